//! What survives a loss of power (manual 3.4, 4.2.13, 4.2.14), in two slots of 40 octets.
//!
//! | octet | holds |
//! |---|---|
//! | 1-2 | `SC` |
//! | 3 | version of this table: 1 |
//! | 4 | flags: bit 0 position error, bit 1 counter-clockwise, others 0 |
//! | 5-8 | sequence number |
//! | 9 | station address set over the bus, 0 for none |
//! | 10 | 0 |
//! | 11-16 | operating time in ms |
//! | 17-20 | offset value, signed |
//! | 21-24 | measuring units per revolution that it was made under |
//! | 25-28 | total measuring range that it was made under |
//! | 29-32 | turn base, signed |
//! | 33-36 | physical position, FFFFFFFFh for unknown |
//! | 37-40 | CRC-32 of octets 1-36 |
//!
//! All numbers are big endian. Writing goes to the slots in turn, so that a cut while writing
//! leaves the record before. A new store begins by writing both.

use core::fmt;

use crate::end_cap::STATION_ADDRESSES;
use crate::parameterization::CodeSequence;
use crate::specification::Variant;

/// Octets of a slot.
pub const SLOT_OCTETS: usize = 40;

const MAGIC: [u8; 2] = *b"SC";
const VERSION: u8 = 1;
const POSITION_ERROR_BIT: u8 = 0x01;
const COUNTER_CLOCKWISE_BIT: u8 = 0x02;
const KNOWN_FLAGS: u8 = POSITION_ERROR_BIT | COUNTER_CLOCKWISE_BIT;
const OPERATING_TIME_MAX_MS: u64 = 0xFFFF_FFFF_FFFF;
const RAW_UNKNOWN: u32 = u32::MAX;

/// The scaling that an offset was made under, so that tools can warn when another is in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct OffsetScaling {
    /// Steps per revolution that were in force.
    pub measuring_units_per_revolution: u32,
    /// Steps of the whole range that were in force.
    pub total_measuring_range: u32,
    /// The direction that was in force.
    pub code_sequence: CodeSequence,
}

/// All that survives a loss of power.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record {
    /// The station address set over the bus, 1 to 125; `None` as delivered (manual 3.4).
    pub stored_address: Option<u8>,
    /// The offset value (manual 4.2.14).
    pub offset: i32,
    /// What it was made under.
    pub offset_scaling: OffsetScaling,
    /// Time under external power in milliseconds, up to 8900 years (manual 4.2.13).
    pub operating_time_ms: u64,
    /// Whether the position error alarm was set: the next power-on clears it (manual 4.2.2).
    pub position_error: bool,
    /// Turns of the shaft that count as turn 0, for a shaft that delivers its full position.
    pub turn_base: i32,
    /// The physical position when this was written, 0 to 2^31 - 1, for a sensor that delivers
    /// the angle only; `None` as delivered.
    pub raw: Option<u32>,
    /// Not stored: this is the state at delivery because both slots were damaged. The device
    /// raises the position error alarm for it.
    pub both_slots_damaged: bool,
}

/// Why a slot holds no record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SlotFault {
    /// Nothing was ever written: no octets, or all FFh.
    Absent,
    /// Not 40 octets.
    Size,
    /// It is something else: it does not begin with `SC`.
    Foreign,
    /// A version of the table that is not known here.
    Version,
    /// The checksum is wrong.
    Checksum,
    /// The checksum is right, but a value is none that is ever written.
    Content,
}

/// The one or the other slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Slot {
    /// The first 40 octets.
    A,
    /// The second 40 octets.
    B,
}

/// What a slot holds: a record and its sequence number, or why not.
pub type SlotContent = Result<(Record, u32), SlotFault>;

/// What two slots amount to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Nothing was ever written: the device is as delivered.
    AsDelivered,
    /// This record counts.
    Use {
        /// The record.
        record: Record,
        /// Its sequence number.
        sequence: u32,
        /// Where it is; the next goes to the other.
        slot: Slot,
        /// What is wrong with the other slot, if it is damaged.
        other_damaged: Option<SlotFault>,
    },
    /// No record is left, but there was one.
    Lost {
        /// What is wrong with slot A.
        a: SlotFault,
        /// What is wrong with slot B.
        b: SlotFault,
    },
}

