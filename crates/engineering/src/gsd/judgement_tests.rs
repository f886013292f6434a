use std::fmt::Write;
use std::path::Path;

use super::*;
use gsd_reader::read;

use crate::gsd::text;

/// Our own file with some of its lines changed: the file of a master's project.
fn judged(changes: &[(&str, &str)]) -> Result<Judgement, String> {
    let mut file = text(Variant::FULL, 0x4711);
    for (from, to) in changes {
        assert!(file.contains(from), "{from} is not in the file");
        file = file.replace(from, to);
    }
    let gsd = read(Path::new("test.gsd"), &file).expect("the test's own GSD");
    judge(&gsd, &file, Variant::FULL)
}

#[track_caller]
fn notes(changes: &[(&str, &str)]) -> Vec<String> {
    judged(changes).expect("a GSD of this device").notes
}

/// There is just one remark, and it has these words.
#[track_caller]
fn one_note(changes: &[(&str, &str)], words: &[&str]) {
    let notes = notes(changes);
    assert_eq!(notes.len(), 1, "{notes:#?}");
    for word in words {
        assert!(notes[0].contains(word), "{word} is not in: {}", notes[0]);
    }
}

#[test]
fn our_own_file_fits() {
    assert_eq!(notes(&[]), Vec::<String>::new());
}

#[test]
fn ident_and_configuration_are_taken_over() {
    let judgement = judged(&[("0xF1,0xD1,0xD1", "0xE1,0xD5")]).expect("fits");
    assert_eq!(judgement.ident_number, 0x4711);
    let chosen = judgement.configurations.find(&[0xE1, 0xD5]).map(|(functionality, _)| functionality);
    assert_eq!(chosen, Some(Functionality::Scancon2));
    assert!(judgement.configurations.find(&[0xF1, 0xD3]).is_none(), "the file's octets, not ours");
    assert!(judgement.configurations.find(&[0xF1]).is_some());
    assert!(judgement.notes.is_empty(), "{:?}", judgement.notes);
}

#[test]
fn two_modules_of_one_functionality_are_both_taken_over() {
    let file = text(Variant::FULL, 0x4711);
    let start = "\r\nModule = \"Scancon";
    let scancon = file.split_once(start).expect("a module").1;
    let another = scancon.replace("0xF1,0xD1,0xD1", "0xE1,0xD5").replace("Multiturn", "again");
    let file = format!("{file}{start}{another}");
    let gsd = read(Path::new("test.gsd"), &file).expect("a GSD");
    let judgement = judge(&gsd, &file, Variant::FULL).expect("fits");
    for octets in [&[0xF1, 0xD1, 0xD1][..], &[0xE1, 0xD5]] {
        let found = judgement.configurations.find(octets).map(|(functionality, _)| functionality);
        assert_eq!(found, Some(Functionality::Scancon2), "{octets:02X?}");
    }
}

#[test]
fn what_the_file_does_not_have_stays_ours() {
    let start = "\r\nModule = \"Class 1";
    let file = text(Variant::FULL, 0x4711);
    let (head, modules) = file.split_once(start).expect("modules");
    let class_1 = modules.split_once("EndModule").expect("an end").0;
    let file = format!("{head}{start}{class_1}EndModule\r\n");
    let gsd = read(Path::new("test.gsd"), &file).expect("a GSD");
    let judgement = judge(&gsd, &file, Variant::FULL).expect("fits");
    assert!(judgement.configurations.find(&[0xF1, 0xD3]).is_some(), "the file says nothing of Scancon 2.0");
}

#[test]
fn another_layout_is_told_and_not_adopted() {
    one_note(
        &[("Ext_Module_Prm_Data_Len = 18", "Ext_Module_Prm_Data_Len = 10")],
        &["Class 2 Multiturn", "17 octets", "needs 25"],
    );
    one_note(
        &[
            ("Ext_Module_Prm_Data_Len = 19", "Ext_Module_Prm_Data_Len = 32"),
            ("Prm_Data_Len = 19", "Prm_Data_Len = 32"),
        ],
        &["39 octets", "has 26", "stays in force"],
    );
    let misplaced = notes(&[("Ext_User_Prm_Data_Ref(18) = 6", "Ext_User_Prm_Data_Ref(17) = 6")]);
    assert_eq!(misplaced.len(), 2, "{misplaced:#?}");
    assert!(misplaced[0].contains("Time base") && misplaced[0].contains("octet 25"), "{}", misplaced[0]);
    assert!(
        misplaced[1].contains("would be refused") && misplaced[1].contains("octet 25"),
        "{}",
        misplaced[1]
    );
    one_note(&[("Unsigned8 1 0-3", "Unsigned16 1 0-3")], &["octet 26", "Unsigned16"]);
}

