//! The device, driven without a bus: each call as a host or a firmware makes it.

use std::hint::black_box;

use profibus_dp::Station;
use profibus_dp::fdl::{BaudSetting, ReceiverMode};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::device::{Device, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::Battery;
use sch108bex::nonvolatile::Choice;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SerialNumber, Variant};

use crate::telegrams::{ADDRESS, Functionality, Octets, exchange, foreign_6, foreign_255, start_up};

/// From latch to latch (manual 6).
const LATCH: Duration = Duration::from_micros(500);
/// From a latch to the end of the request: longer than the longest telegram.
const REQUEST: Duration = Duration::from_micros(300);
/// What the shaft turns from latch to latch, in counts: 3000 revolutions a minute.
const TURN: i64 = 1638;

/// A device in data exchange, its shaft, and the time.
#[derive(Debug)]
pub(crate) struct Driven {
    device: Device,
    latch: Instant,
    shaft: i64,
}

impl Driven {
    /// Brought there by the requests of a master.
    pub(crate) fn in_data_exchange(functionality: Functionality) -> Result<Self, String> {
        let identity = Identity {
            variant: Variant::FULL,
            ident_number: 0x108b,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(ADDRESS),
        };
        let power_on = PowerOn {
            identity,
            stored: Choice::AsDelivered,
            battery: Battery::Ok,
            baud: BaudSetting::Fixed(Baudrate::B12000000),
            receiver: ReceiverMode::Idle,
        };
        let latch = Instant::from_millis(1);
        let device = Device::new(latch, power_on, ());
        let mut driven = Self { device, latch, shaft: 0 };
        for request in start_up(functionality) {
            driven.exchange(request.as_slice()).ok_or("The start-up is not answered.")?;
        }
        let answers = exchange().map(|request| driven.exchange(request.as_slice()));
        if answers != [Some(functionality.answer()); 2] {
            return Err(format!("The answers to Data_Exchange are {answers:?} octets long."));
        }
        Ok(driven)
    }

    /// The latch that an exchange needs, the request's octets, the answer's octets.
    #[inline(never)]
    pub(crate) fn exchange(&mut self, request: &[u8]) -> Option<usize> {
        self.sample();
        let window = self.device.receive(self.latch + REQUEST, request)?;
        self.device.transmit(window.not_before).map(<[u8]>::len)
    }

    /// A telegram for another station.
    #[inline(never)]
    fn ignore(&mut self, telegram: &[u8]) -> bool {
        self.latch += LATCH;
        self.device.receive(self.latch, telegram).is_none()
    }

    #[inline]
    fn sample(&mut self) -> bool {
        self.latch += LATCH;
        self.shaft += TURN;
        self.device.sample(self.latch, ShaftReading::Full(self.shaft))
    }
}

/// How many octets of memory one device takes.
pub(crate) const fn ram() -> usize {
    size_of::<Device>()
}

/// Does a work so many times, for valgrind to count.
pub(crate) fn count(work: &str, rounds: usize) -> Result<(), String> {
    let functionality = if work == "exchange-12" { Functionality::Scancon20 } else { Functionality::Class2 };
    let mut driven = Driven::in_data_exchange(functionality)?;
    let requests = exchange();
    let [one, other] = black_box(requests.each_ref().map(Octets::as_slice));
    let (short, long) = (foreign_6(), foreign_255());
    let (short, long) = black_box((short.as_slice(), long.as_slice()));
    let mut all = 0..rounds;
    let done = match work {
        "exchange-4" | "exchange-12" => {
            all.step_by(2).all(|_| driven.exchange(one).is_some() && driven.exchange(other).is_some())
        }
        "foreign-6" => all.all(|_| driven.ignore(short)),
        "foreign-255" => all.all(|_| driven.ignore(long)),
        "sample" => all.all(|_| driven.sample()),
        _ => return Err(format!("There is no work {work}.")),
    };
    if done { Ok(()) } else { Err(format!("{work} does not do what it should.")) }
}
