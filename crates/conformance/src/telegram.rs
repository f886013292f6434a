//! What is sent: telegrams as cases write them, and the octets they become.

use profibus_dp::time::BitTimes;

use crate::device::{Device, Mode};
use crate::rig::Signal;

/// Start delimiters, end delimiter, short acknowledgement.
const SD1: u8 = 0x10;
const SD2: u8 = 0x68;
const SD3: u8 = 0xA2;
const SD4: u8 = 0xDC;
const ED: u8 = 0x16;
/// The SAP of the master.
pub(crate) const MASTER_SAP: u8 = 62;

/// What one `>` line sends.
#[derive(Debug, Clone)]
pub struct Line {
    /// As written.
    pub text: String,
    /// One after the other.
    pub pieces: Vec<Piece>,
}

/// A telegram or some octets.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Which master sends it, 1 or 2.
    pub master: usize,
    /// What.
    pub body: Body,
    /// What is wrong with it on purpose, and how it comes.
    pub twists: Vec<Twist>,
    /// What stands between it and the next one.
    pub then: Joint,
}

/// Between two pieces of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// Nothing: the next octet follows at once.
    None,
    /// The end of a read.
    Read,
    /// 40 bit times of idle.
    Idle,
}

/// The octets of a piece.
#[derive(Debug, Clone)]
pub enum Body {
    /// A telegram of a service.
    Service(Service),
    /// A token.
    Token(Vec<Atom>),
    /// Octets as they are.
    Raw(Vec<Atom>),
}

/// A request.
#[derive(Debug, Clone)]
pub struct Service {
    /// The function code.
    pub fc: Fc,
    /// The service access point of the slave; `None`: Data_Exchange, FDL status and the like.
    pub dsap: Option<Vec<Atom>>,
    /// The data.
    pub data: Vec<Atom>,
    /// Where to; `None`: the slave under test.
    pub to: Option<Vec<Atom>>,
    /// From whom; `None`: the master of the piece.
    pub from: Option<Vec<Atom>>,
}

/// How the function code comes about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fc {
    /// SRD with the next frame count bit.
    Next,
    /// SRD with the frame count bit of the request before.
    Retry,
    /// SRD low with the next frame count bit.
    NextLow,
    /// SRD low with the frame count bit of the request before.
    RetryLow,
    /// SDA high with the next frame count bit.
    NextSda,
    /// This one.
    Is(u8),
}

/// What is special about a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Twist {
    /// The check sum is one too high.
    BadSum,
    /// The end delimiter is 17.
    BadEnd,
    /// The second length is one too high.
    BadRepeat,
    /// The second start delimiter of SD2 is 69.
    BadStart,
    /// The telegram is an SD2 even where it has 8 octets, or none.
    AsSd2,
    /// The telegram is an SD3.
    AsSd3,
    /// This character, counted from 1, has an error.
    Damaged(usize),
    /// One bit of this octet, counted from 1, is inverted.
    Flipped(usize, u8),
    /// Only so many octets are sent.
    Cut(usize),
    /// A read ends after so many octets.
    Split(usize),
    /// Each octet is a read of its own.
    Slowly,
    /// So many bit times of idle after so many octets.
    Gap(usize, u32),
}

/// Octets by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Atom {
    /// This octet, so many times.
    Octet(u8, usize),
    /// The ident number, so much higher.
    Ident(u16),
    /// Good parameters of a mode.
    Prm {
        /// Which; `None`: the usual one.
        mode: Option<String>,
        /// With the watchdog on, 200 ms.
        watchdog: bool,
        /// From octet N on other ones.
        changed: Vec<(usize, Vec<Atom>)>,
        /// Only so many octets.
        first: Option<usize>,
    },
    /// The configuration of a mode.
    Cfg(Option<String>),
    /// As many octets as the mode in force has outputs, all the same.
    Outputs(u8),
    /// The slave's address; the bit says that an extension follows.
    Own(u8),
    /// A master's address.
    Master(usize, u8),
    /// An address that is neither the slave's nor a master's.
    Other(u8),
    /// The measuring units of one turn, and so many more.
    Units(i64),
    /// The total range, and so much more.
    Range(i64),
    /// The largest number that fits into four octets, and the like: four octets.
    Number(u32),
    /// The revolutions: two octets.
    Turns,
    /// Ten octets of serial number.
    Serial,
    /// The sum of the octets since the last address began.
    Sum(u8),
    /// The next function code.
    NextFc,
    /// A whole FDL status request to the slave.
    Stat,
}

