//! What there is to say about an event.

use bus::FaultCounters;
use profibus_dp::time::Baudrate;

use super::What;

/// Sentences about an event with so many octets.
pub(super) fn of(what: &What, octets: usize) -> Vec<String> {
    let one = |text: &str| vec![text.to_owned()];
    match what {
        What::Heard | What::Request(None) => Vec::new(),
        What::Request(Some(faults)) => requests(faults),
        What::Reply { faults, collision, dropped } => {
            let mut words = faults.as_ref().map_or_else(Vec::new, |faults| replies(faults));
            if *collision {
                words.push("two stations answered at once".to_owned());
            }
            let lost = faults.as_ref().is_some_and(|faults| faults.lost_replies > 0);
            if *dropped > 0 && !lost {
                words.push(format!("the far side did not take {dropped} of {octets} octets"));
            }
            words
        }
        What::Overtaken => one("a reply was not sent: octets came before it"),
        What::TooLate => one("a reply was not sent: it was older than the reply limit"),
        What::CharacterError => one("a character with a parity or framing error"),
        What::MasterCame(rate) => vec![format!("a master came{}", at(*rate))],
        What::Rate(rate) => vec![format!("another rate{}", at(*rate))],
        What::MasterLeft => one("the master left"),
    }
}

fn at(rate: Option<Baudrate>) -> String {
    rate.map_or_else(String::new, |rate| format!(", {} bit/s", rate.bits_per_second()))
}

fn requests(faults: &FaultCounters) -> Vec<String> {
    told([
        (faults.lost_requests, "no station heard it"),
        (faults.doubled_requests, "stations heard it twice"),
        (faults.damaged_request_characters, "characters were damaged"),
    ])
}

fn replies(faults: &FaultCounters) -> Vec<String> {
    told([
        (faults.lost_replies, "the master did not hear it"),
        (faults.doubled_replies, "it came twice"),
        (faults.late_replies, "it was held back"),
        (faults.damaged_reply_characters, "characters were damaged"),
    ])
}

fn told<const N: usize>(faults: [(u64, &str); N]) -> Vec<String> {
    let happened = faults.into_iter().filter(|(count, _)| *count > 0);
    happened
        .map(|(count, words)| match words {
            "characters were damaged" if count == 1 => "line fault: 1 character was damaged".to_owned(),
            "characters were damaged" => format!("line fault: {count} {words}"),
            _ => format!("line fault: {words}"),
        })
        .collect()
}
