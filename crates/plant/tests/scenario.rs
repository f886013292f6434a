//! Scenario files: what is read, what is told of those that are none, and what is played.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use plant::Report;
use plant::scenario::{Outcome, Progress, Scenario, Verdict, keys, run, schema};
use profibus_dp::time::{Duration, Instant};
use serde_json::Value;

const BASE: &str = r#"
[[segment]]
name = "crane"
rate = 1500000

[[segment.encoder]]
name = "hoist"
switches = "05"
per_revolution = "1 m"
shaft = "constant:60"

[segment.master]

[[segment.master.poll]]
encoder = "hoist"
time_base = "100 ms"
"#;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn examples() -> Vec<(String, String)> {
    let folder = root().join("examples/scenarios");
    let mut all: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .map(|path| {
            (path.file_stem().unwrap().to_string_lossy().into_owned(), std::fs::read_to_string(path).unwrap())
        })
        .collect();
    all.sort();
    all
}

#[track_caller]
fn parsed(source: &str) -> Scenario {
    Scenario::parse(source).unwrap_or_else(|faults| panic!("{}", faults.render("scenario", source)))
}

/// What is told of a source that is no scenario.
#[track_caller]
fn told(source: &str) -> String {
    Scenario::parse(source).expect_err("it is none").render("f", source)
}

#[track_caller]
fn played(source: &str) -> Outcome {
    run(&parsed(source), source, &mut ()).expect("it is played")
}

fn with(rest: &str) -> String {
    format!("{BASE}{rest}")
}

#[test]
fn every_example_holds_and_gives_the_same_octets_on_every_run() {
    let all = examples();
    assert!(all.len() >= 7, "{}", all.len());
    for (name, source) in &all {
        let first = played(source);
        let broken: Vec<_> = first.expectations.iter().filter(|verdict| !verdict.holds).collect();
        assert!(first.passed && first.troubles.is_empty(), "{name}: {broken:?} {:?}", first.troubles);
        assert!(first.expectations.len() >= 4, "{name} expects little");
        assert!(first.segments.iter().all(|segment| segment.octets > 1000), "{name}: {first:?}");
        assert_eq!(first, played(source), "{name}");
    }
}

/// Whoever steps in odd pieces.
struct Fidgety;

impl Progress for Fidgety {
    fn longest_step(&self) -> Duration {
        Duration::from_nanos(1_234_567)
    }
}

#[test]
fn the_octets_do_not_depend_on_how_the_time_is_cut() {
    for (name, source) in examples().iter().filter(|(name, _)| !name.contains("weekend")) {
        let pieces = run(&parsed(source), source, &mut Fidgety).unwrap();
        assert_eq!(pieces, played(source), "{name}");
    }
}

#[test]
fn another_seed_gives_other_octets() {
    let (_, source) = examples().into_iter().find(|(name, _)| name.contains("draw-works")).unwrap();
    let other = source.replace("seed = 7", "seed = 8");
    assert_ne!(source, other);
    assert_ne!(played(&source).segments, played(&other).segments);
}

// Each expectation of each example is broken once, where that is a number or a truth.
#[test]
fn an_expectation_that_is_wrong_is_found() {
    let mut broken = 0;
    for (name, source) in examples() {
        let lines: Vec<_> = source.lines().collect();
        let expects = |at: usize| lines[..at].iter().rev().find(|line| line.starts_with('['));
        for (at, line) in lines.iter().enumerate() {
            if expects(at) != Some(&"[[expect]]") {
                continue;
            }
            let changed = match line.split_once(" = ") {
                Some((key @ ("position" | "velocity" | "offset" | "address"), value))
                    if !value.starts_with('"') =>
                {
                    format!("{key} = {}", value.parse::<i64>().unwrap() + 50)
                }
                Some(("position", value)) => format!("position = \"9{}", &value[1..]),
                Some(("exchanging" | "seen", value)) => {
                    let key = line.split(' ').next().unwrap();
                    format!("{key} = {}", value != "true")
                }
                Some(("cycles", _)) => "before = \"1 us\"\nafter = \"0 s\"".to_owned(),
                Some(("alarms", _)) => "alarms = [\"supply_voltage\"]".to_owned(),
                Some(("inputs", _)) => "inputs = \"FF\"".to_owned(),
                _ => continue,
            };
            let mut changed_lines: Vec<_> = lines.iter().map(ToString::to_string).collect();
            changed_lines[at] = changed;
            let source = changed_lines.join("\n").replace("\nafter = \"10 s\"\nbefore", "\nbefore");
            let Ok(scenario) = Scenario::parse(&source) else {
                continue;
            };
            let outcome = run(&scenario, &source, &mut ()).unwrap();
            assert!(!outcome.passed, "{name}: {} is not judged", changed_lines[at]);
            broken += 1;
        }
    }
    assert!(broken >= 25, "{broken}");
}

