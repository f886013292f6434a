//! What the tests of this crate share: encoders to talk to.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::ops::ControlFlow;
use std::thread::JoinHandle;

use bus::segment::Settings;
use bus::{Control, End, Handler, Segment, WallClock};
use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Baudrate, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

pub(crate) const ADDRESS: u8 = 5;
pub(crate) const IDENT: u16 = PLACEHOLDER_IDENT;
/// The shaft stands here: 12345678h.
const RAW: i64 = 0x1234_5678;

/// Set_Prm from octet 8 on: octet 8 is the ASIC's, octet 9 has the operating parameters (manual 4.1).
pub(crate) const CLASS_1: &[u8] = &[0, 0];
/// Class 2 with 16 and 15 bits, not scaled.
#[rustfmt::skip]
pub(crate) const CLASS_2: &[u8] = &[
    0, 0x02, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0,
];
/// The same with a time base of 100 ms.
#[rustfmt::skip]
pub(crate) const SCANCON: &[u8] = &[
    0, 0x02, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0, 1,
];

/// Set_Prm without watchdog.
pub(crate) fn set_prm(user: &[u8]) -> Vec<u8> {
    let [high, low] = IDENT.to_be_bytes();
    [&[0x80, 0, 0, 11, high, low, 0], user].concat()
}

/// An encoder at [`ADDRESS`].
pub(crate) fn encoder(rate: Baudrate) -> EncoderStation {
    encoder_at(ADDRESS, rate)
}

/// An encoder whose switches say `switches`.
pub(crate) fn encoder_at(switches: u8, rate: Baudrate) -> EncoderStation {
    new_encoder(switches, IDENT, Rate::Fixed(rate))
}

pub(crate) fn new_encoder(switches: u8, ident_number: u16, rate: Rate) -> EncoderStation {
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(switches),
        },
        configurations: Configurations::default(),
        rate,
        termination: TerminationSwitches { first: true, second: true },
        shaft: Shaft::still(RAW),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", None),
    };
    EncoderStation::new(Instant::ZERO, setup).expect("nothing is stored")
}

/// An encoder at [`ADDRESS`] in real time, on a thread of its own.
pub(crate) struct Real {
    control: Control<()>,
    thread: Option<JoinHandle<()>>,
}

struct Quiet;

impl Handler<EncoderStation> for Quiet {
    type Command = ();

    fn command(&mut self, _: &mut Segment<EncoderStation>, (): ()) -> ControlFlow<()> {
        ControlFlow::Break(())
    }
}

pub(crate) fn real(end: Box<dyn End>) -> Real {
    let reply_limit = profibus_dp::time::Duration::from_millis(200);
    let mut segment = Segment::new(end, WallClock::new(), Settings { reply_limit, ..Settings::default() });
    segment.add(new_encoder(ADDRESS, IDENT, Rate::OfTheEnd));
    let (control, commands) = segment.control();
    let thread = std::thread::spawn(move || segment.run(&commands, &mut Quiet).expect("it runs"));
    Real { control, thread: Some(thread) }
}

impl Real {
    pub(crate) fn end(mut self) {
        self.stop();
    }

    fn stop(&mut self) {
        let _ = self.control.send(());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Real {
    fn drop(&mut self) {
        self.stop();
    }
}
