//! Rules of worlds, shafts and cables, each in virtual time, so that days pass in no time and nothing is by chance.

use plant::control::Envelope;
use plant::scenario::{Bench, Scenario};
use profibus_dp::time::Instant;
use serde_json::{Value, json};

/// Encoders `a` to `c`, of which the last is on a segment of its own; nobody asks them.
const ENCODERS: &str = "[[segment]]\nname = \"one\"\n[[segment.encoder]]\nname = \"a\"\nswitches = \"05\"\n\
                        [[segment.encoder]]\nname = \"b\"\nswitches = \"06\"\n\
                        [[segment]]\nname = \"other\"\n[[segment.encoder]]\nname = \"c\"\nswitches = \"05\"\n";

fn bench() -> Bench {
    Bench::new(&Scenario::parse(ENCODERS).expect("a scenario")).expect("a bench")
}

#[track_caller]
fn done(bench: &Bench, line: &Value) {
    let line = line.to_string();
    let envelope = Envelope::parse(line.as_bytes()).unwrap_or_else(|error| panic!("{line}: {error}"));
    bench.handle().apply(&envelope.request).unwrap_or_else(|error| panic!("{line}: {error}"));
}

fn go_on(bench: &mut Bench, seconds: f64) {
    let nanos = (seconds * 1e9).round();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some days at most")]
    let until = Instant::from_nanos(bench.now().as_nanos() + nanos as u64);
    bench.advance_to(until).expect("it goes on");
    // Who is not asked by a master is looked at only when somebody looks.
    bench.handle().snapshot().expect("it is there");
}

/// An encoder as the snapshot has it, from 0.
fn encoder(bench: &Bench, number: usize) -> Value {
    serde_json::to_value(bench.handle().snapshot().expect("it is there")).expect("JSON")["encoders"][number]
        .clone()
}

fn reasons(bench: &Bench, number: usize) -> Vec<String> {
    let reasons = encoder(bench, number)["reasons"].as_array().expect("reasons").clone();
    reasons.iter().map(|reason| reason["kind"].as_str().expect("a word").to_owned()).collect()
}

fn told(bench: &mut Bench, part: &str) -> usize {
    bench.take_reports().iter().filter(|report| report.what.to_string().contains(part)).count()
}

#[test]
fn a_fixed_value_ends_what_changes_by_itself() {
    let mut bench = bench();
    done(&bench, &json!({"do": "thermal", "encoder": 1, "ambient": 80, "time_constant_s": 60}));
    done(&bench, &json!({"do": "led_ageing", "encoder": 1, "hours": 0.1}));
    done(
        &bench,
        &json!({"do": "discharge", "encoder": 1, "hours_without_power": 1, "hours_with_power": 0.1}),
    );
    done(&bench, &json!({"do": "supply_profile", "encoder": 1, "points": [[0, 24], [3600, 24], [3600, 8]]}));
    go_on(&mut bench, 30.0);
    assert!(encoder(&bench, 0)["celsius"].as_f64() > Some(30.0));
    done(&bench, &json!({"do": "temperature", "encoder": 1, "celsius": 20}));
    done(&bench, &json!({"do": "light", "encoder": 1, "state": "ok"}));
    done(&bench, &json!({"do": "battery", "encoder": 1, "state": "ok"}));
    done(&bench, &json!({"do": "supply", "encoder": 1, "volts": 24}));
    go_on(&mut bench, 7_200.0);
    let found = encoder(&bench, 0);
    assert_eq!(
        (&found["celsius"], &found["light"], &found["battery"], &found["volts"]),
        (&json!(20.0), &json!("ok"), &json!("ok"), &json!(24.0))
    );
}

#[test]
fn after_a_brown_out_comes_the_voltage_of_before() {
    let mut bench = bench();
    done(&bench, &json!({"do": "supply", "encoder": 1, "volts": 22.5}));
    done(&bench, &json!({"do": "brown_out", "encoder": 1, "volts": 8, "for_s": 0.2}));
    go_on(&mut bench, 0.19);
    assert_eq!(encoder(&bench, 0)["volts"], 8.0);
    go_on(&mut bench, 0.02);
    assert_eq!(encoder(&bench, 0)["volts"], 22.5);
}

