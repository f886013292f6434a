//! What surrounds encoders of a scenario: the cable, machines and drums, worlds, files, and who comes later.

use std::path::Path;

use plant::scenario::{Outcome, Scenario, run};
use sch108bex::configuration::Configurations;

/// A hoist on a segment with a master that asks it; `SEGMENT` and `ENCODER` stand for further keys.
const BASE: &str = "[[segment]]\nname = \"crane\"\nrate = 1500000\nSEGMENT\n[[segment.encoder]]\nname = \"hoist\"\n\
                    switches = \"05\"\nENCODER\n[segment.master]\nMASTER\n[[segment.master.poll]]\nencoder = \"hoist\"\n";

fn with(encoder: &str, rest: &str) -> String {
    BASE.replace("SEGMENT", "").replace("MASTER", "").replace("ENCODER", encoder) + rest
}

#[track_caller]
fn parsed(source: &str) -> Scenario {
    Scenario::parse(source).unwrap_or_else(|faults| panic!("{}", faults.render("scenario", source)))
}

#[track_caller]
fn played(source: &str) -> Outcome {
    run(&parsed(source), source, &mut ()).expect("it is played")
}

#[track_caller]
fn holds(source: &str) {
    let outcome = played(source);
    assert!(outcome.passed, "{source}\n{:#?} {:?}", outcome.expectations, outcome.troubles);
}

#[track_caller]
fn told(source: &str) -> String {
    Scenario::parse(source).expect_err("it is none").render("f", source)
}

fn expect(at: f64, what: &str) -> String {
    format!("[[expect]]\nat = {at}\n{what}\n")
}

/// Encoders 3, 4 and 5 with the master between the first two: 3 M 4 5.
fn cable(rest: &str) -> String {
    let encoder = |name: &str, switches: &str| {
        format!("[[segment.encoder]]\nname = \"{name}\"\nswitches = \"{switches}\"\n")
    };
    let poll = |name: &str| format!("[[segment.master.poll]]\nencoder = \"{name}\"\n");
    format!(
        "[[segment]]\nname = \"bus\"\ncable = [\"a\", \"master\", \"b\", \"c\"]\n{}{}{}[segment.master]\n{}{}{}{rest}",
        encoder("b", "04"),
        encoder("a", "03"),
        encoder("c", "05"),
        poll("a"),
        poll("b"),
        poll("c"),
    )
}

fn exchanging(at: f64, who: [bool; 3]) -> String {
    let one = |(name, is)| format!("[[expect]]\nat = {at}\nencoder = \"bus.{name}\"\nexchanging = {is}\n");
    ["a", "b", "c"].into_iter().zip(who).map(one).collect()
}

// The master's place is that of the `cable`: a cut says how many devices are in front of it, no more.
#[test]
fn a_cut_takes_those_on_the_far_side_of_where_the_master_is() {
    for (after, left) in
        [(1, [false, true, true]), (2, [true, false, false]), (3, [true, true, false]), (4, [true; 3])]
    {
        holds(&cable(&format!(
            "[[event]]\nat = 1\ndo = \"cut\"\nafter = {after}\n[[event]]\nat = 2\ndo = \"mend\"\n{}{}{}",
            exchanging(1.0, [true; 3]),
            exchanging(1.5, left),
            exchanging(3.0, [true; 3]),
        )));
    }
    // Whoever says where the master is, is believed: 3 4 5 M.
    holds(&cable(&format!(
        "[[event]]\nat = 1\ndo = \"cut\"\nafter = 2\nmaster_after = 3\n{}",
        exchanging(1.5, [false, false, true]),
    )));
}

/// Failures of a bus at 12 Mbit/s whose keys are `segment`, in two seconds.
fn failures(segment: &str, encoder: &str) -> u64 {
    let source = BASE.replace("1500000", "12000000").replace("SEGMENT", segment).replace("ENCODER", encoder);
    let source = source.replace("MASTER", "cycle = \"1 ms\"\nretries = 0");
    let outcome = played(&format!("duration = 2\n{source}"));
    outcome.segments[0].encoders.iter().map(|encoder| encoder.failures).sum()
}

