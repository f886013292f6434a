//! What is on the segments, as telegrams in words.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bus::{Sight, WireTap};
use capture::{Direction as Sender, Listener, Packet};
use dissector::{Conversation, Direction, Dissected, Item, Profile, Service};
use plant::{Handle, PlantSnapshot, Report, What};
use profibus_dp::time::Instant;
use serde::Serialize;

use crate::stage::Scene;

/// More telegrams of one batch are not shown, but counted.
pub(crate) const MOST_SHOWN: usize = 400;
/// So many telegrams of data exchange in a batch are shown; what happens seldom always finds a place beside them.
const MOST_EXCHANGES: usize = 60;

/// A telegram as the stream has it.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Telegram {
    pub(crate) n: u64,
    pub(crate) at_ns: u64,
    pub(crate) segment: Arc<str>,
    pub(crate) octets: String,
    pub(crate) from: Option<u8>,
    pub(crate) to: Option<u8>,
    pub(crate) kind: &'static str,
    pub(crate) service: Option<Service>,
    pub(crate) what: String,
    pub(crate) refused: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) notes: Vec<String>,
    pub(crate) fields: Vec<Field>,
}

/// A value in a telegram.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Field {
    first: usize,
    last: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    bits: Option<[u8; 2]>,
    name: &'static str,
    value: dissector::Value,
    text: std::borrow::Cow<'static, str>,
}

/// All segments of a plant.
#[derive(Debug)]
pub(crate) struct Wires {
    wires: Mutex<Vec<Wire>>,
    /// Somebody wants to see telegrams.
    on: Arc<AtomicBool>,
}

#[derive(Debug)]
struct Wire {
    segment: Arc<str>,
    listener: Listener,
    conversation: Conversation,
    ear: Ear,
}

/// Where recordings listen to a segment. Clones are the same.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ear(Arc<Mutex<Vec<Other>>>);

struct Other {
    /// Who it is, to be found again.
    number: u64,
    tap: Box<dyn WireTap>,
}

impl std::fmt::Debug for Other {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.tap.fmt(f)
    }
}

impl Ear {
    /// Somebody listens from now on.
    pub(crate) fn listen_too(&self, number: u64, tap: Box<dyn WireTap>) {
        lock(&self.0).push(Other { number, tap });
    }

    /// He does not any more.
    pub(crate) fn forget(&self, number: u64) {
        lock(&self.0).retain(|other| other.number != number);
    }
}

/// What listens on the segment's thread.
#[derive(Debug)]
struct Head {
    on: Arc<AtomicBool>,
    tap: capture::Tap,
    ear: Ear,
}

