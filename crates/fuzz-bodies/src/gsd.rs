//! A user's GSD file: any text, and text made of what GSD files are made of.

use std::path::Path;

use engineering::gsd::judge;
use gsd_reader::read;
use master::gsd::Gsd;
use profibus_dp::time::Baudrate;
use sch108bex::specification::Variant;

use crate::tape::Tape;

/// What lines of GSD files are made of.
const FRAGMENTS: [&str; 64] = [
    "#Profibus_DP\n",
    "GSD_Revision = 2\n",
    "Vendor_Name = \"V\"\n",
    "Ident_Number = 0x108B\n",
    "Ident_Number = ",
    "Module = \"M\" 0xF1\n",
    "Module = \"C\" 0xD1\n",
    "Module = \"S\" 0xF1,0xD1,0xD1\n",
    "EndModule\n",
    "Module = ",
    "Ext_User_Prm_Data_Const(0) = 0x00\n",
    "Ext_User_Prm_Data_Const(",
    "Ext_User_Prm_Data_Ref(1) = 1\n",
    "Ext_User_Prm_Data_Ref(",
    "User_Prm_Data_Len = 19\n",
    "User_Prm_Data_Len = ",
    "User_Prm_Data = 0x00,0x0A\n",
    "ExtUserPrmData = 1 \"P\"\n",
    "ExtUserPrmData = ",
    "EndExtUserPrmData\n",
    "Bit(0) 0 0-1\n",
    "BitArea(0-3) 1 0-15\n",
    "Unsigned8 0 0-255\n",
    "Unsigned16 4096 1-65535\n",
    "Unsigned32 4096 1-65536\n",
    "Signed16 0 -1-1\n",
    "Bit(",
    "Prm_Text_Ref = 1\n",
    "PrmText = 1\n",
    "Text(0) = \"off\"\n",
    "EndPrmText\n",
    "Text(",
    "SlotDefinition\n",
    "Slot(1) = \"S\" 1 1-2\n",
    "EndSlotDefinition\n",
    "Max_User_Prm_Data_Len = 237\n",
    "Max_Input_Len = 12\n",
    "9.6_supp = 1\n",
    "1.5M_supp = 1\n",
    "12M_supp = 1\n",
    "MaxTsdr_1.5M = 60\n",
    "MaxTsdr_12M = ",
    "Fail_Safe = 1\n",
    "Modular_Station = 1\n",
    "Max_Module = 1\n",
    "Unit_Diag_Area = 0-7\n",
    "Unit_Diag_Area_End\n",
    "Value(1) = \"x\"\n",
    "0",
    "1",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "-1",
    "0x",
    "FF",
    "\"",
    "\n",
    ",",
    "-",
    ")",
    " = ",
    ";",
];

/// The first octet says which: text as it is, or made of fragments.
///
/// # Panics
///
/// When something is taken over that no encoder has, or a message cannot be shown.
pub fn gsd(octets: &[u8]) {
    let mut tape = Tape::new(octets);
    let variant = if tape.octet() & 2 == 0 { Variant::FULL } else { Variant::new(12, 4).expect("12x4") };
    let text = match octets.first() {
        Some(first) if first & 1 == 1 => {
            octets[1..].iter().map(|at| FRAGMENTS[usize::from(*at) % FRAGMENTS.len()]).collect()
        }
        // As it is read where it is no UTF-8.
        _ => octets.get(1..).unwrap_or_default().iter().map(|octet| char::from(*octet)).collect::<String>(),
    };
    match read(Path::new("a.gsd"), &text) {
        Ok(gsd) => match judge(&gsd, &text, variant) {
            Ok(judgement) => {
                assert_ne!(judgement.ident_number, 0);
                judgement.notes.iter().for_each(|note| can_be_shown(note));
            }
            Err(why) => can_be_shown(&why),
        },
        Err(error) => can_be_shown(&error.to_string()),
    }
    of_a_master(&text);
}

/// What the commissioning master takes from it.
fn of_a_master(text: &str) {
    let gsd = match Gsd::parse("a.gsd", text) {
        Ok(gsd) => gsd,
        Err(error) => return can_be_shown(&error.to_string()),
    };
    for rate in Baudrate::ALL {
        if let Err(error) = gsd.max_tsdr(rate) {
            can_be_shown(&error.to_string());
        }
    }
    for name in [None, Some("M"), Some("nobody's")] {
        match gsd.module(name) {
            Ok(module) => {
                if let Ok(octets) = gsd.user_parameters(module, &[("P".to_owned(), "1".to_owned())]) {
                    assert!(octets.len() <= 237, "{} octets fit in no Set_Prm", octets.len());
                }
            }
            Err(error) => can_be_shown(&error.to_string()),
        }
    }
}

fn can_be_shown(message: &str) {
    assert!(!message.is_empty() && message.len() < 100_000);
    let hidden = message.chars().find(|c| c.is_control() && *c != '\n' && *c != '\t');
    assert_eq!(hidden, None, "{message:?}");
}
