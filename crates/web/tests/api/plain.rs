//! The page's files, the snapshot, commands, and the stream.

use std::time::{Duration, Instant};

use crate::client::site;

#[test]
fn the_page_comes_with_its_tag() {
    let site = site();
    let page = site.get("/");
    assert_eq!(page.status, 200);
    assert_eq!(page.header("content-type"), Some("text/html; charset=utf-8"));
    assert!(page.text().contains("SCH108BEX"));
    let tag = page.header("etag").expect("a tag").to_owned();
    let again = site.request("GET", "/").header("If-None-Match", &tag).send();
    assert_eq!((again.status, again.body.len()), (304, 0));
    assert_eq!(again.header("etag"), Some(tag.as_str()));
    assert_eq!(site.request("GET", "/").header("If-None-Match", "\"0\"").send().status, 200);
    for strange in ["/../Cargo.toml", "/%2e%2e/Cargo.toml", "//index.html", "/api/nothing", "/Cargo.toml"] {
        let detail = site.get(strange).problem(404);
        assert!(detail.contains("/api/openapi.json"), "{detail}");
    }
    let wrong = site.request("PUT", "/api/snapshot").send();
    wrong.problem(405);
    assert_eq!(wrong.header("allow"), Some("GET,HEAD"));
}

#[test]
fn the_snapshot_has_what_the_control_has_and_more() {
    let site = site();
    let mut page = site.get("/api/snapshot").json();
    assert_eq!(page["stage"]["kind"], "run");
    assert_eq!(page["stage"]["title"], "A test");
    assert_eq!(page["encoders"][0]["segment"], "bus");
    let cap = &page["encoders"][0]["cap"];
    assert_eq!(
        cap,
        &serde_json::json!({"x16": 0, "x1": 5, "terminated_first": true, "terminated_second": true})
    );
    let own = serde_json::to_value(site.plant().handle().snapshot().expect("it runs")).expect("JSON");
    for name in ["name", "bits", "switches", "shaft", "volts", "injected", "counters", "reasons"] {
        assert_eq!(page["encoders"][0][name], own["encoders"][0][name], "{name}");
    }
    page["segments"][0]["at_ns"] = own["segments"][0]["at_ns"].clone();
    assert_eq!(page["segments"], own["segments"]);
}

#[test]
fn commands_are_those_of_the_control() {
    let site = site();
    let done = site.post("/api/commands", r#"{"do":"temperature","celsius":66.5,"id":"a"}"#);
    assert_eq!((done.status, done.json()), (200, serde_json::json!({"id": "a", "ok": true})));
    let snapshot = site.post("/api/commands", r#"{"do":"snapshot","encoder":1}"#).json();
    assert_eq!(snapshot["encoder"]["celsius"], 66.5);
    for (body, status, advice) in [
        ("", 400, r#"{"do":"help"}"#),
        ("[]", 400, r#"{"do":"help"}"#),
        ("{}", 400, r#"{"do":"help"}"#),
        (r#"{"do":"fly"}"#, 400, r#"{"do":"help"}"#),
        (r#"{"do":"supply"}"#, 400, r#"{"do":"supply","volts":8.5}"#),
        (r#"{"do":"supply","volts":1000}"#, 400, "-100 to 100"),
        (r#"{"do":"supply","volts":24,"encoder":7}"#, 404, "encoder 7"),
        (r#"{"do":"operating_time","hours":1}"#, 409, "switch it off"),
        (r#"{"do":"subscribe"}"#, 400, "/api/stream"),
        (r#"{"do":"unsubscribe"}"#, 400, "/api/stream"),
    ] {
        let detail = site.post("/api/commands", body).problem(status);
        assert!(detail.contains(advice), "{body}: {detail}");
    }
    assert!(site.ends.try_recv().is_err());
    assert_eq!(site.post("/api/commands", r#"{"do":"shutdown"}"#).status, 200);
    site.ends.recv_timeout(Duration::from_secs(5)).expect("the program is told to end");
}

#[test]
fn the_stream_has_snapshots_and_events() {
    let site = site();
    let mut stream = site.stream("/api/stream");
    site.post("/api/commands", r#"{"do":"battery","state":"low"}"#);
    let event = stream.until("event", |event| event["kind"] == "warning_raised");
    assert_eq!(event["who"], "encoder");
    assert_eq!(event["warnings"], serde_json::json!(["battery_charge"]));
    stream.until("snapshot", |snapshot| snapshot["encoders"][0]["battery"] == "low");
    // It moves by half a turn a second: many snapshots, each later than the one before.
    site.post("/api/commands", r#"{"do":"shaft","shaft":"constant:30@here"}"#);
    let begun = Instant::now();
    let (mut last, mut count) = (0, 0);
    while begun.elapsed() < Duration::from_secs(1) {
        let snapshot = stream.until("snapshot", |_| true);
        let at = snapshot["stage"]["clock_ns"].as_u64().expect("a time");
        assert!(at > last);
        (last, count) = (at, count + 1);
    }
    assert!((8..=22).contains(&count), "{count} snapshots in a second");
    site.get("/api/stream?telegrams=maybe").problem(400);
}

#[test]
fn something_comes_every_second_even_where_nothing_happens() {
    let site = site();
    let mut stream = site.stream("/api/stream");
    let begun = Instant::now();
    for _ in 0..2 {
        stream.until("snapshot", |_| true);
    }
    let took = begun.elapsed();
    assert!((Duration::from_millis(900)..Duration::from_secs(4)).contains(&took), "{took:?}");
}

#[test]
fn telegrams_come_in_words() {
    let mut site = site();
    let mut stream = site.stream("/api/stream");
    let mut quiet = site.stream("/api/stream?telegrams=off");
    // The listener is on with the next batch.
    std::thread::sleep(Duration::from_millis(200));
    let mut master = site.master();
    master.diagnosis(5).expect("an answer");
    let batch = stream.until("telegrams", |_| true);
    assert_eq!(batch["dropped"], 0);
    let request = &batch["telegrams"][0];
    // By hand: DA 5 and SA 2 with SAPs, SRD high with FCB, DSAP 60, SSAP 62; the sum of these five octets is 0x1F0.
    assert_eq!(request["octets"], "68 05 05 68 85 82 6D 3C 3E EE 16");
    assert_eq!((&request["n"], &request["kind"]), (&1.into(), &"request".into()));
    assert_eq!((&request["from"], &request["to"]), (&2.into(), &5.into()));
    assert_eq!(request["segment"], "bus");
    assert!(request["what"].as_str().expect("words").starts_with("Slave_Diag"), "{request}");
    let dsap = request["fields"].as_array().expect("fields").iter().find(|field| field["name"] == "DSAP");
    let dsap = dsap.expect("a DSAP");
    assert_eq!((&dsap["first"], &dsap["last"], &dsap["value"]), (&8.into(), &8.into(), &60.into()));
    // The parameters of somebody else's device are refused, and the telegram says why.
    master.set_prm(5, &[0x88, 1, 20, 11, 0x12, 0x34, 0, 0, 0]).expect("an E5");
    let batch = stream.until("telegrams", |batch| {
        batch["telegrams"].as_array().is_some_and(|all| all.iter().any(|one| one["service"] == "Set_Prm"))
    });
    let all = batch["telegrams"].as_array().expect("a list");
    let request = all.iter().find(|one| one["kind"] == "request").expect("a request");
    let why = request["refused"].as_str().unwrap_or_default();
    assert!(why.contains("1234"), "{request}");
    for _ in 0..3 {
        let (name, _) = quiet.next().expect("it goes on");
        assert_ne!(name, "telegrams");
    }
}
