//! What a diagnosis means and what to do: octets by hand, from the tables of the manual (4.2) and of the standard.

use dissector::advice::{self, Diagnosis, Difference, Finding, Level, StartUp};
use profibus_dp::dp::{Refusal, Service};
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::event::{Event, PositionErrorCause};
use sch108bex::functionality::Functionality;
use sch108bex::refusal::{AddressRefusal, CfgRefusal, PresetRefusal, PrmRefusal};
use sch108bex::specification::Variant;

/// In data exchange with master 2, watchdog on; scaling 3600 units a turn in a range of 7200; no fault.
const QUIET: [u8; 57] = [
    0x00, 0x0C, 0x00, 0x02, 0x12, 0x34, // standard
    51, 0x00, 0x0A, 2, 0, 1, 0, 0, 0x80, 0, // to the number of revolutions
    0, 0, 3, 0, 0, 0, 0x36, 1, 1, 1, 1, 0, 0, 0, 100, // to the operating time
    0, 0, 0, 0, 0, 0, 0, 0, // offsets
    0, 0, 0x0E, 0x10, 0, 0, 0x1C, 0x20, // 3600, 7200
    b'1', b'2', b'3', b'4', b'5', b'6', b' ', b' ', b' ', b' ',
];

fn with(changes: &[(usize, u8)]) -> Vec<u8> {
    let mut octets = QUIET.to_vec();
    for (number, octet) in changes {
        octets[number - 1] = *octet;
    }
    octets
}

fn findings(octets: &[u8]) -> Vec<Finding> {
    Diagnosis::read(octets).expect("six octets").findings
}

fn names(octets: &[u8], level: Level) -> Vec<String> {
    findings(octets)
        .into_iter()
        .filter(|finding| finding.level == level)
        .map(|finding| finding.name.into())
        .collect()
}

#[test]
fn a_quiet_encoder_has_notes_only() {
    let read = Diagnosis::read(&QUIET).expect("six octets");
    assert!(read.is_encoder && read.level() == Some(Level::Note), "{:?}", read.findings);
    assert_eq!(names(&QUIET, Level::Note), ["Master_Add", "Ident_Number"]);
    let texts: Vec<_> =
        read.findings.iter().map(|finding| (finding.place(), finding.text.as_ref())).collect();
    assert_eq!(texts[0], ("octet 4".to_owned(), "owned by the master at address 2"));
    assert_eq!(texts[1], ("octets 5-6".to_owned(), "the ident number is 1234h"));
    let serial =
        read.fields.iter().find(|field| field.name == "encoder.serial_number").expect("octets 48-57");
    assert_eq!((serial.value.to_string().as_str(), serial.data_octets), ("123456", Some([48, 57])));
}

#[test]
fn every_alarm_and_warning_is_told_alone_with_what_to_do() {
    for (bit, name) in [(0, "Position Error"), (1, "Supply Voltage Error"), (2, "Current Too High")]
        .into_iter()
        .chain([(3, "Commissioning Diagnostics"), (4, "Memory Error"), (7, "Not Assigned Alarm")])
    {
        let octets = with(&[(1, 0x08), (2, 0x0E), (8, 1 << bit)]);
        assert_eq!(names(&octets, Level::Alarm), ["Stat_Diag", name]);
        let finding = findings(&octets).remove(1);
        assert_eq!((finding.octets, finding.bit), ([8, 8], Some(bit)));
        assert!(finding.advice.len() > 20, "{finding:?}");
    }
    for (octet, bit, name) in [
        (21, 0, "Frequency Exceeded"),
        (21, 1, "Temperature Exceeded"),
        (21, 2, "Light Control Reserve"),
        (21, 3, "CPU Watchdog"),
        (21, 4, "Operating Time Limit"),
        (21, 5, "Battery Charge"),
        (21, 6, "Reference Point"),
        (21, 7, "Not Assigned Warning"),
        (20, 0, "Not Assigned Warning"),
    ] {
        let octets = with(&[(1, 0x08), (octet, 1 << bit)]);
        assert_eq!(names(&octets, Level::Warning), [name]);
        let finding = findings(&octets).remove(0);
        assert_eq!(finding.octets, [20, 21]);
        assert_eq!(finding.bit, Some(if octet == 20 { 8 + bit } else { bit }));
        assert!(finding.advice.len() > 20, "{finding:?}");
    }
}

