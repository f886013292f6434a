//! What goes wrong on a line: by chance from a seed, or once by request.
//!
//! The layer lies between the line and the receivers, in real and in virtual time alike. While nothing
//! is to go wrong it costs a telegram one look at a pointer.
//!
//! Chance comes from four streams of numbers of their own: characters and telegrams, of requests and of
//! replies. So the same seed gives the same faults on the same traffic, however the octets were cut
//! into pieces on their way.

mod chance;

use std::collections::VecDeque;

use profibus_dp::time::{Baudrate, Duration};

use crate::cable::Cable;

use chance::{Chance, Flips, Share};

/// How many faults by request may wait for each direction.
pub const MOST_WAITING: usize = 1_000;

/// The longest that a reply can be held back.
pub const LATEST: Duration = Duration::from_secs(10);

/// What goes wrong by chance. Shares are probabilities from 0 to 1; the default is a quiet line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Where chance begins: the same seed on the same traffic gives the same faults.
    pub seed: u64,
    /// The share of bits that flip, each of the eleven of a character by itself.
    pub bit_errors: f64,
    /// The share of characters that come with a wrong parity.
    pub character_errors: f64,
    /// The share of requests that nobody hears.
    pub lost_requests: f64,
    /// The share of replies that the master does not hear.
    pub lost_replies: f64,
    /// The share of requests that are heard twice.
    pub doubled_requests: f64,
    /// The share of replies that come twice, the second time straight after the first.
    pub doubled_replies: f64,
    /// The share of replies that come later by `late_by`.
    pub late_replies: f64,
    /// How much later, at most [`LATEST`].
    pub late_by: Duration,
    /// The share of characters with which a burst of noise begins. Requests and replies have bursts of
    /// their own.
    pub bursts: f64,
    /// How many characters a burst lasts on average, at least 1.
    pub burst_length: f64,
    /// The share of bits that flip within a burst.
    pub burst_bit_errors: f64,
}

/// A share that is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoiseError {
    /// Not from 0 to 1.
    #[error("{name} is {value}, but a share is a number from 0 to 1, like 0.01 for one in a hundred")]
    Share {
        /// Which share.
        name: &'static str,
        /// What it was given.
        value: f64,
    },
    /// Later than [`LATEST`].
    #[error("a reply can be held back by 10 s at most")]
    TooLate,
    /// Bursts without a length.
    #[error("burst_length is {0}, but a burst lasts from 1 to 1000000 characters on average")]
    BurstLength(f64),
}

/// What happens to a reply on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyFault {
    /// The master hears nothing.
    Lose,
    /// One octet, counted from 0, has the bits of the mask flipped; its parity may fit all the same.
    Corrupt {
        /// Which octet; past the end: the last.
        octet: usize,
        /// Which bits.
        mask: u8,
    },
    /// It comes twice, the second time straight after the first.
    Double,
    /// It comes so much later. A master that has gone on by then does not get it.
    Late(Duration),
}

/// What happens to a request to a station of this line, or to all, on its way. Requests to others
/// and tokens leave what was asked for waiting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestFault {
    /// No station hears it.
    Lose,
    /// One octet, counted from 0, has the bits of the mask flipped; its parity fits all the same.
    Corrupt {
        /// Which octet; past the end: the last.
        octet: usize,
        /// Which bits.
        mask: u8,
    },
    /// One octet, counted from 0, comes with a wrong parity.
    CharacterError {
        /// Which octet; past the end: the last.
        octet: usize,
    },
    /// It is heard twice.
    Double,
}

/// What the layer has done so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounters {
    /// Requests that nobody heard.
    pub lost_requests: u64,
    /// Requests that came twice.
    pub doubled_requests: u64,
    /// Characters of requests that came wrong, whether their parity showed it or not.
    pub damaged_request_characters: u64,
    /// Replies that the master did not hear.
    pub lost_replies: u64,
    /// Replies that came twice.
    pub doubled_replies: u64,
    /// Replies that were held back.
    pub late_replies: u64,
    /// Characters of replies that came wrong, whether their parity showed it or not.
    pub damaged_reply_characters: u64,
}

