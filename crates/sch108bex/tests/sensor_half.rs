//! The sensor half as the bus half and the power see it: presets, position errors, power-on.

use profibus_dp::time::{Duration, Instant};
use proptest::prelude::*;
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::event::{Event, Observer, PositionErrorCause};
use sch108bex::functionality::Functionality;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{OffsetScaling, Record};
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};
use sch108bex::refusal::PresetRefusal;
use sch108bex::sensor::ShaftReading::{self, Fault, Full, Singleturn};
use sch108bex::sensor_half::{Demand, SensorHalf};
use sch108bex::specification::{SerialNumber, Variant};

/// Keeps what it saw.
#[derive(Default)]
struct Seen(Vec<Event>);

impl Observer for Seen {
    fn observe(&mut self, _: Instant, event: &Event) {
        self.0.push(*event);
    }
}

impl Seen {
    fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.0)
    }
}

/// A device of which only the sensor half is there, sampled latch by latch.
struct Bench {
    half: SensorHalf,
    seen: Seen,
    now: Instant,
}

impl Bench {
    fn power_on(record: &Record, battery: Battery) -> Self {
        let mut seen = Seen::default();
        let half = SensorHalf::new(Instant::ZERO, Variant::FULL, record, battery, &mut seen);
        Self { half, seen, now: Instant::ZERO }
    }

    fn delivered() -> Self {
        Self::power_on(&Record::as_delivered(Variant::FULL), Battery::Ok)
    }

    /// Power off and on again: only the record survives.
    fn power_cycle(&self, battery: Battery) -> Self {
        let record = self.half.record(self.now, Some(7));
        assert_eq!(record.stored_address, Some(7));
        let (kept, _) = Record::decode(&record.encode(1)).unwrap();
        assert_eq!(kept, record);
        Self::power_on(&kept, battery)
    }

    fn latch(&mut self, reading: ShaftReading) -> u32 {
        self.skip(1, reading)
    }

    /// So many latches later.
    fn skip(&mut self, latches: u64, reading: ShaftReading) -> u32 {
        let due = self.now + Duration::from_micros(500 * (latches - 1));
        assert!(self.half.sample(due, reading, &mut self.seen));
        self.now = due + Duration::from_micros(500);
        self.half.position()
    }

    fn obey(&mut self, demand: Demand) {
        self.half.obey(self.now, demand, &mut self.seen);
    }

    fn exchange(&mut self, functionality: Functionality, parameters: Parameters) {
        self.obey(Demand::Parameterize { functionality, parameters });
    }

    fn alarmed(&self) -> bool {
        self.half.alarms().contains(Alarms::POSITION_ERROR)
    }
}

fn scaled(units: u32, range: u32) -> Parameters {
    Parameters {
        scaling: true,
        measuring_units_per_revolution: units,
        total_measuring_range: range,
        ..Parameters::default_for(Variant::FULL)
    }
}

const DEFAULTS: Parameters = Parameters::default_for(Variant::FULL);

fn raised(cause: PositionErrorCause) -> [Event; 2] {
    [Event::AlarmRaised(Alarms::POSITION_ERROR), Event::PositionErrorCause(cause)]
}

#[test]
fn a_preset_shows_from_the_next_latch_on() {
    let mut bench = Bench::delivered();
    bench.latch(Full(1000));
    bench.exchange(Functionality::Class2, DEFAULTS);
    let before = *bench.half.inputs();
    bench.obey(Demand::Preset(0x8000_1388));
    assert_eq!(*bench.half.inputs(), before, "the answer shows the latch before");
    assert_eq!(bench.half.health().offset, 4000, "the diagnosis has the offset at once");
    let taken = Event::PresetTaken { from: 1000, to: 5000, offset: 4000 };
    assert_eq!(bench.seen.take(), [taken]);
    assert!(bench.half.take_record_change());
    assert!(!bench.half.take_record_change());
    assert_eq!(bench.latch(Full(999)), 4999);
    // A second preset within the same latch starts from what the first made.
    bench.obey(Demand::Preset(10));
    bench.obey(Demand::Preset(20));
    let from = bench.seen.take();
    assert_eq!(from[1], Event::PresetTaken { from: 10, to: 20, offset: 20 - 999 });
}