// Manual 4.2.2 and 4.2.9: the remedies that it names.
#[test]
fn the_remedies_are_the_manuals() {
    let advice = |octets: &[u8], name: &str| {
        let found = findings(octets).into_iter().find(|finding| finding.name == name);
        found.expect("a finding").advice.into_owned()
    };
    let position = advice(&with(&[(8, 1)]), "Position Error");
    assert!(position.contains("off and on") && position.contains("preset again"), "{position}");
    let supply = advice(&with(&[(8, 2)]), "Supply Voltage Error");
    assert!(supply.contains("measure"), "{supply}");
    for bit in [0x04, 0x20] {
        let name = if bit == 4 { "Light Control Reserve" } else { "Battery Charge" };
        assert!(advice(&with(&[(21, bit)]), name).contains("at the factory"));
    }
}

#[test]
fn the_gravest_comes_first() {
    let octets = with(&[(1, 0x08), (2, 0x06), (8, 3), (21, 0x22)]);
    let levels: Vec<_> = findings(&octets).iter().map(|finding| finding.level).collect();
    assert!(levels.is_sorted(), "{levels:?}");
    assert_eq!(names(&octets, Level::Alarm), ["Stat_Diag", "Position Error", "Supply Voltage Error"]);
    assert_eq!(names(&octets, Level::Warning), ["WD_On", "Temperature Exceeded", "Battery Charge"]);
}

#[test]
fn every_bit_of_the_standard_is_told() {
    for (octet, value, name, level) in [
        (1, 0x01, "Station_Non_Existent", Level::Warning),
        (1, 0x02, "Station_Not_Ready", Level::Note),
        (1, 0x04, "Cfg_Fault", Level::Alarm),
        (1, 0x08, "Ext_Diag", Level::Note),
        (1, 0x10, "Not_Supported", Level::Warning),
        (1, 0x20, "Invalid_Slave_Response", Level::Warning),
        (1, 0x40, "Prm_Fault", Level::Alarm),
        (1, 0x80, "Master_Lock", Level::Warning),
        (2, 0x0D, "Prm_Req", Level::Note),
        (2, 0x0E, "Stat_Diag", Level::Alarm),
        (2, 0x08, "Always_1", Level::Warning),
        (2, 0x04, "WD_On", Level::Warning),
        (2, 0x1C, "Freeze_Mode", Level::Note),
        (2, 0x2C, "Sync_Mode", Level::Note),
        (2, 0x8C, "Deactivated", Level::Warning),
        (3, 0x80, "Ext_Diag_Overflow", Level::Warning),
        (4, 0x7F, "Master_Add", Level::Warning),
    ] {
        let octets = with(&[(octet, value)]);
        assert!(names(&octets, level).iter().any(|told| told == name), "{name}: {:?}", findings(&octets));
        if name != "Master_Add" {
            assert!(!findings(&QUIET).iter().any(|finding| finding.name == name), "{name}");
        }
    }
    assert_eq!(Diagnosis::read(&QUIET[..5]), None);
}

#[test]
fn the_short_form_says_what_is_not_in_it() {
    let idle = [0x02, 0x05, 0, 0xFF, 0x10, 0x8B, 10, 0, 0, 2, 0, 1, 0, 0, 0x80, 0];
    let header = |octets: &[u8]| {
        let found = findings(octets).into_iter().find(|finding| finding.name == "Header");
        found.expect("a note").text.into_owned()
    };
    assert!(header(&idle).contains("outside data exchange"), "{}", header(&idle));
    let mut class_1 = idle;
    class_1[..4].copy_from_slice(&[0, 0x0C, 0, 2]);
    assert!(header(&class_1).starts_with("class 1"), "{}", header(&class_1));
    let placeholder =
        findings(&idle).into_iter().find(|finding| finding.name == "Ident_Number").expect("a note");
    assert!(placeholder.text.contains("placeholder"), "{placeholder:?}");
    assert!(!names(&idle, Level::Note).iter().any(|name| name == "Master_Add"));
}