// Manual 3.3: the bus is terminated at both ends. At 12 Mbit/s each device that is wrong flips 0.3 % of the bits.
#[test]
fn reflections_come_of_a_wrong_termination_alone_and_only_where_they_are_asked_for() {
    assert_eq!(failures("reflections = true", ""), 0);
    assert_eq!(failures("", "termination = \"off\""), 0);
    let one = failures("reflections = true", "termination = \"off\"");
    let master = failures("reflections = true\nmaster_terminated = false", "");
    let both = failures("reflections = true\nmaster_terminated = false", "termination = \"off\"");
    assert!(one > 50 && master > 50 && both > one && both > master, "{one} {master} {both}");
}

/// A bare drum of 0.97 m with rope of 30 mm, ten turns in a layer: in the first layer the middle of the rope runs
/// on a circle of 1.00 m, in the second of 1.06 m.
const DRUM: &str =
    "machine = { unit = \"m\", drum = { drum_diameter = 0.97, rope_diameter = 0.03, turns_per_layer = 10 } }";

// pi m a turn in the first layer: 5 turns 15.708 m. 10 turns 31.416 m, and 5 more of pi * 1.06 m: 48.066 m.
#[test]
fn rope_on_a_drum_is_expected_layer_by_layer() {
    let turning = format!("{DRUM}\nshaft = \"constant:60\"");
    let near = |at, metres| expect(at, &format!("position = \"{metres} m\"\nwithin = \"1 mm\""));
    holds(&with(&turning, &(near(5.0, 15.708) + &near(15.0, 48.066))));
    let outcome = played(&with(&turning, &near(15.0, 47.124)));
    assert!(!outcome.passed, "15 turns as if all were in the first layer");
    // The drum of a shaft counts without a key of its own: 9.42 m of rope are 3 turns of the first layer.
    let hoist = "shaft = \"hoist:unit=m:by=9.4248:speed=10:acceleration=10:pause_s=9:drum_diameter=0.97:rope_diameter=0.03:turns_per_layer=10@0\"";
    holds(&with(hoist, &near(5.0, 9.4248)));
    holds(&with(hoist, &expect(5.0, "position = 196608\nwithin = 2")));
}

#[test]
fn machines_have_units_a_zero_and_a_ring() {
    let machine = |fields: &str, raw: u32| format!("machine = {{ {fields} }}\nshaft = \"still@{raw}\"");
    let is = |text: &str| expect(1.0, &format!("position = \"{text}\"\nwithin = \"1 mm\""));
    let degrees = |text: &str| expect(1.0, &format!("position = \"{text}\"\nwithin = \"0.01 deg\""));
    holds(&with(&machine("unit = \"mm\", per_turn = 500", 131_072), &is("1 m")));
    holds(&with(&machine("per_turn = -0.5", 131_072), &is("-1 m")));
    // Half a turn, from a quarter of a turn on.
    holds(&with(&machine("unit = \"deg\", per_turn = 360, zero = 16384", 32_768), &degrees("90 deg")));
    // A turn before 0 is the last one of the range of 2^31 steps.
    holds(&with(&machine("per_turn = 1", 2_147_418_112), &is("-1 m")));
    assert!(!played(&with(&machine("per_turn = 1", 2_147_418_112), &is("1 m"))).passed);
    // What the master reads, whatever scaling makes of it: 1000 units a revolution.
    let scaled =
        with(&machine("per_turn = 0.5", 98_304), "measuring_units_per_revolution = 1000\n") + &is("0.75 m");
    holds(&scaled);
}

