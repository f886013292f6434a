use super::*;
use crate::faults::RequestFault;

/// Answers to whatever is for address 11.
#[derive(Default)]
struct Eleven {
    line_errors: usize,
}

impl Station for Eleven {
    fn receive(&mut self, _: Instant, _: &[u8]) -> Option<Window> {
        None
    }

    fn indicate(&mut self, now: Instant, _: &Telegram<'_>) -> Option<Window> {
        Some(Window { not_before: now, not_after: now })
    }

    fn line_error(&mut self, _: Instant) {
        self.line_errors += 1;
    }

    fn transmit(&mut self, _: Instant) -> Option<&[u8]> {
        None
    }

    fn poll(&mut self, _: Instant) {}

    fn next_deadline(&self) -> Option<Instant> {
        None
    }

    fn listening_rate(&self) -> Baudrate {
        DEFAULT_RATE
    }

    fn address(&self) -> Option<u8> {
        Some(11)
    }
}

impl RateListener for Eleven {
    fn rate_found(&mut self, _: Instant, _: Option<Baudrate>) {}
}

/// FDL status of station 11, asked by master 2: DP slave reference, section 1.5.
const STATUS_11: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

/// The rest of a damaged telegram comes as a piece of its own, and looks like another one.
#[test]
fn after_a_character_error_nothing_is_heard_until_the_line_has_been_idle() {
    let mut line = Line::new(Settings::default());
    line.stations.push(Eleven::default());
    assert!(line.faults.fail_next_request(RequestFault::CharacterError { octet: 99 }));
    // Something goes on being wrong, so that the layer stays.
    assert!(line.faults.fail_next_reply(crate::faults::ReplyFault::Lose));
    let at = Instant::from_micros;
    assert_eq!(line.receive(at(10_000), &[0x68, 9, 9, 0x68, 11, 2, 0x7D]), None);
    assert_eq!(line.stations.as_slice()[0].line_errors, 1);
    assert_eq!(line.receive(at(10_400), &STATUS_11), None);
    assert_eq!(line.receive(at(10_800), &STATUS_11), None, "it was not idle since");
    assert!(line.receive(at(11_301), &STATUS_11).is_some());
    assert_eq!(line.stations.as_slice()[0].line_errors, 1);
}
