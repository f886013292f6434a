use super::*;
use crate::specification::Variant;
use proptest::prelude::*;

const FULL: &Variant = &Variant::FULL;

// The manual's octets, beginning with the DP standard part: class 2, counter-clockwise,
// scaling on, 1000 steps per revolution, 32000 in all.
const CLASS_2: [u8; 25] = [
    0x88, 0x0A, 0x02, 0x0B, 0x10, 0x8B, 0x00, 0x00, 0x0B, 0x00, 0x00, 0x03, 0xE8, 0x00, 0x00, 0x7D, 0x00, 0,
    0, 0, 0, 0, 0, 0, 0,
];

fn scancon() -> [u8; 26] {
    let mut octets = [0; 26];
    octets[..25].copy_from_slice(&CLASS_2);
    octets[25] = 3;
    octets
}

#[test]
fn the_manuals_octets_both_ways() {
    let parameters = Parameters {
        length: ParameterLength::TwentyFive,
        code_sequence: CodeSequence::CounterClockwise,
        scaling: true,
        measuring_units_per_revolution: 1000,
        total_measuring_range: 32_000,
        time_base: TimeBase::Per100Ms,
    };
    assert_eq!(Parameters::parse(&CLASS_2, FULL), Ok(parameters));
    let mut octets = [0; 26];
    octets[..8].copy_from_slice(&CLASS_2[..8]);
    let length = parameters.emit(&mut octets);
    assert_eq!(octets[..length], CLASS_2);

    let full = Parameters { length: ParameterLength::TwentySix, time_base: TimeBase::Rpm, ..parameters };
    assert_eq!(Parameters::parse(&scancon(), FULL), Ok(full));
    assert_eq!(full.emit(&mut octets), 26);
    assert_eq!(octets, scancon());
}

#[test]
fn nine_octets_have_the_code_sequence_only() {
    let mut octets = [0x88, 0x0A, 0x02, 0x0B, 0x10, 0x8B, 0x00, 0x00, 0x01];
    let parameters = Parameters {
        length: ParameterLength::Nine,
        code_sequence: CodeSequence::CounterClockwise,
        ..Parameters::default_for(Variant::FULL)
    };
    assert_eq!(Parameters::parse(&octets, FULL), Ok(parameters));
    // Bits 1 and 3 are ignored.
    octets[8] = 0x0B;
    assert_eq!(Parameters::parse(&octets, FULL), Ok(parameters));
    let mut emitted = [0xAA; 26];
    assert_eq!(parameters.emit(&mut emitted), 9);
    assert_eq!((emitted[8], emitted[7], emitted[9]), (1, 0xAA, 0xAA));
}

#[test]
fn other_lengths_are_refused() {
    for length in (0..=300).filter(|length| ![9, 25, 26].contains(length)) {
        let octets = std::vec![0; length];
        let refusal = PrmRefusal::Length { octets: length.min(255).try_into().unwrap() };
        assert_eq!(Parameters::parse(&octets, FULL), Err(refusal));
    }
}

#[test]
fn octet_9_is_checked_bit_by_bit() {
    for value in 0..=u8::MAX {
        let mut short = [0; 9];
        short[8] = value;
        let good = value & 0xF4 == 0;
        assert_eq!(Parameters::parse(&short, FULL).is_ok(), good, "9 octets, {value:02X}");
        let mut long = scancon();
        long[8] = value;
        let good = value & 0xF6 == 0x02;
        assert_eq!(Parameters::parse(&long, FULL).is_ok(), good, "26 octets, {value:02X}");
        assert_eq!(Parameters::parse(&long[..25], FULL).is_ok(), good, "25 octets, {value:02X}");
    }
}

#[test]
fn every_reserved_octet_must_be_0() {
    for number in 18..=25_u8 {
        for length in [25, 26] {
            let mut octets = scancon();
            octets[usize::from(number) - 1] = 0x80;
            let refusal = PrmRefusal::Reserved { octet: number, value: 0x80 };
            assert_eq!(Parameters::parse(&octets[..length], FULL), Err(refusal));
        }
    }
}