impl OffsetScaling {
    /// No scaling, clockwise.
    pub const fn physical(variant: Variant) -> Self {
        Self {
            measuring_units_per_revolution: variant.steps_per_revolution(),
            total_measuring_range: variant.total(),
            code_sequence: CodeSequence::Clockwise,
        }
    }
}

impl Record {
    /// The state at delivery: no address, no offset, no time, no fault.
    pub const fn as_delivered(variant: Variant) -> Self {
        Self {
            stored_address: None,
            offset: 0,
            offset_scaling: OffsetScaling::physical(variant),
            operating_time_ms: 0,
            position_error: false,
            turn_base: 0,
            raw: None,
            both_slots_damaged: false,
        }
    }

    /// Reading: with both slots damaged the device starts as delivered, with the position error
    /// alarm.
    pub const fn after_damage(variant: Variant) -> Self {
        Self { both_slots_damaged: true, ..Self::as_delivered(variant) }
    }

    /// The 40 octets of a slot.
    pub fn encode(&self, sequence: u32) -> [u8; SLOT_OCTETS] {
        let mut slot = [0; SLOT_OCTETS];
        let [_, _, time @ ..] = self.operating_time_ms.min(OPERATING_TIME_MAX_MS).to_be_bytes();
        put(&mut slot, 1, MAGIC);
        put(&mut slot, 3, [VERSION]);
        put(&mut slot, 4, [self.flags()]);
        put(&mut slot, 5, sequence.to_be_bytes());
        put(&mut slot, 9, [self.stored_address.unwrap_or(0)]);
        put(&mut slot, 11, time);
        put(&mut slot, 17, self.offset.to_be_bytes());
        put(&mut slot, 21, self.offset_scaling.measuring_units_per_revolution.to_be_bytes());
        put(&mut slot, 25, self.offset_scaling.total_measuring_range.to_be_bytes());
        put(&mut slot, 29, self.turn_base.to_be_bytes());
        put(&mut slot, 33, self.raw.unwrap_or(RAW_UNKNOWN).to_be_bytes());
        let checksum = crc_32(slot.iter().take(36));
        put(&mut slot, 37, checksum.to_be_bytes());
        slot
    }

    fn flags(&self) -> u8 {
        let turned = self.offset_scaling.code_sequence == CodeSequence::CounterClockwise;
        (if self.position_error { POSITION_ERROR_BIT } else { 0 })
            | (if turned { COUNTER_CLOCKWISE_BIT } else { 0 })
    }

    /// The record in the octets of a slot, and its sequence number.
    ///
    /// # Errors
    ///
    /// Why there is none; every change of one to three bits is found.
    pub fn decode(octets: &[u8]) -> SlotContent {
        if octets.iter().all(|&octet| octet == 0xFF) && matches!(octets.len(), 0 | SLOT_OCTETS) {
            return Err(SlotFault::Absent);
        }
        let slot = <&[u8; SLOT_OCTETS]>::try_from(octets).map_err(|_| SlotFault::Size)?;
        if get(slot, 1) != MAGIC {
            return Err(SlotFault::Foreign);
        }
        if crc_32(slot.iter().take(36)) != u32::from_be_bytes(get(slot, 37)) {
            return Err(SlotFault::Checksum);
        }
        let [version, flags] = get(slot, 3);
        if version != VERSION {
            return Err(SlotFault::Version);
        }
        let record = Self::from_checked(slot, flags).ok_or(SlotFault::Content)?;
        Ok((record, u32::from_be_bytes(get(slot, 5))))
    }

