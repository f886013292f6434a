//! The commissioning commands against encoders that run, as pages that show commands and what they print:
//! `tests/cmd/*.trycmd`, and the page for technicians.
//!
//! A page says in a comment with which options its encoder runs; its commands run in a folder of their own in which
//! `encoder.control` is its control socket, with SCH108BEX_PORT as its bus. What a page does not show word for word are times.
//! `TRYCMD=overwrite` writes what is printed into the pages, to be read before it is believed.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::driver::{Program, end_of, program, run};

/// Where a page names the options of its encoder.
const ENCODER: &str = "<!-- encoder:";

fn tests() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cmd")
}

/// Plays a page with an encoder of its own.
fn play(page: &Path) {
    let text = std::fs::read_to_string(page).expect("a page");
    let options = text.lines().find_map(|line| line.strip_prefix(ENCODER)?.strip_suffix("-->"));
    let folder = tempfile::tempdir().expect("a folder");
    let copy = folder.path().join(page.file_name().expect("a name"));
    let place = copy.with_extension("in");
    std::fs::create_dir(&place).expect("a folder");
    std::fs::copy(page, &copy).expect("a copy");
    std::fs::copy(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../gsd/sch108bex-16x15.gsd"),
        place.join("encoder.gsd"),
    )
    .expect("a GSD");
    for script in ["zero.script", "start.script"] {
        std::fs::copy(tests().join(script), place.join(script)).expect("a script");
    }
    let cases = trycmd::TestCases::new();
    cases.register_bin("sch108bex", Path::new(env!("CARGO_BIN_EXE_sch108bex")));
    cases.timeout(std::time::Duration::from_mins(1));
    let mut encoder = options.map(|options| {
        let control = place.join("encoder.control").display().to_string();
        // On a busy computer replies are late, and those that are too late are not sent.
        let more = ["--reply-limit", "1000", "--control", &control].map(str::to_owned);
        run(options.split_whitespace().map(str::to_owned).chain(more))
    });
    if let Some(encoder) = &mut encoder {
        cases.env("SCH108BEX_PORT", encoder.bus().display().to_string());
        // Time enough for a busy computer, but not at each of 125 addresses.
        let reply_within = if text.contains("$ sch108bex scan") { "80" } else { "300" };
        cases.env("SCH108BEX_REPLY_WITHIN", reply_within);
    }
    cases.case(&copy).run();
    if std::env::var_os("TRYCMD").is_some_and(|mode| mode == "overwrite") {
        std::fs::copy(&copy, page).expect("the page can be written");
    }
    if let Some(encoder) = encoder {
        encoder.end();
    }
}

fn page(name: &str) {
    play(&tests().join(name));
}

#[test]
fn who_is_there() {
    page("scan.trycmd");
}

#[test]
fn how_it_is() {
    page("diag.trycmd");
}

#[test]
fn where_it_is() {
    page("monitor.trycmd");
}

#[test]
fn its_zero_point() {
    page("preset.trycmd");
}

#[test]
fn its_address() {
    page("set-address.trycmd");
}

#[test]
fn a_script() {
    page("script.trycmd");
}

#[test]
fn what_does_not_fit() {
    page("refused.trycmd");
}

#[test]
fn scalings() {
    page("scaling.trycmd");
}

