//! Doing what a request asks for.

use bus::faults::MOST_WAITING;
use bus::{Faults, Noise, ReplyFault, RequestFault};
use profibus_dp::time::{Duration, Instant};
use sch108bex::event::PositionErrorCause;
use sch108bex::health::{Battery, Measurement};
use serde::Serialize;

use crate::control::check::{ControlError, numbered, parsed_mask, parsed_switches};
use crate::control::commands::{COMMANDS, CommandHelp};
use crate::control::request::Request;
use crate::control::target::Which;
use crate::control::values::{BatteryState, Light, MemoryFault, Power, SensorFault};
use crate::encoder::EncoderStation;
use crate::handle::Handle;
use crate::snapshot::{PlantSnapshot, Snapshot};
use crate::store::StoreError;
use crate::world::World;
use crate::world::model::WorldModel;

/// What a request gives back beyond that it was done.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Applied {
    /// Everything as it is now.
    Snapshot(PlantSnapshot),
    /// An encoder as it is now.
    Encoder(Box<Snapshot>),
    /// What can be asked for.
    Commands(&'static [CommandHelp]),
}

/// Whoever does what requests ask for: a running plant, or a device that can do some of it.
pub trait Steer: Send + Sync + std::fmt::Debug {
    /// Does what a request asks for, and returns when it is done.
    ///
    /// # Errors
    ///
    /// Why it was not done, and what to write instead.
    fn steer(&self, request: &Request) -> Result<Option<Applied>, ControlError>;
}

impl Steer for Handle {
    fn steer(&self, request: &Request) -> Result<Option<Applied>, ControlError> {
        self.apply(request)
    }
}

impl Handle {
    /// Does what a request asks for, and returns when it is done.
    ///
    /// # Errors
    ///
    /// Why it was not done, and what to write instead.
    pub fn apply(&self, request: &Request) -> Result<Option<Applied>, ControlError> {
        request.check()?;
        match request {
            Request::Help {} => Ok(Some(Applied::Commands(COMMANDS))),
            Request::Snapshot { encoder: Some(which) } if !which.is_all() => {
                let mut snapshots = self.each(Some(which), |_| Ok(EncoderStation::snapshot))?;
                Ok(snapshots.pop().map(|snapshot| Applied::Encoder(Box::new(snapshot))))
            }
            Request::Snapshot { .. } => Ok(Some(Applied::Snapshot(self.snapshot()?))),
            Request::Subscribe {} | Request::Unsubscribe {} | Request::Shutdown {} => {
                Err(ControlError::NotOfThePlant(request.name()))
            }
            Request::Shaft { .. }
            | Request::Supply { .. }
            | Request::Temperature { .. }
            | Request::Light { .. }
            | Request::Battery { .. } => self.apply_to_world(request).map(|()| None),
            Request::Switches { .. }
            | Request::Power { .. }
            | Request::Sensor { .. }
            | Request::Memory { .. }
            | Request::OperatingTime { .. }
            | Request::Leave { .. }
            | Request::Join { .. } => self.apply_to_device(request).map(|()| None),
            Request::SupplyProfile { .. }
            | Request::BrownOut { .. }
            | Request::Thermal { .. }
            | Request::LedAgeing { .. }
            | Request::Discharge { .. }
            | Request::Endurance { .. }
            | Request::Units { .. }
            | Request::Termination { .. }
            | Request::Cut { .. }
            | Request::Mend { .. }
            | Request::Reflections { .. } => self.apply_over_time(request).map(|()| None),
            Request::Line { segment, .. } => {
                let noise = request.noise();
                self.with_segments(segment.as_ref(), move |segment| set_noise(segment.faults_mut(), noise))?;
                Ok(None)
            }
            _ => self.apply_to_next(request).map(|()| None),
        }
    }

    /// What is around the encoders.
    fn apply_to_world(&self, request: &Request) -> Result<(), ControlError> {
        match request {
            Request::Shaft { encoder, shaft } => self.set_shaft(encoder.as_ref(), shaft),
            Request::Supply { encoder, volts } => {
                let supply_mv = rounded(volts * 1e3);
                self.change_world(
                    encoder.as_ref(),
                    |model| model.supply = None,
                    move |world| {
                        world.supply_mv = supply_mv;
                    },
                )
            }
            Request::Temperature { encoder, celsius } => {
                let tenths = i16::try_from(rounded(celsius * 10.0)).unwrap_or_default();
                self.change_world(
                    encoder.as_ref(),
                    |model| model.thermal = None,
                    move |world| {
                        world.temperature_tenths = tenths;
                    },
                )
            }
            Request::Light { encoder, state } => {
                let light_ok = *state == Light::Ok;
                self.change_world(
                    encoder.as_ref(),
                    |model| model.led = None,
                    move |world| {
                        world.light_ok = light_ok;
                    },
                )
            }
            Request::Battery { encoder, state } => {
                let battery = match state {
                    BatteryState::Ok => Battery::Ok,
                    BatteryState::Low => Battery::Low,
                    BatteryState::Empty => Battery::Empty,
                };
                self.change_world(
                    encoder.as_ref(),
                    |model| model.battery = None,
                    move |world| {
                        world.battery = battery;
                    },
                )
            }
            _ => Ok(()),
        }
    }

