//! `sch108bex run`: virtual encoders for your own master.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Sender};
use std::time::Duration;

use bus::{Link, PortAddress, Settings, open_for_slaves};
use clap::Args;
use plant::control::{ControlAddress, Server, Subscriptions};
use plant::{
    EncoderSetup, Handle, Plant, Rate, Report, Reporter, SegmentSetup, Shaft, Snapshot, Store, World,
};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::BitTimes;
use sch108bex::Identity;
use sch108bex::end_cap::{EffectiveAddress, RotarySwitches, TerminationSwitches, effective_address};
use sch108bex::health::Measurement;
use sch108bex::nonvolatile::{Choice, Slot};
use sch108bex::specification::{SerialNumber, Variant};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use web::Shown;

use crate::Failure;
use crate::arguments::{self, BatteryState, Baud, Further, Key, Light, TerminationState};
use crate::gsd::Offer;
use crate::http::Browser;
use crate::output;
use crate::recording::Capture;
use crate::samples;
use crate::search::Searches;
use crate::thinning::Thinning;

/// Put virtual encoders on a bus for your own master
///
/// Prints `bus: WHERE` and `ready` once the bus can be used, then what happens. Ctrl-C ends it; what
/// must be kept is written first. It goes on where nobody reads its standard output any more.
#[derive(Debug, Args)]
pub(crate) struct Run {
    /// A scenario file: its segments on their ports, and its events in real time; docs/scenarios.md has
    /// what stands in it. Beside it --control, --capture, --record and --http can be
    /// given
    #[arg(value_name = "FILE", conflicts_with_all = ["port", "link", "baud", "pace", "switches", "bits", "ident",
        "gsd", "serial", "state", "reset_state", "shaft", "supply", "temperature", "light", "battery",
        "termination", "reply_limit", "max_tsdr", "further"])]
    scenario: Option<PathBuf>,
    /// Where the bus is
    ///
    /// pty: a new pseudo terminal, which your master opens like a serial port.
    ///
    /// tcp-listen:ADDRESS:PORT: your master connects to this TCP port; port 0 takes one that is free. Only
    /// this computer reaches it at 127.0.0.1, which is meant where ADDRESS is left out; any other address is
    /// for others, and nothing protects it.
    ///
    /// tcp:ADDRESS:PORT: your master listens there; tried again until it does.
    ///
    /// unix:PATH: your master connects to this Unix socket.
    ///
    /// /dev/...: a serial device, such as an RS-485 adapter on a real bus; docs/serial.md says what it must
    /// be able to do.
    ///
    /// Pseudo terminals and sockets: one master at a time; while one is connected, others are refused.
    #[arg(long, default_value = "pty", value_name = "PORT")]
    port: PortAddress,
    /// Make a symbolic link to the pseudo terminal, and remove it at the end
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// The rate that the encoders listen at: auto takes the master's, which they have to search on a serial
    /// device
    #[arg(long, default_value = "auto", value_name = "auto|RATE", allow_hyphen_values = true)]
    baud: Baud,
    /// Take as long as a real bus of the rate would, min T_SDR included
    #[arg(long)]
    pace: bool,
    /// The rotary switches, X16 first: 01 to 7D decide the address, 7E lets a master set it
    #[arg(long, default_value = "7E", value_name = "HH", allow_hyphen_values = true)]
    switches: RotarySwitches,
    /// Singleturn and multiturn bits, up to 16x15
    #[arg(long, default_value = "16x15", value_name = "NxM", allow_hyphen_values = true)]
    bits: Variant,
    /// The ident number; the maker's is not public, 0x108B is a placeholder
    #[arg(long, conflicts_with = "gsd", value_parser = arguments::ident_number, value_name = "0xHHHH")]
    ident: Option<u16>,
    /// Take the ident number and the configurations from your own GSD file of this device
    #[arg(long, value_name = "FILE")]
    gsd: Option<PathBuf>,
    /// The serial number, 6 or 7 digits
    #[arg(long, default_value = "1234567", value_name = "DIGITS", allow_hyphen_values = true)]
    serial: SerialNumber,
    /// Keep the non-volatile memory in this file; without it the encoder is as delivered
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Start as delivered; a state file that is there is kept with .bad at its end
    #[arg(long, requires = "state")]
    reset_state: bool,
    /// What turns the shaft: `still@RAW`, `constant:RPM[@RAW]` (RAW in physical counts, RPM positive
    /// clockwise) or another kind with its values, such as `ramp:to_rpm=60:over_s=10` (see docs/shafts.md)
    #[arg(long, default_value = "still@0", value_name = "SHAFT", allow_hyphen_values = true)]
    shaft: Shaft,
    /// Supply voltage; below 6 V and with reversed poles the encoder is off
    #[arg(long, default_value = "24", value_parser = arguments::supply_mv, value_name = "V", allow_negative_numbers = true)]
    supply: i32,
    /// Temperature inside in degrees Celsius
    #[arg(long, default_value = "20", value_parser = arguments::temperature_tenths, value_name = "C", allow_negative_numbers = true)]
    temperature: i16,
    /// The light of the LED
    #[arg(long, default_value = "ok")]
    light: Light,
    /// The battery that keeps the turn count
    #[arg(long, default_value = "ok")]
    battery: BatteryState,
    /// The termination switches; the bus is the master, then the encoders in their order
    #[arg(long, default_value = "auto")]
    termination: TerminationState,
    /// Take requests here: see `sch108bex ctl` and docs/control.md
    ///
    /// PATH: a Unix socket, for you alone.
    ///
    /// tcp:127.0.0.1:PORT: a TCP port of this computer, for every user of it; port 0 takes one that is free.
    #[arg(long, value_parser = arguments::control_address(), value_name = "PATH|tcp:127.0.0.1:PORT")]
    control: Option<ControlAddress>,
    #[command(flatten)]
    capture: Capture,
    #[command(flatten)]
    record: samples::Options,
    /// A reply that would start later than this is not sent
    #[arg(long, default_value_t = 10, value_parser = arguments::whole::<u64>(1..=60_000), value_name = "MS", allow_negative_numbers = true)]
    reply_limit: u64,
    /// On a serial device: replies that start later than this after their request are counted and reported;
    /// max T_SDR of the rate if left out. They are sent all the same
    #[arg(long, value_parser = arguments::whole::<u32>(1..=1_000_000), value_name = "BITS", allow_negative_numbers = true)]
    max_tsdr: Option<u32>,
    /// A further encoder on the same bus: KEY=VALUE pairs with commas between (switches, bits,
    /// serial, state, shaft, termination); what is not named is as with the first, but a state file is never shared. May be given many times
    #[arg(long = "encoder", value_name = "KEY=VALUE,...")]
    further: Vec<Further>,
    #[command(flatten)]
    http: Browser,
}

