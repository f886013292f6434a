//! Shafts as users write them, and where they are when.

use super::*;

fn shaft(text: &str) -> Result<Shaft, ShaftError> {
    text.parse()
}

#[test]
fn a_still_shaft_stays_where_it_is() {
    let mut still = shaft("still@491520").expect("a shaft");
    assert_eq!(still.at(Instant::from_millis(0), Variant::FULL), 491_520);
    assert_eq!(still.at(Instant::from_millis(99_999), Variant::FULL), 491_520);
    assert_eq!(shaft("still").expect("a shaft").at(Instant::ZERO, Variant::FULL), 0);
}

// 3000 RPM are 50 turns a second: 3 276 800 counts with 16 bits.
#[test]
fn a_turning_shaft_turns_exactly() {
    let mut turning = shaft("constant:3000@100").expect("a shaft").started(Instant::from_millis(5));
    assert_eq!(turning.at(Instant::from_millis(5), Variant::FULL), 100);
    assert_eq!(turning.at(Instant::from_millis(1_005), Variant::FULL), 3_276_900);
    assert_eq!(turning.at(Instant::from_millis(15), Variant::FULL), 100 + 32_768);
    let mut back = shaft("constant:-60@0").expect("a shaft");
    assert_eq!(back.at(Instant::from_nanos(1), Variant::FULL), -1, "floor, not truncation");
    assert_eq!(back.at(Instant::from_millis(1_000), Variant::FULL), -65_536);
}

#[test]
fn what_is_no_shaft_is_told() {
    assert!(matches!(shaft("moving"), Err(ShaftError::Form(_))));
    assert!(matches!(shaft("still@1x"), Err(ShaftError::Raw(_))));
    assert!(matches!(shaft("constant:fast"), Err(ShaftError::Speed(_))));
    assert!(matches!(shaft("constant:nan"), Err(ShaftError::Speed(_))));
    assert!(matches!(shaft("constant:1e300"), Err(ShaftError::Speed(_))));
    assert!(shaft("still@-1").expect("text is fine").check(Variant::FULL).is_err());
    assert!(Shaft::still(i64::from(u32::MAX >> 1)).check(Variant::FULL).is_ok());
    assert!(Shaft::still(1 << 31).check(Variant::FULL).is_err());
}

const SECOND: u64 = 1_000_000_000;

fn positions(text: &str, millis: &[u64]) -> Vec<i64> {
    let mut shaft = shaft(text).unwrap_or_else(|error| panic!("{error}"));
    millis.iter().map(|&millis| shaft.at(Instant::from_millis(millis), Variant::FULL)).collect()
}

// From 0 to 60 RPM in 10 s are 5 turns: 327 680 counts; then a turn a second.
#[test]
fn a_ramp_goes_on_at_its_last_speed() {
    assert_eq!(
        positions("ramp:to_rpm=60:over_s=10@100", &[0, 5_000, 10_000, 11_000]),
        [100, 100 + 81_920, 100 + 327_680, 100 + 393_216]
    );
    let mut ramp = shaft("ramp:to_rpm=60:over_s=10").unwrap();
    assert!((ramp.rpm(Instant::from_millis(5_000)) - 30.0).abs() < 1e-9);
}

// Two turns to each side in 30 s; a twelfth of it is half the amplitude.
#[test]
fn a_sine_swings_to_both_sides() {
    assert_eq!(
        positions("sine:amplitude=2:period_s=30@0", &[0, 2_500, 7_500, 15_000, 22_500]),
        [0, 65_536, 131_072, 0, -131_072]
    );
    let days = 86_400_000 * 365;
    assert_eq!(positions("sine:amplitude=2:period_s=30", &[days + 2_500]), [65_536]);
}

