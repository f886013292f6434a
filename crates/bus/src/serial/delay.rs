//! How late answers are through an adapter, before the first is given.
//!
//! | what an adapter on USB adds | up to |
//! |---|---|
//! | until what it has received is fetched | 1 ms, a frame of USB |
//! | until the answer is taken to it | 1 ms |
//! | what its chip waits for more octets | its latency setting, where the driver has one |
//!
//! What the computer needs to wake up comes on top. A UART of the computer itself has none of these.

use std::fmt;
use std::fs;
use std::path::Path;

use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, BitTimes, Duration};

use crate::virtual_segment::slot_time;

/// To an adapter and back.
const FRAMES: Duration = Duration::from_millis(2);

/// The longest slot time that a master can be given.
const LONGEST_SLOT: u32 = 16_383;

/// Answers can start later than max T_SDR, because of the adapter. Prints as a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Delay {
    /// So late at worst, after their request.
    pub up_to: Duration,
    /// How the encoders come to their rate.
    pub baud: BaudSetting,
}

impl Delay {
    /// What there is to warn of, at the rates that may come.
    ///
    /// `device`: what the system says of the device, such as /sys/dev/char/188:0. `latency`: the setting
    /// of its driver in milliseconds.
    pub(super) fn of(device: &Path, latency: Option<u32>, baud: BaudSetting) -> Option<Self> {
        let place = fs::canonicalize(device.join("device")).ok()?;
        if !is_on_usb(&place) {
            return None;
        }
        let up_to = FRAMES + Duration::from_millis(latency.unwrap_or(0).into());
        let may_be_late = match baud {
            BaudSetting::Fixed(rate) => up_to > rate.duration(rate.max_tsdr()),
            BaudSetting::Search(_) => true,
        };
        may_be_late.then_some(Self { up_to, baud })
    }

    /// The slot time that a master needs at this rate, if he can be given as much.
    pub fn slot_time(&self, rate: Baudrate) -> Option<BitTimes> {
        let bits = u128::from(self.up_to.as_nanos()) * u128::from(rate.bits_per_second());
        let needed = bits.div_ceil(1_000_000_000) + u128::from(BitTimes::CHARACTER.0);
        let needed = u32::try_from(needed).ok().filter(|needed| *needed <= LONGEST_SLOT)?;
        Some(BitTimes(needed.max(slot_time(rate).0)))
    }

    /// The highest rate at which answers are not later than max T_SDR.
    pub fn highest_rate(&self) -> Option<Baudrate> {
        Baudrate::ALL.into_iter().rev().find(|rate| self.up_to <= rate.duration(rate.max_tsdr()))
    }
}

impl fmt::Display for Delay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let millis = self.up_to.as_millis();
        write!(f, "warning: answers can take {millis} ms through this USB adapter: ")?;
        match self.baud {
            BaudSetting::Fixed(rate) => {
                let BitTimes(most) = rate.max_tsdr();
                write!(f, "max T_SDR at {rate} is {most} bit times, so ")?;
                match self.slot_time(rate) {
                    Some(BitTimes(slot)) => write!(f, "give the master a slot time of at least {slot}"),
                    None => f.write_str("no slot time is long enough; take a lower rate"),
                }
            }
            BaudSetting::Search(_) => match self.highest_rate() {
                Some(rate) => {
                    write!(f, "above {rate} give the master a longer slot time, as docs/serial.md has it")
                }
                None => f.write_str("give the master a longer slot time, as docs/serial.md has it"),
            },
        }
    }
}

/// Whether a device in /sys hangs on a bus of USB: one of its parents is usb1, usb2 and so on.
fn is_on_usb(place: &Path) -> bool {
    let mut parents = place.components().filter_map(|part| part.as_os_str().to_str());
    parents.any(|part| {
        part.strip_prefix("usb")
            .is_some_and(|number| !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit()))
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// What /sys has of a device: its folder is at this place below /sys/devices.
    fn delay(place: &str, latency: Option<u32>, baud: BaudSetting) -> Option<Delay> {
        let sys = tempfile::tempdir().unwrap();
        let place = sys.path().join("devices").join(place);
        let device = sys.path().join("188:0");
        fs::create_dir_all(&place).unwrap();
        fs::create_dir(&device).unwrap();
        symlink(&place, device.join("device")).unwrap();
        Delay::of(&device, latency, baud)
    }

    const FTDI: &str = "pci0000:00/0000:00:14.0/usb1/1-2/1-2:1.0/ttyUSB0";
    const ACM: &str = "platform/soc/3f980000.usb/usb12/12-1/12-1:1.0";
    /// A UART of the computer; on a board it may even be called so.
    const OWN: [&str; 2] = ["pnp0/00:05", "platform/usbserial.0/usb"];

    // 2 ms of USB and 1 ms, 16 ms or none of the chip. Max T_SDR: 60 bit times at 9600 are 6.25 ms and at
    // 19200 3.125 ms; 1.32 ms at 45450, 0.2 ms (100 bit times) at 500000.
    #[test]
    fn an_adapter_on_usb_is_warned_of_where_max_tsdr_is_shorter() {
        use Baudrate::{B9600, B19200, B45450, B500000, B12000000};
        for (place, latency, rate, millis) in [
            (FTDI, Some(1), B19200, None),
            (FTDI, Some(1), B45450, Some(3)),
            (FTDI, Some(16), B9600, Some(18)),
            (ACM, None, B19200, None),
            (ACM, None, B500000, Some(2)),
            (OWN[0], None, B12000000, None),
            (OWN[1], None, B12000000, None),
        ] {
            let found = delay(place, latency, BaudSetting::Fixed(rate));
            let due = millis.map(Duration::from_millis);
            assert_eq!(found.map(|delay| delay.up_to), due, "{place} {latency:?} {rate}");
        }
        assert_eq!(Delay::of(Path::new("/sys/dev/char/none"), None, BaudSetting::Fixed(B500000)), None);
    }

    // docs/serial.md, the table of slot times.
    #[test]
    fn a_warning_says_what_the_master_needs() {
        let fixed = |latency, rate| delay(FTDI, latency, BaudSetting::Fixed(rate)).unwrap();
        for (delay, words) in [
            (
                fixed(None, Baudrate::B500000),
                "answers can take 2 ms through this USB adapter: max T_SDR at 500 kbit/s is 100 bit times, so give the master a slot time of at least 1011",
            ),
            (
                fixed(Some(16), Baudrate::B9600),
                "18 ms through this USB adapter: max T_SDR at 9.6 kbit/s is 60 bit times, so give the master a slot time of at least 184",
            ),
            (fixed(Some(16), Baudrate::B1500000), "so no slot time is long enough; take a lower rate"),
        ] {
            assert!(delay.to_string().contains(words), "{delay}");
        }
        let searching =
            |latency| delay(FTDI, latency, BaudSetting::Search(Baudrate::B500000)).unwrap().to_string();
        assert!(
            searching(Some(1)).contains("above 19.2 kbit/s give the master a longer slot time"),
            "{}",
            searching(Some(1))
        );
        assert!(
            searching(Some(16))
                .contains("18 ms through this USB adapter: give the master a longer slot time")
        );
        assert_eq!(fixed(None, Baudrate::B45450).slot_time(Baudrate::B45450), Some(BitTimes(102)));
        assert_eq!(fixed(None, Baudrate::B45450).slot_time(Baudrate::B19200), Some(BitTimes(100)));
    }
}
