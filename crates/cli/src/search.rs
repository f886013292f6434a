//! A search for the baud rate goes round for ever while nobody sends: only its beginning and its end are
//! worth a line.

use std::collections::HashSet;
use std::sync::Arc;

use plant::{Report, What};
use profibus_dp::dp::Event as BusEvent;
use sch108bex::event::Event;

/// The encoders whose search has been told.
#[derive(Debug, Default)]
pub(crate) struct Searches(HashSet<Arc<str>>);

impl Searches {
    /// Whether a report says more than that a search goes on.
    pub(crate) fn is_news(&mut self, report: &Report) -> bool {
        match report.what {
            What::Device(Event::Bus(BusEvent::Listening(_))) => self.0.insert(Arc::clone(&report.who)),
            What::Device(Event::Bus(BusEvent::BaudrateFound(_))) | What::PowerOn(_) => {
                self.0.remove(&report.who);
                true
            }
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use profibus_dp::time::{Baudrate, Instant};

    use super::*;

    fn report(who: &str, event: BusEvent) -> Report {
        Report { at: Instant::ZERO, who: Arc::from(who), what: What::Device(Event::Bus(event)) }
    }

    #[test]
    fn each_search_is_told_once() {
        let mut searches = Searches::default();
        let listening = |who| report(who, BusEvent::Listening(Baudrate::B9600));
        let found = |who| report(who, BusEvent::BaudrateFound(Baudrate::B9600));
        for (report, news) in [
            (listening("a"), true),
            (listening("a"), false),
            (listening("b"), true),
            (listening("a"), false),
            (found("a"), true),
            (found("a"), true),
            (listening("b"), false),
            (listening("a"), true),
            (listening("a"), false),
            (Report { what: What::PowerOn(None), ..listening("a") }, true),
            (listening("a"), true),
        ] {
            assert_eq!(searches.is_news(&report), news, "{report:?}");
        }
    }
}
