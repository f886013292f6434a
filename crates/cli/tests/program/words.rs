//! `decode`, `scaling`, `gsd`, `datasheet` and `run --gsd` as their users see them, with whatever they may be
//! given.

use std::fs;
use std::io::Write;
use std::os::unix::ffi::OsStringExt;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;
use tempfile::tempdir;

use crate::driver::{Ended, Program, end_of, program, run};

/// Runs a command line to its end.
fn ended(arguments: &[&str]) -> Ended {
    end_of(program().args(arguments))
}

/// What it prints, if all is well.
#[track_caller]
fn printed(arguments: &[&str]) -> String {
    let Ended { status, output, errors } = ended(arguments);
    assert_eq!((status, errors.as_str()), (Some(0), ""), "{arguments:?}: {output}");
    output
}

/// It ends with this status, says these words on standard error and does not panic.
#[track_caller]
fn fails(arguments: &[&str], status: i32, words: &[&str]) -> Ended {
    let ended = ended(arguments);
    assert_eq!(ended.status, Some(status), "{arguments:?}: {}", ended.errors);
    assert!(ended.errors.starts_with("error: ") && !ended.errors.contains("panicked"), "{}", ended.errors);
    for word in words {
        assert!(ended.errors.contains(word), "{arguments:?}: {word} is not in: {}", ended.errors);
    }
    ended
}

/// What `decode` prints for octets on standard input.
fn decoded(arguments: &[&str], input: &[u8]) -> Ended {
    let directory = tempdir().unwrap();
    let path = directory.path().join("input");
    fs::write(&path, input).unwrap();
    let input = fs::File::open(&path).unwrap();
    end_of(program().arg("decode").args(arguments).arg("-").stdin(Stdio::from(input)))
}

// Reference 1.5.
#[test]
fn decode_takes_arguments_files_and_standard_input() {
    let request = "2 -> 11  FDL_Status request";
    for arguments in [
        &["decode", "10", "0B", "02", "49", "56", "16"][..],
        &["decode", "10 0b 02 49 56 16"],
        &["decode", "100B02495616"],
    ] {
        assert_eq!(printed(arguments).trim(), format!("1  {request}"), "{arguments:?}");
    }
    let directory = tempdir().unwrap();
    let file = directory.path().join("bus.txt");
    for octets in [&b"# a comment\n10 0B 02 49 56 16 ; another\n"[..], &[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16]]
    {
        fs::write(&file, octets).unwrap();
        assert_eq!(printed(&["decode", file.to_str().unwrap()]).trim(), format!("1  {request}"));
        let from_input = decoded(&[], octets);
        assert_eq!(
            (from_input.status, from_input.output.trim()),
            (Some(0), format!("1  {request}").as_str())
        );
    }
    // A file of one octet: text has no E5h.
    assert!(decoded(&[], &[0xE5]).output.contains("short acknowledgement"));
    assert!(decoded(&["--input-form", "binary"], b"\x10\x0B\x02\x49\x56\x16").output.contains(request));
    // What looks like text but is none.
    assert!(decoded(&["--input-form", "binary"], b"55").output.contains("2 octets skipped"));
}

#[test]
fn decode_knows_profiles_and_all_fields() {
    let diagnosis = "68 15 15 68 82 8B 08 3E 3C 08 0E 00 02 47 11 0A 01 00 02 00 00 20 00 10 00 3C 16";
    let auto = printed(&["decode", diagnosis]);
    assert!(
        auto.contains("Slave_Diag: alarm: position error; in data exchange, device fault reported"),
        "{auto}"
    );
    let plain = printed(&["decode", diagnosis, "--profile", "dp", "--verbose"]);
    assert!(plain.contains("Device_Block = 0A 01 00 02") && !plain.contains("position error"), "{plain}");
    let verbose = printed(&["decode", diagnosis, "-v"]);
    assert!(
        verbose.contains("17             data 8       encoder.alarms = 1  alarm: position error"),
        "{verbose}"
    );
    let inputs = printed(&["decode", "--profile", "encoder", "68 07 07 68 02 0B 08 00 12 34 56 B1 16"]);
    assert!(inputs.contains("position 1193046"), "{inputs}");
}

// The maker's octets for Scancon 2.0 are not public: who has them gives them.
#[test]
fn decode_takes_the_identifiers_of_a_users_gsd() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("project.gsd");
    fs::write(&path, kept("sch108bex-16x15.gsd").replace("0xF1,0xD1,0xD1", "0xE1,0xD5")).unwrap();
    let arguments = ["decode", "--profile", "encoder", "68 07 07 68 8B 82 7D 3E 3E E1 D5 BC 16"];
    let own = printed(&[&arguments[..], &["--gsd", path.to_str().unwrap()]].concat());
    assert!(own.contains("Chk_Cfg: 12 in, 4 out, Scancon 2.0"), "{own}");
    assert!(!printed(&arguments).contains("Scancon 2.0"));
    fails(&["decode", "E5", "--gsd", "/no/such.gsd"], 1, &["--gsd /no/such.gsd", "cannot be read"]);
}

