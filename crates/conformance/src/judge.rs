//! Whether what came is what was due; if not, why.

use profibus_dp::time::{Baudrate, BitTimes};

use crate::case::{DataDue, DiagDue, Due, Kind, Pattern};
use crate::reply::{Reply, hex};
use crate::rig::Heard;
use crate::telegram::{Asked, Atom, Context};

/// The SAP of Get_Cfg.
const GET_CFG: u8 = 59;

/// What a reply is judged by.
pub(crate) struct Judge<'a> {
    pub(crate) context: Context<'a>,
    pub(crate) asked: Option<&'a Asked>,
    /// The reply before to the same master.
    pub(crate) before: Option<&'a [u8]>,
    /// What labels stand for.
    pub(crate) labels: &'a [(String, Vec<u8>)],
    pub(crate) rate: Baudrate,
    pub(crate) exact_time: bool,
}

/// Why a reply is not what was due.
type Verdict = Result<(), String>;

impl Judge<'_> {
    /// Finds the alternative that fits; the reason why the first one does not.
    pub(crate) fn judge<'d>(&self, heard: &Heard, due: &[&'d Due]) -> Result<&'d Due, String> {
        let mut first = None;
        for due in due {
            match self.one(heard, due) {
                Ok(()) => return Ok(due),
                Err(why) => {
                    first.get_or_insert(why);
                }
            }
        }
        Err(first.unwrap_or_else(|| "nothing of what could be due fits this bus".to_owned()))
    }

    fn one(&self, heard: &Heard, due: &Due) -> Verdict {
        let kind = &due.kind;
        if let Kind::Silence | Kind::Late = kind {
            return match (heard.octets.is_empty(), kind) {
                (true, _) => Ok(()),
                (false, Kind::Late) => Err("a reply was sent although its time was over".to_owned()),
                (false, _) => Err("the slave sent something, but silence was due".to_owned()),
            };
        }
        if heard.octets.is_empty() {
            return Err("the slave was silent, but a reply was due".to_owned());
        }
        if heard.damaged {
            return Err("a character of the reply had a parity or framing error".to_owned());
        }
        self.timing(heard, due)?;
        match kind {
            Kind::Raw(patterns) => self.raw(&heard.octets, patterns),
            Kind::Again => match self.before {
                Some(before) if before == heard.octets => Ok(()),
                Some(before) => Err(format!("not octet for octet the reply before, {}", hex(before))),
                None => Err("there was no reply before".to_owned()),
            },
            _ => self.reply(&Reply::parse(&heard.octets)?, kind),
        }
    }

    fn timing(&self, heard: &Heard, due: &Due) -> Verdict {
        let Some(delay) = heard.delay.filter(|_| self.exact_time) else {
            return Ok(());
        };
        let min = due.min_tsdr.unwrap_or(11);
        let max = self.context.device.max_tsdr(self.rate).0.max(min);
        let bits = |bits| self.rate.duration(BitTimes(bits));
        // A bit and a half of rounding, as edges are not known better.
        if delay < bits(min) {
            return Err(format!(
                "the reply began {} ns after the request, earlier than min T_SDR = {min} bit times",
                delay.as_nanos()
            ));
        }
        if delay > bits(max + 1) {
            return Err(format!(
                "the reply began {} ns after the request, later than max T_SDR = {max} bit times",
                delay.as_nanos()
            ));
        }
        if due.min_tsdr.is_some() && delay > bits(min + 11) && min > 11 {
            return Err(format!("the reply began long after min T_SDR = {min} bit times"));
        }
        Ok(())
    }

    fn raw(&self, octets: &[u8], patterns: &[Pattern]) -> Verdict {
        self.matches(octets, patterns)
    }

    /// Everything but the data: format, addresses, SAPs, function code.
    fn reply(&self, reply: &Reply, kind: &Kind) -> Verdict {
        let Reply::Data { da, sa, fc, dsap, ssap, data } = reply else {
            return match (kind, reply) {
                (Kind::Ack, Reply::Ack) => Ok(()),
                (Kind::Data { priority, data }, Reply::Ack) if self.data_less(*priority, data) => Ok(()),
                (_, Reply::Ack) => Err("E5 came, but a telegram was due".to_owned()),
                _ => Err("a token came".to_owned()),
            };
        };
        self.head(*da, *sa, *fc)?;
        match kind {
            Kind::Ack if *fc == 0x02 || *fc == 0x03 => Err(format!("{} came, but E5 was due", code(*fc))),
            Kind::Ack => Err("a telegram came, but E5 was due".to_owned()),
            Kind::Ok => short(reply, 0x00),
            Kind::Negative(due) => short(reply, *due),
            Kind::Ident => ident(*fc, data),
            Kind::Diag(due) => {
                fc_is(*fc, 0x08)?;
                self.mirrored(*dsap, *ssap)?;
                self.diag(data, due)
            }
            Kind::Data { priority, data: due } => {
                if let Some(priority) = priority {
                    fc_is(*fc, *priority)?;
                } else if *fc != 0x08 && *fc != 0x0A {
                    return fc_is(*fc, 0x08);
                }
                self.mirrored(*dsap, *ssap)?;
                if *ssap == Some(GET_CFG) {
                    crate::identifiers::whole(data)?;
                }
                self.data(data, due)
            }
            _ => Ok(()),
        }
    }

    fn head(&self, da: u8, sa: u8, fc: u8) -> Verdict {
        let (to, from) = self
            .asked
            .map_or((self.context.address, self.context.masters[0]), |asked| (asked.to, asked.from));
        if da != from {
            return Err(format!("the reply goes to station {da}, but {from} asked"));
        }
        if sa != to {
            return Err(format!("the reply says that it comes from station {sa}, but {to} was asked"));
        }
        if fc & 0xF0 != 0 {
            return Err(format!("function code {fc:02X}: bits 4 to 7 of a slave's reply have to be 0"));
        }
        Ok(())
    }

    fn mirrored(&self, dsap: Option<u8>, ssap: Option<u8>) -> Verdict {
        let asked = self.asked.and_then(|asked| asked.dsap);
        let due = (asked.map(|_| crate::telegram::MASTER_SAP), asked);
        if (dsap, ssap) == due {
            Ok(())
        } else {
            Err("the SAPs of the reply are not those of the request, exchanged".to_owned())
        }
    }

    fn diag(&self, octets: &[u8], due: &DiagDue) -> Verdict {
        let Some((head, _)) = octets.split_first_chunk::<6>() else {
            return Err(format!("a diagnosis has at least 6 octets, not {}", octets.len()));
        };
        if head[4..] != self.context.ident.to_be_bytes() {
            return Err(format!("octets 5 and 6 are not the ident number {:04X}", self.context.ident));
        }
        always(*head)?;
        whole_blocks(&octets[6..])?;
        // What an extended diagnosis may say at any time does not count against a foreign slave.
        let free = [0x08, if head[0] & 0x02 == 0 { 0x02 } else { 0 }, 0x80, 0];
        for (at, pattern) in due.head.iter().enumerate() {
            let (value, mask) = self.pattern(pattern);
            let (value, mask) =
                (value.first().copied().unwrap_or(0), mask & !if due.exact { 0 } else { free[at] });
            if head[at] & mask != value & mask {
                return Err(format!(
                    "octet {} of the diagnosis is {:02X}, but {value:02X} was due: {}",
                    at + 1,
                    head[at],
                    in_words(at, head[at], value)
                ));
            }
        }
        if let Some(length) = due.length.filter(|length| *length != octets.len()) {
            return Err(format!("the diagnosis has {} octets, but {length} were due", octets.len()));
        }
        for (at, patterns) in &due.octets {
            let rest = octets.get(at - 1..).unwrap_or_default();
            let count = self.count(patterns);
            self.matches(&rest[..count.min(rest.len())], patterns)
                .map_err(|why| format!("diagnosis from octet {at} on: {why}"))?;
        }
        Ok(())
    }

    /// How many data the reply to what was asked has.
    fn due_length(&self) -> Option<usize> {
        let mode = self.context.mode;
        match self.asked.map(|asked| asked.dsap) {
            Some(None | Some(56)) => Some(mode.inputs),
            Some(Some(57)) => Some(mode.outputs),
            _ => None,
        }
    }

    /// E5 stands for data of no length.
    fn data_less(&self, priority: Option<u8>, due: &DataDue) -> bool {
        let none = match due {
            DataDue::Any => self.due_length() == Some(0),
            // What may be any data is some all the same.
            DataDue::Octets(patterns) => {
                self.count(patterns) == 0 && !patterns.iter().any(|pattern| matches!(pattern, Pattern::Rest))
            }
            DataDue::Label(label, same) => *same && self.label(label).is_some_and(<[u8]>::is_empty),
        };
        none && priority != Some(0x0A)
    }

    fn data(&self, octets: &[u8], due: &DataDue) -> Verdict {
        match due {
            DataDue::Any => match self.due_length() {
                Some(length) if length != octets.len() => {
                    Err(format!("{} octets of data came, but {length} were due", octets.len()))
                }
                _ => Ok(()),
            },
            DataDue::Octets(patterns) => self.matches(octets, patterns),
            DataDue::Label(label, same) => match (self.label(label), same) {
                (Some(known), true) if known != octets => {
                    Err(format!("the data are {}, but {} were due", hex(octets), hex(known)))
                }
                (Some(known), false) if known == octets => {
                    Err(format!("the data are still {}, but new ones were due", hex(octets)))
                }
                (Some(_), _) => Ok(()),
                (None, _) => Err(format!("nothing is known as {label}")),
            },
        }
    }

    fn label(&self, label: &str) -> Option<&[u8]> {
        self.labels.iter().rev().find(|(name, _)| name == label).map(|(_, octets)| octets.as_slice())
    }

    /// The octets of a pattern and which of their bits count.
    fn pattern(&self, pattern: &Pattern) -> (Vec<u8>, u8) {
        match pattern {
            Pattern::Atom(atom) => (self.context.octets(std::slice::from_ref(atom)), 0xFF),
            Pattern::Any => (vec![0], 0),
            Pattern::Rest => (Vec::new(), 0),
            Pattern::Masked(value, mask) => (vec![*value], *mask),
        }
    }

    fn count(&self, patterns: &[Pattern]) -> usize {
        patterns.iter().map(|pattern| self.pattern(pattern).0.len()).sum()
    }

    fn matches(&self, octets: &[u8], patterns: &[Pattern]) -> Verdict {
        let mut due = Vec::new();
        for pattern in patterns {
            let (values, mask) = match pattern {
                Pattern::Rest => {
                    let rest = octets.len().saturating_sub(due.len());
                    (vec![0; rest], 0)
                }
                Pattern::Atom(Atom::Sum(_)) => (vec![sum_of(&octets[..due.len().min(octets.len())])], 0xFF),
                pattern => self.pattern(pattern),
            };
            due.extend(values.into_iter().map(|value| (value, mask)));
        }
        let fits = due.len() == octets.len()
            && due.iter().zip(octets).all(|((value, mask), octet)| octet & mask == value & mask);
        if fits {
            return Ok(());
        }
        let text: Vec<_> = due
            .iter()
            .map(|(value, mask)| match mask {
                0xFF => format!("{value:02X}"),
                0 => "..".to_owned(),
                mask => format!("{value:02X}/{mask:02X}"),
            })
            .collect();
        Err(format!("{} came, but {} was due", hex(octets), text.join(" ")))
    }
}