/// What octets depend on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) device: &'a Device,
    pub(crate) mode: &'a Mode,
    pub(crate) address: u8,
    pub(crate) masters: [u8; 2],
    pub(crate) ident: u16,
    /// For [`Atom::NextFc`].
    pub(crate) fc: u8,
}

/// Who asked what, for the judge of the reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) to: u8,
    pub(crate) from: u8,
    pub(crate) dsap: Option<u8>,
}

impl Context<'_> {
    /// The octets of several atoms.
    pub(crate) fn octets(&self, atoms: &[Atom]) -> Vec<u8> {
        let mut octets = Vec::new();
        for atom in atoms {
            self.push(atom, &mut octets);
        }
        octets
    }

    fn push(&self, atom: &Atom, to: &mut Vec<u8>) {
        match atom {
            Atom::Octet(octet, times) => to.extend(std::iter::repeat_n(*octet, *times)),
            Atom::Ident(more) => to.extend(self.ident.wrapping_add(*more).to_be_bytes()),
            Atom::Prm { mode, watchdog, changed, first } => {
                let mut prm = self.prm(mode.as_deref(), *watchdog);
                for (at, atoms) in changed {
                    let new = self.octets(atoms);
                    prm.resize(prm.len().max(at - 1 + new.len()), 0);
                    prm[at - 1..at - 1 + new.len()].copy_from_slice(&new);
                }
                prm.resize(first.unwrap_or(prm.len()), 0);
                to.extend(prm);
            }
            Atom::Cfg(mode) => to.extend(&self.device.mode(mode.as_deref()).unwrap_or(self.mode).cfg),
            Atom::Outputs(octet) => to.extend(std::iter::repeat_n(*octet, self.mode.outputs)),
            Atom::Own(bit) => to.push(self.address | bit),
            Atom::Master(number, bit) => to.push(self.masters[number - 1] | bit),
            Atom::Other(bit) => to.push(self.other() | bit),
            Atom::Units(more) => to.extend(number(1 << self.bits().0, *more)),
            Atom::Range(more) => to.extend(number(1 << (self.bits().0 + self.bits().1), *more)),
            Atom::Number(value) => to.extend(value.to_be_bytes()),
            Atom::Turns => to.extend((1_u16 << self.bits().1).to_be_bytes()),
            Atom::Serial => to.extend(self.serial()),
            Atom::Sum(more) => {
                let sum = sum(to).wrapping_add(*more);
                to.push(sum);
            }
            Atom::NextFc => to.push(self.fc),
            Atom::Stat => to.extend(frame([self.address, self.masters[0], 0x49], &[], &[])),
        }
    }

    /// Good Set_Prm data: lock, watchdog 200 ms or none, min T_SDR 11, no group.
    fn prm(&self, mode: Option<&str>, watchdog: bool) -> Vec<u8> {
        let [high, low] = self.ident.to_be_bytes();
        let status = if watchdog { 0x88 } else { 0x80 };
        let mut prm = vec![status, 0x01, 0x14, 0x0B, high, low, 0x00];
        prm.extend(&self.device.mode(mode).unwrap_or(self.mode).user_prm);
        prm
    }

    /// An address that nobody has.
    fn other(&self) -> u8 {
        let taken = [self.address, self.masters[0], self.masters[1]];
        (5..20).find(|address| !taken.contains(address)).unwrap_or(5)
    }

    fn bits(&self) -> (u8, u8) {
        self.device.encoder.as_ref().map_or((0, 0), |facts| (facts.singleturn_bits, facts.multiturn_bits))
    }

    fn serial(&self) -> Vec<u8> {
        let serial = self.device.encoder.as_ref().and_then(|facts| facts.serial.clone()).unwrap_or_default();
        format!("{serial:<10}").into_bytes()
    }

    /// The octets of a telegram, and who asked what.
    pub(crate) fn service(&self, service: &Service, master: usize, twists: &[Twist]) -> (Vec<u8>, Asked) {
        let one = |atoms: &Option<Vec<Atom>>, default: u8| {
            atoms.as_ref().and_then(|atoms| self.octets(atoms).first().copied()).unwrap_or(default)
        };
        let asked = Asked {
            to: one(&service.to, self.address),
            from: one(&service.from, self.masters[master - 1]),
            dsap: service.dsap.as_ref().map(|sap| one(&Some(sap.clone()), 0)),
        };
        let mut pdu = Vec::new();
        let mut extension = 0;
        if let Some(dsap) = asked.dsap {
            extension = 0x80;
            pdu.extend([dsap, MASTER_SAP]);
        }
        pdu.extend(self.octets(&service.data));
        let head = [asked.to | extension, asked.from | extension, self.fc];
        (frame(head, &pdu, twists), asked)
    }

    /// The signals of a piece.
    pub(crate) fn signals(&self, piece: &Piece) -> (Vec<Signal>, Option<Asked>) {
        let (octets, asked) = match &piece.body {
            Body::Service(service) => {
                let (octets, asked) = self.service(service, piece.master, &piece.twists);
                (octets, Some(asked))
            }
            Body::Token(atoms) => {
                let mut octets = vec![SD4];
                octets.extend(self.octets(atoms));
                (octets, None)
            }
            Body::Raw(atoms) => (self.octets(atoms), None),
        };
        (twist(&octets, &piece.twists), asked)
    }
}

