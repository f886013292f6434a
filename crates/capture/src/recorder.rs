//! Takes what a segment's tap sees, and writes it on a thread of its own.
//!
//! The segment copies octets to memory, no more. What the disk cannot take in time is counted, and the file
//! says where it is missing.

mod listener;
mod words;

use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bus::end::Written;
use bus::{FaultCounters, Sight, WireTap};
use profibus_dp::time::{Baudrate, Instant};

use crate::assembler::Assembler;
use crate::packet::{Direction, Faults, LinkType, Packet};
use crate::writer::Writer;

pub use listener::Listener;

/// How often what was seen goes to the file.
const PERIOD: Duration = Duration::from_millis(20);
/// What may wait for the disk.
const MOST_EVENTS: usize = 64 * 1024;
/// With so many waiting the writer does not wait for its period: what it takes then is still in a cache.
const MANY_EVENTS: usize = 8 * 1024;
/// So many octets are given to the system at once.
const MANY_OCTETS: usize = 64 * 1024;
const MOST_OCTETS: usize = 4 * 1024 * 1024;

/// How to record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// How the file names PROFIBUS.
    pub link_type: LinkType,
    /// What the bus is called in it.
    pub name: String,
    /// The segment's time is virtual: it counts from 0, and the segment waits for the disk, as nobody else
    /// waits for the segment.
    pub is_virtual: bool,
}

/// What became of a recording.
#[derive(Debug, Default)]
pub struct Report {
    /// Packets in the file.
    pub packets: u64,
    /// Events that are not in it.
    pub missing: u64,
    /// What the disk said.
    pub error: Option<io::Error>,
}

/// A recording that goes on. Dropping it ends it.
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    is_virtual: bool,
    writer: std::thread::Thread,
    thread: Option<JoinHandle<Report>>,
}

/// Who listens for a [`Recorder`] or a [`Listener`].
#[derive(Debug)]
pub struct Tap {
    shared: Arc<Shared>,
    /// Whoever waits for a store that fills up.
    writer: Option<std::thread::Thread>,
    /// Nanoseconds between 1970 and the segment's zero.
    origin: Option<u64>,
    is_virtual: bool,
}

#[derive(Debug, Default)]
struct Shared {
    store: Mutex<Store>,
    /// There is room again.
    room: Condvar,
}

/// What waits for the disk.
#[derive(Debug, Default)]
struct Store {
    events: Vec<Event>,
    octets: Vec<u8>,
    /// What the few events are that are no usual ones, in their order.
    unusual: Vec<What>,
    /// Events that found no room since the last time.
    missing: u64,
    /// Nobody takes anything any more.
    closed: bool,
    /// It shall end.
    ending: bool,
}

/// Something seen; its octets are the next so many. Two of them come with every exchange, so they are small.
#[derive(Debug, Clone, Copy)]
struct Event {
    nanos: u64,
    octets: u32,
    is: Is,
}

/// What an event is, as far as it is a usual one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Is {
    Request,
    Reply,
    /// The next of those that are told elsewhere.
    Unusual,
}

#[derive(Debug)]
enum What {
    Heard,
    Request(Option<Box<FaultCounters>>),
    Reply { faults: Option<Box<FaultCounters>>, collision: bool, dropped: usize },
    Overtaken,
    TooLate,
    CharacterError,
    MasterCame(Option<Baudrate>),
    Rate(Option<Baudrate>),
    MasterLeft,
}

