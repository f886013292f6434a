//! `conformance`: checks a DP-V0 slave on any port, case by case.

mod device;
mod progress;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration as Time, SystemTime};

use bus::port::PortAddress;
use clap::{Args, ValueEnum};
use conformance::report::{self, Run, Tally};
use conformance::{
    Case, CaseResult, ControlSocket, Device, Expect, Options, Outcome, PortRig, Profile, Rig, RigError,
    Runner, Signal,
};
use profibus_dp::time::{Baudrate, Duration};

use crate::arguments::{ident_number, whole};
use crate::commission::place::open_end;
use crate::{Failure, output};
use device::{described, facts};
use progress::Progress;

/// How long nobody may be behind a port before that is an error.
const COMING: Duration = Duration::from_secs(5);

/// Check a DP-V0 slave on any port, case by case: an encoder, a device of yours, a real one
///
/// Every case begins by itself and leaves the slave without a master. Cases that need control of the device or
/// exact times are left out where there is none, with the reason. No other master may be on the bus.
#[derive(Debug, Args)]
pub(crate) struct Conformance {
    /// Where the slave is: /dev/pts/N, /dev/ttyUSB0, tcp:ADDRESS:PORT, unix:PATH or tcp-listen:ADDRESS:PORT
    #[arg(long, value_name = "PORT", required_unless_present = "list")]
    port: Option<PortAddress>,
    /// The slave's station address
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole::<u8>(0..=125), allow_negative_numbers = true)]
    address: u8,
    /// The rate of the bus, where the port has one
    #[arg(long, value_name = "RATE", default_value = "500000", value_parser = rate)]
    baud: Baudrate,
    /// The slave's ident number; left out, it is read from the diagnosis
    #[arg(long, value_name = "0xHHHH", value_parser = ident_number)]
    ident: Option<u16>,
    /// The slave's GSD: ident number, parameters, configurations and abilities; left out, those of the encoder
    #[arg(long, value_name = "FILE")]
    gsd: Option<PathBuf>,
    /// Which cases
    #[arg(long, value_enum, default_value_t = Which::All)]
    profile: Which,
    /// Only these cases, by their numbers
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',')]
    case: Vec<String>,
    /// Cases that take long as well
    #[arg(long)]
    long: bool,
    /// The control socket of the `sch108bex run --control PATH` that is tested
    #[arg(long, value_name = "PATH")]
    control: Option<PathBuf>,
    /// The encoder that is tested, by name or by number from 1, where the control socket has several
    #[arg(long, value_name = "NAME", requires = "control")]
    encoder: Option<String>,
    /// The slave hears how long the line is idle, though the port is a socket or a pseudo terminal: an emulated
    /// board, a serial server
    #[arg(long)]
    hears_idle: bool,
    /// How long a reply may take at most, in milliseconds
    #[arg(long, alias = "patience", value_name = "MS", default_value_t = 1_000, value_parser = whole::<u64>(1..=60_000), allow_negative_numbers = true)]
    reply_within: u64,
    /// Requests with low priority, wherever a case does not say otherwise
    #[arg(long)]
    srd_low: bool,
    /// Accept no alternative that only a disputed point allows
    #[arg(long)]
    strict: bool,
    /// One line for each case that passes
    #[arg(long)]
    brief: bool,
    /// The results, or the table of --list, as one JSON document on standard output
    #[arg(long)]
    json: bool,
    /// The results as JUnit XML, for build servers
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// The results as one HTML file
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print the table of the cases, and try none
    #[arg(long)]
    list: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    /// Those of any DP-V0 slave
    DpV0,
    /// Those of the encoder
    Encoder,
    /// All
    All,
}

/// One of the ten rates.
fn rate(text: &str) -> Result<Baudrate, String> {
    text.parse().ok().and_then(Baudrate::from_bits_per_second).ok_or_else(|| {
        let rates: Vec<_> = Baudrate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
        format!("PROFIBUS has these rates: {}", rates.join(", "))
    })
}

