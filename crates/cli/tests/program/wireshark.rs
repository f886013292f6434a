//! Our dissector for Wireshark, as tshark runs it, on captures that the program has made.
//!
//! They need tshark 4, which `SCH108BEX_TSHARK` names.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use capture::{LinkType, Packet, Writer};
use serde_json::Value;
use tempfile::tempdir;

use crate::driver::{end_of, program, run};
use crate::master::{CLASS_2, Master};
use crate::tools::tshark;

/// The fields of a packet by their names; a name can come more than once.
type Fields = BTreeMap<String, Vec<String>>;

/// What tshark makes of a capture with our dissector; that must have no fault.
#[track_caller]
fn dissected(tshark: &Path, capture: &Path) -> Vec<Fields> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../wireshark/profibus_dp.lua");
    let home = tempdir().unwrap();
    let mut command = Command::new(tshark);
    command.env("HOME", home.path()).env("XDG_CONFIG_HOME", home.path());
    command.arg("-X").arg(format!("lua_script:{}", script.display()));
    // Two passes, so that a request knows its answer.
    command.args(["-2", "-n", "-T", "json", "--no-duplicate-keys", "-r"]).arg(capture);
    let output = command.output().expect("tshark starts");
    let (text, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && !errors.contains("Lua:"), "{errors}");
    assert!(!text.contains("Lua Error") && !text.contains("Dissector bug"), "{text}");
    let packets: Vec<Value> = serde_json::from_str(&text).expect("JSON");
    packets
        .iter()
        .map(|packet| {
            let mut fields = Fields::new();
            collect("", packet, &mut fields);
            fields
        })
        .collect()
}

fn collect(name: &str, value: &Value, into: &mut Fields) {
    match value {
        Value::Object(object) => object.iter().for_each(|(name, value)| collect(name, value, into)),
        Value::Array(values) => values.iter().for_each(|value| collect(name, value, into)),
        Value::String(text) => into.entry(name.to_owned()).or_default().push(text.clone()),
        _ => {}
    }
}

/// The one value of a field.
#[track_caller]
fn field<'a>(fields: &'a Fields, name: &str) -> &'a str {
    let values = fields.get(&format!("profibus_dp.{name}"));
    let values = values.unwrap_or_else(|| panic!("no {name} in {fields:#?}"));
    assert_eq!(values.len(), 1, "{name}: {values:?}");
    &values[0]
}

/// The same as a number.
#[track_caller]
fn number(fields: &Fields, name: &str) -> i64 {
    as_number(field(fields, name)).unwrap_or_else(|| panic!("{name} is no number in {fields:#?}"))
}

