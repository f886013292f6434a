//! What ends that wait with `poll` share: something to be woken by, and the system's time spans.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};

use profibus_dp::time::Duration;
use rustix::event::{EventfdFlags, Timespec, eventfd};
use rustix::io::{Errno, read, write};

use crate::end::Wake;

/// Something to wake up by, both for those who poll and for those who only look.
#[derive(Debug)]
pub(crate) struct EventFd {
    fd: OwnedFd,
    set: AtomicBool,
}

impl EventFd {
    pub(crate) fn new() -> Result<Self, Errno> {
        let fd = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?;
        Ok(Self { fd, set: AtomicBool::new(false) })
    }

    #[inline]
    pub(crate) fn is_set(&self) -> bool {
        self.set.load(Ordering::Acquire)
    }

    pub(crate) fn clear(&self) {
        // In this order: who sets it in between is seen by the flag the next time.
        self.set.store(false, Ordering::Release);
        // Nothing to read: another wake-up was cleared along with this one.
        let _ = read(&self.fd, &mut [0; 8]);
    }
}

impl AsFd for EventFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl Wake for EventFd {
    fn wake(&self) {
        self.set.store(true, Ordering::Release);
        // Full: it has been woken 2^64 times and will wake up.
        let _ = write(&self.fd, &1u64.to_ne_bytes());
    }
}

#[inline]
pub(crate) fn timespec(span: Duration) -> Timespec {
    let nanos = span.as_nanos();
    // Both fit: the first for 584 years, the second below a thousand million.
    #[allow(clippy::cast_possible_wrap)]
    Timespec { tv_sec: (nanos / 1_000_000_000) as i64, tv_nsec: (nanos % 1_000_000_000) as i64 as _ }
}
