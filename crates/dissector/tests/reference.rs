//! Telegrams of the DP slave reference (sections 1.5, 3.5, 4.6, 6.4) and of the manual in words. What is
//! expected was written by hand from there.

mod common;

use common::{START_SCANCON, field, framed, last, number, summaries, telegrams};
use dissector::{Profile, Service, Value, hex};

const DIAGNOSIS_2: &str = "68 3E 3E 68 82 8B 08 3E 3C 00 0C 00 02 47 11 33 00 0A 02 00 00 20 00 10 00 00 00 03 00 00 \
    00 36 01 01 01 01 00 00 00 3D 00 00 00 00 00 00 00 00 00 00 20 00 02 00 00 00 31 32 33 34 35 36 20 20 20 20 B5 16";

// Section 1.5.
#[test]
fn each_format_is_told() {
    let due = [
        "2 -> 11  FDL_Status request",
        "11 -> 2  FDL_Status: OK",
        "2 -> 11  Slave_Diag request",
        "11 -> 2  Slave_Diag: waits for parameters, no owner, ident 4711h",
        "2 -> 11  Slave_Diag request (retry)",
        "11 -> 2  Slave_Diag: waits for parameters, no owner, ident 4711h",
        "2 -> 11  Data_Exchange: no outputs",
        "11 -> 2  Data_Exchange: RS: no service activated here",
        "2 -> 3  token",
        "2 -> all  Global_Control: Clear for all slaves",
    ];
    let told = summaries(
        "10 0B 02 49 56 16 10 02 0B 00 0D 16
         68 05 05 68 8B 82 6D 3C 3E F4 16 68 0B 0B 68 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16
         68 05 05 68 8B 82 7D 3C 3E 04 16 A2 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16
         10 0B 02 5D 6A 16 10 02 0B 03 10 16
         DC 03 02
         68 07 07 68 FF 82 46 3A 3E 02 00 41 16",
    );
    assert_eq!(told, due);
    assert_eq!(
        last("10 0B 02 49 56 16 10 02 0B 02 0F 16", Profile::Auto).summary,
        "11 -> 2  FDL_Status: RR: no resource for the data"
    );
}

// Section 3.5, one after the other: what stands where.
#[test]
fn each_service_has_its_fields_at_its_octets() {
    let prm = last("68 0E 0E 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 00 E5 16", Profile::Encoder);
    assert_eq!(field(&prm, "Lock_Req").0, [10, 10]);
    assert_eq!((number(&prm, "Lock_Req"), number(&prm, "WD_On"), number(&prm, "Unlock_Req")), (1, 1, 0));
    assert_eq!(
        field(&prm, "WD_Fact_2"),
        ([12, 12], Some([3, 3]), Value::Number(20), "watchdog of 200 ms".to_owned())
    );
    assert_eq!(
        field(&prm, "min_Tsdr"),
        ([13, 13], Some([4, 4]), Value::Number(11), "11 bit times".to_owned())
    );
    assert_eq!(
        field(&prm, "Ident_Number"),
        ([14, 15], Some([5, 6]), Value::Number(0x4711), "4711h".to_owned())
    );
    assert_eq!(field(&prm, "encoder.code_sequence").1, Some([9, 9]));
    let unlock = last("68 0C 0C 68 8B 82 7D 3D 3E 40 00 00 00 47 11 00 9D 16", Profile::Auto);
    assert_eq!(unlock.summary, "2 -> 11  Set_Prm: unlock, ident 4711h, 7 octets");
    let tsdr = last("68 0C 0C 68 8B 82 7D 3D 3E 00 00 00 20 00 00 00 25 16", Profile::Auto);
    assert_eq!(
        (tsdr.summary.as_str(), number(&tsdr, "min_Tsdr")),
        ("2 -> 11  Set_Prm: min T_SDR only, ident 0000h, 7 octets", 32)
    );

    let get = last("68 06 06 68 82 8B 08 3E 3B F1 7F 16", Profile::Auto);
    assert_eq!((get.service, get.summary.as_str()), (Some(Service::GetCfg), "11 -> 2  Get_Cfg: 4 in, 4 out"));
    let words = "2 words in and out, consistent over the whole".to_owned();
    assert_eq!(field(&get, "Identifier"), ([10, 10], Some([1, 1]), Value::Octets("F1".to_owned()), words));

    let address = last("68 09 09 68 FE 82 6D 37 3E 0B 47 11 00 C5 16", Profile::Auto);
    assert_eq!(address.summary, "2 -> 126  Set_Slave_Add: new address 11, for ident 4711h");
    assert_eq!((field(&address, "New_Slave_Add").0, number(&address, "No_Add_Chg")), ([10, 10], 0));

    let sync = last("68 07 07 68 FF 82 46 3A 3E 20 01 60 16", Profile::Auto);
    assert_eq!(sync.summary, "2 -> all  Global_Control: Sync, Operate for group 1");
    assert_eq!((number(&sync, "Sync"), number(&sync, "Clear_Data")), (1, 0));
    let operate = last("68 07 07 68 FF 82 46 3A 3E 00 00 3F 16", Profile::Auto);
    assert_eq!(operate.summary, "2 -> all  Global_Control: Operate for all slaves");

    let inputs = last("68 09 09 68 82 8B 08 3E 38 00 12 34 56 27 16", Profile::Encoder);
    assert_eq!((inputs.service, number(&inputs, "encoder.position")), (Some(Service::RdInp), 0x0012_3456));
    let outputs = last("68 09 09 68 82 8B 08 3E 39 00 00 00 00 8C 16", Profile::Encoder);
    assert_eq!((outputs.service, number(&outputs, "encoder.preset")), (Some(Service::RdOutp), 0));
}