#[test]
fn a_preset_above_the_range_changes_nothing() {
    let mut bench = Bench::delivered();
    bench.latch(Full(0));
    bench.exchange(Functionality::Scancon2, scaled(1000, 32_000));
    bench.obey(Demand::Preset(32_000));
    let refusal = PresetRefusal { value: 32_000, limit: 31_999 };
    assert_eq!(bench.seen.take(), [Event::PresetRefused(refusal)]);
    assert!(!bench.half.take_record_change());
    assert_eq!((bench.half.offset(), bench.half.alarms()), (0, Alarms::empty()));
    assert_eq!(bench.latch(Full(66)), 1);
    bench.obey(Demand::Preset(31_999));
    assert_eq!(bench.latch(Full(66)), 31_999);
}

#[test]
fn where_there_are_no_outputs_nothing_is_preset() {
    let mut bench = Bench::delivered();
    bench.latch(Full(10));
    bench.obey(Demand::Preset(1));
    bench.exchange(Functionality::Class1, DEFAULTS);
    bench.obey(Demand::Preset(1));
    bench.exchange(Functionality::Class2, DEFAULTS);
    bench.obey(Demand::Leave);
    bench.obey(Demand::Preset(1));
    assert_eq!(bench.seen.take(), []);
    assert_eq!(bench.latch(Full(10)), 10);
}

#[test]
fn class_1_has_the_direction_but_neither_scaling_nor_offset() {
    let mut bench = Bench::delivered();
    bench.latch(Full(65_536));
    bench.exchange(Functionality::Class2, DEFAULTS);
    bench.obey(Demand::Preset(5));
    let turned = Parameters { code_sequence: CodeSequence::CounterClockwise, ..scaled(1000, 32_000) };
    bench.exchange(Functionality::Class1, turned);
    assert_eq!(bench.half.position(), 0x7FFF_0000, "at once, from the latest latch");
    // The offset is kept, and in force again in class 2.
    assert_eq!(bench.half.offset(), 5 - 65_536);
    bench.exchange(Functionality::Class2, DEFAULTS);
    assert_eq!(bench.half.position(), 5);
}

#[test]
fn an_offset_under_another_scaling_is_kept_and_told() {
    let mut bench = Bench::delivered();
    bench.latch(Full(0));
    bench.exchange(Functionality::Class2, DEFAULTS);
    assert_eq!(bench.seen.take(), [], "there is no offset yet");
    bench.obey(Demand::Preset(12_345));
    bench.seen.take();
    bench.exchange(Functionality::Class2, DEFAULTS);
    assert_eq!(bench.seen.take(), [], "the scaling is the same");
    let mut bench = bench.power_cycle(Battery::Ok);
    bench.latch(Full(0));
    bench.exchange(Functionality::Class1, DEFAULTS);
    assert_eq!(bench.seen.take(), [], "class 1 has no offset");
    let turned = Parameters { code_sequence: CodeSequence::CounterClockwise, ..DEFAULTS };
    for other in [scaled(1000, 1000), turned] {
        bench.exchange(Functionality::Class2, other);
        let told = Event::OffsetKeptUnderOtherScaling { offset: 12_345 };
        assert_eq!(bench.seen.take(), [told]);
        assert_eq!(bench.half.record(bench.now, None).offset, 12_345);
    }
    bench.exchange(Functionality::Class2, scaled(1000, 1000));
    assert_eq!(bench.half.position(), 345, "modulo the new range");
    bench.obey(Demand::Preset(1));
    let made_under = bench.half.record(bench.now, None).offset_scaling;
    let expected = OffsetScaling {
        measuring_units_per_revolution: 1000,
        total_measuring_range: 1000,
        code_sequence: CodeSequence::Clockwise,
    };
    assert_eq!(made_under, expected);
}

// Vectors E121: 1000/32000 leaves nothing, 360/1804 leaves 124 of 32768 turns.
#[test]
fn a_range_that_jumps_at_the_overflow_is_told() {
    let mut bench = Bench::delivered();
    bench.latch(Full(0));
    bench.exchange(Functionality::Class2, scaled(1000, 32_000));
    assert_eq!(bench.seen.take(), []);
    bench.exchange(Functionality::Class2, scaled(360, 1804));
    assert_eq!(bench.seen.take(), [Event::JumpAtOverflow { residual: 124 }]);
    bench.exchange(Functionality::Class1, scaled(360, 1804));
    assert_eq!(bench.seen.take(), [], "class 1 has no scaling");
}

