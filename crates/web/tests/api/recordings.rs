//! Recordings: begun, ended, downloaded, removed, and bounded.

use std::io::Cursor;

use serde_json::{Value, json};

use crate::client::{Site, demonstration, site};

fn names(site: &Site) -> Vec<String> {
    let all = site.get("/api/recordings").json();
    let all = all["recordings"].as_array().expect("a list").iter();
    all.map(|one| one["name"].as_str().expect("a name").to_owned()).collect()
}

fn begin(site: &Site, request: &str) -> String {
    let begun = site.post("/api/recordings", request);
    assert_eq!(begun.status, 200, "{}", begun.text());
    let begun = begun.json();
    assert_eq!(begun["running"], true);
    begun["name"].as_str().expect("a name").to_owned()
}

fn stop(site: &Site, name: &str) -> Value {
    let stopped = site.post(&format!("/api/recordings/{name}/stop"), "");
    assert_eq!(stopped.status, 200);
    let stopped = stopped.json();
    assert_eq!((&stopped["running"], &stopped["trouble"]), (&json!(false), &Value::Null), "{stopped}");
    stopped
}

#[test]
fn what_is_on_the_bus_is_a_capture() {
    let mut site = site();
    let name = begin(&site, r#"{"kind":"pcapng"}"#);
    let mut master = site.master();
    master.status(5).expect("a bus");
    let stopped = stop(&site, &name);
    // Not recorded any more.
    master.diagnosis(5).expect("an answer");
    let file = site.get(&format!("/api/recordings/{name}"));
    assert_eq!(file.header("content-disposition"), Some(format!("attachment; filename=\"{name}\"").as_str()));
    let octets = file.header("transfer-encoding").map_or(file.body.clone(), |_| unchunked(&file.body));
    assert_eq!(octets.len() as u64, stopped["octets"]);
    let mut reader = capture::Reader::new(Cursor::new(octets)).expect("a capture");
    // A master that came is a packet without octets.
    let mut next = || loop {
        let packet = reader.next_packet().expect("a file");
        if packet.as_ref().is_none_or(|packet| !packet.octets.is_empty()) {
            return packet.map(|packet| packet.octets);
        }
    };
    // FDL_Status of master 2 and its answer, by hand: 5 + 2 + 0x49 = 0x50, 2 + 5 = 7.
    assert_eq!(next(), Some(vec![0x10, 5, 2, 0x49, 0x50, 0x16]));
    assert_eq!(next(), Some(vec![0x10, 2, 5, 0, 7, 0x16]));
    assert_eq!(next(), None);
}

#[test]
fn values_over_time_are_a_table() {
    let site = demonstration();
    let name = begin(&site, r#"{"kind":"csv"}"#);
    std::thread::sleep(std::time::Duration::from_millis(500));
    site.post("/api/commands", r#"{"do":"battery","state":"low"}"#);
    std::thread::sleep(std::time::Duration::from_millis(200));
    stop(&site, &name);
    let file = site.get(&format!("/api/recordings/{name}"));
    let text = String::from_utf8(unchunked(&file.body)).expect("text");
    let first = text.lines().next().expect("a head");
    for column in
        ["time_ns", "encoder", "event", "position", "velocity", "acceleration", "alarms", "warnings"]
    {
        assert!(first.split(',').any(|own| own == column), "{column}: {first}");
    }
    assert!(text.lines().filter(|line| line.contains("bus.encoder")).count() > 20, "{text}");
    assert!(text.lines().any(|line| line.contains("warning_raised")), "{text}");
}

#[test]
fn recordings_are_bounded_and_can_be_removed() {
    let site = site();
    site.post("/api/recordings", r#"{"kind":"pcapng","segment":"nothing"}"#).problem(404);
    for body in ["", r#"{"kind":"wav"}"#, "{}", r#"{"kind":"csv","more":1}"#] {
        site.post("/api/recordings", body).problem(400);
    }
    let running: Vec<_> = (0..4).map(|_| begin(&site, r#"{"kind":"csv"}"#)).collect();
    assert_eq!(names(&site), running);
    let detail = site.post("/api/recordings", r#"{"kind":"csv"}"#).problem(429);
    assert!(detail.contains("stop one"), "{detail}");
    for name in &running {
        stop(&site, name);
    }
    for _ in 4..16 {
        let name = begin(&site, r#"{"kind":"pcapng","segment":"bus"}"#);
        stop(&site, &name);
    }
    let detail = site.post("/api/recordings", r#"{"kind":"csv"}"#).problem(429);
    assert!(detail.contains("delete one"), "{detail}");
    let name = &running[0];
    assert_eq!(site.request("DELETE", &format!("/api/recordings/{name}")).send().status, 200);
    assert!(!names(&site).contains(name));
    begin(&site, r#"{"kind":"csv"}"#);
    for (method, path) in [
        ("GET", format!("/api/recordings/{name}")),
        ("POST", format!("/api/recordings/{name}/stop")),
        ("DELETE", format!("/api/recordings/{name}")),
        ("GET", "/api/recordings/..%2Fpasswd".to_owned()),
    ] {
        let detail = site.request(method, &path).send().problem(404);
        assert!(detail.contains("/api/recordings"), "{detail}");
    }
}

/// Octets out of chunks.
fn unchunked(body: &[u8]) -> Vec<u8> {
    let (mut octets, mut rest) = (Vec::new(), body);
    while let Some(end) = rest.windows(2).position(|two| two == b"\r\n") {
        let length =
            std::str::from_utf8(&rest[..end]).ok().and_then(|digits| usize::from_str_radix(digits, 16).ok());
        let length = length.expect("a length");
        if length == 0 {
            break;
        }
        octets.extend_from_slice(&rest[end + 2..end + 2 + length]);
        rest = &rest[end + 2 + length + 2..];
    }
    octets
}