impl Recorder {
    /// Begins to record to a new file; one that is there is replaced.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn start(path: &Path, settings: &Settings) -> io::Result<Self> {
        let mut writer = Writer::new(
            BufWriter::with_capacity(MANY_OCTETS, File::create(path)?),
            settings.link_type,
            &settings.name,
        )?;
        writer.flush()?;
        let shared = Arc::new(Shared::default());
        let is_virtual = settings.is_virtual;
        let thread = {
            let shared = Arc::clone(&shared);
            let mut work = Work { writer, assembler: Assembler::default(), report: Report::default() };
            std::thread::Builder::new()
                .name("capture".to_owned())
                .spawn(move || work.run(&shared, is_virtual))?
        };
        Ok(Self { shared, is_virtual, writer: thread.thread().clone(), thread: Some(thread) })
    }

    /// Somebody who listens for it, on one segment.
    pub fn tap(&self) -> Tap {
        let thread = Some(self.writer.clone());
        let origin = self.is_virtual.then_some(0);
        Tap { shared: Arc::clone(&self.shared), writer: thread, origin, is_virtual: self.is_virtual }
    }

    /// Ends the recording: all that was seen is in the file then.
    pub fn finish(mut self) -> Report {
        self.end()
    }

    fn end(&mut self) -> Report {
        let Some(thread) = self.thread.take() else {
            return Report::default();
        };
        self.shared.lock().ending = true;
        thread.thread().unpark();
        match thread.join() {
            Ok(report) => report,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Tap {
    /// Takes octets of which nobody knows who has sent them.
    pub fn heard(&mut self, at: Instant, octets: &[u8]) {
        self.keep(at, octets, Is::Unusual, Some(What::Heard));
    }

    fn unusual(&mut self, at: Instant, octets: &[u8], what: What) {
        self.keep(at, octets, Is::Unusual, Some(what));
    }

    /// `unusual` stands beside an event that is.
    fn keep(&mut self, at: Instant, octets: &[u8], is: Is, unusual: Option<What>) {
        let at = at.as_nanos();
        let origin = *self.origin.get_or_insert_with(|| since_1970().saturating_sub(at));
        let event = Event {
            nanos: origin.saturating_add(at),
            octets: u32::try_from(octets.len()).unwrap_or(u32::MAX),
            is,
        };
        let mut store = self.shared.lock();
        while self.is_virtual && !store.closed && !store.has_room(octets.len()) {
            self.wake();
            store = self.shared.room.wait(store).unwrap_or_else(PoisonError::into_inner);
        }
        if store.closed || !store.has_room(octets.len()) {
            store.missing += 1;
            return;
        }
        store.octets.extend_from_slice(octets);
        store.unusual.extend(unusual);
        store.events.push(event);
        // Once, on the way to a full one: the writer comes by itself soon enough.
        if store.events.len() == MANY_EVENTS {
            self.wake();
        }
    }

    fn wake(&self) {
        if let Some(writer) = &self.writer {
            writer.unpark();
        }
    }
}

impl WireTap for Tap {
    fn saw(&mut self, at: Instant, sight: Sight<'_>) {
        let quiet = FaultCounters::default();
        let some = |faults: FaultCounters| (faults != quiet).then(|| Box::new(faults));
        match sight {
            Sight::Request { octets, faults } if faults == quiet => self.keep(at, octets, Is::Request, None),
            Sight::Request { octets, faults } => self.unusual(at, octets, What::Request(some(faults))),
            Sight::Reply { octets, faults, collision: false, written: Written::All } if faults == quiet => {
                self.keep(at, octets, Is::Reply, None);
            }
            Sight::Reply { octets, faults, collision, written } => {
                let dropped = match written {
                    Written::All => 0,
                    Written::Dropped(count) => count,
                };
                self.unusual(at, octets, What::Reply { faults: some(faults), collision, dropped });
            }
            Sight::Overtaken => self.unusual(at, &[], What::Overtaken),
            Sight::TooLate => self.unusual(at, &[], What::TooLate),
            Sight::CharacterError => self.unusual(at, &[], What::CharacterError),
            Sight::MasterCame(rate) => self.unusual(at, &[], What::MasterCame(rate)),
            Sight::Rate(rate) => self.unusual(at, &[], What::Rate(rate)),
            Sight::MasterLeft => self.unusual(at, &[], What::MasterLeft),
        }
    }
}

impl Store {
    fn has_room(&self, octets: usize) -> bool {
        self.events.len() < MOST_EVENTS && self.octets.len() + octets <= MOST_OCTETS
    }

    /// Hands over what waits; this one is empty.
    fn hand_over(&mut self, taken: &mut Self) {
        std::mem::swap(&mut taken.events, &mut self.events);
        std::mem::swap(&mut taken.octets, &mut self.octets);
        std::mem::swap(&mut taken.unusual, &mut self.unusual);
        taken.missing = std::mem::take(&mut self.missing);
    }

    /// Tells every event with its octets, and forgets it.
    fn drain(&mut self, mut tell: impl FnMut(u64, &What, &[u8])) {
        let mut rest = self.octets.as_slice();
        let mut unusual = self.unusual.drain(..);
        for event in self.events.drain(..) {
            let (octets, others) = rest.split_at(event.octets as usize);
            rest = others;
            match event.is {
                Is::Request => tell(event.nanos, &What::Request(None), octets),
                Is::Reply => {
                    tell(event.nanos, &What::Reply { faults: None, collision: false, dropped: 0 }, octets);
                }
                Is::Unusual => {
                    if let Some(what) = unusual.next() {
                        tell(event.nanos, &what, octets);
                    }
                }
            }
        }
        drop(unusual);
        self.octets.clear();
    }

    fn forget(&mut self) {
        self.events.clear();
        self.octets.clear();
        self.unusual.clear();
    }
}

/// What the thread works with.
struct Work {
    writer: Writer<BufWriter<File>>,
    assembler: Assembler,
    report: Report,
}

impl fmt::Debug for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Work").finish_non_exhaustive()
    }
}

