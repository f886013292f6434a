//! `sch108bex completions` and `sch108bex man`: what a shell and a reader get from the same source as `--help`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::{Args, Command, CommandFactory, ValueEnum};

use crate::{Cli, Failure, output};

/// The options of `completions`.
#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

impl Completions {
    pub(crate) fn run(&self) {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "sch108bex", &mut script);
        output::text(&String::from_utf8_lossy(&script));
    }
}

/// How the pages are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Man pages, one for each command
    Man,
    /// One page in Markdown, as the book has it
    Markdown,
}

/// The options of `man`.
#[derive(Debug, Args)]
pub(crate) struct Man {
    /// Write a page for each command into this folder; without it the page of the program goes to standard output
    #[arg(long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// man, or markdown for all commands on one page
    #[arg(long, value_name = "FORMAT", default_value = "man", conflicts_with = "output")]
    format: Format,
}

impl Man {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        match (&self.output, self.format) {
            (Some(folder), _) => write_all(folder).map_err(|error| {
                let folder = folder.display();
                Failure::Failed(format!(
                    "--output {folder}: cannot be written: {error}; write another folder"
                ))
            }),
            (None, Format::Man) => {
                output::text(&String::from_utf8_lossy(&page().unwrap_or_default()));
                Ok(())
            }
            (None, Format::Markdown) => {
                output::text(&markdown(&mut whole()));
                Ok(())
            }
        }
    }
}

/// The program with all its commands put together, without `help`, which has nothing to say of its own.
fn whole() -> Command {
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    command
}

fn page() -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    clap_mangen::Man::new(whole()).render(&mut page)?;
    Ok(page)
}

/// `sch108bex-master-run.1` is the page of `sch108bex master run`.
fn write_all(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    clap_mangen::generate_to(whole(), folder)
}

/// All commands, each with the text that its `--help` prints.
fn markdown(program: &mut Command) -> String {
    let mut text = String::from(
        "# Commands\n\nWhat `sch108bex COMMAND --help` prints; made by `sch108bex man --format markdown`.\n",
    );
    sections(program, "sch108bex", &mut text);
    text
}

fn sections(command: &mut Command, name: &str, text: &mut String) {
    let help = command.render_long_help().to_string();
    let help: Vec<&str> = help.trim_end().lines().map(str::trim_end).collect();
    text.extend(["\n## `", name, "`\n\n```text\n", &help.join("\n"), "\n```\n"]);
    for below in command.get_subcommands_mut() {
        if !below.is_hide_set() && below.get_name() != "help" {
            let name = format!("{name} {}", below.get_name());
            sections(below, &name, text);
        }
    }
}
