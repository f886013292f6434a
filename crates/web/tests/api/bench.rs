//! The demonstration, its master, and scenarios in its place.

use serde_json::{Value, json};

use crate::client::{Site, demonstration, site};

fn device(site: &Site) -> Value {
    site.get("/api/snapshot").json()["encoders"][0]["device"].clone()
}

fn in_exchange(site: &Site) {
    site.snapshot_when("data exchange", |snapshot| {
        snapshot["encoders"][0]["device"]["state"] == "data_exchange"
    });
}

fn ask(site: &Site, request: &Value) -> Value {
    let answer = site.post("/api/master", &request.to_string());
    assert_eq!(answer.status, 200, "{request}: {}", answer.text());
    let reply = answer.json();
    assert_eq!(reply["ok"], true);
    reply["answer"].clone()
}

#[test]
fn the_demonstration_turns_and_exchanges_data() {
    let site = demonstration();
    let snapshot = site.snapshot_when("a velocity", |snapshot| {
        // 30 RPM and 4096 units: 2048 a second, and so 204.8 in 100 ms.
        let velocity = &snapshot["encoders"][0]["device"]["velocity"];
        velocity == 204 || velocity == 205
    });
    let stage = &snapshot["stage"];
    assert_eq!((&stage["kind"], &stage["master"]), (&json!("demo"), &json!("built_in")));
    assert_eq!((&stage["playing"], &stage["time_factor"]), (&Value::Null, &json!(1.0)));
    let encoder = &snapshot["encoders"][0];
    let device = &encoder["device"];
    assert_eq!((&device["functionality"], &device["master"]), (&json!("scancon_2"), &json!(2)));
    assert_eq!((&device["time_base"], &device["scaling"]), (&json!("100_ms"), &json!(true)));
    // Half a metre for a turn, and half a turn a second.
    let machine = &encoder["machine"];
    assert_eq!(
        (&machine["unit"], &machine["per_turn"], &machine["speed"]),
        (&json!("m"), &json!(0.5), &json!(0.25))
    );
    let begun = std::time::Instant::now();
    let clock = |snapshot: &Value| snapshot["stage"]["clock_ns"].as_f64().expect("a time") / 1e9;
    let first = clock(&site.get("/api/snapshot").json());
    std::thread::sleep(std::time::Duration::from_secs(1));
    let passed = clock(&site.get("/api/snapshot").json()) - first;
    let real = begun.elapsed().as_secs_f64();
    assert!((0.6..1.2).contains(&(passed / real)), "{passed} s of the bus in {real} s");
}

