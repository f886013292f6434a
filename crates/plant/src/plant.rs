//! The running plant: segments on threads, and the handle to them.

use std::ops::ControlFlow;
use std::sync::mpsc::{self, Sender};
use std::thread::JoinHandle;

use bus::termination::{self, Tap};
use bus::{Cable, Control, End, EndError, Handler, News, Segment, Settings, WallClock};

use profibus_dp::time::Instant;

use crate::control::Couplings;
use crate::encoder::{EncoderSetup, EncoderStation};
use crate::handle::{Handle, Known, Place, Way};
use crate::report::{Report, Reporter, What};
use crate::shaft::Shaft;
use crate::snapshot::Snapshot;
use crate::store::StoreError;
use crate::world::World;

/// A segment and the encoders on it.
#[derive(Debug)]
pub struct SegmentSetup {
    /// Its name in reports.
    pub name: String,
    /// Where its octets come from and go to.
    pub end: Box<dyn End>,
    /// How it treats replies.
    pub settings: Settings,
    /// Who is on it, in the order of the cable. The master is in front of them, and terminates
    /// its end.
    pub encoders: Vec<EncoderSetup>,
}

/// Why a plant does not run or did not end well.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// The memory of an encoder cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The end of a segment broke.
    #[error(transparent)]
    End(#[from] EndError),
    /// The system gives no thread.
    #[error("cannot start a thread for the segment {0}: {1}")]
    Thread(String, std::io::Error),
    /// The segment has ended already.
    #[error("the segment {0} has ended, and takes no commands")]
    Ended(String),
    /// There is no such encoder.
    #[error("there is no encoder number {0}")]
    NoEncoder(usize),
    /// There is no such segment.
    #[error("there is no segment {0}")]
    NoSegment(String),
}

/// What a segment's thread is asked to do; encoders count from 0 in it.
pub(crate) enum Command {
    StartShafts,
    Shaft(usize, Shaft),
    World(usize, World),
    PowerCycle(usize),
    Snapshots(Sender<Vec<Snapshot>>),
    With(Work),
}

/// Something to do on a segment's thread.
pub(crate) type Work = Box<dyn FnOnce(&mut Segment<EncoderStation>) + Send>;

/// Segments that run, each on a thread of its own. Dropping it ends them in order.
#[derive(Debug, Default)]
pub struct Plant {
    segments: Vec<Running>,
    /// Shafts that others drive, for all handles.
    couplings: Couplings,
}

#[derive(Debug)]
struct Running {
    place: Place,
    control: Control<Command>,
    /// The number of its first encoder in the plant, and how many it has.
    encoders: std::ops::Range<usize>,
    thread: Option<JoinHandle<Result<(), EndError>>>,
}

impl Plant {
    /// A plant without segments.
    pub fn new() -> Self {
        Self::default()
    }

    /// Gives the encoders of a segment power and runs it. Their shafts stand where they begin
    /// until [`start_shafts`](Self::start_shafts).
    ///
    /// # Errors
    ///
    /// A memory that cannot be used, or no thread to be had.
    pub fn add(&mut self, setup: SegmentSetup, reports: Sender<Report>) -> Result<(), PlantError> {
        self.add_with_master_at(MasterTap::default(), setup, reports)
    }

