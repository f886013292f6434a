//! Octets to telegrams, and back on the rails after faults.
//!
//! A telegram that is not perfect does not exist. Two modes say what happens after a fault:
//!
//! - [`ReceiverMode::Idle`], for lines whose idle times and character errors are seen:
//!   everything is dropped until 33 bit times of idle.
//! - [`ReceiverMode::Stream`], for PTYs and TCP, where octets come in chunks: the search for a
//!   telegram goes on with the next octet.
//!
//! Two paths lead through it: [`Receiver::octet`] takes one octet and carries the check sum along
//! (idle mode), [`Receiver::receive`] takes slices and reads a telegram that fills its slice where
//! it lies. Both give the same telegrams at the same times.

use core::hint::cold_path;

use crate::time::{Baudrate, BitTimes, Duration, Instant};
use crate::wire::FunctionCode;
use crate::wire::telegram::{self, ED, Frame, LE_RANGE, Parsed, SC, SD1, SD2, SD3, SD4, Telegram};

/// Reading "Receiver": how a receiver finds its way back after a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReceiverMode {
    /// Wait for 33 bit times of idle.
    Idle,
    /// Look again from the next octet; forget an unfinished telegram after 10 ms (or 33 bit
    /// times where that is longer).
    Stream,
}

/// Collects octets until a telegram is complete.
#[derive(Debug, Clone)]
pub struct Receiver {
    mode: ReceiverMode,
    /// Octets collected.
    length: u8,
    /// Stream mode: with how many the next look at them is due.
    look_at: u8,
    /// Idle mode: how many octets are missing until the next look at them.
    left: u8,
    /// Idle mode: what that look is for.
    stage: Stage,
    /// Idle mode: with how many octets the FCS has come.
    fcs_at: u8,
    /// Idle mode: for another station, so that its octets are summed but not kept.
    foreign: bool,
    /// Idle mode: the sum of all octets from DA on.
    sum: u8,
    /// End of the newest octet.
    last: Instant,
    /// From the end of one octet to the end of the next, in nanoseconds: as long as this, and
    /// the line was idle.
    gap: u32,
    rate: Baudrate,
    // One octet longer than any telegram, so that an octet index is always inside.
    octets: [u8; 256],
}

/// What a look at the octets collected is for (idle mode).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// The start delimiter.
    Start,
    /// SD2, LE, LE again, SD2.
    Head,
    /// DA.
    Destination,
    /// FCS.
    Sum,
    /// The end delimiter.
    End,
    /// SA of a token, its last octet: it has no sum and no end delimiter.
    Token,
    /// Nothing: it is no telegram.
    Deaf,
}

/// What an octet has completed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Collected {
    /// No telegram, or none without a fault.
    Nothing,
    /// One that may be for us, and was kept.
    Telegram,
    /// One for another station, of which nothing was kept.
    Foreign,
}

/// What remains to be done with an octet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gathered {
    /// Nothing.
    Nothing,
    /// A look at what was collected.
    Look,
    /// It has completed a telegram for another station.
    Foreign,
}

/// Who is told of a telegram while it comes in, octet by octet.
pub(crate) trait Listener {
    /// The first octet after another telegram, a fault or silence has come.
    fn begins(&mut self);

    /// Whether nobody here wants a telegram with this DA: it is checked, but not kept.
    fn is_foreign(&self, da: u8) -> bool;

    /// Of a telegram that is kept all but the end delimiter has come, and its sum is good. Of an
    /// SD2 these are LE, and DA, SA and FC.
    fn ahead(&mut self, start: u8, le: u8, head: [u8; 3]);
}

/// Wants every telegram.
struct Everything;

impl Listener for Everything {
    fn begins(&mut self) {}

    fn is_foreign(&self, _: u8) -> bool {
        false
    }

    fn ahead(&mut self, _: u8, _: u8, _: [u8; 3]) {}
}

/// The first look is at the start delimiter.
const START: u8 = 1;
/// DA is octet 5 of an SD2.
const DA_OF_SD2: u8 = 5;
/// PDU octets that hold all the SAPs that there may be.
const BOTH_SAPS: u8 = 2;

/// What silence ends a telegram in stream mode, where a chunk may be late.
const STREAM_GAP: Duration = Duration::from_millis(10);

impl Receiver {
    /// A receiver that has heard nothing yet.
    pub fn new(mode: ReceiverMode, rate: Baudrate) -> Self {
        let mut receiver = Self::blank();
        receiver.restart(mode, rate);
        receiver
    }

