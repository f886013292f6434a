//! Setting shafts, and with them those that they drive.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use profibus_dp::time::Instant;

use super::check::ControlError;
use super::target::{Which, chosen};
use super::values::ShaftSpec;
use crate::encoder::EncoderStation;
use crate::handle::{Found, Handle};
use crate::shaft::{Coupling, Shaft};

/// Which encoder, by number from 0, is driven by which, and how.
#[derive(Debug, Clone, Default)]
pub(crate) struct Couplings(Arc<Mutex<BTreeMap<usize, Driven>>>);

#[derive(Debug, Clone)]
struct Driven {
    by: usize,
    coupling: Coupling,
}

impl Couplings {
    fn with<R>(&self, work: impl FnOnce(&mut BTreeMap<usize, Driven>) -> R) -> R {
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The encoders that this one drives, also through others, each after the one that drives it.
    fn behind(&self, driver: usize) -> Vec<(usize, Driven)> {
        self.with(|all| {
            let mut found: Vec<(usize, Driven)> = Vec::new();
            let mut next = vec![driver];
            while let Some(driver) = next.pop() {
                for (number, driven) in all.iter().filter(|(_, driven)| driven.by == driver) {
                    next.push(*number);
                    found.push((*number, driven.clone()));
                }
            }
            found
        })
    }
}

impl Handle {
    /// Sets the shafts of the encoders that are meant, once all of them are found to be right.
    pub(super) fn set_shaft(&self, encoder: Option<&Which>, spec: &ShaftSpec) -> Result<(), ControlError> {
        let names: Vec<_> = self.encoder_names().collect();
        let numbers = chosen("encoder", encoder, &names)?;
        if let Some(coupling) = spec.coupling()? {
            let [driver] = chosen("encoder", Some(&coupling.to), &names)?[..] else {
                return Ok(());
            };
            return self.couple(&numbers, driver, &coupling);
        }
        let (shaft, from_here) = spec.resolve()?;
        for found in numbers.iter().filter_map(|&number| self.encoder(number)) {
            if !from_here {
                shaft.check(found.variant)?;
            }
        }
        for number in numbers {
            self.couplings().with(|all| all.remove(&number));
            let shaft = shaft.clone();
            self.turn(number, move |station, now| {
                if from_here {
                    station.set_shaft_from_here(now, shaft);
                } else {
                    station.set_shaft(now, shaft.started(now));
                }
            })?;
        }
        Ok(())
    }

    fn couple(&self, numbers: &[usize], driver: usize, coupling: &Coupling) -> Result<(), ControlError> {
        for found in numbers.iter().filter_map(|&number| self.encoder(number)) {
            if let Some(raw) = coupling.raw {
                Shaft::still(raw).check(found.variant)?;
            }
        }
        for &number in numbers {
            let is_behind = self.couplings().behind(number).iter().any(|(behind, _)| *behind == driver);
            if number == driver || is_behind {
                let text = "a shaft cannot be driven by itself, nor by one that it drives".to_owned();
                return Err(ControlError::Value(text));
            }
        }
        for &number in numbers {
            let entry = Driven { by: driver, coupling: coupling.clone() };
            self.couplings().with(|all| all.insert(number, entry));
        }
        // The driver goes on as it does; those behind it are coupled anew, all at one moment.
        self.turn(driver, |_, _| ())?;
        if let Some(raw) = coupling.raw {
            for &number in numbers {
                self.turn(number, move |station, now| station.move_shaft_to(now, raw))?;
            }
        }
        Ok(())
    }

    /// Changes one shaft, and couples what it drives anew: on its segment at the same moment.
    fn turn(
        &self,
        number: usize,
        change: impl FnOnce(&mut EncoderStation, Instant) + Send + 'static,
    ) -> Result<(), ControlError> {
        let Some(found) = self.encoder(number) else {
            return Ok(());
        };
        let behind = self.couplings().behind(number);
        let is_here = |other: &Found<'_>| std::ptr::eq(other.place, found.place);
        let (mut here, mut elsewhere) = (Vec::new(), Vec::new());
        for (number, Driven { by, coupling }) in behind {
            if let (Some(driven), Some(by)) = (self.encoder(number), self.encoder(by)) {
                if is_here(&driven) && is_here(&by) {
                    here.push((driven.at, by.at, coupling));
                } else {
                    elsewhere.push((driven, by, coupling));
                }
            }
        }
        let at = found.at;
        found.place.ask(move |segment| {
            let now = segment.now();
            let stations = segment.stations_mut();
            change(&mut stations[at], now);
            for (driven, by, coupling) in here {
                let drive = stations[by].shaft().clone();
                stations[driven].couple(now, &drive, &coupling);
            }
        })?;
        for (driven, by, coupling) in elsewhere {
            let (drive, age): (Shaft, _) = by.ask(|station, now| (station.shaft().clone(), now))?;
            let running = age.since(drive.since());
            driven.ask(move |station, now| {
                // Another segment has a clock of its own.
                let since = Instant::from_nanos(now.as_nanos().saturating_sub(running.as_nanos()));
                station.couple(now, &drive.started(since), &coupling);
            })?;
        }
        Ok(())
    }
}
