//! Our GSD files as a master reads them, and the device with what a master makes of them.
//!
//! What is expected of the octets is the manual's layout (4.1, 4.3), written here by hand.

use std::fs;
use std::path::{Path, PathBuf};

use gsd_parser::{GenericStationDescription, PrmBuilder, SupportedSpeeds};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::Choice;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Device, Identity, PowerOn};

const SLAVE: u8 = 11;
const MASTER: u8 = 2;

/// Bits, and the octets 10-13 and 14-17 that are their defaults: 2^n and 2^(n+m).
const VARIANTS: [(u8, u8, [u8; 8]); 4] = [
    (16, 15, [0x00, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00]),
    (13, 12, [0x00, 0x00, 0x20, 0x00, 0x02, 0x00, 0x00, 0x00]),
    (12, 12, [0x00, 0x00, 0x10, 0x00, 0x01, 0x00, 0x00, 0x00]),
    (13, 0, [0x00, 0x00, 0x20, 0x00, 0x00, 0x00, 0x20, 0x00]),
];

fn variant(n: u8, m: u8) -> Variant {
    Variant::new(n, m).expect("a variant")
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../gsd")
}

fn parsed(n: u8, m: u8) -> GenericStationDescription {
    let path = folder().join(format!("sch108bex-{n}x{m}.gsd"));
    let text = fs::read_to_string(&path).expect("the file is kept");
    gsd_parser::parser::parse(&path, &text).expect("it is read")
}

/// Octets 9 and up by the manual: the functionality's name in the GSD, identifiers, octets.
fn by_the_manual(scaling_values: [u8; 8]) -> [(&'static str, &'static [u8], Vec<u8>); 3] {
    let class_2 = [&[0x02][..], &scaling_values, &[0; 8]].concat();
    let scancon_2 = [&class_2[..], &[0x01]].concat();
    [
        ("Class 1 Multiturn", &[0xD1], vec![0x00]),
        ("Class 2 Multiturn", &[0xF1], class_2),
        ("Scancon 2.0 Multiturn", &[0xF1, 0xD1, 0xD1], scancon_2),
    ]
}

#[test]
fn the_files_that_are_kept_are_those_of_the_template() {
    let mut due: Vec<_> = engineering::gsd::KEPT
        .iter()
        .map(|&(n, m)| {
            (engineering::gsd::file_name(variant(n, m)), engineering::gsd::text(variant(n, m), 0x108B))
        })
        .collect();
    due.sort();
    let mut kept = Vec::new();
    for entry in fs::read_dir(folder()).expect("the folder") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|extension| extension == "gsd") {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            kept.push((name, fs::read_to_string(&path).expect("text")));
        }
    }
    kept.sort();
    assert!(kept == due, "made anew by: sch108bex gsd --bits NxM --output gsd/sch108bex-NxM.gsd");
}

#[test]
fn gsd_parser_reads_what_the_device_is() {
    for (n, m, _) in VARIANTS {
        let gsd = parsed(n, m);
        assert_eq!(gsd.ident_number, 0x108B);
        assert!(gsd.vendor.contains("not Scancon") && gsd.model.ends_with(&format!("{n}x{m}")));
        let all = SupportedSpeeds::all() - SupportedSpeeds::B31250;
        assert_eq!(gsd.supported_speeds, all, "the ten rates");
        let tsdr = &gsd.max_tsdr;
        assert_eq!(
            [tsdr.b9600, tsdr.b45450, tsdr.b187500, tsdr.b500000, tsdr.b1500000],
            [60, 60, 60, 100, 150]
        );
        assert_eq!([tsdr.b3000000, tsdr.b6000000, tsdr.b12000000], [250, 450, 800]);
        assert!(gsd.freeze_mode_supported && gsd.sync_mode_supported && gsd.fail_safe);
        assert!(gsd.auto_baud_supported && gsd.set_slave_addr_supported && gsd.modular_station);
        assert_eq!((gsd.max_modules, gsd.max_diag_data_length), (1, 57));
        assert_eq!((gsd.max_input_length, gsd.max_output_length, gsd.max_data_length), (12, 4, 16));
        // (octet - 8) * 8 + bit: alarms in octet 8, warnings in octets 20 (bits 15-8) and 21 (manual 4.2.2, 4.2.9).
        let bits: Vec<_> = gsd.unit_diag.bits.keys().copied().collect();
        assert_eq!(bits, [0, 1, 105, 106, 108, 109]);
    }
}

// The defaults of the manual, 4.1.1 to 4.1.5, with the single parameters laid over the constants.
#[test]
fn gsd_parser_builds_the_octets_of_the_manual() {
    for (n, m, values) in VARIANTS {
        let gsd = parsed(n, m);
        assert_eq!(gsd.available_modules.len(), 3);
        for (module, (name, identifiers, octets)) in gsd.available_modules.iter().zip(by_the_manual(values)) {
            assert_eq!((module.name.as_str(), module.config.as_slice()), (name, identifiers));
            let built = PrmBuilder::new(&module.module_prm_data).into_bytes();
            assert_eq!(built, [&[0x00][..], &octets].concat(), "{n}x{m} {name}");
            // Constants alone are the same: pyprofibus knows nothing else.
            assert_eq!(module.module_prm_data.data_const, [(0, built)], "{n}x{m} {name}");
        }
    }
}

