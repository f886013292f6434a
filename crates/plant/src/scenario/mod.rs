//! Scenario files: encoders on their segments, what happens to them, and what must hold.
//!
//! - [`Scenario::parse`] reads one; what is wrong comes with its line and what to write instead.
//! - [`schema`] is the same for editors.
//! - [`run`](run()) plays one in virtual time, with its built-in masters, and judges it.
//!
//! docs/scenarios.md has every key.

mod bench;
mod encoders;
mod events;
mod expect;
mod fault;
mod hand;
mod judge;
pub mod keys;
mod outcome;
mod poll;
mod poller;
pub mod quantity;
mod reader;
mod run;
mod segments;
mod starts;

use std::path::{Path, PathBuf};

use bus::PortAddress;
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::TerminationSwitches;
use sch108bex::specification::Variant;
use toml::de::DeTable;

pub use bench::Bench;
pub use events::{Act, Event, MasterAct};
pub use expect::{Check, Expectation, Flag, What};
pub use fault::{Fault, Faults, position};
pub use hand::{CodeSequenceName, FunctionalityName, MasterRefusal, MasterRequest, TimeBaseName};
pub use keys::schema;
pub use outcome::{EncoderOutcome, Outcome, SegmentOutcome, Verdict};
pub use quantity::{Scale, Travel, Unit, show_time};
pub use run::{Progress, RunError, play, run};

use crate::control::{Request, Which};
use crate::plant::MasterTap;
use crate::shaft::Shaft;
use crate::world::World;
use reader::{Gathered, Reader};

/// Longer files are none.
pub const MOST_OCTETS: usize = 4 << 20;
/// No scenario lasts longer.
pub const LONGEST: Duration = Duration::from_secs(100 * 86_400);

const MOST_SEGMENTS: usize = 64;

/// A scenario, whole and sound: every name in it is somebody's.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// What it is called; may be empty.
    pub title: String,
    /// The story; may be empty.
    pub description: String,
    /// When it ends.
    pub duration: Duration,
    /// The buses.
    pub segments: Vec<SegmentPlan>,
    /// What happens, in order of time.
    pub events: Vec<Event>,
    /// What must hold, in the order of the file.
    pub expectations: Vec<Expectation>,
}

/// A bus.
#[derive(Debug, Clone)]
pub struct SegmentPlan {
    /// Its name.
    pub name: String,
    /// Where it is in real time.
    pub port: PortAddress,
    /// A symbolic link to its pseudo terminal.
    pub link: Option<PathBuf>,
    /// Its rate; `None`: the master's, and [`bus::segment::DEFAULT_RATE`] in virtual time.
    pub rate: Option<Baudrate>,
    /// The encoders have to find the rate.
    pub search: bool,
    /// Replies take as long as on a bus.
    pub pace: bool,
    /// Where the master is in the cable.
    pub tap: MasterTap,
    /// Whether a wrong termination damages bits.
    pub reflections: bool,
    /// Who is on it, in the order of the cable.
    pub encoders: Vec<EncoderPlan>,
    /// The built-in master.
    pub master: Option<MasterPlan>,
}

/// An encoder.
#[derive(Debug, Clone)]
pub struct EncoderPlan {
    /// Its name, that of its segment included: `crane.hoist`.
    pub name: String,
    /// Who it is.
    pub identity: Identity,
    /// The configurations that it offers.
    pub configurations: Configurations,
    /// The user's own GSD of it, which says what masters know of it; see [`Scenario::resolve_gsd`].
    pub gsd: Option<PathBuf>,
    /// What keeps its memory, as the file has it.
    pub state: Option<PathBuf>,
    /// Its termination switches.
    pub termination: TerminationSwitches,
    /// What turns it, from the beginning on.
    pub shaft: Shaft,
    /// What is around it.
    pub world: World,
    /// What turns steps into units of the machine.
    pub scale: Option<Scale>,
    /// What is done for it at its start, each without its name: see [`Scenario::starts`].
    pub starts: Vec<Request>,
    /// Whether it is on the bus at the beginning.
    pub joined: bool,
    /// It is not there before this moment, which stands in the file at this octet.
    pub joins_at: Option<(Instant, usize)>,
}

