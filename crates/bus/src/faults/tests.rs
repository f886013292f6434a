use super::*;

fn noise(change: impl FnOnce(&mut Noise)) -> Faults {
    let mut noise = Noise { seed: 7, ..Noise::default() };
    change(&mut noise);
    let mut faults = Faults::default();
    faults.set_noise(noise).expect("shares");
    faults
}

#[test]
fn a_quiet_line_has_no_layer() {
    let mut faults = Faults::default();
    assert!(!faults.is_active());
    faults.set_noise(Noise { seed: 9, ..Noise::default() }).expect("shares");
    assert!(!faults.is_active());
    assert!(faults.fail_next_reply(ReplyFault::Lose));
    assert!(faults.is_active());
    assert!(faults.reply(&[1, 2]).characters.is_empty());
    assert!(!faults.is_active(), "nothing is left that can go wrong");
    assert_eq!(faults.counters().lost_replies, 1);
}

#[test]
fn how_octets_are_cut_makes_no_difference() {
    let octets: Vec<u8> = (0..=255).cycle().take(4_000).collect();
    let run = |piece: usize| {
        let mut faults = noise(|noise| noise.bit_errors = 0.01);
        let arrived: Vec<_> = octets.chunks(piece).flat_map(|octets| faults.request(octets, false)).collect();
        (arrived, faults.counters())
    };
    let whole = run(4_000);
    assert!(whole.1.damaged_request_characters > 300, "{:?}", whole.1);
    assert_eq!(run(1), whole);
    assert_eq!(run(17), whole);
}

/// What the short way lets pass is what the long way leaves as it is, number for number.
#[test]
fn the_short_way_draws_the_same_chance() {
    let shares = |noise: &mut Noise| {
        (noise.bit_errors, noise.character_errors) = (0.002, 0.003);
        (noise.lost_replies, noise.doubled_replies, noise.late_replies) = (0.05, 0.05, 0.05);
        noise.late_by = Duration::from_micros(5);
    };
    let (mut short, mut long) = (noise(shares), noise(shares));
    let (mut let_pass, octets) = (0, [0x68, 5, 5, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16]);
    for round in 0..2_000 {
        let long_way = (long.request(&octets, false), long.reply(&octets));
        let request =
            if short.leaves_request(&octets) { intact(&octets) } else { short.request(&octets, false) };
        let passed = short.leaves_reply(&octets);
        let reply = if passed {
            Arrival { characters: intact(&octets), late_by: Duration::ZERO }
        } else {
            short.reply(&octets)
        };
        assert_eq!((request, reply), long_way, "round {round}");
        let_pass += usize::from(passed);
    }
    assert_eq!(short.counters(), long.counters());
    assert!((1_000..1_900).contains(&let_pass), "{let_pass}");
}

/// In a burst the long way has to be gone, though outside it no character suffers.
#[test]
fn the_short_way_leaves_out_no_burst() {
    let bursts = |noise: &mut Noise| {
        (noise.seed, noise.bursts, noise.burst_length, noise.burst_bit_errors) = (5, 0.01, 10.0, 0.5);
    };
    let (mut short, mut long) = (noise(bursts), noise(bursts));
    let octets = [0x55; 10];
    for round in 0..1_000 {
        let long_way = (long.request(&octets, false), long.reply(&octets).characters);
        let request =
            if short.leaves_request(&octets) { intact(&octets) } else { short.request(&octets, false) };
        let reply =
            if short.leaves_reply(&octets) { intact(&octets) } else { short.reply(&octets).characters };
        assert_eq!((request, reply), long_way, "round {round}");
    }
    // One character in eleven is in a burst.
    let damaged = long.counters().damaged_request_characters;
    assert!((600..1_300).contains(&damaged), "{damaged} of 10000");
}

