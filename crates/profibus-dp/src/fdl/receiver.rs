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
    /// With how many the next look at them is due: [`START`] when nothing was collected yet,
    /// later where the head or the whole telegram is complete; [`DEAF`].
    look_at: u8,
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

/// The first look is at the start delimiter.
const START: u8 = 1;
/// The look at an SD2 with both lengths: four octets.
const SD2_HEAD: u8 = 4;
/// A token is whole with three octets, has no sum and no end delimiter.
const TOKEN: u8 = 3;
/// No look: what comes is no telegram until the line has been idle (idle mode).
const DEAF: u8 = 0;

/// What silence ends a telegram in stream mode, where a chunk may be late.
const STREAM_GAP: Duration = Duration::from_millis(10);

impl Receiver {
    /// A receiver that has heard nothing yet.
    pub fn new(mode: ReceiverMode, rate: Baudrate) -> Self {
        let mut receiver = Self {
            mode,
            length: 0,
            look_at: START,
            sum: 0,
            last: Instant::ZERO,
            gap: 0,
            rate,
            octets: [0; 256],
        };
        receiver.set_baudrate(rate);
        receiver
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
    pub fn forget(&mut self) {
        (self.length, self.look_at) = (0, START);
    }

    /// A character with a parity, framing or overrun error ended at `now`.
    pub fn line_error(&mut self, now: Instant) {
        self.forget();
        if self.mode == ReceiverMode::Idle {
            self.look_at = DEAF;
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
        if self.look_at != START {
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
        if !self.completes(now, octet, || ()) {
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

    /// Takes one octet; whether it completes a telegram without a fault. If it is the first after
    /// another telegram, a fault or silence, `begins` is called.
    ///
    /// What the telegram is, [`sd2_frame`](Self::sd2_frame) and
    /// [`other_frame`](Self::other_frame) tell before the next octet comes.
    #[inline(always)]
    pub(crate) fn completes(&mut self, now: Instant, octet: u8, begins: impl FnOnce()) -> bool {
        let silence = now.as_nanos().wrapping_sub(self.last.as_nanos());
        self.last = now;
        if silence >= u64::from(self.gap) {
            self.forget();
        }
        self.store(octet);
        if self.length == self.look_at { self.look(octet, begins) } else { self.add(octet) }
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

    /// An octet that is only collected: most are. The sum begins after the head.
    #[inline(always)]
    fn add(&mut self, octet: u8) -> bool {
        self.sum = self.sum.wrapping_add(octet);
        false
    }

    /// Looks at what was collected, the newest octet included; whether it is a whole telegram
    /// without a fault.
    #[inline(always)]
    fn look(&mut self, octet: u8, begins: impl FnOnce()) -> bool {
        match self.length {
            5.. => self.look_at_end(octet),
            START => {
                begins();
                self.look_at_start(octet)
            }
            SD2_HEAD => self.look_at_head(),
            TOKEN => {
                cold_path();
                self.forget();
                true
            }
            _ => {
                // So much was collected while deaf that the length is back at its beginning.
                cold_path();
                false
            }
        }
    }

    /// How long is what this start delimiter begins, as far as it says.
    #[inline(always)]
    fn look_at_start(&mut self, octet: u8) -> bool {
        self.sum = 0;
        self.look_at = match octet {
            SD2 => SD2_HEAD,
            SD1 => 6,
            SD4 => TOKEN,
            SD3 => 14,
            SC => {
                self.forget();
                return true;
            }
            _ => DEAF,
        };
        false
    }

    /// SD2, LE, LE again, SD2.
    #[inline(always)]
    fn look_at_head(&mut self) -> bool {
        let [_, le, ..] = self.octets;
        if self.octets.first_chunk() == Some(&[SD2, le, le, SD2]) && LE_RANGE.contains(&le) {
            (self.look_at, self.sum) = (le.wrapping_add(6), 0);
        } else {
            self.look_at = DEAF;
        }
        false
    }

    /// FCS and end delimiter.
    #[inline(always)]
    fn look_at_end(&mut self, octet: u8) -> bool {
        let fcs = self.octets.get(usize::from(self.length.wrapping_sub(2))).copied().unwrap_or(0);
        // The sum holds the FCS too.
        if octet != ED || self.sum.wrapping_sub(fcs) != fcs {
            cold_path();
            self.look_at = DEAF;
            return false;
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
            self.look_at = DEAF;
        }
    }
}