/// What the main thread waits for.
pub(crate) enum Wake {
    Report(Report),
    End,
}

impl Run {
    /// Runs until it is told to end.
    pub(crate) fn run(&self) -> Result<(), Failure> {
        if let Some(file) = &self.scenario {
            return crate::scenario::live::run(
                file,
                self.control.as_ref(),
                &self.capture,
                &self.record,
                &self.http,
            );
        }
        self.check_port()?;
        let (to_main, wakes) = mpsc::channel();
        let subscriptions = Subscriptions::new();
        let reports = forward_reports(&to_main, subscriptions.clone());
        let offer = Offer::new(self.ident, self.gsd.as_deref(), self.bits)?;
        let encoders = self.encoders(&offer, &reports)?;
        let notes: Vec<String> = encoders.iter().flat_map(|(_, notes)| notes.clone()).collect();
        let end = open_for_slaves(&self.port, self.baud_of_device()).map_err(failed)?;
        let bus = end.name().to_owned();
        let link = self.link.as_deref().map(|link| Link::create(link, Path::new(&bus))).transpose();
        let _link = link.map_err(failed)?;
        let mut plant = Plant::new();
        let segment = SegmentSetup {
            name: "bus".to_owned(),
            end,
            settings: Settings {
                pace: self.pace,
                reply_limit: profibus_dp::time::Duration::from_millis(self.reply_limit),
                max_tsdr: self.max_tsdr.map(BitTimes),
            },
            encoders: encoders.into_iter().map(|(setup, _)| setup).collect(),
        };
        end_on_signals(&to_main)?;
        plant.add(segment, reports).map_err(failed)?;
        for note in &offer.notes {
            output::aside(&format!("note: {note}"));
        }
        let captures = self.capture.start(&plant.handle(), &[("bus", &bus)], false)?;
        output::line(&format!("bus: {bus}"));
        let shared = shared_addresses(&plant.snapshots().map_err(failed)?);
        for note in notes.into_iter().chain(shared) {
            output::line(&note);
        }
        let recording = self.record.start_with(&plant, &subscriptions)?;
        plant.start_shafts().map_err(failed)?;
        let end = end_of(&to_main);
        let control = serve_control(self.control.as_ref(), plant.handle(), subscriptions.clone(), end)?;
        tell_address(control.as_ref());
        let shown = Shown::Plant {
            kind: web::Kind::Run,
            title: "Encoders for your master".to_owned(),
            handle: plant.handle(),
            subscriptions,
        };
        let http = self.http.serve(shown, end_of(&to_main))?;
        output::line("ready");
        drop(to_main);
        tell_until_end(&wakes);
        drop(http);
        drop(control);
        samples::stop(plant, recording).and(captures.end())
    }