#[test]
fn decode_prints_a_document_for_each_telegram() {
    let output = printed(&["decode", "--json", "10 0B 02 49 56 16 10 02 0B 00 0D 16"]);
    let documents: Vec<Value> =
        output.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(documents.len(), 2);
    assert_eq!(documents[0]["summary"], "2 -> 11  FDL_Status request");
    assert_eq!((&documents[1]["answers"], &documents[1]["number"]), (&1.into(), &2.into()));
}

#[test]
fn decode_tells_what_is_wrong_and_goes_on() {
    let ended = fails(&["decode", "55", "10 0B 02 49 57 16", "10 0B 02 49 56 16"], 1, &["1 of 2 entries"]);
    assert!(ended.output.contains("7 octets skipped: octet 1: 55h begins no telegram"), "{}", ended.output);
    assert!(ended.output.contains("2 -> 11  FDL_Status request"), "{}", ended.output);
    let bad = fails(&["decode", "10 0B 02 49 57 16"], 1, &["1 of 1"]);
    assert!(bad.output.contains("bad telegram: octet 5: the check sum is 57h, but the octets make 56h"));
    // A blank line is a pause: what was cut off before it swallows nothing behind it.
    let cut = decoded(&[], b"68 05 05 68 8B\n\n10 0B 02 49 56 16\n");
    assert!(
        cut.output.contains("6 more octets are due") && cut.output.contains("FDL_Status request"),
        "{}",
        cut.output
    );
}

#[test]
fn decode_refuses_what_is_no_input_with_a_remedy() {
    let directory = tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    fails(&["decode"], 2, &["HEX"]);
    fails(
        &["decode", "10", "0G"],
        2,
        &["'G' is no hexadecimal digit", "write octets like", "standard input"],
    );
    fails(&["decode", "1"], 2, &["an octet has two digits"]);
    fails(&["decode", "10", "file.txt"], 2, &["write one file name"]);
    fails(&["decode", "--profile", "s7", "E5"], 2, &["--profile", "auto, encoder, dp"]);
    fails(&["decode", "--json", "--verbose", "E5"], 2, &["--verbose"]);
    fails(&["decode", &path("none")], 1, &["cannot be read", "write octets like"]);
    fails(&["decode", directory.path().to_str().unwrap()], 1, &["is a directory"]);
    fs::write(path("empty"), "").unwrap();
    fails(&["decode", &path("empty")], 1, &["not one octet"]);
    fails(&["decode", ""], 1, &["cannot be read"]);
    fs::write(path("words"), "hello\nworld\n").unwrap();
    fails(&["decode", &path("words")], 1, &["line 1, column 1: 'h' is no hexadecimal digit"]);
    fs::write(path("half"), "10 0B 02 49 56 16\n\n1").unwrap();
    let half = fails(&["decode", &path("half")], 1, &["line 3", "an octet has two digits"]);
    assert!(half.output.contains("FDL_Status request"), "what came before is told: {}", half.output);
    let not_utf_8 = std::ffi::OsString::from_vec(vec![0xFF, 0xFE]);
    let ended = end_of(program().arg("decode").arg(not_utf_8));
    assert_eq!(ended.status, Some(2), "{}", ended.errors);
}

// Some megabytes of anything take seconds and no memory.
#[test]
fn decode_takes_huge_and_hostile_input() {
    let noise: Vec<u8> = (0..1_500_000_u32).map(|i| i.wrapping_mul(2_654_435_761).to_le_bytes()[2]).collect();
    let false_headers = [0x68, 0xF9, 0xF9, 0x68].repeat(100_000);
    for input in [
        noise,
        vec![0; 3_000_000],
        false_headers,
        vec![0x68; 1_000_000],
        vec![0xE5; 20_000],
        b"#".repeat(3_000_000),
    ] {
        let ended = decoded(&[], &input);
        assert!(
            matches!(ended.status, Some(0 | 1)) && !ended.errors.contains("panicked"),
            "{}",
            ended.errors
        );
    }
    let digits = decoded(&[], &b"5".repeat(2_000_000));
    assert!(digits.output.contains("1000000 octets skipped"), "{}", digits.output);
}

