//! What a telegram means by those before it (reference sections 2.2, 3.6, 7.3), and documents.

mod common;

use common::{START_SCANCON, entries, framed, last, telegrams};
use dissector::{Entry, Item, Profile, Service, hex};

// Section 3.6: a whole start-up, with the retry.
#[test]
fn a_start_up_is_told_request_by_request() {
    let told = telegrams(
        "10 0B 02 49 56 16 10 02 0B 00 0D 16
         68 05 05 68 8B 82 6D 3C 3E F4 16 68 0B 0B 68 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16
         68 1E 1E 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 0A 00 00 20 00 02 00 00 00 00 00 00 00 00 00 00 00 11 16 E5
         68 06 06 68 8B 82 7D 3E 3E F1 F7 16 E5
         68 05 05 68 8B 82 5D 3C 3E E4 16 68 0B 0B 68 82 8B 08 3E 3C 00 0C 00 02 47 11 F5 16
         68 07 07 68 0B 02 7D 00 00 00 00 8A 16 68 07 07 68 02 0B 08 00 00 10 00 25 16
         68 07 07 68 0B 02 7D 00 00 00 00 8A 16 68 07 07 68 02 0B 08 00 00 10 00 25 16
         68 07 07 68 0B 02 5D 00 00 00 00 6A 16 68 07 07 68 02 0B 08 00 00 10 01 26 16",
        Profile::Auto,
    );
    let summaries: Vec<_> = told.iter().map(|telegram| telegram.summary.as_str()).collect();
    assert_eq!(
        summaries[4..],
        [
            "2 -> 11  Set_Prm: lock, watchdog 200 ms, ident 4711h, 25 octets; clockwise, 8192 units a turn, 33554432 in all",
            "11 -> 2  Set_Prm: received; whether it is good, the diagnosis tells",
            "2 -> 11  Chk_Cfg: 4 in, 4 out, class 2",
            "11 -> 2  Chk_Cfg: received; whether it is good, the diagnosis tells",
            "2 -> 11  Slave_Diag request",
            "11 -> 2  Slave_Diag: in data exchange, watchdog on, owner 2, ident 4711h",
            "2 -> 11  Data_Exchange: no preset",
            "11 -> 2  Data_Exchange: position 4096",
            "2 -> 11  Data_Exchange: no preset (retry)",
            "11 -> 2  Data_Exchange: position 4096",
            "2 -> 11  Data_Exchange: no preset",
            "11 -> 2  Data_Exchange: position 4097",
        ]
    );
    let retries: Vec<_> = told.iter().map(|telegram| telegram.retry).collect();
    assert_eq!(retries.iter().filter(|retry| **retry).count(), 1);
    let answers: Vec<_> = told.iter().filter_map(|telegram| telegram.answers).collect();
    assert_eq!(answers, [1, 3, 5, 7, 9, 11, 13, 15]);
    assert!(told.iter().all(|telegram| telegram.remarks.is_empty()), "{told:#?}");
}

#[test]
fn lengths_are_compared_with_the_last_configuration() {
    let short =
        format!("{START_SCANCON} 68 05 05 68 0B 02 5D 00 00 6A 16 68 07 07 68 02 0B 08 00 12 34 56 B1 16");
    let told = telegrams(&short, Profile::Auto);
    for telegram in &told[4..] {
        assert!(telegram.remarks[0].words.contains("the last Chk_Cfg has 12 in, 4 out"), "{telegram:#?}");
    }
    assert_eq!(told[5].summary, "11 -> 2  Data_Exchange: 4 octets of inputs");
    // Section 3.5: empty outputs of a master in Clear are nothing to wonder at.
    let clear = last(&format!("{START_SCANCON} 10 0B 02 5D 6A 16"), Profile::Auto);
    assert!(clear.remarks.is_empty() && clear.summary.ends_with("no outputs"), "{clear:#?}");
}

#[test]
fn what_was_agreed_is_forgotten_when_the_slave_leaves() {
    let answer = "10 0B 02 5D 6A 16 68 07 07 68 02 0B 08 00 12 34 56 B1 16";
    for leaves in [
        "68 0C 0C 68 8B 82 7D 3D 3E 40 00 00 00 47 11 00 9D 16",
        "68 0B 0B 68 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16",
    ] {
        let told = last(&format!("{START_SCANCON} {leaves} {answer}"), Profile::Auto);
        assert!(!told.remarks.iter().any(|remark| remark.words.contains("Chk_Cfg")), "{told:#?}");
    }
}

// Section 7.3, cases 78 and 80: what another master asks for and does not get changes nothing.
#[test]
fn what_was_refused_leaves_what_was_agreed() {
    let refused = "10 03 0B 03 11 16";
    let answer = "68 07 07 68 0B 02 5D 00 00 00 00 6A 16 68 0F 0F 68 02 0B 08 00 12 34 56 00 00 00 64 FF FF FF F6 08 16";
    for request in
        ["8B 83 6D 3E 3E 10", "8B 83 6D 3D 3E 40 00 00 00 47 11 00", "8B 83 6D 3D 3E 80 01 01 0B 00 01 00"]
    {
        let told = last(&format!("{START_SCANCON} {} {refused} {answer}", framed(request)), Profile::Auto);
        assert!(
            told.remarks.is_empty() && told.summary.contains("velocity 100 steps per 100 ms"),
            "{told:#?}"
        );
    }
}

