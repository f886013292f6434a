use super::*;
use std::string::ToString;
use std::vec::Vec;

/// Keeps what it saw.
#[derive(Default)]
struct Seen(Vec<(u64, Event)>);

impl Observer for Seen {
    fn observe(&mut self, now: Instant, event: &Event) {
        self.0.push((now.as_nanos() / 1_000_000, *event));
    }
}

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn supply(supply_mv: i32) -> Measurement {
    Measurement { supply_mv, ..Measurement::GOOD }
}

fn new() -> Supervision {
    Supervision::new(at(0), 0, Battery::Ok, &mut ())
}

// Manual 4.2.2: 9 V to 30 V, both ends inside.
#[test]
fn the_supply_alarm_comes_at_once_outside_the_range() {
    for (millivolts, alarm) in
        [(9_000, false), (8_999, true), (30_000, false), (30_001, true), (-24_000, true)]
    {
        let mut supervision = new();
        supervision.measure(at(1), &supply(millivolts), &mut ());
        let raised = supervision.alarms().contains(Alarms::SUPPLY_VOLTAGE);
        assert_eq!(raised, alarm, "{millivolts}");
    }
}

#[test]
fn the_supply_alarm_goes_100_ms_after_the_voltage_is_back() {
    let mut seen = Seen::default();
    let mut supervision = new();
    supervision.measure(at(10), &supply(8_000), &mut seen);
    supervision.measure(at(20), &supply(24_000), &mut seen);
    assert_eq!(supervision.next_deadline(), at(120));
    supervision.measure(at(60), &supply(24_000), &mut seen);
    supervision.poll(at(119), &mut seen);
    assert_eq!(supervision.alarms(), Alarms::SUPPLY_VOLTAGE);
    supervision.poll(at(120), &mut seen);
    assert_eq!(supervision.alarms(), Alarms::empty());
    let expected = [
        (10, Event::AlarmRaised(Alarms::SUPPLY_VOLTAGE)),
        (120, Event::AlarmCleared(Alarms::SUPPLY_VOLTAGE)),
    ];
    assert_eq!(seen.0, expected);
}

#[test]
fn a_new_dip_starts_the_100_ms_anew() {
    let mut supervision = new();
    supervision.measure(at(10), &supply(8_000), &mut ());
    supervision.measure(at(20), &supply(24_000), &mut ());
    supervision.measure(at(90), &supply(31_000), &mut ());
    supervision.measure(at(95), &supply(24_000), &mut ());
    supervision.poll(at(194), &mut ());
    assert_eq!(supervision.alarms(), Alarms::SUPPLY_VOLTAGE);
    supervision.poll(at(195), &mut ());
    assert_eq!(supervision.alarms(), Alarms::empty());
}

#[test]
fn warnings_follow_what_is_measured() {
    let mut seen = Seen::default();
    let mut supervision = new();
    let hot = Measurement { temperature_tenths: 651, ..Measurement::GOOD };
    let warm = Measurement { temperature_tenths: 650, ..Measurement::GOOD };
    let dark = Measurement { light_ok: false, ..Measurement::GOOD };
    let low = Measurement { battery: Battery::Low, ..Measurement::GOOD };
    let empty = Measurement { battery: Battery::Empty, ..Measurement::GOOD };
    for (measurement, warnings) in [
        (hot, Warnings::TEMPERATURE_EXCEEDED),
        (warm, Warnings::empty()),
        (dark, Warnings::LIGHT_CONTROL_RESERVE),
        (low, Warnings::BATTERY_CHARGE),
        (empty, Warnings::BATTERY_CHARGE),
    ] {
        supervision.measure(at(1), &measurement, &mut seen);
        assert_eq!(supervision.warnings(), warnings, "{measurement:?}");
        assert_eq!(supervision.alarms(), Alarms::empty());
    }
    let expected = [
        (1, Event::WarningRaised(Warnings::TEMPERATURE_EXCEEDED)),
        (1, Event::WarningCleared(Warnings::TEMPERATURE_EXCEEDED)),
        (1, Event::WarningRaised(Warnings::LIGHT_CONTROL_RESERVE)),
        (1, Event::WarningRaised(Warnings::BATTERY_CHARGE)),
        (1, Event::WarningCleared(Warnings::LIGHT_CONTROL_RESERVE)),
    ];
    assert_eq!(seen.0, expected);
}

// Manual 4.2.13: 61 is 6 hours and 6 minutes.
#[test]
fn operating_time_is_in_tenths_of_an_hour() {
    let time = OperatingTime::from_millis(61 * 360_000);
    assert_eq!((time.tenths(), time.hours(), time.minutes()), (61, 6, 6));
    assert_eq!(time.to_string(), "6 h 6 min");
    assert_eq!(OperatingTime::from_millis(61 * 360_000 - 1), OperatingTime(60));
    assert_eq!(OperatingTime::from_millis(u64::MAX), OperatingTime(u32::MAX));
}

#[test]
fn operating_time_goes_on_from_the_record() {
    let mut supervision = Supervision::new(at(1_000), 359_000, Battery::Ok, &mut ());
    assert_eq!(supervision.operating_time(), OperatingTime(0));
    assert_eq!(supervision.next_deadline(), at(2_000));
    supervision.poll(at(1_999), &mut ());
    assert_eq!(supervision.operating_time(), OperatingTime(0));
    supervision.poll(at(2_000), &mut ());
    assert_eq!(supervision.operating_time(), OperatingTime(1));
    assert_eq!(supervision.next_deadline(), at(362_000));
    supervision.poll(at(722_000), &mut ());
    assert_eq!(supervision.operating_time(), OperatingTime(3));
    assert_eq!(supervision.operating_time_ms(at(722_000)), 1_080_000);
}

// Manual 4.2.9, bit 4: above 87600 h.
#[test]
fn the_operating_time_warning_is_strictly_above_the_limit_and_stays() {
    let mut seen = Seen::default();
    let limit_ms = 876_000 * 360_000;
    let mut supervision = Supervision::new(at(0), limit_ms, Battery::Ok, &mut seen);
    supervision.poll(at(359_999), &mut seen);
    assert_eq!(supervision.warnings(), Warnings::empty());
    supervision.poll(at(360_000), &mut seen);
    supervision.measure(at(360_001), &Measurement::GOOD, &mut seen);
    assert_eq!(supervision.warnings(), Warnings::OPERATING_TIME_LIMIT);
    assert_eq!(seen.0, [(360_000, Event::WarningRaised(Warnings::OPERATING_TIME_LIMIT))]);
}

#[test]
fn a_position_error_stays_whatever_is_measured() {
    let mut supervision = new();
    assert!(supervision.raise_position_error(at(1), &mut ()));
    assert!(!supervision.raise_position_error(at(2), &mut ()));
    supervision.measure(at(3), &supply(8_000), &mut ());
    assert_eq!(supervision.alarms(), Alarms::SUPPORTED);
    supervision.measure(at(4), &Measurement::GOOD, &mut ());
    supervision.poll(at(1_000), &mut ());
    assert_eq!(supervision.alarms(), Alarms::POSITION_ERROR);
}
