//! Octets on the line of a virtual segment, and who hears them.
//!
//! A telegram is heard as a whole where every station listens at its rate until it has ended; else octet by octet.

use profibus_dp::Station;
use profibus_dp::time::Instant;
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::{SC, SD1, SD1_OCTETS, SD2, SD3, SD3_OCTETS, SD4};

use super::VirtualSegment;
use crate::faults::{Character, FaultCounters};
use crate::line::{characters, is_ours, starts_ours};
use crate::wire_tap::Sight;

impl<S: Station> VirtualSegment<S> {
    /// Octets of the master on the line from `start` on, `fresh` ones after idle time.
    #[inline]
    pub(super) fn put_request_on_line(&mut self, start: Instant, octets: &[u8], fresh: bool) {
        if !self.faults.leaves_request(octets) {
            self.put_failing_request_on_line(start, octets, fresh);
        } else if self.tap.is_none() {
            self.put_on_line(start, octets, None, self.faults.is_active());
        } else if !self.faults.is_active() {
            self.put_on_line(start, octets, None, false);
            self.tap_request(start, octets, FaultCounters::default());
        } else {
            let before = self.faults.counters();
            self.put_on_line(start, octets, None, true);
            // Only now it is known whether anybody was to hear them.
            self.tap_request(start, octets, self.faults.counters().since(&before));
        }
    }

    fn tap_request(&mut self, at: Instant, octets: &[u8], faults: FaultCounters) {
        if let Some(tap) = &mut self.tap {
            tap.saw(at, Sight::Request { octets, faults });
        }
    }

    #[cold]
    fn put_failing_request_on_line(&mut self, start: Instant, octets: &[u8], fresh: bool) {
        let begins = fresh && starts_ours(&self.stations, octets);
        let before = self.faults.counters();
        let characters = self.faults.request(octets, begins);
        let intact = |(character, octet): (&Character, &u8)| !character.error && character.octet == *octet;
        if characters.iter().zip(octets).all(intact) {
            self.put_on_line(start, octets, None, true);
        } else {
            self.put_characters_on_line(start, &characters, None, true);
        }
        if self.tap.is_some() {
            let arrived: Vec<u8> = characters.iter().map(|character| character.octet).collect();
            self.tap_request(start, &arrived, self.faults.counters().since(&before));
        }
    }

    /// Octets on the line from `start` on; everybody but `sender` hears them. `failing`: whole telegrams
    /// may still be lost or doubled.
    pub(super) fn put_on_line(
        &mut self,
        start: Instant,
        octets: &[u8],
        sender: Option<usize>,
        failing: bool,
    ) {
        if !self.unfinished && is_one_telegram(octets) && self.all_are_tuned() {
            let end = start + self.rate.duration(characters(octets.len()));
            if self.advance_in_tune(end) {
                self.one_telegram(octets, sender, failing);
            } else {
                self.octet_by_octet(start, octets, sender, failing);
            }
        } else {
            self.octet_by_octet(start, octets, sender, failing);
        }
        self.quiet_since = self.now();
    }

    #[inline]
    fn all_are_tuned(&mut self) -> bool {
        let Self { stations, rate, all_tuned, .. } = self;
        *all_tuned =
            *all_tuned || stations.as_slice().iter().all(|station| station.listening_rate() == *rate);
        *all_tuned
    }

    /// A telegram during which nothing else happens. Those that it is for hear it, the others later.
    fn one_telegram(&mut self, octets: &[u8], sender: Option<usize>, failing: bool) {
        let Self { stations, clock, receiver, repliers, overheard, faults, .. } = self;
        let now = clock.now();
        if let Some(sender) = sender {
            overheard.sends(sender, now);
        }
        let ended = receiver.receive(now, octets, |now, telegram| {
            repliers.clear();
            let times = if failing { faults.times_heard(is_ours(stations, telegram)) } else { 1 };
            let Telegram::Data(data) = telegram else {
                return;
            };
            for _ in 0..times {
                repliers.clear();
                stations.each_for(data.da, |stations, at| {
                    if Some(at) != sender {
                        overheard.hears(stations, at, now);
                        let window = stations.call(at, |station| station.indicate(now, telegram));
                        repliers.extend(window.map(|window| (window.not_before, at)));
                    }
                });
            }
            if times > 0 {
                overheard.note(now, octets);
            }
        });
        self.unfinished = !ended;
    }

