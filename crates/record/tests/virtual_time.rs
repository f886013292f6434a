//! Recordings of scenarios in virtual time: every value is worked out by hand.

mod common;

use common::{Recorded, played, rows, table, values};
use record::Grade;

/// Shafts at 60 RPM: 65536 counts a second.
const TURNING: &str = r#"
duration = "2 s"

[[segment]]
name = "bus"
rate = 1500000

[[segment.encoder]]
name = "one"
switches = "05"
shaft = "constant:60"

[[segment.encoder]]
name = "two"
switches = "06"
shaft = "constant:60"

[[segment.encoder]]
name = "scancon"
switches = "07"
shaft = "constant:60"
per_revolution = "0.5 m"

[[segment.encoder]]
name = "rpm"
switches = "08"
shaft = "constant:-60"

[[segment.encoder]]
name = "alone"
switches = "09"
shaft = "constant:60"

[segment.master]
cycle = "5 ms"

[[segment.master.poll]]
encoder = "one"
functionality = "class_1"

[[segment.master.poll]]
encoder = "two"
functionality = "class_2"
measuring_units_per_revolution = 4096

[[segment.master.poll]]
encoder = "scancon"
measuring_units_per_revolution = 5000

[[segment.master.poll]]
encoder = "rpm"
time_base = "rpm"
"#;

/// The row of an encoder at a time, in the order of `columns`.
#[track_caller]
fn at(recorded: &Recorded, encoder: &str, millis: u64, columns: &[&str]) -> Vec<String> {
    let all = rows(recorded);
    let time = (millis * 1_000_000).to_string();
    let is_it = |row: &&common::Fields| {
        row["time_ns"] == time && row["encoder"] == encoder && row["event"].is_empty()
    };
    let found: Vec<_> = all.iter().filter(is_it).collect();
    assert_eq!(found.len(), 1, "{encoder} at {millis} ms");
    columns.iter().map(|column| found[0][*column].clone()).collect()
}

#[test]
fn a_constant_speed_is_recorded_in_each_functionality() {
    let recorded = played(TURNING, "csv");
    let columns = [
        "state",
        "functionality",
        "position",
        "velocity",
        "acceleration",
        "physical_position",
        "shaft_position",
        "rpm",
    ];
    let at = |encoder, millis| at(&recorded, encoder, millis, &columns);
    // One turn is 65536 counts; class 1 knows neither scaling nor velocity (manual 4.1.1).
    assert_eq!(at("bus.one", 1_000), ["data_exchange", "class_1", "65536", "0", "0", "65536", "65536", "60"]);
    // 4096 units a turn: 1.5 turns are 6144.
    assert_eq!(at("bus.two", 1_500), ["data_exchange", "class_2", "6144", "0", "0", "98304", "98304", "60"]);
    // 5000 units a turn are 500 in 100 ms.
    assert_eq!(
        at("bus.scancon", 1_500),
        ["data_exchange", "scancon_2", "7500", "500", "0", "98304", "98304", "60"]
    );
    // Counter-clockwise from 0 by 1.5 turns, of 2^31 counts.
    let below = (1_u64 << 31) - 98_304;
    let due = ["data_exchange", "scancon_2", &below.to_string(), "-60", "0", "-98304", "-98304", "-60"];
    assert_eq!(at("bus.rpm", 1_500), due);
    // Nobody asks it: it waits, without scaling.
    assert_eq!(at("bus.alone", 1_500), ["wait_prm", "", "98304", "0", "0", "98304", "98304", "60"]);
}

#[test]
fn machine_units_supply_and_temperature_stand_beside() {
    let recorded = played(TURNING, "csv");
    let columns =
        ["machine_position", "machine_unit", "supply_v", "temperature_c", "alarms", "warnings", "text"];
    // 1.5 turns of 0.5 m.
    let due = ["0.75", "m", "24", "20", "", "", ""];
    assert_eq!(at(&recorded, "bus.scancon", 1_500, &columns), due);
    assert_eq!(at(&recorded, "bus.two", 1_500, &columns), ["", "", "24", "20", "", "", ""]);
}

#[test]
fn every_encoder_has_a_row_every_ten_milliseconds_in_order_of_time() {
    let recorded = played(TURNING, "csv");
    let all = rows(&recorded);
    let times: Vec<u64> = all.iter().map(|row| row["time_ns"].parse().expect("a time")).collect();
    assert!(times.is_sorted());
    for encoder in ["bus.one", "bus.two", "bus.scancon", "bus.rpm", "bus.alone"] {
        let its = all.iter().filter(|row| row["encoder"] == encoder && row["event"].is_empty());
        let its: Vec<u64> = its.map(|row| row["time_ns"].parse().expect("a time")).collect();
        // Some telegram may end after the last step; nothing is due between.
        let due: Vec<u64> = (0..=200).map(|tick| tick * 10_000_000).collect();
        assert_eq!(its, due, "{encoder}");
    }
}

#[test]
fn the_rate_of_samples_can_be_that_of_the_latches_and_changes_nothing_else() {
    let slow = played(TURNING, "csv");
    let fast = common::played_every(TURNING, "csv", 500);
    assert_eq!(slow.sums, fast.sums, "the octets on the bus and their times");
    let columns = ["position", "velocity", "physical_position"];
    // 65536 counts a second are 32.768 in half a millisecond.
    let all = rows(&fast);
    let row = all.iter().find(|row| row["time_ns"] == "1000500000" && row["encoder"] == "bus.scancon");
    let row = row.expect("a row at 1000.5 ms");
    assert_eq!(columns.map(|column| row[column].clone()), ["5002", "500", "65568"]);
    for millis in [10, 500, 1_990] {
        assert_eq!(at(&slow, "bus.scancon", millis, &columns), at(&fast, "bus.scancon", millis, &columns));
    }
}

