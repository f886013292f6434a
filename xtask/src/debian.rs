//! Debian's packages, without changes to the machine's own package sources.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::process::{Show, run};
use crate::project::{Project, has_program};

const UPDATE: Duration = Duration::from_mins(5);
const INSTALL: Duration = Duration::from_mins(15);

/// Whether packages can be installed here: root on Debian.
pub(crate) fn can_install() -> bool {
    is_debian() && fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

fn is_debian() -> bool {
    Path::new("/etc/debian_version").exists() && has_program("apt-get")
}

/// Installs a package: the distribution's, or that of its backports where the distribution's would
/// remove something that is installed.
///
/// # Errors
///
/// A sentence, with the line to run where this machine's administrator has to do it.
pub(crate) fn install(project: &Project, package: &str) -> Result<(), String> {
    if !is_debian() {
        return Err(format!(
            "Install {package} by this system's package manager: only Debian's is known here."
        ));
    }
    if !can_install() {
        return Err(format!("Run this as the administrator: apt-get install {package}"));
    }
    println!("Installing {package}.");
    let mut update = project.command("apt-get", ["-qq", "update"]);
    run(&mut update, UPDATE, Show::Nothing)?;
    let own = Apt { options: Vec::new() };
    if own.installs_without_removing(project, package, None)? {
        return own.install(project, package, None);
    }
    let release = codename()?;
    let backports = format!("{release}-backports");
    let suites =
        [release.as_str(), &format!("{release}-updates"), &format!("{release}-security"), &backports];
    let apt = Apt::private(project, &suites)?;
    if apt.installs_without_removing(project, package, Some(&backports))? {
        return apt.install(project, package, Some(&backports));
    }
    Err(format!(
        "Install {package} by hand: neither {release} nor {backports} has one that fits what is installed."
    ))
}

/// `apt-get` with a choice of package sources.
#[derive(Debug)]
pub(crate) struct Apt {
    options: Vec<String>,
}

impl Apt {
    /// With lists of its own for these suites, from the mirror that the machine uses already.
    pub(crate) fn private(project: &Project, suites: &[&str]) -> Result<Self, String> {
        let folder = project.target.join("setup/apt");
        let trouble = |error| format!("{} cannot be written: {error}.", folder.display());
        fs::create_dir_all(folder.join("lists/partial")).map_err(trouble)?;
        fs::write(folder.join("sources.list"), sources(&mirror()?, suites)).map_err(trouble)?;
        let at = folder.display();
        let apt = Self {
            options: vec![
                "-qq".into(),
                format!("-oDir::Etc::SourceList={at}/sources.list"),
                "-oDir::Etc::SourceParts=/dev/null".into(),
                format!("-oDir::State::Lists={at}/lists"),
                "-oAPT::Sandbox::User=root".into(),
                "-oAcquire::Languages=none".into(),
            ],
        };
        run(&mut apt.command(project, "apt-get", ["update"]), UPDATE, Show::Nothing)?
            .expect_success(&format!("apt-get update for {}", suites.join(", ")))?;
        Ok(apt)
    }

    fn command<'a>(
        &self,
        project: &Project,
        tool: &str,
        words: impl IntoIterator<Item = &'a str>,
    ) -> Command {
        let mut command = project.command(tool, &self.options);
        command.args(words).env("DEBIAN_FRONTEND", "noninteractive").env("LC_ALL", "C");
        command
    }

    fn installation<'a>(package: &'a str, release: Option<&'a str>) -> impl Iterator<Item = &'a str> {
        let release = release.into_iter().flat_map(|release| ["-t", release]);
        ["install", "-y", "--no-install-recommends"].into_iter().chain(release).chain([package])
    }

    fn installs_without_removing(
        &self,
        project: &Project,
        package: &str,
        release: Option<&str>,
    ) -> Result<bool, String> {
        let words = Self::installation(package, release).chain(["--simulate"]);
        let finished = run(&mut self.command(project, "apt-get", words), UPDATE, Show::Nothing)?;
        Ok(finished.success && !finished.stdout.lines().any(|line| line.starts_with("Remv ")))
    }

    fn install(&self, project: &Project, package: &str, release: Option<&str>) -> Result<(), String> {
        let words = Self::installation(package, release);
        run(&mut self.command(project, "apt-get", words), INSTALL, Show::Nothing)?
            .expect_success(&format!("apt-get install {package}"))?;
        Ok(())
    }

    /// The newest version of a package that begins so.
    pub(crate) fn version(&self, project: &Project, package: &str, begin: &str) -> Option<String> {
        let mut command = self.command(project, "apt-cache", ["madison", package]);
        let finished = run(&mut command, UPDATE, Show::Nothing).ok()?;
        let mut versions = finished.stdout.lines().filter_map(|line| line.split('|').nth(1)).map(str::trim);
        versions.find(|version| version.starts_with(begin)).map(Into::into)
    }

    /// Fetches a package's file into a folder.
    pub(crate) fn download(
        &self,
        project: &Project,
        package: &str,
        folder: &Path,
    ) -> Result<PathBuf, String> {
        let mut command = self.command(project, "apt-get", ["download", package]);
        run(command.current_dir(folder), INSTALL, Show::Nothing)?
            .expect_success(&format!("apt-get download {package}"))?;
        let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        files
            .into_iter()
            .find(|path| path.extension().is_some_and(|extension| extension == "deb"))
            .ok_or_else(|| format!("apt-get download {package} left no file in {}.", folder.display()))
    }
}