fn as_number(text: &str) -> Option<i64> {
    match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

fn octets(text: &str) -> Vec<u8> {
    dissector::hex::octets(text).expect("hex")
}

/// A capture of these telegrams.
fn captured(path: &Path, link_type: LinkType, telegrams: &[&str]) {
    let mut writer = Writer::new(fs::File::create(path).unwrap(), link_type, "bus").unwrap();
    for (at, text) in (0..).zip(telegrams) {
        let packet = Packet { nanos: at * 1_000, octets: octets(text), ..Packet::default() };
        writer.write(&packet).unwrap();
    }
}

/// DP slave reference 1.5, 3.5 and 3.6: a start-up and whatever else there is, good and bad.
const CORPUS: &[&str] = &[
    "10 0B 02 49 56 16",
    "10 02 0B 00 0D 16",
    "68 05 05 68 8B 82 6D 3C 3E F4 16",
    "68 0B 0B 68 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16",
    "68 1F 1F 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 0A 00 00 20 00 02 00 00 00 00 00 00 00 00 00 00 00 01 12 16",
    "E5",
    "68 08 08 68 8B 82 7D 3E 3E F1 D1 D1 99 16",
    "E5",
    "68 05 05 68 8B 82 5D 3C 3E E4 16",
    "68 3E 3E 68 82 8B 08 3E 3C 00 0C 00 02 47 11 33 00 0A 02 00 00 20 00 10 00 00 00 03 00 00 00 36 01 01 01 01 \
     00 00 00 3D 00 00 00 00 00 00 00 00 00 00 20 00 02 00 00 00 31 32 33 34 35 36 20 20 20 20 B5 16",
    "68 07 07 68 0B 02 7D 00 00 00 00 8A 16",
    "68 0F 0F 68 02 0B 08 00 12 34 56 00 00 00 64 FF FF FF F6 08 16",
    "68 07 07 68 0B 02 7D 00 00 00 00 8A 16",
    "68 0F 0F 68 02 0B 08 00 12 34 56 00 00 00 64 FF FF FF F6 08 16",
    "68 07 07 68 0B 02 5D 80 00 10 00 FA 16",
    "68 05 05 68 8B 82 5D 3B 3E E3 16",
    "68 06 06 68 82 8B 08 3E 3B F1 7F 16",
    "68 05 05 68 8B 82 5D 38 3E E0 16",
    "68 09 09 68 82 8B 08 3E 38 00 12 34 56 27 16",
    "68 05 05 68 8B 82 7D 39 3E 01 16",
    "68 09 09 68 82 8B 08 3E 39 00 00 00 00 8C 16",
    "68 09 09 68 FE 82 6D 37 3E 0B 47 11 00 C5 16",
    "E5",
    "68 07 07 68 FF 82 46 3A 3E 20 01 60 16",
    "68 07 07 68 FF 82 46 3A 3E 02 00 41 16",
    "A2 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16",
    "68 15 15 68 82 8B 08 3E 3C 00 0C 00 02 47 11 0A 00 00 02 00 00 20 00 10 00 31 16",
    "68 0E 0E 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 00 E5 16",
    "68 0C 0C 68 8B 82 7D 3D 3E 40 00 00 00 47 11 00 9D 16",
    "68 0C 0C 68 8B 82 7D 3D 3E 00 00 00 20 00 00 00 25 16",
    "10 0B 02 7D 8A 16",
    "10 02 0B 03 10 16",
    "DC 03 02",
    "E5",
    "68 0B 0B 68 81 88 08 3E 3C 02 05 00 FF 80 E0 F1 16",
    "68 08 08 68 81 88 08 3E 3B 00 10 10 AA 16",
    "68 0F 0F 68 82 E3 5D 3D 3E B8 05 01 00 0C DA 01 40 00 00 22 16",
    "10 02 63 49 AE 16",
    "10 0B 02 49 57 16",
    "10 0B 02 49 56 17",
    "68 05 05 69 8B 82 6D 3C 3E F4 16",
    "68 05 06 68 8B 82 6D 3C 3E F4 16",
    "68 05 05 68 8B 82",
    "10 8B 82 6D 7A 16",
    // Twice the beginning of a sequence: the second is no retry.
    "68 05 05 68 8B 82 6D 3C 3E F4 16",
    "68 05 05 68 8B 82 6D 3C 3E F4 16",
];

// What stands in the telegrams of the reference, read by hand.
#[test]
fn tshark_shows_the_values_of_the_references_telegrams() {
    let test = "program::wireshark::tshark_shows_the_values_of_the_references_telegrams";
    let Some(tshark) = tshark(test) else { return };
    let directory = tempdir().unwrap();
    for link_type in [LinkType::User0, LinkType::ProfibusDl] {
        let path = directory.path().join("corpus.pcapng");
        captured(&path, link_type, CORPUS);
        let packets = dissected(&tshark, &path);
        assert_eq!(packets.len(), CORPUS.len());
        for (at, due) in [
            (0, &[("da", 11), ("sa", 2), ("function", 9), ("fcb", 0), ("response_in", 2)][..]),
            (1, &[("da", 2), ("sa", 11), ("response_code", 0), ("station_type", 0), ("response_to", 1)]),
            (2, &[("dsap", 60), ("ssap", 62), ("fcb", 1), ("fcv", 0), ("le", 5)]),
            (3, &[("station_not_ready", 1), ("prm_req", 1), ("master_add", 255), ("ident_number", 0x4711)]),
            (
                4,
                &[
                    ("lock_req", 1),
                    ("wd_on", 1),
                    ("wd_fact_2", 20),
                    ("min_tsdr", 11),
                    ("encoder.scaling", 1),
                    ("encoder.measuring_units_per_revolution", 8192),
                    ("encoder.total_measuring_range", 33_554_432),
                    ("encoder.time_base", 1),
                ],
            ),
            (5, &[("response_to", 5)]),
            (
                9,
                &[
                    ("encoder.alarms", 0),
                    ("encoder.warnings", 0),
                    ("encoder.supported_warnings", 0x36),
                    ("encoder.singleturn_resolution", 8192),
                    ("encoder.revolutions", 4096),
                    ("encoder.operating_time", 61),
                    ("encoder.total_measuring_range", 33_554_432),
                    ("wd_on", 1),
                    ("master_add", 2),
                ],
            ),
            (
                11,
                &[("encoder.position", 0x12_3456), ("encoder.velocity", 100), ("encoder.acceleration", -10)],
            ),
            (12, &[("retry", 1)]),
            (14, &[("encoder.preset", 1), ("encoder.preset_value", 0x1000), ("fcb", 0)]),
            (21, &[("new_slave_add", 11), ("da", 126)]),
            (23, &[("sync", 1), ("group_select", 1), ("da", 127)]),
            (24, &[("clear_data", 1)]),
            (28, &[("unlock_req", 1), ("lock_req", 0)]),
            (31, &[("response_code", 3)]),
        ] {
            for (name, value) in due {
                assert_eq!(number(&packets[at], name), *value, "{name} of telegram {at}");
            }
        }
        for (at, due) in [
            (3, ("state", "waits for parameters")),
            (5, ("service", "Set_Prm")),
            (9, ("state", "in data exchange")),
            (11, ("service", "Data_Exchange")),
            (32, ("direction", "token")),
        ] {
            assert_eq!(field(&packets[at], due.0), due.1, "telegram {at}");
        }
        assert_eq!(field(&packets[9], "encoder.serial_number").trim_end(), "123456");
        let wrong = [(38, "fcs"), (39, "ed"), (40, "sd"), (41, "le"), (42, "short"), (43, "sap")];
        for (at, packet) in packets.iter().enumerate() {
            let due = wrong.iter().find(|(bad, _)| *bad == at).map(|(_, name)| *name);
            let has = |name: &str| packet.contains_key(&format!("profibus_dp.expert.{name}"));
            for (_, name) in wrong {
                assert_eq!(has(name), due == Some(name), "{name} of telegram {at}: {packet:#?}");
            }
        }
    }
}

/// Everything that both `decode --json` and tshark tell of each packet is the same.
#[track_caller]
fn compare(tshark: &Path, path: &Path) -> (usize, usize) {
    let packets = dissected(tshark, path);
    let ended = end_of(program().args(["decode", "--json"]).arg(path));
    let entries = ended.output.lines().map(|line| serde_json::from_str::<Value>(line).expect("a document"));
    let entries: Vec<Value> = entries.filter(|entry| entry["kind"] != "note").collect();
    let packets: Vec<_> = packets.iter().filter(|packet| packet["frame.len"] != ["0"]).collect();
    assert_eq!(entries.len(), packets.len(), "{}", ended.errors);
    let (mut fields, mut bad) = (0, 0);
    for (entry, packet) in entries.iter().zip(packets) {
        let told = |name: &str| packet.get(&format!("profibus_dp.{name}")).map(|values| values[0].as_str());
        if entry["kind"] != "telegram" {
            bad += 1;
            let faults = ["fcs", "ed", "sd", "le", "short", "sap"];
            assert!(
                faults.iter().any(|name| told(&format!("expert.{name}")).is_some()),
                "{entry} {packet:#?}"
            );
            continue;
        }
        assert_eq!(told("retry").is_some(), entry["retry"] == true, "{entry} {packet:#?}");
        assert_eq!(told("direction"), entry["direction"].as_str(), "{entry}");
        if entry["service"] != "other" {
            assert_eq!(told("service"), entry["service"].as_str(), "{entry} {packet:#?}");
        }
        for field in entry["fields"].as_array().expect("fields") {
            let name = field["name"].as_str().expect("a name").to_lowercase();
            let due = match &field["value"] {
                Value::Bool(bit) => i64::from(*bit),
                Value::Number(number) => number.as_i64().expect("a number"),
                _ => continue,
            };
            let got = told(&name).and_then(as_number);
            assert_eq!(got, Some(due), "{name} of {entry}\n{packet:#?}");
            fields += 1;
        }
    }
    (fields, bad)
}

#[test]
fn tshark_and_decode_tell_the_same_of_the_references_telegrams() {
    let test = "program::wireshark::tshark_and_decode_tell_the_same_of_the_references_telegrams";
    let Some(tshark) = tshark(test) else { return };
    let directory = tempdir().unwrap();
    let path = directory.path().join("corpus.pcapng");
    captured(&path, LinkType::User0, CORPUS);
    let (fields, bad) = compare(&tshark, &path);
    assert!(fields > 250 && bad == 6, "{fields} fields, {bad} bad telegrams");
}

#[test]
fn tshark_and_decode_tell_the_same_of_a_captured_run() {
    let test = "program::wireshark::tshark_and_decode_tell_the_same_of_a_captured_run";
    let Some(tshark) = tshark(test) else { return };
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    let mut program =
        run(["--switches", "05", "--shaft", "constant:60", "--capture", path.to_str().unwrap()]);
    let mut master: Master = program.master(5);
    master.start_up(CLASS_2, &[0xF1]);
    for _ in 0..20 {
        master.exchange(&[0; 4]);
    }
    drop(master);
    program.wait_for(&["the master has closed the bus"]);
    program.end();
    let (fields, bad) = compare(&tshark, &path);
    assert!(fields > 200 && bad == 0, "{fields} fields, {bad} bad telegrams");
}
