//! `sch108bex demo`: the main job in one go, on a virtual bus whose time runs along with yours.

mod screen;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};

use bus::VirtualSegment;
use clap::Args;
use master::{Error, LightMaster, Settings};
use plant::{EncoderSetup, EncoderStation, Rate, Report, Reporter, Shaft, Store, What, World};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::StandardDiagnosis;
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::diagnostics::{Alarms, Diagnostics, Warnings};
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::event::Event;
use sch108bex::health::Measurement;
use sch108bex::parameterization::{ParameterLength, Parameters, TimeBase};
use sch108bex::specification::{LATCH_PERIOD, PLACEHOLDER_IDENT, SerialNumber, Variant};
use signal_hook::consts::{SIGINT, SIGTERM};
use web::Shown;

use crate::http::Browser;
use crate::run::{end_of, end_on_signals, tell_until_end};
use crate::{Failure, output};
use screen::{FRAME_MILLIS, Facts, Screen};

const RATE: Baudrate = Baudrate::B1500000;
/// The master's address.
const MASTER: u8 = 2;
/// The encoder's address as delivered, and the one that it gets.
const DELIVERED: u8 = 126;
const ADDRESS: u8 = 5;
/// 4096 steps a turn, over all 32768 turns.
const STEPS: u32 = 4096;
/// Physical counts for one step.
const COUNTS_PER_STEP: i64 = 65_536 / STEPS as i64;
/// Output bit 31 (manual 4.3.2).
const PRESET: u32 = 0x8000_0000;
const PRESET_TO: u32 = 1_000_000;
const RPM: f64 = 300.0;
/// 300 RPM are 20.48 steps in a millisecond: an answer is one latch of 500 us and one exchange behind at most.
const MOST_BEHIND: i64 = 20;

/// How long it takes, and how it looks.
#[derive(Debug, Args)]
pub(crate) struct Options {
    /// How long the shaft is watched, in seconds from 0.1 to 86400
    #[arg(long, value_name = "N", default_value = "12", value_parser = seconds)]
    seconds: f64,
    /// Print plain lines on a terminal too
    #[arg(long)]
    plain: bool,
    #[command(flatten)]
    http: Browser,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "write seconds between 0.1 and 86400, like 12".to_owned())
}

/// Shows it, and fails where something is not as claimed.
pub(crate) fn demo(options: &Options) -> Result<(), Failure> {
    if options.http.is_wanted() {
        return stay(&options.http);
    }
    let (encoder, reports) = encoder()?;
    let mut segment = VirtualSegment::new(Instant::ZERO, RATE);
    segment.add(encoder);
    let mut demo = Demo {
        master: LightMaster::new(segment, Settings::default()),
        reports,
        screen: Screen::new(options.plain),
        facts: Facts::default(),
        offset: 0,
        interrupted: interrupted()?,
        hurried: false,
    };
    demo.screen.line(
        "A virtual SCH108BEX as delivered (switches 7E, nothing stored) on a virtual bus at 1.5 Mbit/s,",
    );
    demo.screen.line("and a master with address 2. `sch108bex run` gives your own master such an encoder.");
    demo.give_address()?;
    demo.refused_parameters()?;
    demo.start_up()?;
    let seconds = options.seconds;
    demo.turn(0.4 * seconds)?;
    demo.preset(0.15 * seconds)?;
    demo.warning(0.15 * seconds)?;
    demo.turn_back(0.3 * seconds)?;
    demo.sum_up();
    Ok(())
}

/// The demonstration on a page, where it goes on until it is told to end.
fn stay(http: &Browser) -> Result<(), Failure> {
    let (to_main, wakes) = mpsc::channel();
    end_on_signals(&to_main)?;
    let server = http.serve(Shown::Demonstration, end_of(&to_main))?;
    output::line("ready");
    drop(to_main);
    tell_until_end(&wakes);
    drop(server);
    Ok(())
}

/// Set when somebody presses Ctrl-C: the demonstration then goes through its steps without watching.
fn interrupted() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&flag))
            .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
    }
    Ok(flag)
}

struct Demo {
    master: LightMaster<VirtualSegment<EncoderStation>>,
    reports: Receiver<Report>,
    screen: Screen,
    facts: Facts,
    /// The offset value that the encoder told with its preset.
    offset: i64,
    interrupted: Arc<AtomicBool>,
    hurried: bool,
}

