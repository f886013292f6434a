//! Demands of the manual that need more than one example: every variant, speed, bit.

use profibus_dp::time::{Duration, Instant};
use sch108bex::data_sheet::{DATA_SHEET, Group};
use sch108bex::diagnostics::{Alarms, Class2Part, Diagnostics, Warnings};
use sch108bex::event::PositionErrorCause;
use sch108bex::functionality::Functionality;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::Record;
use sch108bex::parameterization::{CodeSequence, ParameterLength, Parameters, TimeBase};
use sch108bex::sensor::ShaftReading::{Full, Singleturn};
use sch108bex::sensor_half::{Demand, SensorHalf};
use sch108bex::specification::{SHAFT_SPEED_MAX_RPM, SerialNumber, Variant};

const LATCH: Duration = Duration::from_micros(500);

fn delivered(variant: Variant) -> SensorHalf {
    SensorHalf::new(Instant::ZERO, variant, &Record::as_delivered(variant), Battery::Ok, &mut ())
}

fn exchange(half: &mut SensorHalf, functionality: Functionality, parameters: Parameters) {
    half.obey(Instant::ZERO, Demand::Parameterize { functionality, parameters }, &mut ());
}

/// Octets 7-57 (7-16 in class 1) as they are sent; index 0 is octet 7.
fn block(half: &SensorHalf) -> Vec<u8> {
    let diagnostics = half.diagnostics(&SerialNumber::DEFAULT);
    let (mut short, mut long) = ([0; 10], [0; 51]);
    if diagnostics.class_2_part.is_some() {
        diagnostics.emit_long(&mut long);
        long.to_vec()
    } else {
        diagnostics.emit_short(&mut short);
        short.to_vec()
    }
}

fn variants() -> impl Iterator<Item = Variant> {
    (2..=16).flat_map(|n| (0..=15).map(move |m| Variant::new(n, m).unwrap()))
}

// Manual 4.1: the column of the default values, octet by octet.
#[test]
fn the_defaults_are_the_manuals() {
    for variant in variants() {
        let (n, m) = (variant.singleturn_bits(), variant.multiturn_bits());
        let defaults = Parameters::default_for(variant);
        let expected = Parameters {
            length: ParameterLength::TwentySix,
            code_sequence: CodeSequence::Clockwise,
            scaling: false,
            measuring_units_per_revolution: 1 << n,
            total_measuring_range: 1 << (n + m),
            time_base: TimeBase::Per100Ms,
        };
        assert_eq!(Parameters { length: expected.length, ..defaults }, expected, "{variant}");
        let mut octets = [0xAA; 26];
        assert_eq!(expected.emit(&mut octets), 26);
        // Class 2 on, commissioning off, scaling off, clockwise.
        assert_eq!(octets[8], 0b0000_0010, "{variant}");
        assert_eq!(octets[9..13], (1_u32 << n).to_be_bytes(), "{variant}");
        assert_eq!(octets[13..17], (1_u32 << (n + m)).to_be_bytes(), "{variant}");
        assert_eq!(octets[17..26], [0, 0, 0, 0, 0, 0, 0, 0, 1], "{variant}");
    }
}

// Manual 4.2.2, 4.2.3, 4.2.7, 4.2.9: whatever the world is like.
#[test]
fn what_is_not_supported_is_always_0() {
    let parameters = |scaling, turned| Parameters {
        scaling,
        code_sequence: if turned { CodeSequence::CounterClockwise } else { CodeSequence::Clockwise },
        ..Parameters::default_for(Variant::FULL)
    };
    let (mut alarms, mut status, mut warnings, mut cases) = (0, 0, 0, 0);
    for functionality in Functionality::ALL {
        for setting in 0..0x80_u32 {
            let is = |bit: u32| setting >> bit & 1 == 1;
            let limit = 876_000 * 360_000;
            let record = Record {
                operating_time_ms: if is(0) { limit + 360_000 } else { limit },
                ..Record::as_delivered(Variant::FULL)
            };
            let mut half = SensorHalf::new(Instant::ZERO, Variant::FULL, &record, Battery::Ok, &mut ());
            exchange(&mut half, functionality, parameters(is(1), is(2)));
            let measurement = Measurement {
                supply_mv: if is(3) { 31_000 } else { 24_000 },
                temperature_tenths: if is(4) { i16::MAX } else { i16::MIN },
                light_ok: !is(5),
                battery: if is(6) { Battery::Empty } else { Battery::Ok },
            };
            half.measure(Instant::ZERO, &measurement, &mut ());
            if is(3) {
                half.position_error(Instant::ZERO, PositionErrorCause::Injected, &mut ());
            }
            let octets = block(&half);
            alarms |= octets[8 - 7];
            status |= octets[9 - 7];
            if let [high, low] = octets[..].get(20 - 7..=21 - 7).unwrap_or(&[0, 0]) {
                warnings |= u16::from_be_bytes([*high, *low]);
            }
            assert!(octets.get(17 - 7).is_none_or(|additional| *additional == 0));
            cases += 1;
        }
    }
    assert_eq!(cases, 3 * 128);
    assert_eq!(alarms, 0b0000_0011);
    assert_eq!(status, 0b0000_1011);
    assert_eq!(warnings, 0b0011_0110);
    assert_eq!((alarms, warnings), (Alarms::SUPPORTED.bits(), Warnings::SUPPORTED.bits()));
}

