//! The world link: frames to the board and from it. The table of them is in the firmware's `logic::world`.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use logic::world::{BEGIN, PowerOn, World, frame, slot_number};
use sch108bex::health::Battery;
use sch108bex::nonvolatile::{SLOT_OCTETS, Slot};
use sch108bex::sensor::ShaftReading;

use crate::emulator::EmulatorError;

/// How long the board may take to deal with a frame.
const PATIENCE: Duration = Duration::from_secs(10);
/// Octets of the payload of `A`, and of `N`.
const ANSWER: usize = 6;
const RECORD: usize = SLOT_OCTETS + 1;

/// The second USART.
#[derive(Debug)]
pub struct WorldLink {
    stream: UnixStream,
    /// What has come and is not a whole frame yet.
    waiting: Vec<u8>,
}

/// What the board has told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// `N`: a record was written.
    Record(Slot, [u8; SLOT_OCTETS]),
    /// `A`: a frame is dealt with.
    Done(Done),
}

/// An `A` frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// The kind of the frame that is dealt with.
    pub kind: u8,
    /// The lamp and the state of the slave, as the firmware has them.
    pub state: u8,
    /// Latches since power-on.
    pub latches: u32,
}

impl WorldLink {
    /// Takes over the connection.
    ///
    /// # Errors
    ///
    /// The system refuses a time limit.
    pub fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        Ok(Self { stream, waiting: Vec::new() })
    }

    /// Waits until the firmware listens: what comes before is lost.
    ///
    /// # Errors
    ///
    /// It does not answer.
    pub(crate) fn meet(&mut self) -> Result<(), EmulatorError> {
        const AGAIN: Duration = Duration::from_millis(100);
        let limit = |stream: &UnixStream, span| stream.set_read_timeout(Some(span)).map_err(gone);
        limit(&self.stream, AGAIN)?;
        let until = Instant::now() + PATIENCE;
        let mut met = false;
        // Answers to those before may still come; after a pause there are none.
        loop {
            if !met {
                self.cut()?;
            }
            match self.told() {
                Ok(_) => met = true,
                Err(_) if met => return limit(&self.stream, PATIENCE),
                Err(error) if Instant::now() > until => return Err(error),
                Err(_) => {}
            }
        }
    }

    /// What a slot of the memory holds.
    ///
    /// # Errors
    ///
    /// The emulator has gone.
    pub fn memory(&mut self, slot: Slot, octets: &[u8; SLOT_OCTETS]) -> Result<(), EmulatorError> {
        let mut payload = vec![slot_number(slot)];
        payload.extend_from_slice(octets);
        self.send(b'M', &payload)
    }

    /// Power comes.
    ///
    /// # Errors
    ///
    /// The emulator has gone.
    pub fn power_on(&mut self, power_on: &PowerOn) -> Result<(), EmulatorError> {
        self.send(b'P', &power_on_payload(power_on))
    }

    /// The world at the next latch, or as of now.
    ///
    /// # Errors
    ///
    /// The emulator has gone.
    pub fn latch(&mut self, world: &World) -> Result<(), EmulatorError> {
        self.send(b'L', &world_payload(world))
    }

    /// So many latches more with the world as it was.
    ///
    /// # Errors
    ///
    /// The emulator has gone.
    pub fn more(&mut self, latches: u8) -> Result<(), EmulatorError> {
        self.send(b'T', &[latches])
    }

    /// The power is cut.
    ///
    /// # Errors
    ///
    /// The emulator has gone.
    pub fn cut(&mut self) -> Result<(), EmulatorError> {
        self.send(b'C', &[])
    }

    /// Waits until a frame of that kind is dealt with; `record` takes the records that were written meanwhile.
    ///
    /// # Errors
    ///
    /// The board does not answer, or answers something else.
    pub fn done(
        &mut self,
        kind: u8,
        mut record: impl FnMut(Slot, [u8; SLOT_OCTETS]),
    ) -> Result<Done, EmulatorError> {
        loop {
            match self.told()? {
                Told::Record(slot, octets) => record(slot, octets),
                Told::Done(done) if done.kind == kind => return Ok(done),
                Told::Done(done) => {
                    return Err(EmulatorError::Firmware(format!(
                        "has dealt with {:?} where {:?} was sent",
                        char::from(done.kind),
                        char::from(kind)
                    )));
                }
            }
        }
    }

    fn send(&mut self, kind: u8, payload: &[u8]) -> Result<(), EmulatorError> {
        let mut octets = Vec::with_capacity(payload.len() + 3);
        frame(kind, payload, |octet| octets.push(octet));
        self.stream.write_all(&octets).map_err(gone)
    }

    /// The next frame.
    fn told(&mut self) -> Result<Told, EmulatorError> {
        let until = Instant::now() + PATIENCE;
        let mut buffer = [0; 256];
        loop {
            if let Some(told) = take(&mut self.waiting)? {
                return Ok(told);
            }
            if Instant::now() > until {
                return Err(EmulatorError::Firmware("does not answer on the world link".to_owned()));
            }
            match self.stream.read(&mut buffer) {
                Ok(0) => return Err(gone(io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => self.waiting.extend_from_slice(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    return Err(EmulatorError::Firmware("does not answer on the world link".to_owned()));
                }
                Err(error) => return Err(gone(error)),
            }
        }
    }
}

fn gone(error: io::Error) -> EmulatorError {
    EmulatorError::Socket("world link", error)
}

/// The first whole frame of what has come; `None`: none yet.
fn take(waiting: &mut Vec<u8>) -> Result<Option<Told>, EmulatorError> {
    let wrong = |what: &str| EmulatorError::Firmware(format!("sends {what} on the world link"));
    let [begin, kind, rest @ ..] = &waiting[..] else { return Ok(None) };
    if *begin != BEGIN {
        return Err(wrong("octets that are no frame"));
    }
    let length = match kind {
        b'A' => ANSWER,
        b'N' => RECORD,
        _ => return Err(wrong("a frame of no kind that there is")),
    };
    let Some((payload, [check, ..])) = rest.split_at_checked(length) else { return Ok(None) };
    let sum = payload.iter().fold(kind.wrapping_add(*check), |sum, octet| sum.wrapping_add(*octet));
    if sum != 0 {
        return Err(wrong("a frame whose check octet is wrong"));
    }
    let told = match *payload {
        [kind, state, l0, l1, l2, l3] => {
            Told::Done(Done { kind, state, latches: u32::from_le_bytes([l0, l1, l2, l3]) })
        }
        [slot, ref octets @ ..] if slot < 2 => {
            let octets = *octets.first_chunk().ok_or_else(|| wrong("a short record"))?;
            Told::Record(if slot == 0 { Slot::A } else { Slot::B }, octets)
        }
        _ => return Err(wrong("a record for a slot that there is not")),
    };
    waiting.drain(..length + 3);
    Ok(Some(told))
}

const fn battery_number(battery: Battery) -> u8 {
    match battery {
        Battery::Ok => 0,
        Battery::Low => 1,
        Battery::Empty => 2,
    }
}

fn power_on_payload(power_on: &PowerOn) -> [u8; 6] {
    let PowerOn { lock_step, as_delivered, paced, switches, rate, search, battery, variant } = *power_on;
    let flags = u8::from(lock_step) | u8::from(as_delivered) << 1 | u8::from(paced) << 2;
    let rate = rate | u8::from(search) << 7;
    [flags, switches, rate, battery_number(battery), variant.singleturn_bits(), variant.multiturn_bits()]
}

fn world_payload(world: &World) -> [u8; 15] {
    let World { shaft, measurement, termination } = *world;
    let (counts, fault) = match shaft {
        ShaftReading::Full(counts) => (counts, false),
        ShaftReading::Singleturn(counts) => (counts.into(), false),
        ShaftReading::Fault => (0, true),
    };
    let flags = u8::from(!measurement.light_ok)
        | u8::from(fault) << 1
        | u8::from(termination.first) << 2
        | u8::from(termination.second) << 3
        | battery_number(measurement.battery) << 4;
    let mut payload = [0; 15];
    payload[..8].copy_from_slice(&counts.to_le_bytes());
    payload[8..12].copy_from_slice(&measurement.supply_mv.to_le_bytes());
    payload[12..14].copy_from_slice(&measurement.temperature_tenths.to_le_bytes());
    payload[14] = flags;
    payload
}

#[cfg(test)]
mod tests {
    use logic::world::{Message, Reader};
    use sch108bex::end_cap::TerminationSwitches;
    use sch108bex::health::Measurement;
    use sch108bex::specification::Variant;

    use super::*;

    fn read(kind: u8, payload: &[u8]) -> Option<Message> {
        let mut reader = Reader::new();
        let mut message = None;
        frame(kind, payload, |octet| message = reader.take(octet));
        message
    }

    // Octets by hand: 02 is "as delivered", 89 is 12 Mbit/s to begin a search with.
    #[test]
    fn the_firmware_reads_what_power_on_says() {
        let power_on = PowerOn {
            lock_step: false,
            as_delivered: true,
            paced: false,
            switches: 0x2A,
            rate: 9,
            search: true,
            battery: Battery::Low,
            variant: Variant::new(13, 12).expect("a variant"),
        };
        let payload = power_on_payload(&power_on);
        assert_eq!(payload, [0x02, 0x2A, 0x89, 0x01, 13, 12]);
        assert_eq!(read(b'P', &payload), Some(Message::PowerOn(power_on)));
    }

    // -2 counts, 8500 mV = 2134h, -5.0 degrees = FFCEh; light low, second switch, battery empty.
    #[test]
    fn the_firmware_reads_what_a_latch_says() {
        let world = World {
            shaft: ShaftReading::Full(-2),
            measurement: Measurement {
                supply_mv: 8_500,
                temperature_tenths: -50,
                light_ok: false,
                battery: Battery::Empty,
            },
            termination: TerminationSwitches { first: false, second: true },
        };
        let payload = world_payload(&world);
        let due = "FE FF FF FF FF FF FF FF 34 21 00 00 CE FF 29";
        assert_eq!(payload.map(|octet| format!("{octet:02X}")).join(" "), due);
        assert_eq!(read(b'L', &payload), Some(Message::Latch(world)));
        let fault = World { shaft: ShaftReading::Fault, ..world };
        assert_eq!(read(b'L', &world_payload(&fault)), Some(Message::Latch(fault)));
    }

    // Sum of 41 + 4C + 05 + 03 = 95, so 6B makes it 0.
    #[test]
    fn frames_from_the_board_are_taken_whole_or_refused() {
        let whole = [0xA5, b'A', b'L', 0x05, 0x03, 0x00, 0x00, 0x00, 0x6B];
        let mut waiting = whole[..8].to_vec();
        assert_eq!(take(&mut waiting).expect("no fault"), None);
        waiting.extend([0x6B, 0xA5]);
        let done = Told::Done(Done { kind: b'L', state: 5, latches: 3 });
        assert_eq!(take(&mut waiting).expect("no fault"), Some(done));
        assert_eq!(waiting, [0xA5]);
        for (at, wrong) in [(0, 0xA4), (1, b'Z'), (5, 0x01), (8, 0x6C)] {
            let mut octets = whole.to_vec();
            octets[at] = wrong;
            assert!(take(&mut octets).is_err(), "octet {at}");
        }
    }
}
