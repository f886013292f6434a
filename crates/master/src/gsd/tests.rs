use super::*;

/// A device of nobody with parameters of every kind.
const GSD: &str = "#Profibus_DP
GSD_Revision = 2
Vendor_Name = \"Nobody\"
Model_Name = \"Nothing\"
Ident_Number = 0x4711
500_supp = 1
1.5M_supp = 1
MaxTsdr_500 = 90
MaxTsdr_1.5M = 140
Modular_Station = 1
Max_Module = 1
PrmText = 1
Text(0) = \"Clockwise\"
Text(1) = \"Counter-clockwise\"
EndPrmText
ExtUserPrmData = 1 \"Direction\"
Bit(0) 0 0-1
Prm_Text_Ref = 1
EndExtUserPrmData
ExtUserPrmData = 2 \"Area\"
BitArea(4-6) 5 0-7
EndExtUserPrmData
ExtUserPrmData = 3 \"Units\"
Unsigned32 4096 1-65536
EndExtUserPrmData
ExtUserPrmData = 4 \"Signed\"
Signed16 -2 -100-100
EndExtUserPrmData
ExtUserPrmData = 5 \"Choice\"
Unsigned8 1 1,2,4
EndExtUserPrmData
Max_User_Prm_Data_Len = 20
Ext_User_Prm_Data_Const(0) = 0x00,0x02
Ext_User_Prm_Data_Ref(1) = 1
Ext_User_Prm_Data_Ref(1) = 2
Module = \"Small\" 0xD1
Ext_Module_Prm_Data_Len = 1
Ext_User_Prm_Data_Ref(0) = 5
EndModule
Module = \"Large\" 0xF1,0xD1,0xD1
Ext_Module_Prm_Data_Len = 8
Ext_User_Prm_Data_Const(0) = 1,2,3,4,5,6,7,8
Ext_User_Prm_Data_Ref(0) = 3
Ext_User_Prm_Data_Ref(5) = 4
EndModule
";

fn gsd() -> Gsd {
    Gsd::parse("test.gsd", GSD).expect("the test's own")
}

fn set(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|&(name, value)| (name.to_owned(), value.to_owned())).collect()
}

#[test]
fn constants_and_defaults_are_where_the_file_has_them() {
    let gsd = gsd();
    let large = gsd.slave(5, Baudrate::B500000, Some("Large"), &[]).expect("fits");
    // Of the station: 00, then 02 with Area 5 in bits 4 to 6. Of the module: 4096 over 1 2 3 4, then 5,
    // then -2 over 6 7, then 8.
    assert_eq!(large.parameters.user, [0x00, 0x52, 0, 0, 0x10, 0, 5, 0xFF, 0xFE, 8]);
    assert_eq!((large.parameters.ident_number, &large.configuration[..]), (0x4711, &[0xF1, 0xD1, 0xD1][..]));
    assert_eq!((large.inputs, large.outputs, large.max_tsdr), (12, 4, 90));
    let small = gsd.slave(5, Baudrate::B1500000, Some("small"), &[]).expect("fits");
    assert_eq!((&small.parameters.user[..], small.max_tsdr), (&[0x00, 0x52, 1][..], 140));
    assert_eq!((small.inputs, small.outputs), (4, 0));
}

// FA is 1111 1010: bit 0 becomes Direction 0, bits 4 to 6 Area 5, and the others stay.
#[test]
fn bits_beside_a_parameter_keep_their_constant() {
    let text = GSD.replace("= 0x00,0x02", "= 0x00,0xFA");
    let gsd = Gsd::parse("test.gsd", &text).expect("the test's own");
    let small = gsd.slave(5, Baudrate::B500000, Some("Small"), &[]).expect("fits");
    assert_eq!(small.parameters.user, [0x00, 0b1101_1010, 1]);
}

#[test]
fn parameters_are_set_by_name_to_numbers_and_texts() {
    let pairs =
        set(&[("direction", "counter-clockwise"), ("Area", "0"), ("Units", "0x10000"), ("Signed", "-100")]);
    let slave = gsd().slave(5, Baudrate::B500000, Some("Large"), &pairs).expect("fits");
    assert_eq!(slave.parameters.user, [0x00, 0x03, 0, 1, 0, 0, 5, 0xFF, 0x9C, 8]);
}

