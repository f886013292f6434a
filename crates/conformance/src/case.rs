//! A case: one rule, and how it is tried.

use profibus_dp::time::{Baudrate, Duration};

use crate::rig::{Action, Hand};
use crate::telegram::{Atom, Line};

/// One rule that a slave has to keep.
#[derive(Debug, Clone)]
pub struct Case {
    /// The number; those of the slave reference where it has one.
    pub id: String,
    /// The rule in one sentence.
    pub title: String,
    /// What it is about; reports sum up by it.
    pub area: String,
    /// The sections of the slave reference, or of the manual, that it follows.
    pub rule: String,
    /// What of it is disputed, as points of section 8 of the slave reference.
    pub disputed: Vec<String>,
    /// Names of rules, for those who break one on purpose.
    pub tags: Vec<String>,
    /// Whom it is for.
    pub profile: Profile,
    /// Takes more than 2 s on a real bus.
    pub long: bool,
    /// What it needs beyond a port and an address.
    pub needs: Vec<Need>,
    /// Where it begins.
    pub before: Before,
    /// Whether the slave has to answer an FDL status request at the end.
    pub alive: bool,
    /// What happens.
    pub steps: Vec<Step>,
}

/// Whom a case is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// Any DP-V0 slave.
    DpV0,
    /// The encoder of the manual.
    Encoder,
}

/// What a case needs beyond a port and an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Need {
    /// A control of the device.
    Hand(Hand),
    /// A bus whose times are exact.
    ExactTime,
    /// Characters with errors can be sent.
    LineErrors,
    /// The slave sees a stream of octets.
    Stream,
    /// The slave sees idle times.
    Idle,
    /// Rates can be chosen, and slaves hear the difference.
    Rates,
    /// A feature that the GSD says the slave has, or has not.
    Feature(Feature, bool),
    /// The usual mode has outputs, or has none.
    Outputs(bool),
    /// The usual mode has inputs, or has none.
    Inputs(bool),
    /// The usual mode has so many output octets.
    OutputOctets(usize),
    /// The usual mode has so many parameter octets at least, from octet 8 on.
    UserPrm(usize),
    /// An encoder with so many bits for one turn and for the turns.
    Bits(u8, u8),
    /// An encoder whose serial number is known.
    Serial,
}

/// A feature of [`Features`](crate::Features).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// Freeze
    Freeze,
    /// Sync
    Sync,
    /// An empty Data_Exchange clears the outputs.
    FailSafe,
    /// Set_Slave_Add
    SetSlaveAdd,
    /// Octet 8 of Set_Prm is that of the slave ASIC.
    AsicOctet8,
}

/// Where a case begins.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Before {
    /// The state.
    pub state: Start,
    /// The mode, for the states that have one.
    pub mode: Option<String>,
    /// The DP watchdog runs, 200 ms.
    pub watchdog: bool,
    /// The rate, where it matters.
    pub rate: Option<Baudrate>,
    /// The slave searches its rate.
    pub search: bool,
}

/// A state of a slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// The power has just come on.
    PowerOn,
    /// As delivered, at 126.
    At126,
    /// Waits for Set_Prm.
    #[default]
    WaitPrm,
    /// Waits for Chk_Cfg.
    WaitCfg,
    /// Exchanges data.
    DataExchange,
}

/// One thing that happens.
#[derive(Debug, Clone)]
pub enum Step {
    /// The master sends, and something is due.
    Exchange {
        /// What is sent.
        line: Line,
        /// What is due; any of these will do.
        due: Vec<Due>,
    },
    /// Somebody sends what nobody answers, and nobody listens.
    Foreign(Line),
    /// Time passes.
    Wait(Span),
    /// A control is moved.
    Act(Action),
    /// The case goes on from another beginning.
    To(Before),
    /// The master goes on at another rate.
    Rate(Baudrate),
    /// Telegrams go to another address from now on.
    Address(Vec<Atom>),
    /// The master takes its next frame count bit from the beginning: FCV = 0, FCB = 1.
    FirstFcb(usize),
    /// Again and again.
    Repeat(u32, Vec<Step>),
    /// So many random octets; whatever is answered must have been asked.
    Random(usize),
    /// Who drives the line from the next step on expects what the text says; for reports.
    Note(String),
}

/// Time, or bit times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Span {
    /// Time.
    Time(Duration),
    /// Bit times.
    Bits(u32),
}

/// What is due, as written and as understood.
#[derive(Debug, Clone)]
pub struct Due {
    /// As written.
    pub text: String,
    /// As understood.
    pub kind: Kind,
    /// The reply may not start before so many bit times.
    pub min_tsdr: Option<u32>,
    /// Under which its data are remembered.
    pub label: Option<String>,
    /// The disputed point that allows it.
    pub disputed: Option<String>,
    /// Only where the slave sees a stream (`true`), or idle times (`false`).
    pub stream: Option<bool>,
}

/// What is due.
#[derive(Debug, Clone)]
pub enum Kind {
    /// The short acknowledgement E5.
    Ack,
    /// FDL status: OK, a slave.
    Ok,
    /// RS, RR or NR: this function code.
    Negative(u8),
    /// Nothing.
    Silence,
    /// Nothing, because nobody asked in time.
    Late,
    /// Slave_Diag.
    Diag(DiagDue),
    /// Data of the service that was asked for.
    Data {
        /// DL (08) or DH (0A); `None`: either.
        priority: Option<u8>,
        /// What the data have to be.
        data: DataDue,
    },
    /// Octet for octet what came before to the same master.
    Again,
    /// These octets, check sums included.
    Raw(Vec<Pattern>),
    /// Identification with four texts.
    Ident,
}

/// What the data of a reply have to be.
#[derive(Debug, Clone)]
pub enum DataDue {
    /// As many as the agreed configuration has.
    Any,
    /// Octets.
    Octets(Vec<Pattern>),
    /// The same as those remembered (`true`), or others.
    Label(String, bool),
}

/// What Slave_Diag has to say.
#[derive(Debug, Clone)]
pub struct DiagDue {
    /// Octets 1 to 4. Ext_Diag, Stat_Diag in data exchange and Ext_Diag_Overflow are free unless `exact`.
    pub head: Vec<Pattern>,
    /// Whether Ext_Diag counts.
    pub exact: bool,
    /// All octets.
    pub length: Option<usize>,
    /// From which octet on there is what.
    pub octets: Vec<(usize, Vec<Pattern>)>,
}

/// An octet that is due.
#[derive(Debug, Clone)]
pub enum Pattern {
    /// These.
    Atom(Atom),
    /// Any one.
    Any,
    /// Any number of any.
    Rest,
    /// The bits of the second that are set in the first.
    Masked(u8, u8),
}