const STORY: &str = r#"
duration = "6 s"

[[segment]]
name = "bus"
rate = 500000

[[segment.encoder]]
name = "it"
switches = "05"

[segment.master]
cycle = "5 ms"

[[segment.master.poll]]
encoder = "it"

[[event]]
at = "1 s"
do = "preset"
encoder = "bus.it"
value = 100000

[[event]]
at = "2 s"
do = "supply"
volts = 8.5

[[event]]
at = "3 s"
do = "supply"
volts = 3

[[event]]
at = "4 s"
do = "supply"
volts = 24

[[event]]
at = "5 s"
do = "temperature"
celsius = 70
"#;

#[test]
fn a_preset_is_a_jump_and_an_event_with_its_sentence() {
    let recorded = played(STORY, "csv");
    let columns = ["position", "physical_position"];
    // The row at an event's moment shows what was before it.
    assert_eq!(at(&recorded, "bus.it", 1_000, &columns), ["0", "0"]);
    assert_eq!(at(&recorded, "bus.it", 1_020, &columns), ["100000", "0"]);
    let all = rows(&recorded);
    let preset: Vec<_> = all.iter().filter(|row| row["event"] == "preset_taken").collect();
    assert_eq!(preset.len(), 1);
    assert!(preset[0]["text"].contains("100000"), "{:?}", preset[0]);
    let time: u64 = preset[0]["time_ns"].parse().expect("a time");
    assert!((1_000_000_000..1_010_000_000).contains(&time), "within two cycles: {time}");
    for column in ["position", "rpm", "state", "supply_v"] {
        assert_eq!(preset[0][column], "", "an event has no {column}");
    }
}

#[test]
fn alarms_warnings_and_no_power_are_recorded_and_become_bands() {
    let recorded = played(STORY, "csv");
    let columns = ["state", "position", "alarms", "warnings", "supply_v", "temperature_c", "shaft_position"];
    let at = |millis| at(&recorded, "bus.it", millis, &columns);
    assert_eq!(at(2_000), ["data_exchange", "100000", "", "", "24", "20", "0"]);
    assert_eq!(at(2_010), ["data_exchange", "100000", "supply_voltage", "", "8.5", "20", "0"]);
    assert_eq!(at(3_010), ["off", "", "", "", "3", "20", "0"]);
    // The offset is kept (manual 4.2.14).
    assert_eq!(at(4_500), ["data_exchange", "100000", "", "", "24", "20", "0"]);
    assert_eq!(at(5_010), ["data_exchange", "100000", "", "temperature_exceeded", "24", "70", "0"]);
    let table = table(&recorded, &["position"]);
    let curve = table.curves.iter().find(|curve| curve.encoder == "bus.it").expect("it");
    let bands: Vec<_> = curve
        .bands
        .iter()
        .map(|band| (band.grade, band.words.as_str(), band.from / 1_000_000, band.to / 1_000_000))
        .collect();
    let due = [
        (Grade::Alarm, "supply_voltage", 2_010, 3_000),
        (Grade::Off, "off", 3_010, 4_000),
        (Grade::Warning, "temperature_exceeded", 5_010, 6_000),
    ];
    assert_eq!(bands, due);
    let kinds: Vec<_> = curve.marks.iter().map(|mark| mark.kind.as_str()).collect();
    for kind in
        ["power_on", "data_exchange_entered", "preset_taken", "alarm_raised", "power_off", "warning_raised"]
    {
        assert!(kinds.contains(&kind), "{kind} in {kinds:?}");
    }
}

#[test]
fn two_runs_give_the_same_file_whatever_the_steps() {
    for format in common::FORMATS {
        let (one, other) = (played(STORY, format), played(STORY, format));
        assert!(one.octets == other.octets, "{format}");
        let in_other_steps = common::played_with(STORY, format, 10_000, 7);
        assert!(one.octets == in_other_steps.octets, "{format} in steps of 7 ms");
    }
}

#[cfg(feature = "parquet")]
#[test]
fn both_formats_hold_the_same() {
    for story in [STORY, TURNING] {
        let (lines, columns) = (played(story, "csv"), played(story, "parquet"));
        let all: Vec<_> = record::numbers().map(|column| column.name).collect();
        let (one, other) = (table(&lines, &all), table(&columns, &all));
        // What is nothing is not equal to itself, but looks the same.
        assert_eq!(format!("{one:?}"), format!("{other:?}"));
        assert!(one.samples() >= 601);
    }
}

#[test]
fn what_is_chosen_of_a_recording_is_all_that_comes() {
    let recorded = played(TURNING, common::FORMATS[common::FORMATS.len() - 1]);
    let chosen = ["bus.two".to_owned()];
    let table = common::chosen(&recorded, &["position", "rpm"], &chosen, 500_000_000..=520_000_000);
    let table = table.expect("a table");
    assert_eq!(table.curves.len(), 1);
    assert_eq!(table.curves[0].times, [500_000_000, 510_000_000, 520_000_000]);
    // Half a turn of 4096, and 40.96 more every 10 ms, rounded down.
    assert_eq!(values(&table, "bus.two"), [vec![2048.0, 2088.0, 2129.0], vec![60.0; 3]]);
    let nobody = common::chosen(&recorded, &[], &["crane".to_owned()], 0..=u64::MAX).expect_err("nobody");
    assert!(
        nobody.to_string().contains("has no encoder \"crane\"; it has \"bus.one\", \"bus.two\""),
        "{nobody}"
    );
}
