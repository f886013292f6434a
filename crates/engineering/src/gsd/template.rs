//! The one template of our GSD files.

use std::fmt::Write;

use sch108bex::functionality::Functionality;
use sch108bex::parameterization::Parameters;
use sch108bex::specification::Variant;

/// The variants whose files are kept in the folder `gsd`.
pub const KEPT: [(u8, u8); 4] = [(16, 15), (13, 12), (12, 12), (13, 0)];

/// Octets of Set_Prm before the user parameters: the first of these is octet 8.
const STANDARD_OCTETS: usize = 7;

/// The name of a variant's file.
pub fn file_name(variant: Variant) -> String {
    format!("sch108bex-{variant}.gsd")
}

/// The GSD of a variant with an ident number. Lines end as on Windows, where the tools run.
///
/// It has the three functionalities as modules, of which a master takes one. Defaults are the manual's
/// (4.1) and also stand as constants, for masters that do not look at the single parameters.
pub fn text(variant: Variant, ident_number: u16) -> String {
    let steps = variant.steps_per_revolution();
    let total = variant.total();
    let mut text = HEAD
        .replace("@VARIANT@", &variant.to_string())
        .replace("@IDENT@", &format!("0x{ident_number:04X}"))
        .replace("@STEPS@", &steps.to_string())
        .replace("@TOTAL@", &total.to_string());
    for functionality in Functionality::ALL {
        text.push_str(&module(functionality, variant));
    }
    text.replace('\n', "\r\n")
}

/// A functionality as a module: identifiers, constants, and where the parameters lie.
fn module(functionality: Functionality, variant: Variant) -> String {
    let (name, references): (_, &[(u8, u8)]) = match functionality {
        Functionality::Class1 => ("Class 1 Multiturn", &[(1, 1)]),
        Functionality::Class2 => ("Class 2 Multiturn", &[(1, 1), (1, 2), (1, 3), (2, 4), (6, 5)]),
        Functionality::Scancon2 => {
            ("Scancon 2.0 Multiturn", &[(1, 1), (1, 2), (1, 3), (2, 4), (6, 5), (18, 6)])
        }
    };
    let constants = user_parameters(functionality, variant);
    let mut text = format!(
        "\nModule = \"{name}\" {}\nExt_Module_Prm_Data_Len = {}\nExt_User_Prm_Data_Const(0) = {}\n",
        octets(functionality.configuration()),
        constants.len(),
        octets(&constants),
    );
    for (offset, parameter) in references {
        let _ = writeln!(text, "Ext_User_Prm_Data_Ref({offset}) = {parameter}");
    }
    text.push_str("EndModule\n");
    text
}

/// Octet 8 and up of a Set_Prm with the manual's defaults.
fn user_parameters(functionality: Functionality, variant: Variant) -> Vec<u8> {
    let parameters =
        Parameters { length: functionality.parameter_length(), ..Parameters::default_for(variant) };
    let mut set_prm = [0; 26];
    let length = parameters.emit(&mut set_prm);
    set_prm[STANDARD_OCTETS..length].to_vec()
}

fn octets(octets: &[u8]) -> String {
    let list: Vec<_> = octets.iter().map(|octet| format!("0x{octet:02X}")).collect();
    list.join(",")
}

/// Everything but the modules.
const HEAD: &str = "\
; GSD of the software SCH108BEX with @VARIANT@ bits. It is NOT the maker's file, and it is not
; affiliated with Scancon. Made by: sch108bex gsd --bits @VARIANT@ --ident @IDENT@
;
; The maker's ident number is not public. 0x108B is a placeholder for the bench that PI has not
; assigned to this device; in a plant use the maker's GSD, and give it to: sch108bex run --gsd FILE
; The identifiers of Scancon 2.0 are ours for the same reason.
#Profibus_DP
GSD_Revision = 2
Vendor_Name = \"SCH108BEX software (not Scancon)\"
Model_Name = \"SCH108BEX software @VARIANT@\"
Revision = \"V1.1\"
Ident_Number = @IDENT@
Protocol_Ident = 0
Station_Type = 0
FMS_supp = 0
Hardware_Release = \"software\"
Software_Release = \"V1.1\"
9.6_supp = 1
19.2_supp = 1
45.45_supp = 1
93.75_supp = 1
187.5_supp = 1
500_supp = 1
1.5M_supp = 1
3M_supp = 1
6M_supp = 1
12M_supp = 1
MaxTsdr_9.6 = 60
MaxTsdr_19.2 = 60
MaxTsdr_45.45 = 60
MaxTsdr_93.75 = 60
MaxTsdr_187.5 = 60
MaxTsdr_500 = 100
MaxTsdr_1.5M = 150
MaxTsdr_3M = 250
MaxTsdr_6M = 450
MaxTsdr_12M = 800
Redundancy = 0
Repeater_Ctrl_Sig = 0
24V_Pins = 0
Implementation_Type = \"Software\"
Freeze_Mode_supp = 1
Sync_Mode_supp = 1
Auto_Baud_supp = 1
Set_Slave_Add_supp = 1
Fail_Safe = 1
Min_Slave_Intervall = 1
Slave_Family = 7@SCH108BEX software
DP_Encoder_class = 2
DP_Encoder_profile_version = 1.1
DP_Encoder_manufacturer_specific_functions = 1
Modular_Station = 1
Max_Module = 1
Modul_Offset = 1
Max_Input_Len = 12
Max_Output_Len = 4
Max_Data_Len = 16
Max_Diag_Data_Len = 57
Max_User_Prm_Data_Len = 19

