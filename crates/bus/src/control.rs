//! Commands to a running segment from other threads.
//!
//! The segment looks at the queue only after its waker was used, so commands cost a telegram
//! nothing.

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::end::Waker;

struct Shared<C> {
    queue: Mutex<VecDeque<C>>,
    stop: AtomicBool,
    gone: AtomicBool,
}

impl<C> Shared<C> {
    fn with_queue<R>(&self, work: impl FnOnce(&mut VecDeque<C>) -> R) -> R {
        // A queue is whole after every operation, so a panic elsewhere does not matter.
        work(&mut self.queue.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The hand by which other threads reach a running segment; clones reach the same one.
pub struct Control<C> {
    shared: Arc<Shared<C>>,
    waker: Waker,
}

/// The segment's side of a [`Control`]: given to [`Segment::run`](crate::Segment::run).
pub struct Commands<C> {
    shared: Arc<Shared<C>>,
}

/// The segment runs no more; here is the command back.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the segment has stopped; start it again before giving it commands")]
pub struct Stopped<C>(pub C);

/// Both sides of a queue of commands to the thread that `waker` wakes.
pub fn channel<C>(waker: Waker) -> (Control<C>, Commands<C>) {
    let shared = Arc::new(Shared {
        queue: Mutex::new(VecDeque::new()),
        stop: AtomicBool::new(false),
        gone: AtomicBool::new(false),
    });
    (Control { shared: Arc::clone(&shared), waker }, Commands { shared })
}

impl<C> Control<C> {
    /// Gives the segment a command; its handler gets commands in the order they were given.
    ///
    /// # Errors
    ///
    /// The segment's [`Commands`] are gone.
    pub fn send(&self, command: C) -> Result<(), Stopped<C>> {
        self.shared.with_queue(|queue| {
            // Looked at under the lock: what is in the queue is handled, or dropped at the end.
            if self.shared.gone.load(Ordering::Acquire) {
                return Err(Stopped(command));
            }
            queue.push_back(command);
            Ok(())
        })?;
        self.waker.wake();
        Ok(())
    }

    /// Ends [`Segment::run`](crate::Segment::run), or the next one before it begins. Commands
    /// given before are still handled.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Release);
        self.waker.wake();
    }
}

impl<C> Commands<C> {
    /// The oldest command that nobody has taken.
    pub(crate) fn next(&self) -> Option<C> {
        self.shared.with_queue(VecDeque::pop_front)
    }

    /// Whether somebody wants the segment to stop.
    pub(crate) fn stopped(&self) -> bool {
        self.shared.stop.load(Ordering::Acquire)
    }
}

impl<C> Drop for Commands<C> {
    fn drop(&mut self) {
        let left = self.shared.with_queue(|queue| {
            self.shared.gone.store(true, Ordering::Release);
            std::mem::take(queue)
        });
        // Whoever waits for what came of his command hears that nothing will.
        drop(left);
    }
}

impl<C> Clone for Control<C> {
    fn clone(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), waker: self.waker.clone() }
    }
}

impl<C> fmt::Debug for Stopped<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Stopped")
    }
}

impl<C> fmt::Debug for Control<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Control")
    }
}

impl<C> fmt::Debug for Commands<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Commands")
    }
}
