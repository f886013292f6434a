//! Shafts that are set from outside, and those that others drive.

mod common;

use common::bench;
use serde_json::Value;

/// Where the shafts are, each by its own clock, and those clocks.
fn positions(bench: &common::Bench) -> Vec<(i64, u64)> {
    let snapshot = bench.snapshot();
    let encoders = snapshot["encoders"].as_array().expect("encoders");
    let of = |encoder: &Value| Some((encoder["shaft_position"].as_i64()?, encoder["at_ns"].as_u64()?));
    encoders.iter().map(|encoder| of(encoder).expect("numbers")).collect()
}

// Both are on one segment, so at one moment: what the first turns, the second turns half, and the third,
// behind the second, turns three times as far back, whatever the first is given to do.
#[test]
fn a_coupled_shaft_turns_with_the_other_whatever_that_one_does() {
    let bench = bench(3);
    bench.done(r#"{"do":"shaft","encoder":1,"shaft":"still@1000000"}"#);
    bench.done(r#"{"do":"shaft","encoder":2,"shaft":"coupled:to=1:ratio=1/2@2000000"}"#);
    bench.done(
        r#"{"do":"shaft","encoder":3,"shaft":{"kind":"coupled","to":"encoder 2","ratio":-3,"raw":3000000}}"#,
    );
    for drive in [
        "constant:600@here",
        "sine:amplitude=3:period_s=0.01@here",
        "move:by=4:speed=1000:acceleration=100000@here",
    ] {
        let line = serde_json::json!({"do": "shaft", "encoder": 1, "shaft": drive}).to_string();
        bench.done(&line);
        std::thread::sleep(std::time::Duration::from_millis(20));
        let found = positions(&bench);
        let [first, second, third] = found[..] else { panic!("{found:?}") };
        assert_eq!((first.1, second.1), (third.1, third.1));
        let turned = first.0 - 1_000_000;
        assert_ne!(turned, 0, "{drive}");
        assert!((second.0 - 2_000_000 - turned / 2).abs() <= 4, "{drive}: {found:?}");
        assert!((third.0 - 3_000_000 + 3 * turned / 2).abs() <= 8, "{drive}: {found:?}");
    }
    // By itself again, the second leaves the third behind it.
    bench.done(r#"{"do":"shaft","encoder":2,"shaft":"still@5"}"#);
    let before = positions(&bench)[2].0;
    bench.done(r#"{"do":"shaft","encoder":1,"shaft":"constant:600@here"}"#);
    std::thread::sleep(std::time::Duration::from_millis(5));
    assert_eq!(positions(&bench)[1].0, 5);
    assert_eq!(positions(&bench)[2].0, before);
}

#[test]
fn a_shaft_that_would_drive_itself_is_refused() {
    let bench = bench(2);
    bench.done(r#"{"do":"shaft","encoder":2,"shaft":"coupled:to=1"}"#);
    for line in [
        r#"{"do":"shaft","encoder":1,"shaft":"coupled:to=1"}"#,
        r#"{"do":"shaft","encoder":1,"shaft":"coupled:to=2"}"#,
        r#"{"do":"shaft","encoder":"all","shaft":"coupled:to=2"}"#,
    ] {
        assert!(bench.refused(line).contains("driven by itself"), "{line}");
    }
    assert!(bench.refused(r#"{"do":"shaft","encoder":2,"shaft":"coupled:to=3"}"#).contains("no encoder 3"));
}
