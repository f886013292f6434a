//! Reading `[segment.master]`.

use master::{Parameters as StandardPart, Watchdog};
use profibus_dp::time::{Duration, Instant};
use sch108bex::end_cap::STATION_ADDRESSES;
use sch108bex::functionality::Functionality;
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};

use super::encoders::ident;
use super::fault::{nearest, quoted};
use super::reader::{At, Reader};
use super::{EncoderPlan, LONGEST, MasterPlan, PollPlan};

/// Whom a master can ask at most.
const MOST: usize = 126;
/// Octets of Set_Prm after the standard ones, and of Chk_Cfg.
const MOST_OCTETS: usize = 237;

pub(super) fn master(table: &Reader<'_>, segment: &str, encoders: &[EncoderPlan]) -> MasterPlan {
    let byte = |name, most| table.integer(name, 0, most).and_then(|value| u8::try_from(value).ok());
    let cycle = table.time("cycle", Duration::from_micros(10), Duration::from_secs(3_600));
    let start = table.time("start", Duration::ZERO, LONGEST).unwrap_or(Duration::ZERO);
    let mut polls: Vec<PollPlan> = Vec::new();
    for entry in table.tables("poll", MOST) {
        for poll in entries(&entry, segment, encoders) {
            if polls.iter().any(|other| other.encoder == poll.encoder) {
                let message = format!("{} is in the poll list twice", poll.encoder);
                entry.fault(entry.span_of("encoder"), message, "a master asks each encoder once a cycle");
                break;
            }
            polls.push(poll);
        }
    }
    MasterPlan {
        address: byte("address", 125).unwrap_or(2),
        retries: byte("retries", 8).unwrap_or(1),
        cycle: cycle.unwrap_or(Duration::from_millis(10)),
        start: Instant::ZERO + start,
        polls,
    }
}

/// One entry, or one for each encoder that a `count` has made.
fn entries(table: &Reader<'_>, segment: &str, encoders: &[EncoderPlan]) -> Vec<PollPlan> {
    let name = table.text("encoder");
    let Some(At { value, span }) = table.required("encoder", name) else {
        return Vec::new();
    };
    let full = if value.contains('.') { value.to_owned() } else { format!("{segment}.{value}") };
    let counted = |name: &str| {
        let number = name.strip_prefix(&full).and_then(|rest| rest.strip_prefix('-'));
        number.is_some_and(|number| number.parse::<u8>().is_ok())
    };
    let exact = encoders.iter().filter(|encoder| encoder.name == full);
    let mut meant: Vec<_> = exact.collect();
    if meant.is_empty() {
        meant = encoders.iter().filter(|encoder| counted(&encoder.name)).collect();
    }
    if meant.is_empty() {
        let hint = match nearest(&full, encoders.iter().map(|encoder| encoder.name.as_str())) {
            Some(near) => format!("is \"{near}\" meant?"),
            None => "write the name of an encoder of this segment".to_owned(),
        };
        table.fault(span, format!("there is no encoder {} on this segment", quoted(value)), hint);
    }
    meant.into_iter().filter_map(|encoder| poll(table, encoder)).collect()
}

fn poll(table: &Reader<'_>, encoder: &EncoderPlan) -> Option<PollPlan> {
    let functionality = match table.one_of("functionality") {
        Some(0) => Functionality::Class1,
        Some(1) => Functionality::Class2,
        _ => Functionality::Scancon2,
    };
    let own = octets(table, "parameters");
    let user = match own {
        Some(octets) => octets,
        None => parameters(table, encoder, functionality),
    };
    let standard = StandardPart {
        ident_number: ident(table).unwrap_or(encoder.identity.ident_number),
        watchdog: watchdog(table),
        min_tsdr: 11,
        user,
        ..StandardPart::default()
    };
    let configuration = octets(table, "configuration");
    Some(PollPlan {
        encoder: encoder.name.clone(),
        address: address(table, encoder)?,
        set_prm: standard.set_prm(),
        ident_of_encoder: table.raw("ident").is_none(),
        configuration: configuration.unwrap_or_else(|| functionality.configuration().to_vec()),
        outputs: usize::from(functionality.outputs()),
    })
}