#[test]
fn the_diagnosis_is_octets_and_words_with_advice() {
    let site = demonstration();
    in_exchange(&site);
    let fine = device(&site)["diagnosis"].clone();
    // In data exchange with master 2, watchdog on, ident 0x108B; then the encoder's 51 octets.
    let octets = fine["octets"].as_str().expect("octets");
    assert!(octets.starts_with("00 0C 00 02 10 8B 33 00"), "{octets}");
    assert_eq!(octets.split(' ').count(), 57);
    site.post("/api/commands", r#"{"do":"supply","volts":8.5}"#);
    let diagnosis = device(&site)["diagnosis"].clone();
    let words = diagnosis["words"].as_array().expect("a list");
    let alarm = words.iter().find(|word| word["octets"] == json!([8, 8])).expect("the alarm octet");
    assert_eq!(alarm["level"], "alarm");
    assert!(alarm["text"].as_str().is_some_and(|text| text.contains("supply")), "{alarm}");
    assert!(alarm["advice"].as_str().is_some_and(|advice| !advice.is_empty()), "{alarm}");
    // Bit 1 of octet 8, manual 4.2.2.
    assert!(diagnosis["octets"].as_str().is_some_and(|octets| octets[21..].starts_with("02")), "{diagnosis}");
    site.post("/api/commands", r#"{"do":"power","state":"off"}"#);
    assert_eq!(device(&site), Value::Null);
}

#[test]
fn the_master_presets() {
    let site = demonstration();
    in_exchange(&site);
    site.post("/api/commands", r#"{"do":"shaft","shaft":"still@here"}"#);
    let answer = ask(&site, &json!({"do": "preset", "value": 1_000_000}));
    assert_eq!(answer["to"], 1_000_000);
    assert_eq!(device(&site)["position"], 1_000_000);
    assert_eq!(device(&site)["offset"], answer["offset"]);
    // Above the range of 32768 turns with 4096 steps: the encoder's own words.
    let above = json!({"do": "preset", "value": 134_217_728}).to_string();
    let detail = site.post("/api/master", &above).problem(409);
    assert!(detail.contains("134217728"), "{detail}");
    assert_eq!(device(&site)["position"], 1_000_000);
    let detail = site.post("/api/master", r#"{"do":"preset","value":2147483648}"#).problem(400);
    assert!(detail.contains("2147483647"), "{detail}");
}

#[test]
fn the_master_parameterizes_and_tells_refusals() {
    let site = demonstration();
    in_exchange(&site);
    let request = json!({"do": "parameterize", "encoder": "bus.encoder", "functionality": "class_2",
        "code_sequence": "counter_clockwise", "scaling": true, "measuring_units_per_revolution": 1000,
        "total_measuring_range": 4000});
    assert_eq!(ask(&site, &request), json!({"exchanging": true}));
    let now = device(&site);
    assert_eq!(now["functionality"], "class_2");
    assert_eq!(now["code_sequence"], "counter_clockwise");
    assert_eq!(
        (&now["measuring_units_per_revolution"], &now["total_measuring_range"]),
        (&json!(1000), &json!(4000))
    );
    let too_fine = json!({"do": "parameterize", "functionality": "scancon_2", "scaling": true,
        "measuring_units_per_revolution": 70_000});
    let detail = site.post("/api/master", &too_fine.to_string()).problem(409);
    assert!(detail.contains("70000") && detail.contains("manual 4.1.2"), "{detail}");
    assert_eq!(device(&site)["state"], "wait_prm");
    let class_1 = json!({"do": "parameterize", "functionality": "class_1"});
    assert_eq!(ask(&site, &class_1), json!({"exchanging": true}));
    let detail = site.post("/api/master", r#"{"do":"preset","value":1}"#).problem(409);
    assert!(detail.contains("class 1"), "{detail}");
    let rpm = json!({"do": "parameterize", "functionality": "scancon_2", "time_base": "rpm"});
    ask(&site, &rpm);
    assert_eq!(device(&site)["time_base"], "rpm");
}

#[test]
fn the_master_gives_addresses_unlocks_and_freezes() {
    let site = demonstration();
    in_exchange(&site);
    let detail = site.post("/api/master", r#"{"do":"set_address","from":9,"to":10}"#).problem(404);
    assert!(detail.contains("address 9"), "{detail}");
    site.post("/api/master", r#"{"do":"set_address","from":5,"to":126}"#).problem(400);
    // The switches decide: the encoder refuses, and says why.
    site.post("/api/master", r#"{"do":"unlock"}"#);
    site.snapshot_when("the unlocked encoder", |snapshot| {
        snapshot["encoders"][0]["device"]["state"] == "wait_prm"
    });
    site.post("/api/master", r#"{"do":"set_address","from":5,"to":10}"#).problem(409);
    site.post("/api/commands", r#"{"do":"switches","switches":"7E"}"#);
    site.post("/api/commands", r#"{"do":"power","state":"cycle"}"#);
    assert_eq!(device(&site)["address"], 126);
    let answer = ask(&site, &json!({"do": "set_address", "from": 126, "to": 10}));
    assert_eq!(answer, json!({"encoder": "bus.encoder", "address": 10}));
    assert_eq!(device(&site)["address"], 10);
    in_exchange(&site);
    for (request, kind, on) in [
        ("sync", "sync", true),
        ("unsync", "sync", false),
        ("freeze", "freeze", true),
        ("unfreeze", "freeze", false),
    ] {
        let mut stream = site.stream("/api/stream?telegrams=off");
        assert_eq!(ask(&site, &json!({ "do": request })), json!({ "sent": request }));
        stream.until("event", |event| event["kind"] == kind && event["on"] == on);
    }
    for (body, status) in [
        (r#"{"do":"fly"}"#, 400),
        (r#"{"do":"preset"}"#, 400),
        (r#"{"do":"preset","value":-1}"#, 400),
        (r#"{"do":"preset","value":1,"encoder":2}"#, 404),
        (r#"{"do":"preset","value":1,"encoder":"nobody"}"#, 404),
        ("", 400),
    ] {
        site.post("/api/master", body).problem(status);
    }
}

#[test]
fn a_foreign_master_is_not_ours_to_ask() {
    let site = site();
    let detail = site.post("/api/master", r#"{"do":"preset","value":1}"#).problem(409);
    assert!(detail.contains("demo --http"), "{detail}");
    assert_eq!(site.get("/api/snapshot").json()["stage"]["master"], "foreign");
}

#[test]
fn a_scenario_takes_the_stage_and_leaves_it_again() {
    let site = site();
    let all = site.get("/api/scenarios").json();
    let hoist =
        all["scenarios"].as_array().expect("a list").iter().find(|one| one["name"] == "hoist").cloned();
    let hoist = hoist.expect("the hoist");
    assert_eq!((&hoist["title"], &hoist["seconds"]), (&json!("A hoist"), &json!(16.0)));
    assert!(
        hoist["story"].as_str().is_some_and(|story| story.starts_with("A hook goes up 3.2 metres")),
        "{hoist}"
    );
    let mut stream = site.stream("/api/stream");
    site.post("/api/scenarios/stop", "").problem(409);
    assert_eq!(site.post("/api/scenarios/hoist/play", r#"{"factor":20}"#).status, 200);
    let snapshot = stream.until("snapshot", |snapshot| snapshot["stage"]["kind"] == "scenario");
    assert_eq!(snapshot["encoders"][0]["name"], "crane.hoist");
    assert_eq!(snapshot["encoders"][0]["segment"], "crane");
    let playing = &snapshot["stage"]["playing"];
    assert_eq!((&playing["scenario"], &playing["state"]), (&json!("hoist"), &json!("playing")));
    let expectations = playing["expectations"].as_array().expect("a list");
    assert_eq!(expectations.len(), 4);
    assert_eq!(expectations[0]["text"], "it goes up with 0.4 m/s, which are 4000 units");
    assert_eq!(snapshot["stage"]["time_factor"], 20.0);
    stream.until("telegrams", |batch| batch["telegrams"][0]["segment"] == "crane");
    stream.until("event", |event| event["kind"] == "warning_raised" && event["who"] == "crane.hoist");
    let snapshot = stream.until("snapshot", |snapshot| snapshot["stage"]["playing"]["state"] == "passed");
    let playing = &snapshot["stage"]["playing"];
    assert_eq!(playing["at_s"], 16.0);
    for one in playing["expectations"].as_array().expect("a list") {
        assert_eq!(one["state"], "held", "{one}");
    }
    let detail = site.post("/api/master", r#"{"do":"sync"}"#).problem(409);
    assert!(detail.contains("over"), "{detail}");
    assert_eq!(site.post("/api/scenarios/stop", "").status, 200);
    let snapshot = stream.until("snapshot", |snapshot| snapshot["stage"]["kind"] == "run");
    assert_eq!(snapshot["encoders"][0]["name"], "encoder");
    site.post("/api/commands", r#"{"do":"battery","state":"low"}"#);
    stream.until("event", |event| event["kind"] == "warning_raised" && event["who"] == "encoder");
}

#[test]
fn what_cannot_be_played_is_told() {
    let site = site();
    let detail = site.post("/api/scenarios/nothing/play", "").problem(404);
    assert!(detail.contains("/api/scenarios"), "{detail}");
    for body in [r#"{"factor":0}"#, r#"{"factor":1001}"#, r#"{"factor":"x"}"#, "[]", r#"{"speed":1}"#] {
        site.post("/api/scenarios/hoist/play", body).problem(400);
    }
    assert_eq!(site.get("/api/snapshot").json()["stage"]["kind"], "run");
    // One after the other, and the end in the middle.
    for name in ["first-start", "two-encoders-one-address"] {
        assert_eq!(site.request("POST", &format!("/api/scenarios/{name}/play")).send().status, 200);
    }
    let snapshot = site.get("/api/snapshot").json();
    assert_eq!(snapshot["stage"]["playing"]["scenario"], "two-encoders-one-address");
    let took = site.end();
    assert!(took < std::time::Duration::from_secs(1), "{took:?}");
}
