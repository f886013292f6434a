//! Requests about a world that changes by itself, and about the cable.

use bus::termination::{self, Tap};
use profibus_dp::time::Duration;
use sch108bex::end_cap::TerminationSwitches;

use super::check::ControlError;
use super::request::Request;
use crate::encoder::EncoderStation;
use crate::ground::Ground;
use crate::handle::Handle;
use crate::store::StoreError;
use crate::world::model::{hours, nanos};

/// Points of a supply profile at most.
const MOST_POINTS: usize = 10_000;

fn no<T>(text: &str) -> Result<T, ControlError> {
    Err(ControlError::Value(text.to_owned()))
}

fn within(name: &str, value: f64, least: f64, most: f64) -> Result<f64, ControlError> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        no(&format!("{name} is a number from {least} to {most}"))
    }
}

/// Seconds and volts as nanoseconds and millivolts.
fn points(points: &[(f64, f64)]) -> Result<Vec<(u64, i32)>, ControlError> {
    let mut read = Vec::new();
    for &(seconds, volts) in points {
        let at = nanos(within("the time of a point", seconds, 0.0, 1e9)?);
        if read.last().is_some_and(|(before, _)| *before > at) {
            return no("no point is earlier than the one before");
        }
        read.push((at, millivolts(within("the voltage of a point", volts, -100.0, 100.0)?)));
    }
    if read.is_empty() || read.len() > MOST_POINTS {
        return no(
            "points is a list like [[0,24],[2,24],[2,5],[2.5,24]]: seconds and volts, 1 to 10000 of them",
        );
    }
    Ok(read)
}

#[expect(clippy::cast_possible_truncation, reason = "checked before")]
fn millivolts(volts: f64) -> i32 {
    (volts * 1e3).round() as i32
}

impl Request {
    /// Values of these requests that are none.
    pub(super) fn check_surroundings(&self) -> Result<(), ControlError> {
        /// A hundred years and more.
        const LONG: f64 = 1e6;
        match self {
            Self::SupplyProfile { points: given, .. } => points(given).map(drop),
            Self::BrownOut { volts, for_s, .. } => {
                within("volts", *volts, -100.0, 100.0)?;
                within("for_s", *for_s, 0.001, 1e9).map(drop)
            }
            Self::Thermal { ambient, time_constant_s, kelvin_per_watt, watts, .. } => {
                within("ambient", *ambient, -300.0, 300.0)?;
                within("time_constant_s", *time_constant_s, 0.1, 1e9)?;
                within("kelvin_per_watt", *kelvin_per_watt, 0.0, 1e3)?;
                within("watts", *watts, 0.0, 1e3).map(drop)
            }
            Self::LedAgeing { hours, .. } => within("hours", *hours, 0.0, LONG).map(drop),
            Self::Discharge { charge, low, hours_without_power, hours_with_power, .. } => {
                within("charge", *charge, 0.0, 100.0)?;
                within("low", *low, 0.0, 100.0)?;
                within("hours_without_power", *hours_without_power, 1e-6, LONG)?;
                hours_with_power.map_or(Ok(()), |on| within("hours_with_power", on, 1e-6, LONG).map(drop))
            }
            Self::Units { machine: Some(machine), .. } => machine.check().map_err(ControlError::Value),
            _ => Ok(()),
        }
    }
}

