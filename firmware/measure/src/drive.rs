//! Drives the image in lock-step: power, latches, telegrams.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// What an octet on the bus is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Of a telegram for another station, from SA on, but not the last: whose it is is known.
    Foreign,
    /// The last of one.
    ForeignLast,
    /// Of a telegram for us, or not yet known whose, but not the last.
    Own,
    /// The last of a Data_Exchange.
    Exchange,
    /// The last of another telegram for us.
    Other,
}

const ADDRESS: u8 = 42;
const MASTER: u8 = 2;
/// From latch to latch at 3000 revolutions a minute.
const STEP: i64 = 1638;
/// Latches and exchanges of each functionality: two windows of velocity, and some.
const EXCHANGES: usize = 450;
const LIMIT: Duration = Duration::from_secs(100);
const UNITS: u32 = 3_600;
const RANGE: u32 = 100_000_000;

struct Qemu(Child);

impl Drop for Qemu {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs the image and returns what each octet was that was sent to it; the log is in `folder`.
pub(crate) fn run(image: &str, folder: &Path) -> Result<Vec<Kind>, String> {
    let path = |name: &str| folder.join(name).display().to_string();
    let mut command = Command::new("qemu-system-arm");
    command.args([
        "-M",
        "netduinoplus2",
        "-nographic",
        "-monitor",
        "none",
        "-accel",
        "tcg,one-insn-per-tb=on",
    ]);
    command.args(["-d", "exec,nochain,int", "-D", &path("log"), "-trace", "stm32f2xx_usart_*"]);
    for name in ["bus", "world"] {
        command.arg("-serial").arg(format!("unix:{},server=on,wait=off", path(name)));
    }
    command.args(["-kernel", image]).stdin(Stdio::null());
    let qemu = Qemu(command.spawn().map_err(|error| format!("qemu-system-arm: {error}."))?);
    let mut bench = Bench {
        bus: connect(&folder.join("bus"))?,
        world: connect(&folder.join("world"))?,
        sent: Vec::new(),
        shaft: 0,
        until: Instant::now() + LIMIT,
    };
    bench.hello()?;
    for (parameters, configuration, inputs) in [(25, &[0xF1][..], 4), (26, &[0xF1, 0xD1, 0xD1][..], 12)] {
        bench.session(parameters, configuration, inputs)?;
    }
    drop(qemu);
    Ok(bench.sent)
}

fn connect(path: &Path) -> Result<UnixStream, String> {
    for _ in 0..200 {
        if let Ok(stream) = UnixStream::connect(path) {
            stream.set_read_timeout(Some(Duration::from_secs(20))).map_err(|error| error.to_string())?;
            return Ok(stream);
        }
        sleep(Duration::from_millis(20));
    }
    Err(format!("QEMU does not open {}.", path.display()))
}

struct Bench {
    bus: UnixStream,
    world: UnixStream,
    sent: Vec<Kind>,
    shaft: i64,
    until: Instant,
}

impl Bench {
    fn hello(&mut self) -> Result<(), String> {
        let short = Some(Duration::from_millis(50));
        let _ = self.world.set_read_timeout(short);
        for number in 0..200 {
            self.world.write_all(&frame(b'H', &[number])).map_err(|error| error.to_string())?;
            let mut answer = [0; 4];
            if self.world.read_exact(&mut answer).is_ok() && answer[2] == number {
                let _ = self.world.set_read_timeout(Some(Duration::from_secs(20)));
                return Ok(());
            }
        }
        Err("The image does not answer on the world link.".into())
    }

    fn tell(&mut self, kind: u8, payload: &[u8]) -> Result<(), String> {
        let lost = |error| format!("The image says nothing on the world link: {error}.");
        if Instant::now() > self.until {
            return Err("The measurement takes too long.".into());
        }
        self.world.write_all(&frame(kind, payload)).map_err(lost)?;
        loop {
            let mut head = [0; 2];
            self.world.read_exact(&mut head).map_err(lost)?;
            let mut rest = vec![0; if head[1] == b'N' { 42 } else { 7 }];
            self.world.read_exact(&mut rest).map_err(lost)?;
            if head[1] == b'A' {
                return Ok(());
            }
        }
    }