    /// What does not go together with this --port.
    fn check_port(&self) -> Result<(), Failure> {
        let device = matches!(self.port, PortAddress::Device(_));
        let wrong = if self.link.is_some() && self.port != PortAddress::Pty {
            "--link names a pseudo terminal, and this --port is none; leave --link out"
        } else if device && self.pace {
            "--pace is for buses without a time of their own, and a serial device has its own; leave --pace out"
        } else if !device && self.max_tsdr.is_some() {
            "--max-tsdr is for a serial device, and this --port is none; leave --max-tsdr out"
        } else {
            return Ok(());
        };
        Err(Failure::Usage(wrong.to_owned()))
    }

    /// How a serial device is to listen.
    fn baud_of_device(&self) -> BaudSetting {
        match self.baud {
            Baud::Auto => BaudSetting::Search(bus::segment::DEFAULT_RATE),
            Baud::Fixed(rate) => BaudSetting::Fixed(rate),
        }
    }

    /// The encoders, each with what is worth saying about its address.
    fn encoders(
        &self,
        offer: &Offer,
        reports: &Sender<Report>,
    ) -> Result<Vec<(EncoderSetup, Vec<String>)>, Failure> {
        // All of the command line first: a wrong one leaves every state file as it is.
        for own in &self.further {
            self.who_and_where(own, offer)?;
        }
        let mut encoders = vec![self.encoder("encoder", &Further::default(), offer, reports)?];
        for (number, further) in (2..).zip(&self.further) {
            encoders.push(self.encoder(&format!("encoder {number}"), further, offer, reports)?);
        }
        let own = self.further.iter().map(|further| further.parsed(Key::Termination));
        let own: Vec<_> =
            std::iter::once(Ok(None)).chain(own).collect::<Result<_, _>>().map_err(Failure::Usage)?;
        let last = encoders.len() - 1;
        for (at, ((setup, _), own)) in encoders.iter_mut().zip(own).enumerate() {
            setup.termination = own.unwrap_or(self.termination).switches(at == last);
        }
        Ok(encoders)
    }