// 2^15 turns of 360 units in a range of 1804: 11796480 mod 1804 = 124 (reference vector E121).
#[test]
fn a_scaling_that_jumps_is_a_warning() {
    let octets = with(&[(42, 0x01), (43, 0x68), (46, 0x07), (47, 0x0C)]);
    let found = findings(&octets).remove(0);
    assert_eq!((found.level, found.octets), (Level::Warning, [40, 47]));
    assert!(found.text.contains("jumps by 124 units") && found.advice.contains("11796480"), "{found:?}");
    let mut off = octets;
    off[8] = 0x02;
    assert_eq!(names(&off, Level::Warning), Vec::<String>::new(), "scaling is off");
    assert_eq!(names(&off, Level::Note), ["Master_Add", "Ident_Number", "Scaling Function Status"]);
    let zero = with(&[(42, 0), (43, 0), (46, 0), (47, 0)]);
    assert_eq!(names(&zero, Level::Warning), Vec::<String>::new(), "nothing is divided by 0");
}

#[test]
fn an_offset_is_a_note_and_one_from_another_scaling_a_warning() {
    let preset = findings(&with(&[(32, 0xFF), (33, 0xFF), (34, 0xFF), (35, 0x9C)])).remove(2);
    assert_eq!((preset.level, preset.octets), (Level::Note, [32, 35]));
    assert!(preset.text.contains("-100"), "{preset:?}");
    let foreign = findings(&with(&[(34, 0x1C), (35, 0x20)])).remove(0);
    assert_eq!((foreign.level, foreign.name.as_ref()), (Level::Warning, "Offset Value"));
}

#[test]
fn other_encoders_and_other_slaves_are_told_as_what_they_are() {
    let other = with(&[(9, 0x0F), (10, 1), (17, 4), (28, 255), (29, 255), (30, 255), (31, 255), (39, 7)]);
    assert_eq!(names(&other, Level::Alarm), ["Additional Alarms"]);
    let notes = names(&other, Level::Note);
    for name in [
        "Code Sequence",
        "Commissioning Diagnostics",
        "Encoder Type",
        "Operating Time",
        "Manufacturer Offset Value",
    ] {
        assert!(notes.iter().any(|note| note == name), "{name}: {notes:?}");
    }
    // Module 2 of an identifier block; channel 3 of module 1: line break; three octets of the device's own.
    let modular = [0x08, 0x0C, 0, 2, 0x47, 0x11, 0x42, 0x04, 0x81, 0x43, 0x26, 0x03, 0xAA, 0xBB];
    let read = Diagnosis::read(&modular).expect("six octets");
    assert!(!read.is_encoder);
    assert_eq!(names(&modular, Level::Warning), ["Identifier_Block", "Channel_Block"]);
    let texts: Vec<_> = read.findings.iter().take(2).map(|finding| finding.text.as_ref()).collect();
    assert!(texts[0].contains("module 2") && texts[1].contains("line break"), "{texts:?}");
    assert!(names(&modular, Level::Note).iter().any(|name| name == "Device_Block"));
}

