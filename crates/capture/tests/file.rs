//! Files: what is written is read again, and whatever else there is gets a sentence.

use std::io::Read;

use capture::packet::Faults;
use capture::{Direction, LinkType, Packet, ReadError, Reader, Writer};

const STATUS: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

fn packets() -> Vec<Packet> {
    vec![
        Packet {
            nanos: 1_700_000_000_123_456_789,
            direction: Some(Direction::Request),
            octets: STATUS.to_vec(),
            ..Packet::default()
        },
        Packet {
            nanos: 1_700_000_000_123_456_790,
            direction: Some(Direction::Reply),
            octets: vec![0xE5],
            faults: Faults { character: true, check_sum: true, ..Faults::default() },
            missing: 7,
            comments: vec!["first".to_owned(), "sécond".to_owned()],
        },
        Packet { nanos: u64::MAX, comments: vec!["the master left".to_owned()], ..Packet::default() },
    ]
}

fn file(link_type: LinkType, packets: &[Packet]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new(), link_type, "bus").unwrap();
    for packet in packets {
        writer.write(packet).unwrap();
    }
    writer.into_inner()
}

/// All packets, and what ended them.
fn read(file: impl Read) -> (Vec<Packet>, Result<(), ReadError>) {
    let mut packets = Vec::new();
    let mut reader = match Reader::new(file) {
        Ok(reader) => reader,
        Err(error) => return (packets, Err(error)),
    };
    loop {
        match reader.next_packet() {
            Ok(Some(packet)) => packets.push(packet),
            Ok(None) => return (packets, Ok(())),
            Err(error) => return (packets, Err(error)),
        }
    }
}

/// Octets that come one by one.
struct Drops<'a>(&'a [u8]);

impl Read for Drops<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let Some((first, rest)) = self.0.split_first() else { return Ok(0) };
        (buffer[0], self.0) = (*first, rest);
        Ok(1)
    }
}

#[test]
fn what_is_written_is_read_again() {
    for link_type in [LinkType::User0, LinkType::ProfibusDl] {
        let file = file(link_type, &packets());
        let (found, end) = read(file.as_slice());
        assert_eq!(found, packets());
        assert!(end.is_ok());
        assert_eq!(read(Drops(&file)).0, packets());
    }
}

/// A block, little-endian.
fn block(kind: u32, body: &[u8]) -> Vec<u8> {
    let mut body = body.to_vec();
    body.resize(body.len().next_multiple_of(4), 0);
    let length = u32::try_from(body.len() + 12).unwrap().to_le_bytes();
    [&kind.to_le_bytes()[..], &length, &body, &length].concat()
}

fn section() -> Vec<u8> {
    block(0x0A0D_0D0A, &[&0x1A2B_3C4D_u32.to_le_bytes()[..], &[1, 0, 0, 0], &[0xFF; 8]].concat())
}

/// An interface with this link type, and options.
fn interface(link_type: u16, options: &[u8]) -> Vec<u8> {
    block(1, &[&link_type.to_le_bytes()[..], &[0; 6], options].concat())
}

fn packet(interface: u32, time: u64, octets: &[u8]) -> Vec<u8> {
    let (high, low) = (u32::try_from(time >> 32).unwrap(), u32::try_from(time & 0xFFFF_FFFF).unwrap());
    let length = u32::try_from(octets.len()).unwrap();
    let head: Vec<u8> =
        [interface, high, low, length, length].iter().flat_map(|word| word.to_le_bytes()).collect();
    block(6, &[&head, octets].concat())
}

// By hand, as the format has it: times in microseconds where nothing is said.
#[test]
fn files_of_others_have_their_own_units_of_time() {
    for (options, units, nanos) in [
        (&[][..], 1_000_001, 1_000_001_000),
        (&[9, 0, 1, 0, 3, 0, 0, 0, 0, 0, 0, 0], 5, 5_000_000),
        (&[9, 0, 1, 0, 0x81, 0, 0, 0, 0, 0, 0, 0], 3, 1_500_000_000),
        (&[9, 0, 1, 0, 0x7F, 0, 0, 0, 0, 0, 0, 0], 3, 0),
    ] {
        let file = [section(), interface(147, options), packet(0, units, &STATUS)].concat();
        let (found, end) = read(file.as_slice());
        assert!(end.is_ok(), "{end:?}");
        assert_eq!((found[0].nanos, found[0].octets.as_slice()), (nanos, &STATUS[..]));
    }
}

