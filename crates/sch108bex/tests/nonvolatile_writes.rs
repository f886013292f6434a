//! When the whole device wants its record written.

use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::diagnostics::Alarms;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::PositionErrorCause;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SlotContent, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Device, Identity, PowerOn};

const GOOD: Measurement =
    Measurement { supply_mv: 24_000, temperature_tenths: 200, light_ok: true, battery: Battery::Ok };

fn device(stored: Choice) -> Device {
    let mut device = device_with(stored, Battery::Ok);
    device.measure(Instant::ZERO, &GOOD);
    device.sample(Instant::ZERO, ShaftReading::Full(0));
    device
}

fn device_with(stored: Choice, battery: Battery) -> Device {
    let identity = Identity {
        variant: Variant::FULL,
        ident_number: PLACEHOLDER_IDENT,
        serial_number: SerialNumber::DEFAULT,
        switches: RotarySwitches(11),
    };
    let power_on = PowerOn {
        identity,
        stored,
        battery,
        baud: BaudSetting::Fixed(Baudrate::B500000),
        receiver: ReceiverMode::Idle,
    };
    Device::new(Instant::ZERO, power_on, ())
}

/// Writes what is wanted at `now`.
fn write(device: &mut Device, now: Instant) -> Option<Record> {
    let write = device.take_nonvolatile(now)?;
    device.confirm_nonvolatile();
    Some(Record::decode(&write.octets).expect("a record").0)
}

/// Writes everything until nothing is wanted any more.
fn settle(device: &mut Device, until: Instant) {
    let mut now = Instant::ZERO;
    while now < until {
        let _ = write(device, now);
        now += Duration::from_millis(50);
    }
}

// Reading "Position error": stored at once, also when something was written just before.
#[test]
fn a_position_error_is_stored_at_once() {
    let mut device = device(Choice::AsDelivered);
    settle(&mut device, Instant::from_millis(2_000));
    let now = Instant::from_millis(2_000);
    device.shut_down();
    assert!(write(&mut device, now).is_some_and(|record| !record.position_error));
    device.position_error(now, PositionErrorCause::Injected);
    assert!(write(&mut device, now).is_some_and(|record| record.position_error));
    assert!(device.sensor().alarms().contains(Alarms::POSITION_ERROR));
}

// Reading "Operating time": written when the supply falls.
#[test]
fn the_operating_time_is_stored_when_the_supply_falls() {
    let mut device = device(Choice::AsDelivered);
    settle(&mut device, Instant::from_millis(2_000));
    let now = Instant::from_millis(100_000);
    device.poll(now);
    assert_eq!(write(&mut device, now), None, "nothing has changed");
    device.measure(now, &Measurement { supply_mv: 8_900, ..GOOD });
    assert_eq!(write(&mut device, now).map(|record| record.operating_time_ms), Some(100_000));
}

// Reading "Non-volatile writes": every 6 minutes, to the two slots in turn.
#[test]
fn records_go_to_the_slots_in_turn_and_the_newest_counts() {
    let mut device = device(Choice::AsDelivered);
    let mut slots = [Record::decode(&[]), Record::decode(&[])];
    let mut used = Vec::new();
    for minutes in [6u64, 12, 18] {
        let now = Instant::from_millis(minutes * 60_000);
        device.poll(now);
        let write = device.take_nonvolatile(now).expect("six minutes are over");
        assert_eq!(device.take_nonvolatile(now), None, "one at a time");
        device.confirm_nonvolatile();
        used.push(write.slot);
        slots[write.slot as usize] = Record::decode(&write.octets);
    }
    assert_eq!(used[0], used[2]);
    assert_ne!(used[0], used[1]);
    let Choice::Use { record, .. } = choose(slots[0], slots[1]) else { panic!("two good slots") };
    assert_eq!(record.operating_time_ms, 18 * 60_000);
}

#[test]
fn a_write_that_failed_is_tried_again_to_the_same_slot() {
    let mut device = device(Choice::AsDelivered);
    device.shut_down();
    let now = Instant::from_millis(10);
    let first = device.take_nonvolatile(now).expect("forced");
    device.nonvolatile_failed(now);
    assert_eq!(device.take_nonvolatile(now), None, "not in a tight loop");
    let again = device.take_nonvolatile(now + Duration::from_secs(1)).expect("a second later");
    assert_eq!(again.slot, first.slot);
}

/// Both slots, as a host keeps them.
type Slots = [SlotContent; 2];

fn keep(device: &mut Device, slots: &mut Slots, now: Instant) {
    while let Some(write) = device.take_nonvolatile(now) {
        slots[write.slot as usize] = Record::decode(&write.octets);
        device.confirm_nonvolatile();
    }
}

// Reading "Position error": the next power-on clears alarm, turn count and offset; an empty battery
// raises it only at a power-on that follows a run without the alarm. Cleared means: kept as cleared,
// before anything cuts the power again.
#[test]
fn a_power_on_that_clears_a_position_error_is_kept_at_once() {
    let mut slots = [Record::decode(&[]), Record::decode(&[])];
    let mut raised = Vec::new();
    for _ in 0..4 {
        let now = Instant::ZERO;
        let mut device = device_with(choose(slots[0], slots[1]), Battery::Empty);
        device.measure(now, &Measurement { battery: Battery::Empty, ..GOOD });
        device.sample(now, ShaftReading::Full(5 * 65_536 + 100));
        keep(&mut device, &mut slots, now);
        raised.push(device.sensor().alarms().contains(Alarms::POSITION_ERROR));
        let waits = device.next_deadline().expect("the operating time");
        assert!(waits > Instant::from_millis(10_000), "a cut may come before {waits:?}");
    }
    assert_eq!(raised, [true, false, true, false]);
}
