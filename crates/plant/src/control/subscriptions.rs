//! What happens, to whoever wants to know it: bounded, so that a slow reader costs nobody else anything.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};

use crate::report::Report;

/// So many reports wait for a reader who is slow; what comes then is dropped and counted.
const MOST_WAITING: usize = 1_024;

/// Where reports are given to all subscriptions. Clones are the same.
#[derive(Debug, Clone, Default)]
pub struct Subscriptions {
    all: Arc<Mutex<Vec<Weak<Queue>>>>,
}

/// What one reader gets. It ends when this is dropped.
#[derive(Debug, Clone)]
pub struct Subscription {
    queue: Arc<Queue>,
}

/// What a reader gets.
#[derive(Debug, Clone)]
pub enum Item {
    /// This happened.
    Report(Arc<Report>),
    /// So many were dropped at this place.
    Dropped(u64),
}

#[derive(Debug, Default)]
struct Queue {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    items: VecDeque<Item>,
    closed: bool,
}

impl Subscriptions {
    /// Nobody yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// One more reader, from now on.
    pub fn subscribe(&self) -> Subscription {
        let queue = Arc::new(Queue::default());
        lock(&self.all).push(Arc::downgrade(&queue));
        Subscription { queue }
    }

    /// Gives a report to all readers. Never waits for any of them.
    pub fn publish(&self, report: &Report) {
        let mut all = lock(&self.all);
        if all.is_empty() {
            return;
        }
        let report = Arc::new(report.clone());
        all.retain(|queue| queue.upgrade().is_some_and(|queue| queue.push(&report)));
    }
}

impl Queue {
    /// Says whether anybody still reads.
    fn push(&self, report: &Arc<Report>) -> bool {
        let mut waiting = lock(&self.waiting);
        if waiting.closed {
            return false;
        }
        if waiting.items.len() < MOST_WAITING {
            waiting.items.push_back(Item::Report(Arc::clone(report)));
        } else if let Some(Item::Dropped(count)) = waiting.items.back_mut() {
            *count += 1;
        } else {
            waiting.items.push_back(Item::Dropped(1));
        }
        self.changed.notify_one();
        true
    }
}

impl Subscription {
    /// Waits for the next; `None` once it is closed.
    pub fn next(&self) -> Option<Item> {
        let mut waiting = lock(&self.queue.waiting);
        loop {
            if waiting.closed {
                return None;
            }
            if let Some(item) = waiting.items.pop_front() {
                return Some(item);
            }
            waiting = self.queue.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// What waits now; nothing once it is closed.
    pub fn take_waiting(&self) -> Vec<Item> {
        let mut waiting = lock(&self.queue.waiting);
        if waiting.closed { Vec::new() } else { waiting.items.drain(..).collect() }
    }

    /// No more is wanted; what waits is dropped.
    pub fn close(&self) {
        let mut waiting = lock(&self.queue.waiting);
        waiting.closed = true;
        waiting.items.clear();
        self.queue.changed.notify_all();
    }

    /// Whether it was closed.
    pub fn is_closed(&self) -> bool {
        lock(&self.queue.waiting).closed
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Each change is whole by itself, so a panic elsewhere does not matter.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use profibus_dp::time::Instant;

    use super::*;
    use crate::report::What;

    fn report(number: u64) -> Report {
        Report { at: Instant::from_nanos(number), who: "it".into(), what: What::PowerOff }
    }

    #[test]
    fn a_slow_reader_is_told_where_and_how_many_were_dropped() {
        let subscriptions = Subscriptions::new();
        let slow = subscriptions.subscribe();
        let most = MOST_WAITING as u64;
        (0..most + 5).for_each(|number| subscriptions.publish(&report(number)));
        for number in 0..2 {
            assert!(matches!(slow.next(), Some(Item::Report(report)) if report.at.as_nanos() == number));
        }
        // One place is free, and one is the note about the five.
        subscriptions.publish(&report(5_000));
        subscriptions.publish(&report(5_001));
        for number in 2..most {
            assert!(matches!(slow.next(), Some(Item::Report(report)) if report.at.as_nanos() == number));
        }
        assert!(matches!(slow.next(), Some(Item::Dropped(5))));
        assert!(matches!(slow.next(), Some(Item::Report(report)) if report.at.as_nanos() == 5_000));
        assert!(matches!(slow.next(), Some(Item::Dropped(1))));
    }

    #[test]
    fn readers_that_have_gone_are_forgotten() {
        let subscriptions = Subscriptions::new();
        let (dropped, closed, kept) =
            (subscriptions.subscribe(), subscriptions.subscribe(), subscriptions.subscribe());
        drop(dropped);
        closed.close();
        subscriptions.publish(&report(1));
        assert_eq!(lock(&subscriptions.all).len(), 1);
        assert!(closed.next().is_none());
        assert!(kept.next().is_some());
    }
}