/// An octet as it arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Character {
    /// What somebody makes of it who does not look at the parity.
    pub(crate) octet: u8,
    /// Parity, start or stop bit are wrong.
    pub(crate) error: bool,
}

/// A reply as it arrives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Arrival {
    /// None: the reply is lost.
    pub(crate) characters: Vec<Character>,
    pub(crate) late_by: Duration,
}

/// The fault layer of one line.
#[derive(Debug, Default)]
pub struct Faults {
    cable: Cable,
    /// By which the effect of the termination is counted.
    rate: Option<Baudrate>,
    active: Option<Box<Active>>,
    counters: FaultCounters,
}

/// What is there only while something can go wrong.
#[derive(Debug)]
struct Active {
    noise: Noise,
    /// The share of bits that flip because of the termination.
    reflected: f64,
    flips: Flips,
    bursts: Bursts,
    request_burst: Burst,
    reply_burst: Burst,
    characters: Share,
    lost_requests: Share,
    doubled_requests: Share,
    lost_replies: Share,
    doubled_replies: Share,
    late_replies: Share,
    request_characters: Chance,
    request_telegrams: Chance,
    reply_characters: Chance,
    reply_telegrams: Chance,
    next_requests: VecDeque<RequestFault>,
    next_replies: VecDeque<ReplyFault>,
}

impl Noise {
    /// Whether nothing goes wrong by chance.
    pub fn is_quiet(&self) -> bool {
        // Within bursts there is noise only where there are bursts.
        self.shares().iter().all(|(name, share)| *share <= 0.0 || *name == "burst_bit_errors")
    }

    /// Refuses shares that are none.
    ///
    /// # Errors
    ///
    /// The first that is not from 0 to 1, or a delay above [`LATEST`].
    pub fn check(&self) -> Result<(), NoiseError> {
        for (name, value) in self.shares() {
            if !(0.0..=1.0).contains(&value) {
                return Err(NoiseError::Share { name, value });
            }
        }
        if self.bursts > 0.0 && !(1.0..=1e6).contains(&self.burst_length) {
            return Err(NoiseError::BurstLength(self.burst_length));
        }
        if self.late_by > LATEST { Err(NoiseError::TooLate) } else { Ok(()) }
    }

    fn shares(&self) -> [(&'static str, f64); 9] {
        [
            ("bit_errors", self.bit_errors),
            ("character_errors", self.character_errors),
            ("lost_requests", self.lost_requests),
            ("lost_replies", self.lost_replies),
            ("doubled_requests", self.doubled_requests),
            ("doubled_replies", self.doubled_replies),
            ("late_replies", self.late_replies),
            ("bursts", self.bursts),
            ("burst_bit_errors", self.burst_bit_errors),
        ]
    }
}

impl Faults {
    /// From now on this goes wrong by chance; chance begins anew from the seed. Faults by request
    /// that wait go on waiting.
    ///
    /// # Errors
    ///
    /// See [`Noise::check`]; nothing has changed then.
    pub fn set_noise(&mut self, noise: Noise) -> Result<(), NoiseError> {
        noise.check()?;
        let fresh = Active::new(noise, self.reflected());
        match &mut self.active {
            Some(active) => {
                let Active { next_requests, next_replies, .. } = std::mem::replace(&mut **active, fresh);
                (active.next_requests, active.next_replies) = (next_requests, next_replies);
            }
            None => self.active = Some(Box::new(fresh)),
        }
        self.rest();
        Ok(())
    }

    /// What goes wrong by chance; `None` on a quiet line.
    pub fn noise(&self) -> Option<Noise> {
        self.active.as_ref().map(|active| active.noise).filter(|noise| !noise.is_quiet())
    }

    /// What happens to the next reply that has no fault in store yet; `false`, and nothing has
    /// changed, when [`MOST_WAITING`] wait already.
    pub fn fail_next_reply(&mut self, fault: ReplyFault) -> bool {
        let waiting = &mut self.activate().next_replies;
        let room = waiting.len() < MOST_WAITING;
        if room {
            waiting.push_back(fault);
        }
        room
    }