    fn encoder(
        &self,
        name: &str,
        own: &Further,
        offer: &Offer,
        reports: &Sender<Report>,
    ) -> Result<(EncoderSetup, Vec<String>), Failure> {
        let (identity, shaft) = self.who_and_where(own, offer)?;
        let first = own.pairs.is_empty();
        let state = if first { self.state.clone() } else { own.path(Key::State) };
        let mut store = open_store(state.as_deref(), identity.variant, self.reset_state)?;
        let stored = store.load().map_err(failed)?;
        let world = World(Measurement {
            supply_mv: self.supply,
            temperature_tenths: self.temperature,
            light_ok: self.light == Light::Ok,
            battery: self.battery.into(),
        });
        let notes = [note_on_state(name, &stored), note_on_address(name, &identity, &stored, world)];
        let rate = match (self.baud, &self.port) {
            (Baud::Auto, PortAddress::Device(_)) => Rate::Search(bus::segment::DEFAULT_RATE),
            (Baud::Auto, _) => Rate::OfTheEnd,
            (Baud::Fixed(rate), _) => Rate::Fixed(rate),
        };
        let reporter = Reporter::new(name, Some(reports.clone()));
        Ok((
            EncoderSetup {
                identity,
                configurations: offer.configurations,
                rate,
                termination: TerminationSwitches::default(),
                shaft,
                world,
                store,
                reporter,
            },
            notes.into_iter().flatten().collect(),
        ))
    }

    /// What the command line alone says of an encoder.
    fn who_and_where(&self, own: &Further, offer: &Offer) -> Result<(Identity, Shaft), Failure> {
        let identity = Identity {
            variant: own.parsed(Key::Bits).map_err(Failure::Usage)?.unwrap_or(self.bits),
            ident_number: offer.ident_number,
            serial_number: own.parsed(Key::Serial).map_err(Failure::Usage)?.unwrap_or(self.serial),
            switches: own.parsed(Key::Switches).map_err(Failure::Usage)?.unwrap_or(self.switches),
        };
        let shaft = own.parsed(Key::Shaft).map_err(Failure::Usage)?.unwrap_or_else(|| self.shaft.clone());
        let option = if own.pairs.is_empty() { "--shaft" } else { "--encoder: shaft" };
        shaft.check(identity.variant).map_err(|error| Failure::Usage(format!("{option}: {error}")))?;
        if own.get(Key::State) == Some("") {
            return Err(Failure::Usage("--encoder: state=: write the path of a file".to_owned()));
        }
        own.parsed::<TerminationState>(Key::Termination).map_err(Failure::Usage)?;
        Ok((identity, shaft))
    }
}

/// What ends the program in order.
pub(crate) fn end_of(to_main: &Sender<Wake>) -> impl Fn() + Send + Sync + 'static {
    let to_main = to_main.clone();
    move || {
        let _ = to_main.send(Wake::End);
    }
}

/// Somebody who takes requests, where one is asked for.
pub(crate) fn serve_control(
    address: Option<&ControlAddress>,
    handle: Handle,
    subscriptions: Subscriptions,
    on_shutdown: impl Fn() + Send + Sync + 'static,
) -> Result<Option<Server>, Failure> {
    let server = address.map(|address| Server::start(address, handle, subscriptions, on_shutdown));
    server.transpose().map_err(|error| Failure::Failed(format!("--control: {error}")))
}

/// Prints where requests are taken.
pub(crate) fn tell_address(control: Option<&Server>) {
    if let Some(control) = control {
        output::line(&format!("control: {}", control.address()));
    }
}

fn open_store(path: Option<&Path>, variant: Variant, reset: bool) -> Result<Store, Failure> {
    match path {
        None => Ok(Store::forgetful()),
        Some(path) => Store::open(path, variant, reset).map_err(failed),
    }
}

