//! What the adapter of a serial device does besides carrying octets: switch the transmitter of RS-485,
//! and keep what it has received.

use std::fmt;
use std::fs;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use profibus_dp::fdl::BaudSetting;
use rustix::fs::{fstat, major, minor};
use serial2::SerialPort;
use serial2::rs4xx::{Rs485Config, TransceiverMode};

use crate::end::Note;
use crate::serial::delay::Delay;

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

/// What there is to say about an adapter, whose latency is made as short as it can be. `baud`: that of the
/// encoders behind it, who have to answer in time.
pub(super) fn notes(device: &OwnedFd, rs485: Option<&Rs485>, baud: Option<BaudSetting>) -> Vec<Note> {
    let mut notes = vec![Note::Rs485 { by_driver: rs485.is_some() }];
    notes.extend(on_latency(&in_sys(device), baud));
    notes
}

/// Where the system has what it knows of a device.
fn in_sys(device: &OwnedFd) -> PathBuf {
    let number = fstat(device).map_or(0, |found| found.st_rdev);
    PathBuf::from(format!("/sys/dev/char/{}:{}", major(number), minor(number)))
}

fn on_latency(device: &Path, baud: Option<BaudSetting>) -> Vec<Note> {
    // The drivers of FTDI chips have it.
    let setting = device.join("device/latency_timer");
    let latency = if setting.exists() { shorten(&setting) } else { Latency::NoSetting };
    let delay = baud.and_then(|baud| Delay::of(device, latency.millis(), baud));
    std::iter::once(Note::Latency(latency)).chain(delay.map(Note::Delay)).collect()
}

impl Latency {
    /// The setting as it is now.
    const fn millis(self) -> Option<u32> {
        match self {
            Self::Shortened { .. } | Self::Short => Some(SHORTEST),
            Self::Long(millis) => Some(millis),
            Self::NoSetting => None,
        }
    }
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
    use profibus_dp::time::{Baudrate, Duration};

    use super::*;

    // 2 ms of USB, and 1 ms of the chip once its 16 ms are gone: 1500 bit times at 500 kbit/s.
    #[test]
    fn encoders_behind_an_adapter_on_usb_are_warned_of_once_its_latency_is_short() {
        let sys = tempfile::tempdir().unwrap();
        let place = sys.path().join("usb1/1-2/1-2:1.0/ttyUSB0");
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join("latency_timer"), "16").unwrap();
        std::os::unix::fs::symlink(&place, sys.path().join("device")).unwrap();
        let baud = BaudSetting::Fixed(Baudrate::B500000);
        let delay = Delay { up_to: Duration::from_millis(3), baud };
        let shortened = Note::Latency(Latency::Shortened { from: 16 });
        assert_eq!(on_latency(sys.path(), Some(baud)), [shortened, Note::Delay(delay)]);
        assert!(Note::Delay(delay).to_string().ends_with("give the master a slot time of at least 1511"));
        assert_eq!(on_latency(sys.path(), None), [Note::Latency(Latency::Short)], "a master does not answer");
    }

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
        let notes = notes(&device, rs485.as_ref(), Some(BaudSetting::Fixed(Baudrate::B12000000)));
        assert_eq!(notes, [Note::Rs485 { by_driver: false }, Note::Latency(Latency::NoSetting)]);
        assert!(notes[0].to_string().contains("the adapter must switch its transmitter by itself"));
    }

    #[test]
    fn a_latency_that_stays_long_comes_with_the_command_that_shortens_it() {
        let text = Latency::Long(16).to_string();
        assert!(text.contains("16 ms") && text.contains("echo 1 | sudo tee"), "{text}");
    }
}