#[test]
fn single_parameters_stand_where_the_manual_has_them() {
    let gsd = parsed(16, 15);
    let mut builder = PrmBuilder::new(&gsd.available_modules[2].module_prm_data);
    builder.set_prm_from_text("Code sequence", "Counter-clockwise");
    builder.set_prm_from_text("Scaling function control", "Enabled");
    builder.set_prm("Measuring units per revolution", 4_096);
    builder.set_prm("Total measuring range", 134_217_728);
    builder.set_prm_from_text("Time base", "RPM");
    // Vector E058 with the other direction.
    let due = [0x00, 0x0B, 0, 0, 0x10, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3];
    assert_eq!(builder.into_bytes(), due);
}

/// A device alone on its bus, and a master that says what it is told.
struct Bus {
    device: Device,
    now: Instant,
}

impl Bus {
    fn new(variant: Variant) -> Self {
        let identity = Identity {
            variant,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(SLAVE),
        };
        let power_on = PowerOn {
            identity,
            stored: Choice::AsDelivered,
            battery: Battery::Ok,
            baud: BaudSetting::Fixed(Baudrate::B500000),
            receiver: ReceiverMode::Stream,
        };
        let mut device = Device::new(Instant::ZERO, power_on, ());
        let good =
            Measurement { supply_mv: 24_000, temperature_tenths: 200, light_ok: true, battery: Battery::Ok };
        device.measure(Instant::ZERO, &good);
        device.sample(Instant::ZERO, ShaftReading::Full(0));
        Self { device, now: Instant::from_millis(1) }
    }

    /// An SD2 request with these SAPs, and the answer.
    fn ask(&mut self, fc: u8, dsap: u8, data: &[u8]) -> Vec<u8> {
        let body = [&[SLAVE | 0x80, MASTER | 0x80, fc, dsap, 62][..], data].concat();
        self.send(&framed(&body))
    }

    fn send(&mut self, request: &[u8]) -> Vec<u8> {
        self.now += Duration::from_millis(1);
        let window = self.device.receive(self.now, request).expect("an answer");
        self.now = window.not_before;
        self.device.transmit(self.now).expect("octets").to_vec()
    }
}

fn framed(body: &[u8]) -> Vec<u8> {
    let length = u8::try_from(body.len()).expect("short");
    let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    [&[0x68, length, length, 0x68][..], body, &[sum, 0x16]].concat()
}

/// Data exchange begins with these parameters and identifiers, and the answer has so many inputs.
fn exchanges(variant: Variant, user_parameters: &[u8], identifiers: &[u8], outputs: usize, inputs: usize) {
    let mut bus = Bus::new(variant);
    let set_prm = [&[0xB8, 1, 100, 11, 0x10, 0x8B, 0][..], user_parameters].concat();
    assert_eq!(bus.ask(0x6D, 61, &set_prm), [0xE5]);
    let diagnosis = bus.ask(0x5D, 60, &[]);
    assert_eq!(diagnosis[9..13], [0x02, 0x0C, 0x00, MASTER], "no fault: {diagnosis:02X?}");
    assert_eq!(bus.ask(0x7D, 62, identifiers), [0xE5]);
    let diagnosis = bus.ask(0x5D, 60, &[]);
    assert_eq!(diagnosis[9..13], [0x00, 0x0C, 0x00, MASTER], "no fault: {diagnosis:02X?}");
    let answer = if outputs == 0 {
        bus.send(&[0x10, SLAVE, MASTER, 0x7D, SLAVE + MASTER + 0x7D, 0x16])
    } else {
        bus.send(&framed(&[SLAVE, MASTER, 0x7D, 0, 0, 0, 0]))
    };
    assert_eq!((answer.len(), answer[6]), (9 + inputs, 0x08), "{answer:02X?}");
}

#[test]
fn the_device_takes_what_gsd_parser_makes_of_its_gsd() {
    for (n, m, _) in VARIANTS {
        let gsd = parsed(n, m);
        for (module, (outputs, inputs)) in gsd.available_modules.iter().zip([(0, 4), (4, 4), (4, 12)]) {
            let user = PrmBuilder::new(&module.module_prm_data).into_bytes();
            exchanges(variant(n, m), &user, &module.config, outputs, inputs);
        }
    }
}

#[test]
fn the_device_takes_scaling_set_by_the_gsds_parameters() {
    let gsd = parsed(13, 12);
    for (module, inputs) in gsd.available_modules[1..].iter().zip([4, 12]) {
        let mut builder = PrmBuilder::new(&module.module_prm_data);
        builder.set_prm("Scaling function control", 1);
        for (units, range) in [(1, 1), (8_192, 33_554_432)] {
            builder.set_prm("Measuring units per revolution", units);
            builder.set_prm("Total measuring range", range);
            exchanges(variant(13, 12), builder.as_bytes(), &module.config, 4, inputs);
        }
    }
}