// Manual 6: 3000 RPM. Below 2970 it is over, so that a speed that trembles tells nothing twice.
#[test]
fn a_shaft_that_was_too_fast_is_not_told_again_at_once() {
    let mut bench = bench();
    for (rpm, reason) in
        [(3_001, &["too_fast"][..]), (2_980, &["too_fast"]), (3_001, &["too_fast"]), (2_969, &[])]
    {
        done(&bench, &json!({"do": "shaft", "encoder": 1, "shaft": format!("constant:{rpm}@here")}));
        go_on(&mut bench, 1.0);
        assert_eq!(reasons(&bench, 0), reason, "{rpm}");
    }
    let reports = bench.take_reports();
    let count = |part: &str| reports.iter().filter(|report| report.what.to_string().contains(part)).count();
    assert_eq!((count("3001 RPM"), count("below 3000 RPM again")), (1, 1));
}

#[test]
fn who_is_there_already_does_not_join_again() {
    let mut bench = bench();
    bench.take_reports();
    for (request, count) in [("join", 0), ("leave", 1), ("leave", 0), ("join", 1)] {
        done(&bench, &json!({"do": request, "encoder": 1}));
        let what = if request == "join" { "on the bus" } else { "off the bus" };
        assert_eq!(told(&mut bench, what), count, "{request}");
    }
}

// The other segment has a clock of its own, and the driver is in the middle of its way: the gear is there all the same.
#[test]
fn a_shaft_on_another_segment_is_driven_too() {
    let mut bench = bench();
    let position = |bench: &Bench, at| encoder(bench, at)["shaft_position"].as_i64().expect("a number");
    done(
        &bench,
        &json!({"do": "shaft", "encoder": "one.a", "shaft": "sine:amplitude=4:period_s=20@1000000"}),
    );
    go_on(&mut bench, 4.0);
    let before = position(&bench, 0);
    // 4 sin(2 pi 4 / 20) = 3.804 turns.
    assert_eq!((before - 1_000_000) / 655, 380, "{before}");
    done(
        &bench,
        &json!({"do": "shaft", "encoder": "other.c", "shaft": "coupled:to=one.a:ratio=1/4@1000000"}),
    );
    for _ in 0..3 {
        go_on(&mut bench, 5.0);
        let turned = position(&bench, 0) - before;
        let driven = position(&bench, 2) - 1_000_000;
        assert!((driven * 4 - turned).abs() <= 4 && turned.abs() > 1_000, "{driven} {turned}");
    }
}

// A gear behind a gear: a third of a half, backwards.
#[test]
fn gears_behind_gears_are_multiplied_and_play_is_their_own() {
    let mut bench = bench();
    done(&bench, &json!({"do": "shaft", "encoder": "one.b", "shaft": "coupled:to=one.a:ratio=1/2@0"}));
    done(
        &bench,
        &json!({"do": "shaft", "encoder": "other.c", "shaft": "coupled:to=one.b:ratio=-1/3:backlash_deg=36@1000000"}),
    );
    done(&bench, &json!({"do": "shaft", "encoder": "one.a", "shaft": "constant:60@0"}));
    go_on(&mut bench, 60.0);
    let position = |at| encoder(&bench, at)["shaft_position"].as_i64().expect("a number");
    assert_eq!(position(1), 30 * 65_536);
    // Ten turns back, less half of a tenth of a turn.
    assert!((position(2) - (1_000_000 - 10 * 65_536 + 65_536 / 20)).abs() <= 2, "{}", position(2));
}

// Manual 4.2.2: the alarm of the position error stays until the next power-on, and comes again with the fault.
#[test]
fn a_sensor_fault_that_is_held_outlives_the_power() {
    let mut bench = bench();
    let alarms = |bench: &Bench| encoder(bench, 0)["device"]["alarms"].clone();
    let cycle = |bench: &Bench| done(bench, &json!({"do": "power", "encoder": 1, "state": "cycle"}));
    for (fault, during, after) in [
        ("once", json!(["position_error"]), json!([])),
        ("held", json!(["position_error"]), json!(["position_error"])),
    ] {
        done(&bench, &json!({"do": "sensor", "encoder": 1, "fault": fault}));
        go_on(&mut bench, 0.1);
        assert_eq!(alarms(&bench), during, "{fault}");
        cycle(&bench);
        go_on(&mut bench, 0.1);
        assert_eq!(alarms(&bench), after, "{fault}");
        done(&bench, &json!({"do": "sensor", "encoder": 1, "fault": "off"}));
        cycle(&bench);
        go_on(&mut bench, 0.1);
        assert_eq!(alarms(&bench), json!([]), "{fault}");
    }
    // What was to be lost is kept when the fault is taken back in time.
    done(&bench, &json!({"do": "shaft", "encoder": 1, "shaft": "still@200000"}));
    for (taken_back, position) in [(true, 200_000), (false, 200_000 % 65_536)] {
        done(&bench, &json!({"do": "sensor", "encoder": 1, "fault": "turns_lost"}));
        if taken_back {
            done(&bench, &json!({"do": "sensor", "encoder": 1, "fault": "off"}));
        }
        cycle(&bench);
        go_on(&mut bench, 0.1);
        assert_eq!(encoder(&bench, 0)["device"]["position"], position);
    }
}

