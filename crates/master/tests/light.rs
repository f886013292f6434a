//! The light master against encoders in virtual time and in real time.

mod common;

use bus::{EndError, ReplyFault, VirtualSegment, memory};
use common::{ADDRESS, CLASS_1, CLASS_2, IDENT, SCANCON, encoder, encoder_at, set_prm};
use master::light::StationKind;
use master::line::ReplyBuffer;
use master::{Error, Heard, LightMaster, Line, Settings, Wire};
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

/// A line that writes down what is sent; every reply but the lost ones is an E5, or what others say.
#[derive(Debug, Default)]
struct Script {
    sent: Vec<Vec<u8>>,
    lose: usize,
    others: Vec<u8>,
    damaged: bool,
}

impl Line for Script {
    fn now(&self) -> Instant {
        Instant::ZERO
    }

    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        self.sent.push(request.to_vec());
        if self.lose > 0 {
            self.lose -= 1;
            return Ok(Heard::silence(Duration::ZERO));
        }
        let octets = if self.others.is_empty() { &[0xE5][..] } else { &self.others };
        reply[..octets.len()].copy_from_slice(octets);
        Ok(Heard { length: octets.len(), delay: Duration::ZERO, damaged: self.damaged })
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        self.sent.push(octets.to_vec());
        Ok(())
    }

    fn wait(&mut self, _: Duration) -> Result<(), EndError> {
        Ok(())
    }
}

// DP slave reference, section 2: FCV = 0 and FCB = 1 begin; then FCB toggles, but not in a retry.
#[test]
fn the_frame_count_bit_toggles_with_each_answer_and_begins_anew_after_silence() {
    let mut master = LightMaster::new(Script::default(), Settings::default());
    let mut function_codes = |lose: usize, times: usize| {
        master.line_mut().lose = lose;
        for _ in 0..times {
            let _ = master.set_prm(ADDRESS, &[0x80, 0, 0, 0, 0, 0, 0]);
        }
        let sent = std::mem::take(&mut master.line_mut().sent);
        sent.iter().map(|octets| octets[6]).collect::<Vec<u8>>()
    };
    assert_eq!(function_codes(0, 4), [0x6D, 0x5D, 0x7D, 0x5D]);
    // One lost, and its retry.
    assert_eq!(function_codes(1, 2), [0x7D, 0x7D, 0x5D]);
    // Both lost: the station may have heard both, or none.
    assert_eq!(function_codes(2, 3), [0x7D, 0x7D, 0x6D, 0x5D]);
    // Each station has a sequence of its own.
    master.set_prm(ADDRESS + 1, &[0x80, 0, 0, 0, 0, 0, 0]).unwrap();
    assert_eq!(master.line().sent[0][6], 0x6D);
}

// DP slave reference, section 2.2 row 5: with a toggled bit a slave that has not heard the request would
// take the next one for a retry of the request before, and would not carry it out.
#[test]
fn after_somebody_elses_telegram_in_place_of_an_answer_the_sequence_begins_anew() {
    let mut master = LightMaster::new(Script::default(), Settings::default());
    // A token to another master, and another slave's answer to another master: 03 + 09 + 08 + 01 is 15h.
    for others in [vec![0xDC, 3, 4], vec![0x68, 4, 4, 0x68, 3, 9, 8, 1, 0x15, 0x16]] {
        for _ in 0..2 {
            master.set_prm(ADDRESS, &[0x80, 0, 0, 0, 0, 0, 0]).unwrap();
        }
        master.line_mut().others = others;
        let failed = master.set_prm(ADDRESS, &[0x80, 0, 0, 0, 0, 0, 0]);
        assert!(matches!(failed, Err(Error::Unexpected { .. })), "{failed:?}");
        master.line_mut().others.clear();
        master.line_mut().sent.clear();
        master.set_prm(ADDRESS, &[0x80, 0, 0, 0, 0, 0, 0]).unwrap();
        assert_eq!(master.line().sent[0][6], 0x6D);
    }
}

// 02 + 05 is 07h: station 5 says that it is a slave.
#[test]
fn a_station_whose_status_came_damaged_is_not_taken_for_one() {
    let mut master = LightMaster::new(Script::default(), Settings::default());
    master.line_mut().others = vec![0x10, 2, ADDRESS, 0, 0x07, 0x16];
    assert_eq!(master.status(ADDRESS).unwrap(), Some(StationKind::Passive));
    master.line_mut().damaged = true;
    assert_eq!(master.status(ADDRESS).unwrap(), None);
}

// By hand: DA 85, SA 82, then FC, DSAP, SSAP and the data; FCS is their sum.
#[test]
fn services_are_sent_as_the_standard_has_them() {
    let mut master = LightMaster::new(Script::default(), Settings::default());
    master.unlock(ADDRESS, 0x108B).unwrap();
    master.set_address(ADDRESS, 9, 0x108B, true).unwrap();
    master.global_control(0x20, 0x03).unwrap();
    let sent = &master.line().sent;
    assert_eq!(sent[0][4..14], [0x85, 0x82, 0x6D, 61, 62, 0x40, 0, 0, 0, 0x10]);
    assert_eq!(sent[1][4..13], [0x85, 0x82, 0x5D, 55, 62, 9, 0x10, 0x8B, 0xFF]);
    // FF + 82 + 46 + 3A + 3E + 20 + 03 is 262h.
    assert_eq!(sent[2], [0x68, 7, 7, 0x68, 0xFF, 0x82, 0x46, 58, 62, 0x20, 0x03, 0x62, 0x16]);
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

// What an exchange costs does not grow with the stations, and each gets what is for it.
#[test]
fn one_master_keeps_a_full_bus_of_encoders_in_data_exchange() {
    let mut segment = VirtualSegment::new(Instant::ZERO, Baudrate::B12000000);
    let stations: Vec<u8> = (1..=125).filter(|&address| address != 2).collect();
    for &station in &stations {
        segment.add(encoder_at(station, Baudrate::B12000000));
    }
    let mut master = LightMaster::new(segment, Settings::default());
    let mut prm = set_prm(CLASS_2);
    // A watchdog of 100 ms.
    (prm[0], prm[1], prm[2]) = (0x88, 1, 10);
    for &station in &stations {
        master.set_prm(station, &prm).unwrap();
        master.chk_cfg(station, &[0xF1]).unwrap();
    }
    for cycle in 0..200u32 {
        for &station in &stations {
            let outputs = (cycle << 8 | u32::from(station)).to_be_bytes();
            assert_eq!(master.exchange(station, &outputs).unwrap().octets, [0x12, 0x34, 0x56, 0x78]);
        }
    }
    for &station in &stations {
        assert_eq!(master.read_outputs(station).unwrap(), [0, 0, 199, station]);
    }
    assert_eq!(master.counters().retries, 0);
    // 124 exchanges take a few milliseconds; nobody's watchdog has expired. Now all do.
    master.line_mut().wait(Duration::from_millis(150));
    for &station in &stations {
        assert!(master.exchange(station, &[0; 4]).is_err(), "{station}");
    }
}
