use super::*;
use crate::parameterization::Parameters;
use proptest::prelude::*;
use std::string::ToString;

const HEALTH: Health = Health {
    alarms: Alarms::SUPPLY_VOLTAGE,
    warnings: Warnings::TEMPERATURE_EXCEEDED,
    operating_time: OperatingTime(61),
    offset: -1000,
};

// The manual's octets 7-57: class 2, counter-clockwise, scaling 4096 x 32768, supply alarm,
// temperature warning, 6.1 h, offset value -1000.
const CLASS_2: [u8; 51] = [
    51, 0x02, 0x0B, 2, 0, 1, 0, 0, 0x80, 0, // 7-16
    0, 0, 3, 0, 2, 0, 0x36, 1, 1, 1, 1, // 17-27
    0, 0, 0, 61, 0xFF, 0xFF, 0xFC, 0x18, 0, 0, 0, 0, // 28-39
    0, 0, 0x10, 0, 0x08, 0, 0, 0, // 40-47
    b'1', b'2', b'3', b'4', b'5', b'6', b'7', b' ', b' ', b' ', // 48-57
];

fn class_2() -> Diagnostics {
    let parameters = Parameters {
        scaling: true,
        measuring_units_per_revolution: 4096,
        total_measuring_range: 0x0800_0000,
        code_sequence: CodeSequence::CounterClockwise,
        ..Parameters::default_for(Variant::FULL)
    };
    let functionality = Functionality::Class2;
    let scaling = Scaling::in_force(Variant::FULL, functionality, &parameters);
    Diagnostics::in_data_exchange(functionality, &scaling, &HEALTH, &SerialNumber::DEFAULT)
}

#[test]
fn the_manuals_octets_both_ways() {
    let mut block = [0xAA; 51];
    class_2().emit_long(&mut block);
    assert_eq!(block, CLASS_2);
    assert_eq!(Diagnostics::parse(&CLASS_2), Some(class_2()));
}

#[test]
fn class_1_has_ten_octets_and_bit_1_off() {
    let scaling = Scaling::physical(Variant::FULL, CodeSequence::CounterClockwise);
    let class_1 = Functionality::Class1;
    let diagnostics = Diagnostics::in_data_exchange(class_1, &scaling, &HEALTH, &SerialNumber::DEFAULT);
    let mut block = [0xAA; 10];
    diagnostics.emit_short(&mut block);
    assert_eq!(block, [10, 2, 1, 2, 0, 1, 0, 0, 0x80, 0]);
    assert_eq!(Diagnostics::parse(&block), Some(diagnostics));
}

#[test]
fn outside_data_exchange_octet_9_is_0() {
    let variant = Variant::new(13, 12).unwrap();
    let mut block = [0xAA; 10];
    Diagnostics::outside_data_exchange(variant, &HEALTH).emit_short(&mut block);
    assert_eq!(block, [10, 2, 0, 2, 0, 0, 0x20, 0, 0x10, 0]);
}

#[test]
fn alarms_set_both_bits_and_warnings_one_where_they_are_sent() {
    let none = (Alarms::empty(), Warnings::empty());
    assert!(!ext_diag(none.0, none.1, true) && !stat_diag(none.0));
    for alarm in Alarms::SUPPORTED.iter() {
        assert!(ext_diag(alarm, none.1, false) && stat_diag(alarm));
    }
    for warning in Warnings::SUPPORTED.iter() {
        assert!(ext_diag(none.0, warning, true));
        assert!(!ext_diag(none.0, warning, false));
    }
}

#[test]
fn the_supported_bits_are_the_manuals() {
    assert_eq!(Alarms::SUPPORTED.bits(), 0x03);
    assert_eq!(Warnings::SUPPORTED.bits(), 0x0036);
}

#[test]
fn blocks_that_are_none_are_not_parsed() {
    assert_eq!(Diagnostics::parse(&[]), None);
    assert_eq!(Diagnostics::parse(&CLASS_2[..50]), None);
    assert_eq!(Diagnostics::parse(&[10, 0, 0, 2, 0, 0, 0, 0, 0]), None);
    for header in (0..=u8::MAX).filter(|header| ![10, 51].contains(header)) {
        let mut block = CLASS_2;
        block[0] = header;
        assert_eq!(Diagnostics::parse(&block), None);
    }
}

#[test]
fn names_for_people() {
    let alarms = Alarms::SUPPORTED.to_string();
    assert_eq!(alarms, "position error, supply voltage outside 9 to 30 V");
    assert_eq!(Warnings::empty().to_string(), "none");
    assert_eq!(Warnings::BATTERY_CHARGE.to_string(), "battery below its limit");
}

proptest! {
    // Also what other encoders send survives.
    #[test]
    fn emit_undoes_parse(mut block: [u8; 51], long: bool) {
        block[0] = if long { 51 } else { 10 };
        block[2] &= 0x0B;
        let diagnostics = Diagnostics::parse(&block).unwrap();
        let mut long_form = [0; 51];
        let mut short_form = [0; 10];
        diagnostics.emit_long(&mut long_form);
        diagnostics.emit_short(&mut short_form);
        if long {
            prop_assert_eq!(long_form, block);
        } else {
            prop_assert_eq!(&short_form[..], &block[..10]);
            prop_assert_eq!(diagnostics.class_2_part, None);
        }
    }

    #[test]
    fn any_octets_are_parsed_or_not(octets in prop::collection::vec(any::<u8>(), 0..80)) {
        let expected = match octets.first() {
            Some(10) => octets.len() >= 10,
            Some(51) => octets.len() >= 51,
            _ => false,
        };
        prop_assert_eq!(Diagnostics::parse(&octets).is_some(), expected);
    }
}
