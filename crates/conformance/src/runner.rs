//! Plays a case against a slave.

use std::time::Instant as Moment;

use profibus_dp::time::{Baudrate, BitTimes, Duration};

use crate::case::{Before, Case, Due, Kind, Span, Step};
use crate::device::{Device, Mode};
use crate::judge::Judge;
use crate::needs;
use crate::reply::{Reply, hex};
use crate::result::{CaseResult, Outcome, Record};
use crate::rig::{Action, Expect, Heard, Rig, RigError, Signal};
use crate::telegram::{Asked, Atom, Body, Context, Fc, Joint, Line, Piece};

/// How the tester behaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// The addresses of the two masters that the tester plays.
    pub masters: [u8; 2],
    /// The rate at which the slave is met.
    pub rate: Baudrate,
    /// SRD low wherever a case does not say otherwise.
    pub srd_low: bool,
    /// Cases that take long are tried as well.
    pub long: bool,
    /// Alternatives that only a disputed point allows do not count.
    pub strict: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { masters: [2, 3], rate: Baudrate::B500000, srd_low: false, long: false, strict: false }
    }
}

/// Why a case ended before its end.
#[derive(Debug)]
pub(crate) enum Stop {
    /// The slave broke the rule.
    Fault(String),
    /// The case cannot be played here.
    Skip(String),
    /// The rig broke.
    Rig(RigError),
}

impl From<RigError> for Stop {
    fn from(error: RigError) -> Self {
        Self::Rig(error)
    }
}

pub(crate) type Played<T = ()> = Result<T, Stop>;

/// A tester at work on one slave.
pub struct Runner<'a> {
    pub(crate) device: &'a Device,
    pub(crate) rig: &'a mut dyn Rig,
    pub(crate) options: Options,
    pub(crate) ident: u16,
    /// Where telegrams go.
    pub(crate) address: u8,
    /// What was agreed on, or will be.
    pub(crate) mode: &'a Mode,
    /// Of each master: the frame count bit of his next request, once he has begun.
    pub(crate) fcb: [Option<bool>; 2],
    /// Of each master: who was asked what last, and what came.
    asked: [Option<Asked>; 2],
    replies: [Option<Vec<u8>>; 2],
    labels: Vec<(String, Vec<u8>)>,
    pub(crate) records: Vec<Record>,
    disputed: Vec<String>,
}

impl std::fmt::Debug for Runner<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Runner").field("address", &self.address).finish_non_exhaustive()
    }
}

impl<'a> Runner<'a> {
    /// A tester for `device` on `rig`.
    ///
    /// # Errors
    ///
    /// The device has no mode.
    pub fn new(device: &'a Device, rig: &'a mut dyn Rig, options: Options) -> Result<Self, NoMode> {
        let mode = device.modes.first().ok_or(NoMode)?;
        Ok(Self {
            device,
            rig,
            options,
            ident: device.ident.unwrap_or(0),
            address: device.address,
            mode,
            fcb: [None; 2],
            asked: [None, None],
            replies: [None, None],
            labels: Vec::new(),
            records: Vec::new(),
            disputed: Vec::new(),
        })
    }

    /// Plays one case. Whatever becomes of it, the next one begins afresh.
    ///
    /// # Errors
    ///
    /// The port or the device's control broke; the run cannot go on.
    pub fn run(&mut self, case: &Case) -> Result<CaseResult, RigError> {
        let began = Moment::now();
        self.records.clear();
        self.disputed.clear();
        let (outcome, reason) = match self.whole(case) {
            Ok(()) => (Outcome::Pass, self.seen()),
            Err(Stop::Fault(why)) => (Outcome::Fail, why),
            Err(Stop::Skip(why)) => (Outcome::Skip, why),
            Err(Stop::Rig(error)) => return Err(error),
        };
        Ok(CaseResult {
            id: case.id.clone(),
            title: case.title.clone(),
            area: case.area.clone(),
            rule: case.rule.clone(),
            outcome,
            reason,
            records: std::mem::take(&mut self.records),
            seconds: began.elapsed().as_secs_f64(),
        })
    }

    fn whole(&mut self, case: &Case) -> Played {
        needs::check(case, self.device, self.rig, self.options).map_err(Stop::Skip)?;
        self.begin(&case.before)?;
        self.play(&case.steps)?;
        if case.alive { self.alive() } else { Ok(()) }
    }

    fn seen(&self) -> String {
        if self.disputed.is_empty() {
            String::new()
        } else {
            format!("an accepted alternative was seen, see point {}", self.disputed.join(", "))
        }
    }

