//! Sampling only where it matters must answer like sampling every 500 us, and both like the
//! definitions of position, velocity and acceleration.

use profibus_dp::time::{Duration, Instant};
use proptest::prelude::*;
use sch108bex::functionality::Functionality;
use sch108bex::health::Battery;
use sch108bex::nonvolatile::Record;
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};
use sch108bex::sensor::ShaftReading;
use sch108bex::sensor_half::{Demand, SensorHalf};
use sch108bex::specification::Variant;

const POWER_ON: Instant = Instant::from_nanos(123_456_789);
const LATCH_NS: u64 = 500_000;

/// What happens at an instant, after the latches up to it.
#[derive(Debug, Clone)]
enum Step {
    Answer,
    Obey(Demand),
}

/// A shaft as a function of time: it swings, so that speed and direction change.
#[derive(Debug, Clone, Copy)]
struct Shaft {
    start: i64,
    rpm: i64,
    period_ms: i64,
}

impl Shaft {
    fn at(self, instant: Instant) -> i64 {
        let ns = i128::from(instant.since(POWER_ON).as_nanos());
        let period = i128::from(self.period_ms) * 1_000_000;
        let (half, phase) = (ns / period, ns % period);
        let way = if half % 2 == 0 { phase } else { period - phase };
        let counts = way * i128::from(self.rpm) * 65_536 / 60_000_000_000;
        self.start + i64::try_from(counts).unwrap()
    }
}

fn new(variant: Variant) -> SensorHalf {
    let record = Record::as_delivered(variant);
    SensorHalf::new(POWER_ON, variant, &record, Battery::Ok, &mut ())
}

fn eagerly(half: &mut SensorHalf, next: &mut Instant, now: Instant, shaft: Shaft) {
    while *next <= now {
        assert!(half.sample(*next, ShaftReading::Full(shaft.at(*next)), &mut ()));
        *next += Duration::from_nanos(LATCH_NS);
    }
}

fn lazily(half: &mut SensorHalf, now: Instant, shaft: Shaft) -> u32 {
    let mut samples = 0;
    while let Some(latch) = half.latch_needed(now) {
        assert_eq!(latch.since(POWER_ON).as_nanos() % LATCH_NS, 0, "on the grid");
        assert!(latch <= now);
        assert!(half.sample(latch, ShaftReading::Full(shaft.at(latch)), &mut ()));
        samples += 1;
    }
    samples
}

/// Position, velocity and acceleration by their definitions, in wide numbers.
struct ByDefinition {
    variant: Variant,
    functionality: Functionality,
    parameters: Parameters,
    /// Index of the first latch after the parameters came.
    first: u64,
}

impl ByDefinition {
    fn directed(&self, physical: i64) -> i128 {
        match self.parameters.code_sequence {
            CodeSequence::Clockwise => physical.into(),
            CodeSequence::CounterClockwise => -i128::from(physical),
        }
    }

    fn scale(&self) -> (i128, i128) {
        if self.functionality != Functionality::Class1 && self.parameters.scaling {
            let units = self.parameters.measuring_units_per_revolution;
            (units.into(), self.parameters.total_measuring_range.into())
        } else {
            (self.variant.steps_per_revolution().into(), self.variant.total().into())
        }
    }

    fn position(&self, physical: i64, offset: i32) -> u32 {
        let (units, range) = self.scale();
        let within = self.directed(physical).rem_euclid(self.variant.total().into());
        let scaled = within * units / i128::from(self.variant.steps_per_revolution());
        let offset = if self.functionality == Functionality::Class1 { 0 } else { offset };
        (scaled + i128::from(offset)).rem_euclid(range).try_into().unwrap()
    }

    fn motion(&self, latch: u64, shaft: Shaft) -> (i32, i32) {
        let steps = i128::from(self.variant.steps_per_revolution());
        let rpm = self.parameters.time_base == TimeBase::Rpm;
        let window = match self.parameters.time_base {
            TimeBase::Per10Ms => 20,
            TimeBase::Per100Ms | TimeBase::Rpm => 200,
            TimeBase::Per1000Ms => 2000,
        };
        if latch < self.first + window || self.functionality != Functionality::Scancon2 {
            return (0, 0);
        }
        let windows = (latch - self.first) / window;
        let at = |window_index: u64| {
            let index = self.first + window_index * window;
            let directed = self.directed(shaft.at(POWER_ON + Duration::from_nanos(index * LATCH_NS)));
            if rpm { directed } else { (directed * self.scale().0).div_euclid(steps) }
        };
        let rounded = |counts: i128, factor: i128| {
            let size = (counts.abs() * factor * 2 + steps) / (2 * steps);
            size * counts.signum()
        };
        let latest = at(windows) - at(windows - 1);
        let change = if windows < 2 { 0 } else { latest - (at(windows - 1) - at(windows - 2)) };
        let (velocity, acceleration) =
            if rpm { (rounded(latest, 600), rounded(change, 6000)) } else { (latest, change) };
        (velocity.try_into().unwrap(), acceleration.try_into().unwrap())
    }
}

