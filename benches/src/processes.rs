//! Figures of whole processes: the program as a user starts it, and the bare echo.

use std::env;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Instant;

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::median;
use crate::telegrams::{ADDRESS, Functionality, exchange, start_up};
use crate::tty::Port;

const STARTS: usize = 15;
const RUNS: usize = 9;
const TURNS: usize = 4000;
/// What the four telegrams of the start-up are answered with in class 2: the short diagnosis, E5, E5, the long one.
pub(crate) const START_UP_ANSWERS: [usize; 4] = [27, 1, 1, 68];

/// A process with PTYs, ended when this goes.
pub(crate) struct Server {
    process: Child,
    /// Kept open, so that the process can go on printing.
    _output: BufReader<ChildStdout>,
    /// Its PTYs, in the order in which it names them.
    pub(crate) buses: Vec<PathBuf>,
    /// From the start to `ready`.
    milliseconds: f64,
}

impl Server {
    /// Starts a program and waits for its `ready`.
    pub(crate) fn start(program: &Path, words: &[&str]) -> Result<Self, String> {
        let started = Instant::now();
        let mut command = Command::new(program);
        command.args(words).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut process = command.spawn().map_err(|error| format!("{}: {error}.", program.display()))?;
        let mut output = BufReader::new(process.stdout.take().ok_or("no standard output")?);
        let mut buses = Vec::new();
        loop {
            let mut line = String::new();
            let read =
                output.read_line(&mut line).map_err(|error| format!("{}: {error}.", program.display()))?;
            if read == 0 {
                let _ = process.kill();
                let _ = process.wait();
                return Err(format!("{} {} ended before it was ready.", program.display(), words.join(" ")));
            }
            match line.trim().split_once(": ") {
                Some((_, place)) if place.starts_with("/dev/") => buses.push(place.into()),
                _ if line.trim() == "ready" => break,
                _ => {}
            }
        }
        let milliseconds = started.elapsed().as_secs_f64() * 1e3;
        Ok(Self { process, _output: output, buses, milliseconds })
    }

    /// The program `sch108bex`, built into the same folder as this one.
    pub(crate) fn encoder(words: &[&str]) -> Result<Self, String> {
        Self::start(&own_path()?.with_file_name("sch108bex"), words)
    }

    /// The bare echo, on so many PTYs.
    pub(crate) fn echo(count: usize) -> Result<Self, String> {
        Self::start(&own_path()?, &["echo", &count.to_string()])
    }

    /// The only PTY.
    fn port(&self) -> Result<Port, String> {
        Port::open(self.buses.first().ok_or("The program names no PTY.")?)
    }