// What comes is told at once, and the end of the reader is the end.
#[test]
fn decode_tells_a_stream_as_it_comes() {
    let mut command = program();
    command.args(["decode", "-"]).stdin(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    let mut to = child.stdin.take().expect("a pipe");
    let mut from = std::io::BufReader::new(child.stdout.take().expect("a pipe"));
    for number in 1..4 {
        to.write_all(&[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16]).unwrap();
        let mut line = String::new();
        std::io::BufRead::read_line(&mut from, &mut line).unwrap();
        assert!(line.trim().starts_with(&format!("{number}  2 -> 11  FDL_Status")), "{line}");
    }
    // Standard output is closed: it ends though more and more comes.
    drop(from);
    let start = std::time::Instant::now();
    while to.write_all(&[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16].repeat(100)).is_ok() {
        assert!(start.elapsed() < Duration::from_secs(20), "it does not end");
    }
    child.wait().unwrap();
}

// Vector E121, and E055 and E058 for the octets.
#[test]
fn scaling_tells_the_jump_the_words_and_the_octets() {
    let output = printed(&["scaling", "--units", "360", "--range", "1804"]);
    for words in [
        "360 = 00000168h, high word 0, low word 360",
        "124 units after 32768 turns",
        "123 is followed by 0",
        "0A 00 00 01 68 00 00 07 0C 00 00 00 00 00 00 00 00 (class 2)",
    ] {
        assert!(output.contains(words), "{words}: {output}");
    }
    let json: Value =
        serde_json::from_str(&printed(&["scaling", "--units", "4096", "--json"])).expect("JSON");
    assert_eq!((&json["allowed"], &json["bits"]), (&true.into(), &"16x15".into()));
    assert_eq!(json["total_range"]["value"], 134_217_728);
    assert_eq!(json["total_range"]["high_word"], 2_048);
    let consequences = &json["consequences"];
    assert_eq!(consequences["jump"], 0);
    assert_eq!(consequences["set_prm_scancon_2"], "0A 00 00 10 00 08 00 00 00 00 00 00 00 00 00 00 00 01");
    let revolutions = printed(&["scaling", "--units", "100", "--revolutions", "50", "--json"]);
    assert_eq!(serde_json::from_str::<Value>(&revolutions).expect("JSON")["total_range"]["value"], 5_000);
    let back = printed(&["scaling", "--set-prm", "0B 00 00 03 E8 00 00 7D 00 00 00 00 00 00 00 00 00"]);
    assert!(back.contains("1000 = 000003E8h") && back.contains("32000 = 00007D00h"), "{back}");
}

#[test]
fn scaling_refuses_with_the_manuals_limits_or_a_remedy() {
    let too_many =
        fails(&["scaling", "--units", "65537", "--range", "16"], 1, &["at most 65536", "manual 4.1.2"]);
    assert!(too_many.output.contains("65537 = 00010001h"), "{}", too_many.output);
    let json = fails(&["scaling", "--units", "0", "--range", "16", "--json"], 1, &["manual 4.1.2"]);
    assert_eq!(serde_json::from_str::<Value>(&json.output).expect("JSON")["allowed"], false);
    fails(
        &["scaling", "--units", "8192", "--range", "33554433", "--bits", "13x12"],
        1,
        &["33554432", "manual 4.1.3"],
    );
    fails(&["scaling"], 2, &["--units"]);
    fails(&["scaling", "--units", "-1"], 2, &["-1"]);
    fails(&["scaling", "--units", "4294967296"], 2, &["--units"]);
    fails(&["scaling", "--units", "1.5"], 2, &["--units"]);
    fails(&["scaling", "--units", "65536", "--revolutions", "65536"], 2, &["32 bits", "smaller"]);
    fails(&["scaling", "--units", "1", "--range", "1", "--revolutions", "1"], 2, &["--revolutions"]);
    fails(&["scaling", "--units", "1", "--bits", "17x1"], 2, &["--bits", "2 to 16"]);
    fails(&["scaling", "--set-prm", "0A 00"], 2, &["--set-prm", "2 octets", "17 or 18"]);
    fails(&["scaling", "--set-prm", "zz"], 2, &["--set-prm", "no hexadecimal digit"]);
    fails(&["scaling", "--set-prm", "00", "--units", "1"], 2, &["--set-prm"]);
}

/// One of the files in the folder `gsd`.
fn kept(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../gsd").join(name))
        .expect("it is kept")
}

#[test]
fn gsd_writes_the_files_that_are_kept() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("own.gsd");
    for bits in ["16x15", "13x12", "12x12", "13x0"] {
        let due = kept(&format!("sch108bex-{bits}.gsd"));
        assert_eq!(printed(&["gsd", "--bits", bits, "--output", path.to_str().unwrap()]), "");
        assert_eq!(fs::read_to_string(&path).unwrap(), due, "{bits}");
        assert_eq!(printed(&["gsd", "--bits", bits]).lines().count(), due.lines().count());
        let json: Value = serde_json::from_str(&printed(&["gsd", "--bits", bits, "--json"])).expect("JSON");
        assert_eq!((&json["text"], &json["ident_number"]), (&due.into(), &"0x108B".into()));
        assert_eq!(json["note"], "GSD of the software SCH108BEX, not the maker's");
    }
    assert!(printed(&["gsd", "--ident", "0xabcd"]).contains("Ident_Number = 0xABCD"));
}

