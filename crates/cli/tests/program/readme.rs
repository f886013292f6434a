//! The front page and the first pages of the book: each command on them is run, and shows what the page says it
//! shows.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::driver::{Ended, Program, program, run};
use crate::master::Terminal;
use crate::tools::python;

const PAGE: &str = include_str!("../../../../README.md");
/// Pages of the book that tell their story by commands, and how many each has at least.
const BOOK: [(&str, usize); 6] = [
    (include_str!("../../../../docs/start-plc.md"), 5),
    (include_str!("../../../../docs/start-master.md"), 4),
    (include_str!("../../../../docs/start-ci.md"), 2),
    (include_str!("../../../../docs/bus-primer.md"), 1),
    (include_str!("../../../../docs/device.md"), 2),
    (include_str!("../../../../docs/troubleshooting.md"), 2),
];
/// What `cargo xtask` answers to a word that is no task.
const XTASK: &str = include_str!("../../../../xtask/src/main.rs");

/// A block between fences.
struct Block {
    language: &'static str,
    lines: Vec<&'static str>,
}

fn blocks(page: &'static str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    for line in page.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (Some(language), None) => open = Some(Block { language, lines: Vec::new() }),
            (None, Some(block)) => block.lines.push(line),
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a fence is not closed");
    blocks
}

/// The words behind the program's name; `None`: the line is none of its commands.
fn words(line: &str) -> Option<Vec<String>> {
    let rest = match line.strip_prefix("cargo run --release") {
        Some(rest) => rest.strip_prefix(" --").unwrap_or(rest),
        None => line.strip_prefix("sch108bex ")?,
    };
    Some(rest.split_whitespace().map(str::to_owned).collect())
}

/// Words that would need hardware, a place of the user's, or longer than a test has. `cable`: a serial device
/// for encoders; `slave`: one behind which an encoder is.
fn in_place(words: Vec<String>, folder: &Path, cable: &str, slave: &str) -> Vec<String> {
    let here = folder.join("encoder.control").display().to_string();
    let device = if words.first().is_some_and(|word| word == "run") { cable } else { slave };
    let link = folder.join("bus").display().to_string();
    let put = |word: String| match word.as_str() {
        "/tmp/bus" => link.clone(),
        // The program is started elsewhere.
        path if path.starts_with("examples/") => root().join(path).display().to_string(),
        "/dev/ttyUSB0" => device.to_owned(),
        "/tmp/encoder" => here.clone(),
        _ => word,
    };
    let mut words: Vec<String> = words.into_iter().map(put).collect();
    match words.first().map(String::as_str) {
        None => words.extend(["--seconds".to_owned(), "0.3".to_owned()]),
        // Other tests want the usual port, too.
        Some("demo") if words.iter().any(|word| word == "--http") => words.push("127.0.0.1:0".to_owned()),
        // The rest of the cases takes minutes, and has tests of its own.
        Some("conformance") => words.extend(["--case".to_owned(), "1".to_owned()]),
        _ => {}
    }
    words
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn end_in(folder: &Path, words: &[String]) -> Ended {
    Program::start(program().args(words).current_dir(folder)).ended()
}

#[test]
fn every_command_works_in_the_order_of_the_page() {
    let commands = play(PAGE);
    assert!(commands >= 12, "{commands} commands were found");
}

#[test]
fn every_command_of_the_first_pages_of_the_book_works() {
    for (page, least) in BOOK {
        let commands = play(page);
        assert!(
            commands >= least,
            "{commands} commands were found in {}",
            page.lines().next().unwrap_or(page)
        );
    }
}

/// Runs all commands of a page, and gives their number.
fn play(page: &'static str) -> usize {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let blocks = blocks(page);
    let mut commands = 0;
    for (at, block) in blocks.iter().enumerate().filter(|(_, block)| block.language.is_empty()) {
        let (_far, cable) = Terminal::cable();
        let cable = cable.display().to_string();
        let mut slave = run(["--switches", "05"]);
        let bus = slave.bus().display().to_string();
        let mut running = Vec::new();
        let mut output = None;
        for line in block.lines.iter().filter_map(|line| words(line)) {
            commands += 1;
            let line = in_place(line, folder, &cable, &bus);
            let goes_on = line.iter().any(|word| word == "--http");
            if goes_on || line.first().is_some_and(|word| word == "run") {
                let mut command = program();
                let mut encoder = Program::start(command.args(&line).current_dir(folder));
                encoder.wait_for(&[if goes_on { "http: http://127.0.0.1:" } else { "ready" }]);
                running.push(encoder);
            } else {
                // Nobody types faster; a capture is on the disk within less.
                std::thread::sleep(Duration::from_millis(100));
                let ended = end_in(folder, &line);
                assert_eq!(ended.status, Some(0), "{line:?}: {}{}", ended.output, ended.errors);
                output = Some(ended.output);
            }
        }
        // Where the page shows what a command prints, that is what it prints.
        let shown = blocks.get(at + 1).filter(|_| block.lines.len() == 1);
        if let (Some(output), Some(shown)) = (output, shown)
            && block.lines[0].starts_with("sch108bex decode")
        {
            assert_eq!(shown.lines.join("\n").trim(), output.trim());
        }
        running.into_iter().for_each(Program::end);
        slave.end();
    }
    commands
}

#[test]
fn every_task_of_the_page_is_there() {
    let tasks = PAGE.lines().filter_map(|line| line.strip_prefix("cargo xtask "));
    let tasks: Vec<_> = tasks.filter_map(|rest| rest.split_whitespace().next()).collect();
    assert!(tasks.len() >= 4, "{tasks:?}");
    for task in tasks {
        assert!(XTASK.contains(&format!("[\"{task}\"")), "there is no task {task}");
    }
}

#[test]
fn every_link_of_the_page_leads_somewhere() {
    let root = root();
    let links = PAGE.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link);
    let links: Vec<_> = links.filter(|link| !link.contains("://") && !link.starts_with('#')).collect();
    assert!(links.len() >= 10, "{links:?}");
    for link in links {
        let file = link.split('#').next().unwrap_or(link);
        assert!(root.join(file).exists(), "{link} leads nowhere");
    }
}

#[test]
fn the_master_in_python_prints_positions() {
    let Some(python) = python("readme::the_master_in_python_prints_positions") else { return };
    let mut encoder = run(["--switches", "05", "--shaft", "constant:60"]);
    let bus = encoder.bus().display().to_string();
    let script = blocks(PAGE).into_iter().find(|block| block.language == "python").expect("a script");
    let script = script.lines.join("\n");
    assert!(script.contains("/dev/pts/4"), "{script}");
    let mut command = Command::new(python);
    command.args(["-u", "-c", &script.replace("/dev/pts/4", &bus)]);
    let mut master = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("Python starts");
    let lines = BufReader::new(master.stdout.take().expect("an output")).lines();
    // Other lines are the library's own.
    let hexadecimal = |line: &String| line.len() == 24 && line.bytes().all(|octet| octet.is_ascii_hexdigit());
    let until = Instant::now() + Duration::from_secs(20);
    let lines = lines.map_while(Result::ok).take_while(|_| Instant::now() < until);
    let positions: Vec<_> = lines.filter(hexadecimal).take(50).collect();
    master.kill().expect("it runs");
    master.wait().expect("it ends");
    assert_eq!(positions.len(), 50);
    assert_ne!(positions.first(), positions.last(), "the shaft turns");
    encoder.end();
}
