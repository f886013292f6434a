//! The project's own tasks: `cargo xtask setup | check | test | bench | traceability | recording | pictures`.

mod bench;
mod book;
mod browser;
mod debian;
mod drawings;
mod firmware;
mod image;
mod measure;
mod no_panic;
mod package;
mod process;
mod project;
mod recording;
mod setup;
mod soak;
mod steps;
mod tally;
mod thumb;
mod traceability;

use std::env;
use std::process::ExitCode;

use project::Project;

const USAGE: &str = "\
Usage: cargo xtask TASK

  setup [--yes]              what the tests need beside Rust: says what is missing, installs it with --yes
  check                      every day, some minutes: format, lints, tests that need nothing but Rust
  test [STEP]                everything, as continuous integration runs it; or one step of it
  bench [--only NAME] [--gate]
                             the figures, also in target/bench.json; --gate: exit 1 over a limit
  firmware                   the images of all boards: builds them, prints sizes, proves what must hold
  firmware run [OPTIONS]     the image in an emulator, for a master of yours; --help: its options
  soak [--hours H] [--seed N]
                             hours of bus time within minutes, all that must hold looked at; docs/soak.md
  book                       docs as a book below target/book, its links looked at
  deb                        a Debian package below target/package
  traceability               every requirement has tests, and they exist
  drawings                   docs/firmware-wiring.svg anew: how the parts of a board are wired
  recording                  docs/demo.svg anew: the demonstration as a moving picture
  pictures                   docs/pictures anew: the bench page in a browser";

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let Some(task) = task(&words) else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    match Project::find().and_then(|project| task(&project)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("{text}");
            ExitCode::FAILURE
        }
    }
}

type Task = Box<dyn FnOnce(&Project) -> Result<(), String>>;

fn task(words: &[&str]) -> Option<Task> {
    Some(match words {
        ["setup"] => Box::new(|project| setup::setup(project, false).map(drop)),
        ["setup", "--yes"] => Box::new(|project| setup::setup(project, true).map(drop)),
        ["check"] => Box::new(steps::check),
        ["test"] => Box::new(|project| steps::test(project, None)),
        ["test", step] => {
            let step = step.to_string();
            Box::new(move |project| steps::test(project, Some(&step)))
        }
        ["traceability"] => {
            Box::new(|project| traceability::check(&project.root).map(|found| println!("{found}")))
        }
        ["firmware"] => Box::new(firmware::make),
        ["firmware", "run", options @ ..] => {
            let options: Vec<String> = options.iter().map(ToString::to_string).collect();
            Box::new(move |project| firmware::emulate(project, &options))
        }
        ["drawings"] => Box::new(drawings::draw),
        ["pictures"] => Box::new(browser::pictures),
        ["recording"] => Box::new(recording::record),
        ["book"] => Box::new(|project| {
            let tools = setup::Tools::find(project);
            let mdbook = tools.mdbook.ok_or("mdbook is missing. To install it: cargo xtask setup --yes")?;
            println!("{}", book::build(project, &mdbook)?.display());
            Ok(())
        }),
        ["deb"] => Box::new(|project| {
            println!("{}", package::build(project)?.display());
            Ok(())
        }),
        ["bench", options @ ..] => {
            let options = bench::Options::parse(options)?;
            Box::new(move |project| bench::run(project, &options))
        }
        ["soak", options @ ..] => {
            let options: Vec<String> = options.iter().map(ToString::to_string).collect();
            Box::new(move |project| soak::run(project, &options))
        }
        ["help" | "--help" | "-h"] => Box::new(|_| {
            println!("{USAGE}");
            Ok(())
        }),
        _ => return None,
    })
}
