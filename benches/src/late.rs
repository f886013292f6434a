//! How often an answer comes late in real time, with many encoders and masters on two processors.
//!
//! Eight masters ask once a millisecond each, by turns 32 encoders on a PTY of the program and a bare echo that
//! sends the same number of octets back. What the computer itself makes late happens to both.

use std::fmt::Write as _;
use std::fs;
use std::num::NonZeroU64;
use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity, set_current_timer_slack};
use rustix::time::{ClockId, clock_gettime};

use crate::processes::{START_UP_ANSWERS, Server, no_places};
use crate::telegrams::{Functionality, Octets, exchange_at, start_up_at};
use crate::tty::Port;

const SEGMENTS: u8 = 8;
const ENCODERS: u8 = 32;
const PROCESSORS: usize = 2;
/// From one exchange of a master to its next.
const PERIOD: Duration = Duration::from_millis(1);
/// Exchanges of a master with one side, then with the other, a multiple of what makes its frame count bits begin
/// anew; and how often so.
const AT_A_TIME: u32 = 1_536;
const TURNS: u32 = 8;
/// An answer that takes longer is late.
const LATE: Duration = Duration::from_micros(200);
/// Tenths of a second in which there must be an answer. The program leaves answers out that are 10 ms old; then
/// there is none, and it counts as late.
const PATIENCE: u8 = 1;
/// How often a request of the start-up is repeated.
const ATTEMPTS: u32 = 50;
/// The addresses of the encoders begin after that of the master.
const FIRST_ADDRESS: u8 = 3;

/// Up to so many microseconds; more is in a last one.
const BUCKETS: [u32; 10] = [10, 20, 30, 50, 100, 200, 500, 1_000, 2_000, 5_000];

/// How long answers took.
#[derive(Debug, Clone, Copy, Default)]
struct Histogram {
    counts: [u32; BUCKETS.len() + 1],
}

impl Histogram {
    fn add(&mut self, took: Duration) {
        let within = |limit: &u32| took <= Duration::from_micros(u64::from(*limit));
        let bucket = BUCKETS.iter().position(within).unwrap_or(BUCKETS.len());
        self.counts[bucket] += 1;
    }

    fn join(&mut self, other: &Self) {
        for (count, more) in self.counts.iter_mut().zip(other.counts) {
            *count += more;
        }
    }

    fn answers(&self) -> u32 {
        self.counts.iter().sum()
    }

    /// Late ones for 100000 answers.
    fn late(&self) -> f64 {
        let late = BUCKETS.iter().position(|limit| u128::from(*limit) == LATE.as_micros());
        let late: u32 = self.counts.iter().skip(late.map_or(0, |bucket| bucket + 1)).sum();
        f64::from(late) * 1e5 / f64::from(self.answers().max(1))
    }

    fn line(&self, who: &str) -> String {
        let mut line = format!("{who:<8}");
        for (limit, count) in BUCKETS.iter().zip(self.counts) {
            let _ = write!(line, " <={limit} us: {count},");
        }
        let _ = write!(line, " more: {}; {:.1} late in 100000", self.counts[BUCKETS.len()], self.late());
        line
    }
}

/// Late answers of the program for 100000, less those of the echo.
pub(crate) fn late_answers() -> Result<f64, String> {
    stay_on(PROCESSORS)?;
    let file = tempfile::Builder::new().suffix(".toml").tempfile();
    let file = file.map_err(|error| format!("There is no place for a scenario: {error}."))?;
    let path = file.path().to_str().ok_or("The place for a scenario has a strange name.")?;
    fs::write(path, scenario()).map_err(|error| format!("{path}: {error}."))?;
    let servers = [Server::encoder(&["run", path])?, Server::echo(usize::from(SEGMENTS))?];
    let started = Barrier::new(usize::from(SEGMENTS));
    let spent =
        |of: fn(&Server) -> Result<f64, String>| servers.iter().map(of).collect::<Result<Vec<_>, _>>();
    let before = spent(Server::on_processor)?;
    let both = thread::scope(|scope| {
        let ports = servers[0].buses.iter().zip(&servers[1].buses);
        let masters: Vec<_> = ports
            .enumerate()
            .map(|(number, (ours, theirs))| {
                let ports = [Port::open_for(ours, PATIENCE)?, Port::open_for(theirs, PATIENCE)?];
                let started = &started;
                Ok(scope.spawn(move || ask(number, ports, started)))
            })
            .collect::<Result<_, String>>()?;
        if masters.len() != usize::from(SEGMENTS) {
            return Err("The program does not name all of its segments.".to_owned());
        }
        let mut both = [Histogram::default(); 2];
        for master in masters {
            let found = master.join().map_err(|_| "A master has panicked.")??;
            both.iter_mut().zip(found).for_each(|(all, more)| all.join(&more));
        }
        Ok(both)
    })?;
    let after = spent(Server::on_processor)?;
    let span = (PERIOD * AT_A_TIME * TURNS).as_secs_f64();
    for ((histogram, who), spent) in both.iter().zip(["encoders", "echo"]).zip(after.iter().zip(before)) {
        eprintln!("{}", histogram.line(who));
        eprintln!("{who:<8} {:.0} % of a processor", (spent.0 - spent.1) / span * 100.0);
    }
    let own = clock_gettime(ClockId::ProcessCPUTime);
    eprintln!("masters  {} s of a processor, in {:.0} s", own.tv_sec, 2.0 * span);
    Ok(both[0].late() - both[1].late())
}