    /// What happens to the next request that has no fault in store yet; `false`, and nothing has
    /// changed, when [`MOST_WAITING`] wait already.
    pub fn fail_next_request(&mut self, fault: RequestFault) -> bool {
        let waiting = &mut self.activate().next_requests;
        let room = waiting.len() < MOST_WAITING;
        if room {
            waiting.push_back(fault);
        }
        room
    }

    /// How many faults by request wait: for requests, and for replies.
    pub fn waiting(&self) -> (usize, usize) {
        self.active.as_ref().map_or((0, 0), |active| (active.next_requests.len(), active.next_replies.len()))
    }

    /// A quiet line, with nothing in store.
    ///
    /// The cable stays as it is.
    pub fn clear(&mut self) {
        self.active = None;
        self.reflect();
    }

    /// The cable: a cut and the termination.
    pub fn cable(&self) -> Cable {
        self.cable
    }

    /// Another cable. Who is cut off is for the stations; here the termination has its effect.
    pub fn set_cable(&mut self, cable: Cable) {
        self.cable = cable;
        self.reflect();
    }

    /// The share of bits that flip because of the termination, at the rate in force.
    pub fn reflected(&self) -> f64 {
        self.rate.map_or(0.0, |rate| self.cable.bit_errors(rate))
    }

    /// The rate that is on the line.
    pub(crate) fn set_rate(&mut self, rate: Baudrate) {
        self.rate = Some(rate);
        self.reflect();
    }

    fn reflect(&mut self) {
        let reflected = self.reflected();
        let is = self.active.as_ref().map_or(0.0, |active| active.reflected);
        if (is - reflected).abs() > 0.0 {
            self.activate().set_reflected(reflected);
        }
        self.rest();
    }

    /// What was done so far.
    pub fn counters(&self) -> FaultCounters {
        self.counters
    }

    /// Whether anything can go wrong.
    #[inline]
    pub(crate) fn is_active(&self) -> bool {
        self.active.is_some()
    }

    /// Whether octets of a request arrive as they are; if not, [`request`](Self::request) has to tell what
    /// becomes of them. Most do, and this costs them little.
    #[inline]
    pub(crate) fn leaves_request(&mut self, octets: &[u8]) -> bool {
        self.active.as_mut().is_none_or(|active| {
            let Active { flips, bursts, characters, request_characters, next_requests, .. } = &mut **active;
            next_requests.is_empty()
                && !bursts.come()
                && request_characters.passes(octets.len(), flips, *characters)
        })
    }

    /// Whether a reply arrives as it is, as [`leaves_request`](Self::leaves_request) says it of requests.
    #[inline]
    pub(crate) fn leaves_reply(&mut self, octets: &[u8]) -> bool {
        self.active.as_mut().is_none_or(|active| {
            let mut telegrams = active.reply_telegrams.clone();
            let shares = [active.lost_replies, active.doubled_replies, active.late_replies];
            // Each of them draws, also after one that happens.
            let spared = shares.into_iter().filter(|&share| telegrams.takes(share)).count() == 0;
            let Active { flips, bursts, characters, reply_characters, next_replies, .. } = &mut **active;
            let passes = spared
                && next_replies.is_empty()
                && !bursts.come()
                && reply_characters.passes(octets.len(), flips, *characters);
            if passes {
                active.reply_telegrams = telegrams;
            }
            passes
        })
    }

    /// Octets of a request as they arrive. `begins`: a request to one of the stations begins with
    /// them, so that they may have a fault in store.
    pub(crate) fn request(&mut self, octets: &[u8], begins: bool) -> Vec<Character> {
        let Some(active) = &mut self.active else {
            return intact(octets);
        };
        let mut characters: Vec<_> = octets.iter().map(|&octet| active.request_character(octet)).collect();
        let fault = active.next_requests.front().copied().filter(|_| begins);
        if let Some(RequestFault::Corrupt { octet, .. } | RequestFault::CharacterError { octet }) = fault {
            active.next_requests.pop_front();
            let at = octet.min(characters.len().saturating_sub(1));
            if let Some(character) = characters.get_mut(at) {
                match fault {
                    Some(RequestFault::Corrupt { mask, .. }) => character.octet ^= mask,
                    _ => *character = wrong_parity(character.octet),
                }
            }
        }
        self.counters.damaged_request_characters += differences(octets, &characters);
        self.rest();
        characters
    }