impl Work {
    fn run(&mut self, shared: &Shared, is_virtual: bool) -> Report {
        let mut taken = Store::default();
        loop {
            {
                let mut store = shared.lock();
                store.hand_over(&mut taken);
                taken.ending = store.ending;
                store.closed |= self.report.error.is_some();
            }
            shared.room.notify_all();
            let result = self.write(&mut taken, is_virtual);
            self.report.missing += taken.missing;
            if let Err(error) = result {
                self.report.error.get_or_insert(error);
            }
            if taken.ending {
                return std::mem::take(&mut self.report);
            }
            std::thread::park_timeout(PERIOD);
        }
    }

    fn write(&mut self, taken: &mut Store, is_virtual: bool) -> io::Result<()> {
        let Self { writer, assembler, report } = self;
        if report.error.is_some() {
            report.missing += taken.events.len() as u64;
            taken.forget();
            return Ok(());
        }
        let mut result = Ok(());
        let mut take = |packet: Packet| {
            if result.is_ok() {
                result = writer.write(&packet);
                report.packets += u64::from(result.is_ok());
            }
        };
        let nothing_new = taken.events.is_empty();
        let mut last = 0;
        taken.drain(|nanos, what, octets| {
            last = nanos;
            tell(assembler, nanos, what, octets, &mut take);
        });
        if taken.missing > 0 {
            assembler.finish(&mut take);
            let words = format!("{} events are missing here: the disk was too slow", taken.missing);
            take(Packet { nanos: last, missing: taken.missing, comments: vec![words], ..Packet::default() });
        }
        if taken.ending {
            assembler.finish(&mut take);
        } else if !is_virtual && nothing_new {
            assembler.pass(since_1970(), &mut take);
        }
        result?;
        writer.flush()
    }
}

/// An event as packets.
fn tell(assembler: &mut Assembler, nanos: u64, what: &What, octets: &[u8], take: &mut dyn FnMut(Packet)) {
    let (direction, faults) = match what {
        What::Heard => (None, Faults::default()),
        What::Request(_) => (Some(Direction::Request), Faults::default()),
        What::Reply { .. } => (Some(Direction::Reply), Faults::default()),
        What::CharacterError => {
            assembler.character_error(take);
            (None, Faults { character: true, ..Faults::default() })
        }
        _ => {
            assembler.finish(take);
            (None, Faults::default())
        }
    };
    let comments = words::of(what, octets.len());
    if direction.is_some() || matches!(what, What::Heard) {
        assembler.push(nanos, direction, octets, comments, take);
    } else {
        take(Packet { nanos, direction, faults, comments, ..Packet::default() });
    }
}

fn since_1970() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