#[test]
fn gsd_refuses_with_a_remedy() {
    fails(&["gsd", "--bits", "1x0"], 2, &["--bits", "2 to 16"]);
    fails(&["gsd", "--ident", "4711"], 2, &["--ident", "like 0x108B"]);
    fails(&["gsd", "--output", "/no/such/folder/x.gsd"], 1, &["/no/such/folder/x.gsd", "write another path"]);
    fails(&["gsd", "--output", ""], 2, &["--output"]);
    fails(&["gsd", "--json", "--output", "x"], 2, &["--output"]);
    let directory = tempdir().unwrap();
    fails(&["gsd", "--output", directory.path().to_str().unwrap()], 1, &["cannot be written"]);
}

// R6-8: figures of the manual, sections 5 and 6.
#[test]
fn the_data_sheet_has_the_manuals_figures() {
    let output = printed(&["datasheet"]);
    let json: Value = serde_json::from_str(&printed(&["datasheet", "--json"])).expect("JSON");
    let figures = json["figures"].as_array().expect("figures");
    for (group, name, value, section) in [
        ("Electrical", "Supply voltage", "9 V to 30 V", "6"),
        ("Electrical", "Revolutions", "at most 32,768 (15 bits)", "6"),
        ("Mechanical", "Shaft speed", "at most 3000 RPM, continuous", "6"),
        ("Mechanical", "Weight, aluminium", "2.4 kg (5.29 lb)", "6"),
        ("Environmental", "Operating temperature", "-40 to +70 degrees C", "6"),
        ("Mounting", "Screws of the end cap", "at most 6 Nm (53 lbf-in)", "3.2"),
    ] {
        let figure = serde_json::json!({"group": group, "name": name, "value": value, "section": section});
        assert!(figures.contains(&figure), "{figure}");
        let line = output.lines().find(|line| line.contains(name)).expect(name);
        assert!(line.trim_start().starts_with(section) && line.ends_with(value), "{line}");
        assert!(output.contains(&format!("\n{group}\n")));
    }
    fails(&["datasheet", "more"], 2, &["more"]);
}

#[track_caller]
fn run_with_gsd(octets: &[u8]) -> (tempfile::TempDir, Program) {
    let directory = tempdir().unwrap();
    let path = directory.path().join("project.gsd");
    fs::write(&path, octets).unwrap();
    let program = run(["--switches", "0B", "--gsd", path.to_str().unwrap()]);
    (directory, program)
}

// A file as Windows tools leave it: Latin-1, the ident number of a project.
#[test]
fn run_reads_a_gsd_in_latin_1_and_tells_what_does_not_fit() {
    let text = kept("sch108bex-16x15.gsd")
        .replace("0x108B\r\nProtocol", "0x4711\r\nProtocol")
        .replace("3M_supp = 1", "3M_supp = 0");
    let text = text.replace("SCH108BEX software (not Scancon)", "K\u{fc}bler");
    let latin_1: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect();
    let (_directory, mut program) = run_with_gsd(&latin_1);
    let diagnosis = program.master(11).diagnosis();
    assert_eq!(diagnosis.octets(5..=6), [0x47, 0x11]);
    program.kill();
    assert!(program.take_errors().contains("leaves out the rates 3M"));
}

#[test]
fn run_refuses_what_is_no_gsd_of_this_device() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("x.gsd");
    let path = path.to_str().unwrap();
    for (octets, words) in [
        (&b""[..], "no GSD file"),
        (b"\x00\x01\x02", "no GSD file"),
        (b"hello", "no GSD file"),
        (&b" ".repeat(5_000_000), "more than 4194304 octets"),
        (b"#Profibus_DP\nIdent_Number = 1\nModule = \"DI\" 0x10\nEndModule\n", "another device"),
        (b"#Profibus_DP\nModule = \"A\" 0xF1\nExt_User_Prm_Data_Ref(0) = 9\nEndModule\n", "is broken"),
    ] {
        fs::write(path, octets).unwrap();
        let ended = fails(&["run", "--gsd", path], 1, &["--gsd", "x.gsd", words]);
        assert_eq!(ended.output, "");
    }
    fails(&["run", "--gsd", directory.path().to_str().unwrap()], 1, &["is no file"]);
    fails(&["run", "--gsd", "/dev/zero"], 1, &["is no file"]);
    fails(&["run", "--gsd", "/no/such.gsd"], 1, &["cannot be read"]);
}