/// A built-in master.
#[derive(Debug, Clone)]
pub struct MasterPlan {
    /// Its station address.
    pub address: u8,
    /// How often it repeats what is not answered.
    pub retries: u8,
    /// How often it goes through its list.
    pub cycle: Duration,
    /// When it begins.
    pub start: Instant,
    /// Whom it asks, in order.
    pub polls: Vec<PollPlan>,
}

/// Whom a master asks, and how.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PollPlan {
    /// The encoder's full name.
    pub encoder: String,
    /// Where the master looks for it.
    pub address: u8,
    /// Set_Prm, from octet 1 on.
    pub set_prm: Vec<u8>,
    /// Whether its ident number is the encoder's, whatever that is.
    pub ident_of_encoder: bool,
    /// Chk_Cfg.
    pub configuration: Vec<u8>,
    /// How many output octets it sends.
    pub outputs: usize,
}

impl Scenario {
    /// Reads a scenario. Paths in it are as they are written: see [`resolve_paths`](Self::resolve_paths).
    ///
    /// # Errors
    ///
    /// Everything that is wrong, up to twenty things.
    pub fn parse(source: &str) -> Result<Self, Faults> {
        Self::parse_in(source, Path::new(""))
    }

    /// The same with files of playbacks, which are read at once, from this folder on.
    ///
    /// # Errors
    ///
    /// As for [`parse`](Self::parse).
    pub fn parse_in(source: &str, folder: &Path) -> Result<Self, Faults> {
        if source.len() > MOST_OCTETS {
            let message = format!("it has {} octets, and {MOST_OCTETS} is the most", source.len());
            return Err(Faults::of_the_file(message, "is this the right file? Encoders can have a `count`"));
        }
        let document = DeTable::parse(source).map_err(|error| {
            let fault = Fault {
                span: error.span(),
                message: format!("this is no TOML: {}", reader::error_in_short(&error.message())),
                hint: "docs/scenarios.md has examples to begin with".to_owned(),
            };
            Faults(vec![fault])
        })?;
        let faults = Gathered::of(folder);
        let file = Reader::new(&faults, document.get_ref(), 0..0, &keys::FILE);
        let scenario = Self::read(&file);
        let mut found = faults.take();
        found.sort_by_key(|fault| fault.span.as_ref().map(|span| (span.start, span.end)));
        match scenario {
            Some(scenario) if found.is_empty() => Ok(scenario),
            _ => Err(Faults(found)),
        }
    }

    /// Reads octets, which may be anything.
    ///
    /// # Errors
    ///
    /// As for [`parse_in`](Self::parse_in), and octets that are no text.
    pub fn parse_octets(octets: &[u8], folder: &Path) -> Result<Self, Faults> {
        match std::str::from_utf8(octets) {
            Ok(source) => Self::parse_in(source, folder),
            Err(error) => {
                let line = octets[..error.valid_up_to()].split(|octet| *octet == b'\n').count();
                let octet = octets.get(error.valid_up_to()).copied().unwrap_or_default();
                let message = format!("it is no text: octet {octet:02X} in line {line} is none of UTF-8");
                Err(Faults::of_the_file(message, "is this the right file? Save it as UTF-8"))
            }
        }
    }

    fn read(file: &Reader<'_>) -> Option<Self> {
        let text = |name| file.text(name).map(|text| shown(text.value)).unwrap_or_default();
        let (title, description) = (text("title"), text("description"));
        let duration = file.time("duration", Duration::ZERO, LONGEST);
        let tables = file.tables("segment", MOST_SEGMENTS);
        if file
            .raw("segment")
            .is_none_or(|found| found.get_ref().as_array().is_some_and(|list| list.is_empty()))
        {
            let hint = "begin with [[segment]] and [[segment.encoder]]";
            file.fault(file.span_of("segment"), "there is no segment", hint);
        }
        let mut segments = segments::read(&tables);
        if file.faults.any() {
            // Names cannot be looked up: what follows would be told for nothing.
            return None;
        }
        let names = Names::of(&segments);
        let events = events::read(file, &names, segments::joins(&mut segments));
        let expectations = expect::read(file, &names, &segments);
        let last =
            events.iter().map(|event| event.at).chain(expectations.iter().map(Expectation::last)).max();
        let after = last.unwrap_or(Instant::ZERO).since(Instant::ZERO);
        let duration = duration.unwrap_or(Duration::from_nanos(after.as_nanos() + 1_000_000_000));
        if duration < after {
            let hint = format!("write at least {}", show_time(after));
            file.fault(file.span_of("duration"), "it ends before the last event or expectation", hint);
        }
        Some(Self { title, description, duration, segments, events, expectations })
    }

