//! The bare echo that the program's round trip is compared with.

use std::io::{ErrorKind, Read, Write, stdout};
use std::thread;
use std::time::Duration;

use crate::tty;

/// Sends back what comes on a PTY of its own, until it is ended.
pub(crate) fn serve() -> Result<(), String> {
    let (mut own, name) = tty::make_pty()?;
    println!("bus: {name}\nready");
    stdout().flush().map_err(|error| format!("The PTY's name cannot be told: {error}."))?;
    let mut buffer = [0; 512];
    loop {
        match own.read(&mut buffer).and_then(|length| own.write_all(&buffer[..length])) {
            // Nobody has the other side open: EIO, which has no kind.
            Err(error) if error.raw_os_error().is_none() && error.kind() != ErrorKind::Interrupted => {
                return Err(format!("The echo ends: {error}."));
            }
            Err(_) => thread::sleep(Duration::from_millis(1)),
            Ok(()) => {}
        }
    }
}