    /// The same, with the master somewhere else in the cable.
    ///
    /// # Errors
    ///
    /// As for [`add`](Self::add).
    pub fn add_with_master_at(
        &mut self,
        master: MasterTap,
        setup: SegmentSetup,
        reports: Sender<Report>,
    ) -> Result<(), PlantError> {
        let SegmentSetup { name, end, settings, encoders } = setup;
        let first = self.segments.last().map_or(0, |segment| segment.encoders.end);
        let count = encoders.len();
        let mut segment = Segment::new(end, WallClock::new(), settings);
        let taps: Vec<_> = encoders.iter().map(Terminated::of).collect();
        let known = encoders.iter().map(|encoder| Known {
            name: encoder.reporter.who().to_owned(),
            variant: encoder.identity.variant,
        });
        let known: Vec<_> = known.collect();
        for encoder in encoders {
            let now = segment.now();
            segment.add(EncoderStation::new(now, encoder)?);
        }
        segment.faults_mut().set_cable(master.cable(count));
        let (control, commands) = segment.control();
        let port = segment.name().to_owned();
        tell_termination(&name, master, &taps, &reports);
        let mut operator = Operator { reporter: Reporter::new(&name, Some(reports)) };
        let thread = std::thread::Builder::new()
            .name(name.clone())
            .spawn(move || {
                let result = segment.run(&commands, &mut operator);
                let now = segment.now();
                for station in segment.stations_mut() {
                    station.shut_down(now);
                }
                if let Err(error) = &result {
                    operator.reporter.tell(now, What::SegmentBroke(error.to_string().into()));
                }
                result
            })
            .map_err(|error| PlantError::Thread(name.clone(), error))?;
        let encoders = first..first + count;
        let place = Place { name, port, encoders: known, way: Way::Thread(control.clone()) };
        self.segments.push(Running { place, control, encoders, thread: Some(thread) });
        Ok(())
    }

    /// A hand for other threads on the segments that there are now.
    pub fn handle(&self) -> Handle {
        Handle::new(self.segments.iter().map(|segment| segment.place.clone()), self.couplings.clone())
    }

    /// What a user opens to get to each segment.
    pub fn ports(&self) -> impl Iterator<Item = &str> {
        self.segments.iter().map(|segment| segment.place.port.as_str())
    }

    /// Lets the shafts begin to move.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn start_shafts(&self) -> Result<(), PlantError> {
        self.segments.iter().try_for_each(|segment| segment.ask(Command::StartShafts))?;
        // The answer comes when the command has been carried out.
        self.snapshots().map(drop)
    }

    /// Gives an encoder another movement of its shaft; it begins at once.
    ///
    /// # Errors
    ///
    /// No such encoder, or its segment has ended.
    pub fn set_shaft(&self, encoder: usize, shaft: Shaft) -> Result<(), PlantError> {
        let (segment, at) = self.find(encoder)?;
        segment.ask(Command::Shaft(at, shaft))
    }

    /// Gives an encoder another world.
    ///
    /// # Errors
    ///
    /// No such encoder, or its segment has ended.
    pub fn set_world(&self, encoder: usize, world: World) -> Result<(), PlantError> {
        let (segment, at) = self.find(encoder)?;
        segment.ask(Command::World(at, world))
    }

    /// Cuts the power of an encoder and gives it back.
    ///
    /// # Errors
    ///
    /// No such encoder, or its segment has ended.
    pub fn power_cycle(&self, encoder: usize) -> Result<(), PlantError> {
        let (segment, at) = self.find(encoder)?;
        segment.ask(Command::PowerCycle(at))
    }

    /// All encoders as they are now, in the order they were added.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn snapshots(&self) -> Result<Vec<Snapshot>, PlantError> {
        let mut all = Vec::new();
        for segment in &self.segments {
            let (to, from) = mpsc::channel();
            segment.ask(Command::Snapshots(to))?;
            all.extend(from.recv().map_err(|_| PlantError::Ended(segment.place.name.clone()))?);
        }
        Ok(all)
    }

    /// Ends all segments in order: what must be kept is on the disk afterwards.
    ///
    /// # Errors
    ///
    /// The first end that broke while it ran.
    pub fn stop(mut self) -> Result<(), PlantError> {
        self.segments.iter_mut().map(Running::end).fold(Ok(()), Result::and)
    }

    fn find(&self, encoder: usize) -> Result<(&Running, usize), PlantError> {
        let segment = self.segments.iter().find(|segment| segment.encoders.contains(&encoder));
        let segment = segment.ok_or(PlantError::NoEncoder(encoder))?;
        Ok((segment, encoder - segment.encoders.start))
    }
}