impl WireTap for Head {
    fn saw(&mut self, at: Instant, sight: Sight<'_>) {
        if self.on.load(Ordering::Relaxed) {
            self.tap.saw(at, sight);
        }
        for other in lock(&self.ear.0).iter_mut() {
            other.tap.saw(at, sight);
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Each change is whole by itself, so a panic elsewhere does not matter.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What was taken from the wires at once.
#[derive(Debug, Default)]
pub(crate) struct Taken {
    pub(crate) telegrams: Vec<Telegram>,
    /// All that were seen, those that are not among them included.
    pub(crate) seen: u64,
    exchanges: usize,
}

impl Wires {
    /// Listens to all segments of a plant, beside those who do already.
    pub(crate) fn new(handle: &Handle) -> Self {
        let on = Arc::new(AtomicBool::new(false));
        let names: Vec<String> = handle.segments().map(|(name, _)| name.to_owned()).collect();
        let wires = names.into_iter().map(|segment| {
            let listener = Listener::new();
            let ear = Ear::default();
            let head = Head { on: Arc::clone(&on), tap: listener.tap(), ear: ear.clone() };
            // A segment that has ended has nothing to tell.
            let _ = handle.add_tap(&segment, Box::new(head));
            Wire { segment: segment.into(), listener, conversation: fresh(), ear }
        });
        let wires = wires.collect();
        Self { wires: Mutex::new(wires), on }
    }

    /// Where recordings listen to this segment.
    pub(crate) fn ear(&self, segment: &str) -> Option<Ear> {
        lock(&self.wires).iter().find(|wire| &*wire.segment == segment).map(|wire| wire.ear.clone())
    }

    /// Whether telegrams are wanted from now on.
    pub(crate) fn listen(&self, on: bool) {
        let before = self.on.swap(on, Ordering::Relaxed);
        if before && !on {
            for wire in lock(&self.wires).iter_mut() {
                wire.listener.take(Instant::ZERO, &mut |_| ());
                wire.conversation = fresh();
            }
        }
    }

    /// Takes what has come, in the order of time on each segment. `next` is the number of the first telegram.
    pub(crate) fn take(&self, snapshot: &PlantSnapshot, next: u64) -> Taken {
        let mut taken = Taken { seen: 0, ..Taken::default() };
        for wire in lock(&self.wires).iter_mut() {
            let at = snapshot.segments.iter().find(|segment| *segment.name == *wire.segment);
            let now = at.map_or(Instant::ZERO, |segment| segment.at);
            let Wire { segment, listener, conversation, .. } = wire;
            let missing =
                listener.take(now, &mut |packet| tell(segment, conversation, packet, next, &mut taken));
            taken.seen += missing;
        }
        taken
    }
}

fn fresh() -> Conversation {
    Conversation::new(Profile::Encoder)
}

/// A packet as telegrams.
fn tell(segment: &Arc<str>, conversation: &mut Conversation, packet: Packet, next: u64, taken: &mut Taken) {
    let Packet { nanos, direction, octets, comments, .. } = packet;
    if octets.is_empty() {
        // Something that happened: events tell it.
        return;
    }
    let mut items = Vec::new();
    conversation.push(&octets, &mut |entry| items.push(entry.item));
    conversation.finish(&mut |entry| items.push(entry.item));
    for item in items {
        let n = next + taken.seen;
        taken.seen += 1;
        let blank = Telegram {
            n,
            at_ns: nanos,
            segment: Arc::clone(segment),
            octets: String::new(),
            from: None,
            to: None,
            kind: "damaged",
            service: None,
            what: String::new(),
            refused: None,
            notes: comments.clone(),
            fields: Vec::new(),
        };
        let telegram = match item {
            Item::Telegram(dissected) => {
                let exchange = dissected.service == Some(Service::DataExchange);
                taken.exchanges += usize::from(exchange);
                if exchange && taken.exchanges > MOST_EXCHANGES {
                    continue;
                }
                in_words(dissected, blank)
            }
            Item::Bad { octets, words, .. } | Item::Garbage { octets, words, .. } => {
                let from_slave = direction == Some(Sender::Reply);
                let what = if from_slave { format!("of a station: {words}") } else { words };
                Telegram { octets, what, ..blank }
            }
        };
        if taken.telegrams.len() < MOST_SHOWN {
            taken.telegrams.push(telegram);
        }
    }
}

fn in_words(dissected: Dissected, blank: Telegram) -> Telegram {
    let Dissected { octets, direction, source, destination, service, summary, fields, remarks, .. } =
        dissected;
    let kind = match direction {
        Direction::Request => "request",
        Direction::Response => "reply",
        Direction::Token => "token",
    };
    // Who speaks to whom has fields of its own.
    let what = match summary.split_once("  ") {
        Some((_, what)) => what.to_owned(),
        None => summary,
    };
    let mut notes = blank.notes.clone();
    notes.extend(remarks.into_iter().map(|remark| match remark.octet {
        Some(octet) => format!("octet {octet}: {}", remark.words),
        None => remark.words,
    }));
    let fields = fields.into_iter().map(|field| Field {
        first: field.octets[0],
        last: field.octets[1],
        bits: field.bits,
        name: field.name,
        value: field.value,
        text: field.words,
    });
    let fields = fields.collect();
    Telegram { octets, from: source, to: destination, kind, service, what, notes, fields, ..blank }
}

impl Taken {
    /// The device has refused something: that was the last request to it before.
    pub(crate) fn refuse(&mut self, scene: &Scene, report: &Report) {
        use sch108bex::event::Event;
        let (services, why): (&[Service], _) = match &report.what {
            What::Device(event @ Event::PrmRefused(_)) => (&[Service::SetPrm], event.to_string()),
            What::Device(event @ Event::CfgRefused(_)) => (&[Service::ChkCfg], event.to_string()),
            What::Device(event @ Event::AddressRefused(_)) => (&[Service::SetSlaveAdd], event.to_string()),
            What::Device(event @ Event::PresetRefused(_)) => (&[Service::DataExchange], event.to_string()),
            What::Device(event @ Event::Bus(profibus_dp::dp::Event::Refused(_))) => (&[], event.to_string()),
            _ => return,
        };
        let segment = scene
            .handle
            .segments()
            .find_map(|(name, mut encoders)| encoders.any(|encoder| *encoder == *report.who).then_some(name));
        let before = self.telegrams.iter_mut().rev().find(|telegram| {
            telegram.kind == "request"
                && telegram.at_ns <= report.at.as_nanos()
                && Some(&*telegram.segment) == segment
                && (services.is_empty()
                    || telegram.service.is_some_and(|service| services.contains(&service)))
        });
        if let Some(telegram) = before {
            telegram.refused = Some(why);
        }
    }
}