/// A damaged slot that the other one stood in for.
pub(crate) fn note_on_state(name: &str, stored: &Choice) -> Option<String> {
    let Choice::Use { other_damaged: Some(fault), slot, .. } = stored else {
        return None;
    };
    let damaged = if slot.other() == Slot::A { 'A' } else { 'B' };
    Some(format!(
        "warning: {name}: slot {damaged} of the state file is damaged ({fault}); the other slot is used"
    ))
}

/// Why an encoder cannot be reached, where it cannot.
pub(crate) fn note_on_address(
    name: &str,
    identity: &Identity,
    stored: &Choice,
    world: World,
) -> Option<String> {
    if !world.is_powered() {
        return Some(format!("{name}: off, {} V are too little to run", f64::from(world.0.supply_mv) / 1e3));
    }
    let stored = match stored {
        Choice::Use { record, .. } => record.stored_address,
        _ => None,
    };
    match effective_address(identity.switches, stored) {
        EffectiveAddress::OffBus => Some(format!(
            "{name}: off the bus, the switches are at {} but only 01 to 7E hold an address (manual 3.4)",
            identity.switches
        )),
        _ => None,
    }
}

/// Reports come to the main thread by the same way as the signals.
pub(crate) fn forward_reports(to_main: &Sender<Wake>, subscriptions: Subscriptions) -> Sender<Report> {
    let (reports, from) = mpsc::channel();
    let to_main = to_main.clone();
    std::thread::spawn(move || {
        for report in from {
            subscriptions.publish(&report);
            if to_main.send(Wake::Report(report)).is_err() {
                return;
            }
        }
        // Every segment has ended by itself.
        let _ = to_main.send(Wake::End);
    });
    reports
}

pub(crate) fn end_on_signals(to_main: &Sender<Wake>) -> Result<(), Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
    let to_main = to_main.clone();
    std::thread::spawn(move || {
        signals.forever().next();
        let _ = to_main.send(Wake::End);
    });
    Ok(())
}

/// Prints what happens; what happens again and again is thinned out.
pub(crate) fn tell_until_end(wakes: &mpsc::Receiver<Wake>) {
    const QUIET: Duration = Duration::from_secs(1);
    let mut thinning = Thinning::default();
    let mut searches = Searches::default();
    let tell_held = |thinning: &mut Thinning| {
        for (text, times) in thinning.take_held() {
            output::line(&format!("             {text} ({times} times more)"));
        }
    };
    loop {
        match wakes.recv_timeout(QUIET) {
            Ok(Wake::Report(report)) if !searches.is_news(&report) => {}
            Ok(Wake::Report(Report { at, who, what })) => {
                let text = format!("{who}: {what}");
                let Some(held) = thinning.admit(&text, std::time::Instant::now()) else {
                    continue;
                };
                let more = if held > 0 { format!(" (and {held} times before)") } else { String::new() };
                #[expect(clippy::cast_precision_loss, reason = "for reading only")]
                let seconds = at.as_nanos() as f64 / 1e9;
                output::line(&format!("{seconds:11.6}  {text}{more}"));
            }
            Err(mpsc::RecvTimeoutError::Timeout) => tell_held(&mut thinning),
            Ok(Wake::End) | Err(mpsc::RecvTimeoutError::Disconnected) => {
                tell_held(&mut thinning);
                return;
            }
        }
    }
}

/// Encoders that answer to the same address: their replies collide.
pub(crate) fn shared_addresses(encoders: &[Snapshot]) -> Vec<String> {
    let address = |encoder: &Snapshot| encoder.device.and_then(|device| device.address);
    let mut notes = Vec::new();
    for (at, one) in encoders.iter().enumerate() {
        let mut others = encoders.iter().skip(at + 1);
        if let Some(other) = others.find(|other| address(one).is_some() && address(one) == address(other)) {
            let address = address(one).unwrap_or_default();
            notes.push(format!(
                "warning: {} and {} both have address {address}: their replies will collide",
                one.name, other.name
            ));
        }
    }
    notes
}

pub(crate) fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Failed(error.to_string())
}