// The same octets in the other order.
#[test]
fn files_of_computers_with_the_other_order_of_octets_are_read() {
    let word = |value: u32| value.to_be_bytes();
    let mut file = Vec::new();
    for words in [
        &[0x0A0D_0D0A, 28, 0x1A2B_3C4D, 0x0001_0000, u32::MAX, u32::MAX, 28][..],
        &[1, 20, 147 << 16, 0, 20],
        &[6, 40, 0, 0, 9, 6, 6, 0x100B_0249, 0x5616_0000, 40],
    ] {
        file.extend(words.iter().flat_map(|value| word(*value)));
    }
    let (found, end) = read(file.as_slice());
    assert!(end.is_ok(), "{end:?}");
    assert_eq!((found[0].nanos, found[0].octets.as_slice()), (9_000, &STATUS[..]));
}

#[test]
fn a_file_that_is_cut_anywhere_is_read_up_to_there() {
    let whole = file(LinkType::User0, &packets());
    for length in 0..whole.len() {
        let (found, end) = read(&whole[..length]);
        assert_eq!(found, packets()[..found.len()]);
        if let Err(error) = end {
            let words = error.to_string();
            assert!(words.contains("cut off") || words.contains("is no pcapng file"), "{length}: {words}");
        }
    }
}

#[track_caller]
fn fails(file: &[u8], words: &str) {
    let (_, end) = read(file);
    let error = end.expect_err(words).to_string();
    assert!(error.contains(words), "{error}");
}

#[test]
fn whatever_is_no_capture_of_a_profibus_gets_a_sentence() {
    let good = [section(), interface(147, &[])].concat();
    let with = |more: &[u8]| [&good, more].concat();
    fails(b"", "is no pcapng file");
    fails(b"10 0B 02 49 56 16", "does not begin with a section header");
    fails(&[0xD4, 0xC3, 0xB2, 0xA1, 2, 0, 4, 0], "it is an old pcap file");
    fails(&with(&packet(1, 0, &STATUS)), "an interface that was not described");
    fails(&[section(), packet(0, 0, &STATUS)].concat(), "an interface that was not described");
    fails(&[section(), interface(1, &[]), packet(0, 0, &[0; 60])].concat(), "link type 1");
    fails(&with(&[6, 0, 0, 0, 0xFC, 0xFF, 0xFF, 0xFF]), "claims 4294967292 octets");
    fails(&with(&[6, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0]), "cannot be");
    fails(&with(&[6, 0, 0, 0, 12, 0, 0, 0, 13, 0, 0, 0]), "cannot be");
    let mut hostile = section();
    hostile[4..8].copy_from_slice(&0xFFFF_FFF0_u32.to_le_bytes());
    fails(&hostile, "its section header claims 4294967280 octets");
    // A packet that claims more octets than its block has.
    let mut lying = packet(0, 0, &STATUS);
    lying[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
    fails(&with(&lying), "cannot be");
    fails(&[section(), interface(147, &[]).repeat(1_100)].concat(), "interface 1000 and more");
}

#[test]
fn packets_of_other_networks_beside_ours_are_counted() {
    let file =
        [section(), interface(1, &[]), interface(257, &[]), packet(0, 0, &[1; 60]), packet(1, 0, &STATUS)];
    let file = file.concat();
    let mut reader = Reader::new(file.as_slice()).unwrap();
    assert_eq!(reader.next_packet().unwrap().unwrap().octets, STATUS);
    assert!(reader.next_packet().unwrap().is_none());
    assert_eq!(reader.foreign(), Some((1, 1)));
}