/// A number in four octets.
fn number(value: i64, more: i64) -> [u8; 4] {
    u32::try_from(value + more).unwrap_or(0).to_be_bytes()
}

/// The sum of a telegram that is still without it.
fn sum(octets: &[u8]) -> u8 {
    // Cases write raw octets of one telegram at a time; what stands before its start delimiter
    // is garbage of theirs and not part of the sum.
    let from = match octets.first() {
        Some(&SD2) => 4,
        Some(&SD1 | &SD3) => 1,
        _ => 0,
    };
    octets.iter().skip(from).fold(0, |sum, octet| sum.wrapping_add(*octet))
}

/// Puts a telegram together: SD1 without data, SD3 only where asked for, else SD2.
fn frame(head: [u8; 3], pdu: &[u8], twists: &[Twist]) -> Vec<u8> {
    let has = |twist| twists.contains(&twist);
    let mut body = head.to_vec();
    body.extend(pdu);
    let mut octets = if pdu.is_empty() && !has(Twist::AsSd2) {
        vec![SD1]
    } else if has(Twist::AsSd3) {
        vec![SD3]
    } else {
        let length = u8::try_from(body.len()).unwrap_or(u8::MAX);
        let repeat = length.wrapping_add(u8::from(has(Twist::BadRepeat)));
        vec![SD2, length, repeat, if has(Twist::BadStart) { SD2 + 1 } else { SD2 }]
    };
    let sum = body.iter().fold(u8::from(has(Twist::BadSum)), |sum, octet| sum.wrapping_add(*octet));
    octets.extend(body);
    octets.extend([sum, ED + u8::from(has(Twist::BadEnd))]);
    octets
}

/// Octets as they come over the line.
fn twist(octets: &[u8], twists: &[Twist]) -> Vec<Signal> {
    let cut = twists.iter().find_map(|twist| match twist {
        Twist::Cut(count) => Some(*count),
        _ => None,
    });
    let mut signals = Vec::new();
    for (at, octet) in octets.iter().take(cut.unwrap_or(usize::MAX)).enumerate() {
        let number = at + 1;
        let mut signal = Signal::Octet(*octet);
        for twist in twists {
            match *twist {
                Twist::Damaged(which) if which == number => signal = Signal::Damaged(*octet),
                Twist::Flipped(which, mask) if which == number => signal = Signal::Octet(octet ^ mask),
                _ => {}
            }
        }
        signals.push(signal);
        if number == octets.len() {
            break;
        }
        for twist in twists {
            match *twist {
                Twist::Split(after) if after == number => signals.push(Signal::Read),
                Twist::Slowly => signals.extend([Signal::Read, Signal::Pause(BitTimes(11))]),
                Twist::Gap(after, bits) if after == number => signals.push(Signal::Pause(BitTimes(bits))),
                _ => {}
            }
        }
    }
    signals
}

impl Piece {
    /// Whether the slave at `address` gets it as a request that has to do with frame counts.
    pub(crate) fn is_sound(&self) -> bool {
        !self.twists.iter().any(|twist| {
            matches!(
                twist,
                Twist::BadSum
                    | Twist::BadEnd
                    | Twist::BadRepeat
                    | Twist::BadStart
                    | Twist::Damaged(_)
                    | Twist::Flipped(..)
                    | Twist::Cut(_)
            )
        })
    }
}