#[test]
fn values_of_every_kind_are_judged() {
    for (holds, breaks) in [
        ("at = 2\nposition = 131072", "at = 2\nposition = 131000"),
        ("at = 2\nposition = \"2 m\"\nwithin = \"1 mm\"", "at = 2\nposition = \"2.1 m\"\nwithin = \"1 mm\""),
        ("at = 2\nposition = 131072\nwithin = 1", "at = 2\nposition = 131080\nwithin = 1"),
        // A turn a second: 6553.6 counts in 100 ms.
        ("at = 2\nvelocity = 6553\nwithin = 1", "at = 2\nvelocity = 6540\nwithin = 1"),
        ("at = 2\nacceleration = 0\nwithin = 1", "at = 2\nacceleration = 9"),
        ("at = 2\nstate = \"data_exchange\"", "at = 2\nstate = \"off\""),
        ("at = 2\naddress = 5", "at = 2\naddress = 0"),
        ("at = 2\nwarnings = []", "at = 2\nwarnings = [\"battery_charge\"]"),
        ("at = 2\nalarms = []", "at = 2\nalarms = [\"position_error\"]"),
        ("at = 2\nexchanging = true", "at = 2\nexchanging = false"),
        ("at = 2\ndiagnosis = { octet = 10, bit = 1 }", "at = 2\ndiagnosis = { octet = 10, bit = 0 }"),
        ("event = \"data_exchange_entered\"", "event = \"data_exchange_entered\"\nseen = false"),
        ("event = \"power_on\"\nfields = { address = 5 }", "event = \"power_on\"\nfields = { address = 6 }"),
        ("event = \"power_on\"\nbefore = 0", "event = \"power_on\"\nafter = 1"),
        ("event = \"termination\"\nseen = false", "event = \"termination\""),
    ] {
        let holds = with(&format!("[[expect]]\n{holds}\n"));
        let outcome = played(&holds);
        assert!(outcome.passed, "{holds} {:?}", outcome.expectations);
        let breaks = with(&format!("[[expect]]\n{breaks}\n"));
        assert!(!played(&breaks).passed, "{breaks}");
    }
}

// Manual 4.2.9: the warning of the temperature; the answer to the next Data_Exchange tells that there is news.
#[test]
fn what_the_master_sees_is_counted_in_cycles() {
    let heat = "[[event]]\nat = 1\ndo = \"temperature\"\ncelsius = 66\n[[expect]]\nsees = \"temperature_exceeded\"\n";
    assert!(played(&with(&format!("{heat}after = 1\ncycles = 1\n"))).passed);
    assert!(!played(&with(&format!("{heat}after = 1\nbefore = \"1.000001 s\"\n"))).passed);
    // From 0.9 s on it takes eleven cycles of 10 ms.
    assert!(!played(&with(&format!("{heat}after = 0.9\ncycles = 10\n"))).passed);
    assert!(played(&with(&format!("{heat}after = 0.9\ncycles = 11\n"))).passed);
    let other = heat.replace("sees = \"temperature_exceeded\"", "sees = \"supply_voltage\"");
    assert!(!played(&with(&other)).passed);
}