// Section 3.5: both diagnoses of the device; the manual's octets 7 to 57 (4.2).
#[test]
fn the_encoders_diagnosis_is_told_with_alarms_and_warnings_first() {
    let long = last(DIAGNOSIS_2, Profile::Auto);
    let summary =
        "11 -> 2  Slave_Diag: no alarm; no warning; in data exchange, watchdog on, owner 2, ident 4711h";
    assert_eq!(long.summary, summary);
    let first: Vec<_> =
        long.fields.iter().map(|field| field.name).filter(|name| name.starts_with("encoder.")).collect();
    assert_eq!(first[..2], ["encoder.alarms", "encoder.warnings"]);
    for (name, octets, value) in [
        ("encoder.header", [7, 7], 51),
        ("encoder.alarms", [8, 8], 0),
        ("encoder.scaling", [9, 9], 1),
        ("encoder.class_2", [9, 9], 1),
        ("encoder.code_sequence", [9, 9], 0),
        ("encoder.type", [10, 10], 2),
        ("encoder.singleturn_resolution", [11, 14], 8_192),
        ("encoder.revolutions", [15, 16], 4_096),
        ("encoder.additional_alarms", [17, 17], 0),
        ("encoder.supported_alarms", [18, 19], 3),
        ("encoder.warnings", [20, 21], 0),
        ("encoder.supported_warnings", [22, 23], 0x36),
        ("encoder.profile_version", [24, 25], 0x0101),
        ("encoder.software_version", [26, 27], 0x0101),
        ("encoder.operating_time", [28, 31], 61),
        ("encoder.offset", [32, 35], 0),
        ("encoder.manufacturer_offset", [36, 39], 0),
        ("encoder.measuring_units_per_revolution", [40, 43], 8_192),
        ("encoder.total_measuring_range", [44, 47], 33_554_432),
    ] {
        assert_eq!((field(&long, name).1, number(&long, name)), (Some(octets), value), "{name}");
        assert_eq!(field(&long, name).0, octets.map(|octet| octet + 9), "{name}");
    }
    assert_eq!(field(&long, "encoder.operating_time").3, "6.1 h");
    assert_eq!(field(&long, "encoder.profile_version").3, "1.1");
    assert_eq!(field(&long, "encoder.serial_number").2, Value::Text("123456".to_owned()));

    let short = "68 15 15 68 82 8B 08 3E 3C 00 0C 00 02 47 11 0A 00 00 02 00 00 20 00 10 00 31 16";
    let summary = "11 -> 2  Slave_Diag: no alarm; in data exchange, watchdog on, owner 2, ident 4711h";
    assert_eq!(last(short, Profile::Auto).summary, summary);
    let plain = last(short, Profile::Dp);
    assert_eq!(field(&plain, "Device_Block").1, Some([7, 16]));
    assert!(!plain.fields.iter().any(|field| field.name.starts_with("encoder.")));
}

/// The long diagnosis with alarm octet 8 and warning octet 21 changed, and the sum with them.
fn diagnosis_with(alarms: u8, warnings: u8) -> String {
    let mut octets = hex::octets(DIAGNOSIS_2).expect("hex");
    (octets[16], octets[29]) = (alarms, warnings);
    let sum = octets.len() - 2;
    octets[sum] = octets[sum].wrapping_add(alarms).wrapping_add(warnings);
    hex::text(&octets)
}

