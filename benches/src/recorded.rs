//! What recording and capture cost: the same exchanges with both on and with both off.
//!
//! One virtual segment, 32 encoders with moving shafts in Scancon 2.0 at 12 Mbit/s, asked back to back by the light
//! master, who checks every answer. With both on there is a row of every encoder for every 10 ms of the bus in a
//! Parquet file, and every telegram is in a pcapng file. Nothing may be missing: in virtual time the bus waits for
//! writers that are slower, and that counts.
//!
//! Taken is the time by the clock, from the first exchange to the last, on the bus's thread; the writers have the
//! other core. What waits for them at the end is at most what their stores hold.

use std::path::Path;

use capture::LinkType;
use profibus_dp::time::Duration;
use record::Recorder;
use rustix::time::{ClockId, clock_gettime};

use crate::fleet::Fleet;

const ENCODERS: u8 = 32;
/// As `--record-every` has it by default.
const EVERY: Duration = Duration::from_millis(10);
/// How long the bus runs each time, some 170 000 exchanges, and how often.
const SPAN: Duration = Duration::from_secs(10);
const ROUNDS: usize = 15;
/// In between the writers are told how far the bus has come.
const STEP: Duration = Duration::from_millis(100);

/// Nanoseconds an exchange took.
#[derive(Debug, Clone, Copy)]
struct Taken {
    by_the_clock: f64,
    bus_thread: f64,
    all_threads: f64,
}

/// How long an exchange takes by the clock with both on, over both off; by turns, the best of each: whatever
/// else runs on the computer only adds to a time.
pub(crate) fn cost_ratio() -> Result<f64, String> {
    let folder = tempfile::tempdir().map_err(|error| format!("no folder for the files: {error}"))?;
    let (mut off, mut on) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        off.push(run(None)?);
        on.push(run(Some(folder.path()))?);
    }
    let told = |what: &str, of: fn(&Taken) -> f64| {
        let [off, on] = [&off, &on].map(|all| all.iter().map(of).fold(f64::INFINITY, f64::min));
        eprintln!("an exchange, {what}: {off:.0} ns off, {on:.0} ns on, ratio {:.2}", on / off);
        on / off
    };
    told("processor time of all threads", |taken| taken.all_threads);
    told("processor time of the bus's thread", |taken| taken.bus_thread);
    Ok(told("by the clock", |taken| taken.by_the_clock))
}

fn run(folder: Option<&Path>) -> Result<Taken, String> {
    let mut fleet = Fleet::some(ENCODERS)?;
    let recorders = folder.map(|folder| start(&mut fleet, folder)).transpose()?;
    let (begun, from) = (times(), fleet.master.now());
    let mut exchanges = 0;
    while fleet.master.now() < from + SPAN {
        exchanges += fleet.run(STEP)?.exchanges;
        if let Some((recorder, _)) = &recorders {
            recorder.events().settle(fleet.master.now());
        }
    }
    let ended = times();
    if let Some((recorder, capture)) = recorders {
        fleet.master.line_mut().set_tap(None);
        let (report, captured) = (recorder.finish(), capture.finish());
        let due = u64::from(ENCODERS) * (SPAN.as_nanos() / EVERY.as_nanos());
        if report.missing > 0 || report.error.is_some() || report.samples + u64::from(ENCODERS) < due {
            return Err(format!("The recording is not whole, {due} samples were due: {report:?}"));
        }
        if captured.missing > 0 || captured.packets != 2 * u64::from(exchanges) {
            return Err(format!("The capture of {exchanges} exchanges is not whole: {captured:?}"));
        }
    }
    let each = |clock: usize| (ended[clock] - begun[clock]) * 1e9 / f64::from(exchanges);
    Ok(Taken { by_the_clock: each(0), bus_thread: each(1), all_threads: each(2) })
}

fn start(fleet: &mut Fleet, folder: &Path) -> Result<(Recorder, capture::Recorder), String> {
    let told = |error: std::io::Error| format!("{}: {error}", folder.display());
    let settings = record::Settings { every: EVERY, is_virtual: true };
    let recorder = Recorder::start(&folder.join("it.parquet"), settings, |_| {}).map_err(told)?;
    let now = fleet.master.now();
    for (number, station) in (1..).zip(fleet.master.line_mut().stations_mut()) {
        station.sample_to(now, EVERY, Box::new(recorder.tap(&format!("encoder {number}"))));
    }
    let settings =
        capture::Settings { link_type: LinkType::default(), name: "bench".to_owned(), is_virtual: true };
    let capture = capture::Recorder::start(&folder.join("it.pcapng"), &settings).map_err(told)?;
    fleet.master.line_mut().set_tap(Some(Box::new(capture.tap())));
    Ok((recorder, capture))
}

/// Seconds by the clock, of this thread, and of all threads.
#[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
fn times() -> [f64; 3] {
    [ClockId::Monotonic, ClockId::ThreadCPUTime, ClockId::ProcessCPUTime].map(|clock| {
        let time = clock_gettime(clock);
        time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
    })
}