fn codename() -> Result<String, String> {
    let release = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = release.lines().find_map(|line| line.strip_prefix("VERSION_CODENAME="));
    name.map(Into::into)
        .ok_or_else(|| "/etc/os-release does not tell the name of this Debian release.".into())
}

/// The Debian mirror in the machine's own package sources.
fn mirror() -> Result<String, String> {
    let folder = fs::read_dir("/etc/apt/sources.list.d").into_iter().flatten().flatten();
    let files = folder.map(|entry| entry.path()).chain([PathBuf::from("/etc/apt/sources.list")]);
    let files = files.filter(|path| path.extension().is_some_and(|end| end == "sources" || end == "list"));
    let texts = files.filter_map(|path| fs::read_to_string(path).ok());
    texts
        .into_iter()
        .find_map(|text| mirror_in(&text))
        .ok_or_else(|| "No Debian mirror is named in this machine's package sources (/etc/apt).".into())
}

/// A word of a sources file that ends in `/debian`.
fn mirror_in(text: &str) -> Option<String> {
    let lines = text.lines().map(str::trim).filter(|line| !line.starts_with('#'));
    let mut words = lines
        .filter(|line| line.starts_with("URIs:") || line.starts_with("deb "))
        .flat_map(str::split_whitespace);
    words.find_map(|word| {
        let word = word.trim_end_matches('/');
        word.ends_with("/debian").then(|| word.into())
    })
}

fn sources(mirror: &str, suites: &[&str]) -> String {
    const KEYS: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";
    suites.iter().fold(String::new(), |text, suite| {
        let archive = if suite.ends_with("-security") { "-security" } else { "" };
        format!("{text}deb [signed-by={KEYS}] {mirror}{archive} {suite} main\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mirror_is_found_in_both_kinds_of_sources_file() {
        let deb822 =
            "Types: deb\n# http://snapshot.example/archive/debian/1\nURIs: http://mirror.example/debian/\n";
        assert_eq!(mirror_in(deb822).as_deref(), Some("http://mirror.example/debian"));
        let list = "deb [arch=amd64] http://mirror.example/debian stable main\n";
        assert_eq!(mirror_in(list).as_deref(), Some("http://mirror.example/debian"));
        assert_eq!(mirror_in("deb http://mirror.example/other stable main\n"), None);
    }

    #[test]
    fn security_updates_come_from_their_own_archive() {
        let text = sources("http://mirror.example/debian", &["x", "x-security"]);
        let places: Vec<_> = text.lines().map(|line| line.split_once("] ").unwrap().1).collect();
        assert_eq!(
            places,
            ["http://mirror.example/debian x main", "http://mirror.example/debian-security x-security main"]
        );
    }
}
