//! What the adapter of a serial device does besides carrying octets: switch the transmitter of RS-485,
//! and keep what it has received.

use std::fmt;
use std::fs;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rustix::fs::{fstat, major, minor};
use serial2::SerialPort;
use serial2::rs4xx::{Rs485Config, TransceiverMode};

use crate::end::Note;

/// How long an adapter may keep what it has received before it hands it over. Prints as a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latency {
    /// The shortest there is, in milliseconds; before it was another.
    Shortened {
        /// In milliseconds.
        from: u32,
    },
    /// The shortest there is already.
    Short,
    /// So many milliseconds, and this program may not change it.
    Long(u32),
    /// The driver has no such setting.
    NoSetting,
}

/// The shortest time, in milliseconds, that adapters take.
const SHORTEST: u32 = 1;

impl fmt::Display for Latency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shortened { from } => {
                write!(f, "the adapter keeps octets for {SHORTEST} ms at most; before it was {from} ms")
            }
            Self::Short => write!(f, "the adapter keeps octets for {SHORTEST} ms at most"),
            Self::Long(now) => write!(
                f,
                "the adapter keeps octets for up to {now} ms, and only root may change that: \
                 echo {SHORTEST} | sudo tee /sys/bus/usb-serial/devices/ttyUSB.../latency_timer"
            ),
            Self::NoSetting => f.write_str("the driver has no latency setting"),
        }
    }
}

/// The RS-485 mode of a driver, put back to what it was at the end.
#[derive(Debug)]
pub(super) struct Rs485 {
    port: SerialPort,
    before: TransceiverMode,
}

impl Rs485 {
    /// Switches the mode on. `None`: the driver has none.
    pub(super) fn switch_on(device: &OwnedFd) -> Option<Self> {
        let port = SerialPort::from(device.try_clone().ok()?);
        let before = port.get_rs4xx_mode().ok()?;
        // Somebody who knows the board has set it up.
        if matches!(before, TransceiverMode::Default) {
            // Two wires: what is sent is not heard.
            port.set_rs4xx_mode(Rs485Config::new()).ok()?;
        }
        matches!(port.get_rs4xx_mode(), Ok(TransceiverMode::Rs485(_))).then_some(Self { port, before })
    }
}

impl Drop for Rs485 {
    fn drop(&mut self) {
        // An adapter that has gone has no mode any more.
        let _ = self.port.set_rs4xx_mode(self.before.clone());
    }
}

/// What there is to say about an adapter, whose latency is made as short as it can be.
pub(super) fn notes(device: &OwnedFd, rs485: Option<&Rs485>) -> [Note; 2] {
    let setting = latency_setting(device);
    let latency = setting.map_or(Latency::NoSetting, |path| shorten(&path));
    [Note::Rs485 { by_driver: rs485.is_some() }, Note::Latency(latency)]
}

/// Where the driver keeps the setting, if it has one: those of FTDI chips do.
fn latency_setting(device: &OwnedFd) -> Option<PathBuf> {
    let number = fstat(device).ok()?.st_rdev;
    let path = format!("/sys/dev/char/{}:{}/device/latency_timer", major(number), minor(number));
    Some(PathBuf::from(path)).filter(|path| path.exists())
}

fn shorten(setting: &Path) -> Latency {
    let now = || fs::read_to_string(setting).ok().and_then(|text| text.trim().parse::<u32>().ok());
    let Some(before) = now() else {
        return Latency::NoSetting;
    };
    if before <= SHORTEST {
        return Latency::Short;
    }
    // Where it is refused, that is what is told.
    let _ = fs::write(setting, SHORTEST.to_string());
    match now() {
        Some(after) if after > SHORTEST => Latency::Long(after),
        _ => Latency::Shortened { from: before },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latency_is_made_short_and_what_came_of_it_is_told() {
        let directory = tempfile::tempdir().unwrap();
        let setting = directory.path().join("latency_timer");
        assert_eq!(shorten(&setting), Latency::NoSetting);
        fs::write(&setting, "16\n").unwrap();
        assert_eq!(shorten(&setting), Latency::Shortened { from: 16 });
        assert_eq!(fs::read_to_string(&setting).unwrap(), "1");
        assert_eq!(shorten(&setting), Latency::Short);
    }

    #[test]
    fn a_driver_that_has_neither_is_said_to_have_neither() {
        let device = rustix::pty::openpt(rustix::pty::OpenptFlags::NOCTTY).unwrap();
        let rs485 = Rs485::switch_on(&device);
        let notes = notes(&device, rs485.as_ref());
        assert_eq!(notes, [Note::Rs485 { by_driver: false }, Note::Latency(Latency::NoSetting)]);
        assert!(notes[0].to_string().contains("the adapter must switch its transmitter by itself"));
    }

    #[test]
    fn a_latency_that_stays_long_comes_with_the_command_that_shortens_it() {
        let text = Latency::Long(16).to_string();
        assert!(text.contains("16 ms") && text.contains("echo 1 | sudo tee"), "{text}");
    }
}
