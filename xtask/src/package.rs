//! `cargo xtask deb`: the program as a Debian package below `target/package`, and whether it installs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::process::{Show, run};
use crate::project::Project;
use crate::tally::Tally;

const VERSION: &str = env!("CARGO_PKG_VERSION");
const UNIT: &str = "usr/lib/systemd/system/sch108bex@.service";
const DOC: &str = "usr/share/doc/sch108bex";
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "usr/share/bash-completion/completions/sch108bex"),
    ("zsh", "usr/share/zsh/vendor-completions/_sch108bex"),
    ("fish", "usr/share/fish/vendor_completions.d/sch108bex.fish"),
];

/// Builds the package, and gives its path.
///
/// # Errors
///
/// A sentence, when the program cannot be built or dpkg-deb is not content.
pub(crate) fn build(project: &Project) -> Result<PathBuf, String> {
    let mut release = project.cargo(["build", "--quiet", "--release", "--package", "cli"]);
    run(&mut release, Duration::from_mins(15), Show::Live)?.expect_success("cargo build --release")?;
    let folder = project.target.join("package");
    let tree = folder.join("tree");
    if tree.exists() {
        fs::remove_dir_all(&tree).map_err(|error| trouble(&tree, &error))?;
    }
    lay_out(project, &tree)?;
    let architecture = said(project.command("dpkg", ["--print-architecture"]))?;
    write(&tree.join("DEBIAN/control"), &control(project, &tree, &architecture)?)?;
    let package = folder.join(format!("sch108bex_{VERSION}_{architecture}.deb"));
    let mut build = project.command("dpkg-deb", ["--root-owner-group", "-Zxz", "--build"]);
    said({
        build.arg(&tree).arg(&package);
        build
    })?;
    Ok(package)
}

/// Everything where Debian has it.
fn lay_out(project: &Project, tree: &Path) -> Result<(), String> {
    let program = project.target.join("release/sch108bex");
    copy(&program, &tree.join("usr/bin/sch108bex"))?;
    let pages = tree.join("usr/share/man/man1");
    folder_of(&pages.join("page"))?;
    said(project.command(&program, [Path::new("man"), Path::new("--output"), &pages]))?;
    for (shell, path) in COMPLETIONS {
        write(&tree.join(path), &said(project.command(&program, ["completions", shell]))?)?;
    }
    let packaging = project.root.join("packaging");
    copy(&packaging.join("sch108bex@.service"), &tree.join(UNIT))?;
    let doc = tree.join(DOC);
    copy(&packaging.join("copyright"), &doc.join("copyright"))?;
    copy(&packaging.join("60-sch108bex-latency.rules"), &doc.join("60-sch108bex-latency.rules"))?;
    for name in ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        copy(&project.root.join(name), &doc.join(name))?;
    }
    for folder in ["examples/scenarios", "gsd"] {
        for file in files(&project.root.join(folder))? {
            copy(&file, &doc.join(folder).join(file.file_name().unwrap_or_default()))?;
        }
    }
    copy(&project.root.join("wireshark/profibus_dp.lua"), &doc.join("wireshark/profibus_dp.lua"))?;
    let mut gzip = project.command("gzip", ["-9", "-n"]);
    gzip.args(files(&pages)?);
    gzip.args(["CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"].map(|name| doc.join(name)));
    said(gzip).map(drop)
}

fn control(project: &Project, tree: &Path, architecture: &str) -> Result<String, String> {
    let libc = said(project.command("dpkg-query", ["-W", "-f=${Version}", "libc6"]))?;
    let libc = libc.split(['-', '+']).next().unwrap_or_default();
    let size = said(project.command("du", [Path::new("-sk"), tree]))?;
    let size = size.split_whitespace().next().unwrap_or("0");
    Ok(format!(
        "Package: sch108bex\nVersion: {VERSION}\nArchitecture: {architecture}\nSection: electronics\nPriority: optional\n\
         Maintainer: The SCH108BEX software authors <sch108bex@localhost>\nDepends: libc6 (>= {libc}), libgcc-s1\n\
         Installed-Size: {size}\nDescription: SCH108BEX absolute encoder as software\n \
         Virtual PROFIBUS DP-V0 encoders on a pseudo terminal, a socket or a serial device, and the\n \
         tools to commission, watch and break them. Not affiliated with Scancon.\n"
    ))
}

