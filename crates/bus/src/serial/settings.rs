//! What a serial device is set to, and whether it has taken that.

use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;

use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::Baudrate;
use rustix::fs::{major, minor};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, SpecialCodeIndex, Termios, tcflush, tcgetattr,
    tcsetattr,
};

use crate::serial::Rates;

/// So far may a rate be off, in thousandths. Two UARTs still understand each other at twice that.
const TOLERANCE: u64 = 15;

/// After so long a pause in the octets the other side of a pseudo terminal looks at the rate.
const SEEN: std::time::Duration = std::time::Duration::from_millis(1);

/// What kind of device it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A UART of the computer or behind USB.
    Uart,
    /// The terminal side of a pseudo terminal: no parity, and any rate.
    PseudoTerminal,
}

/// What a device did not take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// The settings cannot be read or written at all.
    Failed(Errno),
    /// It made this rate of it, in bits per second.
    Rate { asked: Baudrate, made: u32 },
    /// Even parity.
    Parity,
    /// Eight bits, one stop bit, no handshake, or marks for errors.
    Form,
}

impl Kind {
    /// What is at this path; opens nothing.
    pub(super) fn of(path: &Path) -> Result<Self, Errno> {
        /// The major numbers of the terminal sides of pseudo terminals: 136 to 143.
        const TERMINAL_SIDES: std::ops::Range<u32> = 136..144;
        let found = std::fs::metadata(path)
            .map_err(|error| error.raw_os_error().map_or(Errno::IO, Errno::from_raw_os_error))?;
        if !found.file_type().is_char_device() {
            return Err(Errno::NOTTY);
        }
        let pseudo = TERMINAL_SIDES.contains(&major(found.rdev()));
        Ok(if pseudo { Self::PseudoTerminal } else { Self::Uart })
    }
}

/// Whether the kernel writes its messages to this device.
pub(super) fn is_console(path: &Path) -> bool {
    let consoles = std::fs::read_to_string("/proc/consoles").unwrap_or_default();
    std::fs::metadata(path).is_ok_and(|found| names(&consoles, major(found.rdev()), minor(found.rdev())))
}

/// Whether a device is in the text of /proc/consoles, whose lines end with its numbers.
fn names(consoles: &str, major: u32, minor: u32) -> bool {
    let number = format!("{major}:{minor}");
    consoles.lines().any(|line| line.split_whitespace().next_back() == Some(&number))
}

/// Raw, 8E1, this rate, errors marked. All of it is read back. What was received before is thrown away.
pub(super) fn set_up(device: &OwnedFd, kind: Kind, rate: Baudrate) -> Result<(), Refusal> {
    let mut settings = tcgetattr(device).map_err(Refusal::Failed)?;
    settings.make_raw();
    settings.input_modes &= !(InputModes::IGNPAR | InputModes::IGNBRK | InputModes::BRKINT);
    settings.input_modes &= !(InputModes::IXOFF | InputModes::IXANY);
    settings.input_modes |= InputModes::INPCK | InputModes::PARMRK;
    settings.control_modes &= !(ControlModes::CSTOPB | ControlModes::PARODD | ControlModes::CMSPAR);
    settings.control_modes &= !ControlModes::CRTSCTS;
    settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL | ControlModes::PARENB;
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    apply(device, kind, settings, rate)
}

/// [`set_up`] with a rate that fits, which is returned along with those of the ten that the device
/// refuses; where only one is wanted, no others are tried.
pub(super) fn set_up_for(
    device: &OwnedFd,
    kind: Kind,
    baud: BaudSetting,
) -> Result<(Baudrate, Rates), Refusal> {
    let first = match baud {
        BaudSetting::Fixed(rate) => {
            return set_up(device, kind, rate).map(|()| (rate, Rates::default()));
        }
        BaudSetting::Search(first) => first,
    };
    match set_up(device, kind, first) {
        Ok(()) | Err(Refusal::Rate { .. }) => {}
        Err(refusal) => return Err(refusal),
    }
    let possible = possible_rates(device, kind);
    let rate = if possible.contains(first) { Some(first) } else { possible.iter().next_back() };
    let rate = rate.ok_or(Refusal::Rate { asked: first, made: 0 })?;
    set_up(device, kind, rate)?;
    Ok((rate, possible.others()))
}

/// The rates, of the ten, that a device takes. It is left at any of them.
pub(super) fn possible_rates(device: &OwnedFd, kind: Kind) -> Rates {
    let takes = |rate: &Baudrate| kind == Kind::PseudoTerminal || set_up(device, kind, *rate).is_ok();
    Baudrate::ALL.into_iter().filter(takes).collect()
}

fn apply(device: &OwnedFd, kind: Kind, mut wanted: Termios, rate: Baudrate) -> Result<(), Refusal> {
    let refused = |made| Refusal::Rate { asked: rate, made };
    wanted.set_speed(rate.bits_per_second()).map_err(|_| refused(0))?;
    match tcsetattr(device, OptionalActions::Now, &wanted) {
        Err(Errno::INVAL) => return Err(refused(0)),
        other => other.map_err(Refusal::Failed)?,
    }
    let found = tcgetattr(device).map_err(Refusal::Failed)?;
    judge(&found, kind, rate)?;
    tcflush(device, QueueSelector::IFlush).map_err(Refusal::Failed)?;
    if kind == Kind::PseudoTerminal {
        std::thread::sleep(SEEN);
    }
    Ok(())
}

