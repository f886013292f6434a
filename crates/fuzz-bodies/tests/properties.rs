//! The bodies of the fuzz targets over random octets, and over the corpora that fuzzing has left.

use std::fs;
use std::path::Path;

use fuzz_bodies::{BODIES, Body};
use proptest::prelude::*;

fn body(name: &str) -> Body {
    BODIES.iter().find(|(known, _)| *known == name).expect("a body of that name").1
}

/// Runs every input of a corpus; says which one it is that fails.
fn over_the_corpus(name: &str) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(name);
    let mut inputs = 0;
    for entry in fs::read_dir(&corpus).unwrap_or_else(|error| panic!("{}: {error}", corpus.display())) {
        let path = entry.unwrap().path();
        let octets = fs::read(&path).unwrap();
        let body = body(name);
        let outcome = std::panic::catch_unwind(|| body(&octets));
        assert!(outcome.is_ok(), "{}: see above", path.display());
        inputs += 1;
    }
    assert!(inputs >= 10, "{name}: only {inputs} inputs");
}

#[test]
fn every_body_has_a_target_and_a_corpus_and_nothing_else_has() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let corpora = fuzz.join("corpus");
    let mut names: Vec<_> = fs::read_dir(corpora)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let mut bodies: Vec<_> = BODIES.iter().map(|(name, _)| (*name).to_owned()).collect();
    bodies.sort();
    assert_eq!(names, bodies);
    let manifest = fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
    for body in bodies {
        let target = fs::read_to_string(fuzz.join(format!("fuzz_targets/{body}.rs"))).unwrap();
        assert!(target.contains(&format!("fuzz_bodies::{body}::{body}(octets)")), "{target}");
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{body}.rs\"")), "{body}");
    }
}

#[test]
fn receiver_over_its_corpus() {
    over_the_corpus("receiver");
}

#[test]
fn device_over_its_corpus() {
    over_the_corpus("device");
}

#[test]
fn state_over_its_corpus() {
    over_the_corpus("state");
}

#[test]
fn gsd_over_its_corpus() {
    over_the_corpus("gsd");
}

#[test]
fn scenario_over_its_corpus() {
    over_the_corpus("scenario");
}

#[test]
fn control_over_its_corpus() {
    over_the_corpus("control");
}

/// Octets of which a third are what telegrams begin and end with.
fn octets(most: usize) -> impl Strategy<Value = Vec<u8>> {
    let octet = prop_oneof![
        2 => any::<u8>(),
        1 => prop::sample::select(&[0x10, 0x16, 0x68, 0xA2, 0xDC, 0xE5, 0x00, 0xFF, 0x0B][..]),
    ];
    prop::collection::vec(octet, 0..most)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2_000) })]

    #[test]
    fn receiver_over_random_octets(octets in octets(600)) {
        body("receiver")(&octets);
    }

    #[test]
    fn state_over_random_octets(octets in prop::collection::vec(any::<u8>(), 0..90)) {
        body("state")(&octets);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn control_over_random_octets(octets in prop::collection::vec(any::<u8>(), 0..120)) {
        body("control")(&octets);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(3_000) })]

    #[test]
    fn gsd_over_random_octets(octets in prop::collection::vec(any::<u8>(), 0..120)) {
        body("gsd")(&octets);
    }

    #[test]
    fn scenario_over_random_octets(octets in prop::collection::vec(any::<u8>(), 0..120)) {
        body("scenario")(&octets);
    }

    #[test]
    fn device_over_random_octets(octets in octets(400)) {
        body("device")(&octets);
    }
}