// Power that comes and goes counts for what ages: 3.6 s of light under power, and a battery of 36 s without.
#[test]
fn what_ages_counts_power_to_the_moment_it_comes_or_goes() {
    let mut bench = bench();
    done(&bench, &json!({"do": "led_ageing", "encoder": 1, "hours": 0.001}));
    done(&bench, &json!({"do": "discharge", "encoder": 1, "hours_without_power": 0.01, "low": 50}));
    let found = |bench: &Bench| {
        let encoder = encoder(bench, 0);
        (
            encoder["light"].as_str().expect("a word").to_owned(),
            encoder["battery"].as_str().expect("a word").to_owned(),
        )
    };
    let of = |light: &str, battery: &str| (light.to_owned(), battery.to_owned());
    for (state, seconds, due) in [
        ("on", 3.0, of("ok", "ok")),
        ("off", 17.0, of("ok", "ok")),
        ("on", 0.5, of("ok", "ok")),
        ("off", 2.0, of("ok", "low")),
        ("on", 0.2, of("low", "low")),
    ] {
        done(&bench, &json!({"do": "power", "encoder": 1, "state": state}));
        go_on(&mut bench, seconds);
        assert_eq!(found(&bench), due, "{state} for {seconds} s");
    }
}

// A move waits before it begins; a hoist comes back at its own speed and waits at both ends.
#[test]
fn moves_wait_and_come_back_as_they_are_told() {
    let mut bench = bench();
    // 4 turns at 2 turns a second, at once: 2 s there. Back at 1 turn a second: 4 s. 1 s at each end.
    done(
        &bench,
        &json!({"do": "shaft", "encoder": 1,
        "shaft": "hoist:by=4:speed=2:acceleration=1e6:back_speed=1:pause_s=1@0"}),
    );
    done(
        &bench,
        &json!({"do": "shaft", "encoder": 2, "shaft": "move:by=4:speed=2:acceleration=1e6:pause_s=3@0"}),
    );
    for (seconds, hoist, moved) in
        [(1.0, 2.0, 0.0), (1.5, 4.0, 0.0), (1.5, 3.0, 2.0), (2.0, 1.0, 4.0), (1.5, 0.0, 4.0), (1.5, 2.0, 4.0)]
    {
        go_on(&mut bench, seconds);
        for (at, turns) in [(0, hoist), (1, moved)] {
            let position = encoder(&bench, at)["shaft_position"].as_f64().expect("a number") / 65_536.0;
            assert!((position - turns).abs() < 0.001, "{at}: {position}, not {turns}");
        }
    }
}

// A turn and a half from where it begins, half a metre each. Another machine goes before that of the shaft.
#[test]
fn a_shaft_brings_the_units_of_its_machine() {
    let mut bench = bench();
    done(
        &bench,
        &json!({"do": "shaft", "encoder": 1, "shaft": "move:by=0.75:speed=1:acceleration=1e6:per_turn=0.5@65536"}),
    );
    go_on(&mut bench, 5.0);
    assert_eq!(encoder(&bench, 0)["machine"], json!({"unit": "m", "position": 0.75, "rope_layer": null}));
    done(&bench, &json!({"do": "units", "encoder": 1, "machine": {"unit": "deg", "per_turn": 360}}));
    assert_eq!(encoder(&bench, 0)["machine"]["position"], 900.0);
    done(&bench, &json!({"do": "units", "encoder": 1, "machine": null}));
    assert_eq!(encoder(&bench, 0)["machine"]["position"], 0.75);
}

