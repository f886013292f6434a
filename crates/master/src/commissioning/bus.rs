//! Lines that profirust can live on. It never hears its own octets: it would take them for those of a
//! second master with its address.

use ::bus::{Answer, End, EndError, Event, VirtualSegment, WallClock, Written};
use profibus_dp::Station;
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::telegram::{ED, SD1};
use profirust::phy::ProfibusPhy;

use super::ledger::Traffic;

/// More than any two telegrams.
const BUFFER: usize = 1024;

/// A line that profirust can live on, and the time there.
pub trait Bus: ProfibusPhy {
    /// The time on the bus.
    fn now(&self) -> Instant;

    /// Lets a little time pass, or waits until octets come.
    ///
    /// # Errors
    ///
    /// The line is broken for good.
    fn rest(&mut self) -> Result<(), EndError>;

    /// What has broken the line since the last time.
    fn take_error(&mut self) -> Option<EndError>;

    /// What profirust has sent.
    fn traffic(&self) -> &Traffic;
}

/// An end in real time.
#[derive(Debug)]
pub struct RealBus {
    end: Box<dyn End>,
    clock: WallClock,
    pause: Duration,
    received: Vec<u8>,
    outgoing: [u8; 256],
    error: Option<EndError>,
    traffic: Traffic,
    gone: bool,
    alone: bool,
}

impl RealBus {
    /// A line over an end whose octets take the time of `rate`.
    pub fn new(end: Box<dyn End>, rate: Baudrate) -> Self {
        // As often as profirust has anything to do: its idle time before a telegram.
        let pause = rate.duration(BitTimes::SYN).max(Duration::from_micros(50));
        Self {
            end,
            clock: WallClock::new(),
            pause,
            received: Vec::with_capacity(BUFFER),
            outgoing: [0; 256],
            error: None,
            traffic: Traffic::default(),
            gone: false,
            alone: false,
        }
    }

    /// No other master can be there. profirust asks one address in every rotation of the token whether
    /// somebody there wants it, and waits for a slot time; such questions are then not sent, and it is told
    /// at once that a slave is there.
    #[must_use]
    pub fn alone(mut self) -> Self {
        self.alone = true;
        self
    }

    /// Whether the far side has closed the line.
    pub fn is_gone(&self) -> bool {
        self.gone
    }

    /// The end, for another master.
    pub fn into_end(self) -> Box<dyn End> {
        self.end
    }

    /// Takes what comes within `timeout`; whether anything did.
    fn take(&mut self, timeout: Duration) -> Result<bool, EndError> {
        let mut buffer = [0; BUFFER];
        match self.end.wait(Some(timeout), &mut buffer)? {
            Event::Octets(count) => {
                if self.received.len() + count > BUFFER {
                    self.received.clear();
                }
                self.received.extend_from_slice(&buffer[..count]);
                return Ok(true);
            }
            Event::Left => {
                self.received.clear();
                self.gone = true;
            }
            Event::Came(_) => self.gone = false,
            _ => {}
        }
        Ok(false)
    }
}

impl ProfibusPhy for RealBus {
    fn poll_transmission(&mut self, _: profirust::time::Instant) -> bool {
        // profirust counts the time of its octets itself.
        false
    }

    fn transmit_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&mut [u8]) -> (usize, R),
    {
        self.outgoing.fill(0);
        let (length, result) = f(&mut self.outgoing);
        let octets = &self.outgoing[..length];
        if let ([SD1, da, sa, 0x49, ..], true) = (octets, self.alone) {
            // A passive station: FC 00.
            self.received.extend_from_slice(&[SD1, *sa, *da, 0, sa.wrapping_add(*da), ED]);
        } else if !octets.is_empty() {
            self.traffic.note(octets);
            match self.end.write(octets) {
                // What nobody takes is not answered.
                Ok(Written::All | Written::Dropped(_)) => {}
                Err(error) => self.error = Some(error),
            }
        }
        result
    }

    fn receive_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&[u8]) -> (usize, R),
    {
        if let Err(error) = self.take(Duration::ZERO) {
            self.error = Some(error);
        }
        let (used, result) = f(&self.received);
        self.received.drain(..used.min(self.received.len()));
        result
    }
}