fn sum_of(octets: &[u8]) -> u8 {
    let from = if octets.first() == Some(&0x68) { 4 } else { 1 };
    octets.iter().skip(from).fold(0, |sum, octet| sum.wrapping_add(*octet))
}

fn short(reply: &Reply, due: u8) -> Verdict {
    let Reply::Data { fc, dsap, data, .. } = reply else {
        return Ok(());
    };
    fc_is(*fc, due)?;
    if dsap.is_some() || !data.is_empty() {
        return Err(format!("{} has to be an SD1 without SAPs and data", code(due)));
    }
    Ok(())
}

fn ident(fc: u8, data: &[u8]) -> Verdict {
    fc_is(fc, 0x08)?;
    let sum: usize = data.iter().take(4).map(|length| usize::from(*length)).sum();
    if data.len() == sum + 4 {
        Ok(())
    } else {
        Err("the four lengths of the identification are not those of its texts".to_owned())
    }
}

/// The function code of a reply has to be this one.
fn fc_is(fc: u8, due: u8) -> Verdict {
    if fc == due { Ok(()) } else { Err(format!("{} came, but {} was due", code(fc), code(due))) }
}

/// What a function code of a reply is called.
pub(crate) fn code(fc: u8) -> String {
    let name = match fc {
        0x00 => "OK",
        0x01 => "UE (user error)",
        0x02 => "RR (no resource)",
        0x03 => "RS (service not activated)",
        0x08 => "DL (data, low)",
        0x09 => "NR (no data)",
        0x0A => "DH (data, high: a diagnosis is pending)",
        _ => return format!("function code {fc:02X}"),
    };
    name.to_owned()
}