    /// What [`restart`](Self::restart) makes a receiver of, where it lies.
    pub(crate) const fn blank() -> Self {
        Self {
            mode: ReceiverMode::Idle,
            length: 0,
            look_at: START,
            left: START,
            stage: Stage::Start,
            fcs_at: 0,
            foreign: false,
            sum: 0,
            last: Instant::ZERO,
            gap: 0,
            rate: Baudrate::B9600,
            octets: [0; 256],
        }
    }

    /// As new.
    pub(crate) fn restart(&mut self, mode: ReceiverMode, rate: Baudrate) {
        (self.mode, self.last) = (mode, Instant::ZERO);
        self.set_baudrate(rate);
    }

    /// Listens at another rate; an unfinished telegram is forgotten.
    pub fn set_baudrate(&mut self, rate: Baudrate) {
        // 33 bit times and the octet itself, less half a bit: edges are not known better.
        let idle = Duration::from_nanos(rate.duration(BitTimes(2 * 44 - 1)).as_nanos() / 2);
        let gap = match self.mode {
            ReceiverMode::Idle => idle,
            ReceiverMode::Stream => idle.max(STREAM_GAP),
        };
        self.gap = u32::try_from(gap.as_nanos()).unwrap_or(u32::MAX);
        self.rate = rate;
        self.forget();
    }

    /// The mode it was made with.
    pub const fn mode(&self) -> ReceiverMode {
        self.mode
    }

    /// Forgets an unfinished telegram: the far side has gone.
    #[inline]
    pub fn forget(&mut self) {
        (self.length, self.look_at) = (0, START);
        (self.left, self.stage, self.foreign) = (START, Stage::Start, false);
    }

    /// From now on nothing is a telegram until the line was idle.
    #[inline]
    fn go_deaf(&mut self) -> bool {
        cold_path();
        (self.stage, self.foreign) = (Stage::Deaf, false);
        false
    }

    /// How long the line is silent after the end of one octet, up to the end of the next, when
    /// it counts as idle.
    pub const fn idle_gap(&self) -> Duration {
        Duration::from_nanos(self.gap as u64)
    }

    /// A character with a parity, framing or overrun error ended at `now`.
    pub fn line_error(&mut self, now: Instant) {
        self.forget();
        if self.mode == ReceiverMode::Idle {
            self.go_deaf();
        }
        self.last = now;
    }