#[test]
fn stations_leave_and_join_at_run_time() {
    let outcome = played(&with(
        "[[event]]\nat = 1\ndo = \"leave\"\n[[event]]\nat = 2\ndo = \"join\"\n\
         [[expect]]\nat = 1.5\nexchanging = false\nstate = \"data_exchange\"\n\
         [[expect]]\nat = 3\nexchanging = true\nposition = 196608\n\
         [[expect]]\nevent = \"left_bus\"\nafter = 1\nbefore = 1.01\n\
         [[expect]]\nevent = \"joined_bus\"\nfields = { address = 5 }\nafter = 2\n",
    ));
    assert!(outcome.passed, "{:?}", outcome.expectations);
    let late = BASE.replace("switches = \"05\"", "switches = \"05\"\njoined = false");
    let outcome = played(&format!(
        "{late}[[event]]\nat = 1\ndo = \"join\"\n[[expect]]\nat = 1\nexchanging = false\n[[expect]]\nat = 2\nexchanging = true\n"
    ));
    assert!(outcome.passed, "{:?}", outcome.expectations);
}

#[test]
fn a_full_bus_of_encoders_is_kept_in_data_exchange() {
    let source = "[[segment]]\nrate = 12000000\n[[segment.encoder]]\nname = \"e\"\ncount = 125\nswitches = \"01\"\n\
                  [segment.master]\naddress = 0\ncycle = \"1 ms\"\n[[segment.master.poll]]\nencoder = \"e\"\nwatchdog = \"100 ms\"\n\
                  [[expect]]\nat = 1\nencoder = \"bus.e-125\"\nexchanging = true\naddress = 125\n\
                  [[expect]]\nevent = \"waiting_for_parameters\"\nseen = false\n";
    let outcome = played(source);
    assert!(outcome.passed, "{:?}", outcome.expectations);
    let encoders = &outcome.segments[0].encoders;
    assert_eq!(encoders.len(), 125);
    assert!(encoders.iter().all(|encoder| encoder.failures == 0 && encoder.exchanges > 50), "{encoders:?}");
}

#[test]
fn encoders_that_search_the_rate_find_it() {
    let source = BASE.replace("rate = 1500000", "rate = 187500\nsearch = true");
    let outcome = played(&format!("{source}[[expect]]\nat = 20\nexchanging = true\n"));
    assert!(outcome.passed, "{:?}", outcome.expectations);
}

#[test]
fn a_coupled_shaft_follows_the_other_one() {
    let coupled = "[[segment.encoder]]\nname = \"slew\"\nswitches = \"06\"\n\n[segment.master]";
    let source = BASE.replace("[segment.master]", coupled);
    let outcome = played(&format!(
        "{source}[[event]]\nat = 0\ndo = \"shaft\"\nencoder = \"crane.slew\"\n\
         shaft = {{ kind = \"coupled\", to = \"crane.hoist\", ratio = \"1/4\", raw = 0 }}\n\
         [[expect]]\nat = 2\nencoder = \"crane.slew\"\nposition = 32768\nwithin = 40\n"
    ));
    assert!(outcome.passed, "{:?} {:?}", outcome.expectations, outcome.troubles);
    let at_once =
        BASE.replace("\"constant:60\"", "{ kind = \"coupled\", to = \"crane.hoist\", ratio = \"1/4\" }");
    assert!(told(&at_once).contains("an event at 0 s"), "{}", told(&at_once));
}

#[test]
fn state_files_outlive_a_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let source = BASE
        .replace("switches = \"05\"", "switches = \"05\"\nstate = \"hoist.state\"")
        .replace("shaft = \"constant:60\"", "shaft = \"still@40000\"");
    let first = format!("{source}[[event]]\nat = 1\ndo = \"preset\"\nencoder = \"crane.hoist\"\nvalue = 7\n");
    let second = format!("{source}[[expect]]\nat = 1\nposition = 7\noffset = -39993\n");
    for source in [first, second] {
        let mut scenario = parsed(&source);
        scenario.resolve_paths(folder.path());
        let outcome = run(&scenario, &source, &mut ()).unwrap();
        assert!(outcome.passed, "{:?}", outcome.expectations);
    }
    assert!(folder.path().join("hoist.state").exists());
}

