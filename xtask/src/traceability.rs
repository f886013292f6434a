//! `cargo xtask traceability`: every requirement has a row with tests, and these tests exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The requirements, and the map from them to tests, seen from the project's root.
const REQUIREMENTS: &str = "docs/requirements.md";
const TRACEABILITY: &str = "docs/traceability.md";

/// Checks the project's own two tables.
///
/// # Errors
///
/// One sentence for each thing that is wrong.
pub(crate) fn check(root: &Path) -> Result<String, String> {
    let read = |name: &str| fs::read_to_string(root.join(name)).map_err(|error| format!("{name}: {error}."));
    let requirements = read(REQUIREMENTS)?;
    let map = read(TRACEABILITY)?;
    let wrong = complaints(&requirements, &map, |file| fs::read_to_string(root.join(file)).ok());
    if wrong.is_empty() {
        return Ok(format!("All {} requirements have tests, and these exist.", rows(&requirements).len()));
    }
    Err(format!("{}\nMend {TRACEABILITY}: its head tells how a row is written.", wrong.join("\n")))
}

/// All that is wrong; `file` gives a file's text, or nothing where there is no such file.
fn complaints(requirements: &str, map: &str, file: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let demanded = rows(requirements);
    let mapped = rows(map);
    let known: BTreeSet<&str> = demanded.iter().map(|row| row.id).collect();
    let traced: BTreeSet<&str> = mapped.iter().map(|row| row.id).collect();
    let mut wrong = Vec::new();
    wrong.extend(repeated(&demanded).map(|id| format!("{REQUIREMENTS}: {id} stands there twice.")));
    wrong.extend(repeated(&mapped).map(|id| format!("{TRACEABILITY}: {id} stands there twice.")));
    wrong.extend(known.difference(&traced).map(|id| format!("{id} has no row in {TRACEABILITY}.")));
    wrong.extend(
        traced.difference(&known).map(|id| format!("{TRACEABILITY}: {id} is no id of {REQUIREMENTS}.")),
    );
    for row in &mapped {
        wrong.extend(
            unproven(row.rest, &file).into_iter().map(|text| format!("{TRACEABILITY}: {}: {text}", row.id)),
        );
    }
    if demanded.is_empty() {
        wrong.push(format!("{REQUIREMENTS} has no row."));
    }
    wrong
}

/// A row of a Markdown table: its first column and the next.
struct Row<'a> {
    id: &'a str,
    rest: &'a str,
}

/// The rows whose first column looks like an id: `R4.1.1-0`.
fn rows(text: &str) -> Vec<Row<'_>> {
    let cells =
        text.lines().filter_map(|line| line.trim().strip_prefix('|')?.strip_suffix('|')?.split_once('|'));
    cells
        .map(|(id, rest)| Row { id: id.trim(), rest: rest.trim() })
        .filter(|row| row.id.starts_with('R') && row.id.contains('-'))
        .collect()
}

