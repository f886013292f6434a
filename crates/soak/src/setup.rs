//! Who is on the bus.

use bus::VirtualSegment;
use plant::{EncoderSetup, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Duration, Instant};
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::functionality::Functionality;
use sch108bex::nonvolatile::{Record, Slot};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Identity, NonvolatileWrite};

use crate::Options;
use crate::chance::Chance;
use crate::encoder::{Counts, Encoder, Pending, Phase};
use crate::shadow::Shadow;
use crate::station::SoakStation;
use crate::truth::{Scale, Truth};

/// The addresses of the masters.
pub(crate) const MASTERS: [u8; 2] = [2, 3];

/// The first address of an encoder.
pub(crate) const FIRST_ADDRESS: u8 = 4;

/// One in so many has its switches at 126, and its address from its master.
pub(crate) const ONE_IN_HAS_NO_SWITCHES: usize = 8;

pub(crate) fn has_switches(at: usize) -> bool {
    at % ONE_IN_HAS_NO_SWITCHES != 7
}

pub(crate) fn build(options: &Options, chance: &mut Chance) -> (VirtualSegment<SoakStation>, Vec<Encoder>) {
    let mut segment = VirtualSegment::new(Instant::ZERO, options.rate);
    let mut encoders = Vec::new();
    for at in 0..options.encoders.clamp(2, 64) {
        let address = FIRST_ADDRESS + u8::try_from(at).expect("64 at most");
        let functionality = Functionality::ALL[at % Functionality::ALL.len()];
        let variant = variant(at, chance);
        let scale = scale(functionality, variant, chance);
        let shaft = Shaft::constant(rpm(chance), i64::from(chance.below_32(variant.total())), Instant::ZERO);
        let factors = (at % 3 != 0)
            .then(|| (10 + u8::try_from(chance.below(90)).expect("below 90"), 1 + u8::from(chance.is(2))));
        let watchdog = factors.map(|(one, two)| Duration::from_millis(10 * u64::from(one) * u64::from(two)));
        let owner = MASTERS[at % MASTERS.len()];
        let setup = setup(at, address, variant, shaft.clone(), options);
        let shadow = has_shadow(at, options.shadows)
            .then(|| Shadow::new(Instant::ZERO, setup.identity, options.rate, shaft.clone(), setup.world));
        let world = setup.world;
        segment.add(SoakStation::new(Instant::ZERO, setup, shadow, owner, watchdog));
        encoders.push(Encoder {
            address,
            perhaps: None,
            functionality,
            watchdog: factors,
            truth: Truth::new(variant, scale, Instant::ZERO, shaft, world),
            phase: Phase::Look,
            pending: Pending::Perhaps,
            powered: true,
            paused_until: Instant::ZERO,
            not_before: Instant::ZERO,
            good_since: Instant::ZERO,
            preset_at: Instant::ZERO + chance.millis(500, 8_000),
            holds_preset_bit: false,
            operating_time: 0,
            time_base: u8::try_from(at / 3 % 4).expect("0 to 3"),
            counts: Counts::default(),
        });
    }
    (segment, encoders)
}

/// Of every three the one in Scancon 2.0, which has velocities, then the one in class 2.
fn has_shadow(at: usize, shadows: usize) -> bool {
    let (three, within) = (at / 3, at % 3);
    within > 0 && three * 2 + (2 - within) < shadows
}

fn setup(at: usize, address: u8, variant: Variant, shaft: Shaft, options: &Options) -> EncoderSetup {
    let mut store = Store::forgetful();
    if !has_switches(at) {
        let record = Record { stored_address: Some(address), ..Record::as_delivered(variant) };
        let write = NonvolatileWrite { slot: Slot::A, octets: record.encode(1) };
        store.write(&write).expect("memory takes everything");
    }
    EncoderSetup {
        identity: Identity {
            variant,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(if has_switches(at) { address } else { 126 }),
        },
        configurations: Configurations::default(),
        rate: Rate::Search(options.rate),
        termination: TerminationSwitches::ON,
        shaft,
        world: World::default(),
        store,
        reporter: Reporter::new("it", None),
    }
}

fn variant(at: usize, chance: &mut Chance) -> Variant {
    if at.is_multiple_of(2) {
        return Variant::FULL;
    }
    let bits = |most: u64, chance: &mut Chance| u8::try_from(chance.below(most)).expect("few bits");
    Variant::new(2 + bits(15, chance), bits(16, chance)).expect("2x0 to 16x15")
}

fn scale(functionality: Functionality, variant: Variant, chance: &mut Chance) -> Scale {
    let counter_clockwise = chance.is(2);
    if functionality == Functionality::Class1 {
        let (units, range) = (variant.steps_per_revolution(), variant.total());
        return Scale { counter_clockwise, units, range };
    }
    let units = 1 + chance.below_32(variant.steps_per_revolution());
    let most = u64::from(units) << variant.multiturn_bits();
    let range = 1 + u32::try_from(chance.below(most.min(u64::from(variant.total())))).expect("31 bits");
    Scale { counter_clockwise, units, range }
}

/// From standstill to 6000 RPM either way.
pub(crate) fn rpm(chance: &mut Chance) -> f64 {
    if chance.is(5) { 0.0 } else { f64::from(chance.below_32(120_000)) / 10.0 - 6_000.0 }
}
