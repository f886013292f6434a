//! A virtual encoder and the emulated board, side by side on one clock: the line of a master who hears both.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration as Time;

use bus::{Answer, EndError, VirtualSegment};
use emulated_board::{Board, PowerOn, Setup, World as LinkWorld};
use master::line::ReplyBuffer;
use master::{Heard, Line};
use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{LATCH_PERIOD, PLACEHOLDER_IDENT, SerialNumber, Variant};

/// The rate of the virtual bus: a request and its reply are over within a latch. It is the tenth of the ten.
const RATE: Baudrate = Baudrate::B12000000;
const RATE_NUMBER: u8 = 9;
/// So long nothing may come where nothing is due.
const SILENCE: Time = Time::from_millis(25);
/// The longest that a reply takes on the busiest computer.
const PATIENCE: Time = Time::from_secs(10);

/// The two, and who hears both.
#[derive(Debug)]
pub(crate) struct Pair {
    segment: VirtualSegment<EncoderStation>,
    board: Board,
    bus: UnixStream,
    shaft: Shaft,
    world: World,
    sensor_fault: bool,
    switches: u8,
    variant: Variant,
    powered_at: Instant,
    /// Latches that the board has had.
    latches: u64,
    /// The state file of the virtual encoder.
    state: std::path::PathBuf,
    _folder: tempfile::TempDir,
    /// Telegrams that both have answered alike, or left without answer alike.
    pub(crate) compared: u64,
}

impl Pair {
    /// Both as delivered, with these switches, their power just come on.
    pub(crate) fn start(tools: &[std::path::PathBuf; 2], switches: u8, variant: Variant) -> Self {
        let [program, image] = tools.clone();
        let board = Board::start(&Setup { program, image, bus: None }).expect("an emulated board");
        let bus = UnixStream::connect(board.bus()).expect("the board's bus");
        bus.set_write_timeout(Some(PATIENCE)).expect("a time limit");
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("state");
        let shaft = Shaft::still(0);
        let setup = EncoderSetup {
            identity: Identity {
                variant,
                ident_number: PLACEHOLDER_IDENT,
                serial_number: SerialNumber::DEFAULT,
                switches: RotarySwitches(switches),
            },
            configurations: Configurations::default(),
            rate: Rate::Fixed(RATE),
            termination: TerminationSwitches::ON,
            shaft: shaft.clone(),
            world: World::default(),
            store: Store::open(&state, variant, false).expect("a new state file"),
            reporter: Reporter::new("encoder", None),
        };
        let mut segment = VirtualSegment::new(Instant::ZERO, RATE);
        segment.add(EncoderStation::new(Instant::ZERO, setup).expect("a new store"));
        let mut pair = Self {
            segment,
            board,
            bus,
            shaft,
            world: World::default(),
            sensor_fault: false,
            switches,
            variant,
            powered_at: Instant::ZERO,
            latches: 0,
            state,
            _folder: folder,
            compared: 0,
        };
        // A new state file holds the record of delivery already.
        pair.load_memory();
        pair.power_on_board();
        pair
    }

    /// What the state file holds, as far as anything was written.
    fn slots(&self) -> [[u8; SLOT_OCTETS]; 2] {
        let octets = std::fs::read(&self.state).expect("the state file");
        let slot = |at: usize| *octets[at..].first_chunk().expect("a slot");
        [slot(0), slot(SLOT_OCTETS)]
    }

    fn load_memory(&mut self) {
        *self.board.memory_mut() = self.slots().map(Some);
    }

    fn power_on_board(&mut self) {
        let power_on = PowerOn {
            lock_step: true,
            as_delivered: false,
            paced: false,
            switches: self.switches,
            rate: RATE_NUMBER,
            search: false,
            battery: self.world.0.battery,
            variant: self.variant,
        };
        self.board.power_on(&power_on).expect("power for the board");
        (self.powered_at, self.latches) = (self.segment.now(), 0);
        self.catch_up(self.segment.now());
    }

    fn station(&mut self) -> &mut EncoderStation {
        &mut self.segment.stations_mut()[0]
    }

    /// The board gets the latches up to `now`.
    fn catch_up(&mut self, now: Instant) {
        loop {
            let latch = self.powered_at + LATCH_PERIOD.times(self.latches);
            if latch > now || !self.board.is_powered() {
                return;
            }
            let counts = self.shaft.at(latch, self.variant);
            let world = LinkWorld {
                shaft: if self.sensor_fault { ShaftReading::Fault } else { ShaftReading::Full(counts) },
                measurement: self.world.0,
                termination: TerminationSwitches::ON,
            };
            self.board.latch(&world).expect("a latch of the board");
            self.latches += 1;
        }
    }

