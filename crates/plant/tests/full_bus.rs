//! As many encoders as a bus has addresses, on one pseudo terminal or one TCP port in real time, each with a state of
//! its own, and one master that asks them all.

use std::path::Path;
use std::sync::mpsc;
use std::time::Instant as Moment;

use bus::{PortAddress, Settings, open_for_master, open_for_slaves};
use master::{Error, LightMaster, Parameters as StandardPart, Service, Settings as MasterSettings, Wire};
use plant::control::Envelope;
use plant::{EncoderSetup, Handle, Plant, Rate, Reporter, SegmentSetup, Shaft, Store, World};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

/// The master has address 0, so encoders have all others but that of delivery.
const LAST: u8 = 125;

/// Scancon 2.0, clockwise, no scaling, velocity in 100 ms (manual 4.1): octets 8 to 26 of Set_Prm.
const PARAMETERS: [u8; 19] = [0, 0x02, 0, 1, 0, 0, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x01];
const CONFIGURATION: [u8; 3] = [0xF1, 0xD1, 0xD1];

fn encoder(address: u8, folder: &Path, reporter: Reporter) -> EncoderSetup {
    let state = folder.join(format!("{address}.state"));
    EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(address),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches { first: address == LAST, second: address == LAST },
        shaft: Shaft::still(raw(address).into()),
        world: World::default(),
        store: Store::open(&state, Variant::FULL, false).expect("a state file"),
        reporter,
    }
}

/// Where the shaft of an encoder stands.
fn raw(address: u8) -> i32 {
    i32::from(address) * 100_003
}

/// What the position of an encoder is preset to.
fn preset(address: u8) -> u32 {
    1_000_000_000 + u32::from(address) * 7
}

/// A plant with all of them, and a master at the far side.
struct Bench {
    plant: Plant,
    handle: Handle,
    master: LightMaster<Wire>,
}

fn bench(port: &str, folder: &Path) -> Bench {
    let port: PortAddress = port.parse().expect("a port");
    let end = open_for_slaves(&port, BaudSetting::Search(Baudrate::B500000)).expect("an end");
    let name = end.name().to_owned();
    let (reports, _) = mpsc::channel();
    let encoders = (1..=LAST).map(|address| {
        encoder(address, folder, Reporter::new(&format!("e{address}"), Some(reports.clone())))
    });
    let setup = SegmentSetup {
        name: "bus".to_owned(),
        end,
        // A loaded computer is no fault of the plant's.
        settings: Settings { reply_limit: Duration::from_secs(60), ..Settings::default() },
        encoders: encoders.collect(),
    };
    let mut plant = Plant::new();
    plant.add(setup, reports).expect("a plant");
    let far: PortAddress = name.parse().expect("a port");
    let wire =
        Wire::new(open_for_master(&far, Baudrate::B500000, Duration::from_secs(5)).expect("a far side"));
    let wire = wire.with_slot_time(Duration::from_millis(500));
    let handle = plant.handle();
    Bench {
        plant,
        handle,
        master: LightMaster::new(wire, MasterSettings { address: 0, ..MasterSettings::default() }),
    }
}

impl Bench {
    fn ask(&self, line: &str) {
        let envelope = Envelope::parse(line.as_bytes()).expect("a request");
        assert_eq!(self.handle.apply(&envelope.request).expect(line), None);
    }

    /// Into data exchange: manual 4, and what the diagnosis says of it.
    #[track_caller]
    fn start_up(&mut self, address: u8) {
        let standard = StandardPart {
            ident_number: PLACEHOLDER_IDENT,
            watchdog: None,
            min_tsdr: 11,
            user: PARAMETERS.to_vec(),
            ..StandardPart::default()
        };
        self.master.set_prm(address, &standard.set_prm()).expect("it takes parameters");
        self.master.chk_cfg(address, &CONFIGURATION).expect("it takes the configuration");
        let diagnosis = self.master.diagnosis(address).expect("it has a diagnosis");
        // Octet 1: nothing that keeps it from data exchange. Octet 4: its master.
        assert_eq!(
            (diagnosis.octets[0], diagnosis.octets[3]),
            (0, 0),
            "{address}: {:02X?}",
            diagnosis.octets
        );
    }

    /// The position that an exchange brings.
    #[track_caller]
    fn position(&mut self, address: u8, outputs: u32) -> u32 {
        let inputs = self.master.exchange(address, &outputs.to_be_bytes());
        let octets = inputs.unwrap_or_else(|error| panic!("{address}: {error}")).octets;
        assert_eq!(octets.len(), 12, "{address}");
        u32::from_be_bytes([octets[0], octets[1], octets[2], octets[3]])
    }
}

fn all_of_them(port: &str) {
    let (begun, folder) = (Moment::now(), tempfile::tempdir().expect("a folder"));
    let mut bench = bench(port, folder.path());
    for address in 1..=LAST {
        bench.start_up(address);
    }
    for address in 1..=LAST {
        assert_eq!(bench.position(address, 0), raw(address).unsigned_abs(), "{address}");
    }
    for address in 1..=LAST {
        bench.position(address, preset(address) | 0x8000_0000);
    }
    for address in 1..=LAST {
        assert_eq!(bench.position(address, 0), preset(address), "{address}");
    }
    // One leaves: nobody else notices.
    bench.ask(r#"{"do":"leave","encoder":"e60"}"#);
    for address in (1..=LAST).filter(|address| *address != 60) {
        assert_eq!(bench.position(address, 0), preset(address), "{address}");
    }
    let gone = bench.master.exchange(60, &[0; 4]).map(drop);
    assert!(matches!(gone, Err(Error::Silent { slave: 60, .. })), "{gone:?}");
    // It comes back as it was: without a watchdog its master has never left it.
    bench.ask(r#"{"do":"join","encoder":"e60"}"#);
    assert_eq!(bench.position(60, 0), preset(60));
    // One has no power for a moment: it wants parameters, and has its offset and its turns.
    bench.ask(r#"{"do":"power","encoder":"e61","state":"cycle"}"#);
    let refused = bench.master.exchange(61, &[0; 4]).map(drop);
    assert!(
        matches!(refused, Err(Error::Refused { slave: 61, service: Service::DataExchange, .. })),
        "{refused:?}"
    );
    bench.start_up(61);
    for address in 1..=LAST {
        assert_eq!(bench.position(address, 0), preset(address), "{address}");
    }
    let Bench { plant, master, .. } = bench;
    assert_eq!(master.counters().damaged, 0);
    drop(master);
    plant.stop().expect("it ends in order");
    // What each has kept is its own.
    let mut bench = self::bench(port, folder.path());
    for address in [1, 60, 61, LAST] {
        bench.start_up(address);
        assert_eq!(bench.position(address, 0), preset(address), "{address}");
    }
    assert!(bench.master.now() > Instant::ZERO);
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

#[test]
fn a_full_bus_on_a_pseudo_terminal_has_125_states() {
    all_of_them("pty");
}

#[test]
fn a_full_bus_on_a_tcp_port_has_125_states() {
    all_of_them("tcp-listen:127.0.0.1:0");
}
