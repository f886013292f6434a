//! The light master against encoders in virtual time and in real time.

mod common;

use bus::{ReplyFault, VirtualSegment, memory};
use common::{ADDRESS, CLASS_1, CLASS_2, IDENT, SCANCON, encoder, encoder_at, set_prm};
use master::light::StationKind;
use master::{Error, LightMaster, Settings, Wire};
use plant::EncoderStation;
use profibus_dp::time::{Baudrate, Duration, Instant};

type Master = LightMaster<VirtualSegment<EncoderStation>>;

fn master(rate: Baudrate) -> Master {
    let mut segment = VirtualSegment::new(Instant::ZERO, rate);
    segment.add(encoder(rate));
    LightMaster::new(segment, Settings::default())
}

fn in_exchange(rate: Baudrate) -> Master {
    let mut master = master(rate);
    master.set_prm(ADDRESS, &set_prm(CLASS_2)).unwrap();
    master.chk_cfg(ADDRESS, &[0xF1]).unwrap();
    assert_eq!(master.exchange(ADDRESS, &[0; 4]).unwrap().octets, [0x12, 0x34, 0x56, 0x78]);
    master
}

#[test]
fn all_functionalities_exchange_data_at_all_rates() {
    for rate in Baudrate::ALL {
        for (user, cfg, outputs, inputs) in [
            (CLASS_1, &[0xD1][..], 0, &[0x12, 0x34, 0x56, 0x78][..]),
            (CLASS_2, &[0xF1], 4, &[0x12, 0x34, 0x56, 0x78]),
            (SCANCON, &[0xF1, 0xD1, 0xD1], 4, &[0x12, 0x34, 0x56, 0x78, 0, 0, 0, 0, 0, 0, 0, 0]),
        ] {
            let mut master = master(rate);
            assert!(master.diagnosis(ADDRESS).unwrap().standard.prm_req);
            master.set_prm(ADDRESS, &set_prm(user)).unwrap();
            master.chk_cfg(ADDRESS, cfg).unwrap();
            let diagnosis = master.diagnosis(ADDRESS).unwrap();
            assert!(!diagnosis.standard.station_not_ready, "{rate}");
            assert_eq!(diagnosis.standard.master_add, Some(2));
            for _ in 0..5 {
                let found = master.exchange(ADDRESS, &vec![0; outputs]).unwrap();
                assert_eq!((found.octets, found.high_priority), (inputs, false), "{rate}");
            }
            assert_eq!(master.get_cfg(ADDRESS).unwrap(), cfg);
            assert_eq!(master.counters().retries, 0);
        }
    }
}

#[test]
fn the_live_list_has_every_station_and_no_other() {
    let mut segment = VirtualSegment::new(Instant::ZERO, Baudrate::B1500000);
    for address in [126, 1, 77] {
        segment.add(encoder_at(address, Baudrate::B1500000));
    }
    let mut master = LightMaster::new(segment, Settings::default());
    let passive = |address| (address, StationKind::Passive);
    assert_eq!(master.live_list().unwrap(), [passive(1), passive(77), passive(126)]);
}

#[test]
fn an_address_is_given_and_the_sequence_begins_anew_there() {
    let mut segment = VirtualSegment::new(Instant::ZERO, Baudrate::B500000);
    segment.add(encoder_at(126, Baudrate::B500000));
    let mut master = LightMaster::new(segment, Settings::default());
    master.set_address(126, 9, IDENT, false).unwrap();
    assert!(matches!(master.diagnosis(126), Err(Error::Silent { slave: 126, attempts: 2, .. })));
    assert!(master.diagnosis(9).unwrap().standard.prm_req);
    // The ident number is another's: accepted and ignored.
    master.set_address(9, 10, 0x4711, false).unwrap();
    assert!(master.diagnosis(9).is_ok());
}

#[test]
fn a_lost_answer_is_asked_for_again_and_executed_once() {
    let mut master = in_exchange(Baudrate::B500000);
    for lost in 1..=2 {
        // Preset to 100: 80000064h. The answer to it shows the position before.
        for _ in 0..lost {
            master.line_mut().fail_next_reply(ReplyFault::Lose);
        }
        master.set_settings(Settings { retries: 2, ..Settings::default() });
        let retries = master.counters().retries;
        master.exchange(ADDRESS, &[0x80, 0, 0, 0x64]).unwrap();
        assert_eq!(master.counters().retries - retries, lost);
        master.line_mut().wait(Duration::from_millis(1));
        assert_eq!(master.exchange(ADDRESS, &[0; 4]).unwrap().octets, [0, 0, 0, 0x64]);
    }
}