fn shafts() -> impl Strategy<Value = Shaft> {
    (any::<i32>(), -6000_i64..6000, 1_i64..4000).prop_map(|(start, rpm, period_ms)| Shaft {
        start: start.into(),
        rpm,
        period_ms,
    })
}

fn demands(variant: Variant) -> impl Strategy<Value = Demand> {
    let units = variant.steps_per_revolution();
    let range = variant.total();
    let parameters = (any::<bool>(), any::<bool>(), 1..=units, 1..=range, 0_u8..4, 0_usize..5);
    let parameterize = parameters.prop_map(move |(turned, scaling, units, range, base, which)| {
        let functionality = *Functionality::ALL.get(which).unwrap_or(&Functionality::Scancon2);
        let parameters = Parameters {
            code_sequence: CodeSequence::from_bit(turned.into()),
            scaling,
            measuring_units_per_revolution: units,
            total_measuring_range: range,
            time_base: TimeBase::from_octet(base).unwrap(),
            ..Parameters::default_for(variant)
        };
        Demand::Parameterize { functionality, parameters }
    });
    prop_oneof![
        4 => parameterize,
        4 => any::<u32>().prop_map(Demand::Preset),
        2 => (0_u32..5000).prop_map(Demand::Preset),
        1 => Just(Demand::Leave),
    ]
}

/// Pauses up to a few windows of the longest time base, on and off the grid of latches.
fn pauses() -> impl Strategy<Value = u64> {
    prop_oneof![
        Just(0),
        0_u64..2_000_000,
        (0_u64..4000).prop_map(|latches| latches * LATCH_NS),
        0_u64..400_000_000,
        0_u64..9_000_000_000,
    ]
}