impl Bus for RealBus {
    fn now(&self) -> Instant {
        self.clock.now()
    }

    fn rest(&mut self) -> Result<(), EndError> {
        self.take(self.pause)?;
        Ok(())
    }

    fn take_error(&mut self) -> Option<EndError> {
        self.error.take()
    }

    fn traffic(&self) -> &Traffic {
        &self.traffic
    }
}

/// Times seen on a virtual bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VirtualTimes {
    /// The least and the greatest T_SDR of the slaves.
    pub tsdr: Option<(Duration, Duration)>,
    /// The least idle time that profirust left before a telegram.
    pub idle: Option<Duration>,
}

/// A segment in virtual time.
#[derive(Debug)]
pub struct VirtualBus<S> {
    segment: VirtualSegment<S>,
    received: Vec<u8>,
    outgoing: [u8; 256],
    traffic: Traffic,
    times: VirtualTimes,
    step: Duration,
}

impl<S: Station> VirtualBus<S> {
    /// A line to the stations of `segment`.
    pub fn new(segment: VirtualSegment<S>) -> Self {
        // One bit time, but no less than profirust can count.
        let step = segment.rate().duration(BitTimes(1)).max(Duration::from_micros(1));
        Self {
            segment,
            received: Vec::with_capacity(BUFFER),
            outgoing: [0; 256],
            traffic: Traffic::default(),
            times: VirtualTimes::default(),
            step,
        }
    }

    /// The segment.
    pub fn segment(&self) -> &VirtualSegment<S> {
        &self.segment
    }

    /// The segment, to turn shafts, and for other masters between two polls.
    pub fn segment_mut(&mut self) -> &mut VirtualSegment<S> {
        &mut self.segment
    }

    /// The times seen so far.
    pub fn times(&self) -> VirtualTimes {
        self.times
    }

    /// What comes back, if anything is on its way.
    fn listen(&mut self) {
        if !self.segment.is_answered() {
            return;
        }
        if let Answer::Reply(reply) = self.segment.listen() {
            let (least, most) = self.times.tsdr.unwrap_or((reply.delay, reply.delay));
            self.times.tsdr = Some((least.min(reply.delay), most.max(reply.delay)));
            if !reply.damaged {
                self.received.extend_from_slice(reply.octets);
            }
        }
    }
}

impl<S: Station> ProfibusPhy for VirtualBus<S> {
    fn poll_transmission(&mut self, _: profirust::time::Instant) -> bool {
        // The bus stands at the end of what was sent, or of the answer.
        false
    }

    fn transmit_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&mut [u8]) -> (usize, R),
    {
        self.outgoing.fill(0);
        let (length, result) = f(&mut self.outgoing);
        let octets = &self.outgoing[..length];
        if !octets.is_empty() {
            let idle = self.segment.quiet_for();
            self.times.idle = Some(self.times.idle.map_or(idle, |least| least.min(idle)));
            self.traffic.note(octets);
            self.segment.send_more(octets);
            self.listen();
        }
        result
    }

    fn receive_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&[u8]) -> (usize, R),
    {
        let (used, result) = f(&self.received);
        self.received.drain(..used.min(self.received.len()));
        result
    }
}

impl<S: Station> Bus for VirtualBus<S> {
    fn now(&self) -> Instant {
        self.segment.now()
    }

    fn rest(&mut self) -> Result<(), EndError> {
        self.segment.wait(self.step);
        Ok(())
    }

    fn take_error(&mut self) -> Option<EndError> {
        None
    }

    fn traffic(&self) -> &Traffic {
        &self.traffic
    }
}