/// Where the master looks for it.
fn address(table: &Reader<'_>, encoder: &EncoderPlan) -> Option<u8> {
    if let Some(address) = table.integer("address", 1, 125) {
        return u8::try_from(address).ok();
    }
    let switches = encoder.identity.switches.0;
    if STATION_ADDRESSES.contains(&switches) {
        return Some(switches);
    }
    if table.raw("address").is_none() {
        let message = format!("the switches of {} give it no address to be asked at", encoder.name);
        table.fault(table.span_of("encoder"), message, "add `address`, the one that it will have");
    }
    None
}

/// Set_Prm from octet 8 on.
fn parameters(table: &Reader<'_>, encoder: &EncoderPlan, functionality: Functionality) -> Vec<u8> {
    let variant = encoder.identity.variant;
    let word = |name| table.integer(name, 1, i64::from(u32::MAX)).and_then(|value| u32::try_from(value).ok());
    let (units, range) = (word("measuring_units_per_revolution"), word("total_measuring_range"));
    let scaled = units.is_some() || range.is_some();
    if scaled && functionality == Functionality::Class1 {
        let name = if units.is_some() { "measuring_units_per_revolution" } else { "total_measuring_range" };
        table.fault(
            table.span_of(name),
            "class 1 has no scaling (manual 4.1)",
            "choose class_2 or scancon_2",
        );
    }
    let units = units.unwrap_or(variant.steps_per_revolution());
    let whole = u64::from(units) * u64::from(variant.revolutions());
    let parameters = Parameters {
        length: functionality.parameter_length(),
        code_sequence: match table.one_of("code_sequence") {
            Some(1) => CodeSequence::CounterClockwise,
            _ => CodeSequence::Clockwise,
        },
        scaling: scaled,
        measuring_units_per_revolution: units,
        total_measuring_range: range.unwrap_or(u32::try_from(whole).unwrap_or(u32::MAX)),
        time_base: match table.one_of("time_base") {
            Some(0) => TimeBase::Per10Ms,
            Some(2) => TimeBase::Per1000Ms,
            Some(3) => TimeBase::Rpm,
            _ => TimeBase::Per100Ms,
        },
    };
    let mut set_prm = [0; 26];
    let length = parameters.emit(&mut set_prm);
    // Octet 8 is the ASIC's.
    set_prm.get(7..length).unwrap_or_default().to_vec()
}

fn watchdog(table: &Reader<'_>) -> Option<Watchdog> {
    let span = table.time("watchdog", Duration::ZERO, Duration::from_millis(650_250))?;
    if span == Duration::ZERO { None } else { Watchdog::at_least(span).ok() }
}

/// Octets in hexadecimal digits, with blanks or without.
pub(super) fn octets(table: &Reader<'_>, name: &str) -> Option<Vec<u8>> {
    let At { value, span } = table.text(name)?;
    let digits: Vec<u8> = value.bytes().filter(|octet| !octet.is_ascii_whitespace()).collect();
    let octets: Option<Vec<u8>> = digits
        .chunks(2)
        .map(|pair| match pair {
            [high, low] => {
                let digit =
                    |digit: u8| char::from(digit).to_digit(16).and_then(|digit| u8::try_from(digit).ok());
                Some(digit(*high)? << 4 | digit(*low)?)
            }
            _ => None,
        })
        .collect();
    let octets = octets.filter(|octets| octets.len() <= MOST_OCTETS);
    if octets.is_none() {
        let hint = format!("write two digits for each octet, like \"00 0A\", at most {MOST_OCTETS} octets");
        table.fault(span, format!("`{name}` is no hexadecimal octets"), hint);
    }
    octets
}
