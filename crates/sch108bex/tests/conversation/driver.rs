//! Plays a conversation: virtual time, one master, one encoder, one shaft.

use std::fmt::Write;

use profibus_dp::fdl::Window;
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};

use super::bench::Bench;
use super::script::{Action, Conversation, Piece, Question, Span, Step};

/// Power-on of the first run, so that nothing may rest on time beginning at 0.
const BEGIN: Instant = Instant::from_millis(12_345);
/// The world is measured at least so often, as firmware does in its main loop.
const MEASURED_EVERY: Duration = Duration::from_millis(10);
/// After a step of the shaft: long enough for a latch (every 500 us) to see it.
const SETTLING: Duration = Duration::from_millis(1);

/// A line that went otherwise.
#[derive(Debug)]
pub(crate) struct Mismatch {
    pub(crate) line: usize,
    pub(crate) message: String,
}

/// Plays the whole conversation, up to the first line that goes otherwise.
pub(crate) fn play(conversation: &Conversation) -> Result<(), Mismatch> {
    let setup = &conversation.setup;
    let bench = Bench::new(setup).map_err(|message| Mismatch { line: 1, message })?;
    let mut driver = Driver {
        bench,
        now: BEGIN,
        power_on: BEGIN,
        rate: setup.master_baud,
        shaft: Shaft { start: setup.shaft, since: BEGIN, counts: 0, per: SETTLING },
        memory: setup.memory,
        written: None,
        measured: BEGIN,
        end_of_request: BEGIN,
        last: String::new(),
    };
    driver.bench.power_on(BEGIN);
    driver.keep();
    driver.steps(&conversation.steps)
}

pub(super) struct Driver {
    pub(super) bench: Bench,
    /// How far everything has been played.
    pub(super) now: Instant,
    power_on: Instant,
    pub(super) rate: Baudrate,
    shaft: Shaft,
    memory: Duration,
    /// When the record being written is in the memory.
    written: Option<Instant>,
    measured: Instant,
    /// The end of the last octet that was sent.
    pub(super) end_of_request: Instant,
    /// What was sent last, for messages.
    last: String,
}

/// Where the shaft is: at `start`, moving since then.
struct Shaft {
    start: i64,
    since: Instant,
    counts: i64,
    per: Duration,
}

impl Shaft {
    fn at(&self, now: Instant) -> i64 {
        let nanos = i128::from(now.since(self.since).as_nanos());
        let moved = (i128::from(self.counts) * nanos).div_euclid(i128::from(self.per.as_nanos()));
        self.start + i64::try_from(moved).expect("a shaft stays within 63 bits")
    }
}

pub(super) type Played = Result<(), String>;

impl Driver {
    fn steps(&mut self, steps: &[Step]) -> Result<(), Mismatch> {
        for step in steps {
            match &step.action {
                Action::Repeat { times, body } => {
                    for round in 1..=*times {
                        self.steps(body).map_err(|mut mismatch| {
                            let round = format!("in round {round} of {times}: ");
                            mismatch.message.insert_str(0, &round);
                            mismatch
                        })?;
                    }
                }
                Action::Exchange { request, due_line, due } => {
                    self.bench.forget_reports();
                    let window = self.send(request, BitTimes::SYN);
                    self.judge(due, window).map_err(|message| self.mismatch(*due_line, &message))?;
                }
                action => self.act(action).map_err(|message| self.mismatch(step.line, &message))?,
            }
        }
        Ok(())
    }

    fn mismatch(&self, line: usize, message: &str) -> Mismatch {
        let nanos = self.now.since(self.power_on).as_nanos();
        let (millis, micros) = (nanos / 1_000_000, nanos / 1_000 % 1_000);
        let mut message = format!("{message}\n  {millis}.{micros:03} ms after power-on");
        if !self.last.is_empty() {
            message.push_str("\n  sent     ");
            message.push_str(&self.last);
        }
        for report in self.bench.reports() {
            message.push_str("\n  reported ");
            message.push_str(&report);
        }
        Mismatch { line, message }
    }