#[test]
fn another_seed_gives_other_faults() {
    let run = |seed| {
        let mut faults = noise(|noise| (noise.seed, noise.lost_replies) = (seed, 0.5));
        (0..64).map(|_| faults.reply(&[0xE5]).characters.is_empty()).collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn replies_draw_nothing_from_requests() {
    let run = |requests: usize| {
        let mut faults = noise(|noise| (noise.lost_replies, noise.bit_errors) = (0.5, 0.01));
        (0..64)
            .map(|_| {
                (0..requests).for_each(|_| drop(faults.request(&[0x10, 2], true)));
                faults.reply(&[0xE5])
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(0), run(3));
}

/// One flip among data and parity shows in the parity, two do not; start and stop bit always do.
#[test]
fn parity_sees_an_odd_number_of_flips() {
    let mut faults = noise(|noise| noise.bit_errors = 0.05);
    let (mut seen, mut unseen) = (0, 0);
    for _ in 0..20_000 {
        let [arrived] = faults.request(&[0x5A], false)[..] else { panic!("one") };
        match (arrived.octet ^ 0x5A, arrived.error) {
            (0, error) => assert!(!error, "an error must show in the octet too"),
            (_, true) => seen += 1,
            (mask, false) => {
                unseen += 1;
                // With the parity bit among the flips an odd number of data bits may change unseen.
                assert!(mask.count_ones() <= 8);
            }
        }
    }
    // 1 - 0.95^11 of 20000 have a flip; about 36 pairs of 9 bits among them at 0.05^2 are unseen.
    assert!((7_500..9_500).contains(&(seen + unseen)), "{seen} {unseen}");
    assert!((700..2_000).contains(&unseen), "{unseen}");
}

/// A quarter of 4000 characters: 1000, give or take four times 27. Each is wrong in both ways of looking.
#[test]
fn characters_with_a_wrong_parity_come_as_often_as_they_should() {
    let mut faults = noise(|noise| noise.character_errors = 0.25);
    let (mut in_requests, mut in_replies) = (0, 0);
    for _ in 0..4_000 {
        let [arrived] = faults.request(&[0x5A], false)[..] else { panic!("one") };
        assert_eq!(arrived.octet, if arrived.error { 0xA5 } else { 0x5A });
        in_requests += u32::from(arrived.error);
        in_replies += u32::from(faults.reply(&[0x5A]).characters[0].error);
    }
    assert!((890..1_110).contains(&in_requests), "{in_requests}");
    assert!((890..1_110).contains(&in_replies), "{in_replies}");
    let counters = faults.counters();
    assert_eq!(counters.damaged_request_characters, u64::from(in_requests));
}

#[test]
fn faults_by_request_meet_the_octet_they_are_for() {
    let mut faults = Faults::default();
    for fault in [
        RequestFault::Corrupt { octet: 1, mask: 0x81 },
        RequestFault::CharacterError { octet: 99 },
        RequestFault::Lose,
        RequestFault::Double,
    ] {
        assert!(faults.fail_next_request(fault));
    }
    let good = intact(&[1, 2, 3]);
    assert_eq!(faults.request(&[1, 2, 3], false), good, "to somebody else");
    assert_eq!(faults.request(&[1, 2, 3], true)[1], Character { octet: 0x83, error: false });
    assert_eq!(faults.request(&[1, 2, 3], true)[2], Character { octet: 0xFC, error: true });
    assert_eq!(faults.request(&[1, 2, 3], true), good);
    assert_eq!((faults.times_heard(false), faults.times_heard(true), faults.times_heard(true)), (1, 0, 2));
    assert!(!faults.is_active());
    let counters = faults.counters();
    assert_eq!(counters.damaged_request_characters, 2);
    assert_eq!((counters.lost_requests, counters.doubled_requests), (1, 1));
}

#[test]
fn no_more_than_a_thousand_wait() {
    let mut faults = Faults::default();
    for _ in 0..MOST_WAITING {
        assert!(faults.fail_next_reply(ReplyFault::Lose));
        assert!(faults.fail_next_request(RequestFault::Lose));
    }
    assert!(!faults.fail_next_reply(ReplyFault::Lose));
    assert!(!faults.fail_next_request(RequestFault::Lose));
    assert_eq!(faults.waiting(), (MOST_WAITING, MOST_WAITING));
    faults.clear();
    assert!(!faults.is_active());
}

#[test]
fn what_is_no_share_is_refused() {
    for share in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
        let wrong = Noise { lost_replies: share, ..Noise::default() };
        let mut faults = Faults::default();
        let error = faults.set_noise(wrong).expect_err("no share").to_string();
        assert!(error.contains("lost_replies") && error.contains("from 0 to 1"), "{error}");
        assert!(!faults.is_active());
    }
    let late = Noise { late_by: Duration::from_secs(11), ..Noise::default() };
    assert_eq!(late.check(), Err(NoiseError::TooLate));
}

// A hundredth of characters begin a burst of ten on average: about a burst in 110 characters, so that one
// in eleven is in a burst, in which nearly each has a flip (1 - 0.5^11).
#[test]
fn bursts_come_and_go_as_often_as_they_should() {
    let noise =
        Noise { seed: 5, bursts: 0.01, burst_length: 10.0, burst_bit_errors: 0.5, ..Noise::default() };
    let mut faults = Faults::default();
    faults.set_noise(noise).expect("a noise");
    assert!(faults.noise().is_some());
    let mut again = Faults::default();
    again.set_noise(noise).expect("a noise");
    let sent = [0x55; 200];
    let (mut damaged, mut runs, mut before) = (0, 0, false);
    for _ in 0..500 {
        let arrived = faults.request(&sent, true);
        assert_eq!(again.request(&sent, true), arrived, "the same seed, the same noise");
        for character in arrived {
            let is = character != Character { octet: 0x55, error: false };
            damaged += u32::from(is);
            runs += u32::from(is && !before);
            before = is;
        }
    }
    assert!((8_000..10_200).contains(&damaged), "{damaged} of 100000");
    assert!((700..1_200).contains(&runs), "{runs} bursts");
}

#[test]
fn a_burst_has_a_length_and_needs_a_beginning() {
    let wrong = Noise { bursts: 0.1, ..Noise::default() };
    assert_eq!(wrong.check(), Err(NoiseError::BurstLength(0.0)));
    assert!(Noise { burst_bit_errors: 0.5, burst_length: 5.0, ..Noise::default() }.is_quiet());
}

// Two wrong devices at 12 Mbit/s: 0.006 of the bits, so 1 - 0.994^11 = 6.4 % of characters have a flip.
#[test]
fn a_wrong_termination_damages_bits_by_the_rate_until_it_is_right() {
    let mut faults = Faults::default();
    faults.set_rate(Baudrate::B12000000);
    faults.set_cable(Cable { mismatches: Some(2), ..Cable::default() });
    let sent = [0x55; 10_000];
    let damaged = |faults: &mut Faults| {
        let arrived = faults.request(&sent, true);
        arrived.iter().filter(|character| character.error || character.octet != 0x55).count()
    };
    let found = damaged(&mut faults);
    assert!((540..740).contains(&found), "{found}");
    faults.clear();
    assert!(faults.is_active(), "a quiet line does not end it");
    faults.set_rate(Baudrate::B93750);
    assert_eq!(damaged(&mut faults), 0);
    assert!(!faults.is_active());
    faults.set_rate(Baudrate::B12000000);
    assert!(faults.is_active());
    faults.set_cable(Cable { mismatches: Some(0), ..Cable::default() });
    assert!(!faults.is_active());
}