    /// Time passes up to the next latch, so that what happens then happens to both at the same instant.
    fn wait_for_a_latch(&mut self) {
        self.catch_up(self.segment.now());
        let next = self.powered_at + LATCH_PERIOD.times(self.latches);
        let span = next.since(self.segment.now());
        self.segment.wait(span);
    }

    /// Another world for both.
    pub(crate) fn set_world(&mut self, change: impl FnOnce(&mut World)) {
        self.wait_for_a_latch();
        change(&mut self.world);
        let (now, world) = (self.segment.now(), self.world);
        self.station().set_world(now, world).expect("the store");
        self.catch_up(now);
    }

    /// Another shaft for both, from where it is.
    pub(crate) fn set_shaft(&mut self, shaft: &Shaft) {
        self.wait_for_a_latch();
        let now = self.segment.now();
        // The latch at this instant is of the movement before.
        self.catch_up(now);
        let here = self.shaft.at(now, self.variant);
        self.shaft = shaft.clone().from(here).started(now);
        let shaft = self.shaft.clone();
        self.station().set_shaft(now, shaft);
    }

    /// The sensor reports a fault at one latch.
    pub(crate) fn fault_once(&mut self) {
        self.wait_for_a_latch();
        let now = self.segment.now();
        self.station().sensor_fault(now, false);
        self.sensor_fault = true;
        self.catch_up(now);
        self.sensor_fault = false;
    }

    /// The power is cut for some time; then both have it again, with what their memories hold.
    pub(crate) fn cut_power(&mut self, span: Duration) {
        self.wait_for_a_latch();
        let now = self.segment.now();
        self.catch_up(now);
        self.station().switch_power(now, false).expect("the store");
        self.board.cut().expect("a cut");
        self.segment.wait(span);
        self.same_memory();
        let now = self.segment.now();
        self.station().switch_power(now, true).expect("the store");
        self.power_on_board();
    }

    /// The records of both, octet for octet.
    #[track_caller]
    pub(crate) fn same_memory(&mut self) {
        let due = self.slots();
        let [a, b] = *self.board.memory();
        assert_eq!([a.expect("slot A"), b.expect("slot B")], due, "the records of both");
    }

    /// The rotary switches of both are turned; it shows at the next power-on.
    pub(crate) fn set_switches(&mut self, switches: u8) {
        self.switches = switches;
        self.station().set_switches(RotarySwitches(switches));
    }

    /// What the board answers, where `due` octets are due.
    fn hear_board(&mut self, due: usize) -> Vec<u8> {
        let mut octets = Vec::new();
        let mut buffer = [0; 512];
        let limit = if due == 0 { SILENCE } else { PATIENCE };
        self.bus.set_read_timeout(Some(limit)).expect("a time limit");
        while octets.len() < due.max(1) {
            match self.bus.read(&mut buffer) {
                Ok(0) | Err(_) => break,
                Ok(count) => octets.extend_from_slice(&buffer[..count]),
            }
        }
        octets
    }
}

impl Line for Pair {
    fn now(&self) -> Instant {
        self.segment.now()
    }

    #[track_caller]
    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        self.segment.send_only(request);
        let asked = self.segment.now();
        let heard = match self.segment.listen() {
            Answer::Reply(heard) => {
                let length = heard.octets.len();
                reply[..length].copy_from_slice(heard.octets);
                Heard { length, delay: heard.delay, damaged: heard.damaged }
            }
            Answer::Silence { until } => Heard::silence(until.since(asked)),
        };
        self.catch_up(asked);
        self.bus.write_all(request).expect("the board's bus");
        let due = &reply[..heard.length];
        let came = self.hear_board(heard.length);
        assert_eq!(
            came, due,
            "after {request:02X?} at latch {}: the board, and what the virtual encoder answers",
            self.latches
        );
        self.compared += 1;
        Ok(heard)
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        self.segment.send_only(octets);
        self.catch_up(self.segment.now());
        self.bus.write_all(octets).expect("the board's bus");
        assert_eq!(self.hear_board(0), b"", "nobody answers {octets:02X?}");
        self.compared += 1;
        Ok(())
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        self.segment.wait(span);
        self.catch_up(self.segment.now());
        Ok(())
    }
}