#[test]
fn every_refusal_has_an_advice_of_its_own_kind() {
    let parameters = [
        PrmRefusal::Length { octets: 8 },
        PrmRefusal::Class2Missing { value: 0 },
        PrmRefusal::Commissioning { value: 6 },
        PrmRefusal::NotAssigned { value: 0x12 },
        PrmRefusal::MeasuringUnits { value: 0, variant: Variant::FULL },
        PrmRefusal::MeasuringRange { value: 0, variant: Variant::FULL },
        PrmRefusal::Reserved { octet: 18, value: 1 },
        PrmRefusal::TimeBase { value: 4 },
        PrmRefusal::ShorterThanAgreed { octets: 9, functionality: Functionality::Class2 },
    ];
    let mut told: Vec<_> = parameters.iter().map(advice::of_parameters).collect();
    told.extend([
        advice::of_configuration(&CfgRefusal::not_offered(&[0xD0])),
        advice::of_configuration(&CfgRefusal::ParametersTooShort {
            functionality: Functionality::Class2,
            have: 9,
        }),
        advice::of_preset(&PresetRefusal { value: 9, limit: 8 }),
        advice::of_address(&AddressRefusal::SwitchesDecide { switches: 5 }),
        advice::of_address(&AddressRefusal::Ident { received: 1, own: 2 }),
    ]);
    let mut distinct = told.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), told.len(), "{told:?}");
    assert!(advice::of_parameters(&parameters[4]).contains("high and low words"));
    assert!(advice::of_refusal(&Refusal::NotInThisState(Service::ChkCfg)).contains("Set_Prm"));
    assert!(advice::of_refusal(&Refusal::PrmIdent { received: 1, own: 2 }).contains("GSD"));
}

#[test]
fn an_event_has_the_advice_of_what_it_tells() {
    let supply = findings(&with(&[(8, 2)])).remove(0).advice.into_owned();
    assert_eq!(advice::of_event(&Event::AlarmRaised(Alarms::SUPPLY_VOLTAGE)), Some(supply.as_str()));
    let battery = findings(&with(&[(21, 0x20)])).remove(0).advice.into_owned();
    assert_eq!(advice::of_event(&Event::WarningRaised(Warnings::BATTERY_CHARGE)), Some(battery.as_str()));
    let refusal = PrmRefusal::TimeBase { value: 4 };
    assert_eq!(advice::of_event(&Event::PrmRefused(refusal)), Some(advice::of_parameters(&refusal)));
    let lost = advice::of_event(&Event::PositionErrorCause(PositionErrorCause::TurnCountLost));
    assert!(lost.is_some_and(|advice| advice.contains("battery")), "{lost:?}");
    assert_eq!(advice::of_event(&Event::PresetTaken { from: 1, to: 2, offset: 1 }), None);
    assert_eq!(advice::of_event(&Event::AlarmRaised(Alarms::empty())), None);
}

#[test]
fn documents_have_names_that_do_not_change() {
    let document = serde_json::to_value(findings(&with(&[(8, 2)])).remove(0)).expect("JSON");
    assert_eq!(document["octets"], serde_json::json!([8, 8]));
    assert_eq!((&document["bit"], &document["level"]), (&1.into(), &"alarm".into()));
    assert_eq!(document["name"], "Supply Voltage Error");
}

/// 16x15, ident 1234h, Scancon 2.0, 3600 units a turn in a range of 7200.
const SET_PRM: [u8; 26] = [
    0x88, 1, 100, 11, 0x12, 0x34, 0, 0x00, 0x0A, 0, 0, 0x0E, 0x10, 0, 0, 0x1C, 0x20, 0, 0, 0, 0, 0, 0, 0, 0,
    1,
];
const CFG: [u8; 3] = [0xF1, 0xD1, 0xD1];

fn refused(first: u8) -> Vec<u8> {
    vec![first, 0x05, 0, 0xFF, 0x12, 0x34, 10, 0, 0, 2, 0, 1, 0, 0, 0x80, 0]
}

fn sent(changes: &[(usize, u8)]) -> Vec<u8> {
    let mut octets = SET_PRM.to_vec();
    for (number, octet) in changes {
        octets[number - 1] = *octet;
    }
    octets
}

#[track_caller]
fn only(set_prm: &[u8], chk_cfg: &[u8], diagnosis: &[u8], get_cfg: Option<&[u8]>) -> Difference {
    let mut all = StartUp { set_prm, chk_cfg, diagnosis, get_cfg }.differences();
    assert_eq!(all.len(), 1, "{all:?}");
    all.remove(0)
}

#[test]
fn a_start_up_that_went_well_has_no_difference() {
    let start_up = StartUp { set_prm: &SET_PRM, chk_cfg: &CFG, diagnosis: &QUIET, get_cfg: Some(&CFG) };
    assert_eq!(start_up.differences(), []);
    assert_eq!(StartUp { diagnosis: &QUIET[..5], ..start_up }.differences(), []);
}