    /// How often a request is heard that has arrived without fault. `ours`: it is to a station of
    /// this line.
    pub(crate) fn times_heard(&mut self, ours: bool) -> usize {
        let Some(active) = &mut self.active else {
            return 1;
        };
        let lost = active.request_telegrams.takes(active.lost_requests);
        let doubled = active.request_telegrams.takes(active.doubled_requests);
        let fault = active.next_requests.front().copied().filter(|_| ours);
        let times = match fault {
            Some(RequestFault::Lose) => 0,
            Some(RequestFault::Double) => 2,
            _ if lost => 0,
            _ => 1 + usize::from(doubled),
        };
        if matches!(fault, Some(RequestFault::Lose | RequestFault::Double)) {
            active.next_requests.pop_front();
        }
        self.counters.lost_requests += u64::from(times == 0);
        self.counters.doubled_requests += u64::from(times == 2);
        self.rest();
        times
    }

    /// A reply as it arrives.
    pub(crate) fn reply(&mut self, octets: &[u8]) -> Arrival {
        let Some(active) = &mut self.active else {
            return Arrival { characters: intact(octets), late_by: Duration::ZERO };
        };
        let chance = &mut active.reply_telegrams;
        let mut lost = chance.takes(active.lost_replies);
        let mut doubled = chance.takes(active.doubled_replies);
        let mut late = chance.takes(active.late_replies).then_some(active.noise.late_by);
        let mut sent = octets.to_vec();
        match active.next_replies.pop_front() {
            Some(ReplyFault::Lose) => lost = true,
            Some(ReplyFault::Double) => doubled = true,
            Some(ReplyFault::Late(span)) => late = Some(span),
            Some(ReplyFault::Corrupt { octet, mask }) => {
                let end = sent.len().saturating_sub(1);
                if let Some(octet) = sent.get_mut(octet.min(end)) {
                    *octet ^= mask;
                }
            }
            None => {}
        }
        if doubled {
            sent.extend_from_within(..);
        }
        let whole = if doubled { [octets, octets].concat() } else { octets.to_vec() };
        let mut characters: Vec<_> = sent.iter().map(|&octet| active.reply_character(octet)).collect();
        if lost {
            characters.clear();
        }
        self.counters.count_reply(lost, doubled, late.is_some(), differences(&whole, &characters));
        self.rest();
        Arrival { characters, late_by: late.unwrap_or(Duration::ZERO).min(LATEST) }
    }

    fn activate(&mut self) -> &mut Active {
        let reflected = self.reflected();
        self.active.get_or_insert_with(|| Box::new(Active::new(Noise::default(), reflected)))
    }

    /// Goes away when nothing can go wrong any more.
    fn rest(&mut self) {
        self.active.take_if(|active| {
            let is_quiet = active.noise.is_quiet() && active.reflected <= 0.0;
            is_quiet && active.next_requests.is_empty() && active.next_replies.is_empty()
        });
    }
}

impl FaultCounters {
    fn count_reply(&mut self, lost: bool, doubled: bool, late: bool, damaged: u64) {
        if lost {
            self.lost_replies += 1;
            return;
        }
        self.doubled_replies += u64::from(doubled);
        self.late_replies += u64::from(late);
        self.damaged_reply_characters += damaged;
    }
}

impl Active {
    fn new(noise: Noise, reflected: f64) -> Self {
        let [
            request_characters,
            request_telegrams,
            reply_characters,
            reply_telegrams,
            in_requests,
            in_replies,
        ] = [1, 2, 3, 4, 5, 6].map(|stream| Chance::new(noise.seed, stream));
        Self {
            noise,
            reflected,
            flips: flips(noise, reflected),
            bursts: Bursts::new(noise),
            request_burst: Burst { chance: in_requests, is_on: false },
            reply_burst: Burst { chance: in_replies, is_on: false },
            characters: Share::new(noise.character_errors),
            lost_requests: Share::new(noise.lost_requests),
            doubled_requests: Share::new(noise.doubled_requests),
            lost_replies: Share::new(noise.lost_replies),
            doubled_replies: Share::new(noise.doubled_replies),
            late_replies: Share::new(noise.late_replies),
            request_characters,
            request_telegrams,
            reply_characters,
            reply_telegrams,
            next_requests: VecDeque::new(),
            next_replies: VecDeque::new(),
        }
    }

