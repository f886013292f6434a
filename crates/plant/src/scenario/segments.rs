//! Reading `[[segment]]`.

use std::ops::Range;

use bus::PortAddress;
use profibus_dp::time::Baudrate;

use toml::Spanned;
use toml::de::DeValue;

use super::encoders::{self, Found};
use super::fault::{nearest, quoted};
use super::reader::{At, Reader};
use super::{Act, EncoderPlan, Event, SegmentPlan, poll, starts};
use crate::control::{Request, Which};
use crate::plant::MasterTap;

/// The master's place in `cable`.
const MASTER: &str = "master";

pub(super) fn read(tables: &[Reader<'_>]) -> Vec<SegmentPlan> {
    let mut states = Vec::new();
    let mut segments: Vec<SegmentPlan> = Vec::new();
    for table in tables {
        let Some(segment) = segment(table, &mut states) else {
            continue;
        };
        if segments.iter().any(|other| other.name == segment.name) {
            let hint = "give each segment a `name` of its own; one may be left out, and is `bus`";
            table.fault(
                table.span_of("name"),
                format!("there are two segments {}", quoted(&segment.name)),
                hint,
            );
        }
        same_port(table, &segment, &segments);
        segments.push(segment);
    }
    segments
}

/// Two segments at one port are none; several may be on new pseudo terminals, or on free TCP ports.
fn same_port(table: &Reader<'_>, segment: &SegmentPlan, others: &[SegmentPlan]) {
    let free = match &segment.port {
        PortAddress::Pty => true,
        PortAddress::TcpListen(address) => address.port() == 0,
        _ => false,
    };
    if let Some(other) = others.iter().find(|other| !free && other.port == segment.port) {
        let message = format!("the segment {} is at this port already", quoted(&other.name));
        table.fault(table.span_of("port"), message, "give each segment a port of its own");
    }
}

fn segment(table: &Reader<'_>, states: &mut Vec<(String, Range<usize>)>) -> Option<SegmentPlan> {
    let name = name(table, "name").ok()?.unwrap_or_else(|| "bus".to_owned());
    let port = table.parsed::<PortAddress>("port").map_or(PortAddress::Pty, |port| port.value);
    let link = table.text("link").map(|link| link.value.into());
    if link.is_some() && port != PortAddress::Pty {
        table.fault(
            table.span_of("link"),
            "a link is to a pseudo terminal, and this port is none",
            "leave `link` out",
        );
    }
    let rate = rate(table);
    let (search, pace) = (table.boolean("search").unwrap_or(false), table.boolean("pace").unwrap_or(false));
    if pace && matches!(port, PortAddress::Device(_)) {
        table.fault(table.span_of("pace"), "a serial device has a time of its own", "leave `pace` out");
    }
    let found = encoders::read(table, &name, states);
    let is_list =
        |found: &Spanned<DeValue<'_>>| found.get_ref().as_array().is_some_and(|list| list.is_empty());
    if table.raw("encoder").is_none_or(is_list) {
        let hint = "add [[segment.encoder]] with a `name`";
        table.fault(table.span_of("encoder"), format!("the segment {} has no encoder", quoted(&name)), hint);
    }
    let order = cable(table, &name, &found);
    let (encoders, tap) = placed(table, found, &order);
    let master = table.inner("master").map(|inner| poll::master(&inner, &name, &encoders));
    let reflections = table.boolean("reflections").unwrap_or(false);
    Some(SegmentPlan { name, port, link, rate, search, pace, tap, reflections, encoders, master })
}

/// What happens when encoders come that are not there at the start: they get power, what they begin with, and
/// their place on the bus. Until then they have none of that.
pub(super) fn joins(segments: &mut [SegmentPlan]) -> Vec<Event> {
    let mut events = Vec::new();
    for plan in segments.iter_mut().flat_map(|segment| &mut segment.encoders) {
        let Some((at, octet)) = plan.joins_at else { continue };
        let who = || Some(Which::Name(plan.name.clone()));
        let volts = f64::from(plan.world.0.supply_mv) / 1e3;
        let requests = std::iter::once(Request::Supply { encoder: who(), volts })
            .chain(plan.starts.iter().map(|request| starts::for_encoder(request, &plan.name)))
            .chain([Request::Join { encoder: who() }]);
        events.extend(requests.map(|request| Event { at, octet, act: Act::Request(request) }));
        plan.world.0.supply_mv = 0;
        plan.starts.clear();
        plan.joined = false;
    }
    events
}

/// A name that cannot be one; it was told.
#[derive(Debug)]
pub(super) struct NoName;

/// A name, which others can refer to; `None`: there is none.
pub(super) fn name(table: &Reader<'_>, key: &str) -> Result<Option<String>, NoName> {
    if table.raw(key).is_none() {
        return Ok(None);
    }
    let At { value, span } = table.text(key).ok_or(NoName)?;
    let plain = |octet: u8| octet.is_ascii_alphanumeric() || octet == b'-' || octet == b'_';
    let digits = value.bytes().all(|octet| octet.is_ascii_digit());
    if digits || value.len() > 40 || !value.bytes().all(plain) || ["all", MASTER].contains(&value) {
        let hint =
            "write up to 40 letters, digits, - and _, with a letter among them; `all` and `master` are taken";
        table.fault(span, format!("{} is no name", quoted(value)), hint);
        return Err(NoName);
    }
    Ok(Some(value.to_owned()))
}

fn rate(table: &Reader<'_>) -> Option<Baudrate> {
    let bits = table.integer("rate", 0, i64::from(u32::MAX))?;
    let found = u32::try_from(bits).ok().and_then(Baudrate::from_bits_per_second);
    if found.is_none() {
        let rates: Vec<_> = Baudrate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
        let hint = format!("PROFIBUS has {}", rates.join(", "));
        table.fault(table.span_of("rate"), format!("{bits} bit/s is no rate of PROFIBUS"), hint);
    }
    found
}

/// Who is where: for each place an encoder by its number, or `None` for the master.
fn cable(table: &Reader<'_>, segment: &str, encoders: &[Found]) -> Vec<Option<usize>> {
    let usual = || std::iter::once(None).chain((0..encoders.len()).map(Some)).collect();
    let Some(names) = table.texts("cable") else {
        return usual();
    };
    let full = |name: &str| if name.contains('.') { name.to_owned() } else { format!("{segment}.{name}") };
    let mut order: Vec<Option<usize>> = Vec::new();
    for At { value, span } in names {
        let known = || encoders.iter().map(|encoder| encoder.plan.name.as_str());
        let place = (value != MASTER).then(|| known().position(|known| known == full(value)));
        if place == Some(None) {
            let hint = nearest(&full(value), known()).map_or_else(
                || "write names of encoders of this segment, and `master`".to_owned(),
                |near| format!("is \"{near}\" meant?"),
            );
            table.fault(span, format!("there is no encoder {} on this segment", quoted(value)), hint);
            return usual();
        }
        if order.contains(&place.flatten()) {
            table.fault(span, format!("{} is in the cable twice", quoted(value)), "write each once");
            return usual();
        }
        order.push(place.flatten());
    }
    let missing = (0..encoders.len()).map(Some).chain([None]).find(|place| !order.contains(place));
    if let Some(place) = missing {
        let who = place.map_or("the master", |at| encoders[at].plan.name.as_str());
        table.fault(
            table.span_of("cable"),
            format!("{who} is not in the cable"),
            "write everybody once, in order",
        );
        return usual();
    }
    order
}

/// The encoders in the order of the cable, with their termination switches.
fn placed(table: &Reader<'_>, found: Vec<Found>, order: &[Option<usize>]) -> (Vec<EncoderPlan>, MasterTap) {
    let last = order.len().saturating_sub(1);
    let at_end = |place: usize| place == 0 || place == last;
    let place = order.iter().position(Option::is_none).unwrap_or(0);
    let terminated = table.boolean("master_terminated").unwrap_or(at_end(place));
    let mut waiting: Vec<_> = found.into_iter().map(Some).collect();
    let placed = order.iter().enumerate().filter_map(|(place, who)| {
        let Found { mut plan, termination } = waiting.get_mut((*who)?)?.take()?;
        plan.termination = termination.switches(at_end(place));
        Some(plan)
    });
    let encoders = placed.collect();
    (encoders, MasterTap { place, terminated })
}