    /// Takes octets, `now` being the end of the last one, and hands every whole telegram among
    /// them to `hear`, with the time of its end.
    ///
    /// Returns whether the last octet ended a telegram: if not, the sender of any request before
    /// has gone on, and must not be answered.
    #[inline]
    pub fn receive(
        &mut self,
        now: Instant,
        octets: &[u8],
        mut hear: impl FnMut(Instant, &Telegram<'_>),
    ) -> bool {
        if let Some(Ok(telegram)) = self.whole(now, octets).map(|frame| frame.telegram()) {
            hear(now, &Telegram::Data(telegram));
            return true;
        }
        self.pieces(now, octets, hear)
    }

    /// The telegram that fills the whole slice, if nothing was begun before: the usual case,
    /// read where it lies. `now` is the end of its last octet.
    ///
    /// `None`: [`pieces`](Self::pieces) has to look at the octets.
    #[inline(always)]
    pub(crate) fn whole<'a>(&mut self, now: Instant, octets: &'a [u8]) -> Option<Frame<'a>> {
        if self.length != 0 || self.stage != Stage::Start {
            return None;
        }
        let frame = telegram::parse_usual(octets)?;
        self.last = now;
        Some(frame)
    }

    /// [`receive`](Self::receive) for octets that are not one whole telegram.
    #[cold]
    #[inline(never)]
    pub(crate) fn pieces(
        &mut self,
        now: Instant,
        octets: &[u8],
        hear: impl FnMut(Instant, &Telegram<'_>),
    ) -> bool {
        match self.mode {
            ReceiverMode::Idle => self.receive_idle(now, octets, hear),
            ReceiverMode::Stream => self.receive_stream(now, octets, hear),
        }
    }

    /// Takes one octet that ended at `now` (idle mode).
    ///
    /// Returns the telegram that it completes.
    pub fn octet(&mut self, now: Instant, octet: u8) -> Option<Telegram<'_>> {
        if self.completes(now, octet, &mut Everything) == Collected::Nothing {
            return None;
        }
        match self.octets {
            [SD4, da, sa, ..] => return Some(Telegram::Token { da: da & 0x7F, sa: sa & 0x7F }),
            [SC, ..] => return Some(Telegram::ShortAcknowledgement),
            _ => {}
        }
        if self.frame().is_none() {
            self.spoil();
            return None;
        }
        self.frame()?.telegram().ok().map(Telegram::Data)
    }

    /// The SD1, SD2 or SD3 just collected.
    fn frame(&self) -> Option<Frame<'_>> {
        self.sd2_frame().or_else(|| self.other_frame())
    }

    /// Takes one octet; whether it completes a telegram without a fault.
    ///
    /// What the telegram is, [`sd2_frame`](Self::sd2_frame) and
    /// [`other_frame`](Self::other_frame) tell before the next octet comes.
    #[inline(always)]
    pub(crate) fn completes(&mut self, now: Instant, octet: u8, listener: &mut impl Listener) -> Collected {
        let silence = now.as_nanos().wrapping_sub(self.last.as_nanos());
        self.last = now;
        if silence >= u64::from(self.gap) {
            self.forget();
        }
        match self.gather(octet) {
            Gathered::Nothing => Collected::Nothing,
            Gathered::Foreign => Collected::Foreign,
            Gathered::Look => self.look(octet, listener),
        }
    }

    /// The first part of [`completes`](Self::completes), all that most octets need; for an octet
    /// that comes after idle time, [`forget`](Self::forget) comes first.
    #[inline(always)]
    pub(crate) fn gather(&mut self, octet: u8) -> Gathered {
        self.left = self.left.wrapping_sub(1);
        let due = self.left == 0;
        if self.foreign {
            if due {
                return self.check(octet);
            }
        } else {
            self.store(octet);
            if due {
                return Gathered::Look;
            }
        }
        // The sum begins after the head.
        self.sum = self.sum.wrapping_add(octet);
        Gathered::Nothing
    }

    /// The second part: looks at what was collected, the newest octet included.
    #[inline(always)]
    pub(crate) fn look(&mut self, octet: u8, listener: &mut impl Listener) -> Collected {
        let completes = match self.stage {
            Stage::Start => {
                listener.begins();
                self.look_at_start(octet)
            }
            Stage::Head => self.look_at_head(),
            Stage::Destination => self.look_at_destination(octet, listener),
            Stage::Sum => self.look_at_sum(octet, listener),
            Stage::End => self.look_at_end(octet),
            Stage::Token => {
                cold_path();
                self.forget();
                true
            }
            Stage::Deaf => {
                // So much was collected while deaf that the length is back at its beginning.
                cold_path();
                false
            }
        };
        if completes { Collected::Telegram } else { Collected::Nothing }
    }

    /// FCS or end delimiter of a telegram for another station.
    #[inline(always)]
    fn check(&mut self, octet: u8) -> Gathered {
        if self.stage == Stage::Sum && self.sum == octet {
            (self.stage, self.left) = (Stage::End, 1);
            return Gathered::Nothing;
        }
        if self.stage == Stage::End && octet == ED {
            self.forget();
            return Gathered::Foreign;
        }
        self.go_deaf();
        Gathered::Nothing
    }

    fn receive_idle(
        &mut self,
        now: Instant,
        octets: &[u8],
        mut hear: impl FnMut(Instant, &Telegram<'_>),
    ) -> bool {
        let mut ended = false;
        // The octets of one slice follow each other without a gap.
        let mut left = u32::try_from(octets.len()).unwrap_or(u32::MAX);
        for &octet in octets {
            left = left.wrapping_sub(1);
            let after = self.rate.duration(BitTimes(left.wrapping_mul(BitTimes::CHARACTER.0)));
            let end = now - after;
            let telegram = self.octet(end, octet);
            ended = telegram.is_some();
            if let Some(telegram) = telegram {
                hear(end, &telegram);
            }
        }
        ended
    }

    fn receive_stream(
        &mut self,
        now: Instant,
        octets: &[u8],
        mut hear: impl FnMut(Instant, &Telegram<'_>),
    ) -> bool {
        if now.since(self.last).as_nanos() >= u64::from(self.gap) {
            self.forget();
        }
        self.last = now;
        let mut ended = false;
        for &octet in octets {
            ended = false;
            self.store(octet);
            while self.length != 0 && self.length >= self.look_at {
                match telegram::parse(self.octets.get(..usize::from(self.length)).unwrap_or(&[])) {
                    Parsed::Complete(telegram, used) => {
                        hear(now, &telegram);
                        self.drop_front(used);
                        ended = self.length == 0;
                    }
                    Parsed::Incomplete { missing } => {
                        self.look_at = self.length.saturating_add(u8::try_from(missing).unwrap_or(u8::MAX));
                    }
                    Parsed::Invalid(_) => self.drop_front(1),
                }
            }
        }
        ended
    }

    fn drop_front(&mut self, count: usize) {
        let kept = usize::from(self.length).saturating_sub(count);
        let end = usize::from(self.length);
        if count <= end {
            self.octets.copy_within(count..end, 0);
        }
        self.length = u8::try_from(kept).unwrap_or(0);
        self.look_at = START;
    }

    #[inline]
    fn store(&mut self, octet: u8) {
        // An octet index is inside the 256 octets; the branch is gone when compiled.
        if let Some(place) = self.octets.get_mut(usize::from(self.length)) {
            *place = octet;
        }
        self.length = self.length.wrapping_add(1);
    }

    /// How long is what this start delimiter begins, as far as it says.
    #[inline(always)]
    fn look_at_start(&mut self, octet: u8) -> bool {
        self.sum = 0;
        (self.stage, self.left) = match octet {
            SD2 => (Stage::Head, 3),
            SD1 => {
                self.fcs_at = 5;
                (Stage::Destination, 1)
            }
            SD4 => (Stage::Token, 2),
            SD3 => {
                self.fcs_at = 13;
                (Stage::Destination, 1)
            }
            SC => {
                self.forget();
                return true;
            }
            _ => return self.go_deaf(),
        };
        false
    }

    /// SD2, LE, LE again, SD2.
    #[inline(always)]
    fn look_at_head(&mut self) -> bool {
        let [_, le, ..] = self.octets;
        if self.octets.first_chunk() != Some(&[SD2, le, le, SD2])
            || le.wrapping_sub(*LE_RANGE.start()) > LE_RANGE.end().wrapping_sub(*LE_RANGE.start())
        {
            return self.go_deaf();
        }
        self.fcs_at = le.wrapping_add(DA_OF_SD2);
        (self.stage, self.left) = (Stage::Destination, 1);
        false
    }

    /// DA: whose telegram it is. One that is so short that it could lack a SAP which it announces
    /// is kept, to be looked at.
    #[inline(always)]
    fn look_at_destination(&mut self, da: u8, listener: &impl Listener) -> bool {
        self.left = self.fcs_at.wrapping_sub(self.length);
        self.stage = Stage::Sum;
        self.sum = da;
        // SA, FC, the SAPs, FCS.
        self.foreign = self.left >= BOTH_SAPS + 3 && listener.is_foreign(da);
        false
    }

    /// FCS.
    #[inline(always)]
    fn look_at_sum(&mut self, fcs: u8, listener: &mut impl Listener) -> bool {
        if self.sum != fcs {
            return self.go_deaf();
        }
        (self.stage, self.left) = (Stage::End, 1);
        let [start, le, _, _, da, sa, fc, ..] = self.octets;
        listener.ahead(start, le, [da, sa, fc]);
        false
    }

    /// The end delimiter.
    #[inline(always)]
    fn look_at_end(&mut self, octet: u8) -> bool {
        if octet != ED {
            return self.go_deaf();
        }
        self.forget();
        true
    }

    /// The SD2 just collected, the usual telegram; its sum is known to be good. `None`: it is
    /// another one, see [`other_frame`](Self::other_frame).
    #[inline(always)]
    pub(crate) fn sd2_frame(&self) -> Option<Frame<'_>> {
        let [SD2, le, _, _, da, sa, fc, ..] = self.octets else {
            return None;
        };
        // LE is 249 at most.
        let pdu = self.octets.get(7..usize::from(le.wrapping_add(4)))?;
        let frame = Frame { da, sa, fc: FunctionCode(fc), pdu };
        frame.has_its_saps().then_some(frame)
    }

    /// The SD1 or SD3 just collected; its sum is known to be good. `None`: it is no such telegram,
    /// or [`spoil`](Self::spoil) is due, since it lacks a SAP that it announces.
    #[inline(always)]
    pub(crate) fn other_frame(&self) -> Option<Frame<'_>> {
        let &[start, da, sa, fc, ref pdu @ ..] = &self.octets;
        let pdu = match start {
            SD1 => &[],
            SD3 => pdu.get(..8)?,
            _ => return None,
        };
        let frame = Frame { da, sa, fc: FunctionCode(fc), pdu };
        frame.has_its_saps().then_some(frame)
    }

    /// What was just collected turned out to be no telegram (idle mode).
    #[cold]
    pub(crate) fn spoil(&mut self) {
        if !matches!(self.octets, [SD4 | SC, ..]) {
            self.go_deaf();
        }
    }
}