#[test]
fn motion_is_measured_in_scancon_2_and_stops_when_the_master_leaves() {
    let parameters = Parameters { time_base: TimeBase::Per10Ms, ..DEFAULTS };
    let turn = |bench: &mut Bench, step: i64| {
        for latch in 0..61 {
            bench.latch(Full(latch * step));
        }
        (bench.half.velocity(), bench.half.acceleration())
    };
    for functionality in [Functionality::Class1, Functionality::Class2] {
        let mut bench = Bench::delivered();
        bench.exchange(functionality, parameters);
        assert_eq!(turn(&mut bench, 5), (0, 0));
    }
    let mut bench = Bench::delivered();
    bench.exchange(Functionality::Scancon2, parameters);
    assert_eq!(turn(&mut bench, 5), (100, 0));
    bench.obey(Demand::Preset(77));
    bench.latch(Full(300));
    assert_eq!(bench.half.inputs().velocity(), 100, "a preset does not touch it");
    bench.obey(Demand::Leave);
    turn(&mut bench, 7);
    assert_eq!(bench.half.velocity(), 100, "stopped, not reset");
    bench.exchange(Functionality::Scancon2, parameters);
    let image = bench.half.inputs();
    assert_eq!((image.velocity(), image.acceleration(), bench.half.velocity()), (0, 0, 0));
    assert_eq!(turn(&mut bench, 5), (100, 0));
}

#[test]
fn turns_of_a_singleturn_sensor_are_counted_both_ways() {
    let mut bench = Bench::delivered();
    assert_eq!(bench.latch(Singleturn(50_000)), 50_000, "delivered in turn 0");
    assert_eq!(bench.latch(Singleturn(65_000)), 65_000);
    assert_eq!(bench.latch(Singleturn(10)), 65_546);
    assert_eq!(bench.latch(Singleturn(65_535)), 65_535);
    assert_eq!(bench.latch(Singleturn(60_000)), 60_000);
    for angle in (0..60_000).rev().step_by(10_000) {
        bench.latch(Singleturn(angle));
    }
    assert_eq!(bench.latch(Singleturn(60_000)), 0x7FFF_EA60, "below 0 comes the last turn");
    assert!(!bench.alarmed());
}

#[test]
fn the_turn_count_of_a_singleturn_sensor_survives_a_loss_of_power() {
    let mut bench = Bench::delivered();
    assert_eq!(bench.half.record(bench.now, None).raw, None, "nothing is known yet");
    for angle in [0, 20_000, 40_000, 60_000, 14_464] {
        bench.skip(3, Singleturn(angle));
    }
    assert_eq!(bench.half.position(), 80_000);
    assert!(!bench.alarmed());
    // By the shorter way, up to half a turn either way.
    for (angle, position) in [(14_464, 80_000), (40_000, 105_536), (60_000, 60_000)] {
        let mut bench = bench.power_cycle(Battery::Ok);
        assert_eq!(bench.half.record(bench.now, None).raw, Some(80_000), "kept before the first latch");
        assert_eq!(bench.latch(Singleturn(angle)), position);
        assert!(!bench.alarmed());
    }
}

proptest! {
    #[test]
    fn a_singleturn_sensor_shows_what_a_full_one_does(
        bits in 2_u8..=16,
        steps in prop::collection::vec(-1.0..=1.0_f64, 1..200),
    ) {
        let variant = Variant::new(bits, 15).unwrap();
        let record = Record::as_delivered(variant);
        let new = || SensorHalf::new(Instant::ZERO, variant, &record, Battery::Ok, &mut ());
        let (mut full, mut single) = (new(), new());
        let per_turn = i64::from(variant.steps_per_revolution());
        let mut counts = 0_i64;
        let mut now = Instant::ZERO;
        for step in steps {
            // Up to a quarter turn.
            #[expect(clippy::cast_possible_truncation, reason = "a fraction of a quarter turn")]
            let way = (step * f64::from(variant.steps_per_revolution() / 4)) as i64;
            if now != Instant::ZERO {
                counts += way;
            }
            let angle = u16::try_from(counts.rem_euclid(per_turn)).unwrap();
            full.sample(now, Full(counts), &mut ());
            single.sample(now, Singleturn(angle), &mut ());
            prop_assert_eq!(full.inputs(), single.inputs());
            prop_assert_eq!(full.physical_position(), single.physical_position());
            now += Duration::from_micros(500);
        }
        prop_assert_eq!(single.alarms(), Alarms::empty());
    }
}

