//! Recordings beside a bus in real time: the bus never waits, and what is not in the file is told.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::sync::mpsc;
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::{MemoryEnd, pair};
use bus::{End, Event};
use plant::control::Subscriptions;
use plant::{EncoderSetup, Plant, Rate, Reporter, SegmentSetup, Shaft, Store, World};
use profibus_dp::time::{Duration, Instant};
use record::{Column, Format, Recorder, Ring, Settings, Table, Wanted};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

const EVERY: Duration = Duration::from_millis(1);
const PATIENCE: Time = Time::from_secs(20);

/// An encoder with address 5 on a bus, and its master's end.
struct Bench {
    plant: Plant,
    master: MemoryEnd,
    subscriptions: Subscriptions,
}

fn bench() -> Bench {
    let (end, master) = pair();
    let (to, reports) = mpsc::channel();
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(5),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches::default(),
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", Some(to.clone())),
    };
    let segment = SegmentSetup {
        name: "bus".to_owned(),
        end: Box::new(end),
        settings: bus::Settings { reply_limit: Duration::from_secs(60), ..bus::Settings::default() },
        encoders: vec![setup],
    };
    let mut plant = Plant::new();
    plant.add(segment, to).expect("a plant");
    let subscriptions = Subscriptions::new();
    let publish = subscriptions.clone();
    std::thread::spawn(move || reports.iter().for_each(|report| publish.publish(&report)));
    Bench { plant, master, subscriptions }
}

impl Bench {
    /// The answer to an FDL status request.
    fn status(&mut self) -> Vec<u8> {
        let _ = self.master.write(&[0x10, 5, 2, 0x49, 0x50, 0x16]).expect("an end");
        let until = Moment::now() + PATIENCE;
        let (mut got, mut buffer) = (Vec::new(), [0; 64]);
        while got.len() < 6 {
            let left = until.saturating_duration_since(Moment::now());
            assert!(!left.is_zero(), "no answer");
            if let Event::Octets(count) = self.master.wait(Some(left.into()), &mut buffer).expect("an end") {
                got.extend_from_slice(&buffer[..count]);
            }
        }
        got
    }

    fn record(&self, path: &Path, trouble: impl FnOnce(&str) + Send + 'static) -> Recorder {
        let settings = Settings { every: EVERY, is_virtual: false };
        let mut recorder = Recorder::start(path, settings, trouble).expect("a recorder");
        recorder.listen(self.subscriptions.subscribe()).expect("a thread");
        recorder.attach(&self.plant.handle()).expect("it runs");
        recorder
    }
}

/// The position column; what cannot be read yet counts as empty.
fn read(path: &Path) -> Table {
    let columns = [Column::named("position").expect("a column")];
    let wanted = Wanted { columns: &columns, encoders: &[], times: 0..=u64::MAX };
    Table::read(path, &wanted).unwrap_or_default()
}

fn formats() -> &'static [&'static str] {
    if cfg!(feature = "parquet") { &["csv", "parquet"] } else { &["csv"] }
}

#[test]
fn a_recording_can_be_read_while_it_is_written_also_after_a_sudden_end() {
    for format in formats() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(format!("it.{format}"));
        let bench = bench();
        let recorder = bench.record(&path, |trouble| panic!("{trouble}"));
        let until = Moment::now() + PATIENCE;
        while read(&path).samples() < 200 {
            assert!(Moment::now() < until, "{format}: {} samples", read(&path).samples());
            std::thread::sleep(Time::from_millis(20));
        }
        let table = read(&path);
        let times = &table.curves.iter().find(|curve| curve.encoder == "encoder").expect("it").times;
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] == 1_000_000), "{format}: none is missing");
        assert!(table.curves.iter().all(|curve| curve.values[0].iter().all(|value| *value == 0.0)));
        let report = recorder.finish();
        assert!(
            report.error.is_none() && report.missing == 0 && report.samples >= 200,
            "{format}: {report:?}"
        );
        assert_eq!(read(&path).samples() as u64, report.samples, "{format}");
    }
}