    fn set_reflected(&mut self, reflected: f64) {
        self.reflected = reflected;
        self.flips = flips(self.noise, reflected);
    }

    fn request_character(&mut self, octet: u8) -> Character {
        let flips = self.request_burst.flips(&self.bursts).unwrap_or(&self.flips);
        character(&mut self.request_characters, flips, self.characters, octet)
    }

    fn reply_character(&mut self, octet: u8) -> Character {
        let flips = self.reply_burst.flips(&self.bursts).unwrap_or(&self.flips);
        character(&mut self.reply_characters, flips, self.characters, octet)
    }
}

/// A bit flips by noise or by reflection; by both it would be right again, but nearly never is.
fn flips(noise: Noise, reflected: f64) -> Flips {
    let either = 1.0 - (1.0 - noise.bit_errors) * (1.0 - reflected);
    Flips::new(if reflected > 0.0 { either } else { noise.bit_errors })
}

/// Noise in bursts: the model of Gilbert and Elliott, with two states of the line.
#[derive(Debug)]
struct Bursts {
    begin: Share,
    end: Share,
    flips: Flips,
}

/// Whether there is a burst in one direction.
#[derive(Debug)]
struct Burst {
    chance: Chance,
    is_on: bool,
}

impl Bursts {
    fn new(noise: Noise) -> Self {
        let end = if noise.burst_length >= 1.0 { 1.0 / noise.burst_length } else { 1.0 };
        Self {
            begin: Share::new(noise.bursts),
            end: Share::new(end),
            flips: Flips::new(noise.burst_bit_errors),
        }
    }

    /// Whether there are any: then each character has to be looked at.
    fn come(&self) -> bool {
        !self.begin.is_none()
    }
}

impl Burst {
    /// The bits that flip in the next character, if that is in a burst.
    fn flips<'a>(&mut self, bursts: &'a Bursts) -> Option<&'a Flips> {
        self.is_on = self.is_on || self.chance.takes(bursts.begin);
        if !self.is_on {
            return None;
        }
        self.is_on = !self.chance.takes(bursts.end);
        Some(&bursts.flips)
    }
}

/// A character of eleven bits, as chance lets it arrive.
fn character(chance: &mut Chance, flips: &Flips, errors: Share, octet: u8) -> Character {
    /// The bits of a character in the order of the line: start, eight of data, parity, stop.
    const START_AND_STOP: u16 = 1 << 10 | 1;
    let flipped = chance.flips(flips);
    if chance.takes(errors) {
        return wrong_parity(octet);
    }
    let mask = flipped.to_le_bytes();
    let mask = u8::from_le_bytes([mask[0]]) >> 1 | mask[1] << 7;
    // Even parity sees an odd number of flips among its nine bits.
    let odd = (flipped & !START_AND_STOP).count_ones() % 2 == 1;
    let error = odd || flipped & START_AND_STOP != 0;
    if error && mask == 0 { wrong_parity(octet) } else { Character { octet: octet ^ mask, error } }
}

/// A character whose data are right and whose parity is not. Somebody who does not look at the
/// parity, as behind a pseudo terminal, has to see it in the octet instead.
fn wrong_parity(octet: u8) -> Character {
    Character { octet: !octet, error: true }
}

fn intact(octets: &[u8]) -> Vec<Character> {
    octets.iter().map(|&octet| Character { octet, error: false }).collect()
}

fn differences(sent: &[u8], arrived: &[Character]) -> u64 {
    let differ = sent.iter().zip(arrived).filter(|(octet, arrived)| **octet != arrived.octet);
    differ.count() as u64
}

#[cfg(test)]
mod tests;
