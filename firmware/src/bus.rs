//! The bus: octets in, replies out, all in one interrupt.

use core::ptr;

use profibus_dp::fdl::{Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::halves::BusHalf;

use crate::cell::Topmost;
use crate::clock::Clock;

/// Reading: a reply due within so long a time is waited for in the interrupt.
const BUSY_WAIT: Duration = Duration::from_micros(20);

/// The USART at the bus, and the line that switches its driver on.
pub trait Line {
    /// What has happened; an octet is taken.
    fn happened(&self) -> Happened;
    /// An octet into the transmitter, which has room.
    fn send(&self, octet: u8);
    /// Driver on, and the interrupt of a transmitter with room.
    fn begin_reply(&self);
    /// All octets are in the transmitter: the interrupt of an empty one.
    fn end_reply(&self);
    /// Driver off, no interrupts of the transmitter.
    fn listen(&self);
    /// Another rate.
    fn set_rate(&self, rate: Baudrate);
    /// After bus half's state: the latch's priority has something to do.
    fn demand(&self);
}

/// What a USART has to tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Happened {
    /// An octet came.
    Octet(u8),
    /// A character with an error came.
    Error,
    /// The transmitter has room.
    Room,
    /// The transmitter is empty.
    Empty,
    /// Nothing that is of interest.
    Nothing,
}

/// All that belongs to the bus interrupt.
#[derive(Debug)]
pub struct Bus {
    /// The core's half.
    pub half: BusHalf,
    /// The time.
    pub clock: Clock,
    /// Replies wait for min T_SDR.
    pub paced: bool,
    rate: Baudrate,
    waiting: Option<Window>,
    next: *const u8,
    end: *const u8,
}

/// The one bus.
pub static BUS: Topmost<Bus> = Topmost::new();

impl Bus {
    /// At power-on.
    pub fn new(half: BusHalf, clock: Clock) -> Self {
        let rate = half.bus().listening_rate();
        Self { half, clock, paced: true, rate, waiting: None, next: ptr::null(), end: ptr::null() }
    }

    /// The device is switched on anew.
    pub fn restart(&mut self, half: BusHalf, line: &impl Line) {
        self.half = half;
        self.waiting = None;
        (self.next, self.end) = (ptr::null(), ptr::null());
        line.listen();
        self.rate = self.half.bus().listening_rate();
        line.set_rate(self.rate);
    }

    fn follow_rate(&mut self, line: &impl Line) {
        let rate = self.half.bus().listening_rate();
        if rate != self.rate {
            self.rate = rate;
            line.set_rate(rate);
        }
    }

    /// Lets time pass: watchdog, baud search, a reply that waits.
    pub fn poll(&mut self, line: &impl Line) {
        let now = self.clock.now();
        self.half.poll(now);
        self.follow_rate(line);
        if self.half.is_demanding() {
            line.demand();
        }
        if let Some(window) = self.waiting
            && now >= window.not_before
        {
            self.start(now, line);
        }
    }

    #[inline(never)]
    fn take_collected(&mut self, now: Instant, line: &impl Line) {
        let window = self.half.take_collected(now);
        if self.half.is_demanding() {
            line.demand();
        }
        let Some(window) = window else {
            self.follow_rate(line);
            return;
        };
        if !self.paced {
            self.start(window.not_before, line);
            return;
        }
        if window.not_before.since(now) > BUSY_WAIT {
            self.waiting = Some(window);
            return;
        }
        loop {
            let now = self.clock.now();
            if now >= window.not_before {
                self.start(now, line);
                return;
            }
        }
    }

    fn start(&mut self, now: Instant, line: &impl Line) {
        self.waiting = None;
        if let Some(octets) = self.half.transmit(now) {
            let range = octets.as_ptr_range();
            (self.next, self.end) = (range.start, range.end);
            line.begin_reply();
        }
    }

    fn send_next(&mut self, line: &impl Line) {
        if self.next == self.end {
            line.end_reply();
            return;
        }
        // SAFETY: inside the half's buffer, which is static and stays until the next telegram;
        // that one is only taken when nothing is sent any more.
        let octet = unsafe { self.next.read() };
        self.next = self.next.wrapping_add(1);
        line.send(octet);
    }
}

/// The interrupt of the bus USART.
///
/// # Safety
///
/// Only from the one interrupt of the highest priority.
#[inline(always)]
pub unsafe fn interrupt(line: &impl Line) {
    // SAFETY: the owner, by the caller.
    let bus = unsafe { BUS.own() };
    match line.happened() {
        Happened::Octet(octet) => {
            let now = bus.clock.now();
            if bus.half.collect(now, octet) {
                bus.take_collected(now, line);
            }
        }
        Happened::Error => {
            let now = bus.clock.now();
            bus.half.line_error(now);
            bus.follow_rate(line);
        }
        Happened::Room => bus.send_next(line),
        Happened::Empty => line.listen(),
        Happened::Nothing => {}
    }
}
