//! The stations of a segment, found by their address.

use profibus_dp::Station;
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::telegram::BROADCAST;

/// A station whose deadline stays in the past, whatever is done, is not polled more often than this.
const LEAST_STEP: Duration = Duration::from_micros(100);

/// "No station", in the lists by address.
const NONE: u32 = u32::MAX;

/// Stations in the order they were added. Two may share an address: a fault worth simulating.
#[derive(Debug)]
pub(crate) struct Stations<S> {
    list: Vec<S>,
    /// Where each station is entered.
    addresses: Vec<Option<u8>>,
    /// For each address its first station, and for each station the next of the same address.
    first: [u32; 128],
    next: Vec<u32>,
    /// For each station when it is to be polled; by itself, so that nobody walks through the stations.
    due: Vec<Instant>,
    /// No station is due before this.
    earliest: Instant,
}

impl<S: Station> Stations<S> {
    pub(crate) fn new() -> Self {
        Self {
            list: Vec::new(),
            addresses: Vec::new(),
            first: [NONE; 128],
            next: Vec::new(),
            due: Vec::new(),
            earliest: Instant::MAX,
        }
    }

    pub(crate) fn push(&mut self, station: S) -> usize {
        self.list.push(station);
        self.refresh_all();
        self.list.len() - 1
    }

    pub(crate) fn as_slice(&self) -> &[S] {
        &self.list
    }

    /// After changes through this, [`refresh_all`](Self::refresh_all) is due.
    pub(crate) fn as_mut_slice(&mut self) -> &mut [S] {
        &mut self.list
    }

    pub(crate) fn into_vec(self) -> Vec<S> {
        self.list
    }

    /// The stations that answer to `address`; none for the broadcast address.
    #[inline]
    pub(crate) fn first_at(&self, address: u8) -> Option<usize> {
        self.first.get(usize::from(address)).copied().and_then(index)
    }

    /// The next station with the same address as station `at`.
    #[inline]
    pub(crate) fn next_at(&self, at: usize) -> Option<usize> {
        index(self.next[at])
    }

    /// The stations that a telegram to this address is for.
    #[inline]
    pub(crate) fn each_for(&mut self, address: u8, mut call: impl FnMut(&mut Self, usize)) {
        if address == BROADCAST {
            (0..self.list.len()).for_each(|at| call(self, at));
            return;
        }
        let mut next = self.first_at(address);
        while let Some(at) = next {
            // Found before the call: it may change the address of this station.
            next = self.next_at(at);
            call(self, at);
        }
    }

    /// Calls into one station, then sees to its deadline and its address.
    #[inline]
    pub(crate) fn call<R>(&mut self, at: usize, call: impl FnOnce(&mut S) -> R) -> R {
        let result = call(&mut self.list[at]);
        self.refresh(at);
        result
    }

    /// Sees to what a call into station `at` may have changed.
    #[inline]
    pub(crate) fn refresh(&mut self, at: usize) {
        let station = &self.list[at];
        let due = station.next_deadline().unwrap_or(Instant::MAX);
        self.due[at] = due;
        self.earliest = self.earliest.min(due);
        if station.address() != self.addresses[at] {
            self.enter_all();
        }
    }

    /// Sees to what calls into any stations may have changed.
    pub(crate) fn refresh_all(&mut self) {
        self.due.clear();
        self.due.extend(self.list.iter().map(|station| station.next_deadline().unwrap_or(Instant::MAX)));
        self.find_earliest();
        self.enter_all();
    }

    /// No station wants to be polled before this.
    #[inline]
    pub(crate) fn earliest(&self) -> Instant {
        self.earliest
    }

    /// Polls the stations whose time has come.
    #[cold]
    pub(crate) fn poll(&mut self, now: Instant) {
        self.each_due(now, |stations, at| stations.call(at, |station| station.poll(now)));
    }

    /// Whether a station is to be polled.
    pub(crate) fn is_due(&self, at: usize, now: Instant) -> bool {
        self.due[at] <= now
    }

    /// The stations whose time has come, to be polled, each exactly at its deadline where `now` is
    /// [`earliest`](Self::earliest).
    pub(crate) fn each_due(&mut self, now: Instant, mut call: impl FnMut(&mut Self, usize)) {
        for at in 0..self.list.len() {
            if self.due[at] <= now {
                call(self, at);
                if self.due[at] <= now {
                    self.due[at] = now + LEAST_STEP;
                }
            }
        }
        self.find_earliest();
    }

    fn find_earliest(&mut self) {
        self.earliest = self.due.iter().copied().min().unwrap_or(Instant::MAX);
    }

    #[cold]
    fn enter_all(&mut self) {
        self.first = [NONE; 128];
        self.next = vec![NONE; self.list.len()];
        self.addresses = self.list.iter().map(Station::address).collect();
        for (at, address) in self.addresses.iter().enumerate().rev() {
            if let Some(address) = address.filter(|&address| address < BROADCAST) {
                let first = &mut self.first[usize::from(address)];
                self.next[at] = *first;
                *first = u32::try_from(at).unwrap_or(NONE);
            }
        }
    }
}

#[inline]
fn index(entry: u32) -> Option<usize> {
    (entry != NONE).then_some(entry as usize)
}
