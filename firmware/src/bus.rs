//! The bus: octets in, replies out, all in one interrupt.

use core::mem::MaybeUninit;
use core::ptr;

use logic::usart::Received;
use profibus_dp::fdl::{Gathered, Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::device::PowerOn;
use sch108bex::halves::{BusHalf, ShaftHalf};

use crate::cell::Topmost;
use crate::clock::Clock;

/// What a reply with data begins with.
const SD2: u8 = 0x68;

/// Reading: a reply due within so long a time is waited for in the interrupt.
const BUSY_WAIT: Duration = Duration::from_micros(20);

/// The USART at the bus, and the line that switches its driver on.
pub trait Line {
    /// What has come; it is taken.
    fn received(&self) -> Received;
    /// How the transmitter is.
    fn transmitter(&self) -> Transmitter;
    /// An octet into the transmitter, which has room.
    fn send(&self, octet: u8);
    /// Driver on, and the first octet on its way.
    fn begin_reply(&self, octet: u8);
    /// The interrupt of a transmitter with room.
    fn go_on(&self);
    /// All octets are in the transmitter: the interrupt of an empty one.
    fn end_reply(&self);
    /// Driver off, no interrupts of the transmitter.
    fn listen(&self);
    /// Another rate.
    fn set_rate(&self, rate: Baudrate);
    /// The latch's priority has something to do.
    fn demand(&self);
    /// The alarm's interrupt when the counter is there, or never.
    fn alarm(&self, ticks: Option<u32>);
}

/// How a transmitter is, as far as its interrupts are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transmitter {
    /// It has room.
    Room,
    /// The last octet has gone.
    Empty,
    /// It is busy, or nobody wants to know.
    Busy,
}

/// All that belongs to the bus interrupt.
#[derive(Debug)]
pub struct Bus {
    /// The counter when the newest octet came.
    heard: u32,
    /// So many ticks from octet to octet, and the line was idle.
    gap: u32,
    /// The time.
    pub clock: Clock,
    /// The core's half.
    pub half: BusHalf,
    /// Replies wait for min T_SDR.
    paced: bool,
    rate: Baudrate,
    waiting: Option<Window>,
    next: *const u8,
    end: *const u8,
}

/// Long enough ago to be idle at any rate, in ticks.
const LONG_AGO: u32 = 1 << 30;

/// The one bus.
pub static BUS: Topmost<Bus> = Topmost::new();

impl Bus {
    /// Without power.
    // Not inlined: so it is made where it lies, and not on the stack of whoever asks.
    #[inline(never)]
    pub fn make(place: &mut MaybeUninit<Self>) {
        place.write(Self {
            heard: 0,
            gap: 0,
            clock: Clock::STOPPED,
            half: BusHalf::blank(()),
            paced: false,
            rate: Baudrate::B9600,
            waiting: None,
            next: ptr::null(),
            end: ptr::null(),
        });
    }

    /// The device is switched on.
    pub fn restart(&mut self, clock: Clock, paced: bool, power_on: PowerOn, line: &impl Line) -> ShaftHalf {
        line.listen();
        self.clock = clock;
        self.paced = paced;
        self.waiting = None;
        let shaft = self.half.switch_on(Instant::ZERO, power_on);
        self.set_rate(line);
        shaft
    }

    /// The power is gone: silent until the next [`restart`](Self::restart).
    pub fn stop(&mut self, line: &impl Line) {
        line.listen();
        self.waiting = None;
        self.half.switch_off();
    }

    fn follow_rate(&mut self, line: &impl Line) {
        if self.half.bus().listening_rate() != self.rate {
            self.set_rate(line);
        }
    }

    fn set_rate(&mut self, line: &impl Line) {
        self.rate = self.half.bus().listening_rate();
        self.gap = self.clock.ticks_of(self.half.idle_gap());
        line.set_rate(self.rate);
    }

