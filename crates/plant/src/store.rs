//! The non-volatile memory on the host: a state file with two slots, or none.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use sch108bex::NonvolatileWrite;
use sch108bex::nonvolatile::{self, Choice, Record, SLOT_OCTETS, Slot, SlotFault};
use sch108bex::specification::Variant;

use crate::encoder::PresetError;

/// Octets of a state file: slot A, then slot B.
const FILE_OCTETS: usize = 2 * SLOT_OCTETS;

/// Where the records of one encoder are kept.
#[derive(Debug)]
pub enum Store {
    /// Nowhere: every start is as delivered. Records last as long as this value.
    Memory([Option<[u8; SLOT_OCTETS]>; 2]),
    /// In a state file.
    File {
        /// The open file, locked against a second encoder.
        file: File,
        /// Where it is.
        path: PathBuf,
    },
}

/// Why a state file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refuses the file.
    #[error(
        "cannot {step} the state file {path}: {source}; name a file in a directory that exists and that you may write"
    )]
    Io {
        /// What was tried.
        step: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is a device, a pipe or the like.
    #[error("the state file {path} is no regular file: name a file, one that is there or a new one")]
    NoFile {
        /// What it is called.
        path: PathBuf,
    },
    /// The file has another size than a state file has.
    #[error(
        "the state file {path} has {octets} octets, but a state file has {FILE_OCTETS}: it is damaged or something else. \
         Name another file, or give --reset-state to start as delivered (this file is kept as {path}.bad)"
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// How many octets it has.
        octets: u64,
    },
    /// Both slots are damaged.
    #[error(
        "the state file {path} is damaged (slot A: {a}, slot B: {b}). \
         Give --reset-state to start as delivered (this file is kept as {path}.bad)"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with slot A.
        a: SlotFault,
        /// What is wrong with slot B.
        b: SlotFault,
    },
    /// Another encoder uses the file.
    #[error("the state file {path} is in use by another encoder: end that one, or name another file")]
    InUse {
        /// The file.
        path: PathBuf,
    },
}

impl Store {
    /// A memory that forgets.
    pub const fn forgetful() -> Self {
        Self::Memory([None; 2])
    }

