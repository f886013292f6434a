//! What the tests of this crate share: a small station, and telegrams.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::time::{Duration as Time, Instant as Moment};

use bus::RateListener;
use profibus_dp::fdl::{Station, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::function_code::Function;

/// FDL status of station 11, asked by master 2, and its answer: DP slave reference, section 1.5.
pub(crate) const STATUS_11: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];
pub(crate) const STATUS_11_ANSWER: [u8; 6] = [0x10, 0x02, 0x0B, 0x00, 0x0D, 0x16];

pub(crate) fn status(address: u8) -> [u8; 6] {
    [0x10, address, 2, 0x49, address.wrapping_add(2 + 0x49), 0x16]
}

pub(crate) fn status_answer(address: u8) -> [u8; 6] {
    [0x10, 2, address, 0, address.wrapping_add(2), 0x16]
}

/// A station that answers FDL status requests and writes down what it is told.
#[derive(Debug, Clone)]
pub(crate) struct Listener {
    pub(crate) address: Option<u8>,
    pub(crate) rate: Baudrate,
    pub(crate) min_tsdr: BitTimes,
    pub(crate) heard: Vec<Instant>,
    pub(crate) line_errors: usize,
    pub(crate) polls: Vec<Instant>,
    pub(crate) rates: Vec<Option<Baudrate>>,
    /// Goes on listening at its rate whatever the master's is.
    pub(crate) fixed: bool,
    pub(crate) every: Option<Duration>,
    /// As if the disk or the scheduler had held it up.
    pub(crate) slow: Time,
    /// Handing out the answer changes the address to this.
    pub(crate) moves_to: Option<u8>,
    /// The next poll lets it listen at this rate.
    pub(crate) retunes_to: Option<Baudrate>,
    window: Option<Window>,
    answer: [u8; 6],
    deadline: Option<Instant>,
}

impl Listener {
    pub(crate) fn at(address: u8) -> Self {
        Self {
            address: Some(address),
            rate: Baudrate::B500000,
            min_tsdr: BitTimes::MIN_TSDR,
            heard: Vec::with_capacity(16_384),
            line_errors: 0,
            polls: Vec::new(),
            rates: Vec::new(),
            fixed: false,
            every: None,
            slow: Time::ZERO,
            moves_to: None,
            retunes_to: None,
            window: None,
            answer: [0; 6],
            deadline: None,
        }
    }

    pub(crate) fn at_rate(mut self, rate: Baudrate) -> Self {
        (self.rate, self.fixed) = (rate, true);
        self
    }

    pub(crate) fn with_min_tsdr(mut self, bits: u32) -> Self {
        self.min_tsdr = BitTimes(bits);
        self
    }

    pub(crate) fn polled_every(mut self, span: Duration) -> Self {
        self.every = Some(span);
        self.deadline = Some(Instant::ZERO + span);
        self
    }
}

impl Station for Listener {
    fn receive(&mut self, _: Instant, _: &[u8]) -> Option<Window> {
        unreachable!("segments parse telegrams themselves");
    }

    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        self.heard.push(now);
        self.window = None;
        std::thread::sleep(self.slow);
        let Telegram::Data(data) = telegram else { return None };
        let own = self.address?;
        if data.da != own || !data.fc.is_request() || data.fc.function() != Function::FdlStatus {
            return None;
        }
        self.answer = [0x10, data.sa, own, 0, data.sa.wrapping_add(own), 0x16];
        let latest = BitTimes(self.rate.max_tsdr().0.max(self.min_tsdr.0) + 11);
        self.window = Some(Window {
            not_before: now + self.rate.duration(self.min_tsdr),
            not_after: now + self.rate.duration(latest),
        });
        self.window
    }

    fn line_error(&mut self, _: Instant) {
        self.line_errors += 1;
    }

    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        let window = self.window.take()?;
        if now < window.not_before || now > window.not_after {
            return None;
        }
        self.address = self.moves_to.take().or(self.address);
        Some(&self.answer)
    }

    fn poll(&mut self, now: Instant) {
        self.polls.push(now);
        self.rate = self.retunes_to.take().unwrap_or(self.rate);
        if let (Some(deadline), Some(every)) = (self.deadline, self.every) {
            self.deadline = Some(deadline + every);
        }
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.deadline
    }

    fn listening_rate(&self) -> Baudrate {
        self.rate
    }

    fn address(&self) -> Option<u8> {
        self.address
    }
}

impl RateListener for Listener {
    fn rate_found(&mut self, _: Instant, rate: Option<Baudrate>) {
        self.rates.push(rate);
        if let (Some(rate), false) = (rate, self.fixed) {
            self.rate = rate;
        }
    }
}

/// Waits until `done` says so; a second is for ever here.
pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Moment::now();
    while !done() {
        assert!(begun.elapsed() < Time::from_secs(5), "waited in vain for {what}");
        std::thread::sleep(Time::from_micros(200));
    }
}
