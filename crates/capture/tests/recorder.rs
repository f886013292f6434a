//! What a tap sees is in the file, and what is missing is counted.

use std::fs::File;
use std::path::Path;

use bus::end::Written;
use bus::{FaultCounters, Sight, WireTap};
use capture::{Direction, Packet, Reader, Recorder, Settings};
use profibus_dp::time::Instant;
use tempfile::tempdir;

const STATUS: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];
const ANSWER: [u8; 6] = [0x10, 0x02, 0x0B, 0x00, 0x0D, 0x16];

fn settings() -> Settings {
    Settings { link_type: capture::LinkType::User0, name: "bus".to_owned(), is_virtual: true }
}

fn request(octets: &[u8]) -> Sight<'_> {
    Sight::Request { octets, faults: FaultCounters::default() }
}

fn reply(octets: &[u8]) -> Sight<'_> {
    Sight::Reply { octets, faults: FaultCounters::default(), collision: false, written: Written::All }
}

fn read(path: &Path) -> Vec<Packet> {
    let mut reader = Reader::new(File::open(path).unwrap()).unwrap();
    std::iter::from_fn(|| reader.next_packet().unwrap()).collect()
}

/// What is in the file after these sights, one each millisecond.
fn recorded(sights: &[Sight<'_>]) -> Vec<Packet> {
    let directory = tempdir().unwrap();
    let path = directory.path().join("x.pcapng");
    let recorder = Recorder::start(&path, &settings()).unwrap();
    let mut tap = recorder.tap();
    for (at, sight) in (1..).zip(sights) {
        tap.saw(Instant::from_millis(at), *sight);
    }
    assert_eq!(recorder.finish().missing, 0);
    read(&path)
}

fn in_short(packets: &[Packet]) -> Vec<(u64, Option<Direction>, &[u8])> {
    packets
        .iter()
        .map(|packet| (packet.nanos / 1_000_000, packet.direction, packet.octets.as_slice()))
        .collect()
}

#[test]
fn telegrams_are_put_together_and_taken_apart() {
    let (asked, answered) = (Some(Direction::Request), Some(Direction::Reply));
    let both = [STATUS, STATUS].concat();
    let packets = recorded(&[request(&STATUS[..4]), request(&STATUS[4..]), reply(&ANSWER), request(&both)]);
    assert_eq!(
        in_short(&packets),
        [(1, asked, &STATUS[..]), (3, answered, &ANSWER), (4, asked, &STATUS), (4, asked, &STATUS)]
    );
}

#[test]
fn a_half_telegram_ends_where_somebody_else_speaks_or_something_happens() {
    let packets =
        recorded(&[request(&STATUS[..4]), reply(&ANSWER), request(&STATUS[..2]), Sight::MasterLeft]);
    assert_eq!(packets.len(), 4);
    assert!(packets[0].faults.too_short && packets[0].comments[0].contains("2 more octets are due"));
    assert_eq!(packets[1].octets, ANSWER);
    assert!(packets[2].faults.too_short);
    assert_eq!((packets[3].octets.len(), packets[3].comments[0].as_str()), (0, "the master left"));
}

#[test]
fn faults_and_what_was_not_sent_are_in_comments() {
    let lost = FaultCounters { lost_requests: 1, ..FaultCounters::default() };
    let packets = recorded(&[
        Sight::Request { octets: &STATUS, faults: lost },
        Sight::TooLate,
        Sight::Overtaken,
        Sight::CharacterError,
        Sight::Reply {
            octets: &ANSWER,
            faults: FaultCounters::default(),
            collision: true,
            written: Written::Dropped(6),
        },
    ]);
    let comments: Vec<_> = packets.iter().map(|packet| packet.comments.join("; ")).collect();
    assert_eq!(
        comments,
        [
            "line fault: no station heard it",
            "a reply was not sent: it was older than the reply limit",
            "a reply was not sent: octets came before it",
            "a character with a parity or framing error",
            "two stations answered at once; the far side did not take 6 of 6 octets",
        ]
    );
    assert!(packets[3].faults.character);
}

#[test]
fn in_virtual_time_nothing_is_missing_however_much_it_is() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("x.pcapng");
    let recorder = Recorder::start(&path, &settings()).unwrap();
    let mut tap = recorder.tap();
    for at in 0..200_000 {
        tap.saw(Instant::from_millis(at), request(&STATUS));
    }
    let report = recorder.finish();
    assert_eq!((report.packets, report.missing), (200_000, 0));
    assert!(report.error.is_none());
    assert_eq!(read(&path).len(), 200_000);
}

// Nobody empties the store while its thread is held up by a pipe that nobody reads.
#[test]
fn in_real_time_what_the_disk_cannot_take_is_counted_and_the_bus_does_not_wait() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let reader = {
        let path = path.clone();
        std::thread::spawn(move || File::open(path).unwrap())
    };
    let recorder = Recorder::start(&path, &Settings { is_virtual: false, ..settings() }).unwrap();
    let mut pipe = reader.join().unwrap();
    let mut tap = recorder.tap();
    let sent = 400_000;
    for at in 0..sent {
        tap.saw(Instant::from_millis(at), request(&STATUS));
    }
    let sink = std::thread::spawn(move || {
        let mut octets = Vec::new();
        std::io::Read::read_to_end(&mut pipe, &mut octets).unwrap();
        octets
    });
    let report = recorder.finish();
    let octets = sink.join().unwrap();
    let mut reader = Reader::new(octets.as_slice()).unwrap();
    let packets: Vec<_> = std::iter::from_fn(|| reader.next_packet().unwrap()).collect();
    let told: u64 = packets.iter().map(|packet| packet.missing).sum();
    assert!(report.missing > 0, "the pipe has taken all of it");
    assert_eq!(told, report.missing);
    let telegrams = packets.iter().filter(|packet| packet.octets == STATUS).count() as u64;
    assert_eq!(telegrams + report.missing, sent);
}

#[test]
fn a_disk_that_is_full_is_told() {
    let recorder = Recorder::start(Path::new("/dev/full"), &settings());
    if let Ok(recorder) = recorder {
        let mut tap = recorder.tap();
        for at in 0..100_000 {
            tap.saw(Instant::from_millis(at), request(&STATUS));
        }
        assert!(recorder.finish().error.is_some());
    }
}
