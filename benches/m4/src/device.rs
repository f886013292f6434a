//! The figures of the device, each the largest of many.

use core::hint::black_box;

use profibus_dp::Station;
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use sch108bex::device::{Device, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::Battery;
use sch108bex::nonvolatile::Choice;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SerialNumber, Variant};

use crate::telegrams::{ADDRESS, Functionality, exchange, foreign_6, foreign_255, start_up};
use crate::timer::Timer;

const RATE: Baudrate = Baudrate::B12000000;
/// From latch to latch.
const LATCH: Duration = Duration::from_micros(500);
/// Enough for two windows of velocity.
const EXCHANGES: usize = 450;

/// Instructions, calls included.
#[derive(Default)]
pub(crate) struct Figures {
    /// Any octet but the last of a telegram, whoever it is for.
    pub(crate) octet: u32,
    /// From the last octet of a Data_Exchange to the reply's octets.
    pub(crate) reply: u32,
    /// One latch.
    pub(crate) sample: u32,
}

/// Measures them; `None` if the device does not do what it should.
pub(crate) fn figures(timer: &Timer) -> Option<Figures> {
    let mut figures = Figures::default();
    for functionality in [Functionality::Class2, Functionality::Scancon20] {
        let mut driven = Driven::switch_on();
        for request in start_up(functionality) {
            driven.telegram(timer, &mut Figures::default(), request.as_slice())?;
        }
        let requests = exchange();
        for request in requests.iter().cycle().take(EXCHANGES) {
            figures.sample = figures.sample.max(driven.sample(timer));
            let reply = driven.telegram(timer, &mut figures, request.as_slice())?;
            if reply != functionality.answer() {
                return None;
            }
        }
        for foreign in [foreign_6(), foreign_255()] {
            let mut only_octets = Figures::default();
            if driven.telegram(timer, &mut only_octets, foreign.as_slice()).is_some() {
                return None;
            }
            figures.octet = figures.octet.max(only_octets.octet);
        }
    }
    Some(figures)
}

/// A device, its shaft, and the time.
struct Driven {
    device: Device,
    latch: Instant,
    shaft: u16,
}

impl Driven {
    fn switch_on() -> Self {
        let identity = Identity {
            variant: Variant::FULL,
            ident_number: 0x108b,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(ADDRESS),
        };
        let power_on = PowerOn {
            identity: black_box(identity),
            stored: black_box(Choice::AsDelivered),
            battery: black_box(Battery::Ok),
            baud: black_box(BaudSetting::Fixed(RATE)),
            receiver: black_box(ReceiverMode::Idle),
        };
        let latch = Instant::from_millis(1);
        Self { device: Device::new(latch, power_on, ()), latch, shaft: 0 }
    }

    /// The next latch, of a disc that makes 3000 revolutions a minute.
    fn sample(&mut self, timer: &Timer) -> u32 {
        self.latch += LATCH;
        self.shaft = self.shaft.wrapping_add(1638);
        let (device, now) = (&mut self.device, self.latch);
        let reading = ShaftReading::Singleturn(self.shaft);
        timer.count(|| sample(device, now, reading))
    }

    /// A telegram octet by octet, after some silence; the reply's length.
    fn telegram(&mut self, timer: &Timer, figures: &mut Figures, octets: &[u8]) -> Option<usize> {
        let (last, others) = octets.split_last()?;
        let mut now = self.latch + Duration::from_micros(50);
        let device = &mut self.device;
        for &octet in others {
            now += RATE.duration(BitTimes::CHARACTER);
            figures.octet = figures.octet.max(timer.count(|| receive(device, now, octet)));
        }
        now += RATE.duration(BitTimes::CHARACTER);
        let mut length = None;
        let instructions = timer.count(|| length = reply(device, now, *last));
        figures.reply = figures.reply.max(instructions);
        length
    }
}

// As an interrupt calls them: not inlined into what measures.

#[inline(never)]
fn receive(device: &mut Device, now: Instant, octet: u8) -> Option<Window> {
    device.receive_octet(now, octet)
}

#[inline(never)]
fn reply(device: &mut Device, now: Instant, octet: u8) -> Option<usize> {
    let window = device.receive_octet(now, octet)?;
    device.transmit(window.not_before).map(<[u8]>::len)
}

#[inline(never)]
fn sample(device: &mut Device, now: Instant, reading: ShaftReading) -> bool {
    device.sample(now, reading)
}
