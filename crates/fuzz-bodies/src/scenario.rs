//! A scenario file: any octets, and text made of what scenario files are made of.

use std::path::Path;

use plant::scenario::{MOST_OCTETS, Scenario};

use crate::tape::Tape;

/// What lines of scenario files are made of.
const FRAGMENTS: [&str; 64] = [
    "[[segment]]\n",
    "[[segment.encoder]]\n",
    "[segment.master]\n",
    "[[segment.master.poll]]\n",
    "[[event]]\n",
    "[[expect]]\n",
    "name = \"hoist\"\n",
    "name = \"crane\"\n",
    "name = ",
    "rate = 500000\n",
    "rate = ",
    "port = \"pty\"\n",
    "cable = [\"hoist\", \"master\"]\n",
    "switches = \"05\"\n",
    "bits = \"13x12\"\n",
    "count = 3\n",
    "serial = \"1234567\"\n",
    "ident = 0x108B\n",
    "state = \"x.state\"\n",
    "shaft = \"constant:60\"\n",
    "shaft = { kind = \"still\", raw = 5 }\n",
    "shaft = ",
    "per_revolution = \"0.5 m\"\n",
    "encoder = \"hoist\"\n",
    "encoder = \"crane.hoist\"\n",
    "encoder = \"bus.hoist\"\n",
    "encoder = 1\n",
    "measuring_units_per_revolution = 4096\n",
    "total_measuring_range = 10000\n",
    "parameters = \"00 0A\"\n",
    "watchdog = \"200 ms\"\n",
    "at = \"1 s\"\n",
    "at = 2\n",
    "at = ",
    "do = \"supply\"\nvolts = 8.5\n",
    "do = \"preset\"\nvalue = 7\n",
    "do = \"leave\"\n",
    "do = ",
    "position = \"3.20 m\"\n",
    "within = \"2 mm\"\n",
    "position = 5\n",
    "state = \"data_exchange\"\n",
    "event = \"power_on\"\n",
    "sees = \"battery_charge\"\n",
    "diagnosis = { octet = 8, bit = 0 }\n",
    "duration = \"10 s\"\n",
    "joins_at = 1\n",
    "joined = false\n",
    "machine = { unit = \"mm\", per_turn = 0.5, zero = 7 }\n",
    "machine = { drum = { drum_diameter = 1, rope_diameter = 0.03, turns_per_layer = 10 } }\n",
    "position = \"-90 deg\"\n",
    "thermal = { ambient = 40 }\n",
    "discharge = { charge = 50, hours_without_power = 1 }\n",
    "supply_profile = { points = [[0, 24], [1, 5]] }\n",
    "led_ageing = 1e3\n",
    "endurance = 9\n",
    "gsd = \"x.gsd\"\n",
    "reflections = true\n",
    "shaft = \"playback:file=x.csv\"\n",
    "do = \"cut\"\nafter = 1\n",
    "do = \"shaft\"\nshaft = \"hoist:by=1:speed=1:acceleration=1:unit=m:per_turn=2@here\"\n",
    "{ a = [1, 2], b = 3 }\n",
    "1e308\n",
    "\"\u{e4}\u{1b}[2J\"\n",
];

/// The first octet says whether the others are the file, or choose what it is made of.
///
/// # Panics
///
/// When a file that is none is told without a sentence, a remedy or a place within it, or one that is a scenario
/// has names that are nobody's.
pub fn scenario(octets: &[u8]) {
    let mut tape = Tape::new(octets);
    let file = if tape.octet() & 1 == 0 {
        tape.slice(octets.len()).to_vec()
    } else {
        let chosen = tape.slice(octets.len()).iter().take(400);
        chosen.flat_map(|octet| FRAGMENTS[usize::from(*octet) % FRAGMENTS.len()].bytes()).collect()
    };
    assert!(file.len() <= MOST_OCTETS);
    let source = String::from_utf8_lossy(&file);
    match Scenario::parse_octets(&file, Path::new("/nowhere")) {
        Ok(scenario) => {
            let names: Vec<_> = scenario.encoders().map(|encoder| encoder.name.as_str()).collect();
            assert!(!names.is_empty());
            for (at, name) in names.iter().enumerate() {
                assert!(!names[at + 1..].contains(name), "{name} is there twice");
            }
            for poll in
                scenario.segments.iter().filter_map(|segment| segment.master.as_ref()).flat_map(|m| &m.polls)
            {
                assert!(names.contains(&poll.encoder.as_str()), "{}", poll.encoder);
            }
            assert!(scenario.events.windows(2).all(|pair| pair[0].at <= pair[1].at), "events out of order");
        }
        Err(faults) => {
            assert!((1..=20).contains(&faults.0.len()), "{} faults", faults.0.len());
            for fault in &faults.0 {
                assert!(!fault.message.is_empty() && !fault.hint.is_empty(), "{fault:?}");
                let text = fault.render("file", &source);
                assert!(!text.contains('\u{1b}') && text.len() < 4_000, "{text}");
            }
        }
    }
}