fn schedules() -> impl Strategy<Value = (Variant, Shaft, Vec<(u64, Step)>)> {
    (2_u8..=16, 0_u8..=15).prop_flat_map(|(n, m)| {
        let variant = Variant::new(n, m).unwrap();
        let step = prop_oneof![
            3 => Just(Step::Answer),
            2 => demands(variant).prop_map(Step::Obey),
        ];
        (Just(variant), shafts(), prop::collection::vec((pauses(), step), 1..25))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn lazy_eager_and_the_definitions_agree((variant, shaft, schedule) in schedules()) {
        let (mut eager, mut lazy) = (new(variant), new(variant));
        let (mut now, mut next) = (POWER_ON, POWER_ON);
        let mut definition = ByDefinition {
            variant,
            functionality: Functionality::Class1,
            parameters: Parameters::default_for(variant),
            first: u64::MAX,
        };
        let mut left = false;
        for (pause, step) in schedule {
            now += Duration::from_nanos(pause);
            eagerly(&mut eager, &mut next, now, shaft);
            lazily(&mut lazy, now, shaft);
            let latch = now.since(POWER_ON).as_nanos() / LATCH_NS;
            match step {
                Step::Answer => {
                    prop_assert_eq!(eager.inputs(), lazy.inputs());
                    prop_assert_eq!(eager.record(now, None), lazy.record(now, None));
                }
                Step::Obey(demand) => {
                    eager.obey(now, demand, &mut ());
                    lazy.obey(now, demand, &mut ());
                    if let Demand::Parameterize { functionality, parameters } = demand {
                        definition.functionality = functionality;
                        definition.parameters = parameters;
                        definition.first = latch + 1;
                    }
                    left = match demand {
                        Demand::Parameterize { .. } => false,
                        Demand::Leave => true,
                        Demand::Preset(_) => left,
                    };
                    prop_assert_eq!(eager.inputs(), lazy.inputs());
                }
            }
            if definition.first != u64::MAX && !left {
                let motion = definition.motion(latch, shaft);
                prop_assert_eq!((lazy.velocity(), lazy.acceleration()), motion);
            }
            // A preset shows from the next latch on.
            now += Duration::from_nanos(LATCH_NS);
            eagerly(&mut eager, &mut next, now, shaft);
            lazily(&mut lazy, now, shaft);
            prop_assert_eq!(eager.inputs(), lazy.inputs());
            let physical = lazy.physical_position();
            prop_assert_eq!(lazy.position(), definition.position(physical, lazy.offset()));
        }
    }

    #[test]
    fn after_a_long_pause_few_samples_are_needed(pause_s in 0_u64..100_000, base in 0_u8..4) {
        let mut half = new(Variant::FULL);
        let shaft = Shaft { start: 7, rpm: 3000, period_ms: 1500 };
        let parameters = Parameters {
            time_base: TimeBase::from_octet(base).unwrap(),
            ..Parameters::default_for(Variant::FULL)
        };
        let functionality = Functionality::Scancon2;
        lazily(&mut half, POWER_ON, shaft);
        half.obey(POWER_ON, Demand::Parameterize { functionality, parameters }, &mut ());
        let now = POWER_ON + Duration::from_secs(pause_s);
        prop_assert!(lazily(&mut half, now, shaft) <= 4);
        prop_assert_eq!(half.latch_needed(now), None);
    }
}

#[test]
fn a_call_before_the_next_latch_is_ignored() {
    let mut half = new(Variant::FULL);
    let before = Instant::from_nanos(POWER_ON.as_nanos() - 1);
    assert!(!half.sample(before, ShaftReading::Full(5), &mut ()));
    assert!(half.sample(POWER_ON, ShaftReading::Full(6), &mut ()));
    assert!(!half.sample(POWER_ON, ShaftReading::Full(7), &mut ()));
    let almost = POWER_ON + Duration::from_nanos(LATCH_NS - 1);
    assert!(!half.sample(almost, ShaftReading::Full(8), &mut ()));
    assert_eq!(half.position(), 6);
    // A late call takes the latch that it is late for; the grid stays.
    assert!(half.sample(almost + Duration::from_nanos(100_000), ShaftReading::Full(9), &mut ()));
    assert_eq!(half.position(), 9);
    assert_eq!(half.latch_needed(POWER_ON + Duration::from_nanos(2 * LATCH_NS - 1)), None);
    let third = POWER_ON + Duration::from_nanos(2 * LATCH_NS);
    assert_eq!(half.latch_needed(third), Some(third));
    // Skipping goes to the latest latch.
    let fourth = POWER_ON + Duration::from_nanos(3 * LATCH_NS);
    assert_eq!(half.latch_needed(fourth), Some(fourth));
    let far = POWER_ON + Duration::from_nanos(10 * LATCH_NS + 3);
    assert!(half.sample(far, ShaftReading::Full(10), &mut ()));
    assert!(!half.sample(
        POWER_ON + Duration::from_nanos(11 * LATCH_NS - 1),
        ShaftReading::Full(11),
        &mut ()
    ));
    assert!(half.sample(POWER_ON + Duration::from_nanos(11 * LATCH_NS), ShaftReading::Full(12), &mut ()));
}

#[test]
fn a_latch_that_comes_late_stands_for_its_boundary() {
    let mut half = new(Variant::FULL);
    let latch = |index: u64| POWER_ON + Duration::from_nanos(index * LATCH_NS);
    half.sample(POWER_ON, ShaftReading::Full(0), &mut ());
    let parameters = Parameters { time_base: TimeBase::Per10Ms, ..Parameters::default_for(Variant::FULL) };
    let functionality = Functionality::Scancon2;
    half.obey(POWER_ON, Demand::Parameterize { functionality, parameters }, &mut ());
    half.sample(latch(1), ShaftReading::Full(0), &mut ());
    // The boundary at latch 21 is missed by one latch, the next stays where it was.
    half.sample(latch(22), ShaftReading::Full(100), &mut ());
    assert_eq!((half.velocity(), half.acceleration()), (100, 0));
    half.sample(latch(40), ShaftReading::Full(200), &mut ());
    assert_eq!((half.velocity(), half.acceleration()), (100, 0));
    half.sample(latch(41), ShaftReading::Full(250), &mut ());
    assert_eq!((half.velocity(), half.acceleration()), (150, 50));
    // A whole window missed: it starts anew.
    half.sample(latch(81), ShaftReading::Full(1000), &mut ());
    assert_eq!((half.velocity(), half.acceleration()), (0, 0));
    half.sample(latch(101), ShaftReading::Full(1010), &mut ());
    assert_eq!((half.velocity(), half.acceleration()), (10, 0));
}
