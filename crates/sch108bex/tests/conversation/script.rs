//! A conversation as data: what the parser makes of a file and the driver plays.

use profibus_dp::time::{Baudrate, Duration};

/// One file.
#[derive(Debug, Clone)]
pub(crate) struct Conversation {
    /// The device and the line at the beginning.
    pub(crate) setup: Setup,
    /// What happens, in order.
    pub(crate) steps: Vec<Step>,
}

/// The header of a file: which device, and how the line is.
#[derive(Debug, Clone)]
pub(crate) struct Setup {
    /// Singleturn and multiturn bits.
    pub(crate) bits: (u8, u8),
    pub(crate) switches: u8,
    pub(crate) ident: u16,
    pub(crate) serial: String,
    /// `None`: the device searches.
    pub(crate) baud: Option<Baudrate>,
    /// The rate of the master.
    pub(crate) master_baud: Baudrate,
    pub(crate) stream: bool,
    pub(crate) stored_address: Option<u8>,
    /// In tenths of an hour.
    pub(crate) operating_time: u64,
    /// Physical counts at power-on.
    pub(crate) shaft: i64,
    /// How long the non-volatile memory takes to keep a record.
    pub(crate) memory: Duration,
}

/// A step and the line where it begins.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub(crate) line: usize,
    pub(crate) action: Action,
}

#[derive(Debug, Clone)]
pub(crate) enum Action {
    /// `>` or `>>` and the `<` that follows it.
    Exchange {
        request: Vec<Piece>,
        due_line: usize,
        due: Due,
    },
    /// `+`: somebody else's telegram.
    Foreign(Vec<Piece>),
    Wait(Span),
    /// Time since the last power-on.
    At(Duration),
    Shaft(i64),
    /// So many counts in so long.
    ShaftMoves(i64, Duration),
    ShaftStops,
    PositionError,
    /// Tenths of a degree.
    Temperature(i64),
    /// Tenths of a volt.
    Supply(i64),
    Light {
        ok: bool,
    },
    Battery(Battery),
    PowerOff,
    PowerOn,
    Switches(u8),
    LineError,
    /// The master changes its rate.
    Baud(Baudrate),
    Ask(Question),
    /// `!`
    Reported(Vec<String>),
    /// `!! none`
    NothingReported,
    Repeat {
        times: u32,
        body: Vec<Step>,
    },
}

/// What a sent line consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Piece {
    Octet(u8),
    /// `--`: a character that arrives damaged.
    Damaged,
    /// `|`: what came so far is one read.
    Read,
    /// `|N`: the same, and then so many bit times of idle.
    Idle(u32),
}

/// What a `<` line demands.
#[derive(Debug, Clone)]
pub(crate) enum Due {
    /// These octets (`None`: free), not before so many bit times.
    Reply {
        min_tsdr: Option<u32>,
        octets: Vec<Option<u8>>,
        /// Silence will do as well.
        perhaps: bool,
    },
    Silence,
    /// A reply is due, but nobody asks for it until its window has passed.
    Late,
    /// A reply is due, but nobody asks for it before the next line.
    Unfetched,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Span {
    Time(Duration),
    Bits(u32),
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Battery {
    Ok,
    Low,
    Empty,
}

/// `?`: what the station says about itself, off the bus.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Question {
    Address(Option<u8>),
    Rate(Baudrate),
    Powered(bool),
}
