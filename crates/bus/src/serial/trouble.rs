//! What can be wrong with a serial device, and what the user can do about it.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::io::Errno;

use crate::end::EndError;
use crate::serial::Rates;
use crate::serial::settings::{self, Kind, Refusal};

/// Makes errors about one device.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trouble<'a> {
    path: &'a Path,
}

impl<'a> Trouble<'a> {
    pub(super) const fn new(path: &'a Path) -> Self {
        Self { path }
    }

    /// It cannot be opened, or not for oneself alone.
    pub(super) fn cannot_open(self, error: Errno) -> EndError {
        let remedy = match error {
            Errno::NOENT | Errno::NOTDIR => {
                "look for adapters that are there in /dev/serial/by-id, or plug it in".to_owned()
            }
            Errno::ACCESS | Errno::PERM => self.who_may(),
            Errno::BUSY => {
                return self.error(
                    "open",
                    io::Error::other("another program has it"),
                    format!("end that one (`fuser -v {}` names it)", self.path.display()),
                );
            }
            Errno::NOTTY | Errno::ISDIR => return self.no_terminal(),
            Errno::NXIO | Errno::NODEV | Errno::IO => NOTHING_BEHIND.to_owned(),
            _ => "check the device".to_owned(),
        };
        self.error("open", error.into(), remedy)
    }

    /// It is something else.
    pub(super) fn no_terminal(self) -> EndError {
        self.error(
            "use",
            io::Error::other("it is no serial device"),
            "write the path of one, like /dev/ttyUSB0, or of a pseudo terminal, like /dev/pts/4".to_owned(),
        )
    }

    /// The kernel has it.
    pub(super) fn console(self) -> EndError {
        self.error(
            "use",
            io::Error::other("the kernel writes its messages there"),
            "take its console= from the kernel's command line and start the computer again, or use another \
             device"
                .to_owned(),
        )
    }

    /// It does not take what a bus needs.
    pub(super) fn cannot_set(self, device: &OwnedFd, kind: Kind, refusal: Refusal) -> EndError {
        match refusal {
            Refusal::Failed(error @ Errno::IO) => {
                self.error("set up", error.into(), NOTHING_BEHIND.to_owned())
            }
            Refusal::Failed(error) => self.error("set up", error.into(), "check the device".to_owned()),
            Refusal::Rate { asked, made } => {
                let made = if made == 0 { String::new() } else { format!(" and makes {made} of it") };
                let why = format!("its driver refuses {} bit/s{made}", asked.bits_per_second());
                let possible = settings::possible_rates(device, kind);
                self.error("set up", io::Error::other(why), other_rates(possible))
            }
            Refusal::Parity => self.error(
                "set up",
                io::Error::other("its driver does not keep even parity"),
                "use an adapter that has it: PROFIBUS is 8E1".to_owned(),
            ),
            Refusal::Form => self.error(
                "set up",
                io::Error::other("its driver does not keep 8 data bits, 1 stop bit and marks for errors"),
                "use another adapter".to_owned(),
            ),
        }
    }

    /// It worked until now.
    pub(super) fn broken(self, step: &'static str, error: Errno) -> EndError {
        let remedy = match error {
            Errno::IO | Errno::NODEV | Errno::NXIO => {
                "was it unplugged, or has its program ended? See to that, and start again"
            }
            _ => "start again",
        };
        self.error(step, error.into(), remedy.to_owned())
    }

    fn error(self, step: &'static str, source: io::Error, remedy: String) -> EndError {
        EndError::Device { step, name: self.path.display().to_string(), source, remedy }
    }

    /// Who may open the device: the group that it belongs to, if that may.
    fn who_may(self) -> String {
        const READ_WRITE: u32 = 0o060;
        let Ok(found) = fs::metadata(self.path) else {
            return "check the rights of its directory".to_owned();
        };
        if found.mode() & READ_WRITE != READ_WRITE {
            return format!("only its owner (user {}) may open it: change its rights", found.uid());
        }
        let groups = fs::read_to_string("/etc/group").unwrap_or_default();
        match group_name(&groups, found.gid()) {
            Some(name) => {
                format!("it is for the group {name}: `sudo usermod -aG {name} $USER`, then log in again")
            }
            None => format!("it is for the group number {}: become a member of it", found.gid()),
        }
    }
}