// Half a metre for a turn: 3.2 m are 6.4 turns, 419 430.4 counts. 4 s at 0.8 m/s and 2 s more for
// coming up to speed (without a limit of the jerk); then 2 s at the top, and down.
#[test]
fn a_hoist_goes_up_and_down_for_ever() {
    let hoist = "hoist:by=3.2:speed=0.8:acceleration=0.4:pause_s=2:unit=m:per_turn=0.5@1000";
    let once = positions(hoist, &[0, 3_000, 6_000, 8_000, 11_000, 14_000, 16_000]);
    assert_eq!(once, [1_000, 1_000 + 209_715, 420_430, 420_430, 210_715, 1_000, 1_000]);
    let later = positions(hoist, &[16_000_000 + 3_000, 16_000_000 + 6_000]);
    assert_eq!(later, [210_715, 420_430]);
}

// A drum whose rope lies at 1 m in the first layer of ten turns and at 1.06 m in the second: 15 turns
// are (10 + 5.3) pi of rope, a quarter of that at the hook of four lines.
#[test]
fn a_trip_winds_its_rope_in_layers() {
    let by = (10.0 + 5.3) * std::f64::consts::PI / 4.0;
    let trip = format!(
        "trip:by={by}:speed=10:acceleration=1000:pause_s=5:drum_diameter=0.97:rope_diameter=0.03:\
         turns_per_layer=10:lines=4"
    );
    let found = positions(&trip, &[4_000, 3_000_000])[0];
    assert!((found - 15 * 65_536).abs() <= 1, "{found}");
}

#[test]
fn texts_and_fields_are_the_same_shafts_and_print_as_texts() {
    for text in [
        "still@5",
        "constant:-12.5@7",
        "ramp:from_rpm=-10.0:over_s=2.5:to_rpm=20.0@5",
        "constant:backlash_deg=1.5:rpm=60.0@0",
        "walk:every_s=0.5:rpm=30.0:seed=7:within=10.0@9",
    ] {
        let parsed = shaft(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(parsed.to_string(), text);
        let fields = ShaftFields::parse(text).unwrap();
        let json = serde_json::to_string(&fields).unwrap();
        let read: ShaftFields = serde_json::from_str(&json).unwrap();
        assert_eq!(Shaft::try_from(&read).unwrap(), parsed);
    }
}

#[test]
fn every_example_is_a_shaft_and_what_a_kind_does_not_take_is_told() {
    for kind in ["still", "constant", "ramp", "sine", "move", "hoist", "trip", "walk"] {
        let kind: ShaftKind = serde_json::from_value(kind.into()).unwrap();
        shaft(kind.form().example).unwrap_or_else(|error| panic!("{error}"));
    }
    for (text, word) in [
        ("still:rpm=5", "rpm"),
        ("ramp:over_s=5", "to_rpm"),
        ("ramp:to_rpm=5:over_s=0", "over_s"),
        ("sine:amplitude=2", "period_s"),
        ("move:by=1:speed=0:acceleration=1", "speed"),
        ("trip:by=1:speed=1:acceleration=1", "drum"),
        ("walk:rpm=60:every_s=1:within=0.5", "within"),
        ("hoist:by=1:speed=1:acceleration=1:unit=m", "per_turn"),
        ("constant:60:vibration_hz=5", "vibration_deg"),
        ("ramp:to_rpm=5:over_s=1:over_s=2", "twice"),
        ("ramp:to_rpm=5:overs=1", "overs"),
        ("playback:file=/does/not/exist", "/does/not/exist"),
        ("coupled:to=1", "control socket"),
        ("coupled:to=1:ratio=1/0", "3/2"),
    ] {
        let error = shaft(text).expect_err(text).to_string();
        assert!(error.contains(word), "{text}: {error}");
    }
}

// Three turns for two, the other way round, from where both are.
#[test]
fn a_coupled_shaft_turns_with_the_other() {
    let coupling = ShaftFields::parse("coupled:to=1:ratio=-3/2").unwrap().coupling().unwrap().unwrap();
    let drive = shaft("constant:60@1000").unwrap();
    let now = Instant::from_millis(2_000);
    let mut driven = drive.geared(&coupling, now, 500, Variant::FULL);
    assert_eq!(driven.at(now, Variant::FULL), 500);
    assert_eq!(driven.at(Instant::from_millis(4_000), Variant::FULL), 500 - 3 * 65_536);
    // One behind it with a third of its turns: half of the first, and no drift after a day.
    let third = ShaftFields::parse("coupled:to=2:ratio=-1/3").unwrap().coupling().unwrap().unwrap();
    let mut last = driven.geared(&third, now, 0, Variant::FULL);
    assert_eq!(last.at(Instant::from_nanos(86_402 * SECOND), Variant::FULL), 43_200 * 65_536);
}

#[test]
fn vibration_comes_on_top_and_play_takes_off() {
    // A degree is 182.04 counts; the quarter of a period of 10 Hz is 25 ms.
    assert_eq!(
        positions("still:vibration_deg=1:vibration_hz=10@1000", &[0, 25, 50, 75]),
        [1_000, 1_182, 1_000, 817]
    );
    // Play of 90 degrees takes 45 off.
    assert_eq!(positions("constant:60:backlash_deg=90", &[100, 1_000]), [0, 65_536 - 8_192]);
}

#[test]
fn a_file_is_played_back() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a:b@c.csv");
    std::fs::write(&file, "time,position\n0,1\n2,3\n").unwrap();
    let text = format!("playback:per_turn=0.5:file={}", file.display());
    assert_eq!(positions(&text, &[0, 1_000, 5_000]), [131_072, 262_144, 393_216]);
    let text = format!("playback:per_turn=0.5:repeat=true:file={}", file.display());
    assert_eq!(positions(&text, &[1_000, 5_000]), [262_144, 262_144]);
}

