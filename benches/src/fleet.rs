//! Encoders by the hundred and by the thousand in virtual time, polled without a pause, every answer checked
//! against its shaft.
//!
//! It is what a user of a virtual segment has: a light master, a segment at 12 Mbit/s whose bus times are kept,
//! and encoders in Scancon 2.0 whose shafts move in five different ways.

use std::fs;
use std::ops::RangeInclusive;

use bus::VirtualSegment;
use master::{LightMaster, Request, Service, Settings};
use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use rustix::time::{ClockId, clock_gettime};
use sch108bex::configuration::Configurations;
use sch108bex::encoder::Identity;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{LATCH_PERIOD, PLACEHOLDER_IDENT, SerialNumber, Variant};

use crate::median;
use crate::telegrams::{Functionality, MEASURING_RANGE, MEASURING_UNITS, parameters};

const RATE: Baudrate = Baudrate::B12000000;
/// Rotary switches can give the addresses 1 to 125, so as many encoders fit on a segment.
const FULL: u8 = 125;
/// The master is where no encoder can be.
const MASTER: u8 = 0;
/// The answer: SD2 with 12 inputs, 11 bits each octet.
const ANSWER: BitTimes = BitTimes(11 * 21);
/// Before this the first two windows of velocity may not be over.
const SETTLED: Instant = Instant::from_millis(500);

/// A way to move, and what velocity (RPM) and acceleration (RPM a second) can be then. Counter-clockwise, as
/// the parameters have it: a shaft that turns clockwise goes backwards.
type Movement = (&'static str, RangeInclusive<i32>, RangeInclusive<i32>);

const MOVEMENTS: [Movement; 5] = [
    ("constant:300@1000", -300..=-300, 0..=0),
    // 2 turns, 3 s: 2 pi 2 / 3 turns a second, and 2 pi / 3 of it a second.
    ("sine:amplitude=2:period_s=3@500000", -252..=252, -527..=527),
    ("ramp:from_rpm=-1200:to_rpm=1200:over_s=20@70000000", -1200..=1200, -121..=121),
    ("hoist:by=32:speed=8:acceleration=4:jerk=8:pause_s=0.5@10000", -480..=480, -241..=241),
    // Another speed every half second, from one end to the other at most.
    ("walk:rpm=60:every_s=0.5:seed=7@40000000", -60..=60, -1201..=1201),
];

/// What an encoder must answer.
struct Expected {
    address: u8,
    shaft: Shaft,
    velocity: RangeInclusive<i32>,
    acceleration: RangeInclusive<i32>,
}

impl Expected {
    /// Whether these inputs are right for a request that ended at `asked`.
    #[inline]
    fn is_met(&mut self, asked: Instant, inputs: [u8; 12]) -> bool {
        let number = |at: usize| i32::from_be_bytes([0, 1, 2, 3].map(|octet| inputs[at + octet]));
        let [position, velocity, acceleration] = [number(0), number(4), number(8)];
        // Every encoder got its power at 0, where its first latch was.
        let latch = LATCH_PERIOD.times(asked.since(Instant::ZERO).whole(LATCH_PERIOD));
        let physical = self.shaft.at(Instant::ZERO + latch, Variant::FULL);
        let raw = physical.wrapping_neg() & i64::from(u32::MAX >> 1);
        let due = ((raw * i64::from(MEASURING_UNITS)) >> 16) % i64::from(MEASURING_RANGE);
        i64::from(position) == due
            && (asked < SETTLED
                || self.velocity.contains(&velocity) && self.acceleration.contains(&acceleration))
    }
}

/// A segment with its master, and what its encoders must answer.
pub(crate) struct Fleet {
    pub(crate) master: LightMaster<VirtualSegment<EncoderStation>>,
    expected: Vec<Expected>,
    /// Who is next.
    at: usize,
    /// How long nobody is asked after each exchange.
    pause: Duration,
}

/// What a run brought.
#[derive(Default)]
pub(crate) struct Run {
    pub(crate) exchanges: u32,
    /// Seconds on the bus.
    passed: f64,
    /// Seconds of a processor that it took.
    taken: f64,
}

impl Fleet {
    /// As many encoders as fit on a segment, who move in all ways.
    fn full() -> Result<Self, String> {
        Self::some(FULL)
    }

    /// So many encoders, at most as many as fit on a segment, who move in all ways.
    pub(crate) fn some(count: u8) -> Result<Self, String> {
        Self::of((1..=count).zip(MOVEMENTS.iter().cycle()))
    }

    /// One encoder.
    fn alone(movement: &Movement) -> Result<Self, String> {
        Self::of(std::iter::once((1, movement)))
    }

    /// Encoders, all of them in data exchange.
    fn of<'a>(encoders: impl Iterator<Item = (u8, &'a Movement)>) -> Result<Self, String> {
        let mut segment = VirtualSegment::new(Instant::ZERO, RATE);
        let mut expected = Vec::new();
        for (address, (text, velocity, acceleration)) in encoders {
            let shaft: Shaft = text.parse().map_err(|error| format!("{text}: {error}"))?;
            segment.add(encoder(address, shaft.clone())?);
            let (velocity, acceleration) = (velocity.clone(), acceleration.clone());
            expected.push(Expected { address, shaft, velocity, acceleration });
        }
        let mut master = LightMaster::new(segment, Settings { address: MASTER, ..Settings::default() });
        let (mut parameters, _, configuration) = parameters(Functionality::Scancon20);
        // As masters set it: 200 ms.
        parameters[1..3].copy_from_slice(&[1, 20]);
        for Expected { address, .. } in &expected {
            let told = |error| format!("encoder {address}: {error}");
            master.set_prm(*address, &parameters).map_err(told)?;
            master.chk_cfg(*address, configuration).map_err(told)?;
        }
        Ok(Self { master, expected, at: 0, pause: Duration::ZERO })
    }

    /// One Data_Exchange with whoever is next; the answer must be what the shaft says.
    #[inline]
    fn exchange(&mut self) -> Result<(), String> {
        let Self { master, expected, at, .. } = self;
        let count = expected.len();
        let due = &mut expected[*at];
        *at = if *at + 1 < count { *at + 1 } else { 0 };
        let request = Request::service(due.address, Service::DataExchange, &[0; 4]);
        let reply = master.request(&request).map_err(|error| error.to_string())?;
        let inputs = <[u8; 12]>::try_from(reply.data).map_err(|_| "The answer does not have 12 inputs.")?;
        let delay = reply.delay;
        let asked = master.now() - RATE.duration(ANSWER) - delay;
        if due.is_met(asked, inputs) { Ok(()) } else { Err(wrong(due.address, asked, inputs)) }
    }

    /// Exchanges for so long.
    pub(crate) fn run(&mut self, span: Duration) -> Result<Run, String> {
        let (begun, from) = (on_processor(), self.master.now());
        let mut exchanges = 0;
        while self.master.now() < from + span {
            self.exchange()?;
            if self.pause > Duration::ZERO {
                self.master.line_mut().wait(self.pause);
            }
            exchanges += 1;
        }
        let taken = on_processor() - begun;
        let passed = std::time::Duration::from(self.master.now().since(from)).as_secs_f64();
        Ok(Run { exchanges, passed, taken })
    }

    /// The time in which it asks everybody once.
    fn cycle(&mut self) -> Result<Duration, String> {
        let from = self.master.now();
        (0..self.expected.len()).try_for_each(|_| self.exchange())?;
        Ok(self.master.now().since(from))
    }
}