fn encoder() -> Result<(EncoderStation, Receiver<Report>), Failure> {
    let (to, reports) = mpsc::channel();
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: "1234567"
                .parse::<SerialNumber>()
                .map_err(|error| Failure::Failed(error.to_string()))?,
            switches: RotarySwitches(126),
        },
        configurations: Configurations::default(),
        rate: Rate::Fixed(RATE),
        termination: TerminationSwitches { first: true, second: true },
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", Some(to)),
    };
    let station =
        EncoderStation::new(Instant::ZERO, setup).map_err(|error| Failure::Failed(error.to_string()))?;
    Ok((station, reports))
}

/// A Set_Prm for Scancon 2.0: watchdog 200 ms, scaling on, steps per 100 ms.
fn parameters(units_per_revolution: u32) -> Vec<u8> {
    let parameters = Parameters {
        length: ParameterLength::TwentySix,
        scaling: true,
        measuring_units_per_revolution: units_per_revolution,
        total_measuring_range: STEPS * Variant::FULL.revolutions(),
        time_base: TimeBase::Per100Ms,
        ..Parameters::default_for(Variant::FULL)
    };
    let mut octets = [0; 26];
    let length = parameters.emit(&mut octets);
    let [ident_high, ident_low] = PLACEHOLDER_IDENT.to_be_bytes();
    octets[..8].copy_from_slice(&[0x88, 1, 20, 11, ident_high, ident_low, 0, 0]);
    octets[..length].to_vec()
}

impl Demo {
    fn give_address(&mut self) -> Result<(), Failure> {
        self.screen.heading("The master looks for stations and finds one at 126; it gives it address 5.");
        expect(self.found()? == [DELIVERED], "one station, at 126")?;
        self.master.set_address(DELIVERED, ADDRESS, PLACEHOLDER_IDENT, false).map_err(failed)?;
        expect(self.found()? == [ADDRESS], "one station, at 5")?;
        self.tell_events();
        Ok(())
    }

    fn refused_parameters(&mut self) -> Result<(), Failure> {
        self.screen.heading(
            "It asks for 70000 units per revolution, more than the disc has. The encoder says why not:",
        );
        self.master.set_prm(ADDRESS, &parameters(70_000)).map_err(failed)?;
        let (standard, _) = self.diagnosis()?;
        expect(standard.prm_fault, "Prm_Fault")?;
        let refused = self.tell_events();
        expect(refused.iter().any(|event| matches!(event, Event::PrmRefused(_))), "a refusal with its reason")
    }

    fn start_up(&mut self) -> Result<(), Failure> {
        self.screen.heading("Set_Prm with 4096 units per revolution, then Chk_Cfg F1 D1 D1: Scancon 2.0.");
        self.master.set_prm(ADDRESS, &parameters(STEPS)).map_err(failed)?;
        self.master.chk_cfg(ADDRESS, &[0xF1, 0xD1, 0xD1]).map_err(failed)?;
        let (standard, extended) = self.diagnosis()?;
        expect(!standard.station_not_ready && standard.master_add == Some(MASTER), "data exchange")?;
        let part = extended.class_2_part.ok_or_else(|| missing("the long diagnosis"))?;
        self.tell_events();
        self.screen.line(&format!(
            "  diagnosis: {} steps x {} turns on the disc, {} of {} units in force, serial number {}",
            extended.singleturn_resolution,
            extended.revolutions,
            part.measuring_units_per_revolution,
            part.total_measuring_range,
            String::from_utf8_lossy(&part.serial_number).trim_end()
        ));
        Ok(())
    }

    fn turn(&mut self, seconds: f64) -> Result<(), Failure> {
        self.screen.heading("The shaft turns clockwise at 300 RPM: 20480 units a second, 2048 in 100 ms.");
        self.set_speed(RPM);
        // The first window of velocity needs 100 ms, and acceleration two of them.
        self.exchange_for(Duration::from_millis(300))?;
        self.watch(seconds, |_, _| ())?;
        expect(
            (2047..=2049).contains(&self.facts.velocity) && self.facts.acceleration.abs() <= 1,
            "a steady velocity of 2048",
        )
    }