// The highest speed of each by hand: 2 pi 2 / 3 s and so on, the hoist's and the trip's limits, and what
// shaking adds. A tester who looks at the speed wants neither to miss one above 3000 RPM nor to look in vain.
#[test]
fn no_shaft_is_faster_than_it_says_and_each_is_as_fast_at_times() {
    let tau = std::f64::consts::TAU;
    for (text, rpm) in [
        ("ramp:from_rpm=-900:to_rpm=600:over_s=10", 900.0),
        ("sine:amplitude=2:period_s=3", tau * 2.0 / 3.0 * 60.0),
        ("hoist:by=3.2:speed=0.8:back_speed=1:acceleration=0.4:jerk=1:pause_s=2:unit=m:per_turn=-0.5", 120.0),
        ("move:by=10:speed=2:acceleration=10", 120.0),
        // A metre a second of a quarter of the rope, which lies at a diameter of 1 m in the first layer.
        (
            "trip:by=5:speed=1:acceleration=1:pause_s=5:drum_diameter=0.97:rope_diameter=0.03:turns_per_layer=10:lines=4",
            240.0 / std::f64::consts::PI,
        ),
        ("constant:backlash_deg=1:rpm=-60", 60.0),
        ("constant:rpm=30:vibration_deg=3.6:vibration_hz=50", 30.0 + tau * 0.01 * 50.0 * 60.0),
        ("walk:rpm=30:every_s=0.01:seed=7", 30.0),
    ] {
        let mut shaft = shaft(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let highest = |shaft: &mut Shaft| {
            let speeds = (0..40_000_u64).map(|step| shaft.rpm(Instant::from_micros(step * 997)).abs());
            speeds.fold(0.0, f64::max)
        };
        let (found, bound) = (highest(&mut shaft), shaft.moving.as_ref().unwrap().most_rpm());
        assert!((bound / rpm - 1.0).abs() < 1e-3, "{text}: at most {bound}, and {rpm} by hand");
        assert!(found <= bound && found > 0.99 * bound, "{text}: {found} of {bound}");
    }
    for (text, rpm, may) in [
        ("constant:3000", 3000, false),
        ("constant:-3001", 3000, true),
        ("sine:amplitude=2:period_s=3", 251, true),
    ] {
        assert_eq!(shaft(text).unwrap().may_exceed(rpm), may, "{text}");
    }
    // A move that is too short for its speed: it turns round at a speed of 2.
    assert!(!shaft("move:by=4:speed=100:acceleration=1").unwrap().may_exceed(121));
}