#[test]
fn the_page_for_technicians() {
    play(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/commissioning.md"));
}

#[test]
fn every_page_is_played() {
    let source = include_str!("commands.rs");
    for entry in tests().read_dir().expect("a folder").filter_map(Result::ok) {
        let name = entry.file_name().to_string_lossy().into_owned();
        assert!(source.contains(&format!("\"{name}\"")), "{name} is played by no test");
    }
}

/// A command beside an encoder, with time enough for a busy computer.
fn beside(encoder: &mut Program, words: &[&str]) -> Program {
    let bus = encoder.bus().display().to_string();
    let mut command = program();
    command.args(words).args(["--port", &bus, "--reply-within", "300"]);
    Program::start(&mut command)
}

#[test]
fn a_watch_tells_what_comes_and_goes() {
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("control").display().to_string();
    let mut encoder = run(["--switches", "05", "--control", &control]);
    let mut watch = beside(&mut encoder, &["diag", "5", "--watch", "--every", "20"]);
    watch.wait_for(&["encoder.revolutions = 32768"]);
    let supply = |volts: &str| {
        let ended = end_of(program().args(["ctl", &control, "supply", volts]));
        assert_eq!(ended.status, Some(0), "{}", ended.errors);
    };
    supply("8.5");
    watch.wait_for(&["came: alarm    Supply Voltage Error (octet 8 bit 1)"]);
    watch.wait_for(&["encoder.alarms = 2", "(was 0)"]);
    supply("24");
    watch.wait_for(&["went: alarm Supply Voltage Error (octet 8 bit 1)"]);
    // A watch goes on until Ctrl-C, which is no failure.
    watch.end();
    encoder.end();
}

#[test]
fn a_monitor_sees_the_shaft_turn() {
    let mut encoder = run(["--switches", "05", "--shaft", "constant:60"]);
    // 60 RPM at 1.5 m a turn: 1.5 m/s, and 65536 steps a second are 6553.6 in 100 ms.
    let mut monitor =
        beside(&mut encoder, &["monitor", "5", "--json", "--units-per-turn", "1.5", "--unit", "m"]);
    let line = monitor.wait_for(&["\"rpm\":6"]);
    let reading: Value = serde_json::from_str(&line).expect("a document");
    let number = |name: &str| reading[name].as_f64().unwrap_or_else(|| panic!("no {name} in {line}"));
    assert!((6_553..=6_554).contains(&reading["velocity"].as_i64().expect("steps")), "{line}");
    assert!(
        (number("rpm") - 60.0).abs() < 0.01 && (number("value_per_second") - 1.5).abs() < 0.001,
        "{line}"
    );
    assert!((number("value") - number("turns") * 1.5).abs() < 1e-6, "{line}");
    monitor.end();
    encoder.end();
}

#[test]
fn who_only_listens_hears_what_a_master_exchanges() {
    // The tester's bus: whoever opens it is heard by the monitor, which never says a word.
    let port = free_port();
    let mut command = program();
    let here = format!("tcp-listen:127.0.0.1:{port}");
    command.args(["monitor", "5", "--listen", "--port", &here, "--json", "--seconds", "30"]);
    let mut monitor = Program::start(&mut command);
    let mut line = connect(port);
    // Set_Prm with time base 3 (RPM) and its E5; then Data_Exchange: position 1000h, 60 RPM, no acceleration.
    let set_prm = [
        0x68, 0x1F, 0x1F, 0x68, 0x85, 0x82, 0x5D, 0x3D, 0x3E, 0x88, 0x01, 0x14, 0x0B, 0x10, 0x8B, 0x00, 0x00,
        0x0A, 0x00, 0x00, 0x20, 0x00, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x03,
    ];
    send(&mut line, &with_sum(&set_prm));
    send(&mut line, &[0xE5]);
    send(&mut line, &with_sum(&[0x68, 0x07, 0x07, 0x68, 0x05, 0x02, 0x7D, 0, 0, 0, 0]));
    let inputs = [0x68, 0x0F, 0x0F, 0x68, 0x02, 0x05, 0x08, 0, 0, 0x10, 0, 0, 0, 0, 60, 0, 0, 0, 0];
    send(&mut line, &with_sum(&inputs));
    let heard = monitor.wait_for(&["\"position\":4096"]);
    let heard: Value = serde_json::from_str(&heard).expect("a document");
    assert_eq!((&heard["velocity"], &heard["rpm"]), (&60.into(), &60.0.into()), "{heard}");
    drop(line);
    monitor.end();
}

/// A telegram with its check sum and its end.
fn with_sum(telegram: &[u8]) -> Vec<u8> {
    let sum = telegram[4..].iter().fold(0, |sum: u8, octet| sum.wrapping_add(*octet));
    [telegram, &[sum, 0x16]].concat()
}

fn free_port() -> u16 {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("an address").port()
}

/// Connects as soon as somebody listens.
fn connect(port: u16) -> std::net::TcpStream {
    for _ in 0..500 {
        if let Ok(line) = std::net::TcpStream::connect(("127.0.0.1", port)) {
            line.set_nodelay(true).expect("a socket");
            return line;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    panic!("nobody listens at port {port}");
}

fn send(line: &mut std::net::TcpStream, octets: &[u8]) {
    use std::io::Write;
    line.write_all(octets).expect("sent");
    // Requests and answers do not come in one piece.
    std::thread::sleep(std::time::Duration::from_millis(20));
}