/// The master in the cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MasterTap {
    /// How many encoders are before it.
    pub place: usize,
    /// Whether it terminates the bus.
    pub terminated: bool,
}

impl MasterTap {
    /// The cable, whole, with so many encoders.
    pub(crate) fn cable(self, encoders: usize) -> Cable {
        let at_end = self.place == 0 || self.place >= encoders;
        // A master that is right stays right wherever a request puts it.
        let master_terminated = (self.terminated != at_end).then_some(self.terminated);
        Cable { master_after: self.place, master_terminated, ..Cable::default() }
    }
}

impl Default for MasterTap {
    /// In front of all encoders, and terminated.
    fn default() -> Self {
        Self { place: 0, terminated: true }
    }
}

/// An encoder's switches in the cable.
pub(crate) struct Terminated {
    name: String,
    switches: [bool; 2],
}

impl Terminated {
    pub(crate) fn of(encoder: &EncoderSetup) -> Self {
        let switches = [encoder.termination.first, encoder.termination.second];
        Self { name: encoder.reporter.who().to_owned(), switches }
    }
}

/// Reports where the bus is not terminated as it has to be (manual 3.3).
pub(crate) fn tell_termination(
    segment: &str,
    master: MasterTap,
    encoders: &[Terminated],
    reports: &Sender<Report>,
) {
    let taps = encoders.iter().map(|encoder| Tap { name: &encoder.name, switches: encoder.switches });
    let mut cable: Vec<_> = taps.collect();
    let tap = Tap { name: "master", switches: [master.terminated; 2] };
    cable.insert(master.place.min(cable.len()), tap);
    let reporter = Reporter::new(segment, Some(reports.clone()));
    for complaint in termination::judge(&cable) {
        reporter.tell(Instant::ZERO, What::Termination(complaint.to_string().into()));
    }
}

impl Running {
    fn ask(&self, command: Command) -> Result<(), PlantError> {
        self.control.send(command).map_err(|_| PlantError::Ended(self.place.name.clone()))
    }

    fn end(&mut self) -> Result<(), PlantError> {
        self.control.stop();
        match self.thread.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(result)) => Ok(result?),
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.control.stop();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What carries commands out on the thread of a segment.
#[derive(Debug)]
struct Operator {
    reporter: Reporter,
}

impl Handler<EncoderStation> for Operator {
    type Command = Command;

    fn command(&mut self, segment: &mut Segment<EncoderStation>, command: Command) -> ControlFlow<()> {
        if let Command::With(work) = command {
            work(segment);
            return ControlFlow::Continue(());
        }
        let now = segment.now();
        let stations = segment.stations_mut();
        let result = match command {
            Command::StartShafts => {
                for station in stations {
                    station.start_shaft(now);
                }
                Ok(())
            }
            Command::Shaft(at, shaft) => {
                stations[at].set_shaft(now, shaft.started(now));
                Ok(())
            }
            Command::World(at, world) => stations[at].set_world(now, world),
            Command::PowerCycle(at) => stations[at].power_cycle(now),
            Command::With(_) => Ok(()),
            Command::Snapshots(to) => {
                let _ = to.send(stations.iter_mut().map(|station| station.snapshot(now)).collect());
                Ok(())
            }
        };
        if let Err(error) = result {
            self.reporter.tell(now, What::NotStored(error.to_string().into()));
        }
        ControlFlow::Continue(())
    }

    fn news(&mut self, segment: &mut Segment<EncoderStation>, news: News) {
        let what = match news {
            News::MasterCame(_) if !segment.has_rate() => What::MasterConnected,
            News::MasterCame(rate) => What::MasterCame(rate),
            News::RateChanged(rate) => What::RateChanged(rate),
            News::MasterLeft => What::MasterLeft,
            News::LateReplies(late) => What::LateReplies(late),
            News::Noted(note) => What::Noted(note),
        };
        self.reporter.tell(segment.now(), what);
    }
}
