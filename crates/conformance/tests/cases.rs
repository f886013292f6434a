//! The cases as data: all can be read, none is there twice, each says what rule it is.

use std::collections::BTreeSet;

use conformance::{Profile, cases, parse};

#[test]
fn every_case_has_a_number_of_its_own_an_area_a_rule_and_a_tag() {
    let mut numbers = BTreeSet::new();
    let mut titles = BTreeSet::new();
    for case in cases() {
        assert!(numbers.insert(&case.id), "case {} is there twice", case.id);
        assert!(titles.insert(&case.title), "the title of case {} is there twice", case.id);
        assert!(!case.area.is_empty() && !case.rule.is_empty(), "case {}: area and rule", case.id);
        assert!(!case.tags.is_empty(), "case {}: a tag", case.id);
        assert!(!case.steps.is_empty(), "case {}: steps", case.id);
        assert!(!case.title.ends_with('.'), "case {}: the title is a rule, not a text", case.id);
    }
}

#[test]
fn a_case_is_disputed_where_one_of_its_alternatives_is() {
    let text = "case 1 x\nrule 1\n> STAT\n< OK or RS (8.4)\nrepeat 2:\n> STAT\n< OK or silence (8.7)\nend";
    assert_eq!(parse("some.txt", text).expect("readable")[0].disputed, ["8.4", "8.7"]);
}

#[test]
fn what_cannot_be_read_is_told_with_its_line() {
    let fault = |text: &str| parse("some.txt", text).expect_err("a fault").to_string();
    for (text, told) in [
        ("> STAT", "some.txt:1: a case begins with `case NUMBER TITLE`"),
        ("case 1", "some.txt:1: a case has a number and a title"),
        ("case 1 x\n> STAT", "some.txt:2: what is due? `< ...`"),
        ("case 1 x\n> STUT\n< OK", "some.txt:2: `STUT` is no telegram"),
        ("case 1 x\n> STAT\n< KO", "some.txt:3: `KO` is nothing that can be due"),
        ("case 1 x\n> STAT bad luck\n< OK", "some.txt:2: `bad luck` means nothing"),
        ("case 1 x\n> raw 1\n< OK", "some.txt:2: `1` stands for no octets"),
        ("case 1 x\nneeds luck", "some.txt:2: `luck` is nothing that a case can need"),
        ("case 1 x\nbefore dawn", "some.txt:2: `dawn` is no state: power-on, at-126, wprm, wcfg or dx"),
        ("case 1 x\nrepeat 2:\n> STAT\n< OK", "some.txt:2: `end` is missing"),
        (
            "case 1 x\nwait 1 h 2",
            "some.txt:2: `1 h 2` is no time: a whole number and bits, us, ms, s, min or h",
        ),
        ("case 1 x\n> PRM(P[0=00])\n< E5", "some.txt:2: `[0=00]`: octets count from 1"),
    ] {
        assert_eq!(fault(text), told);
    }
}

#[test]
fn there_are_cases_for_every_slave() {
    assert!(cases().iter().filter(|case| case.profile == Profile::DpV0).count() >= 200);
}
