//! Captures that commands write.

use std::path::{Path, PathBuf};

use capture::{LinkType, Recorder, Settings};
use clap::Args;
use plant::Handle;

use crate::Failure;

/// What is kept of what is on a bus.
#[derive(Debug, Args)]
pub(crate) struct Capture {
    /// Keep what is on the bus in this file, as pcapng: see docs/capture.md. Of several segments each has a file
    /// of its own, FILE with -SEGMENT before its ending
    #[arg(long, value_name = "FILE")]
    capture: Option<PathBuf>,
    /// What PROFIBUS is called in the file: 147 (USER0, for our Wireshark dissector) or 257 (PROFIBUS_DL)
    #[arg(long, requires = "capture", default_value_t, value_name = "147|257")]
    link_type: LinkType,
}

/// Captures that go on. Dropping them ends them as well, and tells nobody.
#[derive(Debug)]
pub(crate) struct Captures(Vec<(Recorder, PathBuf)>);

impl Capture {
    /// Begins to listen to segments, each with its name and what its bus is called in the file.
    pub(crate) fn start(
        &self,
        handle: &Handle,
        segments: &[(&str, &str)],
        is_virtual: bool,
    ) -> Result<Captures, Failure> {
        let mut captures = Captures(Vec::new());
        for (segment, bus) in segments {
            let Some(path) = &self.capture else { break };
            let path = if segments.len() > 1 { of_segment(path, segment) } else { path.clone() };
            let recorder = begin(&path, self.link_type, bus, is_virtual)?;
            handle.set_tap(segment, Some(Box::new(recorder.tap()))).map_err(crate::run::failed)?;
            captures.0.push((recorder, path));
        }
        Ok(captures)
    }
}

impl Captures {
    /// Ends them; what is missing is told.
    pub(crate) fn end(self) -> Result<(), Failure> {
        let ended = self.0.into_iter().map(|(recorder, path)| end(recorder, &path).map(drop));
        ended.fold(Ok(()), Result::and)
    }
}

/// `run.pcapng` of the segment `crane` is `run-crane.pcapng`.
fn of_segment(path: &Path, segment: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("-{segment}"));
    if let Some(ending) = path.extension() {
        name.push(".");
        name.push(ending);
    }
    path.with_file_name(name)
}

/// Begins a capture of the bus called `name`, in real time.
pub(crate) fn start(path: &Path, link_type: LinkType, name: &str) -> Result<Recorder, Failure> {
    begin(path, link_type, name, false)
}

fn begin(path: &Path, link_type: LinkType, name: &str, is_virtual: bool) -> Result<Recorder, Failure> {
    let settings = Settings { link_type, name: name.to_owned(), is_virtual };
    Recorder::start(path, &settings).map_err(|error| {
        Failure::Failed(format!("the capture {} cannot be written: {error}", path.display()))
    })
}

/// Ends it; how many packets it has. What is missing is told.
pub(crate) fn end(recorder: Recorder, path: &Path) -> Result<u64, Failure> {
    let report = recorder.finish();
    let path = path.display();
    if let Some(error) = report.error {
        return Err(Failure::Failed(format!(
            "the capture {path} could not be written any further: {error}; it has {} packets, and {} events \
             are missing",
            report.packets, report.missing
        )));
    }
    if report.missing > 0 {
        crate::output::aside(&format!(
            "warning: {} events are missing in the capture {path}: the disk was too slow; its packets say where",
            report.missing
        ));
    }
    Ok(report.packets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_segment_has_a_file_of_its_own() {
        for (path, of_its_own) in [
            ("run.pcapng", "run-crane.pcapng"),
            ("/tmp/a.b/run", "/tmp/a.b/run-crane"),
            ("x/run.1.pcapng", "x/run.1-crane.pcapng"),
        ] {
            assert_eq!(of_segment(Path::new(path), "crane"), Path::new(of_its_own));
        }
    }
}