    fn preset(&mut self, seconds: f64) -> Result<(), Failure> {
        self.screen.heading("Bit 31 of the outputs rises with the value 1000000: a preset while it turns.");
        self.exchange(PRESET + PRESET_TO)?;
        let offset = self.tell_events().iter().find_map(|event| match event {
            Event::PresetTaken { offset, .. } => Some(*offset),
            _ => None,
        });
        self.offset = offset.ok_or_else(|| missing("a preset"))?.into();
        // It counts from the next latch on.
        self.master.line_mut().wait(LATCH_PERIOD);
        self.exchange_for(Duration::from_micros(500))?;
        let Facts { position, velocity, .. } = self.facts;
        self.screen
            .line(&format!("  position {position} a millisecond later, velocity {velocity} as before"));
        expect((PRESET_TO..PRESET_TO + 100).contains(&position), "a position behind 1000000")?;
        expect((2047..=2049).contains(&velocity), "a velocity without a jump")?;
        self.watch(seconds, |_, _| ())
    }

    fn warning(&mut self, seconds: f64) -> Result<(), Failure> {
        self.screen.heading(
            "It gets 70 degrees warm. The next answer has high priority, and the master fetches the diagnosis.",
        );
        let now = self.now();
        let world = World(Measurement { temperature_tenths: 700, ..World::default().0 });
        let warmed = self.master.line_mut().stations_mut()[0].set_world(now, world);
        warmed.map_err(|error| Failure::Failed(error.to_string()))?;
        self.tell_events();
        expect(self.exchange(0)?, "an answer of high priority")?;
        let (standard, extended) = self.diagnosis()?;
        let warnings = extended.class_2_part.map(|part| part.warnings).unwrap_or_default();
        self.screen.line(&format!(
            "  diagnosis: alarms {}, warnings {warnings}; Ext_Diag {}, Stat_Diag {}",
            extended.alarms,
            u8::from(standard.ext_diag),
            u8::from(standard.stat_diag)
        ));
        self.screen.line("  A warning stops nothing: the position is good, and the exchange goes on.");
        expect(warnings == Warnings::TEMPERATURE_EXCEEDED && standard.ext_diag, "the temperature warning")?;
        expect(!self.exchange(0)?, "low priority after the diagnosis was fetched")?;
        self.watch(seconds, |_, _| ())
    }

    fn turn_back(&mut self, seconds: f64) -> Result<(), Failure> {
        self.screen.heading("The shaft slows down, stops, and turns back.");
        let mut slowest = 0;
        self.watch(seconds, |demo, share| {
            demo.set_speed(RPM * (1.0 - 2.0 * share));
            slowest = slowest.min(demo.facts.acceleration);
        })?;
        self.exchange_for(Duration::from_millis(300))?;
        self.screen.keep(&self.facts);
        expect(slowest < 0, "a negative acceleration while it slows down")?;
        expect((-2049..=-2047).contains(&self.facts.velocity), "a velocity of -2048 in the end")
    }

    fn sum_up(&mut self) {
        let Facts { exchanges, cycle_us, retries, .. } = self.facts;
        self.screen.heading(&format!(
            "{exchanges} exchanges, one in {cycle_us} us, {retries} retries; no position more than a latch and an exchange \
             behind."
        ));
        self.screen.line("All as it should be.");
    }