    /// The values in octets whose checksum is right; `None` if one is never written so.
    fn from_checked(slot: &[u8; SLOT_OCTETS], flags: u8) -> Option<Self> {
        let [address, spare] = get(slot, 9);
        let [t5, t4, t3, t2, t1, t0] = get(slot, 11);
        let raw = u32::from_be_bytes(get(slot, 33));
        let offset_scaling = OffsetScaling {
            measuring_units_per_revolution: u32::from_be_bytes(get(slot, 21)),
            total_measuring_range: u32::from_be_bytes(get(slot, 25)),
            code_sequence: CodeSequence::from_bit(flags >> 1),
        };
        let good = flags & !KNOWN_FLAGS == 0
            && spare == 0
            && (address == 0 || STATION_ADDRESSES.contains(&address))
            && (1..=Variant::FULL.steps_per_revolution())
                .contains(&offset_scaling.measuring_units_per_revolution)
            && (1..=Variant::FULL.total()).contains(&offset_scaling.total_measuring_range)
            && (raw == RAW_UNKNOWN || raw < Variant::FULL.total());
        good.then(|| Self {
            stored_address: (address != 0).then_some(address),
            offset: i32::from_be_bytes(get(slot, 17)),
            offset_scaling,
            operating_time_ms: u64::from_be_bytes([0, 0, t5, t4, t3, t2, t1, t0]),
            position_error: flags & POSITION_ERROR_BIT != 0,
            turn_base: i32::from_be_bytes(get(slot, 29)),
            raw: (raw != RAW_UNKNOWN).then_some(raw),
            both_slots_damaged: false,
        })
    }
}

impl Slot {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// Reading: of two slots the newer record counts, sequence numbers wrapping; one damaged, the
/// other is used and the damage told; both damaged is an error. A damaged slot beside one never
/// written is an error too for a host, which makes a new store with both slots in one go; a device
/// that writes octet by octet takes it for a first write that was cut.
pub fn choose(a: SlotContent, b: SlotContent) -> Choice {
    let use_slot = |(record, sequence), slot, other: SlotContent| Choice::Use {
        record,
        sequence,
        slot,
        other_damaged: other.err().filter(|&fault| fault != SlotFault::Absent),
    };
    match (a, b) {
        (Ok(one), Ok(two)) if newer(two.1, one.1) => use_slot(two, Slot::B, a),
        (Ok(one), _) => use_slot(one, Slot::A, b),
        (_, Ok(two)) => use_slot(two, Slot::B, a),
        (Err(SlotFault::Absent), Err(SlotFault::Absent)) => Choice::AsDelivered,
        (Err(a), Err(b)) => Choice::Lost { a, b },
    }
}

/// Whether the one sequence number is after the other, counted on over the end.
const fn newer(one: u32, other: u32) -> bool {
    one.wrapping_sub(other).cast_signed() > 0
}

/// The CRC-32 of IEEE 802.3, bit by bit: a record is written once a second at most.
fn crc_32<'a>(octets: impl Iterator<Item = &'a u8>) -> u32 {
    const POLYNOMIAL: u32 = 0xEDB8_8320;
    let remainder = octets.fold(u32::MAX, |crc, &octet| {
        (0..8).fold(crc ^ u32::from(octet), |crc, _| (crc >> 1) ^ if crc & 1 == 0 { 0 } else { POLYNOMIAL })
    });
    !remainder
}

/// Where the octet with this number stands: the only subtraction.
const fn index(number: u8) -> usize {
    number.saturating_sub(1) as usize
}

fn put<const N: usize>(slot: &mut [u8; SLOT_OCTETS], number: u8, octets: [u8; N]) {
    for (place, octet) in slot.iter_mut().skip(index(number)).zip(octets) {
        *place = octet;
    }
}

fn get<const N: usize>(slot: &[u8; SLOT_OCTETS], number: u8) -> [u8; N] {
    let mut octets = [0; N];
    for (octet, &kept) in octets.iter_mut().zip(slot.iter().skip(index(number))) {
        *octet = kept;
    }
    octets
}

impl fmt::Display for SlotFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Absent => "nothing was ever written",
            Self::Size => "it does not have 40 octets",
            Self::Foreign => "it does not begin like a record of this device",
            Self::Version => "it was written by another version of this program",
            Self::Checksum => "its checksum is wrong",
            Self::Content => "its checksum is right, but a value is out of range",
        })
    }
}

impl core::error::Error for SlotFault {}

#[cfg(test)]
mod tests;
