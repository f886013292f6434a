//! A world that changes by itself, and the cable, as they show on the bus and in the snapshot.

mod common;

use common::{Bench, bench, status, status_answer, wait_until};
use serde_json::{Value, json};

fn reasons(bench: &Bench) -> Vec<String> {
    let snapshot = bench.snapshot();
    let reasons = snapshot["encoders"][0]["reasons"].as_array().expect("reasons").clone();
    reasons.iter().map(|reason| reason["kind"].as_str().expect("a word").to_owned()).collect()
}

fn counter(bench: &Bench, name: &str) -> u64 {
    bench.snapshot()["encoders"][0]["counters"][name].as_u64().expect("a number")
}

// Octet 8 bit 1 (manual 4.2.2).
#[test]
fn a_brown_out_is_an_alarm_until_it_is_over() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"brown_out","volts":8.9,"for_s":1}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x02);
    assert_eq!(reasons(&bench), ["supply_low"]);
    wait_until("the end", || bench.diagnosis(11)[7] == 0x00);
    assert_eq!(bench.snapshot()["encoders"][0]["volts"], 24.0);
    assert_eq!(counter(&bench, "power_ons"), 1);
}

#[test]
fn a_profile_takes_the_power_and_gives_it_back_for_ever() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"supply_profile","points":[[0,24],[0.02,24],[0.02,-5],[0.04,-5],[0.04,24],[0.06,24]],"repeat":true}"#);
    wait_until("three cuts", || counter(&bench, "power_ons") >= 4);
    bench.done(r#"{"do":"supply","volts":-24}"#);
    let before = counter(&bench, "power_ons");
    std::thread::sleep(std::time::Duration::from_millis(100));
    assert_eq!(counter(&bench, "power_ons"), before, "a fixed supply ends the profile");
    assert_eq!(reasons(&bench), ["reversed_poles"]);
    assert!(bench.is_silent(11));
}