const NOTHING_BEHIND: &str =
    "nothing is behind this name: the adapter was unplugged, or the computer has no such port";

fn other_rates(possible: Rates) -> String {
    if possible.is_empty() {
        return "it takes none of PROFIBUS's rates: use another adapter".to_owned();
    }
    format!("it takes {possible}: use one of these, or another adapter")
}

/// The name of a group in the text of /etc/group.
fn group_name(groups: &str, number: u32) -> Option<&str> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        let found = fields.nth(1)?.parse::<u32>().ok()?;
        (found == number && !name.is_empty()).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use profibus_dp::time::Baudrate;

    use super::*;

    #[test]
    fn a_group_is_found_by_its_number() {
        let groups = "root:x:0:\n\nbad line\ndialout:x:20:anna,bert\ntty:x:5:\n";
        assert_eq!(group_name(groups, 20), Some("dialout"));
        assert_eq!(group_name(groups, 5), Some("tty"));
        assert_eq!(group_name(groups, 2), None);
    }

    #[test]
    fn who_may_open_a_device_is_told_by_its_rights() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("device");
        fs::write(&path, "").unwrap();
        let found = fs::metadata(&path).unwrap();
        let groups = fs::read_to_string("/etc/group").unwrap_or_default();
        let due = group_name(&groups, found.gid())
            .map_or("become a member of it".to_owned(), |name| format!("usermod -aG {name} $USER"));
        for (mode, due) in [(0o660, due.as_str()), (0o600, "only its owner"), (0o640, "only its owner")] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            let text = Trouble::new(&path).cannot_open(Errno::ACCESS).to_string();
            assert!(text.contains("Permission denied") && text.contains(due), "{mode:o}: {text}");
        }
    }

    #[test]
    fn what_a_driver_does_not_keep_is_told_with_what_it_has() {
        // A pseudo terminal takes all rates, so these are what is left to choose from.
        let device = rustix::pty::openpt(rustix::pty::OpenptFlags::NOCTTY).unwrap();
        let trouble = Trouble::new(Path::new("/dev/ttyS9"));
        let refused = |made| Refusal::Rate { asked: Baudrate::B6000000, made };
        for (refusal, words) in [
            (refused(3_000_000), "its driver refuses 6000000 bit/s and makes 3000000 of it; it takes 9600, "),
            (refused(0), "its driver refuses 6000000 bit/s; it takes 9600, "),
            (Refusal::Parity, "its driver does not keep even parity; use an adapter that has it"),
            (Refusal::Form, "8 data bits"),
            (Refusal::Failed(Errno::IO), "the computer has no such port"),
        ] {
            let text = trouble.cannot_set(&device, Kind::PseudoTerminal, refusal).to_string();
            assert!(text.starts_with("cannot set up /dev/ttyS9: ") && text.contains(words), "{text}");
        }
    }

    #[test]
    fn each_trouble_has_its_remedy() {
        let trouble = Trouble::new(Path::new("/dev/ttyUSB9"));
        for (error, words) in [
            (Errno::NOENT, "/dev/serial/by-id"),
            (Errno::BUSY, "`fuser -v /dev/ttyUSB9`"),
            (Errno::NXIO, "unplugged"),
            (Errno::NOTTY, "it is no serial device; write the path of one"),
        ] {
            let text = trouble.cannot_open(error).to_string();
            assert!(text.contains("/dev/ttyUSB9: ") && text.contains(words), "{text}");
        }
        assert_eq!(
            other_rates([Baudrate::B9600, Baudrate::B19200].into_iter().collect()),
            "it takes 9600, 19200: use one of these, or another adapter"
        );
        assert!(other_rates(Rates::default()).contains("none of PROFIBUS's rates"));
    }
}