    /// A case begins from the beginning.
    fn begin(&mut self, before: &Before) -> Played {
        self.fcb = [None; 2];
        self.asked = [None, None];
        self.replies = [None, None];
        self.labels.clear();
        self.reach(before)
    }

    fn play(&mut self, steps: &[Step]) -> Played {
        for step in steps {
            self.step(step)?;
        }
        Ok(())
    }

    fn step(&mut self, step: &Step) -> Played {
        match step {
            Step::Exchange { line, due } => self.exchange(line, due),
            Step::Foreign(line) => {
                let (signals, _) = self.signals(line);
                self.rig.send(&signals)?;
                self.note("+", &line.text, &signals);
                Ok(())
            }
            Step::Wait(span) => self.wait(*span),
            Step::Act(action) => self.act(action),
            Step::To(before) => {
                self.note("", &format!("from the beginning: {before:?}"), &[]);
                self.begin(before)
            }
            Step::Rate(rate) => {
                self.rig.set_rate(*rate)?;
                self.note("", &format!("the master goes on at {rate}"), &[]);
                Ok(())
            }
            Step::Address(atoms) => {
                self.address = self.context(0).octets(atoms).first().copied().unwrap_or(self.address);
                Ok(())
            }
            Step::FirstFcb(master) => {
                self.fcb[master - 1] = None;
                Ok(())
            }
            Step::Repeat(times, body) => self.repeat(*times, body),
            Step::Random(count) => self.random(*count),
            Step::Note(text) => {
                self.note("", text, &[]);
                Ok(())
            }
        }
    }

    fn repeat(&mut self, times: u32, body: &[Step]) -> Played {
        for round in 0..times {
            let before = self.records.len();
            self.play(body)?;
            // One round is enough to read.
            if round > 0 {
                self.records.truncate(before);
            }
        }
        Ok(())
    }

    fn wait(&mut self, span: Span) -> Played {
        let time = match span {
            Span::Time(time) => time,
            Span::Bits(bits) => self.rig.rate().duration(BitTimes(bits)),
        };
        let stray = self.rig.wait(time)?;
        self.note("", &format!("{} ms pass", time.as_millis()), &[]);
        if stray.is_empty() {
            Ok(())
        } else {
            Err(Stop::Fault(format!("unasked, the slave sent {}", hex(&stray))))
        }
    }

    fn act(&mut self, action: &Action) -> Played {
        self.rig.act(action)?;
        self.note("", &format!("{action:?}"), &[]);
        if *action == Action::PowerOn {
            self.fcb = [None; 2];
        }
        Ok(())
    }

    pub(crate) fn note(&mut self, mark: &str, what: &str, signals: &[Signal]) {
        let what = format!("{mark} {what}").trim().to_owned();
        self.records.push(Record {
            what,
            sent: sent(signals),
            came: String::new(),
            due: String::new(),
            delay_ns: None,
            fault: None,
        });
    }