#[test]
fn more_than_a_quarter_turn_within_1_ms_is_a_position_error() {
    for (latches, step, alarmed) in [
        (1, 16_384, false),
        (1, 16_385, true),
        (1, 65_536 - 16_384, false),
        (1, 65_536 - 16_385, true),
        (2, 16_384, false),
        (2, 16_385, true),
        (3, 32_768, false),
    ] {
        let mut bench = Bench::delivered();
        bench.latch(Singleturn(0));
        bench.skip(latches, Singleturn(u16::try_from(step).unwrap()));
        assert_eq!(bench.alarmed(), alarmed, "{step} after {latches} latches");
        let expected = raised(PositionErrorCause::ImplausibleStep);
        assert_eq!(bench.seen.take(), if alarmed { &expected[..] } else { &[] });
        assert_eq!(bench.half.take_record_change(), alarmed);
    }
    // A virtual shaft may jump.
    let mut bench = Bench::delivered();
    bench.latch(Full(0));
    bench.latch(Full(1 << 40));
    assert!(!bench.alarmed());
}

#[test]
fn a_faulty_sensor_raises_the_alarm_once_and_the_position_stays() {
    let mut bench = Bench::delivered();
    bench.latch(Full(77));
    assert_eq!(bench.latch(Fault), 77);
    assert_eq!(bench.latch(Fault), 77);
    assert_eq!(bench.seen.take(), raised(PositionErrorCause::SensorFault));
    assert!(bench.half.take_record_change(), "stored at once");
    assert_eq!(bench.latch(Full(78)), 78);
    assert!(bench.alarmed(), "until the next power-on");
    // Already at the first latch.
    let mut bench = Bench::delivered();
    bench.latch(Fault);
    assert!(bench.alarmed());
    assert_eq!(bench.latch(Full(5)), 5);
}

#[test]
fn the_next_power_on_clears_alarm_turn_count_and_offset() {
    for battery in [Battery::Ok, Battery::Low, Battery::Empty] {
        let mut bench = Bench::delivered();
        bench.latch(Full(10 * 65_536 + 3));
        bench.exchange(Functionality::Class2, DEFAULTS);
        bench.obey(Demand::Preset(1));
        bench.latch(Full(10 * 65_536 + 3));
        bench.half.position_error(bench.now, PositionErrorCause::Injected, &mut bench.seen);
        assert!(bench.alarmed());

        let mut bench = bench.power_cycle(battery);
        assert!(!bench.alarmed());
        assert!(bench.seen.take().contains(&Event::PositionErrorCleared));
        assert!(bench.half.record(bench.now, None).position_error, "not yet done");
        assert!(!bench.half.take_record_change());
        assert_eq!(bench.latch(Full(-12 * 65_536 + 4)), 4, "turn 0 from here on");
        assert!(bench.half.take_record_change());
        bench.exchange(Functionality::Class2, DEFAULTS);
        assert_eq!((bench.half.position(), bench.half.offset()), (4, 0));

        // The restarted count survives the next loss of power.
        let mut bench = bench.power_cycle(Battery::Ok);
        assert_eq!(bench.latch(Full(-11 * 65_536 + 4)), 65_540);
        assert!(!bench.alarmed());
    }
}

