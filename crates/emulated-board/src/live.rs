//! A board that runs beside the clock, in a world that somebody steers.
//!
//! Its time goes on latch by latch, as fast as the clock where the computer is fast enough and else slower: so
//! nothing that is late here is late there. Shaft and world are those of an encoder in virtual time that is on the
//! bus of nobody, a *shadow*: requests about shaft, supply, temperature, light and battery go to it.

mod requests;

use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration as Time, Instant as Moment};

use plant::scenario::{Bench, Scenario};
use plant::{Handle, Snapshot};
use profibus_dp::time::{Duration, Instant};
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::specification::LATCH_PERIOD;

use crate::board::Board;
use crate::emulator::EmulatorError;
use crate::stepped::Stepped;

/// Where the clock is so far ahead it is not caught up with any more.
const FORGIVEN: Duration = Duration::from_millis(50);

/// What such a board begins with.
#[derive(Debug, Clone)]
pub struct Beginning {
    /// The rotary switches.
    pub switches: String,
    /// Singleturn and multiturn bits, as `16x15`.
    pub bits: String,
    /// What turns it, as `run --shaft` has it.
    pub shaft: String,
}

/// A board that runs. Dropping the last of its clones ends it.
#[derive(Clone)]
pub struct Live {
    shared: Arc<Shared>,
    _keeper: Arc<Keeper>,
}

struct Shared {
    table: Mutex<Table>,
    shadow: Handle,
    ended: AtomicBool,
    /// So many wait for the table: the thread that lets time go on makes room for them.
    waiting: AtomicUsize,
}

struct Keeper {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// What is under the hands of whoever has the lock.
#[derive(Debug)]
struct Table {
    stepped: Stepped,
    bench: Bench,
    switched_off: bool,
    memory_lost: bool,
    /// Why it does not run any more.
    broken: Option<String>,
}

impl Live {
    /// Gives the board power, and lets its time go on.
    ///
    /// # Errors
    ///
    /// A beginning that is none, a firmware that does not answer, or no thread to be had.
    pub fn start(board: Board, beginning: &Beginning) -> Result<Self, EmulatorError> {
        let failed = |error: &dyn fmt::Display| EmulatorError::World(error.to_string());
        let scenario =
            Scenario::parse(&beginning.scenario()).map_err(|faults| failed(&format!("{faults:?}")))?;
        let bench = Bench::new(&scenario).map_err(|error| failed(&error))?;
        let shadow = bench.handle().clone();
        let snapshot = snapshot(&shadow)?;
        let mut stepped = Stepped::new(board, snapshot.identity.variant, snapshot.world.0);
        // Octets come while latches go on: no telegram is to end where they come a little late.
        (stepped.rate, stepped.brief) = (1, false);
        stepped.switches = snapshot.identity.switches.0;
        let mut table = Table { stepped, bench, switched_off: false, memory_lost: false, broken: None };
        table.look(&shadow)?;
        let shared = Arc::new(Shared {
            table: Mutex::new(table),
            shadow,
            ended: AtomicBool::new(false),
            waiting: AtomicUsize::new(0),
        });
        let seen = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("world".to_owned())
            .spawn(move || seen.run())
            .map_err(|error| failed(&error))?;
        let keeper = Keeper { shared: Arc::clone(&shared), thread: Mutex::new(Some(thread)) };
        Ok(Self { shared, _keeper: Arc::new(keeper) })
    }

    /// The socket that a master connects to.
    pub fn bus(&self) -> PathBuf {
        self.shared.table().stepped.board().bus().to_owned()
    }

    /// Why the board does not run any more, if so.
    pub fn broken(&self) -> Option<String> {
        self.shared.table().broken.clone()
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Relaxed);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            let _ = thread.join();
        }
    }
}

impl fmt::Debug for Live {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Live").finish_non_exhaustive()
    }
}

impl Beginning {
    fn scenario(&self) -> String {
        let Self { switches, bits, shaft } = self;
        // The shadow has no master, so its rate does not matter.
        format!(
            "[[segment]]\nname = \"nowhere\"\nrate = 12000000\n[[segment.encoder]]\nname = \"board\"\n\
             switches = {switches:?}\nbits = {bits:?}\nshaft = {shaft:?}\n"
        )
    }
}

fn snapshot(shadow: &Handle) -> Result<Snapshot, EmulatorError> {
    let all = shadow.snapshot().map_err(|error| EmulatorError::World(error.to_string()))?;
    all.encoders.into_iter().next().ok_or_else(|| EmulatorError::World("there is no shadow".to_owned()))
}

impl Shared {
    fn table(&self) -> MutexGuard<'_, Table> {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        let table = self.table.lock().unwrap_or_else(PoisonError::into_inner);
        self.waiting.fetch_sub(1, Ordering::Relaxed);
        table
    }

    /// Lets time go on until the end.
    fn run(&self) {
        let mut began = (Moment::now(), Instant::ZERO);
        while !self.ended.load(Ordering::Relaxed) {
            if self.waiting.load(Ordering::Relaxed) > 0 {
                std::thread::sleep(Time::from_micros(50));
            }
            let mut table = self.table();
            let now = table.stepped.now();
            let (moment, instant) = began;
            let due = instant
                + Duration::from_nanos(u64::try_from(moment.elapsed().as_nanos()).unwrap_or(u64::MAX));
            if now + LATCH_PERIOD > due {
                drop(table);
                std::thread::sleep(Time::from(LATCH_PERIOD));
                continue;
            }
            if due.since(now) > FORGIVEN {
                began = (Moment::now(), now);
            }
            if let Err(error) = table.step(&self.shadow) {
                table.broken = Some(error.to_string());
                return;
            }
        }
    }
}

impl Table {
    /// One latch on, with the world as it is there.
    fn step(&mut self, shadow: &Handle) -> Result<(), EmulatorError> {
        let next = self.stepped.now() + LATCH_PERIOD;
        self.bench.advance_to(next).map_err(|error| EmulatorError::World(error.to_string()))?;
        self.look(shadow)?;
        self.stepped.advance_to(next)
    }

    /// The world as the shadow has it now; power comes or goes with it.
    fn look(&mut self, shadow: &Handle) -> Result<(), EmulatorError> {
        let seen = snapshot(shadow)?;
        self.stepped.measurement = seen.world.0;
        self.stepped.shaft = seen.shaft;
        let powered = seen.world.is_powered() && !self.switched_off;
        match (self.stepped.board().is_powered(), powered) {
            (true, false) => self.stepped.cut(),
            (false, true) => {
                if std::mem::take(&mut self.memory_lost) {
                    *self.stepped.board_mut().memory_mut() = [Some([0; SLOT_OCTETS]); 2];
                }
                self.stepped.power_on()
            }
            _ => Ok(()),
        }
    }
}
