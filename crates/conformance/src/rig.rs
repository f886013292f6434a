//! What a case needs of the bus and of the device: octets out, octets in, time, and a hand at the
//! device's controls.

use profibus_dp::time::{Baudrate, BitTimes, Duration};

/// One thing that a master puts on the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// A character without fault.
    Octet(u8),
    /// This character, with a parity or framing error.
    Damaged(u8),
    /// The line is idle for so long, inside what is sent.
    Pause(BitTimes),
    /// What came so far reaches the slave in one read, the rest in another.
    Read,
}

/// What is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expect {
    /// A reply is due.
    Reply,
    /// Nothing is due: three slot times of silence are enough.
    Silence,
    /// A reply is due, but it is only asked for when its time is over (virtual buses).
    Late,
}

/// What came back.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Heard {
    /// The octets; none: silence.
    pub octets: Vec<u8>,
    /// From the end of the request to the start of the reply, where that is known exactly.
    pub delay: Option<Duration>,
    /// A character of it had an error.
    pub damaged: bool,
}

/// What a rig can do on the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Abilities {
    /// Times are those of the bus, to the nanosecond; hours cost nothing.
    pub exact_time: bool,
    /// Characters with errors can be sent.
    pub line_errors: bool,
    /// The slave sees a stream of octets, without the idle times between them.
    pub stream: bool,
    /// The master's rate can be chosen, and a slave at another one hears nothing but errors.
    pub rates: bool,
}

/// What a device has to be like at the beginning of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Order {
    /// The master's rate.
    pub rate: Baudrate,
    /// The slave searches its rate; else it is set to `rate`.
    pub search: bool,
    /// The power comes on for this case.
    pub power_on: bool,
    /// The address to answer to; `None`: as delivered, the switches at 126.
    pub address: Option<u8>,
}

/// What a rig did about an [`Order`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fresh {
    /// The device is as delivered, and its power has just come on.
    Delivered,
    /// Its power has just come on; it remembers what it keeps without power.
    PowerCycled,
    /// It goes on as it was.
    Same,
}

/// A hand at the controls of the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// The power is cut without warning.
    PowerOff,
    /// And comes back.
    PowerOn,
    /// The rotary switches, X16 in the high digit.
    Switches(u8),
    /// The shaft stands at a physical position in counts.
    Shaft(i64),
    /// The shaft turns at so many revolutions a minute, from where it is.
    Turn(f64),
    /// Supply in tenths of a volt.
    Supply(i32),
    /// Temperature in tenths of a degree.
    Temperature(i16),
    /// Whether the light source has reserve.
    Light(bool),
    /// The battery.
    Battery(Battery),
    /// The sensor reports a fault: a position error.
    PositionError,
    /// Operating time, in tenths of an hour.
    OperatingTime(u64),
}

/// The state of the battery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Battery {
    /// Good.
    Ok,
    /// Below its limit.
    Low,
    /// Empty.
    Empty,
}

/// What kind of control a case needs; each is asked for before the case begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Hand {
    /// [`Action::PowerOff`], [`Action::PowerOn`].
    Power,
    /// A memory as delivered.
    Delivery,
    /// [`Action::Switches`]
    Switches,
    /// [`Action::Shaft`], [`Action::Turn`]
    Shaft,
    /// [`Action::Supply`], [`Action::Temperature`], [`Action::Light`], [`Action::Battery`]
    World,
    /// [`Action::PositionError`]
    Faults,
    /// [`Action::OperatingTime`]
    OperatingTime,
}

impl Action {
    /// The control that it takes.
    pub const fn hand(&self) -> Hand {
        match self {
            Self::PowerOff | Self::PowerOn => Hand::Power,
            Self::Switches(_) => Hand::Switches,
            Self::Shaft(_) | Self::Turn(_) => Hand::Shaft,
            Self::Supply(_) | Self::Temperature(_) | Self::Light(_) | Self::Battery(_) => Hand::World,
            Self::PositionError => Hand::Faults,
            Self::OperatingTime(_) => Hand::OperatingTime,
        }
    }
}

impl Hand {
    /// What a report says is missing.
    pub const fn what(self) -> &'static str {
        match self {
            Self::Power => "the device's power",
            Self::Delivery => "the device's memory (a device as delivered)",
            Self::Switches => "the device's rotary switches",
            Self::Shaft => "the device's shaft",
            Self::World => "the device's supply, temperature, light and battery",
            Self::Faults => "the device's faults",
            Self::OperatingTime => "the device's operating time",
        }
    }
}

/// Why a run cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The port broke.
    #[error(transparent)]
    End(#[from] bus::EndError),
    /// Nobody takes the octets.
    #[error("the port takes no octets: nobody reads at its far side")]
    NotTaken,
    /// The device did not do what it was asked to by its controls.
    #[error("the control of the device failed: {0}")]
    Control(String),
}

/// A bus with the slave under test on it, and the tester's hands.
pub trait Rig {
    /// What can be done on the line.
    fn abilities(&self) -> Abilities;

    /// Whether the device has this control.
    fn has(&self, hand: Hand) -> bool;

    /// Gets the device ready for a case.
    ///
    /// # Errors
    ///
    /// The port or the control broke.
    fn fresh(&mut self, order: &Order) -> Result<Fresh, RigError>;

    /// Sends after the idle time that a request needs.
    ///
    /// # Errors
    ///
    /// The port broke.
    fn send(&mut self, signals: &[Signal]) -> Result<(), RigError>;

    /// What came after the last [`send`](Self::send).
    ///
    /// # Errors
    ///
    /// The port broke.
    fn listen(&mut self, expect: Expect) -> Result<Heard, RigError>;

    /// Lets time pass. Octets that come meanwhile are given back.
    ///
    /// # Errors
    ///
    /// The port broke.
    fn wait(&mut self, span: Duration) -> Result<Vec<u8>, RigError>;

    /// The master goes on at another rate.
    ///
    /// # Errors
    ///
    /// The port broke.
    fn set_rate(&mut self, rate: Baudrate) -> Result<(), RigError>;

    /// The master's rate.
    fn rate(&self) -> Baudrate;

    /// Moves a control. Only asked for what the device [`has`](Self::has).
    ///
    /// # Errors
    ///
    /// The control broke.
    fn act(&mut self, action: &Action) -> Result<(), RigError>;
}

/// The slot time that masters use at this rate.
#[doc(alias = "Tsl")]
pub const fn slot_time(rate: Baudrate) -> BitTimes {
    bus::virtual_segment::slot_time(rate)
}