#[test]
fn refused_parameters_are_told_by_their_octet() {
    let fault = refused(0x42);
    for (changes, octets, sent_words, expected) in [
        (&[(5, 0x47), (6, 0x11)][..], [5, 6], "4711h", "1234h"),
        (&[(1, 0x8A)], [1, 1], "8Ah", "bits 0 to 2 off"),
        (&[(3, 0)], [3, 3], "00h", "1 to 255"),
        (&[(8, 0x80)], [8, 8], "80h", "00h"),
        (&[(9, 0x08)], [9, 9], "08", "must be on"),
        // 65537 units, in octets 10-13.
        (&[(11, 1), (12, 0), (13, 1)], [10, 13], "00 01 00 01", "at most 65536"),
        (&[(16, 0), (17, 0)], [14, 17], "00 00 00 00", "1 to 2147483648"),
        (&[(20, 5)], [20, 20], "05", "must be 0"),
        (&[(26, 4)], [26, 26], "04", "must be 0 (10 ms)"),
    ] {
        let difference = only(&sent(changes), &CFG, &fault, Some(&CFG));
        assert_eq!((difference.telegram, difference.octets), ("Set_Prm", Some(octets)), "{difference:?}");
        assert_eq!(difference.sent, sent_words);
        assert!(difference.expected.contains(expected), "{difference:?}");
        assert!(!difference.advice.is_empty() && !difference.text.is_empty());
    }
    let both = only(&sent(&[(26, 4)]), &CFG, &refused(0x46), Some(&[0xD1]));
    assert_eq!(both.telegram, "Set_Prm", "the configuration is refused for the parameters' sake");
    let short = only(&SET_PRM[..24], &CFG, &fault, None);
    assert_eq!((short.octets, short.sent.as_str()), (None, "24 octets"));
}

#[test]
fn a_refused_configuration_is_told_by_its_octet_and_lengths() {
    let fault = refused(0x06);
    let wrong = only(&SET_PRM, &[0xF1, 0xD0], &fault, Some(&CFG));
    assert_eq!((wrong.telegram, wrong.octets), ("Chk_Cfg", Some([2, 2])));
    assert_eq!((wrong.sent.as_str(), wrong.expected.as_str()), ("D0h", "D1h"));
    for words in ["F1 D0 (6 in, 4 out)", "F1 D1 D1 (12 in, 4 out)", "F1 D3"] {
        assert!(wrong.text.contains(words), "{wrong:?}");
    }
    let longer = only(&SET_PRM, &[0xF1, 0xD1, 0xD1, 0xD1], &fault, Some(&CFG));
    assert_eq!((longer.octets, longer.expected.as_str()), (Some([4, 4]), "nothing"));
    // Class 2 needs 25 octets of parameters.
    let parameters = only(&SET_PRM[..9], &[0xF1], &fault, Some(&[0xD1]));
    assert_eq!((parameters.telegram, parameters.octets), ("Set_Prm", None));
    assert_eq!((parameters.sent.as_str(), parameters.expected.as_str()), ("9 octets", "25 octets"));
    let unknown = StartUp { set_prm: &SET_PRM, chk_cfg: &[0xF1, 0xD0], diagnosis: &fault, get_cfg: None };
    assert_eq!(unknown.differences(), [], "nothing is guessed");
}

#[test]
fn another_scaling_in_force_is_told() {
    // The device reduced 7201 to 7200, as other makers' encoders do.
    let difference = only(&sent(&[(17, 0x21)]), &CFG, &QUIET, Some(&CFG));
    assert_eq!((difference.telegram, difference.octets), ("Slave_Diag", Some([44, 47])));
    assert_eq!((difference.sent.as_str(), difference.expected.as_str()), ("7201", "7200"));
    let off = sent(&[(9, 0x02), (17, 0x21)]);
    assert_eq!(StartUp { set_prm: &off, chk_cfg: &CFG, diagnosis: &QUIET, get_cfg: None }.differences(), []);
}
