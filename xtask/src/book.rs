//! `cargo xtask book`: the folder `docs` as a book, below `target/book`, with every link of it looked at.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use crate::process::{Show, run};
use crate::project::Project;

/// Pages that are made, not kept.
const COMMANDS: &str = "commands.md";

/// Makes the book, and gives the path of its first page.
///
/// # Errors
///
/// A sentence: what could not be written, a page that no chapter names, or a link that leads nowhere.
pub(crate) fn build(project: &Project, mdbook: &Path) -> Result<PathBuf, String> {
    let sources = project.target.join("book-src");
    let pages = project.target.join("book");
    for folder in [&sources, &pages] {
        if folder.exists() {
            fs::remove_dir_all(folder).map_err(|error| trouble(folder, &error))?;
        }
    }
    let mut build = project.cargo(["build", "--quiet", "--package", "cli"]);
    run(&mut build, Duration::from_mins(10), Show::Nothing)?.expect_success("cargo build")?;
    let program = project.target.join("debug/sch108bex");
    let commands = run(
        &mut project.command(program, ["man", "--format", "markdown"]),
        Duration::from_secs(20),
        Show::Nothing,
    )?
    .expect_success("sch108bex man")?;
    copy(&project.root.join("docs"), &sources.join("docs"))?;
    write(&sources.join("docs").join(COMMANDS), &commands)?;
    let settings = fs::read_to_string(project.root.join("book.toml"))
        .map_err(|error| trouble(&project.root.join("book.toml"), &error))?;
    write(&sources.join("book.toml"), &settings)?;
    let mut command = project.command(mdbook, ["build", "--dest-dir"]);
    command.arg(&pages).arg(&sources);
    run(&mut command, Duration::from_mins(2), Show::Nothing)?.expect_success("mdbook")?;
    let faults = faults(&project.root.join("docs"), &pages)?;
    if faults.is_empty() { Ok(pages.join("index.html")) } else { Err(faults.join("\n")) }
}

/// Copies pages, their links to files beside `docs` turned into plain names.
fn copy(from: &Path, to: &Path) -> Result<(), String> {
    fs::create_dir_all(to).map_err(|error| trouble(to, &error))?;
    for entry in fs::read_dir(from).map_err(|error| trouble(from, &error))?.flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() {
            copy(&path, &to.join(name))?;
        } else if path.extension().is_some_and(|extension| extension == "md") {
            let text = fs::read_to_string(&path).map_err(|error| trouble(&path, &error))?;
            write(&to.join(name), &inside(&text))?;
        } else {
            fs::copy(&path, to.join(name)).map_err(|error| trouble(&path, &error))?;
        }
    }
    Ok(())
}

/// A page whose links lead to other pages only: `[text](../path)` becomes `text (path)`.
fn inside(page: &str) -> String {
    let mut text = String::with_capacity(page.len());
    let mut rest = page;
    while let Some((before, behind)) = rest.split_once("](../") {
        let Some(((shown, words), (path, after))) = before.rsplit_once('[').zip(behind.split_once(')'))
        else {
            text.push_str(before);
            text.push_str("](../");
            rest = behind;
            continue;
        };
        text.push_str(shown);
        if words.trim_matches('`') == path.trim_end_matches('/') {
            text.push_str(words);
        } else {
            text.extend([words, " (`", path, "`)"]);
        }
        rest = after;
    }
    text + rest
}

/// Pages that the book has not, and links of it that lead nowhere.
fn faults(docs: &Path, pages: &Path) -> Result<Vec<String>, String> {
    let mut faults = Vec::new();
    let chapters = fs::read_to_string(docs.join("SUMMARY.md")).map_err(|error| trouble(docs, &error))?;
    for entry in fs::read_dir(docs).map_err(|error| trouble(docs, &error))?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let page = entry.path().extension().is_some_and(|extension| extension == "md");
        if page && name != "SUMMARY.md" && !chapters.contains(&format!("({name})")) {
            faults.push(format!("docs/{name} is no chapter: name it in docs/SUMMARY.md"));
        }
    }
    let mut known: BTreeMap<PathBuf, BTreeSet<String>> = BTreeMap::new();
    let mut html = Vec::new();
    for entry in fs::read_dir(pages).map_err(|error| trouble(pages, &error))?.flatten() {
        let path = entry.path();
        let chapter = path.extension().is_some_and(|extension| extension == "html")
            && !path.ends_with("print.html")
            && !path.ends_with("404.html");
        if chapter {
            let text = fs::read_to_string(&path).map_err(|error| trouble(&path, &error))?;
            known.insert(path.clone(), values(&text, " id=\"").map(str::to_owned).collect());
            html.push((path, text));
        }
    }
    for (path, text) in &html {
        for link in values(text, " href=\"").chain(values(text, " src=\"")).filter(|link| is_local(link)) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let leads = if file.is_empty() { path.clone() } else { plain(&pages.join(file)) };
            let there = match known.get(&leads) {
                Some(anchors) => anchor.is_empty() || anchors.contains(anchor),
                None => leads.exists(),
            };
            if !there {
                faults.push(format!("{} has a link that leads nowhere: {link}", name_of(path)));
            }
        }
    }
    Ok(faults)
}

fn values<'a>(text: &'a str, before: &'a str) -> impl Iterator<Item = &'a str> {
    text.split(before).skip(1).filter_map(|rest| rest.split_once('"')).map(|(value, _)| value)
}

fn is_local(link: &str) -> bool {
    !link.is_empty() && !link.contains("://") && !link.starts_with("mailto:") && !link.starts_with("data:")
}

/// The path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            Component::CurDir => {}
            other => plain.push(other),
        }
    }
    plain
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|error| trouble(path, &error))
}

fn trouble(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}.", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_out_of_the_book_become_names() {
        assert_eq!(
            inside("see [the map](../ARCHITECTURE.md), [`gsd`](../gsd) and [here](words.md)"),
            "see the map (`ARCHITECTURE.md`), `gsd` and [here](words.md)"
        );
        assert_eq!(inside("no link ](../ at all"), "no link ](../ at all");
    }

    #[test]
    fn a_link_that_leads_nowhere_and_a_page_that_no_chapter_names_are_told() {
        let folder = std::env::temp_dir().join(format!("book-faults-{}", std::process::id()));
        let (docs, pages) = (folder.join("docs"), folder.join("pages"));
        fs::create_dir_all(&docs).unwrap();
        fs::create_dir_all(&pages).unwrap();
        fs::write(docs.join("SUMMARY.md"), "- [A](a.md)\n").unwrap();
        fs::write(docs.join("a.md"), "").unwrap();
        fs::write(docs.join("b.md"), "").unwrap();
        fs::write(
            pages.join("a.html"),
            "<h2 id=\"x\"></h2><a href=\"#x\"></a><a href=\"./a.html#y\"></a><a href=\"c.html\"></a>",
        )
        .unwrap();
        let found = faults(&docs, &pages).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(
            found,
            [
                "docs/b.md is no chapter: name it in docs/SUMMARY.md",
                "a.html has a link that leads nowhere: ./a.html#y",
                "a.html has a link that leads nowhere: c.html"
            ]
        );
    }
}