#[test]
fn worlds_that_change_begin_with_the_encoder() {
    let flag = |at, warning: &str| expect(at, &format!("warnings = [{warning}]"));
    // 20 to 70 degrees with 600 s: 65 after 600 * ln 10 = 1381.6 s.
    let slow = |encoder| {
        BASE.replace("SEGMENT", "").replace("MASTER", "cycle = \"1 s\"").replace("ENCODER", encoder)
    };
    holds(&format!(
        "{}{}{}",
        slow("thermal = { ambient = 20, time_constant_s = 600, kelvin_per_watt = 25, watts = 2 }"),
        flag(1_370.0, ""),
        flag(1_395.0, "\"temperature_exceeded\""),
    ));
    // 3.6 s under power.
    holds(&with("led_ageing = 0.001", &(flag(3.5, "") + &flag(3.7, "\"light_control_reserve\""))));
    // One percent of 36 s is 0.36 s.
    holds(&with(
        "discharge = { charge = 21, hours_without_power = 1, hours_with_power = 0.01 }",
        &(flag(0.3, "") + &flag(0.4, "\"battery_charge\"")),
    ));
    holds(&with(
        "supply_profile = { points = [[0, 24], [1, 24], [1, 8], [2, 8], [2, 24]] }",
        &(expect(0.9, "alarms = []")
            + &expect(1.5, "alarms = [\"supply_voltage\"]")
            + &expect(2.5, "alarms = []")),
    ));
    let preset = "[[event]]\nat = 1\ndo = \"preset\"\nencoder = \"crane.hoist\"\nvalue = 7\n[[expect]]\nevent = \"not_stored\"\n";
    holds(&with("endurance = 0", preset));
    holds(&with("endurance = 1000", &format!("{preset}seen = false\n")));
}

// The battery alone keeps the turn count: empty without power, the next power-on has a position error.
#[test]
fn a_battery_that_dies_in_the_dark_loses_the_turns() {
    let off_for = |seconds: u32| {
        format!(
            "[[event]]\nat = 1\ndo = \"power\"\nstate = \"off\"\n[[event]]\nat = {}\ndo = \"power\"\nstate = \"on\"\n",
            1 + seconds
        )
    };
    // 36 s a full one.
    let encoder = "shaft = \"still@200000\"\ndischarge = { charge = 50, hours_without_power = 0.01 }";
    let after = |seconds: u32, what: &str| {
        with(encoder, &(off_for(seconds) + &expect(f64::from(seconds) + 1.5, what)))
    };
    holds(&after(17, "alarms = []\nposition = 200000"));
    holds(&after(19, "alarms = [\"position_error\"]\nwarnings = [\"battery_charge\"]"));
}

#[test]
fn an_encoder_that_comes_later_is_not_there_before() {
    let late = with(
        "joins_at = \"2 s\"\nled_ageing = 0.001\nsupply = 23",
        &(expect(1.9, "state = \"off\"\nexchanging = false")
            + &expect(3.0, "state = \"data_exchange\"\nexchanging = true\nwarnings = []")
            // What it begins with counts from then on: 3.6 s.
            + &expect(5.5, "warnings = []")
            + &expect(5.7, "warnings = [\"light_control_reserve\"]")
            + "[[expect]]\nevent = \"power_on\"\nbefore = 1.9\nseen = false\n[[expect]]\nevent = \"power_on\"\nafter = 2\nbefore = 2.1\n\
               [[expect]]\nevent = \"joined_bus\"\nfields = { address = 5 }\nafter = 2\nbefore = 2.1\n"),
    );
    holds(&late);
    // It lasts a second longer than that, and events of the same moment come after.
    assert_eq!(parsed(&with("joins_at = 4", "")).duration.as_nanos(), 5_000_000_000);
    let moment = with("joins_at = 2", "[[event]]\nat = 2\ndo = \"power\"\nstate = \"off\"\n");
    holds(&(moment + &expect(3.0, "state = \"off\"")));
}

#[test]
fn playbacks_are_read_from_the_folder_of_the_scenario() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("trip.csv"), "0,0\n1,0\n2,4\n").expect("a file");
    let by_name = with("shaft = \"playback:file=trip.csv\"", &expect(3.0, "position = 262144"));
    let in_fields =
        with("shaft = { kind = \"playback\", file = \"trip.csv\" }", &expect(3.0, "position = 262144"));
    let at_once = "[[event]]\nat = 1\ndo = \"shaft\"\nshaft = \"playback:file=trip.csv@here\"\n";
    let event = with(
        "shaft = \"still@5\"",
        &(at_once.to_owned().replace("@here", "") + &expect(4.0, "position = 262144")),
    );
    for source in [by_name, in_fields, event] {
        let scenario = Scenario::parse_in(&source, folder.path());
        let scenario = scenario.unwrap_or_else(|faults| panic!("{}", faults.render("scenario", &source)));
        let outcome = run(&scenario, &source, &mut ()).expect("it is played");
        assert!(outcome.passed, "{source} {:?}", outcome.expectations);
        let elsewhere = Scenario::parse_in(&source, Path::new("/nowhere")).expect_err("it is not there");
        let told = elsewhere.render("f", &source);
        assert!(told.contains("/nowhere/trip.csv"), "{told}");
    }
}

