//! A pair of ends in memory: what one writes, the other reads. For tests and for masters in the
//! same process.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use profibus_dp::time::{Baudrate, Duration};

use crate::end::{End, EndError, Event, Wake, Waker, Written};

/// What a side holds at most, as a pseudo terminal would; the rest is dropped.
pub const CAPACITY: usize = 16_384;

/// One of two ends in memory. Each side may live on a thread of its own; dropping one tells the
/// other that nobody is there any more.
#[derive(Debug)]
pub struct MemoryEnd {
    shared: Arc<Shared>,
    side: usize,
}

#[derive(Debug, Default)]
struct Shared {
    sides: Mutex<[Side; 2]>,
    changed: [Condvar; 2],
}

/// What one side has not taken yet.
#[derive(Debug, Default)]
struct Side {
    octets: Vec<u8>,
    /// The rate that the other side has set.
    rate: Option<Baudrate>,
    news: Option<RateNews>,
    woken: bool,
    left: bool,
}

#[derive(Debug, Clone, Copy)]
enum RateNews {
    Came,
    Changed,
}

/// Two ends that are joined. Neither has a rate until [`MemoryEnd::set_rate`].
pub fn pair() -> (MemoryEnd, MemoryEnd) {
    let shared = Arc::new(Shared::default());
    for side in shared.sides().iter_mut() {
        side.octets.reserve(CAPACITY);
        side.news = Some(RateNews::Came);
    }
    (MemoryEnd { shared: Arc::clone(&shared), side: 0 }, MemoryEnd { shared, side: 1 })
}

impl Shared {
    fn sides(&self) -> MutexGuard<'_, [Side; 2]> {
        // Each change is whole by itself, so a panic elsewhere does not matter.
        self.sides.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, side: usize, change: impl FnOnce(&mut Side)) {
        change(&mut self.sides()[side]);
        self.changed[side].notify_one();
    }
}

impl Side {
    fn take(&mut self, buffer: &mut [u8]) -> Option<Event> {
        if self.woken {
            self.woken = false;
            return Some(Event::Woken);
        }
        if !self.octets.is_empty() || matches!(self.news, Some(RateNews::Changed)) {
            if let Some(news) = self.news.take() {
                return Some(match news {
                    RateNews::Came => Event::Came(self.rate),
                    RateNews::Changed => Event::Rate(self.rate),
                });
            }
            let count = self.octets.len().min(buffer.len());
            buffer[..count].copy_from_slice(&self.octets[..count]);
            self.octets.drain(..count);
            return Some(Event::Octets(count));
        }
        if self.left {
            self.left = false;
            return Some(Event::Left);
        }
        None
    }
}

impl MemoryEnd {
    /// Sets the rate that the other side sees, as a master sets that of a serial port.
    pub fn set_rate(&self, rate: Option<Baudrate>) {
        self.shared.change(1 - self.side, |other| {
            if other.rate != rate {
                other.rate = rate;
                other.news.get_or_insert(RateNews::Changed);
            }
        });
    }
}

impl End for MemoryEnd {
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError> {
        let until = timeout.and_then(|timeout| std::time::Instant::now().checked_add(timeout.into()));
        let mut sides = self.shared.sides();
        loop {
            if let Some(event) = sides[self.side].take(buffer) {
                return Ok(event);
            }
            let changed = &self.shared.changed[self.side];
            sides = match until {
                None => changed.wait(sides).unwrap_or_else(PoisonError::into_inner),
                Some(until) => {
                    let left = until.saturating_duration_since(std::time::Instant::now());
                    if left.is_zero() {
                        return Ok(Event::TimedOut);
                    }
                    changed.wait_timeout(sides, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }

    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError> {
        let mut dropped = 0;
        if Arc::strong_count(&self.shared) < 2 {
            return Ok(Written::Dropped(octets.len()));
        }
        self.shared.change(1 - self.side, |other| {
            let room = CAPACITY - other.octets.len().min(CAPACITY);
            let count = octets.len().min(room);
            other.octets.extend_from_slice(&octets[..count]);
            dropped = octets.len() - count;
        });
        Ok(if dropped == 0 { Written::All } else { Written::Dropped(dropped) })
    }

    fn name(&self) -> &'static str {
        "memory"
    }

    fn waker(&self) -> Waker {
        Waker::new(Arc::new(SideWaker { shared: Arc::downgrade(&self.shared), side: self.side }))
    }
}

impl Drop for MemoryEnd {
    fn drop(&mut self) {
        self.shared.change(1 - self.side, |other| other.left = true);
    }
}

struct SideWaker {
    // Weak, so that wakers do not count as somebody at the far side.
    shared: std::sync::Weak<Shared>,
    side: usize,
}

impl Wake for SideWaker {
    fn wake(&self) {
        if let Some(shared) = self.shared.upgrade() {
            shared.change(self.side, |own| own.woken = true);
        }
    }
}