/// An extended diagnosis is made of blocks whose lengths fit.
fn whole_blocks(mut octets: &[u8]) -> Verdict {
    while let Some(&header) = octets.first() {
        let length = match header >> 6 {
            0 | 1 => usize::from(header & 0x3F),
            2 => 3,
            _ => 1,
        };
        if length == 0 || length > octets.len() {
            return Err(format!(
                "the diagnosis has a block with header {header:02X}, so of {length} octets, but {} follow",
                octets.len()
            ));
        }
        octets = &octets[length..];
    }
    Ok(())
}

/// Bits that a slave never, or always, sets.
fn always(head: [u8; 6]) -> Verdict {
    if head[0] & 0xA1 != 0 {
        return Err(format!(
            "octet 1 of the diagnosis is {:02X}: bits 0, 5 and 7 belong to the master, a slave sends 0",
            head[0]
        ));
    }
    if head[1] & 0x04 == 0 {
        return Err(format!("octet 2 of the diagnosis is {:02X}: bit 2 is always 1", head[1]));
    }
    if head[1] & 0xC0 != 0 {
        return Err(format!("octet 2 of the diagnosis is {:02X}: bits 6 and 7 are always 0", head[1]));
    }
    if head[2] & 0x7F != 0 {
        return Err(format!("octet 3 of the diagnosis is {:02X}: bits 0 to 6 are reserved", head[2]));
    }
    Ok(())
}

/// The bits of a diagnosis octet that differ, by name.
fn in_words(at: usize, came: u8, due: u8) -> String {
    const NAMES: [[&str; 8]; 2] = [
        [
            "Station_Non_Existent",
            "Station_Not_Ready",
            "Cfg_Fault",
            "Ext_Diag",
            "Not_Supported",
            "Invalid_Slave_Response",
            "Prm_Fault",
            "Master_Lock",
        ],
        ["Prm_Req", "Stat_Diag", "bit 2", "WD_On", "Freeze_Mode", "Sync_Mode", "reserved", "Deactivated"],
    ];
    let Some(names) = NAMES.get(at) else {
        return if at == 3 {
            format!("the owner is {}, not {}", owner(came), owner(due))
        } else {
            "reserved".to_owned()
        };
    };
    let words: Vec<_> = (0..8)
        .filter(|bit| (came ^ due) >> bit & 1 != 0)
        .map(|bit| format!("{} is {}", names[bit], came >> bit & 1))
        .collect();
    words.join(", ")
}

fn owner(address: u8) -> String {
    if address == 0xFF { "nobody".to_owned() } else { format!("master {address}") }
}