    fn act(&mut self, action: &Action) -> Played {
        match *action {
            Action::Foreign(ref pieces) => {
                if self.send(pieces, BitTimes::CHARACTER).is_some() {
                    return Err("the station wants to answer what is not for it".into());
                }
            }
            Action::Wait(Span::Time(time)) => self.advance(self.now + time),
            Action::Wait(Span::Bits(bits)) => self.advance(self.now + self.bits(bits)),
            Action::At(time) => {
                let then = self.power_on + time;
                if then < self.now {
                    return Err("that moment has passed already".into());
                }
                self.advance(then);
            }
            Action::Shaft(start) => {
                self.move_shaft(start, 0, SETTLING);
                self.advance(self.now + SETTLING);
            }
            Action::ShaftMoves(counts, per) => {
                self.move_shaft(self.shaft.at(self.now), counts, per);
            }
            Action::ShaftStops => self.move_shaft(self.shaft.at(self.now), 0, SETTLING),
            Action::PositionError => self.bench.position_error(self.now),
            Action::Temperature(tenths) => self.bench.temperature(tenths)?,
            Action::Light { ok } => self.bench.light(ok),
            Action::Battery(battery) => self.bench.battery(battery),
            Action::Supply(tenths) => self.supply(tenths)?,
            Action::PowerOff => self.power_off(),
            Action::PowerOn => self.power_on()?,
            Action::Switches(switches) => self.bench.switches(switches),
            Action::LineError => {
                if let Some(station) = self.bench.station() {
                    station.line_error(self.now);
                }
            }
            Action::Baud(rate) => self.rate = rate,
            Action::Ask(question) => self.ask(question)?,
            Action::Reported(ref words) => self.reported(words)?,
            Action::NothingReported => {
                if let Some(report) = self.bench.reports().first() {
                    return Err(format!("nothing should have been reported, but: {report}"));
                }
            }
            Action::Exchange { .. } | Action::Repeat { .. } => unreachable!("played by steps"),
        }
        // A change of the world is measured, and what it makes necessary is kept, at once.
        if matches!(action, Action::Temperature(_) | Action::Light { .. } | Action::Battery(_)) {
            self.measure();
        }
        self.keep();
        Ok(())
    }

    fn move_shaft(&mut self, start: i64, counts: i64, per: Duration) {
        self.shaft = Shaft { start, since: self.now, counts, per };
    }

    fn supply(&mut self, tenths: i64) -> Played {
        let enough = self.bench.supply(tenths)?;
        self.measure();
        self.keep();
        match (enough, self.bench.is_powered()) {
            (false, true) => self.power_off(),
            (true, false) => self.power_on()?,
            _ => {}
        }
        Ok(())
    }

    fn power_off(&mut self) {
        self.bench.power_off();
        self.written = None;
    }

    fn power_on(&mut self) -> Played {
        if self.bench.is_powered() {
            return Err("the power is on".into());
        }
        self.bench.forget_reports();
        self.power_on = self.now;
        self.measured = self.now;
        self.bench.power_on(self.now);
        Ok(())
    }

    fn ask(&mut self, question: Question) -> Played {
        let powered = self.bench.is_powered();
        let station = self.bench.station();
        let (due, got) = match question {
            Question::Powered(due) => (format!("{due}"), format!("{powered}")),
            Question::Address(due) => {
                let got = station.and_then(|station| station.address());
                (format!("{due:?}"), format!("{got:?}"))
            }
            Question::Rate(due) => {
                let got = station.map(|station| station.listening_rate());
                (format!("{:?}", Some(due)), format!("{got:?}"))
            }
        };
        if due == got { Ok(()) } else { Err(format!("should be {due}, but is {got}")) }
    }

    /// Whether one sentence has all these words.
    fn reported(&self, words: &[String]) -> Played {
        let has_all = |report: &String| {
            let report = report.to_lowercase();
            let mut found =
                report.split_whitespace().map(|word| word.trim_matches(|c: char| ",.:;()".contains(c)));
            words
                .iter()
                .all(|word| found.clone().any(|had| had == word || had.strip_suffix('h') == Some(word)))
                && found.next().is_some()
        };
        if self.bench.reports().iter().any(has_all) {
            Ok(())
        } else {
            Err(format!("no report has the words: {}", words.join(" ")))
        }
    }