impl Handle {
    /// What changes around encoders by itself.
    pub(super) fn apply_over_time(&self, request: &Request) -> Result<(), ControlError> {
        match request {
            Request::SupplyProfile { encoder, points: given, repeat } => {
                let (profile, repeat) = (points(given)?, *repeat);
                self.each(encoder.as_ref(), |_| {
                    let profile = profile.clone();
                    Ok(move |station: &mut EncoderStation, now| station.follow_supply(now, profile, repeat))
                })
                .map(drop)
            }
            Request::BrownOut { encoder, volts, for_s } => {
                let (low, end) = (millivolts(*volts), nanos(*for_s));
                self.with(encoder.as_ref(), move |station, now| {
                    let back = station.world().0.supply_mv;
                    station.follow_supply(now, vec![(0, low), (end, low), (end, back)], false);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Thermal { encoder, ambient, time_constant_s, kelvin_per_watt, watts } => {
                let (ambient, own) = (*ambient, kelvin_per_watt * watts);
                let constant = Duration::from_nanos(nanos(*time_constant_s));
                self.with(encoder.as_ref(), move |station, now| {
                    station.follow_temperature(now, ambient, own, constant);
                    Ok::<_, StoreError>(())
                })
            }
            Request::LedAgeing { encoder, hours: left } => {
                let left = hours(*left);
                self.with(encoder.as_ref(), move |station, now| {
                    station.age_led(now, left);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Discharge { encoder, charge, low, hours_without_power, hours_with_power } => {
                let (charge, low) = (charge / 100.0, low / 100.0);
                let lasts = [Some(hours(*hours_without_power)), hours_with_power.map(hours)];
                self.with(encoder.as_ref(), move |station, now| {
                    station.discharge(now, charge, low, lasts);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Endurance { encoder, writes } => {
                let writes = *writes;
                self.with(encoder.as_ref(), move |station, _| {
                    station.set_endurance(writes);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Units { encoder, machine } => self
                .each(encoder.as_ref(), |_| {
                    let machine = machine.clone();
                    Ok(move |station: &mut EncoderStation, _| station.set_machine(machine))
                })
                .map(drop),
            _ => self.apply_to_cable(request),
        }
    }

    /// The cable and its termination.
    fn apply_to_cable(&self, request: &Request) -> Result<(), ControlError> {
        let segment = match request {
            Request::Termination { encoder, first, second } => {
                let switches = TerminationSwitches { first: *first, second: *second };
                self.with(encoder.as_ref(), move |station, _| {
                    station.set_termination(switches);
                    Ok::<_, StoreError>(())
                })?;
                // The segments of those that were meant are not worth finding: all are judged.
                &Some(super::Which::Name("all".to_owned()))
            }
            Request::Cut { segment, .. }
            | Request::Mend { segment }
            | Request::Reflections { segment, .. } => segment,
            _ => return Ok(()),
        };
        let change = match *request {
            Request::Cut { after, master_after, .. } => Change::Cut { after, master_after },
            Request::Mend { .. } => Change::Mend,
            Request::Reflections { on, .. } => Change::Reflections(on),
            _ => Change::Nothing,
        };
        self.with_segments(segment.as_ref(), move |segment| {
            let cable = change.of(segment.faults().cable(), segment.stations().len())?;
            relay(segment, cable);
            Ok::<_, ControlError>(())
        })
    }
}

/// What becomes of a cable.
#[derive(Debug, Clone, Copy)]
enum Change {
    Cut { after: usize, master_after: Option<usize> },
    Mend,
    Reflections(bool),
    Nothing,
}

impl Change {
    fn of(self, mut cable: bus::Cable, stations: usize) -> Result<bus::Cable, ControlError> {
        match self {
            Self::Cut { after, master_after } => {
                let devices = stations + 1;
                if after > devices {
                    let text = format!(
                        "after is a number from 0 to {devices}: there are {devices} devices, the master among them"
                    );
                    return Err(ControlError::Value(text));
                }
                if master_after.is_some_and(|master_after| master_after > stations) {
                    let text = format!(
                        "master_after is a number from 0 to {stations}: there are {stations} encoders"
                    );
                    return Err(ControlError::Value(text));
                }
                cable.cut_after = Some(after);
                cable.master_after = master_after.unwrap_or(cable.master_after);
            }
            Self::Mend => cable.cut_after = None,
            Self::Reflections(on) => cable.mismatches = on.then_some(0),
            Self::Nothing => {}
        }
        Ok(cable)
    }
}

/// Puts another cable in, and judges its termination.
fn relay(segment: &mut dyn Ground, mut cable: bus::Cable) {
    let now = segment.now();
    for (at, station) in segment.stations_mut().iter_mut().enumerate() {
        let cut = cable.cuts_off(at);
        if cut != station.injected().cut_off {
            station.cut_off(now, cut);
        }
    }
    if cable.mismatches.is_some() {
        cable.mismatches = Some(judge(segment.stations(), &cable).len());
    }
    segment.faults_mut().set_cable(cable);
}

/// What is wrong with the termination of the part of the cable that the master is on (manual 3.3).
pub(crate) fn judge(stations: &[EncoderStation], cable: &bus::Cable) -> Vec<String> {
    let master_after = cable.master_after;
    let mut taps: Vec<_> = stations
        .iter()
        .enumerate()
        .filter(|(_, station)| !station.injected().cut_off)
        .map(|(at, station)| {
            let TerminationSwitches { first, second } = station.termination();
            (at, Tap { name: station.name(), switches: [first, second] })
        })
        .collect();
    let place = taps.iter().filter(|(at, _)| *at < master_after).count();
    // Where nobody has said otherwise the master's plug is switched as it has to be where it is, unless the
    // cable was cut beside it.
    let at_end = master_after == 0 || master_after >= stations.len();
    let terminated = cable.master_terminated.unwrap_or(at_end);
    taps.insert(place, (usize::MAX, Tap { name: "master", switches: [terminated; 2] }));
    let taps: Vec<_> = taps.into_iter().map(|(_, tap)| tap).collect();
    termination::judge(&taps).iter().map(ToString::to_string).collect()
}