#[test]
fn scaling_values_are_checked_while_scaling_is_on() {
    let variant = Variant::new(13, 12).unwrap();
    let with = |scaling, units: u32, range: u32| {
        let mut octets = CLASS_2;
        octets[8] = if scaling { 0x0A } else { 0x02 };
        octets[9..13].copy_from_slice(&units.to_be_bytes());
        octets[13..17].copy_from_slice(&range.to_be_bytes());
        Parameters::parse(&octets, &variant).map(|_| ())
    };
    assert_eq!(with(true, 8192, 1 << 25), Ok(()));
    assert_eq!(with(true, 1, 1), Ok(()));
    for value in [0, 8193, u32::MAX] {
        assert_eq!(with(true, value, 1), Err(PrmRefusal::MeasuringUnits { value, variant }));
        assert_eq!(with(false, value, 1), Ok(()));
    }
    for value in [0, (1 << 25) + 1, u32::MAX] {
        assert_eq!(with(true, 1, value), Err(PrmRefusal::MeasuringRange { value, variant }));
        assert_eq!(with(false, 1, value), Ok(()));
    }
}

#[test]
fn time_bases_are_0_to_3_in_the_manuals_order() {
    use TimeBase::{Per10Ms, Per100Ms, Per1000Ms, Rpm};
    for (value, time_base) in (0..).zip([Per10Ms, Per100Ms, Per1000Ms, Rpm]) {
        let mut octets = scancon();
        octets[25] = value;
        assert_eq!(Parameters::parse(&octets, FULL).unwrap().time_base, time_base);
        assert_eq!(time_base.octet(), value);
    }
    for value in 4..=u8::MAX {
        let mut octets = scancon();
        octets[25] = value;
        assert_eq!(Parameters::parse(&octets, FULL), Err(PrmRefusal::TimeBase { value }));
    }
}

#[test]
fn the_first_fault_in_the_order_of_the_octets_counts() {
    let mut octets = scancon();
    let mut last = None;
    // Faults from the last octet to the first: each new one hides those after it.
    for (index, value) in [(25, 9), (24, 1), (17, 1), (13, 0xFF), (9, 0xFF), (8, 0x1A), (8, 0x1E), (8, 0x1C)]
    {
        octets[index] = value;
        let refusal = Parameters::parse(&octets, FULL).unwrap_err();
        assert_ne!(Some(refusal), last);
        assert_eq!(refusal.octet(), Some(u8::try_from(index).unwrap() + 1));
        last = Some(refusal);
    }
    assert_eq!(last, Some(PrmRefusal::Class2Missing { value: 0x1C }));
}

proptest! {
    #[test]
    fn what_is_accepted_is_emitted_again(
        operating: u8, values: [u8; 8], reserved in prop::option::weighted(0.1, 17_usize..25),
        base in 0_u8..6, long: bool,
    ) {
        let mut octets = [0; 26];
        octets[8] = operating & 0x0F;
        octets[9..17].copy_from_slice(&values);
        octets[9] = 0;
        octets[13] &= 0x7F;
        if let Some(index) = reserved {
            octets[index] = 1;
        }
        octets[25] = base;
        let sent = if long { &octets[..] } else { &octets[..25] };
        if let Ok(parameters) = Parameters::parse(sent, FULL) {
            let mut emitted = [0; 26];
            let length = parameters.emit(&mut emitted);
            prop_assert_eq!(&emitted[..length], sent);
        }
    }

    #[test]
    fn any_octets_are_taken_or_refused(octets in prop::collection::vec(any::<u8>(), 0..40)) {
        let taken = Parameters::parse(&octets, FULL);
        prop_assert!(taken.is_err() || [9, 25, 26].contains(&octets.len()));
    }

    #[test]
    fn parse_undoes_emit(
        length in prop::sample::select(std::vec![ParameterLength::Nine, ParameterLength::TwentyFive, ParameterLength::TwentySix]),
        turned: bool, scaling: bool, units in 1_u32..=65_536, range in 1_u32..=1 << 31, base in 0_u8..4,
    ) {
        let mut sent = Parameters {
            length,
            code_sequence: CodeSequence::from_bit(turned.into()),
            ..Parameters::default_for(Variant::FULL)
        };
        if length > ParameterLength::Nine {
            sent.scaling = scaling;
            sent.measuring_units_per_revolution = units;
            sent.total_measuring_range = range;
        }
        if length == ParameterLength::TwentySix {
            sent.time_base = TimeBase::from_octet(base).unwrap();
        }
        let mut octets = [0xFF; 26];
        let length = sent.emit(&mut octets);
        prop_assert_eq!(Parameters::parse(&octets[..length], FULL), Ok(sent));
    }
}
