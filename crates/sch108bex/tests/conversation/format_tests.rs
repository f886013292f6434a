//! The format itself under test: bad lines are named, and a wrong expectation is seen.

use super::{driver, parser};

/// A test of the runner.
pub(crate) type FormatTest = fn() -> Result<(), String>;

/// All of them, by name.
pub(crate) const TESTS: [(&str, FormatTest); 3] = [
    ("a_bad_line_is_named", a_bad_line_is_named),
    ("a_good_one_passes", a_good_one_passes),
    ("a_wrong_expectation_is_seen", a_wrong_expectation_is_seen),
];

const HEADER: &str = "# FDL status
source: by hand
bits: 13x12
switches: 0B
ident: 4711
serial: 123456
baud: 500000
";

/// Lines behind the header (it has 7), the line that is to be named and words of the message.
const BAD: &[(&str, usize, &str)] = &[
    ("> 10 0B 02 49 56 16", 8, "`< silence`"),
    ("> 10 0B 02 4 56 16\n< silence", 8, "`4` is no octet"),
    ("> 10 0B 02 49 56 1G\n< silence", 8, "`1G` is no octet"),
    (">\n< silence", 8, "no octets to send"),
    ("< silence", 8, "without a `>` line"),
    ("> E5\n<", 9, "`<` needs octets"),
    ("> E5\n< quiet", 9, "`quiet` is no octet"),
    ("> E5\n< 10 02 0B 00 0E 16", 9, "add up to 0D"),
    ("> E5\n< 10 02 0B 00 0D 17", 9, "no telegram of a slave"),
    ("> E5\n< @x E5", 9, "`x` is no number"),
    ("wait 5", 8, "is no time"),
    ("wait five ms", 8, "`five` is no number"),
    ("battery full", 8, "none of ok, low, empty"),
    ("shaft 0xQ", 8, "is no number"),
    ("shaft moves 5 counts", 8, "per 1 ms"),
    ("baud 115200", 8, "none of the ten rates"),
    ("temperature 65.05", 8, "one digit"),
    ("? colour red", 8, "the questions are"),
    ("!! nothing", 8, "`!! none`"),
    ("end", 8, "without `repeat`"),
    ("+ E5\nrepeat 3:\n+ E5", 9, "has no `end`"),
    ("repeat x:\nend", 8, "`x` is no number"),
    ("jump", 8, "`jump` begins no line"),
    ("56 16", 8, "goes on with no telegram"),
    ("+ E5\nserial: 1", 9, "belongs to the header"),
    ("wait 1 s", 1, "nothing is said"),
];

fn a_bad_line_is_named() -> Result<(), String> {
    for &(lines, line, words) in BAD {
        let text = format!("{HEADER}{lines}\n");
        match parser::parse(&text) {
            Ok(_) => return Err(format!("`{lines}` was taken")),
            Err(bad) if bad.line == line && bad.message.contains(words) => {}
            Err(bad) => {
                let parser::BadLine { line, message } = bad;
                return Err(format!("`{lines}`: line {line}: {message}"));
            }
        }
    }
    for key in ["source", "bits", "switches", "ident", "serial", "baud"] {
        let kept = HEADER.lines().chain(["+ E5"]).filter(|line| !line.starts_with(key));
        let text = kept.collect::<Vec<_>>().join(
            "
",
        );
        match parser::parse(&text) {
            Err(bad) if bad.message.contains(&format!("`{key}:` is missing")) => {}
            _ => return Err(format!("nobody missed `{key}:`")),
        }
    }
    match parser::parse(HEADER.trim_start_matches("# ")) {
        Err(bad) if bad.line == 1 => Ok(()),
        _ => Err("nobody missed the title".into()),
    }
}

fn played(lines: &str) -> Result<(), (usize, String)> {
    let conversation = parser::parse(&format!("{HEADER}{lines}\n")).map_err(|bad| (bad.line, bad.message))?;
    driver::play(&conversation).map_err(|mismatch| (mismatch.line, mismatch.message))
}

fn a_good_one_passes() -> Result<(), String> {
    played("> 10 0B 02 49\n  56 16 ; comment\n\n# heading\n< 10 02 .. 00 .. 16\n? address 11\n!! none")
        .map_err(|(line, message)| format!("line {line}: {message}"))
}

fn a_wrong_expectation_is_seen() -> Result<(), String> {
    const STATUS: &str = "> 10 0B 02 49 56 16";
    let wrong = [
        (format!("{STATUS}\n< silence"), 9, "got      10 02 0B 00 0D 16"),
        (format!("{STATUS}\n< E5"), 9, "due      E5"),
        (format!("{STATUS}\n< 10 02 0B 03 10 16"), 9, "10 02 0B 00 0D 16"),
        (format!("{STATUS}\n< 10 02 0B 00 .. .. .."), 9, "due      10 02 0B 00 .. .. .."),
        (format!("{STATUS}\n< @12 10 02 0B 00 0D 16"), 9, "starts 11 bit times"),
        (format!("{STATUS}\n< late\n? address 12"), 10, "is Some(11)"),
        ("> 10 0C 02 49 57 16\n< E5".into(), 9, "got      silence"),
        ("> 10 0C 02 49 57 16\n< late".into(), 9, "no reply is due"),
        ("+ 10 0B 02 49 56 16".into(), 8, "not for it"),
        ("+ E5\n! anything".into(), 9, "no report has the words: anything"),
        ("+ E5\nbattery low\n!! none".into(), 10, "nothing should have been reported"),
        ("+ E5\npower on".into(), 9, "the power is on"),
        ("+ E5\nwait 5 ms\nat 4 ms".into(), 10, "has passed"),
        ("repeat 2:\n+ E5\n? off\nend".into(), 10, "in round 1 of 2"),
    ];
    for (lines, line, words) in wrong {
        match played(&lines) {
            Ok(()) => return Err(format!("this passed:\n{lines}")),
            Err((at, message)) if at == line && message.contains(words) => {}
            Err((at, message)) => return Err(format!("line {at}: {message}\nof:\n{lines}")),
        }
    }
    Ok(())
}
