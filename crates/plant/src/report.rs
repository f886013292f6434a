//! What encoders and segments tell, as it happens.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use profibus_dp::time::Instant;
use sch108bex::event::{Event, Observer};

/// One thing that happened.
#[derive(Debug, Clone)]
pub struct Report {
    /// When, on the clock of the segment.
    pub at: Instant,
    /// The encoder's name, or the segment's.
    pub who: Arc<str>,
    /// What.
    pub what: What,
}

/// What happened.
#[derive(Debug, Clone)]
pub enum What {
    /// In the device.
    Device(Event),
    /// The encoder has power, and answers to this address (`None`: to none).
    PowerOn(Option<u8>),
    /// The encoder has no power.
    PowerOff,
    /// The shaft turns faster than the encoder stands (manual 6), in revolutions per minute.
    TooFast(f64),
    /// The shaft does not turn too fast any more.
    SlowAgain,
    /// It was put on the bus, and answers to this address (`None`: to none, or it has no power).
    Joined(Option<u8>),
    /// It was taken off the bus.
    Left,
    /// The bus is not terminated as it has to be. The text says where.
    Termination(Arc<str>),
    /// The memory could not be written; the record before holds. The text says why.
    NotStored(Arc<str>),
    /// A master has opened the segment's end.
    MasterCame(Option<profibus_dp::time::Baudrate>),
    /// A master has connected to an end that has no rate.
    MasterConnected,
    /// The master has set another rate.
    RateChanged(Option<profibus_dp::time::Baudrate>),
    /// The master has closed the segment's end.
    MasterLeft,
    /// Replies on a serial device started later than masters wait.
    LateReplies(bus::LateReplies),
    /// The segment's end has something to say that changes nothing.
    Noted(bus::Note),
    /// The segment has ended because its end broke. The text says why.
    SegmentBroke(Arc<str>),
}

impl std::fmt::Display for What {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let rate = |rate: &Option<profibus_dp::time::Baudrate>| {
            rate.map_or_else(|| "a rate that is none of PROFIBUS's".to_owned(), |rate| rate.to_string())
        };
        match self {
            Self::Device(event) => event.fmt(f),
            Self::PowerOn(Some(address)) => write!(f, "power on, station address {address}"),
            Self::PowerOn(None) => f.write_str("power on, but the switches keep it off the bus"),
            Self::Joined(Some(address)) => write!(f, "on the bus, station address {address}"),
            Self::Joined(None) => f.write_str("on the bus, but it answers to no address"),
            Self::Left => f.write_str("taken off the bus"),
            Self::PowerOff => f.write_str("power off"),
            Self::TooFast(rpm) => {
                write!(f, "the shaft turns at {rpm:.0} RPM, and 3000 RPM is the most it stands (manual 6)")
            }
            Self::SlowAgain => f.write_str("the shaft is below 3000 RPM again"),
            Self::Termination(complaint) => write!(f, "termination: {complaint} (manual 3.3)"),
            Self::NotStored(why) => write!(f, "the memory was not written: {why}; it is tried again"),
            Self::MasterCame(found) => write!(f, "a master has opened the bus at {}", rate(found)),
            Self::MasterConnected => f.write_str("a master has connected"),
            Self::RateChanged(found) => write!(f, "the master has changed to {}", rate(found)),
            Self::MasterLeft => f.write_str("the master has closed the bus"),
            Self::LateReplies(late) => late.fmt(f),
            Self::Noted(note) => note.fmt(f),
            Self::SegmentBroke(why) => write!(f, "the segment has ended: {why}"),
        }
    }
}

/// Sends the events of one encoder as reports. A receiver that is gone is no error.
#[derive(Debug, Clone)]
pub struct Reporter {
    who: Arc<str>,
    to: Option<Sender<Report>>,
}

impl Reporter {
    /// Reports as `who`, to nobody if `to` is `None`.
    pub fn new(who: &str, to: Option<Sender<Report>>) -> Self {
        Self { who: Arc::from(who), to }
    }

    /// Whom it reports as.
    pub fn who(&self) -> &str {
        &self.who
    }

    /// Reports.
    pub fn tell(&self, at: Instant, what: What) {
        if let Some(to) = &self.to {
            let _ = to.send(Report { at, who: Arc::clone(&self.who), what });
        }
    }
}

impl Observer for Reporter {
    fn observe(&mut self, now: Instant, event: &Event) {
        self.tell(now, What::Device(*event));
    }
}
