//! A slave in virtual time: no thread, no clock, bus times to the nanosecond.

use profibus_dp::Station;
use profibus_dp::fdl::Window;
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};

use crate::rig::{Abilities, Action, Expect, Fresh, Hand, Heard, Order, Rig, RigError, Signal, slot_time};

/// A deadline that stays in the past is not served more often than this.
const LEAST_STEP: Duration = Duration::from_micros(100);

/// A kind of slave, and the hand at its controls.
pub trait Subject {
    /// What is on the bus.
    type Station: Station;

    /// A slave as delivered, whose power comes on at `now`.
    fn power_on(&mut self, now: Instant, order: &Order) -> Self::Station;

    /// Whether it has this control. [`Hand::Power`] and [`Hand::Delivery`] every subject has.
    fn has(&self, hand: Hand) -> bool {
        matches!(hand, Hand::Power | Hand::Delivery)
    }

    /// Moves a control; the power is cut (`None`) or comes back by [`Action::PowerOn`].
    fn act(&mut self, station: &mut Option<Self::Station>, now: Instant, action: &Action, order: &Order) {
        match action {
            Action::PowerOff => *station = None,
            Action::PowerOn => *station = Some(self.power_on(now, order)),
            _ => {}
        }
    }
}

/// Any slave without controls and without a memory: what makes one.
#[derive(Debug, Clone, Copy)]
pub struct Fresher<F>(pub F);

impl<S: Station, F: FnMut(Instant) -> S> Subject for Fresher<F> {
    type Station = S;

    fn power_on(&mut self, now: Instant, _: &Order) -> S {
        (self.0)(now)
    }
}

/// A virtual bus with one slave. The slave gets octets by [`Station::receive`], so that its own
/// receiver is under test as well.
#[derive(Debug)]
pub struct VirtualRig<S: Subject> {
    subject: S,
    station: Option<S::Station>,
    order: Order,
    now: Instant,
    rate: Baudrate,
    /// End of the last octet on the line.
    quiet_since: Instant,
    window: Option<Window>,
    /// Each octet is a read of its own.
    octetwise: bool,
    /// Says of the slave's receiver that it sees a stream.
    stream: bool,
}

impl<S: Subject> VirtualRig<S> {
    /// A bus for `subject` at 500 kbit/s. `octetwise`: each octet is a read of its own, as from a
    /// UART; else telegrams come whole, as from a DMA.
    pub fn new(subject: S, octetwise: bool) -> Self {
        let now = Instant::from_millis(1_000);
        let order = Order { rate: Baudrate::B500000, search: false, power_on: true, address: None };
        Self {
            subject,
            station: None,
            order,
            now,
            rate: order.rate,
            quiet_since: now,
            window: None,
            octetwise,
            stream: false,
        }
    }

    /// The slaves look for the next telegram from the next octet on, and not after an idle line.
    #[must_use]
    pub fn with_stream_receivers(mut self) -> Self {
        self.stream = true;
        self
    }

    fn advance_to(&mut self, until: Instant) {
        if let Some(station) = &mut self.station {
            let mut least = self.now;
            while let Some(deadline) = station.next_deadline().map(|deadline| deadline.max(least)) {
                if deadline > until {
                    break;
                }
                self.now = self.now.max(deadline);
                station.poll(self.now);
                least = self.now + LEAST_STEP;
            }
        }
        self.now = self.now.max(until);
    }

    /// Octets that ended by now reach the slave.
    fn deliver(&mut self, octets: &[u8]) {
        let (rate, now) = (self.rate, self.now);
        if let (Some(station), false) = (&mut self.station, octets.is_empty()) {
            self.window = if station.listening_rate() == rate {
                station.receive(now, octets)
            } else {
                station.line_error(now);
                None
            };
        }
    }

    /// Who changes to the right rate in the middle of a telegram has missed its beginning; and a
    /// slave that searches must see each octet at its own time.
    fn in_one_read(&self) -> bool {
        !self.octetwise
            && !self.order.search
            && self.station.as_ref().is_none_or(|station| station.listening_rate() == self.rate)
    }

