//! What happens to encoders beside the bus.

use bus::VirtualSegment;
use plant::{Shaft, World};
use profibus_dp::time::Instant;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::{Battery, Measurement};

use crate::chance::Chance;
use crate::encoder::{Encoder, Pending, Phase};
use crate::setup::{FIRST_ADDRESS, has_switches, rpm};
use crate::station::SoakStation;

/// How often each of them happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Disturbances {
    /// The shaft went on differently.
    pub shafts: u64,
    /// Supply, temperature, light or battery changed.
    pub worlds: u64,
    /// The power was cut without warning.
    pub power_cuts: u64,
    /// The supply was away for a while.
    pub outages: u64,
    /// The switches were turned, and the power cut.
    pub switches: u64,
    /// The master fell silent towards an encoder.
    pub pauses: u64,
}

/// Something happens to one of them.
pub(crate) fn disturb(
    segment: &mut VirtualSegment<SoakStation>,
    encoders: &mut [Encoder],
    chance: &mut Chance,
    counts: &mut Disturbances,
) {
    let now = segment.now();
    bring_power_back(segment, encoders, chance);
    let at = chance.place(encoders.len());
    let free = free_address(encoders, chance);
    let (encoder, station) = (&mut encoders[at], &mut segment.stations_mut()[at]);
    if !encoder.powered {
        return;
    }
    match chance.below(100) {
        0..=34 => {
            let shaft =
                Shaft::constant(rpm(chance), encoder.truth.shaft().at(now, encoder.truth.variant), now);
            station.set_shaft(now, shaft.clone());
            encoder.truth.set_shaft(now, shaft);
            counts.shafts += 1;
        }
        35..=64 => {
            change_world(encoder, station, chance, now);
            counts.worlds += 1;
        }
        65..=76 => {
            station.power_cycle(now);
            powered(encoder, now);
            counts.power_cuts += 1;
        }
        77..=84 => {
            set_world(encoder, station, now, |world| world.supply_mv = 5_000);
            encoder.powered = false;
            counts.outages += 1;
        }
        85..=89 if has_switches(at) => {
            station.set_switches(RotarySwitches(free));
            station.power_cycle(now);
            powered(encoder, now);
            (encoder.address, encoder.phase) = (free, Phase::Look);
            counts.switches += 1;
        }
        85..=89 if encoder.perhaps.is_none() => encoder.phase = Phase::Release(free),
        _ => {
            encoder.paused_until = now + chance.millis(10, 2_500);
            encoder.good_since = encoder.paused_until;
            counts.pauses += 1;
        }
    }
}

fn powered(encoder: &mut Encoder, now: Instant) {
    encoder.truth.set_power_on(now);
    (encoder.powered, encoder.pending) = (true, Pending::Perhaps);
    encoder.good_since = encoder.good_since.max(now);
}

/// One in two of those that are without.
fn bring_power_back(
    segment: &mut VirtualSegment<SoakStation>,
    encoders: &mut [Encoder],
    chance: &mut Chance,
) {
    let now = segment.now();
    for (at, encoder) in encoders.iter_mut().enumerate().filter(|(_, encoder)| !encoder.powered) {
        if chance.is(2) {
            let station = &mut segment.stations_mut()[at];
            set_world(encoder, station, now, |world| world.supply_mv = 24_000);
            powered(encoder, now);
            debug_assert!(station.is_powered());
        }
    }
}

fn change_world(encoder: &mut Encoder, station: &mut SoakStation, chance: &mut Chance, now: Instant) {
    match chance.below(4) {
        0 => {
            let supply_mv = [24_000, 9_000, 30_000, 8_999, 30_001, 7_000][chance.place(6)];
            set_world(encoder, station, now, |world| world.supply_mv = supply_mv);
        }
        1 => {
            let temperature_tenths = [200, 650, 651, 900, -300][chance.place(5)];
            set_world(encoder, station, now, |world| world.temperature_tenths = temperature_tenths);
        }
        2 => {
            let light_ok = chance.is(2);
            set_world(encoder, station, now, |world| world.light_ok = light_ok);
        }
        _ => {
            let battery = [Battery::Ok, Battery::Low][chance.place(2)];
            set_world(encoder, station, now, |world| world.battery = battery);
        }
    }
}

fn set_world(
    encoder: &mut Encoder,
    station: &mut SoakStation,
    now: Instant,
    change: impl FnOnce(&mut Measurement),
) {
    let mut measurement = encoder.truth.world.0;
    change(&mut measurement);
    let world = World(measurement);
    let before = (encoder.truth.alarms(now), encoder.truth.warnings());
    station.set_world(now, world);
    encoder.truth.set_world(now, world);
    let after = (encoder.truth.alarms(now), encoder.truth.warnings());
    let warned = before.1 != after.1 && encoder.sends_warnings();
    let raised = before.0 == Some(0) && after.0 == Some(0x02);
    if raised || warned {
        encoder.pending = if encoder.pending == Pending::Perhaps { Pending::Perhaps } else { Pending::Yes };
    }
    if before.0 != Some(0) {
        // The alarm will go by itself, and that is a change, too.
        encoder.pending = Pending::Perhaps;
    }
}

/// An address that nobody has, had, or may have.
fn free_address(encoders: &[Encoder], chance: &mut Chance) -> u8 {
    loop {
        let address = FIRST_ADDRESS + u8::try_from(chance.below(122)).expect("below 122");
        let is_taken = |encoder: &Encoder| {
            encoder.address == address
                || encoder.perhaps == Some(address)
                || matches!(encoder.phase, Phase::Release(to) | Phase::Move(to) if to == address)
        };
        if !encoders.iter().any(is_taken) {
            return address;
        }
    }
}
