//! A device of which the sensor half is there, set up from the inputs of a vector.

use profibus_dp::time::{Duration, Instant};
use sch108bex::functionality::Functionality;
use sch108bex::health::Battery;
use sch108bex::nonvolatile::Record;
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};
use sch108bex::sensor::ShaftReading;
use sch108bex::sensor_half::{Demand, SensorHalf};
use sch108bex::specification::Variant;

use crate::vector::Vector;

const LATCH: Duration = Duration::from_micros(500);

pub(crate) struct Bench {
    pub(crate) half: SensorHalf,
    pub(crate) now: Instant,
}

impl Bench {
    pub(crate) fn power_on(record: &Record, variant: Variant) -> Self {
        let now = Instant::from_millis(1);
        let half = SensorHalf::new(now, variant, record, Battery::Ok, &mut ());
        Self { half, now }
    }

    pub(crate) fn delivered(variant: Variant) -> Self {
        Self::power_on(&Record::as_delivered(variant), variant)
    }

    /// The latch that is due, and time goes on to the next.
    pub(crate) fn latch(&mut self, physical: i64) {
        assert!(self.half.sample(self.now, ShaftReading::Full(physical), &mut ()));
        self.now += LATCH;
    }

    /// So many milliseconds of latches, the shaft standing still.
    pub(crate) fn stand(&mut self, ms: u64, physical: i64) {
        for _ in 0..ms * 2 {
            self.latch(physical);
        }
    }

    pub(crate) fn obey(&mut self, demand: Demand) {
        self.half.obey(self.now, demand, &mut ());
    }

    pub(crate) fn exchange(&mut self, functionality: Functionality, parameters: Parameters) {
        self.obey(Demand::Parameterize { functionality, parameters });
    }
}

/// The bits of the vector's encoder; the full ones where it does not say.
pub(crate) fn variant(vector: &Vector) -> Variant {
    let bits = |key| vector.int(key).map(|bits| u8::try_from(bits).expect("few bits"));
    match (bits("n"), bits("m")) {
        (Some(n), Some(m)) => Variant::new(n, m).expect("a variant"),
        _ => Variant::FULL,
    }
}

pub(crate) fn functionality(name: &str) -> Functionality {
    let named = |functionality: &Functionality| functionality.to_string() == name;
    Functionality::ALL.into_iter().find(named).expect("one of the three")
}

/// Parameters from the inputs `ccw`, `scaling`, `mur`, `tmr` and `time_base`, whichever there are.
pub(crate) fn parameters(vector: &Vector, variant: Variant) -> Parameters {
    let defaults = Parameters::default_for(variant);
    let number = |key| vector.int(key).map(|value| u32::try_from(value).expect("32 bits"));
    let turned = vector.flag("ccw") || vector.text("code_sequence") == "counter-clockwise";
    let time_base = vector
        .int("time_base")
        .map(|base| TimeBase::from_octet(u8::try_from(base).expect("an octet")).expect("0 to 3"));
    Parameters {
        code_sequence: CodeSequence::from_bit(turned.into()),
        scaling: vector.flag("scaling"),
        measuring_units_per_revolution: number("mur").unwrap_or(defaults.measuring_units_per_revolution),
        total_measuring_range: number("tmr").unwrap_or(defaults.total_measuring_range),
        time_base: time_base.unwrap_or_default(),
        ..defaults
    }
}
