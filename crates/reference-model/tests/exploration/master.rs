//! A master as simple as can be: start-up, data exchange, one retry, and back to the start-up.

/// Who it is.
pub(crate) const MASTER: u8 = 2;
/// Whom it talks to.
pub(crate) const SLAVE: u8 = 11;

/// What it does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Diagnosis,
    SetPrm,
    ChkCfg,
    Ready,
    Exchange,
}

/// How masters differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Habits {
    /// A station that falls silent is begun anew with FCV = 0, FCB = 1; else the count goes on.
    pub(crate) resets_count: bool,
    /// A retry carries new outputs under the old count.
    pub(crate) renews_outputs: bool,
}

/// What it needs to know of the slave.
#[derive(Debug, Clone)]
pub(crate) struct Facts {
    pub(crate) prm: Vec<u8>,
    pub(crate) cfg: Vec<u8>,
    pub(crate) inputs: usize,
}

pub(crate) struct Master {
    habits: Habits,
    facts: Facts,
    phase: Phase,
    fcb: bool,
    first: bool,
    is_retry: bool,
    /// The number in the outputs of the request.
    serial: u16,
    /// Numbers whose exchange was answered well.
    pub(crate) answered: Vec<u16>,
    /// Numbers sent, retries included.
    pub(crate) sent: u16,
    /// Exchanges answered well, one after the other.
    pub(crate) in_a_row: u32,
}

fn telegram(fc: u8, sap: Option<u8>, data: &[u8]) -> Vec<u8> {
    let extension = if sap.is_some() { 0x80 } else { 0 };
    let saps: Vec<u8> = sap.into_iter().flat_map(|sap| [sap, 0x3E]).collect();
    let body = [&[SLAVE | extension, MASTER | extension, fc], &saps[..], data].concat();
    let sum = body.iter().fold(0u8, |sum, octet| sum.wrapping_add(*octet));
    let le = u8::try_from(body.len()).expect("short");
    [&[0x68, le, le, 0x68], &body[..], &[sum, 0x16]].concat()
}

/// Outputs that carry a number; those of odd ones ask for a preset to it.
pub(crate) fn outputs(serial: u16) -> [u8; 4] {
    let [high, low] = serial.to_be_bytes();
    [if serial % 2 == 1 { 0x80 } else { 0 }, 0, high, low]
}

impl Master {
    pub(crate) fn new(habits: Habits, facts: Facts) -> Self {
        let phase = Phase::Diagnosis;
        let (fcb, first, is_retry, answered) = (true, true, false, Vec::new());
        Self { habits, facts, phase, fcb, first, is_retry, serial: 1, answered, sent: 0, in_a_row: 0 }
    }

    pub(crate) fn request(&mut self) -> Vec<u8> {
        let fc = 0x4D | if self.first { 0 } else { 0x10 } | if self.fcb { 0x20 } else { 0 };
        match self.phase {
            Phase::Diagnosis | Phase::Ready => telegram(fc, Some(0x3C), &[]),
            Phase::SetPrm => telegram(fc, Some(0x3D), &self.facts.prm),
            Phase::ChkCfg => telegram(fc, Some(0x3E), &self.facts.cfg),
            Phase::Exchange => {
                if self.is_retry && self.habits.renews_outputs {
                    self.serial += 1;
                }
                self.sent = self.sent.max(self.serial);
                telegram(fc, None, &outputs(self.serial))
            }
        }
    }

    /// What it makes of a reply, or of the slot time gone by.
    pub(crate) fn hear(&mut self, reply: Option<&[u8]>) {
        let Some(next) = reply.and_then(|reply| self.next(reply)) else {
            if !self.is_retry {
                self.is_retry = true;
                return;
            }
            self.offline();
            return;
        };
        (self.fcb, self.first, self.is_retry) = (!self.fcb, false, false);
        if self.phase == Phase::Exchange {
            self.serial += 1;
        }
        if next != Phase::Exchange {
            self.in_a_row = 0;
        }
        self.phase = next;
    }

    fn offline(&mut self) {
        (self.phase, self.is_retry, self.in_a_row) = (Phase::Diagnosis, false, 0);
        self.serial += 1;
        if self.habits.resets_count {
            (self.fcb, self.first) = (true, true);
        }
    }

    /// What follows a reply; `None`: it is none to this request.
    fn next(&mut self, reply: &[u8]) -> Option<Phase> {
        let is_negative = matches!(reply, [0x10, MASTER, SLAVE, 0x03, ..]);
        let diagnosis = match reply {
            [0x68, _, _, 0x68, 0x82, 0x8B, 0x08, 0x3E, 0x3C, octets @ .., _, 0x16] => Some(octets),
            _ => None,
        };
        match self.phase {
            Phase::Diagnosis => diagnosis.map(|_| Phase::SetPrm),
            Phase::Ready => diagnosis.map(|octets| {
                let ready = octets[0] & 0x46 == 0 && octets[1] & 0x01 == 0;
                if ready { Phase::Exchange } else { Phase::Diagnosis }
            }),
            Phase::SetPrm if reply == [0xE5] => Some(Phase::ChkCfg),
            Phase::ChkCfg if reply == [0xE5] => Some(Phase::Ready),
            Phase::Exchange => match reply {
                [0x68, _, _, 0x68, MASTER, SLAVE, 0x08 | 0x0A, inputs @ .., _, 0x16]
                    if inputs.len() == self.facts.inputs =>
                {
                    self.in_a_row += 1;
                    // Which of them the slave took, a master that renews cannot know.
                    if !(self.is_retry && self.habits.renews_outputs) {
                        self.answered.push(self.serial);
                    }
                    Some(Phase::Exchange)
                }
                _ if is_negative => Some(Phase::Diagnosis),
                _ => None,
            },
            _ if is_negative => Some(Phase::Diagnosis),
            _ => None,
        }
    }
}
