//! An encoder on the bus that is watched: its watchdog, and a shadow that takes every latch.

use plant::{EncoderSetup, EncoderStation, Shaft, World};
use profibus_dp::dp::State;
use profibus_dp::fdl::{Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::{DataTelegram, Sap, Telegram};
use sch108bex::end_cap::RotarySwitches;

use crate::shadow::Shadow;

/// How late a segment may poll a station after it has polled another.
const LATE_AT_MOST: Duration = Duration::from_micros(100);

/// What is counted of one station.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Watched {
    pub(crate) expiries: u64,
    /// The longest from the end of a watchdog to when it showed.
    pub(crate) latest: Duration,
}

#[derive(Debug)]
pub(crate) struct SoakStation {
    inner: EncoderStation,
    pub(crate) shadow: Option<Box<Shadow>>,
    owner: u8,
    watchdog: Option<Duration>,
    /// End of the last SRD of the owner to it.
    fed: Instant,
    pub(crate) watched: Watched,
    pub(crate) violation: Option<String>,
}

impl SoakStation {
    pub(crate) fn new(
        now: Instant,
        setup: EncoderSetup,
        shadow: Option<Shadow>,
        owner: u8,
        watchdog: Option<Duration>,
    ) -> Self {
        let inner = EncoderStation::new(now, setup).expect("a memory that forgets can be read");
        Self {
            inner,
            shadow: shadow.map(Box::new),
            owner,
            watchdog,
            fed: now,
            watched: Watched::default(),
            violation: None,
        }
    }

    pub(crate) fn set_shaft(&mut self, now: Instant, shaft: Shaft) {
        self.inner.set_shaft(now, shaft.clone());
        if let Some(shadow) = &mut self.shadow {
            shadow.set_shaft(now, shaft);
        }
    }

    pub(crate) fn set_world(&mut self, now: Instant, world: World) {
        self.inner.set_world(now, world).expect("a memory that forgets can be read");
        if let Some(shadow) = &mut self.shadow {
            shadow.set_world(now, world);
        }
    }

    pub(crate) fn set_switches(&mut self, switches: RotarySwitches) {
        self.inner.set_switches(switches);
        if let Some(shadow) = &mut self.shadow {
            shadow.set_switches(switches);
        }
    }

    pub(crate) fn power_cycle(&mut self, now: Instant) {
        self.inner.power_cycle(now).expect("a memory that forgets can be read");
        if let Some(shadow) = &mut self.shadow {
            shadow.power_cycle(now);
        }
    }

    pub(crate) fn is_powered(&self) -> bool {
        self.inner.device().is_some()
    }

    fn has_session(&self) -> bool {
        self.inner.device().is_some_and(|device| !matches!(device.bus().slave().state(), State::WaitPrm))
    }

    #[cold]
    fn violate(&mut self, what: String) {
        self.violation.get_or_insert(what);
    }

    /// The session ended at `now`, and nobody had asked for that.
    #[cold]
    fn left(&mut self, now: Instant) {
        let Some(watchdog) = self.watchdog else {
            self.violate("it left its master without a watchdog".into());
            return;
        };
        let end = self.fed + watchdog;
        if now < end || now.since(end) > LATE_AT_MOST {
            self.violate(format!("its watchdog of {watchdog:?}, fed at {:?}, ran out at {now:?}", self.fed));
        }
        self.watched.expiries += 1;
        self.watched.latest = self.watched.latest.max(now.since(end));
    }

    /// Whether it is an SRD of the owner to this station.
    #[inline]
    fn is_feed(&self, data: &DataTelegram<'_>) -> bool {
        data.sa == self.owner && data.fc.is_srd_request() && Some(data.da) == self.inner.address()
    }
}

impl Station for SoakStation {
    fn receive(&mut self, _: Instant, _: &[u8]) -> Option<Window> {
        unreachable!("a virtual segment parses")
    }

    #[inline]
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        let Telegram::Data(data) = telegram else {
            return self.inner.indicate(now, telegram);
        };
        let feeds = self.is_feed(data);
        let before = feeds && self.has_session();
        let window = self.inner.indicate(now, telegram);
        if let Some(shadow) = &mut self.shadow
            && let Some(difference) = shadow.indicate(now, telegram, window)
        {
            self.violate(difference);
        }
        if feeds {
            let end = self.watchdog.map(|watchdog| self.fed + watchdog);
            // Data_Exchange and diagnosis end no session.
            if before && matches!(data.dsap, Sap::NIL | Sap::SLAVE_DIAG) {
                let after = self.has_session();
                if after && end.is_some_and(|end| now > end) {
                    self.violate(format!("its watchdog, fed at {:?}, has not run out at {now:?}", self.fed));
                } else if !after {
                    self.left(now);
                }
            }
            self.fed = now;
        }
        window
    }

    fn line_error(&mut self, now: Instant) {
        self.inner.line_error(now);
        if let Some(shadow) = &mut self.shadow {
            shadow.line_error(now);
        }
    }

    #[inline]
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        let Self { inner, shadow, violation, .. } = self;
        let reply = inner.transmit(now);
        if let Some(shadow) = shadow
            && let Some(difference) = shadow.transmit(now, reply)
        {
            violation.get_or_insert(difference);
        }
        reply
    }

    fn poll(&mut self, now: Instant) {
        let before = self.has_session();
        self.inner.poll(now);
        if let Some(shadow) = &mut self.shadow {
            shadow.poll(now);
        }
        if before && !self.has_session() {
            self.left(now);
        }
    }

    #[inline]
    fn next_deadline(&self) -> Option<Instant> {
        self.inner.next_deadline()
    }

    #[inline]
    fn listening_rate(&self) -> Baudrate {
        self.inner.listening_rate()
    }

    #[inline]
    fn address(&self) -> Option<u8> {
        self.inner.address()
    }
}