/// This process and those that it starts use so many processors.
fn stay_on(count: usize) -> Result<(), String> {
    let allowed = sched_getaffinity(None).map_err(no_places)?;
    let mut set = CpuSet::new();
    for processor in (0..CpuSet::MAX_CPU).filter(|&processor| allowed.is_set(processor)).take(count) {
        set.set(processor);
    }
    sched_setaffinity(None, &set).map_err(no_places)
}

/// The segments and their encoders.
fn scenario() -> String {
    let mut text = String::new();
    for segment in 1..=SEGMENTS {
        let _ = writeln!(text, "[[segment]]\nname = \"bus{segment}\"");
        for address in FIRST_ADDRESS..FIRST_ADDRESS + ENCODERS {
            let _ = write!(text, "[[segment.encoder]]\nname = \"encoder{address}\"\n");
            let _ = write!(text, "switches = \"{address:02X}\"\nshaft = \"constant:60\"\n");
        }
    }
    text
}

/// What one master sees on its two ports.
fn ask(number: usize, mut ports: [Port; 2], started: &Barrier) -> Result<[Histogram; 2], String> {
    // Without it the system wakes it up to 50 us late.
    let _ = set_current_timer_slack(NonZeroU64::new(1));
    let requests = bring_up(&mut ports[0]);
    // Whoever cannot go on does not let the others wait.
    started.wait();
    let requests = requests?;
    let mut both = [Histogram::default(); 2];
    // Masters know nothing of each other: theirs are spread over the period.
    let first = Instant::now() + PERIOD / u32::from(SEGMENTS) * u32::try_from(number).unwrap_or(0);
    let mut answer = [0; Functionality::Class2.answer()];
    for exchange in 0..2 * AT_A_TIME * TURNS {
        let due = first + PERIOD * exchange;
        let side = usize::from(exchange / AT_A_TIME % 2 == 1);
        let now = Instant::now();
        if now > due + PERIOD {
            // It was kept from asking; what it has missed is not made up for.
            continue;
        }
        thread::sleep(due.saturating_duration_since(now));
        let request = &requests[exchange as usize % requests.len()];
        let begun = Instant::now();
        let length = ports[side].ask(request.as_slice(), &mut answer)?;
        both[side].add(begun.elapsed());
        if length < answer.len() {
            ports[side].forget()?;
            continue;
        }
        let [from, to] = if side == 0 { [4, 5] } else { [5, 4] };
        if answer[0] != 0x68 || answer[from] != request.as_slice()[5] || answer[to] != request.as_slice()[4] {
            return Err(format!("{:02x?} is answered by {answer:02x?}.", request.as_slice()));
        }
    }
    Ok(both)
}

/// Sends a request until there is an answer of this length, as masters do.
fn insist(port: &mut Port, request: &[u8], length: usize) -> Result<(), String> {
    for _ in 0..ATTEMPTS {
        if port.ask(request, &mut [0; 255][..length])? == length {
            return Ok(());
        }
        port.forget()?;
    }
    Err(format!("No answer to {request:02x?}."))
}

/// Brings all encoders of a segment to data exchange; the requests that follow, for all of them in turn.
fn bring_up(port: &mut Port) -> Result<Vec<Octets>, String> {
    let addresses = FIRST_ADDRESS..FIRST_ADDRESS + ENCODERS;
    for address in addresses.clone() {
        for (request, length) in start_up_at(address, Functionality::Class2).iter().zip(START_UP_ANSWERS) {
            insist(port, request.as_slice(), length)?;
        }
    }
    let both = addresses.map(exchange_at);
    let [mut one, other]: [Vec<_>; 2] =
        both.fold([const { Vec::new() }; 2], |[mut one, mut other], [a, b]| {
            one.push(a);
            other.push(b);
            [one, other]
        });
    one.extend(other);
    Ok(one)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_after_200_us_is_late() {
        let mut histogram = Histogram::default();
        for micros in [15, 200, 201, 9_000] {
            histogram.add(Duration::from_micros(micros));
        }
        assert!((histogram.late() - 50_000.0).abs() < 1e-9);
        let line = histogram.line("echo");
        assert!(line.contains("<=20 us: 1, ") && line.contains("<=200 us: 1, <=500 us: 1, "), "{line}");
        assert!(line.ends_with("more: 1; 50000.0 late in 100000"), "{line}");
        histogram.join(&histogram.clone());
        assert_eq!(histogram.answers(), 8);
    }
}
