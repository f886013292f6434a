//! What stations of a virtual segment hear of telegrams for others.
//!
//! Such a telegram tells a station only that the bus is alive at its rate, and only the newest matters.
//! So it is kept, and told before anything that depends on it: a deadline of the station, a fault on the
//! line, a change from outside.

use profibus_dp::Station;
use profibus_dp::time::Instant;
use profibus_dp::wire::telegram::{self, MAX_OCTETS, Parsed, Telegram};

use crate::stations::Stations;

/// The newest telegram that all stations could hear, and who has heard it or a newer one.
#[derive(Debug)]
pub(crate) struct Overheard {
    octets: [u8; MAX_OCTETS],
    length: usize,
    /// Its end.
    at: Instant,
    /// For each station the end of the newest telegram that it heard, or sent.
    heard: Vec<Instant>,
    /// For each station whether it may be searching for the rate: then it depends on what it has heard before
    /// whether it answers.
    unsure: Vec<bool>,
}

impl Overheard {
    pub(crate) fn new() -> Self {
        Self { octets: [0; MAX_OCTETS], length: 0, at: Instant::ZERO, heard: Vec::new(), unsure: Vec::new() }
    }

    /// One more station, that hears nothing of what was before.
    pub(crate) fn add(&mut self, now: Instant) {
        self.heard.push(now);
        self.unsure.push(true);
    }

    /// A station sends the telegram that ends at `now`.
    #[inline]
    pub(crate) fn sends(&mut self, station: usize, now: Instant) {
        self.heard[station] = now;
    }

    /// A station is about to hear the telegram that ends at `now`.
    #[inline]
    pub(crate) fn hears<S: Station>(&mut self, stations: &mut Stations<S>, station: usize, now: Instant) {
        if self.unsure[station] {
            self.tell(stations, station);
            self.unsure[station] = false;
        }
        self.heard[station] = now;
    }

    /// A station was polled: it may have begun to search.
    #[inline]
    pub(crate) fn was_polled(&mut self, station: usize) {
        self.unsure[station] = true;
    }

    /// A telegram ended at `now`.
    #[inline]
    pub(crate) fn note(&mut self, now: Instant, octets: &[u8]) {
        if let Some(place) = self.octets.get_mut(..octets.len()) {
            place.copy_from_slice(octets);
            (self.length, self.at) = (octets.len(), now);
        }
    }

    /// Every station has heard whatever there was.
    pub(crate) fn all_heard(&mut self, now: Instant) {
        self.heard.fill(now);
    }

    /// Tells every station that has not heard it.
    pub(crate) fn tell_all<S: Station>(&mut self, stations: &mut Stations<S>) {
        for at in 0..self.heard.len() {
            self.tell(stations, at);
        }
        self.unsure.fill(true);
    }

    /// Tells one station, unless it has heard it.
    #[inline]
    pub(crate) fn tell<S: Station>(&mut self, stations: &mut Stations<S>, station: usize) {
        let Self { octets, length, at, heard, .. } = self;
        if *at <= heard[station] {
            return;
        }
        if let Parsed::Complete(telegram @ Telegram::Data(_), _) = telegram::parse(&octets[..*length]) {
            heard[station] = *at;
            // It is not for this station, so there is no answer.
            let _ = stations.call(station, |station| station.indicate(*at, &telegram));
        }
    }
}