// Manual 4.2.5, 4.2.6 and 6: in every variant, in all forms.
#[test]
fn the_diagnosis_has_the_bits_of_every_variant() {
    for variant in variants() {
        let (n, m) = (u32::from(variant.singleturn_bits()), u32::from(variant.multiturn_bits()));
        let mut half = delivered(variant);
        let check = |half: &SensorHalf| {
            let octets = block(half);
            assert_eq!(octets[11 - 7..=14 - 7], 2_u32.pow(n).to_be_bytes(), "{variant}");
            assert_eq!(octets[15 - 7..=16 - 7], 2_u16.pow(m).to_be_bytes(), "{variant}");
        };
        check(&half);
        for functionality in Functionality::ALL {
            exchange(&mut half, functionality, Parameters::default_for(variant));
            check(&half);
        }
    }
}

// Manual 4.2.12.
#[test]
fn the_software_version_is_major_then_minor() {
    let mut half = delivered(Variant::FULL);
    exchange(&mut half, Functionality::Class2, Parameters::default_for(Variant::FULL));
    assert_eq!(block(&half)[26 - 7..=27 - 7], [1, 1]);
    let mut diagnostics = half.diagnostics(&SerialNumber::DEFAULT);
    let part = diagnostics.class_2_part.unwrap();
    diagnostics.class_2_part = Some(Class2Part { software_version: [3, 7], ..part });
    let mut octets = [0; 51];
    diagnostics.emit_long(&mut octets);
    assert_eq!(octets[26 - 7..=27 - 7], [3, 7]);
    assert_eq!(Diagnostics::parse(&octets), Some(diagnostics));
}

// Manual 6: by the formula of the position, at each latch of a fifth of a second, forwards from 0
// and backwards over the physical overflow, with either kind of sensor.
#[test]
fn the_position_is_right_at_every_speed_up_to_3000_rpm() {
    let (units, range) = (3600, 100_000);
    let parameters = Parameters {
        scaling: true,
        measuring_units_per_revolution: 3600,
        total_measuring_range: 100_000,
        ..Parameters::default_for(Variant::FULL)
    };
    let top = i64::from(SHAFT_SPEED_MAX_RPM);
    assert_eq!(top, 3000);
    for rpm in -top..=top {
        let (mut full, mut single) = (delivered(Variant::FULL), delivered(Variant::FULL));
        exchange(&mut full, Functionality::Scancon2, parameters);
        exchange(&mut single, Functionality::Scancon2, parameters);
        let mut now = Instant::ZERO;
        for latch in 0..400 {
            // 120000 latches in a minute.
            let counts = (rpm * 65_536 * latch).div_euclid(120_000);
            let raw = counts.rem_euclid(1 << 31);
            let due = raw * units / 65_536 % range;
            full.sample(now, Full(counts), &mut ());
            single.sample(now, Singleturn(u16::try_from(counts.rem_euclid(65_536)).unwrap()), &mut ());
            assert_eq!(i64::from(full.position()), due, "{rpm} RPM, latch {latch}");
            assert_eq!(i64::from(single.position()), due, "{rpm} RPM, latch {latch}, angle only");
            now += LATCH;
        }
        assert_eq!(single.alarms(), Alarms::empty(), "{rpm} RPM");
    }
}

// Manual 3.2.
#[test]
fn the_data_sheet_has_every_terminal() {
    let value = |name: &str| {
        let row = DATA_SHEET.iter().find(|row| row.group == Group::Connections && row.name == name);
        row.unwrap_or_else(|| panic!("no row {name}")).value
    };
    assert!(value("VSUP").contains("9 V to 30 V"));
    assert!(value("GND").contains("0 V"));
    assert!(value("A-LINE").contains("negative data line"));
    assert!(value("B-LINE").contains("positive data line"));
    assert!(value("Terminals").contains("bus in and bus out"));
    let protection = DATA_SHEET.iter().find(|row| row.name == "Protection").expect("a row");
    assert!(protection.value.contains("reverse polarity"));
}