// Jerk of a turn a second cubed for a second: a sixth of a turn. In the middle of its way it is after twice that time.
#[test]
fn a_jerk_that_is_limited_makes_a_move_gentle() {
    let mut bench = bench();
    done(&bench, &json!({"do": "shaft", "encoder": 1, "shaft": "move:by=2:speed=1:acceleration=1:jerk=1@0"}));
    for (seconds, steps) in
        [(1.0, 65_536 / 6), (1.0, 65_536), (1.0, 2 * 65_536 - 65_536 / 6), (1.0, 2 * 65_536)]
    {
        go_on(&mut bench, seconds);
        let position = encoder(&bench, 0)["shaft_position"].as_i64().expect("a number");
        assert!((position - steps).abs() <= 1, "{position}, not {steps}");
    }
}

// A hundredth of a turn ten times a second: in the middle of its way it is as fast as 2 pi 0.1 turns a second.
#[test]
fn what_vibrates_has_a_speed() {
    let mut bench = bench();
    done(
        &bench,
        &json!({"do": "shaft", "encoder": 1, "shaft": "still:vibration_deg=3.6:vibration_hz=10@1000000"}),
    );
    for (seconds, rpm, steps) in [(1.0, 37.70, 0), (0.025, 0.0, 655), (0.025, -37.70, 0)] {
        go_on(&mut bench, seconds);
        let found = encoder(&bench, 0);
        assert!((found["rpm"].as_f64().expect("a number") - rpm).abs() < 0.01, "{}", found["rpm"]);
        let turned = found["shaft_position"].as_i64().expect("a number") - 1_000_000;
        assert!((turned - steps).abs() <= 1, "{turned}");
    }
}

// The power goes in the middle of a write, and no supply brings it back, but the switch does.
#[test]
fn after_a_torn_write_the_power_stays_off_until_it_is_switched_on() {
    let mut bench = bench();
    done(&bench, &json!({"do": "memory", "encoder": 1, "fault": "torn_write"}));
    done(&bench, &json!({"do": "sensor", "encoder": 1, "fault": "once"}));
    go_on(&mut bench, 2.0);
    assert_eq!(encoder(&bench, 0)["device"], Value::Null);
    done(&bench, &json!({"do": "supply", "encoder": 1, "volts": 23}));
    go_on(&mut bench, 2.0);
    assert_eq!(
        (&encoder(&bench, 0)["device"], reasons(&bench, 0)),
        (&Value::Null, vec!["switched_off".to_owned()])
    );
    done(&bench, &json!({"do": "power", "encoder": 1, "state": "on"}));
    assert_ne!(encoder(&bench, 0)["device"], Value::Null);
}

#[test]
fn a_file_may_have_an_at_sign_in_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("trip@site.csv");
    std::fs::write(&path, "0,0\n1,1\n").expect("a file");
    let mut bench = bench();
    let shaft = format!("playback:repeat=true:file={}", path.display());
    done(&bench, &json!({"do": "shaft", "encoder": 1, "shaft": shaft}));
    go_on(&mut bench, 2.5);
    assert_eq!(encoder(&bench, 0)["shaft_position"], 32_768, "once more from the beginning");
}

// Manual 4.2.2 has no word for a cable: it keeps its power, and its watchdog counts.
#[test]
fn behind_a_cut_the_watchdog_decides_whether_an_encoder_leaves_its_master() {
    let mastered = |watchdog: &str| {
        format!(
            "[[segment]]\n[[segment.encoder]]\nname = \"a\"\nswitches = \"05\"\n[segment.master]\n\
             [[segment.master.poll]]\nencoder = \"a\"\n{watchdog}\n[[event]]\nat = 1\ndo = \"cut\"\nafter = 1\n\
             [[expect]]\nat = 3\nexchanging = false\nstate = \"STATE\"\n"
        )
    };
    for (watchdog, state) in [("watchdog = \"200 ms\"", "wait_prm"), ("", "data_exchange")] {
        let source = mastered(watchdog).replace("STATE", state);
        let scenario =
            Scenario::parse(&source).unwrap_or_else(|faults| panic!("{}", faults.render("s", &source)));
        let outcome = plant::scenario::run(&scenario, &source, &mut ()).expect("it is played");
        assert!(outcome.passed, "{:?}", outcome.expectations);
    }
}