/// How many seconds this thread has had a processor: whatever else a machine does is not in it.
#[expect(clippy::cast_precision_loss, reason = "a nanosecond of a month is no loss")]
fn on_processor() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

#[cold]
fn wrong(encoder: u8, asked: Instant, inputs: [u8; 12]) -> String {
    format!(
        "Encoder {encoder} answers {inputs:02x?} at {} ns, and its shaft says otherwise.",
        asked.as_nanos()
    )
}

fn encoder(address: u8, shaft: Shaft) -> Result<EncoderStation, String> {
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(address),
        },
        configurations: Configurations::default(),
        rate: Rate::Fixed(RATE),
        termination: TerminationSwitches { first: address == FULL, second: address == FULL },
        shaft,
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new(&format!("encoder {address}"), None),
    };
    EncoderStation::new(Instant::ZERO, setup).map_err(|error| error.to_string())
}

/// How many times faster than real time a full segment is, polled back to back; the median of several runs.
pub(crate) fn times_real_time() -> Result<f64, String> {
    const RUNS: usize = 9;
    const SPAN: Duration = Duration::from_secs(40);
    let mut fleet = Fleet::full()?;
    let runs = (0..RUNS).map(|_| fleet.run(SPAN)).collect::<Result<Vec<_>, _>>()?;
    let nanos = median(runs.iter().map(|run| run.taken * 1e9 / f64::from(run.exchanges)).collect());
    eprintln!("{nanos:.1} ns for an exchange");
    Ok(median(runs.iter().map(|run| run.passed / run.taken).collect()))
}