    /// So many bit times at the master's rate.
    pub(super) fn bits(&self, bits: u32) -> Duration {
        self.rate.duration(BitTimes(bits))
    }

    /// Sends after `idle` of silence; what the station wants to answer to the last read.
    fn send(&mut self, pieces: &[Piece], idle: BitTimes) -> Option<Window> {
        let begin = self.now + self.rate.duration(idle);
        let mut sent_bits = 0;
        let mut read = Vec::new();
        let mut window = None;
        self.last = String::new();
        for piece in pieces {
            match *piece {
                Piece::Octet(octet) => {
                    sent_bits += BitTimes::CHARACTER.0;
                    read.push(octet);
                    let _ = write!(self.last, "{octet:02X} ");
                }
                Piece::Damaged => {
                    self.deliver(&mut window, begin + self.bits(sent_bits), &mut read);
                    sent_bits += BitTimes::CHARACTER.0;
                    self.advance(begin + self.bits(sent_bits));
                    self.damage();
                    window = None;
                    self.last.push_str("-- ");
                }
                Piece::Read => {
                    self.deliver(&mut window, begin + self.bits(sent_bits), &mut read);
                }
                Piece::Idle(bits) => {
                    self.deliver(&mut window, begin + self.bits(sent_bits), &mut read);
                    sent_bits += bits;
                }
            }
        }
        self.deliver(&mut window, begin + self.bits(sent_bits), &mut read);
        self.end_of_request = self.now;
        self.keep();
        window
    }

    /// Gives the station what it reads at `end`: garbled where it listens at another rate.
    fn deliver(&mut self, window: &mut Option<Window>, end: Instant, read: &mut Vec<u8>) {
        self.advance(end);
        if read.is_empty() {
            return;
        }
        let hears = self.rate;
        let listens = self.bench.station().map(|station| station.listening_rate());
        *window = if listens == Some(hears) {
            self.bench.receive(end, read)
        } else {
            for _ in read.iter() {
                self.damage();
            }
            None
        };
        read.clear();
    }

    fn damage(&mut self) {
        if let Some(station) = self.bench.station() {
            station.line_error(self.now);
        }
    }

    /// Lets time pass up to `then`: latches, deadlines, the memory, a look at the world.
    pub(super) fn advance(&mut self, then: Instant) {
        loop {
            let deadline = self
                .bench
                .station()
                .and_then(|station| station.next_deadline())
                // "Not later than": a deadline that stays is looked at again, but not for ever.
                .map(|deadline| deadline.max(self.now + Duration::from_micros(50)));
            let next = [deadline, self.written, Some(self.measured + MEASURED_EVERY)]
                .into_iter()
                .flatten()
                .min()
                .filter(|&next| next < then);
            let Some(next) = next else {
                break;
            };
            self.now = next.max(self.now);
            self.tick();
        }
        self.now = then.max(self.now);
        self.latch();
    }

    fn tick(&mut self) {
        self.latch();
        if self.written.is_some_and(|written| written <= self.now) {
            self.written = None;
            self.bench.confirm_nonvolatile();
        }
        if self.measured + MEASURED_EVERY <= self.now {
            self.measure();
        }
        let now = self.now;
        if let Some(station) = self.bench.station() {
            station.poll(now);
        }
        self.keep();
    }

    fn latch(&mut self) {
        let shaft = &self.shaft;
        self.bench.latch(self.now, |at| shaft.at(at));
    }

    fn measure(&mut self) {
        self.measured = self.now;
        self.bench.measure(self.now);
    }

    pub(super) fn keep(&mut self) {
        if self.bench.take_nonvolatile(self.now) {
            if self.memory == Duration::ZERO {
                self.bench.confirm_nonvolatile();
            } else {
                self.written = Some(self.now + self.memory);
            }
        }
    }
}
