//! The emulator as a process: started with an image, ended by its id.

use std::io;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use tempfile::TempDir;

/// The emulator's program.
pub const QEMU: &str = "qemu-system-arm";
/// The board whose part is an STM32F405.
const MACHINE: &str = "netduinoplus2";
/// How long the emulator may take until its sockets are there.
const START: Duration = Duration::from_secs(10);
/// What the emulator lives for at most, whatever becomes of this program; in seconds.
const LIFE: &str = "3600";

/// Why there is no emulated board.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The emulator does not run.
    #[error("cannot start {0}: {1}; install QEMU for ARM, on Debian: apt-get install qemu-system-arm")]
    NotStarted(PathBuf, io::Error),
    /// There is no image.
    #[error("{0} is not there; make it with: cargo xtask firmware")]
    NoImage(PathBuf),
    /// It has ended by itself.
    #[error("the emulator has ended: {0}")]
    Ended(String),
    /// A socket of the emulator cannot be used.
    #[error("the emulator's {0}: {1}")]
    Socket(&'static str, io::Error),
    /// What is around the board cannot be had.
    #[error("the board's world: {0}")]
    World(String),
    /// The firmware does not do what it has to.
    #[error("the firmware {0}")]
    Firmware(String),
}

/// A running emulator. Dropping it ends it.
#[derive(Debug)]
pub struct Emulator {
    child: Child,
    /// Where the sockets are.
    folder: TempDir,
    bus: PathBuf,
}

/// What to start.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The emulator.
    pub program: PathBuf,
    /// The image for the F405.
    pub image: PathBuf,
    /// Where the bus is to be; `None`: in a folder of its own.
    pub bus: Option<PathBuf>,
}

impl Emulator {
    /// Starts it and connects to its world link.
    ///
    /// # Errors
    ///
    /// It is not there, or does not come up.
    pub fn start(setup: &Setup) -> Result<(Self, UnixStream), EmulatorError> {
        if !setup.image.is_file() {
            return Err(EmulatorError::NoImage(setup.image.clone()));
        }
        let not_started = |error| EmulatorError::NotStarted(setup.program.clone(), error);
        let folder = tempfile::Builder::new().prefix("sch108bex-board-").tempdir().map_err(not_started)?;
        let bus = setup.bus.clone().unwrap_or_else(|| folder.path().join("bus"));
        let listening = |path: &Path| format!("unix:{},server=on,wait=off", path.display());
        let mut command = Command::new("timeout");
        // The emulator does not always end when asked to: `-k` makes it.
        command.args(["-k", "2", LIFE]).arg(&setup.program);
        command.args(["-machine", MACHINE, "-nographic", "-monitor", "none"]);
        command.arg("-serial").arg(listening(&bus));
        let world = folder.path().join("world");
        command.arg("-serial").arg(listening(&world));
        command.arg("-kernel").arg(&setup.image);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).process_group(0);
        let child = command.spawn().map_err(not_started)?;
        let mut emulator = Self { child, folder, bus };
        let world = emulator.connect("world link", &world)?;
        Ok((emulator, world))
    }

    /// The socket that a master connects to.
    pub fn bus(&self) -> &Path {
        &self.bus
    }

    /// Connects to one of the emulator's sockets, once it is there.
    fn connect(&mut self, name: &'static str, path: &Path) -> Result<UnixStream, EmulatorError> {
        let until = Instant::now() + START;
        loop {
            match UnixStream::connect(path) {
                Ok(stream) => return Ok(stream),
                Err(error) if Instant::now() > until => return Err(EmulatorError::Socket(name, error)),
                Err(_) => self.expect_life()?,
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn expect_life(&mut self) -> Result<(), EmulatorError> {
        use io::Read as _;
        if !matches!(self.child.try_wait(), Ok(Some(_))) {
            return Ok(());
        }
        let mut told = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            let _ = stderr.read_to_string(&mut told);
        }
        Err(EmulatorError::Ended(told.trim().to_owned()))
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // `timeout` has made a group of its own and is its leader; the emulator is in it.
        if let Some(group) = Pid::from_raw(self.child.id().cast_signed()) {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.child.wait();
        if !self.bus.starts_with(self.folder.path()) {
            let _ = std::fs::remove_file(&self.bus);
        }
    }
}
