//! The bare echo that the program's round trip is compared with.

use std::fs::File;
use std::io::{ErrorKind, Read, Write, stdout};
use std::thread;
use std::time::Duration;

use crate::tty;

/// Sends back what comes on so many PTYs of its own, until it is ended.
pub(crate) fn serve(count: usize) -> Result<(), String> {
    let ptys = (0..count).map(|_| tty::make_pty()).collect::<Result<Vec<_>, _>>()?;
    for (_, name) in &ptys {
        println!("bus: {name}");
    }
    println!("ready");
    stdout().flush().map_err(|error| format!("The names of the PTYs cannot be told: {error}."))?;
    let echoes: Vec<_> = ptys.into_iter().map(|(own, _)| thread::spawn(move || send_back(own))).collect();
    echoes.into_iter().try_for_each(|echo| echo.join().map_err(|_| "An echo has panicked.")?)
}

fn send_back(mut own: File) -> Result<(), String> {
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
