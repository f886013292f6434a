//! Recordings of what encoders show over time.

use std::path::PathBuf;

use clap::Args;
use plant::control::Subscriptions;
use plant::{Handle, Plant, Report};
use profibus_dp::time::{Duration, Instant};
use record::{Format, Recorder, Settings};

use crate::Failure;
use crate::output;
use crate::run::failed;

/// What to record.
#[derive(Debug, Clone, Args)]
pub(crate) struct Options {
    /// Keep position, velocity, acceleration, diagnosis and events of every encoder in this file: .parquet or
    /// .csv; see docs/recording.md and `sch108bex plot`
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// How often a sample is taken, in milliseconds; 0.5 is every latch
    #[arg(long, requires = "record", default_value = "10", value_parser = every, value_name = "MS",
        allow_negative_numbers = true)]
    record_every: Duration,
}

fn every(text: &str) -> Result<Duration, String> {
    let millis = text.parse().ok().filter(|millis| (0.5..=60_000.0).contains(millis));
    let millis: f64 = millis.ok_or("write milliseconds from 0.5 to 60000, like 10")?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
    Ok(Duration::from_nanos((millis * 1e6).round() as u64))
}

/// A recording that goes on.
#[derive(Debug)]
pub(crate) struct Recording {
    recorder: Recorder,
    path: PathBuf,
    handle: Handle,
}

impl Options {
    /// Begins to record these encoders, where it is asked for, in virtual time.
    pub(crate) fn start_virtual(&self, handle: &Handle) -> Result<Option<Recording>, Failure> {
        self.start(handle, true)
    }

    /// The same, of all encoders of a plant in real time, with what happens.
    pub(crate) fn start_with(
        &self,
        plant: &Plant,
        subscriptions: &Subscriptions,
    ) -> Result<Option<Recording>, Failure> {
        let mut recording = self.start(&plant.handle(), false)?;
        if let Some(recording) = &mut recording {
            recording.recorder.listen(subscriptions.subscribe()).map_err(failed)?;
        }
        Ok(recording)
    }

    fn start(&self, handle: &Handle, is_virtual: bool) -> Result<Option<Recording>, Failure> {
        let Some(path) = &self.record else {
            return Ok(None);
        };
        Format::of(path).map_err(|error| Failure::Usage(format!("--record: {error}")))?;
        let settings = Settings { every: self.record_every, is_virtual };
        let trouble = |text: &str| output::aside(&format!("warning: {text}"));
        let mut recorder = Recorder::start(path, settings, trouble).map_err(|error| {
            Failure::Failed(format!("the recording {} cannot be written: {error}", path.display()))
        })?;
        recorder.attach(handle).map_err(failed)?;
        Ok(Some(Recording { recorder, path: path.clone(), handle: handle.clone() }))
    }
}

impl Recording {
    /// Something has happened.
    pub(crate) fn report(&self, report: &Report) {
        self.recorder.events().report(report);
    }

    /// Virtual time has come to this moment.
    pub(crate) fn step(&self, to: Instant) {
        // Segments in virtual time never end before their plant.
        let _ = self.recorder.step(&self.handle, to);
    }

    /// Ends it. What is missing is told.
    fn end(self) -> Result<(), Failure> {
        let report = self.recorder.finish();
        let path = self.path.display();
        if let Some(error) = report.error {
            return Err(Failure::Failed(format!(
                "the recording {path} is not whole: {error}; it has {} samples and {} events, and {} are missing",
                report.samples, report.events, report.missing
            )));
        }
        if report.missing > 0 {
            output::aside(&format!(
                "warning: {} samples and events are missing in the recording {path}: the disk was too slow; its rows \
                 called recording_gap say where",
                report.missing
            ));
        }
        Ok(())
    }
}

/// Ends a recording, where there is one.
pub(crate) fn end(recording: Option<Recording>) -> Result<(), Failure> {
    recording.map_or(Ok(()), Recording::end)
}

/// Ends a plant, and the recording of it with all that there was.
pub(crate) fn stop(plant: Plant, mut recording: Option<Recording>) -> Result<(), Failure> {
    if let Some(recording) = &mut recording {
        recording.recorder.stop_sampling();
    }
    let stopped = plant.stop().map_err(failed);
    stopped.and(end(recording))
}