// Octets of Set_Prm that the device refuses, manual 4.1.1 to 4.1.5.
#[test]
fn parameters_that_the_device_would_refuse_are_told() {
    for (from, to, words) in [
        ("= 0x00,0x00\r\n", "= 0x80,0x00\r\n", "octet 8"),
        ("= 0x00,0x00\r\n", "= 0x00,0x04\r\n", "commissioning"),
        ("= 0x00,0x00\r\n", "= 0x00,0x40\r\n", "bits 4-7"),
        ("Bit(3) 0 0-1", "Bit(2) 1 0-1", "commissioning"),
    ] {
        let notes = notes(&[(from, to)]);
        assert!(
            !notes.is_empty() && notes.iter().all(|note| note.contains("would be refused")),
            "{notes:#?}"
        );
        assert!(notes.iter().any(|note| note.contains(words)), "{words}: {notes:#?}");
    }
    // Without the bit of class 2 in the constants pyprofibus, which knows nothing else, is refused.
    let notes = notes(&[("0x00,0x02,0x00,0x01", "0x00,0x00,0x00,0x01")]);
    assert_eq!(notes.len(), 2, "{notes:#?}");
    assert!(notes[0].contains("by its constants alone") && notes[0].contains("bit 1"), "{notes:#?}");
}

#[test]
fn values_that_another_variant_has_are_told() {
    let file = text(Variant::FULL, 0x4711);
    let gsd = read(Path::new("test.gsd"), &file).expect("a GSD");
    let small = Variant::new(13, 12).expect("a variant");
    let notes = judge(&gsd, &file, small).expect("fits").notes;
    assert_eq!(notes.len(), 4, "units and range in class 2 and in Scancon 2.0: {notes:#?}");
    assert!(notes[0].contains("65536 by default, more than the 8192 that 13x12 bits allow"), "{}", notes[0]);
    one_note(&[("Unsigned8 1 0-3", "Unsigned8 1 0-9")], &["Time base", "up to 9", "more than 3"]);
}

#[test]
fn the_time_bases_of_other_makers_are_told() {
    let changes = [
        ("Text(0) = \"Steps per 10 ms\"", "Text(0) = \"Steps per 1000 ms\""),
        ("Text(2) = \"Steps per 1000 ms\"", "Text(2) = \"Steps per 10 ms\""),
    ];
    one_note(&changes, &["calls 0 \"Steps per 1000 ms\"", "manual 4.1.5"]);
}

#[test]
fn what_the_station_cannot_or_may_not_is_told() {
    one_note(&[("\r\n3M_supp = 1", "\r\n3M_supp = 0"), ("12M_supp = 1", "12M_supp = 0")], &["3M, 12M"]);
    one_note(&[("Max_Diag_Data_Len = 57", "Max_Diag_Data_Len = 16")], &["Max_Diag_Data_Len is 16", "57"]);
    one_note(&[("Max_User_Prm_Data_Len = 19", "Max_User_Prm_Data_Len = 0x12")], &["is 18", "needs 19"]);
    one_note(&[("Max_Input_Len = 12", "Max_Input_Len = 4")], &["Max_Input_Len 4", "12"]);
    one_note(&[("Max_Data_Len = 16", "Max_Data_Len = 8")], &["Max_Data_Len is 8", "16"]);
    one_note(&[("Max_Module = 1", "Max_Module = 3")], &["Max_Module is 3", "one module"]);
    one_note(&[("Modular_Station = 1", "Modular_Station = 0")], &["all of them at once"]);
    one_note(&[("FMS_supp = 0", "FMS_supp = 0\r\nDPV1_Slave = 1")], &["DPV1_Slave", "DP-V0"]);
    one_note(&[("Set_Slave_Add_supp = 1", "Set_Slave_Add_supp = 0")], &["Set_Slave_Add_supp"]);
    // Other encoders leave 45.45 kbit/s out; no master misses it.
    assert!(notes(&[("45.45_supp = 1", "45.45_supp = 0")]).is_empty());
}

#[test]
fn a_file_without_ident_number_or_of_another_device_is_an_error() {
    let error = judged(&[("Ident_Number = 0x4711", "Ident_Number = 0")]).expect_err("no ident number");
    assert!(error.contains("Ident_Number"), "{error}");
    let other = "#Profibus_DP\nIdent_Number = 0x0001\nModule = \"DI\" 0x10\nEndModule\n";
    let gsd = read(Path::new("test.gsd"), other).expect("a GSD");
    assert!(judge(&gsd, other, Variant::FULL).expect_err("no encoder").contains("another device"));
}

#[test]
fn thousands_of_foreign_modules_are_not_told_one_by_one() {
    let mut file = text(Variant::FULL, 0x4711);
    for number in 0..1_000 {
        let _ = write!(file, "Module = \"M{number}\" 0x10\r\nEndModule\r\n");
    }
    let gsd = read(Path::new("test.gsd"), &file).expect("a GSD");
    let notes = judge(&gsd, &file, Variant::FULL).expect("fits").notes;
    assert!(notes.len() == 41 && notes[40].contains("960 more"), "{}", notes.len());
}

// Offsets, lengths and defaults without any sense must not bring it down.
#[test]
fn senseless_numbers_are_judged_too() {
    let file = text(Variant::FULL, 0x4711)
        .replace("Ref(18) = 6", "Ref(4294967295) = 6")
        .replace("Const(0) = 0x00,0x00\r\n", "Const(4294967295) = 0x00,0x00\r\n")
        .replace("Bit(0) 0 0-1", "BitArea(200-100) 255 0-1")
        .replace("Unsigned8 1 0-3", "Unsigned8 4294967295 7-3");
    let gsd = read(Path::new("test.gsd"), &file).expect("a GSD");
    assert!(!judge(&gsd, &file, Variant::FULL).expect("fits").notes.is_empty());
}
