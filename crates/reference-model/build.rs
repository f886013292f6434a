//! Makes the wrong slaves of `mutants.txt`: for each of them a copy of the model with one line
//! changed, as a module of its own for `tests/mutants`.

use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs};

/// The model's files below `src/slave`.
const PARTS: [&str; 3] = ["telegram", "station", "services"];

struct Patch<'a> {
    name: &'a str,
    file: &'a str,
    function: &'a str,
    old: &'a str,
    new: &'a str,
}

fn main() {
    let read = |path: &str| {
        println!("cargo::rerun-if-changed={path}");
        fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"))
    };
    let (patches, slave) = (read("mutants.txt"), read("src/slave.rs"));
    let parts = PARTS.map(|part| read(&format!("src/slave/{part}.rs")));
    let (mut modules, mut list) = (String::new(), String::new());
    for patch in patches.split("\nmutant ").skip(1).map(parse) {
        let mut text = changed(&slave, "slave", &patch);
        for (name, part) in PARTS.iter().zip(&parts) {
            let part = changed(part, name, &patch);
            text = text.replace(&format!("mod {name};\n"), &format!("mod {name} {{\n{part}}}\n"));
        }
        let module = patch.name.replace('-', "_");
        writeln!(modules, "pub mod {module} {{\n{text}}}\nversion!(self::{module}, power_on_{module});")
            .expect("a string");
        writeln!(list, "    (\"{}\", power_on_{module}),", patch.name).expect("a string");
    }
    let all = format!("{modules}\npub const ALL: &[(&str, PowerOn)] = &[\n{list}];\n");
    let out = env::var_os("OUT_DIR").expect("cargo sets it");
    fs::write(Path::new(&out).join("mutants.rs"), all).expect("the output directory takes files");
}

fn parse(text: &str) -> Patch<'_> {
    let name = text.lines().next().unwrap_or_default().trim();
    let line = |key: &str| {
        let found = text.lines().find_map(|line| line.strip_prefix(key));
        found.unwrap_or_else(|| panic!("mutant {name}: a line `{key}...` is missing")).trim()
    };
    let (file, function) =
        line("in ").split_once(' ').unwrap_or_else(|| panic!("mutant {name}: in FILE FUNCTION"));
    Patch {
        name,
        file,
        function,
        old: line("- "),
        new: Some(line("+ ")).filter(|new| *new != "nothing").unwrap_or_default(),
    }
}

/// The file with its line changed, if it is the one; the line is looked for from the function on.
fn changed(text: &str, file: &str, patch: &Patch<'_>) -> String {
    let Patch { name, function, old, new, .. } = patch;
    if patch.file != file {
        return text.to_owned();
    }
    let begin =
        text.find(&format!("fn {function}(")).unwrap_or_else(|| panic!("mutant {name}: no fn {function}"));
    let (before, after) = text.split_at(begin);
    let end = after[3..].find("fn ").map_or(after.len(), |end| end + 3);
    let (body, rest) = after.split_at(end);
    assert!(body.lines().any(|line| line.trim() == *old), "mutant {name}: `{old}` is not in {function}");
    let mut open = true;
    let lines = body.lines().map(|line| {
        if open && line.trim() == *old {
            open = false;
            *new
        } else {
            line
        }
    });
    let body: Vec<&str> = lines.collect();
    format!("{before}{}\n{rest}", body.join("\n"))
}