impl Conformance {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let cases = self.chosen()?;
        if self.list {
            output::line(&if self.json { report::list_json(&cases) } else { report::list(&cases) });
            return Ok(());
        }
        let Some(port) = &self.port else {
            return Err(Failure::Usage("name the port with --port".to_owned()));
        };
        let mut device = described(self.address, self.ident, self.gsd.as_deref())?;
        let mut rig = self.open(port)?;
        self.meet(&mut device, &mut rig)?;
        let (results, broken) = self.play(&cases, &device, &mut rig)?;
        let run = Run {
            program: format!("sch108bex {}", env!("CARGO_PKG_VERSION")),
            port: port.to_string(),
            address: self.address,
            ident: device.ident.unwrap_or(0),
            when: progress::utc(SystemTime::now()),
        };
        self.report(&run, &results)?;
        if let Some(error) = broken {
            return Err(Failure::Failed(format!("after {} cases: {error}", results.len())));
        }
        verdict(&results)
    }

    /// The cases that were asked for.
    fn chosen(&self) -> Result<Vec<Case>, Failure> {
        let all = conformance::cases();
        if let Some(unknown) = self.case.iter().find(|id| !all.iter().any(|case| case.id == **id)) {
            return Err(Failure::Usage(format!(
                "there is no case {unknown}; `sch108bex conformance --list` has them all"
            )));
        }
        let wanted = |case: &&Case| match self.profile {
            Which::DpV0 => case.profile == Profile::DpV0,
            Which::Encoder => case.profile == Profile::Encoder,
            Which::All => true,
        };
        let named = |case: &&Case| self.case.is_empty() || self.case.contains(&case.id);
        let chosen: Vec<_> = all.iter().filter(wanted).filter(named).cloned().collect();
        if chosen.is_empty() {
            return Err(Failure::Usage(
                "none of these cases is in this profile; leave --profile out".to_owned(),
            ));
        }
        Ok(chosen)
    }

    fn open(&self, port: &PortAddress) -> Result<PortRig, Failure> {
        let end = open_end(port, self.baud, COMING)?;
        let rig = PortRig::new(end, self.baud, is_stream(port) && !self.hears_idle)
            .with_patience(Time::from_millis(self.reply_within));
        let Some(path) = &self.control else { return Ok(rig) };
        let control = ControlSocket::connect(path, self.encoder.as_deref()).map_err(|error| {
            Failure::Failed(format!(
                "--control {}: {error}; start the device with `sch108bex run --control {}`",
                path.display(),
                path.display()
            ))
        })?;
        Ok(rig.with_control(Box::new(control)))
    }

    /// Asks who is there.
    fn meet(&self, device: &mut Device, rig: &mut PortRig) -> Result<(), Failure> {
        let known = device.clone();
        let mut runner =
            Runner::new(&known, rig, self.options()).map_err(|error| Failure::Failed(error.to_string()))?;
        let diagnosis = runner.identify().map_err(Failure::Failed)?;
        let (owner, ident) = (diagnosis[3], u16::from_be_bytes([diagnosis[4], diagnosis[5]]));
        if owner != 0xFF && !self.options().masters.contains(&owner) {
            return Err(Failure::Failed(format!(
                "master {owner} owns the slave at {}: end that master first, the tester needs the slave for itself",
                self.address
            )));
        }
        if let Some(due) = device.ident.filter(|due| *due != ident) {
            return Err(Failure::Failed(format!(
                "the slave at {} has ident number {ident:04X}, not {due:04X}: it is another device",
                self.address
            )));
        }
        self.look_for_others(rig)?;
        device.ident = Some(ident);
        device.encoder = facts(&diagnosis).filter(|_| device.encoder.is_some());
        if let (Some(facts), None) = (&device.encoder, &self.gsd) {
            let (n, m) = (facts.singleturn_bits, facts.multiturn_bits);
            device.modes = Device::encoder(self.address, n, m).modes;
        }
        Ok(())
    }

    /// Another slave where a new one is would answer to what is meant for the one that is tested.
    fn look_for_others(&self, rig: &mut PortRig) -> Result<(), Failure> {
        // Master 2 asks 126 for its FDL status: 7E + 02 + 49 = C9.
        const STATUS: [u8; 6] = [0x10, 0x7E, 0x02, 0x49, 0xC9, 0x16];
        if self.address == 126 {
            return Ok(());
        }
        let broken = |error: RigError| Failure::Failed(error.to_string());
        rig.send(&STATUS.map(Signal::Octet)).map_err(broken)?;
        if !rig.listen(Expect::Silence).map_err(broken)?.octets.is_empty() {
            output::aside(
                "warning: a station answers at address 126 too; cases that change addresses fail while it is on \
                 the bus",
            );
        }
        Ok(())
    }

    fn options(&self) -> Options {
        // The two masters have addresses that the slave has not.
        let mut free = (2..).filter(|address| *address != self.address);
        let masters = [free.next().unwrap_or(2), free.next().unwrap_or(3)];
        Options { masters, rate: self.baud, srd_low: self.srd_low, long: self.long, strict: self.strict }
    }

    fn play(
        &self,
        cases: &[Case],
        device: &Device,
        rig: &mut PortRig,
    ) -> Result<(Vec<CaseResult>, Option<RigError>), Failure> {
        let mut runner =
            Runner::new(device, rig, self.options()).map_err(|error| Failure::Failed(error.to_string()))?;
        let mut progress = Progress::new(cases.len(), std::io::stderr().is_terminal());
        let mut results = Vec::new();
        for case in cases {
            progress.show(&case.id);
            let result = match runner.run(case) {
                Ok(result) => result,
                Err(error) => {
                    progress.clear();
                    return Ok((results, Some(error)));
                }
            };
            progress.clear();
            progress.done(result.outcome == Outcome::Fail);
            if !self.json {
                output::line(&report::case_text(&result, !self.brief));
            }
            results.push(result);
        }
        Ok((results, None))
    }

    fn report(&self, run: &Run, results: &[CaseResult]) -> Result<(), Failure> {
        if self.json {
            output::line(&report::json(run, results));
        } else {
            output::line(&format!("\n{}", report::summary(results)));
        }
        let files = [
            ("--junit", &self.junit, report::junit as fn(&Run, &[CaseResult]) -> String),
            ("--html", &self.html, report::html),
        ];
        for (option, path, make) in files {
            let Some(path) = path else { continue };
            std::fs::write(path, make(run, results)).map_err(|error| {
                Failure::Failed(format!("{option} {}: cannot be written: {error}", path.display()))
            })?;
        }
        Ok(())
    }
}

fn verdict(results: &[CaseResult]) -> Result<(), Failure> {
    let tally = Tally::of(results);
    if tally.failed == 0 {
        return Ok(());
    }
    let failed = results.iter().filter(|result| result.outcome == Outcome::Fail);
    let numbers: Vec<_> = failed.map(|result| result.id.as_str()).collect();
    Err(Failure::Failed(format!(
        "{} of {} cases failed: {}",
        tally.failed,
        tally.passed + tally.failed,
        numbers.join(", ")
    )))
}

/// Whether the slave sees a stream of octets behind this port.
fn is_stream(port: &PortAddress) -> bool {
    match port {
        PortAddress::Device(path) => {
            std::fs::canonicalize(path).is_ok_and(|path| path.starts_with("/dev/pts"))
        }
        _ => true,
    }
}