/// What an exchange costs with 80 full segments, over what it costs with one encoder on one segment.
///
/// Both do the same: each encoder is asked once in the time in which a full segment asks all, so that it has as
/// many latches to catch up with; and the one encoder is each kind of shaft in turn. The segments are brought on
/// one after the other by a second each, as `sch108bex scenario run --virtual` does.
pub(crate) fn cost_ratio() -> Result<f64, String> {
    const SEGMENTS: usize = 80;
    const ROUNDS: usize = 9;
    const STEP: Duration = Duration::from_secs(1);
    let mut all = (0..SEGMENTS).map(|_| Fleet::full()).collect::<Result<Vec<_>, _>>()?;
    let cycle = all.first_mut().map(Fleet::cycle).transpose()?.unwrap_or_default();
    let mut alone = MOVEMENTS.iter().map(Fleet::alone).collect::<Result<Vec<_>, _>>()?;
    for one in &mut alone {
        one.pause = Duration::from_nanos(cycle.as_nanos() - one.cycle()?.as_nanos());
    }
    let (mut of_one, mut of_all) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        // By turns, some two million exchanges and one.
        of_one.push(nanos(&mut alone, Duration::from_secs(1_000))?);
        of_all.push(nanos(&mut all, STEP)?);
    }
    let (of_one, of_all) = (median(of_one), median(of_all));
    eprintln!("{of_one:.1} ns with one, {of_all:.1} ns with {}", SEGMENTS * usize::from(FULL));
    Ok(of_all / of_one)
}

/// Brings each on by so much; nanoseconds for an exchange.
fn nanos(fleets: &mut [Fleet], step: Duration) -> Result<f64, String> {
    let mut sum = Run::default();
    for fleet in fleets {
        let run = fleet.run(step)?;
        sum.taken += run.taken;
        sum.exchanges += run.exchanges;
    }
    Ok(sum.taken * 1e9 / f64::from(sum.exchanges))
}

/// Resident memory of one encoder in KiB: what 79 further segments take.
pub(crate) fn memory() -> Result<f64, String> {
    const FURTHER: u16 = 79;
    let first = Fleet::full()?;
    let before = resident_kib()?;
    let further = (0..FURTHER).map(|_| Fleet::full()).collect::<Result<Vec<_>, _>>()?;
    let after = resident_kib()?;
    drop((first, further));
    Ok((after - before) / f64::from(FURTHER * u16::from(FULL)))
}

fn resident_kib() -> Result<f64, String> {
    let status = fs::read_to_string("/proc/self/status");
    let status = status.map_err(|error| format!("/proc/self/status: {error}."))?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB"));
    line.and_then(|kib| kib.parse().ok()).ok_or_else(|| "/proc/self/status has no VmRSS.".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOME_TIME: Duration = Duration::from_millis(700);

    #[test]
    fn answers_that_are_not_those_of_the_shaft_are_noticed() {
        for movement in &MOVEMENTS {
            let mut fleet = Fleet::alone(movement).unwrap();
            assert!(fleet.run(SOME_TIME).unwrap().exchanges > 10_000, "{}", movement.0);
            // A speed that is not his, an acceleration, and another place.
            let expected = fleet.expected[0].velocity.clone();
            fleet.expected[0].velocity = 3_000..=3_000;
            assert!(fleet.exchange().is_err(), "{}", movement.0);
            fleet.expected[0].velocity = expected;
            fleet.exchange().unwrap();
            fleet.expected[0].acceleration = 3_000..=3_000;
            assert!(fleet.exchange().is_err(), "{}", movement.0);
            fleet.expected[0].acceleration = movement.2.clone();
            fleet.exchange().unwrap();
            let (constant, _) = movement.0.split_once('@').unwrap();
            fleet.expected[0].shaft = format!("{constant}@77").parse().unwrap();
            assert!(fleet.exchange().is_err(), "{}", movement.0);
        }
    }

    // 13 and 21 octets of 11 bits, min T_SDR 11 and 76 of idle: 461 bits of 1/12 us, rounded up piece by piece.
    #[test]
    fn a_full_segment_asks_everybody_in_as_long_as_its_bus_takes() {
        let cycle = Fleet::full().unwrap().cycle().unwrap();
        let due = 125 * 461 * 1_000 / 12;
        assert!((due..due + 125 * 4).contains(&cycle.as_nanos()), "{cycle:?} {due}");
    }
}
