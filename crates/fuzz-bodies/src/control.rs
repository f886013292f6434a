//! Control messages: lines, as a client sends them, done by a running plant.

use std::sync::mpsc;

use bus::memory::pair;
use bus::{End, Settings};
use plant::control::{COMMANDS, Envelope, Reply};
use plant::{EncoderSetup, Handle, Plant, Rate, Reporter, SegmentSetup, Shaft, Store, World};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use serde_json::Value;

use crate::tape::Tape;

/// More lines of one input are not looked at.
const LINES: usize = 30;

/// FDL status to station 11.
const STATUS: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

/// The first octet says which: lines as they are, or good ones with fields changed.
///
/// # Panics
///
/// When the plant does not live on, a request changes by being written down, or a reply is no line.
pub fn control(octets: &[u8]) {
    let Some((first, rest)) = octets.split_first() else { return };
    let lines: Vec<Vec<u8>> = if first & 1 == 0 {
        rest.split(|octet| *octet == b'\n').take(LINES).map(<[u8]>::to_vec).collect()
    } else {
        changed_examples(rest)
    };
    // Most lines are no requests, and need no plant.
    let parsed: Vec<_> = lines.iter().map(|line| Envelope::parse(line)).collect();
    for refused in parsed.iter().filter_map(|parsed| parsed.as_ref().err()) {
        is_one_line(&Reply::refused(refused.id.clone(), refused.error.clone()));
    }
    let requests: Vec<&Envelope> = parsed.iter().flatten().collect();
    if !requests.is_empty() {
        live(&requests);
    }
}

/// A plant does what is asked for, with a master that asks in between.
fn live(requests: &[&Envelope]) {
    let (end, mut master) = pair();
    let (to, _reports) = mpsc::channel();
    let segment = SegmentSetup {
        name: "bus".to_owned(),
        end: Box::new(end),
        settings: Settings::default(),
        encoders: [11, 12].map(setup).into(),
    };
    let mut plant = Plant::new();
    plant.add(segment, to).expect("a plant");
    let handle = plant.handle();
    for envelope in requests {
        let again = serde_json::to_vec(&envelope.request).expect("requests can be written");
        let same = Envelope::parse(&again).expect("what was written can be read").request;
        // Not more: the last digit of a number may be rounded.
        assert_eq!(same.name(), envelope.request.name());
        let _ = master.write(&STATUS).expect("memory never breaks");
        is_one_line(&obey(&handle, envelope));
        let seen = handle.snapshot().expect("the plant lives on");
        assert_eq!((seen.segments.len(), seen.encoders.len()), (1, 2));
    }
    plant.stop().expect("the plant ends in order");
}

fn obey(handle: &Handle, envelope: &Envelope) -> Reply {
    match handle.apply(&envelope.request) {
        Ok(applied) => Reply::done(envelope.id.clone(), applied),
        Err(error) => Reply::refused(envelope.id.clone(), error.to_string()),
    }
}

fn is_one_line(reply: &Reply) {
    let text = serde_json::to_string(reply).expect("replies can be written");
    assert!(!text.contains('\n') && text.len() < 1_000_000, "{text}");
    assert!(reply.ok || reply.error.as_ref().is_some_and(|error| !error.is_empty()), "{text}");
}

fn setup(address: u8) -> EncoderSetup {
    EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(address),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches::default(),
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new(&format!("encoder {address}"), None),
    }
}

/// The examples of the help, with fields that have other values, or are new, or gone.
fn changed_examples(octets: &[u8]) -> Vec<Vec<u8>> {
    let mut tape = Tape::new(octets);
    let mut lines = Vec::new();
    while !tape.is_over() && lines.len() < LINES {
        let command = &COMMANDS[usize::from(tape.octet()) % COMMANDS.len()];
        let mut object: Value = serde_json::from_str(command.example).expect("a good example");
        for _ in 0..tape.octet() % 3 {
            change(&mut object, &mut tape);
        }
        lines.push(serde_json::to_vec(&object).expect("an object can be written"));
    }
    lines
}

fn change(object: &mut Value, tape: &mut Tape<'_>) {
    let Value::Object(fields) = object else { return };
    let names: Vec<String> =
        fields.keys().cloned().chain(["encoder", "segment", "id", "count"].map(str::to_owned)).collect();
    let name = names[usize::from(tape.octet()) % names.len()].clone();
    let value = match tape.octet() % 12 {
        0 => Value::Null,
        1 => Value::from(tape.octet() & 1 == 0),
        2 => Value::from("all"),
        3 => Value::from(i64::from(tape.octet()) - 3),
        4 => Value::from(i64::from(tape.double().cast_signed()) << (tape.octet() % 32)),
        5 => Value::from(f64::from_bits(u64::from(tape.double()) << 32 | u64::from(tape.double()))),
        6 => Value::from(f64::from(tape.word()) / 65_536.0),
        7 => Value::from(tape.pick(&[
            "off",
            "on",
            "cycle",
            "low",
            "ok",
            "empty",
            "once",
            "held",
            "turns_lost",
        ])),
        8 => Value::from(tape.pick(&[
            "damage_a",
            "damage_b",
            "lost_at_power_on",
            "writes_fail",
            "constant:60@here",
        ])),
        9 => Value::from(String::from_utf8_lossy(tape.slice(4)).into_owned()),
        10 => Value::Array(vec![Value::from(1), Value::Null]),
        _ => {
            fields.remove(&name);
            return;
        }
    };
    fields.insert(name, value);
}
