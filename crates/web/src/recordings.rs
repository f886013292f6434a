//! Recordings that a client asks for: in a folder of their own, removed at the end, bounded in number and size.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use capture::LinkType;
use profibus_dp::time::Duration;
use serde::{Deserialize, Serialize};

use crate::stage::Scene;
use crate::token::Token;
use crate::wire::Ear;

/// So many recordings are kept; one has to be removed for another.
pub(crate) const MOST: usize = 16;
/// So many of them run at once.
pub(crate) const MOST_RUNNING: usize = 4;
/// One that has grown to this is ended.
pub(crate) const MOST_OCTETS: u64 = 64 << 20;
/// From row to row of values.
const EVERY: Duration = Duration::from_millis(10);

/// What is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// Values of all encoders over time.
    Csv,
    /// What is on a bus.
    Pcapng,
}

/// A recording as clients see it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Listed {
    name: String,
    kind: Kind,
    octets: u64,
    running: bool,
    trouble: Option<String>,
}

/// Why there is none.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Refusal {
    #[error("{MOST_RUNNING} recordings run already; stop one of them first")]
    TooManyRun,
    #[error("there are {MOST} recordings already; delete one of them first")]
    TooMany,
    #[error("there is no segment {0:?}; there are {1}")]
    NoSegment(String, String),
    #[error("there are several segments: add \"segment\" with one of {0}")]
    Several(String),
    #[error("it cannot be recorded: {0}")]
    Failed(String),
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Recordings(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    folder: Option<Folder>,
    next: u64,
    all: Vec<Recording>,
}

/// A folder for this user alone, removed with all that is in it.
#[derive(Debug)]
struct Folder(PathBuf);

#[derive(Debug)]
struct Recording {
    name: String,
    kind: Kind,
    path: PathBuf,
    running: Option<Running>,
    trouble: Arc<Mutex<Option<String>>>,
}

#[derive(Debug)]
enum Running {
    Values(Box<record::Recorder>),
    Bus { recorder: capture::Recorder, ear: Ear, number: u64 },
}