// Manual 4.2.2 and 4.2.9.
#[test]
fn each_alarm_and_warning_has_its_words() {
    for (alarms, warnings, words) in [
        (1, 0, "alarm: position error; no warning;"),
        (2, 0, "alarm: supply voltage; no warning;"),
        (3, 0, "alarms: position error, supply voltage; no warning;"),
        (0, 0x02, "no alarm; warning: temperature exceeded;"),
        (0, 0x04, "no alarm; warning: light control reserve used up;"),
        (0, 0x10, "no alarm; warning: operating time limit exceeded;"),
        (0, 0x20, "no alarm; warning: battery low;"),
        (0x10, 0x22, "alarm: memory error; warnings: temperature exceeded, battery low;"),
        (0x80, 0x80, "alarm: others; warning: others;"),
    ] {
        let summary = last(&diagnosis_with(alarms, warnings), Profile::Auto).summary;
        assert!(summary.contains(&format!("Slave_Diag: {words}")), "{summary}");
    }
}

// Section 3.5: Scancon 2.0, position, velocity, acceleration; negative numbers; the time base of Set_Prm.
#[test]
fn velocity_and_acceleration_have_the_unit_that_was_parameterized() {
    let exchange = "68 07 07 68 0B 02 5D 00 00 00 00 6A 16 68 0F 0F 68 02 0B 08 00 12 34 56 00 00 00 64 FF FF FF F6 08 16";
    let told = last(&format!("{START_SCANCON}{exchange}"), Profile::Auto);
    let words = "11 -> 2  Data_Exchange: position 1193046, velocity 100 steps per 100 ms, acceleration -10";
    assert_eq!(told.summary, words);
    assert_eq!(
        (field(&told, "encoder.velocity").0, field(&told, "encoder.velocity").1),
        ([12, 15], Some([5, 8]))
    );
    assert_eq!(number(&told, "encoder.acceleration"), -10);
    let alone = last(exchange, Profile::Encoder);
    assert_eq!(alone.summary, "11 -> 2  Data_Exchange: position 1193046, velocity 100, acceleration -10");
}

#[test]
fn a_preset_and_a_waiting_diagnosis_are_told() {
    let told = telegrams(&format!("{START_SCANCON} 68 07 07 68 0B 02 5D 80 00 10 00 FA 16"), Profile::Auto);
    let preset = told.last().expect("a telegram");
    assert_eq!(preset.summary, "2 -> 11  Data_Exchange: preset to 4096");
    assert_eq!((number(preset, "encoder.preset"), number(preset, "encoder.preset_value")), (1, 4_096));
    let waits = last(
        "68 07 07 68 0B 02 5D 00 00 00 00 6A 16 68 07 07 68 02 0B 0A 00 12 34 56 B3 16",
        Profile::Encoder,
    );
    assert_eq!(waits.summary, "11 -> 2  Data_Exchange: position 1193046 (a diagnosis waits)");
}

// Nothing is assumed: other slaves' telegrams, from real traffic (section 1.5).
#[test]
fn other_slaves_are_told_by_the_standard_only() {
    let told = summaries(
        "68 05 05 68 88 81 6D 3C 3E F0 16 68 0B 0B 68 81 88 08 3E 3C 02 05 00 FF 80 E0 F1 16
         68 08 08 68 81 88 08 3E 3B 00 10 10 AA 16
         68 08 08 68 88 81 5D 3E 3E 00 10 10 02 16 E5
         68 0F 0F 68 82 E3 5D 3D 3E B8 05 01 00 0C DA 01 40 00 00 22 16",
    );
    assert_eq!(told[1], "8 -> 1  Slave_Diag: waits for parameters, no owner, ident 80E0h");
    assert_eq!(told[2], "8 -> 1  Get_Cfg: 2 in, 0 out");
    assert_eq!(told[3], "1 -> 8  Chk_Cfg: 2 in, 0 out");
    assert_eq!(told[4], "8 -> 1  Chk_Cfg: received; whether it is good, the diagnosis tells");
    assert_eq!(told[5], "99 -> 2  Set_Prm: lock, watchdog 50 ms, ident 0CDAh, 10 octets");
    let four = last("10 08 01 5D 66 16 68 07 07 68 01 08 08 00 12 34 56 AD 16", Profile::Auto);
    assert_eq!(four.summary, "8 -> 1  Data_Exchange: 4 octets of inputs");
    assert_eq!(field(&four, "Inputs").2, Value::Octets("00 12 34 56".to_owned()));
}

