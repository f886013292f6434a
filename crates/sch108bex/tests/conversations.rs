//! Plays every conversation of `tests/conversations` with the whole device, each as a test.
//!
//! `tests/conversations/README.md` has the format. This runner takes what the usual one takes as
//! far as cargo and nextest need it: filters, `--exact`, `--skip`, `--list`, `--ignored`.

mod conversation;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use conversation::variants::Variant;
use conversation::{driver, format_tests, parser};

enum What {
    File(PathBuf),
    Format(format_tests::FormatTest),
}

struct Test {
    name: String,
    what: What,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse(std::env::args().skip(1));
    let tests = match tests() {
        Ok(tests) => tests,
        Err(error) => {
            eprintln!("error: the conversations cannot be read: {error}");
            return ExitCode::FAILURE;
        }
    };
    let all = tests.len();
    let chosen: Vec<_> = tests.into_iter().filter(|test| arguments.choose(&test.name)).collect();
    if arguments.list {
        for test in &chosen {
            println!("{}: test", test.name);
        }
        return ExitCode::SUCCESS;
    }
    run(&chosen, all)
}

fn run(chosen: &[Test], all: usize) -> ExitCode {
    println!("\nrunning {} tests", chosen.len());
    let mut failures = Vec::new();
    for test in chosen {
        print!("test {} ... ", test.name);
        // Whoever waits for a long one sees which it is.
        let _ = io::stdout().flush();
        match test.run() {
            Ok(()) => println!("ok"),
            Err(message) => {
                println!("FAILED");
                failures.push((&test.name, message));
            }
        }
    }
    if !failures.is_empty() {
        println!("\nfailures:");
        for (name, message) in &failures {
            println!("\n---- {name} ----\n{message}");
        }
    }
    let result = if failures.is_empty() { "ok" } else { "FAILED" };
    println!(
        "\ntest result: {result}. {} passed; {} failed; 0 ignored; 0 measured; {} filtered out\n",
        chosen.len() - failures.len(),
        failures.len(),
        all - chosen.len()
    );
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

impl Test {
    fn run(&self) -> Result<(), String> {
        match &self.what {
            What::Format(test) => test(),
            What::File(path) => {
                let text = fs::read_to_string(path).map_err(|error| error.to_string())?;
                let at = |line, message: &str| {
                    let file = path.file_name().unwrap_or_default().display();
                    format!("tests/conversations/{file}:{line}: {message}")
                };
                let conversation = parser::parse(&text).map_err(|bad| at(bad.line, &bad.message))?;
                for variant in Variant::ALL {
                    driver::play(&variant.of(&conversation))
                        .map_err(|bad| at(bad.line, &format!("{}{}", variant.note(), bad.message)))?;
                }
                Ok(())
            }
        }
    }
}

/// Every file, by name, and the tests of the format.
fn tests() -> io::Result<Vec<Test>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/conversations");
    let mut tests = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "txt")
            && let Some(stem) = path.file_stem()
        {
            let name = format!("conversations::{}", stem.to_string_lossy());
            let what = What::File(path);
            tests.push(Test { name, what });
        }
    }
    for (name, test) in format_tests::TESTS {
        let name = format!("format::{name}");
        let what = What::Format(test);
        tests.push(Test { name, what });
    }
    tests.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(tests)
}

#[derive(Default)]
struct Arguments {
    filters: Vec<String>,
    skip: Vec<String>,
    exact: bool,
    list: bool,
    ignored: bool,
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self::default();
        while let Some(word) = words.next() {
            match word.as_str() {
                "--exact" => arguments.exact = true,
                "--list" => arguments.list = true,
                "--ignored" => arguments.ignored = true,
                "--skip" => arguments.skip.extend(words.next()),
                // Options of the usual runner that have a value of no interest here.
                "--format" | "--color" | "--test-threads" | "--logfile" | "-Z" | "--shuffle-seed" => {
                    words.next();
                }
                option if option.starts_with('-') => {}
                _ => arguments.filters.push(word),
            }
        }
        arguments
    }

    /// None of the tests here is ignored by default.
    fn choose(&self, name: &str) -> bool {
        let fits = |filter: &String| {
            if self.exact { name == filter } else { name.contains(filter.as_str()) }
        };
        !self.ignored
            && (self.filters.is_empty() || self.filters.iter().any(fits))
            && !self.skip.iter().any(fits)
    }
}
