//! The figures of the device, each the largest of many.

use core::hint::black_box;

use profibus_dp::fdl::{BaudSetting, Gathered, ReceiverMode, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use sch108bex::device::{Device, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::halves::{BusHalf, ShaftHalf};
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
    bus: BusHalf,
    half: ShaftHalf,
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
        let (bus, half) = Device::new(latch, power_on, ()).into_halves();
        Self { bus, half, latch, shaft: 0 }
    }

    /// The next latch, of a disc that makes 3000 revolutions a minute.
    fn sample(&mut self, timer: &Timer) -> u32 {
        self.latch += LATCH;
        self.shaft = self.shaft.wrapping_add(1638);
        timer.count(|| sample(self))
    }

    /// A telegram octet by octet, after some silence; the reply's length.
    fn telegram(&mut self, timer: &Timer, figures: &mut Figures, octets: &[u8]) -> Option<usize> {
        let (last, others) = octets.split_last()?;
        let mut now = self.latch + Duration::from_micros(50);
        let bus = &mut self.bus;
        bus.line_was_idle();
        for &octet in others {
            now += RATE.duration(BitTimes::CHARACTER);
            figures.octet = figures.octet.max(timer.count(|| receive(bus, now, octet)));
        }
        now += RATE.duration(BitTimes::CHARACTER);
        let mut length = None;
        let instructions = timer.count(|| length = reply(bus, now, *last));
        while let Some(demand) = bus.take_demand() {
            self.half.obey(now, demand, &mut ());
        }
        bus.publish(self.half.health());
        figures.reply = figures.reply.max(instructions);
        length
    }
}

// As the firmware's interrupts call them: not inlined into what measures, and with the halves where they lie.

#[inline(never)]
fn receive(bus: &mut BusHalf, now: Instant, octet: u8) -> Option<Window> {
    match bus.gather(octet) {
        Gathered::Nothing => None,
        Gathered::Foreign => {
            bus.hear_foreign(now);
            None
        }
        Gathered::Look if bus.look(octet) => bus.take_collected(now),
        Gathered::Look => None,
    }
}

#[inline(never)]
fn reply(bus: &mut BusHalf, now: Instant, octet: u8) -> Option<usize> {
    let window = receive(bus, now, octet)?;
    bus.transmit(window.not_before).map(<[u8]>::len)
}

#[inline(never)]
fn sample(driven: &mut Driven) -> bool {
    let reading = ShaftReading::Singleturn(driven.shaft);
    let changed = driven.half.sample(driven.latch, reading, &mut ());
    driven.bus.show(driven.half.inputs());
    changed
}
