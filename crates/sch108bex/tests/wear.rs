//! How often the memory is written: no bus traffic wears it out.
//!
//! An E2PROM bears a hundred thousand to a million writes of a cell. Reading "Non-volatile writes":
//! a first change at once, further ones at most once a second, the newest value last.

#![allow(clippy::pedantic)] // Test code: casts and names are plain enough here.

use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::telegram::{Parsed, parse};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, Slot};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Device, Identity, PowerOn};

const HOUR: Duration = Duration::from_secs(3600);

/// Once a second, one more for the first change at once.
const CHANGES_PER_HOUR: u64 = 3600 + 1;

/// Every 6 minutes.
const WITHOUT_CHANGES_PER_HOUR: u64 = 10;

fn telegram(data: &[u8], saps: bool) -> Vec<u8> {
    let mark = if saps { 0x80 } else { 0 };
    // SRD high, each the first of its kind, to station 11 from master 2.
    let body = [&[11 | mark, 2 | mark, 0x6D], data].concat();
    let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    let length = body.len() as u8;
    [&[0x68, length, length, 0x68], &body[..], &[sum, 0x16]].concat()
}

/// A device in data exchange, what it has written, and when.
struct Exchange {
    device: Device,
    now: Instant,
    cycle: Duration,
    last: Option<Record>,
    writes: u64,
}

impl Exchange {
    /// One request every `cycle`.
    fn new(cycle: Duration) -> Self {
        let identity = Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(11),
        };
        let power_on = PowerOn {
            identity,
            stored: Choice::Use {
                record: Record::as_delivered(Variant::FULL),
                sequence: 1,
                slot: Slot::B,
                other_damaged: None,
            },
            battery: Battery::Ok,
            baud: BaudSetting::Fixed(Baudrate::B1500000),
            receiver: ReceiverMode::Idle,
        };
        let mut device = Device::new(Instant::ZERO, power_on, ());
        device.measure(Instant::ZERO, &Measurement::GOOD);
        let mut exchange = Self { device, now: Instant::ZERO, cycle, last: None, writes: 0 };
        let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
        let mut parameters = vec![61, 62, 0x80, 1, 1, 11, high, low, 0, 0, 2];
        parameters.resize(2 + 25, 0);
        for request in [&parameters[..], &[62, 62, 0xF1]] {
            exchange.ask(&telegram(request, true));
        }
        exchange
    }

    fn ask(&mut self, request: &[u8]) {
        self.now += self.cycle;
        let Parsed::Complete(telegram, _) = parse(request) else { panic!("a telegram") };
        while let Some(latch) = self.device.latch_needed(self.now) {
            self.device.sample(latch, ShaftReading::Full(70_000));
        }
        if self.device.next_deadline().is_some_and(|due| due <= self.now) {
            self.device.poll(self.now);
        }
        let window = self.device.indicate(self.now, &telegram).expect("a reply");
        assert!(self.device.transmit(window.not_before).is_some());
        while let Some(write) = self.device.take_nonvolatile(self.now) {
            self.last = Some(Record::decode(&write.octets).expect("a record").0);
            self.device.confirm_nonvolatile();
            self.writes += 1;
        }
    }

    /// The preset bit changes with every request, and the value with every preset.
    fn toggle_for(&mut self, span: Duration) -> u64 {
        let until = self.now + span;
        let before = self.writes;
        let requests: Vec<_> = (0..8_u32)
            .map(|at| telegram(&(at + if at % 2 == 0 { 0x8000_0000 } else { 0 }).to_be_bytes(), false))
            .collect();
        for request in requests.iter().cycle() {
            if self.now >= until {
                break;
            }
            self.ask(request);
        }
        self.writes - before
    }

    /// The outputs stay as they are.
    fn rest_for(&mut self, span: Duration) -> u64 {
        let until = self.now + span;
        let before = self.writes;
        let request = telegram(&[0; 4], false);
        while self.now < until {
            self.ask(&request);
        }
        self.writes - before
    }
}

// 13 octets each way at 9.6 kbit/s with the idle times between: some 350 bit times.
#[test]
fn a_preset_bit_that_toggles_at_bus_speed_for_a_day_writes_once_a_second() {
    let mut exchange = Exchange::new(Baudrate::B9600.duration(profibus_dp::time::BitTimes(350)));
    for hour in 0..24 {
        let writes = exchange.toggle_for(HOUR);
        assert!((CHANGES_PER_HOUR - 100..=CHANGES_PER_HOUR).contains(&writes), "hour {hour}: {writes}");
    }
}

#[test]
fn so_it_does_at_1500_kbit_per_second() {
    let mut exchange = Exchange::new(Baudrate::B1500000.duration(profibus_dp::time::BitTimes(350)));
    let writes = exchange.toggle_for(HOUR);
    assert!((CHANGES_PER_HOUR - 2..=CHANGES_PER_HOUR).contains(&writes), "{writes}");
    // And the newest value is written last.
    exchange.rest_for(Duration::from_secs(2));
    assert_eq!(exchange.last.unwrap().offset, exchange.device.sensor().offset());
}

#[test]
fn without_changes_only_the_operating_time_is_written() {
    let mut exchange = Exchange::new(Duration::from_millis(100));
    let day: u64 = (0..24).map(|_| exchange.rest_for(HOUR)).sum();
    assert_eq!(day, 24 * WITHOUT_CHANGES_PER_HOUR);
}

#[test]
fn a_single_preset_is_written_once_and_at_once() {
    let mut exchange = Exchange::new(Duration::from_millis(10));
    exchange.rest_for(Duration::from_secs(2));
    let before = exchange.writes;
    exchange.ask(&telegram(&0x8000_0007_u32.to_be_bytes(), false));
    assert_eq!(exchange.writes, before + 1, "before the next request comes");
    assert_eq!(exchange.rest_for(Duration::from_secs(300)), 0);
}