    /// Octets of which each is heard as it ends; those that have ended already were heard by all.
    #[cold]
    fn octet_by_octet(&mut self, start: Instant, octets: &[u8], sender: Option<usize>, failing: bool) {
        self.listen_closely();
        for (at, octet) in octets.iter().enumerate() {
            // From the start each time, so that nothing is rounded twice.
            let end = start + self.rate.duration(characters(at + 1));
            if end < self.now() {
                self.unfinished = !self.receiver.receive(end, &[*octet], |_, _| {});
                continue;
            }
            self.advance_to(end);
            self.one_octet(*octet, sender, failing);
        }
        self.overheard.all_heard(self.clock.now());
    }

    /// The same for octets that have suffered.
    #[cold]
    pub(super) fn put_characters_on_line(
        &mut self,
        start: Instant,
        arriving: &[Character],
        sender: Option<usize>,
        failing: bool,
    ) {
        self.listen_closely();
        for (at, character) in arriving.iter().enumerate() {
            self.advance_to(start + self.rate.duration(characters(at + 1)));
            if !character.error {
                self.one_octet(character.octet, sender, failing);
                continue;
            }
            let now = self.now();
            self.receiver.line_error(now);
            self.unfinished = true;
            self.repliers.clear();
            for at in (0..self.stations.as_slice().len()).filter(|&at| Some(at) != sender) {
                self.stations.call(at, |station| station.line_error(now));
            }
        }
        self.overheard.all_heard(self.clock.now());
        self.quiet_since = self.now();
    }

    /// From here on every station hears every octet as it ends.
    fn listen_closely(&mut self) {
        self.overheard.tell_all(&mut self.stations);
        self.all_tuned = false;
        let Self { stations, tuned, rate, .. } = self;
        tuned.clear();
        tuned.extend(stations.as_slice().iter().map(|station| station.listening_rate() == *rate));
    }

    fn one_octet(&mut self, octet: u8, sender: Option<usize>, failing: bool) {
        let Self { stations, clock, receiver, tuned, repliers, rate, faults, .. } = self;
        let now = clock.now();
        for (at, tuned) in tuned.iter_mut().enumerate() {
            if *tuned && stations.as_slice()[at].listening_rate() == *rate {
                continue;
            }
            // Who changes to the right rate now has missed the beginning.
            *tuned = false;
            if Some(at) != sender {
                stations.call(at, |station| station.line_error(now));
            }
        }
        self.unfinished = !receiver.receive(now, &[octet], |now, telegram| {
            let times = if failing { faults.times_heard(is_ours(stations, telegram)) } else { 1 };
            repliers.clear();
            for _ in 0..times {
                repliers.clear();
                let hearing = tuned.iter().enumerate().filter(|&(at, tuned)| *tuned && Some(at) != sender);
                for (at, _) in hearing {
                    if let Some(window) = stations.call(at, |station| station.indicate(now, telegram)) {
                        repliers.push((window.not_before, at));
                    }
                }
            }
        });
    }
}

/// Whether octets are as many as their first ones announce.
fn is_one_telegram(octets: &[u8]) -> bool {
    match *octets {
        [SD2, le, ..] => octets.len() == usize::from(le) + 6,
        [SD1, ..] => octets.len() == SD1_OCTETS,
        [SD3, ..] => octets.len() == SD3_OCTETS,
        [SD4, ..] => octets.len() == 3,
        [SC] => true,
        _ => false,
    }
}