    /// How many seconds it has had a processor.
    pub(crate) fn on_processor(&self) -> Result<f64, String> {
        /// Ticks in a second, on every Linux.
        const TICKS: f64 = 100.0;
        let path = format!("/proc/{}/stat", self.process.id());
        let stat = fs::read_to_string(&path).map_err(|error| format!("{path}: {error}."))?;
        // The name of the program ends with the only parenthesis; utime is field 14, stime field 15.
        let fields = stat.rsplit_once(") ").map(|(_, fields)| fields.split(' ')).into_iter().flatten();
        let ticks: Vec<f64> = fields.skip(11).take(2).filter_map(|field| field.parse().ok()).collect();
        Ok(ticks.iter().sum::<f64>() / TICKS)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn own_path() -> Result<PathBuf, String> {
    env::current_exe().map_err(|error| format!("This program does not know its own place: {error}."))
}

/// `sch108bex run` from its start to `ready`, in milliseconds.
pub(crate) fn start_to_ready() -> Result<f64, String> {
    let times = (0..STARTS).map(|_| Server::encoder(&["run"]).map(|server| server.milliseconds));
    times.collect::<Result<_, _>>().map(median)
}

/// `sch108bex --help` from its start to its end, in milliseconds.
pub(crate) fn help() -> Result<f64, String> {
    let program = own_path()?.with_file_name("sch108bex");
    let once = |_| {
        let started = Instant::now();
        let status = Command::new(&program).arg("--help").stdout(Stdio::null()).status();
        match status {
            Ok(status) if status.success() => Ok(started.elapsed().as_secs_f64() * 1e3),
            Ok(status) => Err(format!("{} --help ended with {status}.", program.display())),
            Err(error) => Err(format!("{}: {error}.", program.display())),
        }
    };
    (0..STARTS).map(once).collect::<Result<_, _>>().map(median)
}

/// A Data_Exchange with `sch108bex run` over the same octets with a bare echo.
///
/// Where the system puts two processes that wake each other decides by itself over a factor of up to
/// eight, and stays as it is. So the master has one processor and its far side another, whichever of the
/// two that is.
pub(crate) fn round_trip_ratio() -> Result<f64, String> {
    let places = Places::of_this_machine()?;
    let (mut with_encoder, mut with_echo) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        with_encoder.push(encoder_turn(&places)?);
        with_echo.push(echo_turn(&places)?);
    }
    let (encoder, echo) = (median(with_encoder), median(with_echo));
    eprintln!("encoder {encoder:.2} us, echo {echo:.2} us");
    Ok(encoder / echo)
}

/// Which processors the two sides of a round trip have.
struct Places {
    master: CpuSet,
    far_side: CpuSet,
}

impl Places {
    /// One for each; where this process may use one only, that one for both.
    fn of_this_machine() -> Result<Self, String> {
        let allowed = sched_getaffinity(None).map_err(no_places)?;
        let mut usable = (0..CpuSet::MAX_CPU).filter(|&processor| allowed.is_set(processor));
        let first = usable.next().unwrap_or(0);
        let second = usable.next().unwrap_or(first);
        let only = |processor| {
            let mut set = CpuSet::new();
            set.set(processor);
            set
        };
        Ok(Self { master: only(first), far_side: only(second) })
    }

    /// Starts a far side in its place, and goes to the master's.
    fn start(&self, start: impl FnOnce() -> Result<Server, String>) -> Result<Server, String> {
        // What is started inherits the place of who starts it, with all its threads.
        sched_setaffinity(None, &self.far_side).map_err(no_places)?;
        let server = start();
        sched_setaffinity(None, &self.master).map_err(no_places)?;
        server
    }
}

pub(crate) fn no_places(error: rustix::io::Errno) -> String {
    format!("Processes cannot be kept on their processors: {error}.")
}

/// The median turn with an encoder, brought to data exchange before.
fn encoder_turn(places: &Places) -> Result<f64, String> {
    let switches = format!("{ADDRESS:02X}");
    let encoder =
        places.start(|| Server::encoder(&["run", "--switches", &switches, "--shaft", "constant:60"]))?;
    let mut port = encoder.port()?;
    let start_up = start_up(Functionality::Class2);
    for (request, length) in start_up.iter().zip(START_UP_ANSWERS) {
        port.turn(request.as_slice(), &mut [0; 255][..length])?;
    }
    median_turn(&mut port)
}

/// The median turn with a bare echo.
fn echo_turn(places: &Places) -> Result<f64, String> {
    let echo = places.start(|| Server::echo(1))?;
    median_turn(&mut echo.port()?)
}

/// The median of many turns, in microseconds.
fn median_turn(port: &mut Port) -> Result<f64, String> {
    let requests = exchange();
    // As long as the request: 4 inputs, 4 outputs.
    let mut answer = [0; Functionality::Class2.answer()];
    let mut times = Vec::with_capacity(TURNS);
    for request in requests.iter().cycle().take(TURNS) {
        let started = Instant::now();
        port.turn(request.as_slice(), &mut answer)?;
        times.push(started.elapsed().as_secs_f64() * 1e6);
    }
    Ok(median(times))
}