/// Whether these are the settings of the bus.
fn judge(found: &Termios, kind: Kind, rate: Baudrate) -> Result<(), Refusal> {
    if [found.output_speed(), found.input_speed()].into_iter().any(|made| !is_close(made, rate)) {
        return Err(Refusal::Rate { asked: rate, made: found.output_speed() });
    }
    let modes = found.control_modes;
    if kind == Kind::Uart && (!modes.contains(ControlModes::PARENB) || modes.contains(ControlModes::PARODD)) {
        return Err(Refusal::Parity);
    }
    let form = modes & ControlModes::CSIZE == ControlModes::CS8
        && !modes.intersects(ControlModes::CSTOPB | ControlModes::CRTSCTS)
        && found.input_modes.contains(InputModes::INPCK | InputModes::PARMRK);
    if form { Ok(()) } else { Err(Refusal::Form) }
}

fn is_close(made: u32, rate: Baudrate) -> bool {
    let (made, asked) = (u64::from(made), u64::from(rate.bits_per_second()));
    made.abs_diff(asked) * 1000 <= asked * TOLERANCE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a pseudo terminal has, as if it were the settings that a driver says it has.
    fn settings() -> Termios {
        let device = rustix::pty::openpt(rustix::pty::OpenptFlags::NOCTTY).unwrap();
        set_up(&device, Kind::PseudoTerminal, Baudrate::B500000).unwrap();
        tcgetattr(&device).unwrap()
    }

    #[test]
    fn each_setting_that_a_driver_does_not_keep_is_found() {
        let rate = Baudrate::B500000;
        let found = settings();
        assert_eq!(judge(&found, Kind::PseudoTerminal, rate), Ok(()));
        assert_eq!(judge(&found, Kind::Uart, rate), Err(Refusal::Parity));
        let mut even = found;
        even.control_modes |= ControlModes::PARENB;
        assert_eq!(judge(&even, Kind::Uart, rate), Ok(()));
        let changed = |change: &dyn Fn(&mut Termios)| {
            let mut settings = even.clone();
            change(&mut settings);
            judge(&settings, Kind::Uart, rate)
        };
        assert_eq!(changed(&|s| s.control_modes |= ControlModes::PARODD), Err(Refusal::Parity));
        assert_eq!(changed(&|s| s.control_modes |= ControlModes::CSTOPB), Err(Refusal::Form));
        assert_eq!(changed(&|s| s.control_modes |= ControlModes::CRTSCTS), Err(Refusal::Form));
        assert_eq!(
            changed(&|s| s.control_modes -= ControlModes::CS8 - ControlModes::CS7),
            Err(Refusal::Form)
        );
        assert_eq!(changed(&|s| s.input_modes -= InputModes::INPCK), Err(Refusal::Form));
        assert_eq!(changed(&|s| s.input_modes -= InputModes::PARMRK), Err(Refusal::Form));
        let other = changed(&|s| s.set_speed(460_800).unwrap());
        assert_eq!(other, Err(Refusal::Rate { asked: rate, made: 460_800 }));
    }

    #[test]
    fn consoles_are_found_by_their_numbers() {
        let consoles =
            "tty0                 -WU (EC  p  )    4:1\nttyS0                -W- (EC  p a)    4:64\n";
        assert!(names(consoles, 4, 64) && names(consoles, 4, 1));
        assert!(!names(consoles, 4, 6) && !names(consoles, 64, 4) && !names("", 4, 64));
    }

    #[test]
    fn a_search_takes_what_the_device_has() {
        let device = rustix::pty::openpt(rustix::pty::OpenptFlags::NOCTTY).unwrap();
        let search = BaudSetting::Search(Baudrate::B19200);
        let taken = set_up_for(&device, Kind::PseudoTerminal, search);
        assert_eq!(taken, Ok((Baudrate::B19200, Rates::default())));
        // As a UART it keeps no parity, whatever the rate.
        assert_eq!(set_up_for(&device, Kind::Uart, search), Err(Refusal::Parity));
    }

    #[test]
    fn a_rate_that_is_off_by_more_than_one_and_a_half_percent_is_refused() {
        for (made, rate, close) in [
            (500_000, Baudrate::B500000, true),
            // 3 MHz / 66
            (45_455, Baudrate::B45450, true),
            // 1.8432 MHz / 16 / 1, the nearest that a classic UART has
            (115_200, Baudrate::B93750, false),
            (9_744, Baudrate::B9600, true),
            (9_745, Baudrate::B9600, false),
            (9_455, Baudrate::B9600, false),
            (0, Baudrate::B9600, false),
        ] {
            assert_eq!(is_close(made, rate), close, "{made} for {rate}");
        }
    }
}
