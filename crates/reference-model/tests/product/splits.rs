//! However a telegram is cut into reads, and whatever garbage comes before it: the same answers.

use profibus_dp::time::{Baudrate, Duration};
use reference_model::{Device, Setting};

use crate::services::{ALL, Service};
use crate::twin::{Fate, Twin};

/// A slave so far on its way: with so many telegrams of the start-up behind it.
fn twin(stream: bool, telegrams: usize) -> Twin {
    let device = Device { address_changeable: true, ..Device::new() };
    let mut twin = Twin::new(Setting { address: 11, rate: Baudrate::B500000, stream }, &device);
    let start_up = [(Service::PrmGood, 0x6D), (Service::CfgGood, 0x5D)];
    for (service, fc) in start_up.into_iter().take(telegrams) {
        pause(&mut twin);
        let octets = request(&twin, service, fc);
        twin.send(&[&octets], Fate::After(0)).expect("they are the same");
    }
    twin
}

fn pause(twin: &mut Twin) {
    twin.pass(Duration::from_millis(11)).expect("they are the same");
}

fn request(twin: &Twin, service: Service, fc: u8) -> Vec<u8> {
    service.asked(11, 2, fc, &twin.model.device, 1).octets(false)
}

/// The answer to the reads, and to a Slave_Diag after them.
fn answers(stream: bool, telegrams: usize, garbage: &[u8], reads: &[&[u8]]) -> [Option<Vec<u8>>; 2] {
    let mut twin = twin(stream, telegrams);
    pause(&mut twin);
    twin.send(&[garbage], Fate::Lost).expect("they are the same");
    pause(&mut twin);
    let answer = twin.send(reads, Fate::After(0)).expect("they are the same");
    pause(&mut twin);
    let diagnosis = request(&twin, Service::Diag, 0x5D);
    [answer, twin.send(&[&diagnosis], Fate::After(0)).expect("they are the same")]
}

#[test]
fn every_way_to_cut_a_telegram_into_two_or_three_reads_gets_the_same_answer() {
    for (stream, telegrams) in
        [false, true].into_iter().flat_map(|stream| [0, 1, 2].map(|from| (stream, from)))
    {
        for service in ALL {
            let octets = request(&twin(stream, telegrams), service, 0x7D);
            let whole = answers(stream, telegrams, &[], &[&octets]);
            for first in 0..octets.len() {
                for second in first..octets.len() {
                    let reads = [&octets[..first], &octets[first..second], &octets[second..]];
                    let cut = answers(stream, telegrams, &[], &reads);
                    assert_eq!(cut, whole, "{service:?} cut at {first} and {second}, stream {stream}");
                }
            }
            let single: Vec<&[u8]> = octets.chunks(1).collect();
            assert_eq!(answers(stream, telegrams, &[], &single), whole, "{service:?} octet by octet");
        }
    }
}

#[test]
fn garbage_and_a_pause_before_a_telegram_change_no_answer() {
    // Heads of telegrams, telegrams broken off or damaged, longest claims, and plain noise.
    let garbage: [&[u8]; 12] = [
        &[0xFF, 0x00, 0x55],
        &[0x68],
        &[0x68, 0xF9, 0xF9, 0x68],
        &[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4],
        &[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x7D, 0x3D, 0x3E, 0xF5, 0x16],
        &[0x10, 0x0B, 0x02, 0x49, 0x56],
        &[0x10, 0x0B, 0x02, 0x49, 0x57, 0x16],
        &[0xA2, 0x8B, 0x82],
        &[0xDC, 0x0B],
        &[0xE5, 0xE5, 0xE5],
        &[0x16, 0x16, 0x68, 0x68, 0x10],
        &[0x00; 300],
    ];
    for (stream, telegrams) in
        [false, true].into_iter().flat_map(|stream| [0, 1, 2].map(|from| (stream, from)))
    {
        for service in ALL {
            let octets = request(&twin(stream, telegrams), service, 0x7D);
            let clean = answers(stream, telegrams, &[], &[&octets]);
            for garbage in garbage {
                let after = answers(stream, telegrams, garbage, &[&octets]);
                assert_eq!(after, clean, "{service:?} after {garbage:02X?}, stream {stream}");
            }
        }
    }
}