#[test]
fn a_gsd_of_the_user_decides_the_ident_number_of_both_sides() {
    let resolved = |poll: &str| {
        let source = with("gsd = \"own.gsd\"", poll) + "[[expect]]\nat = 1\nexchanging = true\n";
        let mut scenario = parsed(&source);
        scenario.resolve_paths(Path::new("/folder"));
        let read = scenario.resolve_gsd(|path, variant| {
            assert_eq!((path, variant.to_string().as_str()), (Path::new("/folder/own.gsd"), "16x15"));
            Ok((0x4711, Configurations::default()))
        });
        assert_eq!(read, Ok(()));
        run(&scenario, &source, &mut ()).expect("it is played").passed
    };
    assert!(resolved(""));
    // A master with another number in its project is none of its masters.
    assert!(!resolved("ident = 0x108B\n"));
    assert!(resolved("ident = 0x4711\n"));
    let mut scenario = parsed(&with("gsd = \"own.gsd\"", ""));
    let error = scenario.resolve_gsd(|_, _| Err("it is no GSD".to_owned())).expect_err("it is none");
    assert_eq!(error, "crane.hoist: gsd own.gsd: it is no GSD");
}

#[test]
fn mistakes_are_told_with_their_line_and_a_remedy() {
    // The encoder's further keys are in line 8.
    for (key, parts) in [
        ("machine = 5", &["`machine`", "per_turn = 0.5"][..]),
        ("machine = { per_turn = 0 }", &["per_turn is a number, and not 0"]),
        ("machine = { per_turn = 1, unit = \"parsec\" }", &["\"parsec\" is no unit", "ft, deg or rev"]),
        ("machine = { per_turn = 1, colour = 1 }", &["unknown field `colour`"]),
        ("machine = { per_turn = 1 }\nper_revolution = \"1 m\"", &["both say what a revolution moves"]),
        ("thermal = 5", &["`thermal`: it is a table", "ambient = 40"]),
        ("thermal = { watts = 1 }", &["missing field `ambient`"]),
        ("thermal = { ambient = 400 }", &["ambient is a number from -300 to 300"]),
        ("thermal = { ambient = 40, encoder = \"x\" }", &["no field `encoder`"]),
        ("led_ageing = -1", &["hours is a number from 0"]),
        ("led_ageing = \"long\"", &["invalid type"]),
        ("discharge = { charge = 50 }", &["missing field `hours_without_power`"]),
        ("supply_profile = { points = [] }", &["points is a list"]),
        ("endurance = -1", &["`endurance`", "100000"]),
        ("gsd = \"own.gsd\"\nident = 5", &["`gsd` and `ident` both say"]),
        ("joins_at = \"soon\"", &["`joins_at` is no time"]),
        ("joins_at = 1\njoined = true", &["`joins_at` and `joined` both say"]),
        ("shaft = \"playback:file=nothing.csv\"", &["nothing.csv"]),
    ] {
        let told = told(&with(key, ""));
        let line = told.strip_prefix("f:").and_then(|rest| rest.split(':').next()).expect("a line");
        assert!(["8", "9"].contains(&line), "{key}: {told}");
        for part in parts {
            assert!(told.contains(part), "{key}: {part}: {told}");
        }
        assert!(told.contains("hint: "), "{told}");
    }
    let wrong = with(DRUM, &expect(1.0, "position = \"90 deg\""));
    assert!(
        told(&wrong).contains("write `position` and `within` as the encoder has them: lengths"),
        "{}",
        told(&wrong)
    );
}