    fn put(&mut self, signals: &[Signal]) {
        let mut start = self.now;
        let mut count = 0;
        let mut read = Vec::new();
        let mut deaf = self.station.as_ref().is_some_and(|station| station.listening_rate() != self.rate);
        for signal in signals {
            match *signal {
                Signal::Octet(octet) => {
                    count += 1;
                    let end = start + self.rate.duration(BitTimes(11 * count));
                    // A host that waits for the whole telegram does not look at the clock meanwhile.
                    if deaf || !self.in_one_read() {
                        self.advance_to(end);
                    }
                    self.now = self.now.max(end);
                    read.push(octet);
                    if deaf {
                        read.clear();
                        self.line_error();
                    } else if !self.in_one_read() {
                        self.deliver(&read);
                        read.clear();
                    }
                }
                Signal::Damaged(_) => {
                    self.deliver(&std::mem::take(&mut read));
                    count += 1;
                    self.advance_to(start + self.rate.duration(BitTimes(11 * count)));
                    self.line_error();
                }
                Signal::Read => self.deliver(&std::mem::take(&mut read)),
                Signal::Pause(bits) => {
                    self.deliver(&std::mem::take(&mut read));
                    self.advance_to(self.now + self.rate.duration(bits));
                    (start, count) = (self.now, 0);
                    deaf &= bits < BitTimes::SYN;
                }
            }
        }
        self.deliver(&read);
        self.quiet_since = self.now;
    }

    fn line_error(&mut self) {
        let now = self.now;
        self.window = None;
        if let Some(station) = &mut self.station {
            station.line_error(now);
        }
    }
}

impl<S: Subject> Rig for VirtualRig<S> {
    fn abilities(&self) -> Abilities {
        Abilities { exact_time: true, line_errors: true, stream: self.stream, rates: true }
    }

    fn has(&self, hand: Hand) -> bool {
        self.subject.has(hand)
    }

    fn fresh(&mut self, order: &Order) -> Result<Fresh, RigError> {
        self.order = *order;
        self.rate = order.rate;
        self.window = None;
        // So that whatever the last slave did is long ago.
        self.now += Duration::from_secs(1);
        self.quiet_since = self.now;
        self.station = Some(self.subject.power_on(self.now, order));
        Ok(Fresh::Delivered)
    }

    fn send(&mut self, signals: &[Signal]) -> Result<(), RigError> {
        let idle = self.rate.duration(bus::virtual_segment::idle_time(self.rate));
        self.advance_to(self.quiet_since + idle);
        self.window = None;
        self.put(signals);
        Ok(())
    }

    fn listen(&mut self, expect: Expect) -> Result<Heard, RigError> {
        let asked = self.quiet_since;
        let slot = self.rate.duration(slot_time(self.rate));
        let window = self.window.take();
        let start = match (window, expect) {
            (Some(window), Expect::Late) => Some(window.not_after + self.rate.duration(BitTimes(1))),
            (Some(window), _) => Some(window.not_before),
            (None, _) => None,
        };
        if let Some(start) = start {
            self.advance_to(start);
            let now = self.now;
            if let Some(octets) = self.station.as_mut().and_then(|station| station.transmit(now)) {
                let octets = octets.to_vec();
                let length = u32::try_from(octets.len()).unwrap_or(u32::MAX);
                self.advance_to(now + self.rate.duration(BitTimes(11 * length)));
                self.quiet_since = self.now;
                return Ok(Heard { octets, delay: Some(now.since(asked)), damaged: false });
            }
        }
        self.advance_to(asked + slot.times(3));
        Ok(Heard::default())
    }

    fn wait(&mut self, span: Duration) -> Result<Vec<u8>, RigError> {
        self.advance_to(self.now + span);
        Ok(Vec::new())
    }

    fn set_rate(&mut self, rate: Baudrate) -> Result<(), RigError> {
        self.rate = rate;
        Ok(())
    }

    fn rate(&self) -> Baudrate {
        self.rate
    }

    fn act(&mut self, action: &Action) -> Result<(), RigError> {
        let Self { subject, station, now, order, .. } = self;
        subject.act(station, *now, action, order);
        if station.is_none() {
            self.window = None;
        }
        Ok(())
    }
}
