//! A slave behind a port: a serial device, a pseudo terminal, a socket.
//!
//! No time is exact here: what the operating system does in between counts as well. So a reply may
//! come late, and silence is waited for a little longer than the bus would take.

use std::fmt;
use std::time::{Duration as Time, Instant as Moment};

use bus::virtual_segment::idle_time;
use bus::{End, Event, Written};
use profibus_dp::time::{Baudrate, BitTimes, Duration};

use crate::control::Control;
use crate::reply;
use crate::rig::{Abilities, Action, Expect, Fresh, Hand, Heard, Order, Rig, RigError, Signal, slot_time};

/// No reply within this time is silence.
const SILENCE: Time = Time::from_millis(30);
/// Between two octets of one reply.
const BETWEEN_OCTETS: Time = Time::from_millis(200);
/// How long somebody may take to come to the far side.
const COMING: Time = Time::from_secs(10);
/// How long the far side may take to read.
const TAKING: Time = Time::from_secs(2);
/// Between two reads of one telegram: less than a slave takes for its end.
const READ: Time = Time::from_micros(300);
/// More than a slave on a stream takes for the end of a telegram.
const IDLE: Time = Time::from_millis(25);
/// How long a slave may take from power-on until it answers.
const START: Time = Time::from_millis(20);
/// How long the reply to a request may take, if nobody says otherwise.
pub const PATIENCE: Time = Time::from_secs(1);

/// A slave behind an [`End`], and the hand at its controls, if there is one.
pub struct PortRig {
    end: Box<dyn End>,
    control: Option<Box<dyn Control>>,
    rate: Baudrate,
    patience: Time,
    stream: bool,
    /// Somebody is at the far side.
    there: bool,
    /// Octets that came when none were due.
    stray: Vec<u8>,
    damaged: bool,
    /// When the last octet known of was, or will be, over on a line whose octets take time.
    quiet: Moment,
    /// Controls that are not where they were.
    moved: Vec<Action>,
    /// The address of the beginning.
    address: Option<u8>,
}

impl fmt::Debug for PortRig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PortRig").field("end", &self.end).finish_non_exhaustive()
    }
}

impl PortRig {
    /// A slave behind `end`, which runs at `rate`. `stream`: no idle times are to be seen between
    /// octets, as on a pseudo terminal or a socket.
    pub fn new(end: Box<dyn End>, rate: Baudrate, stream: bool) -> Self {
        Self {
            end,
            control: None,
            rate,
            patience: PATIENCE,
            stream,
            there: false,
            stray: Vec::new(),
            damaged: false,
            quiet: Moment::now(),
            moved: Vec::new(),
            address: None,
        }
    }

    /// With a hand at the controls of the device.
    #[must_use]
    pub fn with_control(mut self, control: Box<dyn Control>) -> Self {
        self.control = Some(control);
        self
    }

    /// Waits so long for the reply to a request.
    #[must_use]
    pub fn with_patience(mut self, patience: Time) -> Self {
        self.patience = patience;
        self
    }

    fn write(&mut self, octets: &[u8]) -> Result<(), RigError> {
        if octets.is_empty() {
            return Ok(());
        }
        if !self.there {
            self.somebody()?;
        }
        if !self.stream {
            let bits = u32::try_from(octets.len()).unwrap_or(u32::MAX).saturating_mul(11);
            self.quiet = self.quiet.max(Moment::now()) + Time::from(self.rate.duration(BitTimes(bits)));
        }
        let until = Moment::now() + TAKING;
        let mut rest = octets;
        while let Written::Dropped(count) = self.end.write(rest)? {
            if Moment::now() >= until {
                return Err(RigError::NotTaken);
            }
            // The far side has not read yet what came before.
            rest = &rest[rest.len() - count.min(rest.len())..];
            std::thread::sleep(READ);
        }
        Ok(())
    }

    /// Waits until somebody is at the far side.
    fn somebody(&mut self) -> Result<(), RigError> {
        let until = Moment::now() + COMING;
        while !self.there && Moment::now() < until {
            self.take(until)?;
        }
        if self.there { Ok(()) } else { Err(RigError::NotTaken) }
    }

    /// One look at the port, at most until `until`; octets go to `stray`.
    fn take(&mut self, until: Moment) -> Result<bool, RigError> {
        let mut buffer = [0; 512];
        let left = until.saturating_duration_since(Moment::now());
        let nanos = u64::try_from(left.as_nanos()).unwrap_or(u64::MAX);
        match self.end.wait(Some(Duration::from_nanos(nanos)), &mut buffer)? {
            Event::Octets(count) => {
                self.there = true;
                self.stray.extend_from_slice(&buffer[..count]);
                self.quiet = self.quiet.max(Moment::now());
                return Ok(true);
            }
            Event::Came(_) => self.there = true,
            Event::Left => self.there = false,
            Event::LineError => self.damaged = true,
            Event::Rate(_) | Event::Noted(_) | Event::Woken | Event::TimedOut => {}
        }
        Ok(false)
    }