    /// Lets time pass: watchdog, baud search, a reply that waits.
    pub fn poll(&mut self, line: &impl Line) {
        let ticks = self.clock.ticks();
        if ticks.wrapping_sub(self.heard) >= self.gap {
            // Before the counter comes round.
            self.heard = ticks.wrapping_sub(LONG_AGO);
        }
        let now = self.clock.at(ticks);
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

    /// An octet after idle time.
    #[inline(never)]
    fn begin(&mut self, octet: u8, ticks: u32, line: &impl Line) {
        self.half.line_was_idle();
        // The first one of a telegram is looked at.
        if self.half.gather(octet) == Gathered::Look {
            self.look(octet, ticks, line);
        }
    }

    /// A look is due at what came.
    // By itself: without it the interrupt needs no register that has to be saved.
    #[inline(never)]
    fn look(&mut self, octet: u8, ticks: u32, line: &impl Line) {
        if self.half.look(octet) {
            self.complete(ticks, line);
        }
    }

    /// A telegram is complete.
    #[inline]
    fn complete(&mut self, ticks: u32, line: &impl Line) {
        let now = self.clock.at(ticks);
        if self.half.answers_data(now) && self.wait(ticks) {
            // What it begins with is known; the rest gets ready meanwhile.
            line.begin_reply(SD2);
            let window = self.half.take_collected(now);
            let at =
                if self.paced { self.clock.now() } else { window.map_or(now, |window| window.not_before) };
            if let Some([_, second, rest @ ..]) = self.half.transmit(at) {
                line.send(*second);
                let rest = rest.as_ptr_range();
                (self.next, self.end) = (rest.start, rest.end);
            }
            line.go_on();
            if self.half.is_demanding() {
                line.demand();
            }
        } else {
            self.complete_other(now, line);
        }
    }

    /// Waits for min T_SDR after the request; no if that is too long for an interrupt.
    #[inline(always)]
    fn wait(&self, ticks: u32) -> bool {
        if self.paced {
            let delay = self.half.reply_delay();
            if delay > BUSY_WAIT {
                return false;
            }
            while self.clock.nanos(ticks, self.clock.ticks()) < delay.as_nanos() {}
        }
        true
    }

    /// One that is not the usual Data_Exchange.
    #[inline(never)]
    fn complete_other(&mut self, now: Instant, line: &impl Line) {
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
        let delay = window.not_before.since(now);
        if delay > BUSY_WAIT {
            self.waiting = Some(window);
            // Rounded up: not before.
            line.alarm(Some(self.heard.wrapping_add(self.clock.ticks_of(delay)).wrapping_add(1)));
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
        if let Some([first, rest @ ..]) = self.half.transmit(now) {
            line.begin_reply(*first);
            let rest = rest.as_ptr_range();
            (self.next, self.end) = (rest.start, rest.end);
            line.go_on();
        }
    }

    /// A telegram for another station is complete.
    #[inline(never)]
    fn hear_foreign(&mut self, ticks: u32, line: &impl Line) {
        self.half.hear_foreign(self.clock.at(ticks));
        self.follow_rate(line);
    }

    /// A character with an error.
    #[cold]
    #[inline(never)]
    fn spoil(&mut self, line: &impl Line) {
        self.heard = self.clock.ticks();
        self.half.line_error(self.clock.at(self.heard));
        self.follow_rate(line);
    }

    /// The transmitter has something to tell.
    #[inline(never)]
    fn go_on(&mut self, line: &impl Line) {
        match line.transmitter() {
            Transmitter::Room => self.send_next(line),
            Transmitter::Empty => line.listen(),
            Transmitter::Busy => {}
        }
    }

    #[inline]
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
/// Only from an interrupt of the highest priority.
#[inline(always)]
pub unsafe fn interrupt(line: &impl Line) {
    // SAFETY: the owner, by the caller.
    let bus = unsafe { BUS.own() };
    match line.received() {
        Received::Octet(octet) => {
            let ticks = bus.clock.ticks();
            let idle = ticks.wrapping_sub(bus.heard) >= bus.gap;
            bus.heard = ticks;
            if idle {
                return bus.begin(octet, ticks, line);
            }
            match bus.half.gather(octet) {
                Gathered::Nothing => {}
                Gathered::Look => bus.look(octet, ticks, line),
                Gathered::Foreign => bus.hear_foreign(ticks, line),
            }
        }
        Received::Error => bus.spoil(line),
        Received::Nothing => bus.go_on(line),
    }
}

/// The interrupt of the alarm: a reply is due.
///
/// # Safety
///
/// Only from an interrupt of the highest priority.
pub unsafe fn alarm(line: &impl Line) {
    line.alarm(None);
    // SAFETY: an owner, by the caller.
    unsafe { BUS.own() }.poll(line);
}