#[test]
fn heat_is_a_warning_and_has_a_reason() {
    let bench = bench(1);
    bench.done(r#"{"do":"temperature","celsius":64.9}"#);
    bench.done(r#"{"do":"thermal","ambient":20,"kelvin_per_watt":100,"watts":1,"time_constant_s":10}"#);
    wait_until("65.1 degrees", || bench.device()["warnings"] == json!(["temperature_exceeded"]));
    assert_eq!(reasons(&bench), ["hot"]);
}

#[test]
fn an_led_that_has_aged_is_a_warning() {
    let bench = bench(1);
    bench.done(r#"{"do":"led_ageing","hours":1e-5}"#);
    wait_until("the warning", || bench.device()["warnings"] == json!(["light_control_reserve"]));
    assert_eq!(reasons(&bench), ["light_low"]);
    bench.done(r#"{"do":"light","state":"ok"}"#);
    assert_eq!(reasons(&bench), [""; 0]);
}

// Three turns of 65536 and 5: with an empty battery the turns go with the power, and 5 is left.
#[test]
fn a_battery_that_ran_down_without_power_has_lost_the_turns_even_if_it_is_replaced() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"shaft","shaft":"still@196613"}"#);
    bench.done(r#"{"do":"discharge","charge":100,"hours_without_power":1e-5}"#);
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    wait_until("a latch", || bench.device()["position"] == 196_613);
    assert_eq!(bench.diagnosis(11)[7], 0x00, "a short cut takes nothing");
    bench.done(r#"{"do":"power","state":"off"}"#);
    wait_until("the end", || reasons(&bench) == ["switched_off", "battery_empty", "turns_lost"]);
    bench.done(r#"{"do":"battery","state":"ok"}"#);
    bench.done(r#"{"do":"power","state":"on"}"#);
    assert_eq!(bench.diagnosis(11)[7], 0x01);
    wait_until("a latch", || bench.device()["position"] == 5);
}

#[test]
fn a_worn_out_memory_takes_no_writes() {
    let bench = bench(1);
    let before = counter(&bench, "memory_writes");
    bench.done(&json!({"do": "endurance", "writes": before + 1000}).to_string());
    assert_eq!(reasons(&bench), [""; 0]);
    bench.done(&json!({"do": "endurance", "writes": before}).to_string());
    assert_eq!(reasons(&bench), ["memory_worn_out"]);
    bench.done(r#"{"do":"sensor","fault":"once"}"#);
    wait_until("a write that fails", || counter(&bench, "memory_writes_failed") > 0);
    assert_eq!(counter(&bench, "memory_writes"), before);
    bench.done(r#"{"do":"endurance","writes":null}"#);
    wait_until("the write that is tried again", || counter(&bench, "memory_writes") > before);
}

// The record before is in the other slot.
#[test]
fn a_torn_write_takes_the_power_and_the_record_before_holds() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"power","state":"off"}"#);
    bench.done(r#"{"do":"operating_time","hours":100}"#);
    bench.done(r#"{"do":"power","state":"on"}"#);
    bench.done(r#"{"do":"memory","fault":"torn_write"}"#);
    bench.done(r#"{"do":"sensor","fault":"once"}"#);
    wait_until("the write", || bench.device() == Value::Null);
    assert!(bench.is_silent(11));
    bench.done(r#"{"do":"power","state":"on"}"#);
    // The alarm was never stored, and the operating time was before.
    assert_eq!(bench.diagnosis(11)[7], 0x00);
    assert_eq!(bench.device()["operating_time_hours"], 100.0);
}

#[test]
fn above_3000_rpm_there_is_a_reason_and_an_event() {
    let bench = bench(1);
    bench.done(r#"{"do":"shaft","shaft":"constant:-3000"}"#);
    std::thread::sleep(std::time::Duration::from_millis(5));
    assert_eq!(reasons(&bench), [""; 0]);
    bench.done(r#"{"do":"shaft","shaft":"constant:-3001"}"#);
    wait_until("a latch", || reasons(&bench) == ["too_fast"]);
    assert_eq!(bench.snapshot()["encoders"][0]["rpm"], -3001.0);
    bench.done(r#"{"do":"shaft","shaft":"still@here"}"#);
    wait_until("a latch", || reasons(&bench).is_empty());
    let told: Vec<_> = bench.reports.try_iter().map(|report| report.what.to_string()).collect();
    assert!(told.iter().any(|text| text.contains("3001 RPM")), "{told:?}");
    assert!(told.iter().any(|text| text.contains("below 3000 RPM again")), "{told:?}");
}

#[test]
fn switches_turned_under_power_wait_for_the_next_power_on() {
    let mut bench = bench(1);
    bench.done(r#"{"do":"switches","switches":"21"}"#);
    assert_eq!(reasons(&bench), ["switches_turned"]);
    assert_eq!(bench.status(11), status_answer(11));
    bench.done(r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(reasons(&bench), [""; 0]);
    assert_eq!(bench.status(33), status_answer(33));
}

// Half a metre for a turn, 0 at 65536: 3.25 turns are 1.125 m.
#[test]
fn the_snapshot_has_the_units_of_the_machine() {
    let bench = bench(1);
    bench.done(r#"{"do":"shaft","shaft":"still@212992"}"#);
    assert_eq!(bench.snapshot()["encoders"][0]["machine"], Value::Null);
    bench.done(r#"{"do":"units","machine":{"unit":"m","per_turn":0.5,"zero":65536}}"#);
    let machine = bench.snapshot()["encoders"][0]["machine"].clone();
    assert_eq!(machine, json!({"unit": "m", "position": 1.125, "rope_layer": null}));
    let error = bench.refused(r#"{"do":"units","machine":{"unit":"m","per_turn":0}}"#);
    assert!(error.contains("per_turn is a number, and not 0"), "{error}");
}

// The master, 11, 12 and 13: behind the second device is 12.
#[test]
fn who_is_behind_a_cut_vanishes_and_comes_back() {
    let mut bench = bench(3);
    bench.done(r#"{"do":"cut","after":2}"#);
    assert_eq!(bench.status(11), status_answer(11));
    assert!(bench.is_silent(12) && bench.is_silent(13));
    let snapshot = bench.snapshot();
    assert_eq!(snapshot["encoders"][1]["reasons"][0]["kind"], "cut_off");
    assert_ne!(snapshot["encoders"][1]["device"], Value::Null, "it keeps its power");
    // 11, 12, the master, 13.
    bench.done(r#"{"do":"cut","after":2,"master_after":2}"#);
    assert!(bench.is_silent(11) && bench.is_silent(12));
    assert_eq!(bench.status(13), status_answer(13));
    bench.done(r#"{"do":"mend"}"#);
    for address in [11, 12, 13] {
        assert_eq!(bench.status(address), status_answer(address));
    }
}

// Manual 3.3. At 500 kbit/s, which counts where there is no rate, each wrong device adds 0.00001.
#[test]
fn the_termination_is_judged_and_has_an_effect_if_asked_for() {
    let mut bench = bench(2);
    let segment = |bench: &Bench| bench.snapshot()["segments"][0].clone();
    bench.done(r#"{"do":"termination","encoder":"all","first":false,"second":false}"#);
    let told = segment(&bench)["termination"].clone();
    assert_eq!(told.as_array().map(Vec::len), Some(1), "{told}");
    assert!(told[0].as_str().is_some_and(|text| text.starts_with("encoder 2: both")), "{told}");
    assert_eq!(segment(&bench)["cable"]["reflected_bit_errors"], 0.0);
    bench.done(r#"{"do":"reflections","on":true}"#);
    assert_eq!(segment(&bench)["cable"]["reflected_bit_errors"], 1e-5);
    bench.done(r#"{"do":"termination","encoder":1,"first":true,"second":true}"#);
    assert_eq!(segment(&bench)["cable"]["reflected_bit_errors"], 2e-5);
    bench.done(r#"{"do":"termination","encoder":1,"first":false,"second":false}"#);
    bench.done(r#"{"do":"termination","encoder":2,"first":true,"second":true}"#);
    assert_eq!(segment(&bench)["termination"], json!([]));
    assert_eq!(segment(&bench)["cable"]["reflected_bit_errors"], 0.0);
    // A cut takes the far end's resistors away.
    bench.done(r#"{"do":"cut","after":2}"#);
    assert_eq!(segment(&bench)["cable"]["reflected_bit_errors"], 1e-5);
    assert_eq!(bench.ask(&status(12), 6, std::time::Duration::from_millis(50)), [0; 0]);
}

#[test]
fn values_that_are_none_are_told() {
    let bench = bench(1);
    for (line, told) in [
        (r#"{"do":"supply_profile","points":[]}"#, "seconds and volts"),
        (r#"{"do":"supply_profile","points":[[1,24],[0,24]]}"#, "earlier"),
        (r#"{"do":"supply_profile","points":[[1,240]]}"#, "-100 to 100"),
        (r#"{"do":"brown_out","volts":8,"for_s":0}"#, "for_s"),
        (r#"{"do":"thermal","ambient":20,"time_constant_s":0}"#, "time_constant_s"),
        (r#"{"do":"led_ageing","hours":-1}"#, "hours"),
        (r#"{"do":"discharge","hours_without_power":0}"#, "hours_without_power"),
        (r#"{"do":"discharge","hours_without_power":1,"charge":101}"#, "charge"),
        (r#"{"do":"line","bursts":0.1,"burst_length":0.5}"#, "burst_length"),
        (r#"{"do":"line","bursts":1.5}"#, "bursts"),
        (r#"{"do":"cut","after":3}"#, "0 to 2"),
        (r#"{"do":"cut","after":1,"master_after":2}"#, "0 to 1"),
    ] {
        let error = bench.refused(line);
        assert!(error.contains(told), "{line}: {error}");
    }
}
