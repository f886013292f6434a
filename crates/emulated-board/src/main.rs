//! `emulated-board`: the firmware in an emulator, for a master of yours.

#![forbid(unsafe_code)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{self, Sender};
use std::time::Duration;

use bus::{Link, PortAddress};
use clap::Parser;
use emulated_board::{Beginning, Board, Bridge, Live, QEMU, Setup};
use plant::Shaft;
use plant::control::{ControlAddress, Server, Subscriptions};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::specification::Variant;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// The firmware's image on an emulated board, with a shaft and a world, for a master of yours
///
/// Prints `bus: WHERE` and `ready` once the bus can be used. Ctrl-C ends it.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask firmware run", bin_name = "cargo xtask firmware run")]
struct Arguments {
    /// The image for the STM32F405
    #[arg(long, value_name = "FILE")]
    image: PathBuf,
    /// The emulator
    #[arg(long, default_value = QEMU, value_name = "FILE")]
    qemu: PathBuf,
    /// Where the bus is: pty, tcp-listen:ADDRESS:PORT, unix:PATH
    #[arg(long, default_value = "pty", value_name = "PORT")]
    port: PortAddress,
    /// Make a symbolic link to the pseudo terminal, and remove it at the end
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// The rotary switches, X16 first
    #[arg(long, default_value = "7E", value_name = "HH", allow_hyphen_values = true)]
    switches: RotarySwitches,
    /// Singleturn and multiturn bits, up to 16x15
    #[arg(long, default_value = "16x15", value_name = "NxM", allow_hyphen_values = true)]
    bits: Variant,
    /// What turns the shaft: `still@RAW`, `constant:RPM[@RAW]` or another kind (docs/shafts.md)
    #[arg(long, default_value = "still@0", value_name = "SHAFT", allow_hyphen_values = true)]
    shaft: String,
    /// Take requests there: shaft, supply, temperature, light, battery, switches, power, sensor, memory and
    /// operating_time of docs/control.md
    #[arg(long, value_name = "PATH|tcp-listen:ADDRESS:PORT")]
    control: Option<ControlAddress>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match arguments.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("{text}");
            ExitCode::FAILURE
        }
    }
}

impl Arguments {
    fn run(&self) -> Result<(), String> {
        let shaft: Shaft = self.shaft.parse().map_err(|error| format!("--shaft: {error}"))?;
        shaft.check(self.bits).map_err(|error| format!("--shaft: {error}"))?;
        if self.link.is_some() && self.port != PortAddress::Pty {
            return Err("--link names a pseudo terminal, and this --port is none; leave --link out".into());
        }
        let (to_main, ends) = mpsc::channel();
        end_on_signals(&to_main)?;
        let board = Board::start(&self.setup()).map_err(|error| error.to_string())?;
        let live = Live::start(board, &self.beginning()).map_err(|error| error.to_string())?;
        let (bridge, bus) = match &self.port {
            PortAddress::Unix(path) => (None, format!("unix:{}", path.display())),
            port => {
                let bridge = Bridge::start(port, &live.bus()).map_err(|error| error.to_string())?;
                let name = bridge.name().to_owned();
                (Some(bridge), name)
            }
        };
        let link = self.link.as_deref().map(|link| Link::create(link, Path::new(&bus)));
        let _link = link.transpose().map_err(|error| error.to_string())?;
        let control = self.control.as_ref().map(|address| {
            let end = move || {
                let _ = to_main.send(());
            };
            Server::start(address, live.clone(), Subscriptions::new(), end)
        });
        let control = control.transpose().map_err(|error| format!("--control: {error}"))?;
        println!("bus: {bus}");
        println!("ready");
        let broken = wait(&ends, &live);
        drop((control, bridge));
        broken.map_or(Ok(()), Err)
    }

    fn setup(&self) -> Setup {
        let bus = match &self.port {
            PortAddress::Unix(path) => Some(path.clone()),
            _ => None,
        };
        Setup { program: self.qemu.clone(), image: self.image.clone(), bus }
    }

    fn beginning(&self) -> Beginning {
        let Self { switches, bits, shaft, .. } = self;
        Beginning { switches: switches.to_string(), bits: bits.to_string(), shaft: shaft.clone() }
    }
}

fn end_on_signals(to_main: &Sender<()>) -> Result<(), String> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| format!("cannot take note of Ctrl-C: {error}"))?;
    let to_main = to_main.clone();
    std::thread::spawn(move || {
        signals.forever().next();
        let _ = to_main.send(());
    });
    Ok(())
}

/// Until somebody ends it, or the board breaks; then why.
fn wait(ends: &mpsc::Receiver<()>, live: &Live) -> Option<String> {
    const LOOK: Duration = Duration::from_millis(200);
    loop {
        match ends.recv_timeout(LOOK) {
            Err(mpsc::RecvTimeoutError::Timeout) => {
                if let Some(why) = live.broken() {
                    return Some(why);
                }
            }
            _ => return None,
        }
    }
}