// Section 4.6, the example of the standard: a device block, an identifier block, two channels.
#[test]
fn blocks_of_other_diagnoses_are_told() {
    let body = "82 8B 08 3E 3C 00 0C 00 02 47 11 04 01 02 03 45 01 10 04 00 80 02 24 8C 06 A7";
    let told = last(&framed(body), Profile::Auto);
    assert_eq!(field(&told, "Device_Block").3, "device related, 4 octets");
    assert_eq!(field(&told, "Identifier_Block").3, "diagnosis of module 0, 12, 18");
    let channels: Vec<_> = told.fields.iter().filter(|field| field.name == "Channel_Block").collect();
    assert_eq!(channels[0].words, "module 0, channel 2 (1 bit): overload (4)");
    assert_eq!(channels[1].words, "module 12, channel 6 (word): upper limit exceeded (7)");
    assert_eq!(channels[1].data_octets, Some([19, 21]));
    let cut = last(&framed("82 8B 08 3E 3C 00 0C 00 02 47 11 33 01"), Profile::Auto);
    let found = cut.remarks.iter().find(|remark| remark.octet == Some(16)).expect("a remark");
    assert_eq!(found.words, "the block says 51 octets, but 2 are left");
}

// Section 6.4.
#[test]
fn special_identifiers_are_told() {
    let told = last(&framed("8B 82 7D 3E 3E C3 CF C7 01 02 03 00 20"), Profile::Auto);
    assert_eq!(told.summary, "2 -> 11  Chk_Cfg: 16 in, 33 out");
    let words: Vec<_> = told
        .fields
        .iter()
        .filter(|field| field.name == "Identifier")
        .map(|field| field.words.to_string())
        .collect();
    assert_eq!(
        words,
        [
            "16 words out, consistent over the whole; 8 words in, consistent over the whole; 3 octets of the maker",
            "free place",
            "1 octet out, consistent over each octet",
        ]
    );
    let cut = last(&framed("8B 82 7D 3E 3E C3 CF"), Profile::Auto);
    assert!(cut.remarks[0].words.contains("malformed"), "{cut:#?}");
}

// Sections 1.2 to 3.3: what is wrong in a telegram whose format is right.
#[test]
fn what_is_wrong_is_told_with_its_octet() {
    let refused = "68 1E 1E 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 0A 00 01 11 70 80 00 00 00 00 00 00 00 00 00 00 00 00 F1 16";
    for (text, octet, words) in [
        // 70000 units a turn.
        (framed(&refused[12..refused.len() - 6]), 19, "at most 65536 are possible"),
        (framed("8B 82 7D 3D 3E 88 00 14 0B 47 11 00 00 00"), 11, "a factor is 0"),
        (framed("8B 82 7D 3D 3E 81 01 14 0B 47 11 00 00 00"), 10, "reserved"),
        (framed("8B 82 7D 3D 3E 88 01"), 11, "at least 7"),
        (framed("FF 82 46 3A 3E 41 00"), 10, "reserved"),
        (framed("FF 82 46 3A 3E 02"), 10, "has 2"),
        (framed("FE 82 6D 37 3E 7F 47 11 00"), 10, "0 to 125"),
        (framed("FE 82 6D 37 3E 0B 47 11"), 12, "at least 4"),
        (framed("8B 82 6D 3C 3E 01"), 10, "no data"),
        (framed("FF 82 6D 3C 3E"), 5, "may go to all stations"),
        ("10 7F 02 49 CA 16".to_owned(), 2, "may go to all stations"),
        ("10 0B 7F 49 D3 16".to_owned(), 3, "127 is no source"),
        ("10 0B 02 48 55 16".to_owned(), 4, "reserved"),
        ("DC 7F 02".to_owned(), 2, "127"),
        (framed("82 8B 08 3E 3C 02 01 00 FF 47 11"), 11, "bit 2 is 0"),
        (framed("82 8B 08 3E 3C 02 05"), 11, "at least 6"),
        (framed("8B 82 6D 7C 3E"), 8, "segment"),
    ] {
        let told = last(&text, Profile::Encoder);
        let found =
            told.remarks.iter().any(|remark| remark.octet == Some(octet) && remark.words.contains(words));
        assert!(found, "{text}: {:#?}", told.remarks);
    }
}

// Section 4.4: without Lock_Req, and with Unlock_Req, a slave looks at neither reserved bits nor factors.
#[test]
fn a_set_prm_that_does_not_lock_is_not_blamed_for_what_only_a_lock_has() {
    for body in ["8B 82 7D 3D 3E 09 00 00 20 00 00 00", "8B 82 7D 3D 3E 4A 00 00 00 47 11 00"] {
        let told = last(&framed(body), Profile::Dp);
        assert!(told.remarks.is_empty(), "{body}: {:#?}", told.remarks);
    }
}
