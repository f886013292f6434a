//! Who is on the bus, with a word in between: 126 addresses at which nobody answers take a while.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use ::master::light::{HIGHEST_ADDRESS, StationKind};

use super::{Light, failed};
use crate::{Failure, output};

/// What is said where nobody answers.
pub(crate) const NOBODY: &str = "nobody answers at any address; check the rate, the wiring and the power";

/// Without a terminal a line now and then.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// How far it is, on standard error.
struct Progress {
    terminal: bool,
    told: Instant,
    found: usize,
}

impl Progress {
    fn show(&mut self, address: u8) {
        let text = format!("asking address {address} of {HIGHEST_ADDRESS}; {} found so far", self.found);
        if self.terminal {
            let _ = write!(std::io::stderr(), "\r\x1b[2K{text}");
        } else if self.told.elapsed() >= LINE_EVERY {
            self.told = Instant::now();
            output::aside(&text);
        }
    }

    fn clear(&self) {
        if self.terminal {
            let _ = write!(std::io::stderr(), "\r\x1b[2K");
        }
    }
}

/// Asks every address from 0 to 126 but its own, and hands out each station as it is found. Where nobody has answered at all, it asks
/// once more: one answer may be lost or late.
pub(crate) fn each_station(
    light: &mut Light,
    mut take: impl FnMut(&mut Light, u8, StationKind) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut progress = Progress { terminal: std::io::stderr().is_terminal(), told: Instant::now(), found: 0 };
    let mut done = pass(light, &mut progress, &mut take);
    if done.is_ok() && progress.found == 0 {
        done = pass(light, &mut progress, &mut take);
    }
    progress.clear();
    done
}

fn pass(
    light: &mut Light,
    progress: &mut Progress,
    take: &mut impl FnMut(&mut Light, u8, StationKind) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let own = light.settings().address;
    for address in (0..=HIGHEST_ADDRESS).filter(|address| *address != own) {
        progress.show(address);
        if let Some(kind) = light.status(address).map_err(failed)? {
            progress.found += 1;
            progress.clear();
            take(light, address, kind)?;
        } else if light.line().is_gone() {
            return Err(Failure::Failed("the line was closed".to_owned()));
        }
    }
    Ok(())
}

/// All that answer.
pub(crate) fn live_list(light: &mut Light) -> Result<Vec<(u8, StationKind)>, Failure> {
    let mut found = Vec::new();
    each_station(light, |_, address, kind| {
        found.push((address, kind));
        Ok(())
    })?;
    Ok(found)
}

/// The station to talk to: the one that was named, or the only one there is.
pub(crate) fn station(light: &mut Light, named: Option<u8>, how_to_name: &str) -> Result<u8, Failure> {
    if let Some(address) = named {
        return Ok(address);
    }
    let found = live_list(light)?;
    let slaves: Vec<u8> = found
        .into_iter()
        .filter(|(_, kind)| *kind == StationKind::Passive)
        .map(|(address, _)| address)
        .collect();
    match slaves.as_slice() {
        [only] => Ok(*only),
        [] => Err(Failure::Failed(NOBODY.to_owned())),
        several => Err(Failure::Failed(format!(
            "there are several stations, at {}; choose one with {how_to_name}",
            several.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
        ))),
    }
}