    /// Takes paths that are not absolute from this folder on.
    pub fn resolve_paths(&mut self, folder: &Path) {
        for encoder in self.segments.iter_mut().flat_map(|segment| &mut segment.encoders) {
            encoder.state = encoder.state.take().map(|path| folder.join(path));
            encoder.gsd = encoder.gsd.take().map(|path| folder.join(path));
        }
    }

    /// Lets somebody read the GSD files of encoders, for the ident number and the configurations that masters
    /// know them by.
    ///
    /// # Errors
    ///
    /// What the reader says of the first file that is none, with its name.
    pub fn resolve_gsd(
        &mut self,
        mut read: impl FnMut(&Path, Variant) -> Result<(u16, Configurations), String>,
    ) -> Result<(), String> {
        for segment in &mut self.segments {
            for encoder in &mut segment.encoders {
                let Some(path) = &encoder.gsd else { continue };
                let (ident, configurations) = read(path, encoder.identity.variant)
                    .map_err(|why| format!("{}: gsd {}: {why}", encoder.name, path.display()))?;
                encoder.identity.ident_number = ident;
                encoder.configurations = configurations;
                let polls = segment.master.iter_mut().flat_map(|master| &mut master.polls);
                polls
                    .filter(|poll| poll.encoder == encoder.name)
                    .for_each(|poll| poll.encoder_has_ident(ident));
            }
        }
        Ok(())
    }

    /// What is done at the start, in this order.
    pub fn starts(&self) -> Vec<Request> {
        let reflections = self.segments.iter().filter(|segment| segment.reflections);
        let reflections = reflections.map(|segment| Request::Reflections {
            segment: Some(Which::Name(segment.name.clone())),
            on: true,
        });
        let of_encoders = self.encoders().flat_map(|encoder| {
            let named = |request| starts::for_encoder(request, &encoder.name);
            let leave = Request::Leave { encoder: Some(Which::Name(encoder.name.clone())) };
            encoder.starts.iter().map(named).chain((!encoder.joined).then_some(leave))
        });
        reflections.chain(of_encoders).collect()
    }

    /// All encoders, in the order in which they are numbered.
    pub fn encoders(&self) -> impl Iterator<Item = &EncoderPlan> {
        self.segments.iter().flat_map(|segment| &segment.encoders)
    }
}

impl PollPlan {
    /// The ident number of the encoder has become known.
    fn encoder_has_ident(&mut self, ident: u16) {
        // Octets 5 and 6 of Set_Prm.
        if let (true, Some(octets)) = (self.ident_of_encoder, self.set_prm.get_mut(4..6)) {
            octets.copy_from_slice(&ident.to_be_bytes());
        }
    }
}

/// A text of the file as it can be shown: nothing in it is taken for a command by a terminal.
fn shown(text: &str) -> String {
    text.chars()
        .map(|character| if character.is_control() && character != '\n' { ' ' } else { character })
        .collect()
}

/// The names that events and expectations can use.
#[derive(Debug)]
pub(crate) struct Names {
    pub(crate) encoders: Vec<String>,
    pub(crate) segments: Vec<String>,
    /// Encoders that a built-in master asks.
    pub(crate) polled: Vec<String>,
    /// Segments with a built-in master.
    pub(crate) mastered: Vec<String>,
}

impl Names {
    fn of(segments: &[SegmentPlan]) -> Self {
        let encoders = segments.iter().flat_map(|segment| &segment.encoders);
        let masters = segments.iter().filter_map(|segment| segment.master.as_ref());
        let mastered = segments.iter().filter(|segment| segment.master.is_some());
        Self {
            encoders: encoders.map(|encoder| encoder.name.clone()).collect(),
            segments: segments.iter().map(|segment| segment.name.clone()).collect(),
            polled: masters.flat_map(|master| &master.polls).map(|poll| poll.encoder.clone()).collect(),
            mastered: mastered.map(|segment| segment.name.clone()).collect(),
        }
    }
}