#[test]
fn an_event_that_cannot_be_done_fails_the_scenario() {
    let outcome = played(&with("[[event]]\nat = 1\ndo = \"operating_time\"\nhours = 3\n"));
    assert!(!outcome.passed);
    assert!(
        outcome.troubles[0].starts_with("line 19: ") && outcome.troubles[0].contains("switch it off"),
        "{outcome:?}"
    );
}

/// Ends it at the first opportunity.
struct Impatient(Vec<Verdict>);

impl Progress for Impatient {
    fn step(&mut self, to: Instant) -> ControlFlow<()> {
        if to > Instant::from_millis(500) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn report(&mut self, report: &Report) {
        assert!(report.at < Instant::from_millis(600));
    }

    fn verdict(&mut self, verdict: &Verdict) {
        self.0.push(verdict.clone());
    }
}

#[test]
fn a_scenario_that_is_ended_early_has_not_passed() {
    let source = with("[[expect]]\nat = 2\nexchanging = true\n[[expect]]\nevent = \"power_on\"\n");
    let mut watch = Impatient(Vec::new());
    let outcome = run(&parsed(&source), &source, &mut watch).unwrap();
    assert!(!outcome.passed && outcome.troubles[0].contains("before its time"), "{outcome:?}");
    assert_eq!(watch.0, outcome.expectations);
    assert!(!watch.0[0].holds && watch.0[1].holds);
}

// The line is that of the mistake, the sentence says what is wrong, and the hint what to write.
#[test]
fn mistakes_are_told_with_their_line_and_a_remedy() {
    for (from, to, line, parts) in [
        ("rate = 1500000", "rate = 115200", 4, &["no rate of PROFIBUS", "9600, 19200"][..]),
        ("rate = 1500000", "rat = 1500000", 4, &["no key \"rat\"", "is `rate` meant?"]),
        ("rate = 1500000", "rate = \"fast\"", 4, &["whole number", "this is a text"]),
        ("switches = \"05\"", "switches = 5", 8, &["`switches` is a text"]),
        ("switches = \"05\"", "switches = \"5G\"", 8, &["two hexadecimal digits"]),
        ("switches = \"05\"", "switches = \"7E\"", 15, &["no address", "add `address`"]),
        ("name = \"hoist\"", "name = \"ho.ist\"", 7, &["is no name", "letters"]),
        ("name = \"hoist\"", "nam = \"hoist\"", 6, &["needs `name`"]),
        ("name = \"hoist\"", "name = \"hoist\"\ncolour = 1", 8, &["no key \"colour\"", "it has name"]),
        (
            "encoder = \"hoist\"",
            "encoder = \"hoits\"",
            15,
            &["no encoder \"hoits\"", "is \"crane.hoist\" meant?"],
        ),
        ("time_base = \"100 ms\"", "time_base = \"100ms\"", 16, &["is \"100 ms\" meant?"]),
        ("\"constant:60\"", "\"constant:fast\"", 10, &["`fast` is no speed"]),
        ("\"constant:60\"", "\"still@-1\"", 10, &["outside the physical range"]),
        ("\"1 m\"", "\"1 parsec\"", 9, &["length or an angle"]),
        ("[segment.master]", "[[segment.master]]", 12, &["`master` is a table", "[segment.master]"]),
        ("[[segment]]", "[segment]", 2, &["list of tables"]),
        ("name = \"crane\"", "name = \"crane", 3, &["no TOML"]),
        ("name = \"crane\"", "name = \"crane\"\ncable = [\"master\", \"slew\"]", 4, &["no encoder \"slew\""]),
        ("name = \"crane\"", "name = \"crane\"\ncable = [\"hoist\"]", 4, &["the master is not in the cable"]),
        ("time_base = \"100 ms\"", "cfg = 1", 16, &["no key \"cfg\"", "it has encoder"]),
        ("time_base = \"100 ms\"", "parameters = \"0G\"", 16, &["no hexadecimal octets"]),
        ("time_base = \"100 ms\"", "watchdog = \"11 min\"", 16, &["outside its range", "650.25 s"]),
    ] {
        assert!(BASE.contains(from), "{from}");
        let told = told(&BASE.replacen(from, to, 1));
        assert!(told.starts_with(&format!("f:{line}:")), "{to}: {told}");
        for part in parts {
            assert!(told.contains(part), "{to}: {part}: {told}");
        }
        assert!(told.contains("hint: "), "{told}");
    }
}

#[test]
fn mistakes_in_events_and_expectations_are_told_too() {
    for (text, line, parts) in [
        ("[[event]]\ndo = \"power\"\nstate = \"on\"", 17, &["needs `at`", "add at = \"1 s\""][..]),
        ("[[event]]\nat = 1\ndo = \"suply\"\nvolts = 1", 19, &["is \"supply\" meant?"]),
        ("[[event]]\nat = 1\ndo = \"supply\"\nvolt = 1", 20, &["unknown field `volt`", r#""volts":8.5"#]),
        ("[[event]]\nat = 1\ndo = \"supply\"", 19, &["missing field `volts`"]),
        ("[[event]]\nat = 1\ndo = \"supply\"\nvolts = 850", 20, &["-100 to 100"]),
        ("[[event]]\nat = 1\ndo = \"light\"\nstate = \"dim\"", 20, &["unknown variant `dim`"]),
        ("[[event]]\nat = 1\ndo = \"shaft\"\nshaft = \"spin\"", 20, &["is no shaft"]),
        ("[[event]]\nat = 1\ndo = \"snapshot\"", 19, &["`do` cannot be \"snapshot\""]),
        ("[[event]]\nat = \"soon\"\ndo = \"join\"", 18, &["`at` is no time", "250 ms"]),
        ("[[event]]\nat = -1\ndo = \"join\"", 18, &["`at` is no time"]),
        ("[[event]]\nat = 1\ndo = \"join\"\nencoder = \"crane.hoits\"", 20, &["is \"crane.hoist\" meant?"]),
        ("[[event]]\nat = 1\ndo = \"join\"\nencoder = 2", 20, &["numbered from 1 to 1"]),
        ("[[event]]\nat = 1\ndo = \"preset\"\nvalue = 0x80000000", 20, &["31 bits"]),
        ("[[event]]\nat = 1\ndo = \"set_address\"\nfrom = 126\nto = 126", 19, &["no addresses"]),
        ("[[expect]]\nat = 1", 17, &["expects nothing"]),
        ("[[expect]]\nat = 1\nposition = \"1 deg\"", 19, &["lengths and angles"]),
        ("[[expect]]\nat = 1\nstate = \"sleeping\"", 19, &["data_exchange"]),
        ("[[expect]]\nat = 1\nevent = \"power_on\"", 18, &["`at` does not go together"]),
        ("[[expect]]\nevent = \"power_om\"", 18, &["is \"power_on\" meant?"]),
        ("[[expect]]\nat = 1\nwarnings = [\"battery\"]", 19, &["battery_charge"]),
        ("[[expect]]\nat = 1\ndiagnosis = { octet = 58, bit = 0 }", 19, &["octets from 1 to 57"]),
        ("[[expect]]\nat = 1\nencoder = \"hoist\"\naddress = 5", 19, &["is \"crane.hoist\" meant?"]),
        ("[[expect]]\nsees = \"battery_charge\"\nafter = 2\nbefore = 1", 20, &["earlier than `after`"]),
    ] {
        let told = told(&with(&format!("{text}\n")));
        assert!(told.starts_with(&format!("f:{line}:")), "{text}: {told}");
        for part in parts {
            assert!(told.contains(part), "{text}: {part}: {told}");
        }
        assert!(told.contains("hint: "), "{told}");
    }
    let short = format!("duration = 1\n{BASE}[[expect]]\nat = 2\naddress = 5\n");
    assert!(told(&short).starts_with("f:1:12: it ends before"), "{}", told(&short));
}

#[test]
fn names_ports_and_state_files_are_not_shared() {
    let two = |a: &str, b: &str| {
        format!(
            "[[segment]]\n[[segment.encoder]]\nname = \"a\"\n{a}\n[[segment.encoder]]\nname = \"b\"\n{b}\n"
        )
    };
    let shared = told(&two("state = \"x.state\"", "state = \"./x.state\""));
    assert!(shared.starts_with("f:7:9: another encoder keeps its memory"), "{shared}");
    assert!(told(&two("", "").replace("\"b\"", "\"a\"")).contains("two encoders \"bus.a\""));
    assert!(
        told("[[segment]]\n[[segment.encoder]]\nname = \"a\"\ncount = 2\nstate = \"s\"\n")
            .contains("cannot share")
    );
    assert!(
        told("[[segment]]\n[[segment.encoder]]\nname = \"a\"\ncount = 126\nswitches = \"05\"\n")
            .contains("past address 125")
    );
    let segment = |port: &str| {
        format!("[[segment]]\nname = \"x\"\nport = \"{port}\"\n[[segment.encoder]]\nname = \"a\"\n")
    };
    let both = |port: &str| segment(port) + &segment(port).replace("\"x\"", "\"y\"");
    assert!(told(&both("/dev/ttyUSB0")).contains("at this port already"));
    assert!(Scenario::parse(&both("tcp-listen:127.0.0.1:0")).is_ok());
    assert!(told(&(segment("pty") + &segment("pty"))).contains("two segments \"x\""));
}

#[test]
fn hostile_files_get_a_sentence() {
    let deep = format!("a = {}1{}", "[".repeat(100_000), "]".repeat(100_000));
    let dotted = format!("{}a = 1", "a.".repeat(50_000));
    let long = format!("{}{}", "x".repeat(1_000_000), " = ");
    let many = format!("[[segment]]\n{}", "[[segment.encoder]]\nname = \"a\"\n".repeat(20_000));
    let wrong = (0..1000).map(|n| format!("k{n} = {n}")).collect::<Vec<_>>().join("\n");
    for source in [
        "",
        "=",
        "\u{0}",
        "[[segment]]",
        "segment = 1",
        "segment = [1]",
        "[[segment]]\nencoder = []",
        &deep,
        &dotted,
        &long,
        &many,
        &wrong,
    ] {
        let faults = Scenario::parse(source).expect_err("it is none");
        assert!((1..=20).contains(&faults.0.len()));
        for fault in &faults.0 {
            let text = fault.render("f", source);
            assert!(text.len() < 2_000, "{} octets", text.len());
            assert!(!fault.message.is_empty() && !fault.hint.is_empty(), "{text}");
        }
    }
    let huge = "#".repeat((4 << 20) + 1);
    assert!(told(&huge).contains("4194304 is the most"));
    let binary =
        Scenario::parse_octets(b"a = 1\n\xFF\xFE", Path::new("")).expect_err("no text").render("f", "");
    assert!(binary.contains("octet FF in line 2") && binary.contains("UTF-8"), "{binary}");
}

/// The part of JSON schema that ours uses.
fn validates(schema: &Value, value: &Value) -> Result<(), String> {
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let fits = |due: &Value| due == kind || (due == "number" && kind == "integer");
    match &schema["type"] {
        Value::Array(kinds) if kinds.iter().any(fits) => {}
        due if fits(due) => {}
        due => return Err(format!("{value} is no {due}")),
    }
    if let Some(texts) = schema["enum"].as_array().filter(|texts| !texts.contains(value)) {
        return Err(format!("{value} is none of {texts:?}"));
    }
    for item in value.as_array().into_iter().flatten() {
        validates(&schema["items"], item)?;
    }
    let Some(fields) = value.as_object().filter(|_| schema.get("properties").is_some()) else {
        return Ok(());
    };
    for required in schema["required"].as_array().unwrap() {
        if !fields.contains_key(required.as_str().unwrap()) {
            return Err(format!("{required} is missing"));
        }
    }
    for (name, value) in fields {
        match schema["properties"].get(name) {
            Some(schema) => validates(schema, value).map_err(|error| format!("{name}: {error}"))?,
            None if schema["additionalProperties"] == false => return Err(format!("{name} is not known")),
            None => {}
        }
    }
    Ok(())
}

fn as_json(source: &str) -> Value {
    serde_json::to_value(toml::from_str::<toml::Table>(source).unwrap()).unwrap()
}

#[test]
fn the_examples_fit_the_schema_and_what_is_none_does_not() {
    let schema = schema();
    for (name, source) in examples() {
        assert_eq!(validates(&schema, &as_json(&source)), Ok(()), "{name}");
    }
    for (from, to) in [
        ("rate = 1500000", "rat = 1500000"),
        ("name = \"hoist\"", "switch = 1"),
        ("switches = \"05\"", "switches = 5"),
        ("time_base = \"100 ms\"", "time_base = \"1 ms\""),
        ("[segment.master]", "[segment.masters]"),
    ] {
        assert!(validates(&schema, &as_json(&BASE.replacen(from, to, 1))).is_err(), "{to}");
    }
    assert!(validates(&schema, &as_json(&with("[[event]]\nat = 1\ndo = \"explode\"\n"))).is_err());
    assert_eq!(validates(&schema, &as_json(&with("[[event]]\nat = 1\ndo = \"leave\"\n"))), Ok(()));
}

fn page() -> String {
    std::fs::read_to_string(root().join("docs/scenarios.md")).unwrap()
}

#[test]
fn the_page_has_every_key_with_its_range_and_default() {
    let page = page();
    for table in keys::TABLES {
        for key in table.keys {
            let row = format!("| `{}` | {} | {} | {} |", key.name, key.values, key.default, key.means);
            assert!(page.contains(&row), "docs/scenarios.md lacks {row}");
            let used = page.contains(&format!("\n{} = ", key.name))
                || page.contains(&format!("[segment.{}", key.name))
                || page.contains(&format!("[[{}", key.name))
                || page.contains(&format!("master.{}", key.name));
            let elsewhere = [
                "title",
                "description",
                "duration",
                "search",
                "pace",
                "master_terminated",
                "ident",
                "temperature",
                "light",
                "battery",
                "joined",
                "acceleration",
                "offset",
                "address",
                "warnings",
                "inputs",
            ];
            assert!(
                used || elsewhere.contains(&key.name),
                "docs/scenarios.md has no example of {}",
                key.name
            );
        }
    }
}

/// Blocks without a segment go on from the second one of the page.
#[test]
fn every_example_of_the_page_is_a_scenario_that_holds() {
    let page = page();
    let blocks: Vec<_> =
        page.split("```toml\n").skip(1).map(|block| block.split("```").next().unwrap()).collect();
    assert!(blocks.len() >= 10, "{}", blocks.len());
    let base = blocks[1].split("[[expect]]").next().unwrap();
    for block in &blocks {
        let source =
            if block.contains("[[segment]]") { (*block).to_owned() } else { format!("{base}{block}") };
        let mut scenario = parsed(&source);
        assert_eq!(validates(&schema(), &as_json(&source)), Ok(()), "{block}");
        let folder = tempfile::tempdir().unwrap();
        scenario.resolve_paths(folder.path());
        let outcome = run(&scenario, &source, &mut ()).unwrap();
        let address = outcome.troubles.iter().all(|trouble| trouble.contains("Set_Slave_Add"));
        let holds = outcome.expectations.iter().all(|verdict| verdict.holds);
        assert!(holds && address, "{block} {:?} {:?}", outcome.expectations, outcome.troubles);
    }
}