    /// Opens a state file, or makes one as delivered.
    ///
    /// `reset`: a file that is there is kept beside it as `.bad` and a new one is made. One kept
    /// before stays: then it is `.bad2` and so on.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or written, is in use, or holds no record; it is left as it is.
    pub fn open(path: &Path, variant: Variant, reset: bool) -> Result<Self, StoreError> {
        let failed = |step| move |source| StoreError::Io { step, path: path.to_owned(), source };
        let open = || OpenOptions::new().read(true).write(true).open(path);
        let mut is_new = false;
        let mut file = match open() {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                is_new = true;
                make(path, variant).and_then(|()| open()).map_err(failed("make"))?
            }
            other => other.map_err(failed("open"))?,
        };
        if !file.metadata().map_err(failed("read"))?.is_file() {
            return Err(StoreError::NoFile { path: path.to_owned() });
        }
        lock(&file, path)?;
        if reset && !is_new {
            fs::rename(path, name_to_keep(path)).map_err(failed("set aside"))?;
            file = make(path, variant).and_then(|()| open()).map_err(failed("make"))?;
            lock(&file, path)?;
        }
        let octets = file.metadata().map_err(failed("read"))?.len();
        if octets != FILE_OCTETS as u64 {
            return Err(StoreError::Size { path: path.to_owned(), octets });
        }
        Ok(Self::File { file, path: path.to_owned() })
    }

    /// What is stored.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or both its slots are damaged.
    pub fn load(&mut self) -> Result<Choice, StoreError> {
        let (file, path) = match self {
            Self::Memory([a, b]) => {
                let slot = |octets: &Option<[u8; SLOT_OCTETS]>| {
                    Record::decode(octets.as_ref().map_or(&[], <[u8; SLOT_OCTETS]>::as_slice))
                };
                return Ok(nonvolatile::choose(slot(a), slot(b)));
            }
            Self::File { file, path } => (file, path),
        };
        let mut octets = [0; FILE_OCTETS];
        let read = io::Seek::rewind(file).and_then(|()| file.read_exact(&mut octets));
        read.map_err(|source| StoreError::Io { step: "read", path: path.clone(), source })?;
        let (a, b) = octets.split_at(SLOT_OCTETS);
        match nonvolatile::choose(Record::decode(a), Record::decode(b)) {
            Choice::Lost { a, b } => Err(StoreError::Damaged { path: path.clone(), a, b }),
            choice => Ok(choice),
        }
    }

    /// Writes a record into its slot. It survives the end of this program at once; the system
    /// brings it to the disk in its own time.
    ///
    /// # Errors
    ///
    /// The system refuses.
    pub fn write(&mut self, record: &NonvolatileWrite) -> io::Result<()> {
        match self {
            Self::Memory(slots) => {
                let [a, b] = slots;
                *(if record.slot == Slot::A { a } else { b }) = Some(record.octets);
                Ok(())
            }
            Self::File { file, .. } => {
                let offset = if record.slot == Slot::A { 0 } else { SLOT_OCTETS as u64 };
                file.write_all_at(&record.octets, offset)
            }
        }
    }

    /// Writes the first half of a record into its slot, as when the power goes meanwhile.
    pub(crate) fn write_half(&mut self, record: &NonvolatileWrite) -> io::Result<()> {
        let half = &record.octets[..SLOT_OCTETS / 2];
        match self {
            Self::Memory([a, b]) => {
                let slot = if record.slot == Slot::A { a } else { b };
                slot.get_or_insert([0xFF; SLOT_OCTETS])[..half.len()].copy_from_slice(half);
                Ok(())
            }
            Self::File { file, .. } => {
                let offset = if record.slot == Slot::A { 0 } else { SLOT_OCTETS as u64 };
                file.write_all_at(half, offset)
            }
        }
    }

    /// Damages what slot A and slot B hold, where asked to.
    ///
    /// # Errors
    ///
    /// The system refuses the file.
    pub fn damage(&mut self, slots: [bool; 2]) -> Result<(), StoreError> {
        for (slot, damaged) in [Slot::A, Slot::B].into_iter().zip(slots) {
            if damaged {
                // No record begins so.
                self.write(&NonvolatileWrite { slot, octets: [0xA5; SLOT_OCTETS] })
                    .map_err(|source| self.io_error("damage", source))?;
            }
        }
        Ok(())
    }

    /// Changes the record in force, or that of delivery, and writes it as the next one.
    pub(crate) fn rewrite(
        &mut self,
        variant: Variant,
        change: impl FnOnce(&mut Record),
    ) -> Result<(), PresetError> {
        let (mut record, mut sequence, mut slot, writes) = match self.load() {
            Ok(Choice::Use { record, sequence, slot, .. }) => (record, sequence, slot, 1),
            // The very first record goes to both slots.
            Ok(Choice::AsDelivered) => (Record::as_delivered(variant), 0, Slot::B, 2),
            Ok(Choice::Lost { .. }) | Err(StoreError::Damaged { .. }) => return Err(PresetError::Damaged),
            Err(error) => return Err(error.into()),
        };
        change(&mut record);
        for _ in 0..writes {
            (sequence, slot) = (sequence.wrapping_add(1), slot.other());
            let octets = record.encode(sequence);
            self.write(&NonvolatileWrite { slot, octets }).map_err(PresetError::Write)?;
        }
        Ok(())
    }

    fn io_error(&self, step: &'static str, source: io::Error) -> StoreError {
        let path = match self {
            Self::Memory(_) => PathBuf::new(),
            Self::File { path, .. } => path.clone(),
        };
        StoreError::Io { step, path, source }
    }

    /// Waits until everything is on the disk.
    ///
    /// # Errors
    ///
    /// The system refuses.
    pub fn sync(&self) -> io::Result<()> {
        match self {
            Self::Memory(_) => Ok(()),
            Self::File { file, .. } => file.sync_data(),
        }
    }
}

/// A name beside `path` that nothing has yet.
fn name_to_keep(path: &Path) -> PathBuf {
    let mut bad = path.as_os_str().to_owned();
    bad.push(".bad");
    let mut name = PathBuf::from(&bad);
    let mut number = 1;
    while fs::symlink_metadata(&name).is_ok() {
        number += 1;
        let mut numbered = bad.clone();
        numbered.push(number.to_string());
        name = numbered.into();
    }
    name
}

/// Makes a state file as delivered, whole or not at all. Both slots hold the record, so that a cut
/// during the first write finds the other one good.
fn make(path: &Path, variant: Variant) -> io::Result<()> {
    let mut fresh = path.as_os_str().to_owned();
    fresh.push(".new");
    let fresh = PathBuf::from(fresh);
    let slot = Record::as_delivered(variant).encode(0);
    let mut file = File::create(&fresh)?;
    file.write_all(&[slot, slot].concat())?;
    // Before it has its name: power that goes now would leave a file with nothing in it.
    file.sync_all()?;
    // A link never takes the place of a file that somebody else has made meanwhile; where the file
    // system has none, a new name has to do.
    match fs::hard_link(&fresh, path) {
        Ok(()) => fs::remove_file(&fresh),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => fs::remove_file(&fresh),
        Err(_) => fs::rename(&fresh, path),
    }
}

fn lock(file: &File, path: &Path) -> Result<(), StoreError> {
    file.try_lock().map_err(|error| match error {
        fs::TryLockError::WouldBlock => StoreError::InUse { path: path.to_owned() },
        fs::TryLockError::Error(source) => StoreError::Io { step: "lock", path: path.to_owned(), source },
    })
}
