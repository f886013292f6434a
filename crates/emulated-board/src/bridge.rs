//! Any port for the bus of a board: what comes in at the one end goes out at the other.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration as Time, Instant as Moment};

use bus::port::open_for_slaves;
use bus::{End, EndError, Event, PortAddress, SocketEnd};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::Duration;

/// While octets have come so lately, the other end is looked at often.
const BUSY: Time = Time::from_millis(50);
/// Between two looks then, and else.
const SOON: Duration = Duration::from_micros(100);
const LATER: Duration = Duration::from_millis(2);

/// A bridge from a port to the bus of a board. Dropping it ends it.
#[derive(Debug)]
pub struct Bridge {
    name: String,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bridge {
    /// Opens a port for masters, and carries octets between it and the board's socket at `bus`.
    ///
    /// # Errors
    ///
    /// The port or the socket cannot be had.
    pub fn start(port: &PortAddress, bus: &Path) -> Result<Self, EndError> {
        let near = open_for_slaves(port, BaudSetting::Fixed(bus::segment::DEFAULT_RATE))?;
        let far = SocketEnd::dial_unix(bus)?;
        let name = near.name().to_owned();
        let ended = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&ended);
        let thread = std::thread::Builder::new()
            .name("bridge".to_owned())
            .spawn(move || carry(near, Box::new(far), &seen))
            .map_err(|source| EndError::Broken { name: name.clone(), step: "serve", source })?;
        Ok(Self { name, ended, thread: Some(thread) })
    }

    /// What a master opens.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn carry(mut near: Box<dyn End>, mut far: Box<dyn End>, ended: &AtomicBool) {
    let mut lately: Option<Moment> = None;
    while !ended.load(Ordering::Relaxed) {
        let busy = lately.is_some_and(|at| at.elapsed() < BUSY);
        let pause = if busy { SOON } else { LATER };
        match (pass(&mut *near, &mut *far, pause), pass(&mut *far, &mut *near, pause)) {
            (Ok(false), Ok(false)) => {}
            (Ok(_), Ok(_)) => lately = Some(Moment::now()),
            // One of them is gone for good.
            _ => return,
        }
    }
}

/// Whether anything came from the one for the other.
fn pass(from: &mut dyn End, to: &mut dyn End, pause: Duration) -> Result<bool, EndError> {
    let mut octets = [0; 512];
    let Event::Octets(count) = from.wait(Some(pause), &mut octets)? else { return Ok(false) };
    // What nobody takes is lost, as on a line.
    let _ = to.write(&octets[..count])?;
    Ok(true)
}
