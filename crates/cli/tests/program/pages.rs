//! `man` and `completions`: what they write has every command, and is what its reader takes.

use std::fs;
use std::process::Command;

use tempfile::tempdir;

use crate::driver::{end_of, program};

/// What a command that must work prints.
fn printed(arguments: &[&str]) -> String {
    let ended = end_of(program().args(arguments));
    assert_eq!((ended.status, ended.errors.as_str()), (Some(0), ""), "{arguments:?}");
    ended.output
}

/// The commands that `--help` names.
fn commands() -> Vec<String> {
    let help = printed(&["--help"]);
    let (_, list) = help.split_once("Commands:\n").expect("a list of commands");
    let (list, _) = list.split_once("\n\n").expect("an end of the list");
    let words = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = words.filter_map(|line| line.split_whitespace().next()).map(str::to_owned);
    let names: Vec<String> = names.filter(|name| name != "help").collect();
    assert!(names.len() >= 12 && names.iter().any(|name| name == "conformance"), "{names:?}");
    names
}

#[test]
fn every_command_has_a_man_page() {
    let folder = tempdir().unwrap();
    let pages = folder.path().join("made/man1");
    assert_eq!(printed(&["man", "--output", pages.to_str().unwrap()]), "");
    for name in commands() {
        let page = fs::read_to_string(pages.join(format!("sch108bex-{name}.1"))).expect(&name);
        assert!(page.contains(&format!("\n.TH sch108bex-{name} 1")), "{name}: {page}");
        assert!(page.contains("\n.SH SYNOPSIS\n") && page.contains("\n.SH OPTIONS\n"), "{name}: {page}");
    }
    let run = fs::read_to_string(pages.join("sch108bex-run.1")).unwrap();
    assert!(run.contains(r"\fB\-\-switches\fR"), "{run}");
    let program = fs::read_to_string(pages.join("sch108bex.1")).unwrap();
    assert_eq!(printed(&["man"]).trim_end(), program.trim_end());
}

#[test]
fn the_page_of_the_book_has_every_command_with_its_help() {
    let page = printed(&["man", "--format", "markdown"]);
    for name in commands() {
        let help = printed(&[&name, "--help"]);
        // The end of the first line is the same whether `help` is a command or not.
        let first = help.lines().next().unwrap();
        let section = page.split(&format!("\n## `sch108bex {name}`\n")).nth(1).expect(&name);
        assert!(section.trim_start().starts_with(&format!("```text\n{first}")), "{name}: {section}");
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_told() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("a file");
    fs::write(&file, "").unwrap();
    let ended = end_of(program().args(["man", "--output"]).arg(&file));
    assert_eq!(ended.status, Some(1));
    assert!(ended.errors.contains("write another folder"), "{}", ended.errors);
}

#[test]
fn bash_takes_the_completions_and_completes_a_command() {
    let folder = tempdir().unwrap();
    let script = folder.path().join("completions");
    fs::write(&script, printed(&["completions", "bash"])).unwrap();
    let ask = "source \"$1\" && COMP_WORDS=(sch108bex scen) COMP_CWORD=1 && _sch108bex sch108bex scen sch108bex \
               && echo \"${COMPREPLY[*]}\"";
    let said = Command::new("bash").args(["--norc", "-c", ask, "bash"]).arg(&script).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&said.stdout).trim(), "scenario");
    for shell in ["zsh", "fish", "elvish", "powershell"] {
        assert!(printed(&["completions", shell]).contains("conformance"), "{shell}");
    }
}