#[test]
fn a_damaged_answer_is_asked_for_again_and_told_in_hex_in_the_end() {
    let mut master = in_exchange(Baudrate::B500000);
    master.line_mut().fail_next_reply(ReplyFault::Corrupt { octet: 7, mask: 0x10 });
    assert_eq!(master.exchange(ADDRESS, &[0; 4]).unwrap().octets, [0x12, 0x34, 0x56, 0x78]);
    for _ in 0..2 {
        master.line_mut().fail_next_reply(ReplyFault::Corrupt { octet: 7, mask: 0x10 });
    }
    let error = master.exchange(ADDRESS, &[0; 4]).unwrap_err().to_string();
    // 12 became 02; LE is 7, and the sum of 02 05 08 12 34 56 78 is 23.
    assert!(error.contains("68 07 07 68 02 05 08 02 34 56 78 23 16"), "{error}");
    // A new sequence, and all is well.
    assert!(master.exchange(ADDRESS, &[0; 4]).is_ok());
}

#[test]
fn two_silent_requests_in_a_row_do_not_lock_anybody_up() {
    let mut master = in_exchange(Baudrate::B500000);
    for _ in 0..4 {
        master.line_mut().fail_next_reply(ReplyFault::Lose);
    }
    assert!(matches!(master.exchange(ADDRESS, &[0; 4]), Err(Error::Silent { .. })));
    assert!(matches!(master.diagnosis(ADDRESS), Err(Error::Silent { .. })));
    assert_eq!(master.exchange(ADDRESS, &[0; 4]).unwrap().octets, [0x12, 0x34, 0x56, 0x78]);
}

#[test]
fn a_second_master_reads_while_the_first_owns() {
    let mut owner = in_exchange(Baudrate::B1500000);
    owner.exchange(ADDRESS, &[0, 0, 0, 7]).unwrap();
    let mut reader = LightMaster::new(owner.line_mut(), Settings { address: 3, ..Settings::default() });
    assert_eq!(reader.diagnosis(ADDRESS).unwrap().standard.master_add, Some(2));
    assert_eq!(reader.read_inputs(ADDRESS).unwrap(), [0x12, 0x34, 0x56, 0x78]);
    assert_eq!(reader.read_outputs(ADDRESS).unwrap(), [0, 0, 0, 7]);
    assert_eq!(reader.get_cfg(ADDRESS).unwrap(), [0xF1]);
    let refused = reader.exchange(ADDRESS, &[0; 4]).unwrap_err().to_string();
    assert!(refused.contains("refuses Data_Exchange: RS") && refused.contains("another master"), "{refused}");
    assert!(owner.exchange(ADDRESS, &[0; 4]).is_ok());
    owner.unlock(ADDRESS, IDENT).unwrap();
    assert_eq!(owner.diagnosis(ADDRESS).unwrap().standard.master_add, None);
    let refused = owner.exchange(ADDRESS, &[0; 4]).unwrap_err().to_string();
    assert!(refused.contains("wants parameters"), "{refused}");
}

#[test]
fn global_control_reaches_the_slaves_and_is_not_answered() {
    let mut master = master(Baudrate::B500000);
    let mut prm = set_prm(CLASS_2);
    prm[0] |= 0x10;
    master.set_prm(ADDRESS, &prm).unwrap();
    master.chk_cfg(ADDRESS, &[0xF1]).unwrap();
    master.exchange(ADDRESS, &[0; 4]).unwrap();
    // Freeze.
    master.global_control(0x08, 0).unwrap();
    assert!(master.diagnosis(ADDRESS).unwrap().standard.freeze_mode);
}

#[test]
fn raw_octets_go_out_as_they_are() {
    let mut master = master(Baudrate::B500000);
    // FDL status of station 5.
    assert_eq!(master.raw(&[0x10, 5, 2, 0x49, 0x50, 0x16]).unwrap(), [0x10, 2, 5, 0, 7, 0x16]);
    assert_eq!(master.raw(&[0x10, 5, 2, 0x49, 0x51, 0x16]).unwrap(), [0; 0]);
}

#[test]
fn what_cannot_be_asked_is_a_sentence() {
    let mut master = master(Baudrate::B500000);
    assert!(master.diagnosis(127).unwrap_err().to_string().contains("0 to 126"));
    let long = master.set_prm(ADDRESS, &[0; 245]).unwrap_err().to_string();
    assert!(long.contains("Set_Prm with 245 octets"), "{long}");
}

#[test]
fn in_real_time_it_asks_over_any_end() {
    let (near, far) = memory::pair();
    let bus = common::real(Box::new(far));
    let wire = Wire::new(Box::new(near)).with_slot_time(Duration::from_millis(300));
    let mut master = LightMaster::new(wire, Settings::default());
    master.set_prm(ADDRESS, &set_prm(CLASS_2)).unwrap();
    master.chk_cfg(ADDRESS, &[0xF1]).unwrap();
    for _ in 0..50 {
        assert_eq!(master.exchange(ADDRESS, &[0; 4]).unwrap().octets, [0x12, 0x34, 0x56, 0x78]);
    }
    master.line_mut();
    let wire = master.into_line().with_slot_time(Duration::from_millis(10));
    let mut master = LightMaster::new(wire, Settings::default());
    assert!(matches!(master.diagnosis(6), Err(Error::Silent { slave: 6, .. })));
    bus.end();
}