    /// Restores what was moved, and switches the power off and on.
    fn restore(&mut self, order: Order) -> Result<Fresh, RigError> {
        let Some(control) = &mut self.control else { return Ok(Fresh::Same) };
        let usual = [
            Action::Supply(240),
            Action::Temperature(200),
            Action::Light(true),
            Action::Battery(crate::rig::Battery::Ok),
            Action::Shaft(0),
            Action::Switches(order.address.unwrap_or(126)),
        ];
        let operated = self.moved.iter().any(|action| matches!(action, Action::OperatingTime(_)));
        let undo = operated.then_some(Action::OperatingTime(0));
        for action in usual.iter().chain(&undo) {
            if control.has(action.hand()) {
                control.act(action).map_err(RigError::Control)?;
            }
        }
        self.moved.clear();
        self.address = order.address;
        let delivered = order.address.is_none();
        if delivered {
            control.deliver().map_err(RigError::Control)?;
        } else {
            control.act(&Action::PowerOff).map_err(RigError::Control)?;
            control.act(&Action::PowerOn).map_err(RigError::Control)?;
        }
        std::thread::sleep(START);
        Ok(if delivered { Fresh::Delivered } else { Fresh::PowerCycled })
    }
}

impl Rig for PortRig {
    fn abilities(&self) -> Abilities {
        let line_errors = self.control.as_ref().is_some_and(|control| control.damages_characters());
        Abilities { exact_time: false, line_errors, stream: self.stream, rates: false }
    }

    fn has(&self, hand: Hand) -> bool {
        self.control.as_ref().is_some_and(|control| control.has(hand))
    }

    fn fresh(&mut self, order: &Order) -> Result<Fresh, RigError> {
        let moved = !self.moved.is_empty() || self.address != order.address;
        let fresh = if self.control.is_some() && (order.power_on || moved) {
            self.restore(*order)?
        } else {
            Fresh::Same
        };
        // What the case before has left on the line.
        self.take(Moment::now())?;
        self.stray.clear();
        self.damaged = false;
        Ok(fresh)
    }

    fn send(&mut self, signals: &[Signal]) -> Result<(), RigError> {
        while self.take(Moment::now())? {}
        if !self.stream {
            // A request needs an idle line before it.
            let idle = Time::from(self.rate.duration(idle_time(self.rate)));
            std::thread::sleep((self.quiet + idle).saturating_duration_since(Moment::now()));
        }
        let mut octets = Vec::new();
        for (at, signal) in signals.iter().enumerate() {
            match *signal {
                Signal::Octet(octet) => octets.push(octet),
                Signal::Damaged(octet) => {
                    if let Some(control) = &mut self.control {
                        control.damage_character(at + 1).map_err(RigError::Control)?;
                    }
                    octets.push(octet);
                }
                // On a line there are no reads, and a pause could end the telegram.
                Signal::Read if !self.stream => {}
                Signal::Read => {
                    self.write(&std::mem::take(&mut octets))?;
                    std::thread::sleep(READ);
                }
                Signal::Pause(bits) => {
                    self.write(&std::mem::take(&mut octets))?;
                    if bits >= BitTimes::SYN {
                        std::thread::sleep(self.quiet.saturating_duration_since(Moment::now()) + IDLE);
                    }
                }
            }
        }
        self.write(&octets)
    }

    fn listen(&mut self, expect: Expect) -> Result<Heard, RigError> {
        let slots = Time::from(self.rate.duration(slot_time(self.rate)).times(3));
        let first = match expect {
            Expect::Reply => self.patience.max(slots),
            Expect::Silence | Expect::Late => SILENCE.max(slots),
        };
        let mut until = self.quiet.max(Moment::now()) + first;
        loop {
            let whole = reply::length(&self.stray).is_some_and(|length| self.stray.len() >= length);
            if whole || Moment::now() >= until {
                break;
            }
            if self.take(until)? {
                until = Moment::now() + BETWEEN_OCTETS;
            }
        }
        let damaged = std::mem::take(&mut self.damaged);
        Ok(Heard { octets: std::mem::take(&mut self.stray), delay: None, damaged })
    }

    fn wait(&mut self, span: Duration) -> Result<Vec<u8>, RigError> {
        let until = Moment::now() + Time::from(span);
        while Moment::now() < until {
            self.take(until)?;
        }
        Ok(std::mem::take(&mut self.stray))
    }

    fn set_rate(&mut self, rate: Baudrate) -> Result<(), RigError> {
        self.rate = rate;
        Ok(())
    }

    fn rate(&self) -> Baudrate {
        self.rate
    }

    fn act(&mut self, action: &Action) -> Result<(), RigError> {
        if !matches!(action, Action::Shaft(0)) {
            self.moved.push(*action);
        }
        match &mut self.control {
            Some(control) => control.act(action).map_err(RigError::Control),
            None => Ok(()),
        }
    }
}
