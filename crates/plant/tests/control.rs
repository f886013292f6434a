//! What requests do to encoders and to the line, as it shows on the bus.

mod common;

use common::{bench, status, status_answer, wait_until};
use plant::control::{COMMANDS, Envelope, EventLine, Request};
use plant::{Report, What};
use profibus_dp::time::Instant;
use serde_json::{Value, json};
use std::time::Duration as Time;

#[test]
fn a_supply_of_8_5_v_is_alarm_bit_1_in_the_next_diagnosis() {
    let mut bench = bench(1);
    assert_eq!(bench.diagnosis(11)[7], 0x00);
    bench.done(r#"{"do":"supply","volts":8.5}"#);
    let diagnosis = bench.diagnosis(11);
    // Octet 8 bit 1 (manual 4.2.2); Ext_Diag in octet 1, Stat_Diag in octet 2.
    assert_eq!((diagnosis[7], diagnosis[0] & 0x08, diagnosis[1] & 0x02), (0x02, 0x08, 0x02));
    bench.done(r#"{"do":"supply","volts":24}"#);
    wait_until("the alarm to go", || bench.diagnosis(11)[7] == 0x00);
}

#[test]
fn too_little_supply_and_the_switch_both_take_the_power() {
    let mut bench = bench(1);
    for (off, on) in [
        (r#"{"do":"supply","volts":5.9}"#, r#"{"do":"supply","volts":6}"#),
        (r#"{"do":"supply","volts":-24}"#, r#"{"do":"supply","volts":24}"#),
        (r#"{"do":"power","state":"off"}"#, r#"{"do":"power","state":"on"}"#),
    ] {
        bench.done(off);
        assert!(bench.is_silent(11), "{off}");
        assert_eq!(bench.device(), Value::Null);
        bench.done(on);
        assert_eq!(bench.status(11), status_answer(11), "{on}");
    }
    // Off stays off, whatever the supply.
    bench.done(r#"{"do":"power","state":"off"}"#);
    bench.done(r#"{"do":"supply","volts":25}"#);
    assert!(bench.is_silent(11));
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.status(11), status_answer(11));
}

// Position error, octet 8 bit 0: gone at the next power-on (manual 4.2.2).
#[test]
fn a_power_cycle_ends_a_position_error_unless_its_cause_is_held() {
    let mut bench = bench(1);
    for fault in ["once", "position_error"] {
        bench.done(&json!({"do": "sensor", "fault": fault}).to_string());
        assert_eq!(bench.diagnosis(11)[7], 0x01, "{fault}");
        bench.done(r#"{"do":"power","state":"cycle"}"#);
        assert_eq!(bench.diagnosis(11)[7], 0x00, "{fault}");
    }
    bench.done(r#"{"do":"sensor","fault":"held"}"#);
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x01);
    bench.done(r#"{"do":"sensor","fault":"off"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x01);
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x00);
}

#[test]
fn while_the_sensor_reports_a_fault_the_position_stands_still() {
    let bench = bench(1);
    bench.done(r#"{"do":"shaft","shaft":"still@1000"}"#);
    wait_until("a latch", || bench.device()["position"] == 1_000);
    bench.done(r#"{"do":"sensor","fault":"held"}"#);
    bench.done(r#"{"do":"shaft","shaft":"still@2000"}"#);
    std::thread::sleep(Time::from_millis(5));
    assert_eq!(bench.device()["position"], 1_000);
    bench.done(r#"{"do":"sensor","fault":"off"}"#);
    wait_until("a latch", || bench.device()["position"] == 2_000);
}

#[test]
fn a_lost_turn_count_restarts_at_0_with_an_alarm_and_the_next_power_on_ends_it() {
    let mut bench = bench(1);
    // Three turns of 65536 and 5.
    bench.done(r#"{"do":"shaft","shaft":"still@196613"}"#);
    wait_until("a latch", || bench.device()["position"] == 196_613);
    bench.done(r#"{"do":"sensor","fault":"turns_lost"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x00);
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x01);
    assert_eq!(bench.device()["position"], 5);
    assert_eq!(bench.device()["alarms"], json!(["position_error"]));
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x00);
}

#[test]
fn a_lost_memory_is_a_position_error_at_the_next_power_on() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"power","state":"off"}"#);
    bench.done(r#"{"do":"operating_time","hours":100}"#);
    bench.done(r#"{"do":"memory","fault":"lost_at_power_on"}"#);
    bench.done(r#"{"do":"power","state":"on"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x01);
    assert_eq!(bench.device()["operating_time_hours"], 0.0);
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x00);
}

#[test]
fn of_two_records_one_may_be_damaged() {
    let bench = bench(1);
    bench.done(r#"{"do":"power","state":"off"}"#);
    // The very first record goes to both slots, the next to slot A.
    bench.done(r#"{"do":"operating_time","hours":100}"#);
    bench.done(r#"{"do":"operating_time","hours":200}"#);
    bench.done(r#"{"do":"memory","fault":"damage_a"}"#);
    bench.done(r#"{"do":"power","state":"on"}"#);
    assert_eq!(bench.device()["operating_time_hours"], 100.0);
    assert_eq!(bench.device()["alarms"], json!([]));
}

// The warning comes strictly above 87600 h (manual 4.2.9, bit 4).
#[test]
fn the_operating_time_is_set_only_without_power_and_warns_above_its_limit() {
    let bench = bench(1);
    let error = bench.refused(r#"{"do":"operating_time","hours":87600}"#);
    assert!(error.contains("switch it off first"), "{error}");
    for (hours, warnings) in [(87_600.0, json!([])), (87_600.1, json!(["operating_time_limit"]))] {
        bench.done(r#"{"do":"power","state":"off"}"#);
        bench.done(&json!({"do": "operating_time", "hours": hours}).to_string());
        bench.done(r#"{"do":"power","state":"on"}"#);
        assert_eq!(bench.device()["operating_time_hours"], hours);
        assert_eq!(bench.device()["warnings"], warnings);
    }
}

#[test]
fn writes_that_fail_are_told_and_counted_and_the_old_record_holds() {
    let bench = bench(1);
    let counted =
        |bench: &common::Bench, name: &str| bench.snapshot()["encoders"][0]["counters"][name].clone();
    bench.done(r#"{"do":"memory","fault":"writes_fail"}"#);
    // A supply that falls out of its range makes it write at once.
    bench.done(r#"{"do":"supply","volts":8}"#);
    assert_eq!(counted(&bench, "memory_writes_failed"), 1);
    assert_eq!(counted(&bench, "memory_writes"), 0);
    assert!(bench.reports.try_iter().any(|report| matches!(report.what, What::NotStored(_))));
    bench.done(r#"{"do":"memory","fault":"off"}"#);
    // The very first record goes to both slots.
    wait_until("another try", || counted(&bench, "memory_writes") == 2);
}

#[test]
fn warnings_and_switches_do_what_they_do_on_the_device() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"temperature","celsius":65}"#);
    assert_eq!(bench.device()["warnings"], json!([]));
    bench.done(r#"{"do":"temperature","celsius":65.1}"#);
    bench.done(r#"{"do":"light","state":"low"}"#);
    bench.done(r#"{"do":"battery","state":"empty"}"#);
    let all = json!(["temperature_exceeded", "light_control_reserve", "battery_charge"]);
    assert_eq!(bench.device()["warnings"], all);
    bench.done(r#"{"do":"switches","switches":"0D"}"#);
    assert_eq!(bench.status(11), status_answer(11));
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(bench.status(13), status_answer(13));
    assert!(bench.is_silent(11));
}

#[test]
fn a_shaft_goes_on_from_where_it_is_or_jumps_as_asked() {
    let bench = bench(1);
    let shaft =
        |bench: &common::Bench| bench.snapshot()["encoders"][0]["shaft_position"].as_i64().expect("counts");
    bench.done(r#"{"do":"shaft","shaft":{"kind":"still","raw":5000}}"#);
    assert_eq!(shaft(&bench), 5_000);
    bench.done(r#"{"do":"shaft","shaft":{"kind":"constant","rpm":-600}}"#);
    wait_until("counter-clockwise", || shaft(&bench) < 5_000);
    bench.done(r#"{"do":"shaft","shaft":"still@here"}"#);
    let here = shaft(&bench);
    assert!(here < 5_000 && here != 0, "{here}");
    assert_eq!(shaft(&bench), here);
    bench.done(r#"{"do":"shaft","shaft":"constant:0.001@77"}"#);
    assert_eq!(shaft(&bench), 77);
}

// The answer of station 11 is 10 02 0B 00 0D 16: DP slave reference, section 1.5.
#[test]
fn an_encoder_that_has_left_the_bus_keeps_its_power_and_hears_nothing() {
    let mut bench = bench(2);
    bench.done(r#"{"do":"leave","encoder":1}"#);
    assert!(bench.is_silent(11));
    assert_eq!(bench.status(12), status_answer(12));
    let encoder = &bench.snapshot()["encoders"][0];
    assert_eq!(encoder["injected"]["off_the_bus"], true);
    assert_eq!(encoder["device"]["address"], 11);
    let heard = encoder["counters"]["telegrams"].clone();
    // A power-on does not put it back.
    bench.done(r#"{"do":"power","encoder":1,"state":"cycle"}"#);
    assert!(bench.is_silent(11));
    assert_eq!(bench.snapshot()["encoders"][0]["counters"]["telegrams"], heard);
    bench.done(r#"{"do":"join","encoder":1}"#);
    assert_eq!(bench.status(11), status_answer(11));
    // Who is there already does not come again.
    bench.done(r#"{"do":"join","encoder":"all"}"#);
    let told: Vec<_> = bench.reports.try_iter().map(|report| report.what.to_string()).collect();
    assert_eq!(told.iter().filter(|text| *text == "on the bus, station address 11").count(), 1, "{told:?}");
    assert_eq!(told.iter().filter(|text| *text == "taken off the bus").count(), 1, "{told:?}");
}

#[test]
fn faults_by_request_meet_the_next_telegrams() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"damage_reply","octet":4,"mask":"81"}"#);
    assert_eq!(bench.status(11), [0x10, 0x02, 0x0B, 0x81, 0x0D, 0x16]);
    bench.done(r#"{"do":"double_replies"}"#);
    assert_eq!(
        bench.ask(&status(11), 12, Time::from_secs(10)),
        [status_answer(11), status_answer(11)].concat()
    );
    for (fault, count) in [
        (r#"{"do":"lose_replies","count":2}"#, 2),
        (r#"{"do":"lose_requests"}"#, 1),
        (r#"{"do":"damage_request","octet":2}"#, 1),
        (r#"{"do":"character_error","octet":6}"#, 1),
    ] {
        bench.done(fault);
        for _ in 0..count {
            assert!(bench.is_silent(11), "{fault}");
        }
        assert_eq!(bench.status(11), status_answer(11), "{fault}");
    }
    bench.done(r#"{"do":"delay_replies","by_us":30000}"#);
    let begun = std::time::Instant::now();
    assert_eq!(bench.status(11), status_answer(11));
    assert!(begun.elapsed() >= Time::from_millis(30));
    bench.done(r#"{"do":"double_requests"}"#);
    assert_eq!(bench.status(11), status_answer(11));
    let snapshot = bench.snapshot();
    let faults = &snapshot["segments"][0]["faults"];
    assert_eq!(
        *faults,
        json!({"lost_requests": 1, "doubled_requests": 1, "damaged_request_characters": 2, "lost_replies": 2,
               "doubled_replies": 1, "late_replies": 1, "damaged_reply_characters": 1})
    );
    assert_eq!(snapshot["encoders"][0]["counters"]["line_errors"], 1);
}

#[test]
fn what_waits_for_requests_and_for_replies_is_shown_apart_until_the_line_is_quiet() {
    let bench = bench(1);
    bench.done(r#"{"do":"lose_requests","count":3}"#);
    bench.done(r#"{"do":"double_replies","count":2}"#);
    let waiting = || {
        let segment = bench.snapshot()["segments"][0].clone();
        [segment["waiting_request_faults"].clone(), segment["waiting_reply_faults"].clone()]
    };
    assert_eq!(waiting(), [json!(3), json!(2)]);
    bench.done(r#"{"do":"line"}"#);
    assert_eq!(waiting(), [json!(0), json!(0)]);
}

#[test]
fn the_same_seed_loses_the_same_replies() {
    let mut bench = bench(1);
    let mut run = |seed: u64| {
        bench.done(&json!({"do": "line", "seed": seed, "lost_replies": 0.25}).to_string());
        (0..32).map(|_| bench.ask(&status(11), 6, Time::from_millis(150)).is_empty()).collect::<Vec<_>>()
    };
    let first = run(1);
    assert!(first.contains(&true) && first.contains(&false), "{first:?}");
    assert_eq!(run(1), first);
    assert_ne!(run(2), first);
    bench.done(r#"{"do":"line"}"#);
    assert_eq!(bench.snapshot()["segments"][0]["line"], Value::Null);
    assert!((0..32).all(|_| bench.status(11) == status_answer(11)));
}

#[test]
fn encoders_are_called_by_name_or_number_or_all_of_them() {
    let bench = bench(3);
    let low = |bench: &common::Bench| -> Vec<bool> {
        let snapshot = bench.snapshot();
        let encoders = snapshot["encoders"].as_array().expect("encoders");
        encoders.iter().map(|encoder| encoder["light"] == "low").collect()
    };
    bench.done(r#"{"do":"light","encoder":"encoder 2","state":"low"}"#);
    assert_eq!(low(&bench), [false, true, false]);
    bench.done(r#"{"do":"light","encoder":3,"state":"low"}"#);
    assert_eq!(low(&bench), [false, true, true]);
    bench.done(r#"{"do":"light","encoder":"all","state":"low"}"#);
    assert_eq!(low(&bench), [true; 3]);
    let error = bench.refused(r#"{"do":"light","state":"ok"}"#);
    assert!(error.contains(r#"add "encoder" with one of "encoder", "encoder 2", "encoder 3""#), "{error}");
    for nobody in [json!(0), json!(4), json!("motor"), json!("Encoder")] {
        let error = bench.refused(&json!({"do": "light", "encoder": nobody, "state": "ok"}).to_string());
        assert!(error.contains("there is no encoder") && error.contains("numbered from 1"), "{error}");
    }
    let error = bench.refused(r#"{"do":"lose_replies","segment":"cable"}"#);
    assert!(error.contains(r#"there is no segment "cable"; there are "bus""#), "{error}");
    assert_eq!(low(&bench), [true; 3]);
}

#[test]
fn a_value_that_is_none_changes_nothing_and_is_told() {
    let bench = bench(1);
    let before = bench.snapshot()["encoders"][0]["device"].clone();
    for (line, told) in [
        (r#"{"do":"supply","volts":101}"#, "from -100 to 100"),
        (r#"{"do":"temperature","celsius":-301}"#, "from -300 to 300"),
        (r#"{"do":"operating_time","hours":-1}"#, "from 0 to 10000000"),
        (r#"{"do":"switches","switches":"5"}"#, "two hexadecimal digits"),
        (r#"{"do":"shaft","shaft":"turning"}"#, "write still@RAW"),
        (r#"{"do":"shaft","shaft":"still@5@here"}"#, "write still@RAW"),
        (r#"{"do":"shaft","shaft":"still@2147483648"}"#, "0 to 2147483647"),
        (r#"{"do":"shaft","shaft":{"kind":"constant"}}"#, "it needs rpm"),
        (r#"{"do":"shaft","shaft":{"kind":"constant","rpm":1e9}}"#, "is no speed"),
        (r#"{"do":"line","lost_replies":1.5}"#, "a number from 0 to 1"),
        (r#"{"do":"line","late_replies":1,"late_by_us":10000001}"#, "10 s at most"),
        (r#"{"do":"lose_replies","count":0}"#, "from 1 to 1000"),
        (r#"{"do":"lose_requests","count":1001}"#, "from 1 to 1000"),
        (r#"{"do":"delay_replies","by_us":99999999}"#, "10 s at most"),
        (r#"{"do":"damage_reply","octet":0}"#, "counted from 1"),
        (r#"{"do":"damage_request","octet":1,"mask":"+1"}"#, "two hexadecimal digits"),
        (r#"{"do":"damage_request","octet":1,"mask":"00"}"#, "two hexadecimal digits"),
        (r#"{"do":"character_error","octet":0}"#, "counted from 1"),
    ] {
        let error = bench.refused(line);
        assert!(error.contains(told), "{line}: {error}");
    }
    bench.done(r#"{"do":"lose_replies","count":1000}"#);
    let error = bench.refused(r#"{"do":"double_replies"}"#);
    assert!(error.contains("no more than 1000 can wait"), "{error}");
    assert_eq!(bench.snapshot()["encoders"][0]["device"]["alarms"], before["alarms"]);
}

#[test]
fn what_is_no_request_is_told_what_to_write() {
    for (line, told) in [
        ("", "write one on each line"),
        ("hello", "write one on each line"),
        ("[1]", "write one on each line"),
        ("7", "write one on each line"),
        (r#"{"do":"#, "write one on each line"),
        ("{}", r#""do" is missing"#),
        (r#"{"do":7}"#, r#""do" is missing"#),
        (r#"{"do":"explode"}"#, r#"{"do":"help"} lists"#),
        (r#"{"do":"supply"}"#, "missing field `volts`; write for example"),
        (r#"{"do":"supply","volts":"8"}"#, "write for example"),
        (r#"{"do":"supply","volts":8,"amps":1}"#, "unknown field `amps`"),
        (r#"{"do":"power","state":"maybe"}"#, "expected one of `off`, `on`, `cycle`"),
        (r#"{"do":"power","encoder":1.5,"state":"on"}"#, r#"a name, a number from 1, or "all""#),
        (r#"{"do":"shaft","shaft":7}"#, "a shaft is a text like"),
        (r#"{"do":"lose_replies","count":-1}"#, "write for example"),
    ] {
        let error = Envelope::parse(line.as_bytes()).expect_err(line).to_string();
        assert!(error.contains(told), "{line}: {error}");
    }
    assert!(Envelope::parse(&[0xFF, 0xFE]).is_err());
    assert!(Envelope::parse("[".repeat(60_000).as_bytes()).is_err());
    let refused = Envelope::parse(br#"{"id":[1,"a"],"do":"explode"}"#).expect_err("no request");
    assert_eq!(refused.id, Some(json!([1, "a"])));
}

#[test]
fn every_request_is_in_the_list_and_its_example_is_one() {
    for command in COMMANDS {
        let envelope = Envelope::parse(command.example.as_bytes()).expect(command.example);
        assert_eq!(envelope.request.name(), command.name);
        envelope.request.check().expect(command.example);
        let line = serde_json::to_string(&envelope.request).expect("JSON");
        assert_eq!(Envelope::parse(line.as_bytes()).expect("itself").request, envelope.request);
    }
    // What serde knows, from its own sentence.
    let error = serde_json::from_str::<Request>(r#"{"do":"?"}"#).expect_err("none").to_string();
    let known = error.matches('`').count() / 2 - 1;
    assert_eq!(known, COMMANDS.len(), "{error}");
}

#[test]
fn an_event_has_its_time_its_name_its_fields_and_its_sentence() {
    let line = |what: What| {
        let report = Report { at: Instant::from_millis(3), who: "it".into(), what };
        serde_json::to_value(EventLine::from(&report)).expect("JSON")
    };
    assert_eq!(
        line(What::PowerOn(Some(5))),
        json!({"event": "report", "at_ns": 3_000_000, "who": "it", "kind": "power_on", "address": 5,
               "text": "power on, station address 5"})
    );
    let preset = sch108bex::event::Event::PresetTaken { from: 7, to: 1, offset: -6 };
    assert_eq!(
        line(What::Device(preset)),
        json!({"event": "report", "at_ns": 3_000_000, "who": "it", "kind": "preset_taken", "from": 7, "to": 1,
               "offset": -6, "text": "preset: position 7 is now 1, offset value -6"})
    );
    let dropped = serde_json::to_value(EventLine::dropped(3)).expect("JSON");
    assert_eq!((&dropped["event"], &dropped["count"]), (&json!("dropped"), &json!(3)));
}

#[test]
fn a_plant_that_has_ended_takes_no_requests() {
    let bench = bench(1);
    let handle = bench.handle.clone();
    bench.plant.stop().expect("an end");
    let error = handle.apply(&Request::Snapshot { encoder: None }).expect_err("ended").to_string();
    assert!(error.contains("has ended"), "{error}");
}