#[test]
fn what_the_file_does_not_have_is_told_with_what_it_has() {
    let gsd = gsd();
    let error = |module: Option<&str>, pairs: &[(&str, &str)]| {
        gsd.slave(5, Baudrate::B500000, module, &set(pairs)).expect_err("refused").to_string()
    };
    assert!(
        error(None, &[]).contains("2 modules, so one has to be chosen by its name: \"Small\", \"Large\"")
    );
    assert!(error(Some("Huge"), &[]).contains("no module \"Huge\"; there are: \"Small\""));
    assert!(error(Some("Small"), &[("Units", "1")]).contains("\"Direction\", \"Area\", \"Choice\""));
    assert!(error(Some("Large"), &[("Units", "65537")]).contains("cannot be 65537: it takes 1 to 65536"));
    assert!(error(Some("Large"), &[("Units", "many")]).contains("cannot be many"));
    assert!(error(Some("Small"), &[("Choice", "3")]).contains("it takes 1, 2, 4"));
    assert!(
        error(Some("Small"), &[("Direction", "left")])
            .contains("\"Clockwise\" (0), \"Counter-clockwise\" (1)")
    );
    let rate = gsd.slave(5, Baudrate::B12000000, Some("Small"), &[]).expect_err("refused").to_string();
    assert!(rate.contains("does not run at 12 Mbit/s; it does at: 500 kbit/s, 1.5 Mbit/s"), "{rate}");
}

#[test]
fn broken_files_are_sentences_and_no_panics() {
    let error = |text: &str| Gsd::parse("test.gsd", text).expect_err("refused").to_string();
    assert!(error("").contains("no GSD file"));
    assert!(error("hello").contains("no GSD file"));
    assert!(error(&GSD.replace("Ident_Number = 0x4711\n", "")).contains("no Ident_Number"));
    assert!(
        error(&GSD.replace("Ext_User_Prm_Data_Ref(5) = 4", "Ext_User_Prm_Data_Ref(5) = 44"))
            .contains("broken")
    );
    assert!(error(&GSD.replace("Signed16", "Float")).contains("broken"));
    let none = "#Profibus_DP\nIdent_Number = 1\n";
    let none = Gsd::parse("test.gsd", none).expect("can be read");
    assert_eq!(none.module(None).err(), Some(GsdError::NoModules));
}

#[test]
fn what_does_not_fit_is_refused() {
    let refusal = |from: &str, to: &str, module: &str| {
        let gsd = Gsd::parse("test.gsd", &GSD.replace(from, to)).expect("can be read");
        gsd.slave(5, Baudrate::B500000, Some(module), &[]).expect_err("refused").to_string()
    };
    assert!(
        refusal("Unsigned8 1 1,2,4", "Unsigned8 300 1,2,4", "Small").contains("\"Choice\" is 300 by default")
    );
    assert!(refusal("BitArea(4-6) 5", "BitArea(6-9) 5", "Small").contains("\"Area\" is 5 by default"));
    assert!(
        refusal("Ext_User_Prm_Data_Ref(5) = 4", "Ext_User_Prm_Data_Ref(60000) = 4", "Large")
            .contains("237 fit")
    );
    assert!(
        refusal("0xD1\nExt_Module_Prm_Data_Len = 1", "0x40\nExt_Module_Prm_Data_Len = 1", "Small")
            .contains("make no configuration")
    );
}

#[test]
fn the_legacy_keywords_do_too() {
    let text = "#Profibus_DP\nIdent_Number = 0x0815\nUser_Prm_Data_Len = 3\nUser_Prm_Data = 0x01,0x02,0x03\n\
                Module = \"Only\" 0x10\nEndModule\n";
    let slave = Gsd::parse("test.gsd", text).unwrap().slave(9, Baudrate::B9600, None, &[]).expect("fits");
    assert_eq!((&slave.parameters.user[..], slave.inputs, slave.max_tsdr), (&[1, 2, 3][..], 1, 60));
}

// Found by the fuzz target `gsd`.
#[test]
fn nothing_of_a_hostile_file_reaches_a_terminal_as_a_command() {
    let broken = Gsd::parse("a.gsd", "#Profibus_DP\n\u{1b}]0;mine\u{7}\u{96}\n").unwrap_err().to_string();
    let module = format!("{}Module = \"\u{1b}[2J\" 0xD1\nEndModule\n", &GSD[..GSD.find("Modular").unwrap()]);
    let unknown = Gsd::parse("a.gsd", &module).unwrap().module(Some("other")).unwrap_err().to_string();
    for message in [broken, unknown] {
        assert!(message.chars().all(|c| c == '\n' || !c.is_control()), "{message:?}");
    }
}

// Each number of each range is looked for among all modules: 20000 slots of 65536 numbers take hours.
#[test]
fn slots_take_no_time() {
    let slots = "Slot(1) = \"S\" 1 0-65535\n".repeat(20_000);
    let text = format!("{GSD}SlotDefinition\n{slots}EndSlotDefinition\n");
    let started = std::time::Instant::now();
    assert!(Gsd::parse("a.gsd", &text).is_ok());
    assert!(started.elapsed().as_secs() < 30, "{:?}", started.elapsed());
}