    /// The encoders themselves.
    fn apply_to_device(&self, request: &Request) -> Result<(), ControlError> {
        match request {
            Request::Switches { encoder, switches } => {
                let switches = parsed_switches(switches)?;
                self.with(encoder.as_ref(), move |station, _| {
                    station.set_switches(switches);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Leave { encoder } => self.plug(encoder.as_ref(), false),
            Request::Join { encoder } => self.plug(encoder.as_ref(), true),
            Request::Power { encoder, state } => {
                let state = *state;
                self.with(encoder.as_ref(), move |station, now| switch(station, now, state))
            }
            Request::Sensor { encoder, fault } => {
                let fault = *fault;
                self.with(encoder.as_ref(), move |station, now| {
                    inject(station, now, fault);
                    Ok::<_, StoreError>(())
                })
            }
            Request::Memory { encoder, fault } => {
                let fault = *fault;
                self.with(encoder.as_ref(), move |station, _| spoil(station, fault))
            }
            Request::OperatingTime { encoder, hours } => {
                /// A hundredth of an hour.
                const STEP_MS: u64 = 36_000;
                let millis = u64::from(rounded(hours * 100.0).unsigned_abs()) * STEP_MS;
                self.with(encoder.as_ref(), move |station, _| station.set_operating_time(millis))
            }
            _ => Ok(()),
        }
    }

    fn plug(&self, encoder: Option<&Which>, in_place: bool) -> Result<(), ControlError> {
        self.with(encoder, move |station, now| {
            station.plug(now, in_place);
            Ok::<_, StoreError>(())
        })
    }

    /// What goes wrong with the next requests and replies.
    fn apply_to_next(&self, request: &Request) -> Result<(), ControlError> {
        use NextFault::{Reply, Request as Asked};
        let (segment, fault, count) = match request {
            Request::LoseRequests { segment, count } => (segment, Asked(RequestFault::Lose), *count),
            Request::DoubleRequests { segment, count } => (segment, Asked(RequestFault::Double), *count),
            Request::LoseReplies { segment, count } => (segment, Reply(ReplyFault::Lose), *count),
            Request::DoubleReplies { segment, count } => (segment, Reply(ReplyFault::Double), *count),
            Request::DelayReplies { segment, by_us, count } => {
                (segment, Reply(ReplyFault::Late(Duration::from_micros(*by_us))), *count)
            }
            Request::DamageRequest { segment, octet, mask } => {
                let fault = RequestFault::Corrupt { octet: numbered(*octet)?, mask: parsed_mask(mask)? };
                (segment, Asked(fault), 1)
            }
            Request::DamageReply { segment, octet, mask } => {
                let fault = ReplyFault::Corrupt { octet: numbered(*octet)?, mask: parsed_mask(mask)? };
                (segment, Reply(fault), 1)
            }
            Request::CharacterError { segment, octet } => {
                (segment, Asked(RequestFault::CharacterError { octet: numbered(*octet)? }), 1)
            }
            _ => return Ok(()),
        };
        self.with_segments(segment.as_ref(), move |segment| fault.store(segment.faults_mut(), count))
    }

    fn change_world(
        &self,
        encoder: Option<&Which>,
        stop: impl Fn(&mut WorldModel) + Copy + Send + 'static,
        change: impl Fn(&mut Measurement) + Copy + Send + 'static,
    ) -> Result<(), ControlError> {
        self.with(encoder, move |station, now| {
            station.stop_following(now, stop);
            let World(mut world) = station.world();
            change(&mut world);
            station.set_world(now, World(world))
        })
    }
}

/// A fault by request for what comes next.
#[derive(Debug, Clone, Copy)]
enum NextFault {
    Request(RequestFault),
    Reply(ReplyFault),
}

impl NextFault {
    fn store(self, faults: &mut Faults, count: usize) -> Result<(), ControlError> {
        for stored in 0..count {
            let room = match self {
                Self::Request(fault) => faults.fail_next_request(fault),
                Self::Reply(fault) => faults.fail_next_reply(fault),
            };
            if !room {
                return Err(ControlError::Value(format!(
                    "{stored} of {count} were stored: no more than {MOST_WAITING} can wait; \
                     let the master go on, or clear them with {{\"do\":\"line\"}}"
                )));
            }
        }
        Ok(())
    }
}

fn set_noise(faults: &mut Faults, noise: Noise) -> Result<(), bus::NoiseError> {
    if noise == Noise::default() {
        faults.clear();
    }
    faults.set_noise(noise)
}

fn switch(station: &mut EncoderStation, now: Instant, state: Power) -> Result<(), StoreError> {
    match state {
        Power::Off => station.switch_power(now, false),
        Power::On => station.switch_power(now, true),
        Power::Cycle => {
            station.switch_power(now, false)?;
            station.switch_power(now, true)
        }
    }
}

fn inject(station: &mut EncoderStation, now: Instant, fault: SensorFault) {
    match fault {
        SensorFault::Once => station.sensor_fault(now, false),
        SensorFault::Held => station.sensor_fault(now, true),
        SensorFault::PositionError => station.position_error(now, PositionErrorCause::Injected),
        SensorFault::TurnsLost => station.lose_turns(),
        SensorFault::Off => station.end_sensor_fault(now),
    }
}

fn spoil(station: &mut EncoderStation, fault: MemoryFault) -> Result<(), StoreError> {
    match fault {
        MemoryFault::WritesFail => station.fail_writes(true),
        MemoryFault::DamageA => station.damage_memory([true, false])?,
        MemoryFault::DamageB => station.damage_memory([false, true])?,
        MemoryFault::LostAtPowerOn => station.lose_memory(true),
        MemoryFault::TornWrite => station.tear_next_write(true),
        MemoryFault::Off => {
            station.tear_next_write(false);
            station.fail_writes(false);
            station.lose_memory(false);
        }
    }
    Ok(())
}

#[expect(clippy::cast_possible_truncation, reason = "bounded before")]
fn rounded(value: f64) -> i32 {
    value.round() as i32
}