/// The test: the package installs beside an empty database, what is in it works, and it goes without a rest.
///
/// # Errors
///
/// A sentence, when the package could not be built.
pub(crate) fn prove(project: &Project) -> Result<Tally, String> {
    let package = build(project)?;
    println!("{} ({} kB)", package.display(), fs::metadata(&package).map_or(0, |file| file.len() / 1000));
    let root = project.target.join("package/root");
    if root.exists() {
        fs::remove_dir_all(&root).map_err(|error| trouble(&root, &error))?;
    }
    write(&root.join("var/lib/dpkg/status"), "")?;
    for folder in ["var/lib/dpkg/info", "var/lib/dpkg/updates", "var/lib/dpkg/triggers"] {
        folder_of(&root.join(folder).join("file"))?;
    }
    let mut tally = Tally::default();
    // What it depends on is the machine's, not that of the empty database.
    let mut install = dpkg(project, &root);
    install.args(["--force-depends", "--install"]).arg(&package);
    check(&mut tally, "deb: it installs", install);
    check(
        &mut tally,
        "deb: the program runs",
        project.command(root.join("usr/bin/sch108bex"), ["--version"]),
    );
    let unit = root.join(UNIT);
    if crate::project::has_program("systemd-analyze") {
        let copy = root.join("sch108bex@test.service");
        let text = fs::read_to_string(&unit).map_err(|error| trouble(&unit, &error))?;
        let program = root.join("usr/bin/sch108bex").display().to_string();
        write(&copy, &text.replace("/usr/bin/sch108bex", &program))?;
        let mut verify = project.command("systemd-analyze", ["verify", "--man=no"]);
        verify.arg(&copy);
        check(&mut tally, "deb: systemd takes the unit", verify);
    } else {
        tally.skip("deb: systemd takes the unit", "no systemd-analyze");
    }
    for page in ["sch108bex.1.gz", "sch108bex-run.1.gz"] {
        let page = root.join("usr/share/man/man1").join(page);
        check(
            &mut tally,
            &format!("deb: {}", name_of(&page)),
            project.command("gzip", [Path::new("-t"), &page]),
        );
    }
    let scenario = root.join(DOC).join("examples/scenarios/first-start.toml");
    let mut play = project.command(root.join("usr/bin/sch108bex"), ["scenario", "run", "--virtual"]);
    play.arg(scenario);
    check(&mut tally, "deb: an example of it holds", play);
    let mut remove = dpkg(project, &root);
    remove.args(["--purge", "sch108bex"]);
    check(&mut tally, "deb: it can be removed", remove);
    let _ = fs::remove_file(root.join("sch108bex@test.service"));
    tally.check("deb: nothing is left", !root.join("usr").exists());
    Ok(tally)
}

fn dpkg(project: &Project, root: &Path) -> Command {
    let mut dpkg = project.command("dpkg", ["--force-not-root", "--force-script-chrootless"]);
    let mut option = std::ffi::OsString::from("--root=");
    option.push(root);
    dpkg.arg(option);
    dpkg
}

fn check(tally: &mut Tally, name: &str, mut command: Command) {
    let verdict = run(&mut command, Duration::from_mins(2), Show::Nothing)
        .and_then(|finished| finished.expect_success(name));
    if let Err(text) = &verdict {
        println!("{text}");
    }
    tally.check(name, verdict.is_ok());
}

fn said(mut command: Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let said = run(&mut command, Duration::from_mins(2), Show::Nothing)?.expect_success(&name)?;
    Ok(said.trim_end().to_owned())
}

fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .map_err(|error| trouble(folder, &error))?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    Ok(files)
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    folder_of(to)?;
    fs::copy(from, to).map(drop).map_err(|error| trouble(from, &error))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    folder_of(path)?;
    fs::write(path, text).map_err(|error| trouble(path, &error))
}

fn folder_of(path: &Path) -> Result<(), String> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(|error| trouble(folder, &error))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn trouble(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}.", path.display())
}
