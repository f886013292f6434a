//! What the tests of the control share: a running plant, and a master at its memory end.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::sync::mpsc::{self, Receiver};
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::{MemoryEnd, pair};
use bus::{End, Event, Settings};
use plant::control::{Applied, ControlError, Envelope};
use plant::{EncoderSetup, Handle, Plant, Rate, Report, Reporter, SegmentSetup, Shaft, Store, World};
use profibus_dp::time::Duration;
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use serde_json::Value;

/// Encoders with addresses 11, 12 and so on, called `encoder`, `encoder 2` and so on.
pub(crate) struct Bench {
    pub(crate) plant: Plant,
    pub(crate) handle: Handle,
    pub(crate) master: MemoryEnd,
    pub(crate) reports: Receiver<Report>,
}

pub(crate) fn bench(encoders: u8) -> Bench {
    let (end, master) = pair();
    let (to, reports) = mpsc::channel();
    let setup = |number: u8| EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(11 + number),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches::default(),
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new(
            &if number == 0 { "encoder".to_owned() } else { format!("encoder {}", number + 1) },
            Some(to.clone()),
        ),
    };
    let segment = SegmentSetup {
        name: "bus".to_owned(),
        end: Box::new(end),
        // A loaded computer is no fault of the plant's.
        settings: Settings { reply_limit: Duration::from_secs(60), ..Settings::default() },
        encoders: (0..encoders).map(setup).collect(),
    };
    let mut plant = Plant::new();
    plant.add(segment, to.clone()).expect("a plant");
    let handle = plant.handle();
    Bench { plant, handle, master, reports }
}

impl Bench {
    /// Does what a line of JSON asks for.
    #[track_caller]
    pub(crate) fn apply(&self, line: &str) -> Result<Option<Applied>, ControlError> {
        let envelope = Envelope::parse(line.as_bytes()).expect("a request");
        self.handle.apply(&envelope.request)
    }

    #[track_caller]
    pub(crate) fn done(&self, line: &str) {
        assert_eq!(self.apply(line).expect(line), None, "{line}");
    }

    /// The sentence about a request that is refused.
    #[track_caller]
    pub(crate) fn refused(&self, line: &str) -> String {
        self.apply(line).expect_err(line).to_string()
    }

    /// Everything, or one encoder, as JSON has it.
    pub(crate) fn snapshot(&self) -> Value {
        let snapshot = self.handle.snapshot().expect("it runs");
        serde_json::to_value(snapshot).expect("JSON")
    }

    /// What the first device says of itself.
    pub(crate) fn device(&self) -> Value {
        self.snapshot()["encoders"][0]["device"].clone()
    }

    /// Sends a request; what comes until it is long enough, or the time is over.
    pub(crate) fn ask(&mut self, request: &[u8], due: usize, within: Time) -> Vec<u8> {
        let _ = self.master.write(request).expect("an end");
        let until = Moment::now() + within;
        let (mut got, mut buffer) = (Vec::new(), [0; 512]);
        while got.len() < due {
            let left = until.saturating_duration_since(Moment::now());
            match self.master.wait(Some(left.into()), &mut buffer).expect("an end") {
                Event::Octets(count) => got.extend_from_slice(&buffer[..count]),
                _ if left.is_zero() => break,
                _ => {}
            }
        }
        got
    }

    /// The answer to an FDL status request, empty for silence.
    pub(crate) fn status(&mut self, address: u8) -> Vec<u8> {
        self.ask(&status(address), 6, Time::from_secs(10))
    }

    pub(crate) fn is_silent(&mut self, address: u8) -> bool {
        self.ask(&status(address), 6, Time::from_millis(100)).is_empty()
    }

    /// Diagnosis octets from 1 on, asked by master 2 outside data exchange, where they are 16.
    #[track_caller]
    pub(crate) fn diagnosis(&mut self, address: u8) -> Vec<u8> {
        let body = [address | 0x80, 0x82, 0x6D, 60, 62];
        let request = [&[0x68, 5, 5, 0x68], &body[..], &[sum(&body), 0x16]].concat();
        // 16 octets and what is around them.
        let answer = self.ask(&request, 27, Time::from_secs(10));
        assert_eq!(answer.len(), 27, "{answer:02X?}");
        answer[9..25].to_vec()
    }
}

pub(crate) fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum: u8, octet| sum.wrapping_add(*octet))
}

/// FDL status of a station, asked by master 2.
pub(crate) fn status(address: u8) -> [u8; 6] {
    [0x10, address, 2, 0x49, sum(&[address, 2, 0x49]), 0x16]
}

/// Its answer.
pub(crate) fn status_answer(address: u8) -> [u8; 6] {
    [0x10, 2, address, 0, sum(&[2, address]), 0x16]
}

/// Waits until `done` says so.
#[track_caller]
pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Moment::now();
    while !done() {
        assert!(begun.elapsed() < Time::from_secs(20), "waited in vain for {what}");
        std::thread::sleep(Time::from_millis(2));
    }
}