    pub(crate) fn context(&self, fc: u8) -> Context<'a> {
        Context {
            device: self.device,
            mode: self.mode,
            address: self.address,
            masters: self.options.masters,
            ident: self.ident,
            fc,
        }
    }

    /// The signals of a line; and which master asked last.
    fn signals(&mut self, line: &Line) -> (Vec<Signal>, usize) {
        let mut signals = Vec::new();
        let mut last = 1;
        for piece in &line.pieces {
            last = piece.master;
            let fc = self.fc(piece);
            let (octets, asked) = self.context(fc).signals(piece);
            signals.extend(octets);
            match piece.then {
                Joint::None => {}
                Joint::Read => signals.push(Signal::Read),
                Joint::Idle => signals.extend([Signal::Read, Signal::Pause(BitTimes(40))]),
            }
            if let Some(asked) = asked {
                self.asked[piece.master - 1] = Some(asked);
            }
        }
        (signals, last)
    }

    /// The function code of a piece; the frame count goes on where the slave will see it.
    fn fc(&mut self, piece: &Piece) -> u8 {
        let at = piece.master - 1;
        let (kind, sound) = match &piece.body {
            Body::Service(service) => (service.fc, piece.is_sound() && service.to.is_none()),
            Body::Raw(atoms) if atoms.contains(&Atom::NextFc) => (Fc::Next, !atoms.contains(&Atom::Sum(1))),
            Body::Raw(_) | Body::Token(_) => return 0,
        };
        let low = self.options.srd_low || matches!(kind, Fc::NextLow | Fc::RetryLow);
        let function = match kind {
            Fc::NextSda => 0x05,
            _ if low => 0x0C,
            _ => 0x0D,
        };
        let bit = match kind {
            Fc::Is(fc) => return self.explicit(fc, at, sound),
            Fc::Retry | Fc::RetryLow => self.fcb[at].map(|next| !next),
            Fc::Next | Fc::NextLow | Fc::NextSda => self.fcb[at],
        };
        let fc = match bit {
            None => 0x60 | function,
            Some(bit) => 0x50 | u8::from(bit) << 5 | function,
        };
        if sound && !matches!(kind, Fc::Retry | Fc::RetryLow) {
            self.fcb[at] = Some(!bit.unwrap_or(true));
        }
        fc
    }

    /// A function code that the case names: the frame count goes on from it.
    fn explicit(&mut self, fc: u8, at: usize, sound: bool) -> u8 {
        let is_srd = matches!(fc & 0x4F, 0x43 | 0x45 | 0x4C | 0x4D);
        if sound && is_srd {
            self.fcb[at] = match fc & 0x30 {
                0x00 => None,
                bits => Some(bits & 0x20 == 0),
            };
        }
        if self.options.srd_low && fc & 0x4F == 0x4D { fc & !0x01 } else { fc }
    }

    fn exchange(&mut self, line: &Line, due: &[Due]) -> Played {
        let (signals, master) = self.signals(line);
        self.rig.send(&signals)?;
        let stream = self.rig.abilities().stream;
        let strict = self.options.strict;
        let counts =
            |due: &&Due| due.stream.is_none_or(|only| only == stream) && !(strict && due.disputed.is_some());
        let due: Vec<&Due> = due.iter().filter(counts).collect();
        let heard = self.rig.listen(expectation(&due))?;
        self.judge(&line.text, &signals, &heard, &due, master)
    }

    fn judge(
        &mut self,
        text: &str,
        signals: &[Signal],
        heard: &Heard,
        due: &[&Due],
        master: usize,
    ) -> Played {
        let at = master - 1;
        let judge = Judge {
            context: self.context(0),
            asked: self.asked[at].as_ref(),
            before: self.replies[at].as_deref(),
            labels: &self.labels,
            rate: self.rig.rate(),
            exact_time: self.rig.abilities().exact_time,
        };
        let verdict = judge.judge(heard, due);
        let words: Vec<_> = due.iter().map(|due| due.text.as_str()).collect();
        self.records.push(Record {
            what: text.to_owned(),
            sent: sent(signals),
            came: hex(&heard.octets),
            due: words.join(" or "),
            delay_ns: heard.delay.map(Duration::as_nanos),
            fault: verdict.as_ref().err().cloned(),
        });
        let seen = verdict.map_err(Stop::Fault)?;
        if let Some(point) = &seen.disputed
            && !self.disputed.contains(point)
        {
            self.disputed.push(point.clone());
        }
        if let Some(label) = &seen.label {
            let data = match Reply::parse(&heard.octets) {
                Ok(Reply::Data { data, .. }) => data,
                _ => Vec::new(),
            };
            self.labels.push((label.clone(), data));
        }
        if !heard.octets.is_empty() {
            self.replies[at] = Some(heard.octets.clone());
        }
        Ok(())
    }
}

/// How long to listen for what is due.
fn expectation(due: &[&Due]) -> Expect {
    if due.iter().any(|due| matches!(due.kind, Kind::Late)) {
        Expect::Late
    } else if due.iter().all(|due| matches!(due.kind, Kind::Silence)) {
        Expect::Silence
    } else {
        Expect::Reply
    }
}

/// What was sent, for reading.
pub(crate) fn sent(signals: &[Signal]) -> String {
    let words: Vec<_> = signals
        .iter()
        .filter_map(|signal| match signal {
            Signal::Octet(octet) => Some(format!("{octet:02X}")),
            Signal::Damaged(_) => Some("--".to_owned()),
            Signal::Pause(_) => None,
            Signal::Read => Some("|".to_owned()),
        })
        .collect();
    words.join(" ").trim_end_matches(" |").to_owned()
}

/// A device without a mode cannot be tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no configuration of the slave is known; give its GSD with --gsd")]
pub struct NoMode;

impl Stop {
    /// A fault on the way to the beginning of a case.
    pub(crate) fn on_the_way(text: &str) -> Self {
        Self::Fault(format!("before the case could begin: {text}"))
    }
}