    fn latch(&mut self) -> Result<(), String> {
        self.shaft += STEP;
        let mut payload = self.shaft.to_le_bytes().to_vec();
        payload.extend(24_000_i32.to_le_bytes());
        payload.extend(200_i16.to_le_bytes());
        payload.push(0);
        self.tell(b'L', &payload)
    }

    /// Power, start-up, exchanges, and telegrams for others between.
    fn session(&mut self, parameters: usize, configuration: &[u8], inputs: usize) -> Result<(), String> {
        self.tell(b'P', &[0b11, ADDRESS, 9, 0, 16, 15])?;
        self.latch()?;
        // Scaling, counter-clockwise, time base RPM, the watchdog at 100 s: all that costs most.
        let mut prm = vec![0x88, 100, 100, 11, 0x10, 0x8B, 0, 0, 0x0B];
        prm.extend(UNITS.to_be_bytes());
        prm.extend(RANGE.to_be_bytes());
        prm.resize(25, 0);
        prm.push(3);
        prm.truncate(parameters);
        self.ask(&sd2(ADDRESS, 0x6D, &[60, 62], &[]), 22, Kind::Other)?;
        self.ask(&sd2(ADDRESS, 0x5D, &[61, 62], &prm), 1, Kind::Other)?;
        self.ask(&sd2(ADDRESS, 0x7D, &[62, 62], configuration), 1, Kind::Other)?;
        self.ask(&sd2(ADDRESS, 0x5D, &[60, 62], &[]), 68, Kind::Other)?;
        for round in 0..EXCHANGES {
            self.latch()?;
            let fc = [0x7D, 0x5D][round % 2];
            self.ask(&sd2(ADDRESS, fc, &[], &[0; 4]), 9 + inputs, Kind::Exchange)?;
            if round % 50 == 0 {
                self.foreign(&sd1(ADDRESS + 1, 0x49))?;
                self.foreign(&sd2(ADDRESS + 1, 0x5D, &[], &[0x55; 20]))?;
                self.foreign(&sd2(ADDRESS + 1, 0x5D, &[61, 62], &[0x55; 26]))?;
            }
        }
        self.foreign(&sd2(ADDRESS + 1, 0x5D, &[], &[0x55; 246]))
    }

    fn send(&mut self, octets: &[u8]) -> Result<(), String> {
        self.bus.write_all(octets).map_err(|error| format!("The bus: {error}."))
    }

    fn ask(&mut self, octets: &[u8], reply: usize, last: Kind) -> Result<(), String> {
        self.send(octets)?;
        self.sent.extend(std::iter::repeat_n(Kind::Own, octets.len() - 1));
        self.sent.push(last);
        let mut answer = vec![0; reply];
        self.bus.read_exact(&mut answer).map_err(|error| format!("No reply of {reply} octets: {error}."))
    }

    /// Nothing comes back; the next latch waits until it has been read.
    fn foreign(&mut self, octets: &[u8]) -> Result<(), String> {
        self.send(octets)?;
        // Short ones could lack a SAP and are kept like our own.
        let known = if octets[0] == 0x68 { 5 } else { octets.len() - 1 };
        for place in 0..octets.len() {
            self.sent.push(match place {
                _ if place + 1 == octets.len() => Kind::ForeignLast,
                _ if place < known => Kind::Own,
                _ => Kind::Foreign,
            });
        }
        // A reply to the next question shows that it has been heard to its end.
        self.ask(&sd1(ADDRESS, 0x49), 6, Kind::Other)
    }
}

fn frame(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xA5, kind];
    frame.extend(payload);
    let sum = frame[1..].iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    frame.push(sum.wrapping_neg());
    frame
}

fn sd1(da: u8, fc: u8) -> Vec<u8> {
    vec![0x10, da, MASTER, fc, da.wrapping_add(MASTER).wrapping_add(fc), 0x16]
}

fn sd2(da: u8, fc: u8, saps: &[u8], data: &[u8]) -> Vec<u8> {
    let extension = if saps.is_empty() { 0 } else { 0x80 };
    let mut body = vec![da | extension, MASTER | extension, fc];
    body.extend(saps);
    body.extend(data);
    let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    let length = u8::try_from(body.len()).unwrap_or(u8::MAX);
    let mut octets = vec![0x68, length, length, 0x68];
    octets.extend(body);
    octets.extend([sum, 0x16]);
    octets
}