#[test]
fn an_empty_battery_loses_the_turns_after_every_good_run() {
    let mut bench = Bench::power_on(&Record::as_delivered(Variant::FULL), Battery::Ok);
    bench.latch(Full(5 * 65_536 + 9));
    bench.exchange(Functionality::Class2, DEFAULTS);
    bench.obey(Demand::Preset(100));

    let mut bench = bench.power_cycle(Battery::Empty);
    assert!(bench.alarmed());
    let seen = bench.seen.take();
    assert_eq!(seen[0], Event::WarningRaised(Warnings::BATTERY_CHARGE));
    assert_eq!(seen[1..], raised(PositionErrorCause::TurnCountLost));
    assert!(bench.half.take_record_change());
    assert_eq!(bench.latch(Full(5 * 65_536 + 9)), 9, "the turn count restarts at 0");
    assert!(bench.half.take_record_change());
    assert_eq!(bench.half.offset(), 100 - (5 * 65_536 + 9), "the offset goes with the alarm");

    let mut bench = bench.power_cycle(Battery::Empty);
    assert!(!bench.alarmed(), "cleared, also with an empty battery");
    assert_eq!((bench.latch(Full(6 * 65_536)), bench.half.offset()), (0, 0));

    let bench = bench.power_cycle(Battery::Empty);
    assert!(bench.alarmed(), "the run before was one without the alarm");
}

#[test]
fn a_low_battery_only_warns() {
    let mut bench = Bench::delivered();
    bench.latch(Full(5 * 65_536));
    let mut bench = bench.power_cycle(Battery::Low);
    assert_eq!(bench.half.warnings(), Warnings::BATTERY_CHARGE);
    assert!(!bench.alarmed());
    assert_eq!(bench.latch(Full(5 * 65_536)), 5 * 65_536);
    // Getting empty while there is power loses nothing yet.
    let empty = Measurement { battery: Battery::Empty, ..Measurement::GOOD };
    bench.half.measure(bench.now, &empty, &mut bench.seen);
    assert!(!bench.alarmed());
}

#[test]
fn two_damaged_records_raise_the_alarm() {
    let record = Record::after_damage(Variant::FULL);
    let mut bench = Bench::power_on(&record, Battery::Ok);
    assert_eq!(bench.seen.take(), raised(PositionErrorCause::BothRecordsDamaged));
    assert!(bench.half.take_record_change());
    assert_eq!(bench.latch(Full(65_537)), 65_537);
    let bench = bench.power_cycle(Battery::Ok);
    assert!(!bench.alarmed());
}

#[test]
fn operating_time_goes_into_the_record_and_the_deadlines() {
    let mut bench = Bench::delivered();
    let six_minutes = Instant::from_millis(360_000);
    assert_eq!(bench.half.next_deadline(), Some(six_minutes));
    bench.half.poll(six_minutes, &mut bench.seen);
    assert_eq!(bench.half.health().operating_time.tenths(), 1);
    assert_eq!(bench.half.record(Instant::from_millis(400_000), None).operating_time_ms, 400_000);
    let low = Measurement { supply_mv: 1, ..Measurement::GOOD };
    bench.half.measure(six_minutes, &low, &mut bench.seen);
    assert_eq!(bench.half.alarms(), Alarms::SUPPLY_VOLTAGE);
    bench.half.measure(six_minutes, &Measurement::GOOD, &mut bench.seen);
    assert_eq!(bench.half.next_deadline(), Some(Instant::from_millis(360_100)));
    bench.half.poll(Instant::from_millis(360_100), &mut bench.seen);
    assert_eq!(bench.half.alarms(), Alarms::empty());
}

#[test]
fn the_diagnosis_has_its_short_form_outside_data_exchange() {
    let mut bench = Bench::delivered();
    let serial = SerialNumber::DEFAULT;
    let turned = Parameters { code_sequence: CodeSequence::CounterClockwise, ..scaled(1000, 32_000) };
    assert_eq!(bench.half.diagnostics(&serial).class_2_part, None);
    bench.exchange(Functionality::Class2, turned);
    let inside = bench.half.diagnostics(&serial);
    assert_eq!(inside.operating_status(), 0x0B);
    assert_eq!(inside.class_2_part.unwrap().total_measuring_range, 32_000);
    bench.obey(Demand::Leave);
    let outside = bench.half.diagnostics(&serial);
    assert_eq!((outside.operating_status(), outside.class_2_part), (0, None));
    bench.exchange(Functionality::Class1, turned);
    assert_eq!(bench.half.diagnostics(&serial).operating_status(), 0x01);
}

#[test]
fn it_is_small() {
    assert!(size_of::<SensorHalf>() < 400, "{} octets", size_of::<SensorHalf>());
    assert!(size_of::<Record>() < 64 && size_of::<Event>() <= 24);
}
