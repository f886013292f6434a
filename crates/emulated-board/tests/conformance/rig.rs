//! The board as a rig of the slave checks, its clock in the tester's hand: nothing depends on how fast this computer is.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration as Time;

use conformance::rig::{Abilities, Battery as Cell, Fresh, Heard};
use conformance::{Action, Expect, Hand, Order, Rig, RigError, Signal};
use emulated_board::{Board, EmulatorError, Setup, Stepped};
use plant::{Shaft, World};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use sch108bex::health::Battery;
use sch108bex::specification::Variant;

/// No reply within this time is silence; and the longest that one takes on the busiest computer.
const SILENCE: Time = Time::from_millis(25);
const PATIENCE: Time = Time::from_secs(5);

/// The board, and the master's end of its bus.
#[derive(Debug)]
pub(crate) struct BoardRig {
    stepped: Stepped,
    bus: UnixStream,
    /// Octets that nobody has listened after: they may still be on their way.
    unheard: u32,
}

fn failed(error: &EmulatorError) -> RigError {
    RigError::Control(error.to_string())
}

impl BoardRig {
    pub(crate) fn start([program, image]: [PathBuf; 2]) -> Self {
        let board = Board::start(&Setup { program, image, bus: None }).expect("an emulated board");
        let bus = UnixStream::connect(board.bus()).expect("the board's bus");
        bus.set_write_timeout(Some(PATIENCE)).expect("a time limit");
        Self { stepped: Stepped::new(board, Variant::FULL, World::default().0), bus, unheard: 0 }
    }

    /// A latch is an idle line: what was sent has to be there before it.
    fn settle(&mut self) {
        /// More than the emulator takes for an octet.
        const OCTET: Time = Time::from_micros(200);
        if self.unheard > 0 {
            std::thread::sleep(SILENCE + OCTET * std::mem::take(&mut self.unheard));
        }
    }

    fn write(&mut self, octets: &[u8]) {
        self.unheard += u32::try_from(octets.len()).expect("few octets");
        self.bus.write_all(octets).expect("the board's bus");
    }

    /// Octets that came, until a telegram is whole or nothing has come for `first`.
    fn read(&mut self, first: Time) -> Vec<u8> {
        let mut octets = Vec::new();
        let mut buffer = [0; 512];
        self.bus.set_read_timeout(Some(first)).expect("a time limit");
        while length(&octets).is_none_or(|length| octets.len() < length) {
            match self.bus.read(&mut buffer) {
                Ok(0) | Err(_) => break,
                Ok(count) => octets.extend_from_slice(&buffer[..count]),
            }
        }
        octets
    }

    /// The bits of the record of the operating time, while the power is off.
    fn operate(&mut self, tenths: u64) -> Result<(), EmulatorError> {
        /// A tenth of an hour.
        const STEP_MS: u64 = 360_000;
        self.stepped.cut()?;
        self.stepped.set_operating_time(tenths * STEP_MS)?;
        self.stepped.power_on()
    }

    fn perform(&mut self, action: &Action) -> Result<(), EmulatorError> {
        let stepped = &mut self.stepped;
        match *action {
            Action::PowerOff => return stepped.cut(),
            Action::PowerOn => return stepped.power_on(),
            Action::OperatingTime(tenths) => return self.operate(tenths),
            Action::Switches(switches) => stepped.switches = switches,
            Action::Shaft(raw) => stepped.shaft = Shaft::still(raw),
            Action::Turn(rpm) => {
                let now = stepped.now();
                let here = stepped.shaft.at(now, stepped.variant);
                stepped.shaft = Shaft::constant(rpm, 0, Instant::ZERO).from(here).started(now);
            }
            Action::PositionError => {
                stepped.sensor_fault = true;
                stepped.step()?;
                stepped.sensor_fault = false;
            }
            Action::Supply(tenths) => stepped.measurement.supply_mv = tenths * 100,
            Action::Temperature(tenths) => stepped.measurement.temperature_tenths = tenths,
            Action::Light(ok) => stepped.measurement.light_ok = ok,
            Action::Battery(cell) => {
                stepped.measurement.battery = match cell {
                    Cell::Ok => Battery::Ok,
                    Cell::Low => Battery::Low,
                    Cell::Empty => Battery::Empty,
                };
            }
        }
        let powered = World(stepped.measurement).is_powered();
        match (stepped.board().is_powered(), powered) {
            (true, false) => stepped.cut(),
            (true, true) => stepped.step(),
            _ => Ok(()),
        }
    }
}

/// How long the telegram will be that these octets begin; `None`: that is not known yet.
fn length(octets: &[u8]) -> Option<usize> {
    match *octets {
        [0xE5, ..] => Some(1),
        [0x10, ..] => Some(6),
        [0xA2, ..] => Some(14),
        [0x68, length, ..] => Some(usize::from(length) + 6),
        _ => None,
    }
}

impl Rig for BoardRig {
    fn abilities(&self) -> Abilities {
        Abilities { exact_time: false, line_errors: false, stream: false, rates: false }
    }

    fn has(&self, _: Hand) -> bool {
        true
    }

    fn fresh(&mut self, order: &Order) -> Result<Fresh, RigError> {
        let stepped = &mut self.stepped;
        if stepped.board().is_powered() {
            stepped.cut().map_err(|error| failed(&error))?;
        }
        stepped.deliver();
        stepped.measurement = World::default().0;
        stepped.shaft = Shaft::still(0);
        stepped.sensor_fault = false;
        stepped.switches = order.address.unwrap_or(126);
        stepped.power_on().map_err(|error| failed(&error))?;
        self.read(Time::from_millis(1));
        Ok(Fresh::Delivered)
    }

    fn send(&mut self, signals: &[Signal]) -> Result<(), RigError> {
        // A request needs an idle line before it: a latch is one.
        self.settle();
        self.stepped.step().map_err(|error| failed(&error))?;
        let mut octets = Vec::new();
        for signal in signals {
            match *signal {
                Signal::Octet(octet) | Signal::Damaged(octet) => octets.push(octet),
                // Shorter than what ends a telegram, and than a latch.
                Signal::Read => {}
                Signal::Pause(bits) if bits < BitTimes::SYN => {}
                Signal::Pause(bits) => {
                    self.write(&std::mem::take(&mut octets));
                    self.settle();
                    let pause = self.rate().duration(bits);
                    self.stepped.wait(pause).map_err(|error| failed(&error))?;
                    self.stepped.step().map_err(|error| failed(&error))?;
                }
            }
        }
        self.write(&octets);
        Ok(())
    }

    fn listen(&mut self, expect: Expect) -> Result<Heard, RigError> {
        let first = if expect == Expect::Reply { PATIENCE } else { SILENCE };
        let octets = self.read(first);
        // Who answers has heard it all, and so has who was silent for that long.
        self.unheard = 0;
        Ok(Heard { octets, delay: None, damaged: false })
    }

    fn wait(&mut self, span: Duration) -> Result<Vec<u8>, RigError> {
        self.settle();
        self.stepped.wait(span).map_err(|error| failed(&error))?;
        Ok(self.read(Time::from_millis(1)))
    }

    fn set_rate(&mut self, _: Baudrate) -> Result<(), RigError> {
        Ok(())
    }

    fn rate(&self) -> Baudrate {
        Baudrate::B12000000
    }

    fn act(&mut self, action: &Action) -> Result<(), RigError> {
        self.settle();
        self.perform(action).map_err(|error| failed(&error))
    }
}