; Bits count from octet 8 of the diagnosis on: alarms are octet 8, warnings octets 20 and 21.
Unit_Diag_Bit(0) = \"Alarm: position error\"
Unit_Diag_Bit(1) = \"Alarm: supply not 9 to 30 V\"
Unit_Diag_Bit(105) = \"Warning: above 65 degrees C\"
Unit_Diag_Bit(106) = \"Warning: light reserve used up\"
Unit_Diag_Bit(108) = \"Warning: above 87600 h\"
Unit_Diag_Bit(109) = \"Warning: battery low\"

PrmText = 1
Text(0) = \"Clockwise\"
Text(1) = \"Counter-clockwise\"
EndPrmText
PrmText = 2
Text(1) = \"Enabled\"
EndPrmText
PrmText = 3
Text(0) = \"Disabled\"
Text(1) = \"Enabled\"
EndPrmText
PrmText = 4
Text(0) = \"Steps per 10 ms\"
Text(1) = \"Steps per 100 ms\"
Text(2) = \"Steps per 1000 ms\"
Text(3) = \"RPM\"
EndPrmText

ExtUserPrmData = 1 \"Code sequence\"
Bit(0) 0 0-1
Prm_Text_Ref = 1
EndExtUserPrmData
ExtUserPrmData = 2 \"Class 2 functionality\"
Bit(1) 1 1-1
Prm_Text_Ref = 2
EndExtUserPrmData
ExtUserPrmData = 3 \"Scaling function control\"
Bit(3) 0 0-1
Prm_Text_Ref = 3
EndExtUserPrmData
ExtUserPrmData = 4 \"Measuring units per revolution\"
Unsigned32 @STEPS@ 1-@STEPS@
EndExtUserPrmData
ExtUserPrmData = 5 \"Total measuring range\"
Unsigned32 @TOTAL@ 1-@TOTAL@
EndExtUserPrmData
ExtUserPrmData = 6 \"Time base\"
Unsigned8 1 0-3
Prm_Text_Ref = 4
EndExtUserPrmData
";

#[cfg(test)]
mod tests {
    use super::*;

    // What engineering tools take: 32 characters of a text, 80 columns of old lines left aside.
    #[test]
    fn texts_are_at_most_32_characters() {
        let text = text(Variant::FULL, 0x108B);
        for line in text.lines().filter(|line| !line.starts_with(';')) {
            if let Some(quoted) = line.split('"').nth(1) {
                assert!(quoted.len() <= 32, "{quoted} has {}", quoted.len());
            }
        }
    }

    #[test]
    fn it_says_whose_it_is_where_tools_show_it() {
        let text = text(Variant::FULL, 0x108B);
        assert!(text.starts_with("; GSD of the software SCH108BEX"));
        assert!(text.contains("NOT the maker's file"));
        assert!(text.contains("Vendor_Name = \"SCH108BEX software (not Scancon)\"\r\n"));
        assert!(text.contains("Model_Name = \"SCH108BEX software 16x15\"\r\n"));
    }

    #[test]
    fn no_place_of_the_template_is_left() {
        for (n, m) in KEPT {
            let text = text(Variant::new(n, m).expect("a variant"), 0xABCD);
            assert!(!text.contains("@VARIANT@") && !text.contains("@STEPS@") && !text.contains("@TOTAL@"));
            assert!(text.contains("Ident_Number = 0xABCD\r\n"));
            assert!(text.is_ascii());
        }
    }
}