impl Folder {
    fn new() -> io::Result<Self> {
        let name = format!("sch108bex-{}", Token::random()?.text());
        let path = std::env::temp_dir().join(name);
        DirBuilder::new().mode(0o700).create(&path)?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Recordings {
    /// Begins one of what is shown.
    pub(crate) fn start(&self, scene: &Scene, kind: Kind, segment: Option<&str>) -> Result<Listed, Refusal> {
        let mut kept = self.kept();
        if kept.all.len() >= MOST {
            return Err(Refusal::TooMany);
        }
        if kept.all.iter().filter(|recording| recording.running.is_some()).count() >= MOST_RUNNING {
            return Err(Refusal::TooManyRun);
        }
        let failed = |error: io::Error| Refusal::Failed(error.to_string());
        let folder = match &kept.folder {
            Some(folder) => folder.0.clone(),
            None => kept.folder.insert(Folder::new().map_err(failed)?).0.clone(),
        };
        let number = kept.next + 1;
        let name = match kind {
            Kind::Csv => format!("recording-{number}.csv"),
            Kind::Pcapng => format!("recording-{number}.pcapng"),
        };
        let path = folder.join(&name);
        let trouble = Arc::default();
        let running = match kind {
            Kind::Csv => values(&path, scene, Arc::clone(&trouble))?,
            Kind::Pcapng => bus(&path, scene, segment, number)?,
        };
        kept.next = number;
        kept.all.push(Recording { name, kind, path, running: Some(running), trouble });
        Ok(kept.all[kept.all.len() - 1].listed())
    }

    /// All of them, in the order in which they began.
    pub(crate) fn list(&self) -> Vec<Listed> {
        self.kept().all.iter().map(Recording::listed).collect()
    }

    /// Ends one, if it is there.
    pub(crate) fn stop(&self, name: &str) -> Option<Listed> {
        let mut kept = self.kept();
        let recording = kept.all.iter_mut().find(|recording| recording.name == name)?;
        recording.stop();
        Some(recording.listed())
    }

    /// Removes one; whether it was there.
    pub(crate) fn remove(&self, name: &str) -> bool {
        let mut kept = self.kept();
        let Some(at) = kept.all.iter().position(|recording| recording.name == name) else {
            return false;
        };
        let mut recording = kept.all.remove(at);
        recording.stop();
        let _ = std::fs::remove_file(&recording.path);
        true
    }

    /// Where the file of one is.
    pub(crate) fn path(&self, name: &str) -> Option<PathBuf> {
        let kept = self.kept();
        kept.all.iter().find(|recording| recording.name == name).map(|recording| recording.path.clone())
    }

    /// Ends those that have grown too long.
    pub(crate) fn bound(&self) {
        for recording in &mut self.kept().all {
            if recording.running.is_some() && recording.octets() >= MOST_OCTETS {
                recording.stop();
                let words = format!("ended at {} MiB, the most that is kept", MOST_OCTETS >> 20);
                lock(&recording.trouble).get_or_insert(words);
            }
        }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        lock(&self.0)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Each change is whole by itself, so a panic elsewhere does not matter.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Recording {
    fn octets(&self) -> u64 {
        std::fs::metadata(&self.path).map_or(0, |data| data.len())
    }

    fn listed(&self) -> Listed {
        Listed {
            name: self.name.clone(),
            kind: self.kind,
            octets: self.octets(),
            running: self.running.is_some(),
            trouble: lock(&self.trouble).clone(),
        }
    }

    fn stop(&mut self) {
        let (missing, error) = match self.running.take() {
            None => return,
            Some(Running::Values(recorder)) => {
                let report = recorder.finish();
                (report.missing, report.error)
            }
            Some(Running::Bus { recorder, ear, number }) => {
                ear.forget(number);
                let report = recorder.finish();
                (report.missing, report.error)
            }
        };
        let words = match (error, missing) {
            (Some(error), _) => format!("it could not be written any further: {error}"),
            (None, 0) => return,
            (None, missing) => format!("{missing} rows or packets are missing: the disk was too slow"),
        };
        lock(&self.trouble).get_or_insert(words);
    }
}

fn values(path: &Path, scene: &Scene, trouble: Arc<Mutex<Option<String>>>) -> Result<Running, Refusal> {
    let settings = record::Settings { every: EVERY, is_virtual: false };
    let told = move |words: &str| {
        lock(&trouble).get_or_insert_with(|| words.to_owned());
    };
    let failed = |error: &dyn std::fmt::Display| Refusal::Failed(error.to_string());
    let mut recorder = record::Recorder::start(path, settings, told).map_err(|error| failed(&error))?;
    recorder.attach(&scene.handle).map_err(|error| failed(&error))?;
    recorder.listen(scene.subscriptions.subscribe()).map_err(|error| failed(&error))?;
    Ok(Running::Values(Box::new(recorder)))
}

fn bus(path: &Path, scene: &Scene, segment: Option<&str>, number: u64) -> Result<Running, Refusal> {
    let names: Vec<&str> = scene.handle.segments().map(|(name, _)| name).collect();
    let name = match (segment, names.as_slice()) {
        (None, [only]) => *only,
        (None, _) => return Err(Refusal::Several(names.join(", "))),
        (Some(name), _) if names.contains(&name) => name,
        (Some(name), _) => return Err(Refusal::NoSegment(crate::assets::shortened(name), names.join(", "))),
    };
    let settings = capture::Settings { link_type: LinkType::User0, name: name.to_owned(), is_virtual: false };
    let recorder =
        capture::Recorder::start(path, &settings).map_err(|error| Refusal::Failed(error.to_string()))?;
    let Some(ear) = scene.wires.ear(name) else {
        return Err(Refusal::NoSegment(name.to_owned(), names.join(", ")));
    };
    ear.listen_too(number, Box::new(recorder.tap()));
    Ok(Running::Bus { recorder, ear, number })
}