    /// Exchanges data for so long, in step with the time of who watches, and shows it.
    ///
    /// `drive` is called before every frame with how much of the time is over, from 0 to 1.
    fn watch(&mut self, seconds: f64, mut drive: impl FnMut(&mut Self, f64)) -> Result<(), Failure> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 86400 s")]
        let frames = ((seconds * 1e3) as u64).div_ceil(FRAME_MILLIS).max(2);
        let begun = std::time::Instant::now();
        for frame in 1..=frames {
            #[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
            drive(self, frame as f64 / frames as f64);
            self.exchange_for(Duration::from_millis(FRAME_MILLIS))?;
            self.tell_events();
            if self.interrupted.load(Ordering::Relaxed) {
                self.hurry();
                continue;
            }
            let (request, answer) = self.master.last_exchange();
            self.facts.request = request.to_vec();
            self.facts.answer = answer.to_vec();
            self.screen.show(&self.facts);
            let due = begun + std::time::Duration::from_millis(frame * FRAME_MILLIS);
            std::thread::sleep(due.saturating_duration_since(std::time::Instant::now()));
        }
        self.screen.keep(&self.facts);
        Ok(())
    }

    /// Says once that nobody waits any more.
    fn hurry(&mut self) {
        if !std::mem::replace(&mut self.hurried, true) {
            self.screen.line("  (interrupted: the rest goes by without waiting)");
        }
    }

    /// Exchanges data without a pause for a span of bus time, and checks each position.
    fn exchange_for(&mut self, span: Duration) -> Result<(), Failure> {
        let until = self.now() + span;
        while self.now() < until {
            let begun = self.now();
            self.exchange(0)?;
            self.facts.exchanges += 1;
            self.facts.cycle_us = self.now().since(begun).as_nanos() / 1_000;
            self.check_position()?;
        }
        Ok(())
    }

    /// Outputs for inputs; whether the answer was high priority.
    fn exchange(&mut self, outputs: u32) -> Result<bool, Failure> {
        let inputs = self.master.exchange(ADDRESS, &outputs.to_be_bytes()).map_err(failed)?;
        let word = |at: usize| inputs.octets.get(at..at + 4).and_then(|octets| octets.first_chunk().copied());
        let (Some(position), Some(velocity), Some(acceleration)) = (word(0), word(4), word(8)) else {
            return Err(missing("12 input octets"));
        };
        let high_priority = inputs.high_priority;
        self.facts.position = u32::from_be_bytes(position);
        self.facts.velocity = i32::from_be_bytes(velocity);
        self.facts.acceleration = i32::from_be_bytes(acceleration);
        self.facts.retries = self.master.counters().retries;
        Ok(high_priority)
    }

    /// Fails if the position is not that of the shaft.
    fn check_position(&mut self) -> Result<(), Failure> {
        let counts = self.counts();
        self.facts.turn_thousandths =
            u32::try_from(counts.rem_euclid(65_536) * 1_000 / 65_536).unwrap_or_default();
        let range = i64::from(STEPS * Variant::FULL.revolutions());
        let due = counts.div_euclid(COUNTS_PER_STEP) + self.offset;
        let behind = (due - i64::from(self.facts.position)).rem_euclid(range);
        let behind = if behind > range / 2 { range - behind } else { behind };
        expect(behind <= MOST_BEHIND, "the position of the shaft")
    }

    /// Another speed, from now on and from where the shaft is.
    fn set_speed(&mut self, rpm: f64) {
        let (now, counts) = (self.now(), self.counts());
        self.master.line_mut().stations_mut()[0].set_shaft(now, Shaft::constant(rpm, counts, now));
    }

    /// Where the shaft is, in physical counts.
    fn counts(&mut self) -> i64 {
        let now = self.now();
        self.master.line_mut().stations_mut()[0].snapshot(now).shaft.at(now, Variant::FULL)
    }

    fn now(&mut self) -> Instant {
        self.master.now()
    }

    fn diagnosis(&mut self) -> Result<(StandardDiagnosis, Diagnostics), Failure> {
        let diagnosis = self.master.diagnosis(ADDRESS).map_err(failed)?;
        let extended = Diagnostics::parse(diagnosis.extended());
        let standard = diagnosis.standard;
        let extended = extended.ok_or_else(|| missing("a diagnosis that can be read"))?;
        self.facts.diagnosis = in_words(&extended);
        Ok((standard, extended))
    }

    /// The addresses at which somebody answers.
    fn found(&mut self) -> Result<Vec<u8>, Failure> {
        let stations = self.master.live_list().map_err(failed)?;
        Ok(stations.into_iter().map(|(address, _)| address).collect())
    }

    /// Prints what the encoder has told since the last time.
    fn tell_events(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        for Report { what, .. } in self.reports.try_iter() {
            self.screen.line(&format!("  encoder: {what}"));
            if let What::Device(event) = what {
                events.push(event);
            }
        }
        events
    }
}

/// Alarms and warnings, or that there are none.
fn in_words(diagnosis: &Diagnostics) -> String {
    let warnings = diagnosis.class_2_part.map(|part| part.warnings).unwrap_or_default();
    match (diagnosis.alarms == Alarms::empty(), warnings == Warnings::empty()) {
        (true, true) => "no alarm, no warning".to_owned(),
        (true, false) => format!("no alarm; warning: {warnings}"),
        (false, true) => format!("ALARM: {}", diagnosis.alarms),
        (false, false) => format!("ALARM: {}; warning: {warnings}", diagnosis.alarms),
    }
}

fn expect(holds: bool, what: &str) -> Result<(), Failure> {
    if holds { Ok(()) } else { Err(missing(what)) }
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn failed(error: Error) -> Failure {
    Failure::Failed(format!("the demonstration went wrong: {error}"))
}

fn missing(what: &str) -> Failure {
    Failure::Failed(format!("the demonstration went wrong: {what} was due, but did not come"))
}
