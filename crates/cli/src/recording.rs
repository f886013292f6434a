//! Captures that commands write.

use std::path::Path;

use capture::{LinkType, Recorder, Settings};

use crate::Failure;

/// Begins a capture of the bus called `name`, in real time.
pub(crate) fn start(path: &Path, link_type: LinkType, name: &str) -> Result<Recorder, Failure> {
    let settings = Settings { link_type, name: name.to_owned(), is_virtual: false };
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