fn repeated<'a>(rows: &'a [Row<'a>]) -> impl Iterator<Item = &'a str> {
    let mut seen = BTreeSet::new();
    rows.iter().map(|row| row.id).filter(move |id| !seen.insert(*id))
}

/// What is wrong with the second column of a row.
fn unproven(places: &str, file: &impl Fn(&str) -> Option<String>) -> Vec<String> {
    let places = places.replace('`', "");
    let mut wrong = Vec::new();
    let mut any = false;
    for place in places.split(';').map(str::trim).filter(|place| !place.is_empty()) {
        any = true;
        // After a colon with a space, so that `vectors::E001` stays whole.
        let (path, names) = place.split_once(": ").map_or((place, ""), |(path, names)| (path.trim(), names));
        let Some(text) = file(path) else {
            wrong.push(format!("there is no file {path}."));
            continue;
        };
        let names: Vec<&str> = names.split(',').map(str::trim).filter(|name| !name.is_empty()).collect();
        match (is_conversation(path), names.is_empty()) {
            (true, true) => {}
            (true, false) => wrong.push(format!("{path} is a conversation: nothing is named after it.")),
            (false, true) => wrong.push(format!("no test is named after {path}.")),
            (false, false) => {
                let absent = names.iter().filter(|name| !has_test(path, &text, name));
                wrong.extend(absent.map(|name| format!("{path} has no test {name}.")));
            }
        }
    }
    if !any {
        wrong.push("no test is named.".into());
    }
    wrong
}

fn is_conversation(path: &str) -> bool {
    path.contains("/conversations/")
        && Path::new(path).extension().is_some_and(|extension| extension == "txt")
}

fn has_extension(path: &str, extension: &str) -> bool {
    Path::new(path).extension().is_some_and(|found| found == extension)
}

fn has_test(path: &str, text: &str, name: &str) -> bool {
    match name.strip_prefix("vectors::") {
        Some(id) => has_extension(path, "json") && has_vector(text, id),
        None => has_extension(path, "rs") && has_rust_test(text, name.rsplit("::").next().unwrap_or(name)),
    }
}

/// `"id": "E001"`, with any white space.
fn has_vector(text: &str, id: &str) -> bool {
    let value = format!("\"{id}\"");
    text.split("\"id\"").skip(1).any(|after| {
        let after = after.trim_start();
        after.strip_prefix(':').is_some_and(|after| after.trim_start().starts_with(&value))
    })
}

/// `fn name(` with `#[test]` among the attributes and comments right above it.
fn has_rust_test(text: &str, name: &str) -> bool {
    let mut marked = false;
    for line in text.lines().map(str::trim) {
        let declared =
            line.trim_start_matches("pub ").strip_prefix("fn ").and_then(|rest| rest.strip_prefix(name));
        if marked && declared.is_some_and(|rest| rest.trim_start().starts_with('(')) {
            return true;
        }
        marked = line == "#[test]" || marked && (line.starts_with("#[") || line.starts_with("//"));
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEMANDS: &str = "# Title\n| id | demand |\n|---|---|\n| R1-1 | a | \n| R4.1.1-0 | b: `x`; or y |\n";
    const TESTS: &str = "#[test]\n// Why.\n#[should_panic]\nfn turns() {}\n\nfn helper() {}\n\
                         proptest! {\n    #[test]\n    fn never_fails(octets in any()) {}\n}\n";

    fn judge(map: &str) -> Vec<String> {
        complaints(DEMANDS, map, |file| match file {
            "crates/a/tests/t.rs" => Some(TESTS.into()),
            "crates/a/tests/data/encoder-vectors.json" => {
                Some("[{\"id\": \"E001\"}, {\"id\":\"E002\"}]".into())
            }
            "crates/a/tests/conversations/start.txt" => Some("> 10".into()),
            _ => None,
        })
    }

    fn one(map: &str) -> String {
        let wrong = judge(map);
        assert_eq!(wrong.len(), 1, "{wrong:?}");
        wrong.into_iter().next().unwrap_or_default()
    }

    #[test]
    fn a_good_table_passes() {
        let map = "| id | where |\n|---|---|\n| R1-1 | `crates/a/tests/t.rs`: `turns`, `never_fails` |\n\
                   | R4.1.1-0 | crates/a/tests/data/encoder-vectors.json: vectors::E001, vectors::E002; \
                   crates/a/tests/conversations/start.txt |\n";
        assert_eq!(judge(map), Vec::<String>::new());
    }

    #[test]
    fn a_requirement_without_a_row_is_named() {
        let text = one("| R1-1 | crates/a/tests/t.rs: turns |\n");
        assert_eq!(text, "R4.1.1-0 has no row in docs/traceability.md.");
    }

    #[test]
    fn a_row_with_an_unknown_id_is_named() {
        let good = "| R1-1 | crates/a/tests/t.rs: turns |\n| R4.1.1-0 | crates/a/tests/t.rs: turns |\n";
        assert!(one(&format!("{good}| R9-9 | crates/a/tests/t.rs: turns |\n")).contains("R9-9 is no id"));
        assert!(
            one(&format!("{good}| R1-1 | crates/a/tests/t.rs: turns |\n"))
                .contains("R1-1 stands there twice")
        );
    }

    #[test]
    fn what_does_not_exist_is_named() {
        let with =
            |place: &str| one(&format!("| R1-1 | crates/a/tests/t.rs: turns |\n| R4.1.1-0 | {place} |\n"));
        assert!(with("crates/a/tests/u.rs: turns").contains("there is no file crates/a/tests/u.rs"));
        assert!(with("crates/a/tests/t.rs: helper").contains("has no test helper"));
        assert!(with("crates/a/tests/t.rs: turn").contains("has no test turn"));
        assert!(with("crates/a/tests/t.rs").contains("no test is named after"));
        assert!(with("").contains("no test is named"));
        assert!(
            with("crates/a/tests/data/encoder-vectors.json: vectors::E00")
                .contains("has no test vectors::E00")
        );
        assert!(with("crates/a/tests/conversations/start.txt: a").contains("nothing is named after it"));
    }

    #[test]
    fn the_project_itself_passes() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        if let Err(text) = check(root) {
            panic!("{text}");
        }
    }
}
