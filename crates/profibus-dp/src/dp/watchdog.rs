//! The DP watchdog (Twd).

use crate::time::{Duration, Instant};

/// Runs from a Set_Prm with WD_On; expires when the owner is silent for Twd.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watchdog {
    /// Twd; zero: off.
    span: Duration,
    /// The last sign of life of the owner.
    last: Instant,
}

impl Watchdog {
    /// Does not run.
    pub const OFF: Self = Self { span: Duration::ZERO, last: Instant::ZERO };

    /// Starts, restarts, or with `None` stops it.
    pub fn set(&mut self, now: Instant, span: Option<Duration>) {
        *self = Self { span: span.unwrap_or(Duration::ZERO), last: now };
    }

    /// Whether it runs.
    #[doc(alias = "WD_On")]
    pub fn is_on(&self) -> bool {
        self.span > Duration::ZERO
    }

    /// Reading "Watchdog retrigger": an error-free SDA or SRD of the owner to our own address,
    /// retries included, ended at `now`.
    #[inline]
    pub fn retrigger(&mut self, now: Instant) {
        self.last = now;
    }

    /// When it expires unless retriggered.
    pub fn deadline(&self) -> Option<Instant> {
        self.is_on().then(|| self.last + self.span)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_from_the_last_sign_of_life() {
        let mut watchdog = Watchdog::default();
        assert_eq!(watchdog.deadline(), None);
        watchdog.set(Instant::from_millis(10), Some(Duration::from_millis(200)));
        assert_eq!(watchdog.deadline(), Some(Instant::from_millis(210)));
        watchdog.retrigger(Instant::from_millis(150));
        assert_eq!(watchdog.deadline(), Some(Instant::from_millis(350)));
        watchdog.set(Instant::from_millis(160), None);
        assert!(!watchdog.is_on());
        assert_eq!(watchdog.deadline(), None);
    }
}