#[test]
fn events_of_a_running_bus_are_in_the_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("it.csv");
    let bench = bench();
    let recorder = bench.record(&path, |trouble| panic!("{trouble}"));
    bench.plant.power_cycle(0).expect("it runs");
    let until = Moment::now() + PATIENCE;
    let kinds = || {
        let table = read(&path);
        let marks = table.curves.into_iter().flat_map(|curve| curve.marks);
        marks.map(|mark| mark.kind).collect::<Vec<_>>()
    };
    while !kinds().ends_with(&["power_off".to_owned(), "power_on".to_owned()]) {
        assert!(Moment::now() < until, "{:?}", kinds());
        std::thread::sleep(Time::from_millis(20));
    }
    drop(recorder);
}

#[test]
fn a_disk_that_takes_nothing_delays_no_answer_and_what_is_lost_is_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("it.csv");
    rustix::fs::mknodat(
        rustix::fs::CWD,
        &path,
        rustix::fs::FileType::Fifo,
        rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR,
        0,
    )
    .expect("a pipe");
    // Somebody holds it open, and reads nothing until the end.
    let mut reader = fs::File::options().read(true).write(true).open(&path).expect("a pipe");
    let mut bench = bench();
    let settings = Settings { every: Duration::from_micros(500), is_virtual: false };
    let mut recorder = Recorder::start(&path, settings, |trouble| panic!("{trouble}")).expect("a recorder");
    recorder.attach(&bench.plant.handle()).expect("it runs");
    // The pipe holds 64 KiB, which is less than 1000 rows.
    let begun = Moment::now();
    while begun.elapsed() < Time::from_secs(2) {
        assert_eq!(bench.status(), [0x10, 2, 5, 0, 7, 0x16]);
        std::thread::sleep(Time::from_millis(1));
    }
    let report = recorder.finish();
    let error = report.error.expect("it is not whole").to_string();
    assert_eq!(error, "it took nothing for 5 s");
    assert!(report.missing > 500, "{}", report.missing);
    assert_eq!(bench.status(), [0x10, 2, 5, 0, 7, 0x16]);
    let mut some = [0; 12];
    reader.read_exact(&mut some).expect("what was written");
    assert_eq!(&some, b"time_ns,enco");
}

#[test]
fn a_file_that_cannot_be_written_is_told_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("full.csv");
    std::os::unix::fs::symlink("/dev/full", &path).expect("a link");
    let settings = Settings { every: EVERY, is_virtual: false };
    // The first line is refused already.
    let error = Recorder::start(&path, settings, |_| {}).expect_err("there is no room");
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
}

#[test]
fn a_ring_has_the_last_samples_in_memory() {
    let bench = bench();
    let ring = Ring::new(&bench.plant.handle(), Duration::from_millis(2), Duration::from_millis(100))
        .expect("it runs");
    std::thread::sleep(Time::from_millis(300));
    let (rows, until) = ring.since(Instant::ZERO).expect("it runs");
    // 100 ms in steps of 2 ms, both ends included.
    assert_eq!(rows.len(), 51);
    assert!(rows.windows(2).all(|pair| pair[1].time_ns - pair[0].time_ns == 2_000_000));
    assert!(until.as_nanos() - rows[50].time_ns < 2_000_000, "the newest is at most one step old");
    let (none, _) = ring.since(Instant::from_nanos(rows[50].time_ns)).expect("it runs");
    assert!(none.iter().all(|row| row.time_ns > rows[50].time_ns));
}

#[test]
fn names_say_what_is_written() {
    let told = |name: &str| Format::of(Path::new(name)).map_err(|error| error.to_string());
    assert_eq!(told("a.CSV"), Ok(Format::Csv));
    assert_eq!(
        told("a.txt"),
        Err("a.txt does not say what to write: end it with .parquet or .csv".to_owned())
    );
    if cfg!(feature = "parquet") {
        assert_eq!(told("a.parquet"), Ok(Format::Parquet));
    } else {
        assert!(told("a.parquet").expect_err("none").contains("end the name with .csv"));
    }
}
