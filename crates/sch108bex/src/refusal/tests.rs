use super::*;
use std::string::{String, ToString};

fn sentences() -> [(String, &'static str); 14] {
    let variant = Variant::FULL;
    let functionality = Functionality::Scancon2;
    [
        (
            PrmRefusal::Length { octets: 10 }.to_string(),
            "Set_Prm: 10 octets, but it must be 9 (class 1), 25 (class 2) or 26 (Scancon 2.0) (manual 4.1)",
        ),
        (
            PrmRefusal::Class2Missing { value: 0 }.to_string(),
            "Set_Prm octet 9: 00h has bit 1 (class 2 functionality) off, but in 25 and 26 octets it must be on (manual 4.1.1)",
        ),
        (
            PrmRefusal::Commissioning { value: 6 }.to_string(),
            "Set_Prm octet 9: 06h has bit 2 (commissioning diagnostics) on, but that is not supported and must be off (manual 4.1.1)",
        ),
        (
            PrmRefusal::MeasuringUnits { value: 65_537, variant }.to_string(),
            "Set_Prm octets 10-13: 65537 measuring units per revolution, but at most 65536 are possible with 16 singleturn bits (manual 4.1.2)",
        ),
        (
            PrmRefusal::MeasuringUnits { value: 0, variant }.to_string(),
            "Set_Prm octets 10-13: 0 measuring units per revolution, but 1 to 65536 are possible with 16 singleturn bits (manual 4.1.2)",
        ),
        (
            PrmRefusal::MeasuringRange { value: 0x8000_0001, variant }.to_string(),
            "Set_Prm octets 14-17: 2147483649 steps of total measuring range, but at most 2147483648 are possible with 16 singleturn and 15 multiturn bits (manual 4.1.3)",
        ),
        (
            PrmRefusal::Reserved { octet: 18, value: 1 }.to_string(),
            "Set_Prm octet 18: 01h, but octets 18-25 are reserved and must be 0 (manual 4.1.4)",
        ),
        (
            PrmRefusal::TimeBase { value: 4 }.to_string(),
            "Set_Prm octet 26: time base 4, but it must be 0 (10 ms), 1 (100 ms), 2 (1000 ms) or 3 (RPM) (manual 4.1.5)",
        ),
        (
            CfgRefusal::not_offered(&[0xF0]).to_string(),
            "Chk_Cfg: F0, but the device offers D1 (class 1), F1 (class 2), F1 D1 D1 or F1 D3 (Scancon 2.0) (manual 4.3)",
        ),
        (
            CfgRefusal::not_offered(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]).to_string(),
            "Chk_Cfg: 01 02 03 04 05 06 07 08 and 2 octets more, but the device offers D1 (class 1), F1 (class 2), F1 D1 D1 or F1 D3 (Scancon 2.0) (manual 4.3)",
        ),
        (
            CfgRefusal::ParametersTooShort { functionality, have: 25 }.to_string(),
            "Chk_Cfg: Scancon 2.0 needs a Set_Prm of 26 octets, but the last one had 25 (manual 4.1)",
        ),
        (
            PresetRefusal { value: 32_000, limit: 31_999 }.to_string(),
            "output octets 1-4: preset to 32000, but at most 31999 is possible, the total measuring range minus 1 (manual 4.3.2)",
        ),
        (
            AddressRefusal::SwitchesDecide { switches: 42 }.to_string(),
            "Set_Slave_Add: the rotary switches are at 2Ah (42) and decide the address, but a change over the bus needs them at 7Eh (126) (manual 3.4)",
        ),
        (
            AddressRefusal::Ident { received: 0x4711, own: 0x108B }.to_string(),
            "Set_Slave_Add octets 2-3: ident number 4711h, but this device has 108Bh (manual 3.4)",
        ),
    ]
}

#[test]
fn refusals_are_sentences_with_octet_value_rule_and_section() {
    for (sentence, expected) in sentences() {
        assert_eq!(sentence, expected);
    }
}

#[test]
fn octet_value_and_section_can_be_had_alone() {
    let units = PrmRefusal::MeasuringUnits { value: 0, variant: Variant::FULL };
    assert_eq!((units.octet(), units.value(), units.section()), (Some(10), 0, "4.1.2"));
    let range = PrmRefusal::MeasuringRange { value: 7, variant: Variant::FULL };
    assert_eq!((range.octet(), range.value(), range.section()), (Some(14), 7, "4.1.3"));
    let length = PrmRefusal::Length { octets: 10 };
    assert_eq!((length.octet(), length.value(), length.section()), (None, 10, "4.1"));
    let bits = PrmRefusal::NotAssigned { value: 0x12 };
    assert_eq!((bits.octet(), bits.value(), bits.section()), (Some(9), 0x12, "4.1.1"));
    let base = PrmRefusal::TimeBase { value: 9 };
    assert_eq!((base.octet(), base.value(), base.section()), (Some(26), 9, "4.1.5"));
    let octets = CfgRefusal::not_offered(&[0xF1, 0xD0]);
    let value = (octets.octet(), octets.value(), octets.section());
    assert_eq!(value, (Some(1), 0xF1D0_0000, "4.3"));
    assert_eq!(CfgRefusal::not_offered(&[]).octet(), None);
    let address = AddressRefusal::OutOfRange { address: 126 };
    assert_eq!((address.octet(), address.value(), address.section()), (Some(1), 126, "3.4"));
}