#[test]
fn an_answer_without_its_request_says_so() {
    for text in [
        "E5",
        "10 02 0B 03 10 16",
        "68 07 07 68 02 0B 08 00 12 34 56 B1 16",
        "10 0B 02 49 56 16 DC 03 02 10 02 0B 00 0D 16",
    ] {
        let told = last(text, Profile::Auto);
        assert!(told.remarks.iter().any(|remark| remark.words.contains("is not here")), "{text}: {told:#?}");
        assert_eq!(told.answers, None);
    }
    // Of another station, and with SAPs that are not the request's.
    let other = last("10 0C 02 49 57 16 10 02 0B 00 0D 16", Profile::Auto);
    assert_eq!((other.answers, other.service), (None, None));
    let saps = last(
        "68 05 05 68 8B 82 5D 3B 3E E3 16 68 0B 0B 68 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16",
        Profile::Auto,
    );
    assert!(saps.remarks[0].words.contains("the other way round"), "{saps:#?}");
    assert_eq!(saps.service, Some(Service::SlaveDiag), "the SAPs of the answer tell");
}

// Section 2.2, rows 1 to 6.
#[test]
fn retries_are_told_by_the_frame_count_bit() {
    let retry = |text: &str| last(text, Profile::Auto).retry;
    let (first, one, nought) = (
        "68 05 05 68 8B 82 6D 3C 3E F4 16",
        "68 05 05 68 8B 82 7D 3C 3E 04 16",
        "68 05 05 68 8B 82 5D 3C 3E E4 16",
    );
    assert!(!retry(one));
    assert!(!retry(&format!("{first} {first}")), "FCV = 0 is always new");
    assert!(retry(&format!("{first} {one}")));
    assert!(!retry(&format!("{first} {nought}")));
    assert!(
        retry(&format!("{nought} 10 0B 02 49 56 16 DC 03 02 {nought}")),
        "FDL status and tokens change nothing"
    );
    assert!(
        !retry(&format!("{nought} 68 05 05 68 8B 83 5D 3C 3E E5 16 {nought}")),
        "another master was there"
    );
    assert!(
        !retry(&format!("{nought} 68 05 05 68 8B 82 5D 3B 3E E3 16")),
        "another service, profirust's habit"
    );
}

#[test]
fn json_has_stable_names() {
    let entries = entries("10 0B 02 49 56 16 55 10 0B 02 49 57 16", Profile::Auto);
    let json: Vec<serde_json::Value> =
        entries.iter().map(|entry| serde_json::to_value(entry).expect("JSON")).collect();
    assert_eq!(json[0]["kind"], "telegram");
    assert_eq!(json[0]["format"], "SD1");
    assert_eq!(json[0]["direction"], "request");
    assert_eq!((&json[0]["source"], &json[0]["destination"]), (&2.into(), &11.into()));
    assert_eq!((&json[0]["service"], &json[0]["retry"]), (&"FDL_Status".into(), &false.into()));
    let function = serde_json::json!({"octets": [4, 4], "bits": [3, 0], "name": "Function", "value": 9, "words": "request FDL status"});
    assert!(json[0]["fields"].as_array().expect("fields").contains(&function), "{}", json[0]);
    assert_eq!(
        (&json[1]["kind"], &json[1]["count"], &json[1]["first_octet"]),
        (&"garbage".into(), &7.into(), &7.into())
    );
    let bad = serde_json::to_value(&entries_of_bad()[0]).expect("JSON");
    assert_eq!((&bad["kind"], &bad["wrong_octet"], &bad["number"]), (&"bad".into(), &5.into(), &1.into()));
}

fn entries_of_bad() -> Vec<Entry> {
    entries("10 0B 02 49 57 16", Profile::Auto)
}

proptest::proptest! {
    // Whatever the data are: no panic, and every field within the telegram.
    #[test]
    fn any_data_of_any_service_are_told(
        dsap in 46_u8..=64,
        response: bool,
        code in proptest::prelude::any::<u8>(),
        data in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..244),
    ) {
        let saps = if response { [62, dsap] } else { [dsap, 62] };
        let fc = if response { code & 0xBF } else { code | 0x40 };
        let body = hex::text(&[&[0x8B, 0x82, fc, saps[0], saps[1]][..], &data].concat());
        for profile in [Profile::Auto, Profile::Encoder, Profile::Dp] {
            for entry in entries(&framed(&body), profile) {
                let Item::Telegram(telegram) = entry.item else { continue };
                let length = telegram.octets.split(' ').count();
                for field in &telegram.fields {
                    let [first, last] = field.octets;
                    proptest::prop_assert!(1 <= first && first <= last && last <= length, "{:?}", field);
                }
            }
        }
    }
}
