//! Encoders in their world: power, shaft, memory, and the thread they run on.

use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::{MemoryEnd, pair};
use bus::{End, Event, Settings, Written};
use plant::{EncoderSetup, EncoderStation, Plant, PlantError, Rate, Report, Reporter};
use plant::{SegmentSetup, Shaft, Snapshot, Store, What, World};
use profibus_dp::fdl::Station;
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::telegram::{Parsed, parse};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, choose};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

fn setup(switches: u8, shaft: Shaft) -> (EncoderSetup, Receiver<Report>) {
    let (to, reports) = mpsc::channel();
    let identity = Identity {
        variant: Variant::FULL,
        ident_number: PLACEHOLDER_IDENT,
        serial_number: SerialNumber::DEFAULT,
        switches: RotarySwitches(switches),
    };
    let setup = EncoderSetup {
        identity,
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches::ON,
        shaft,
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("it", Some(to)),
    };
    (setup, reports)
}

fn world(change: impl FnOnce(&mut Measurement)) -> World {
    let mut measurement = World::default().0;
    change(&mut measurement);
    World(measurement)
}

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn told(reports: &Receiver<Report>) -> Vec<String> {
    reports.try_iter().map(|report| format!("{}: {}", report.who, report.what)).collect()
}

#[test]
fn power_comes_and_goes_with_the_supply() {
    let (setup, reports) = setup(0x0B, Shaft::still(0));
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    assert_eq!(station.address(), Some(11));
    assert_eq!(told(&reports)[0], "it: power on, station address 11");
    // 6.0 V and above it runs, with an alarm.
    station.set_world(at(10), world(|world| world.supply_mv = 6_000)).unwrap();
    let device = station.snapshot(at(10)).device.expect("power");
    assert_eq!(device.alarms, Alarms::SUPPLY_VOLTAGE);
    for (millis, supply_mv) in [(20, 5_999), (40, 0), (60, -24_000)] {
        station.set_world(at(millis), world(|world| world.supply_mv = supply_mv)).unwrap();
        assert_eq!(station.address(), None, "{supply_mv} mV");
        assert_eq!(station.snapshot(at(millis)).device, None);
        assert_eq!(station.next_deadline(), None);
        station.set_world(at(millis + 10), World::default()).unwrap();
        assert_eq!(station.address(), Some(11));
    }
    let told = told(&reports);
    assert_eq!(told.iter().filter(|line| *line == "it: power off").count(), 3);
    assert_eq!(told.iter().filter(|line| *line == "it: power on, station address 11").count(), 3);
}

// A segment in virtual time takes the long way for every telegram while a station hears only faults.
#[test]
fn without_power_it_is_no_station_that_listens_at_another_rate() {
    for rate in [Rate::Fixed(Baudrate::B12000000), Rate::Search(Baudrate::B12000000)] {
        let (mut setup, _reports) = setup(0x0B, Shaft::still(0));
        setup.rate = rate;
        setup.world = world(|world| world.supply_mv = 0);
        let station = EncoderStation::new(at(0), setup).unwrap();
        assert_eq!((station.address(), station.listening_rate()), (None, Baudrate::B12000000));
    }
}

#[test]
fn without_enough_supply_at_the_start_it_is_off() {
    let (mut setup, reports) = setup(0x0B, Shaft::still(0));
    setup.world = world(|world| world.supply_mv = 5_000);
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    assert_eq!((station.address(), station.snapshot(at(1)).device), (None, None));
    assert!(told(&reports).is_empty());
}

#[test]
fn switches_count_at_the_next_power_on() {
    let (setup, _reports) = setup(0x0B, Shaft::still(0));
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    station.set_switches(RotarySwitches(0x0C));
    assert_eq!(station.address(), Some(11));
    station.power_cycle(at(10)).unwrap();
    assert_eq!(station.address(), Some(12));
    station.set_switches(RotarySwitches(0x00));
    station.power_cycle(at(20)).unwrap();
    assert_eq!(station.address(), None);
}

#[test]
fn a_snapshot_shows_the_latch_of_its_moment() {
    // 60 RPM from 1000: a latch every 500 us, 32.768 counts apart.
    let (setup, _reports) = setup(0x0B, Shaft::constant(60.0, 1_000, at(100)));
    let mut station = EncoderStation::new(at(100), setup).unwrap();
    for (micros, position) in [(0, 1_000), (499, 1_000), (500, 1_032), (999, 1_032), (1_000, 1_065)] {
        let now = at(100) + Duration::from_micros(micros);
        let device = station.snapshot(now).device.expect("power");
        assert_eq!(device.physical_position, position, "{micros} us");
        assert_eq!(i64::from(device.position), position, "{micros} us");
    }
}

#[test]
fn a_shaft_that_changes_is_latched_before_it_does() {
    let (setup, _reports) = setup(0x0B, Shaft::still(10));
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    // Between the latches at 1.0 and 1.5 ms.
    let now = Instant::from_nanos(1_200_000);
    station.set_shaft(now, Shaft::still(20));
    assert_eq!(station.snapshot(now).device.unwrap().physical_position, 10);
    let now = Instant::from_nanos(1_500_000);
    assert_eq!(station.snapshot(now).device.unwrap().physical_position, 20);
}

#[test]
fn the_operating_time_survives_an_orderly_end_and_a_cut_loses_what_was_not_written() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("memory");
    let run = |orderly: bool| {
        let (mut setup, _reports) = setup(0x0B, Shaft::still(0));
        setup.store = Store::open(&path, Variant::FULL, false).unwrap();
        let mut station = EncoderStation::new(at(0), setup).unwrap();
        let begun = station.snapshot(at(0)).device.unwrap().operating_time.tenths();
        // Just below the 6 minutes after which it is written anyway.
        station.poll(at(359_999));
        if orderly {
            station.shut_down(at(359_999));
        }
        begun
    };
    // 0.1 h are 360000 ms.
    assert_eq!(run(true), 0);
    assert_eq!(run(true), 0, "359999 ms are no tenth of an hour yet");
    assert_eq!(run(false), 1);
    assert_eq!(run(false), 1, "a cut loses what was not written");
}

#[test]
fn the_operating_time_is_written_every_six_minutes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("memory");
    let (mut setup, _reports) = setup(0x0B, Shaft::still(0));
    setup.store = Store::open(&path, Variant::FULL, false).unwrap();
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    let before = std::fs::read(&path).unwrap();
    station.poll(at(359_999));
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert!(station.next_deadline().is_some_and(|due| due <= at(360_000)));
    station.poll(at(360_000));
    assert_ne!(std::fs::read(&path).unwrap(), before);
}

/// Hands a request to a station and takes its reply, with nothing in between and nothing after.
fn ask(station: &mut EncoderStation, now: Instant, request: &[u8]) -> Vec<u8> {
    let Parsed::Complete(telegram, _) = parse(request) else { panic!("{request:02X?} is no telegram") };
    let window = station.indicate(now, &telegram).expect("an answer");
    station.transmit(window.not_before).expect("an answer").to_vec()
}

/// The record in force that another start would find in a state file.
fn stored(path: &std::path::Path) -> Record {
    let file = std::fs::read(path).unwrap();
    let (a, b) = file.split_at(SLOT_OCTETS);
    match choose(Record::decode(a), Record::decode(b)) {
        Choice::Use { record, .. } => record,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_new_address_is_stored_before_the_master_can_know_of_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("memory");
    let (mut setup, _reports) = setup(0x7E, Shaft::still(0));
    setup.store = Store::open(&path, Variant::FULL, false).unwrap();
    setup.rate = Rate::Fixed(Baudrate::B500000);
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    // Set_Slave_Add from 126 to 11: DP slave reference, section 3.5, with this ident number.
    let request = [0x68, 9, 9, 0x68, 0xFE, 0x82, 0x6D, 0x37, 0x3E, 0x0B, 0x10, 0x8B, 0x00, 0x08, 0x16];
    assert_eq!(ask(&mut station, at(1), &request), [0xE5]);
    assert_eq!(stored(&path).stored_address, Some(11));
}

#[test]
fn a_preset_is_stored_before_the_master_can_know_of_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("memory");
    let (mut setup, _reports) = setup(0x0B, Shaft::still(100));
    setup.store = Store::open(&path, Variant::FULL, false).unwrap();
    setup.rate = Rate::Fixed(Baudrate::B500000);
    let mut station = EncoderStation::new(at(0), setup).unwrap();
    // Set_Prm of class 2 without watchdog, Chk_Cfg F1, Data_Exchange: DP slave reference, section 3.5.
    #[rustfmt::skip]
    let requests: [&[u8]; 3] = [
        &[0x68, 0x1E, 0x1E, 0x68, 0x8B, 0x82, 0x6D, 0x3D, 0x3E, 0x80, 0x01, 0x01, 0x0B, 0x10, 0x8B, 0x00,
          0x00, 0x02, 0, 1, 0, 0, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xA0, 0x16],
        &[0x68, 0x06, 0x06, 0x68, 0x8B, 0x82, 0x5D, 0x3E, 0x3E, 0xF1, 0xD7, 0x16],
        &[0x68, 0x07, 0x07, 0x68, 0x0B, 0x02, 0x7D, 0x00, 0x00, 0x00, 0x00, 0x8A, 0x16],
    ];
    for (millis, request) in (1..).zip(requests) {
        ask(&mut station, at(millis), request);
    }
    // A preset to 4096: the position was 100.
    let request = [0x68, 0x07, 0x07, 0x68, 0x0B, 0x02, 0x5D, 0x80, 0x00, 0x10, 0x00, 0xFA, 0x16];
    let answer = [0x68, 0x07, 0x07, 0x68, 0x02, 0x0B, 0x08, 0x00, 0x00, 0x00, 0x64, 0x79, 0x16];
    assert_eq!(ask(&mut station, at(10), &request), answer);
    assert_eq!(stored(&path).offset, 4_096 - 100);
}

/// A plant with encoders at 11, 12, ... on one segment, and the master's side of it.
fn plant(shafts: &[Shaft]) -> (Plant, MemoryEnd, Receiver<Report>) {
    let (end, master) = pair();
    let (to, reports) = mpsc::channel();
    let mut plant = Plant::new();
    let encoders = (11..).zip(shafts).map(|(address, shaft)| {
        let (mut setup, _) = setup(address, shaft.clone());
        setup.reporter = Reporter::new(&format!("at {address}"), Some(to.clone()));
        setup
    });
    let segment = SegmentSetup {
        name: "line".to_owned(),
        end: Box::new(end),
        settings: Settings::default(),
        encoders: encoders.collect(),
    };
    plant.add(segment, to.clone()).unwrap();
    (plant, master, reports)
}

/// Asks for the FDL status; what comes back.
fn status(master: &mut MemoryEnd, address: u8) -> Vec<u8> {
    let request = [0x10, address, 2, 0x49, address.wrapping_add(2 + 0x49), 0x16];
    let mut buffer = [0; 16];
    for _ in 0..5 {
        assert_eq!(master.write(&request).unwrap(), Written::All);
        let until = Moment::now() + Time::from_millis(300);
        while Moment::now() < until {
            if let Event::Octets(count) = master.wait(Some(Duration::from_millis(300)), &mut buffer).unwrap()
            {
                return buffer[..count].to_vec();
            }
        }
    }
    Vec::new()
}

#[test]
fn a_plant_answers_shows_and_obeys() {
    let (plant, mut master, _reports) = plant(&[Shaft::still(5), Shaft::still(6)]);
    assert_eq!(status(&mut master, 11), [0x10, 0x02, 0x0B, 0x00, 0x0D, 0x16]);
    assert_eq!(status(&mut master, 12), [0x10, 0x02, 0x0C, 0x00, 0x0E, 0x16]);
    let position = |snapshot: &Snapshot| snapshot.device.unwrap().physical_position;
    let snapshots = plant.snapshots().unwrap();
    assert_eq!(snapshots.iter().map(position).collect::<Vec<_>>(), [5, 6]);
    assert_eq!(snapshots[1].name, "at 12");

    plant.set_shaft(1, Shaft::still(7)).unwrap();
    plant.set_world(0, world(|world| world.battery = Battery::Low)).unwrap();
    std::thread::sleep(Time::from_millis(2));
    let snapshots = plant.snapshots().unwrap();
    assert_eq!(snapshots.iter().map(position).collect::<Vec<_>>(), [5, 7]);
    assert_eq!(snapshots[0].device.unwrap().warnings, Warnings::BATTERY_CHARGE);
    assert_eq!(snapshots[1].device.unwrap().warnings, Warnings::empty());

    plant.set_world(0, world(|world| world.supply_mv = 0)).unwrap();
    assert_eq!(plant.snapshots().unwrap()[0].device, None);
    assert_eq!(status(&mut master, 12).len(), 6);
    plant.stop().unwrap();
}

#[test]
fn shafts_stand_until_they_are_started() {
    let (plant, _master, _reports) = plant(&[Shaft::constant(60_000.0, 100, Instant::MAX)]);
    let position = || plant.snapshots().unwrap()[0].device.unwrap().physical_position;
    std::thread::sleep(Time::from_millis(5));
    assert_eq!(position(), 100);
    plant.start_shafts().unwrap();
    std::thread::sleep(Time::from_millis(5));
    // 1000 turns a second: 65536 counts in a millisecond.
    assert!(position() >= 100 + 4 * 65_536, "{}", position());
}

#[test]
fn what_is_not_there_is_an_error() {
    let (plant, _master, _reports) = plant(&[Shaft::still(0)]);
    for result in [
        plant.set_shaft(1, Shaft::still(0)),
        plant.set_world(1, World::default()),
        plant.power_cycle(usize::MAX),
    ] {
        assert!(matches!(result, Err(PlantError::NoEncoder(_))), "{result:?}");
    }
    plant.power_cycle(0).unwrap();
}

#[test]
fn a_plant_that_is_dropped_ends_its_threads() {
    let (plant, mut master, reports) = plant(&[Shaft::still(0)]);
    assert_eq!(status(&mut master, 11).len(), 6);
    drop(plant);
    // The thread's reporters are gone, so it is.
    while reports.try_recv().is_ok() {}
    assert!(matches!(reports.try_recv(), Err(TryRecvError::Disconnected)));
}

#[test]
fn a_report_says_who_and_what() {
    let (mut setup, reports) = setup(0x7E, Shaft::still(0));
    setup.reporter = Reporter::new("somebody", None);
    let mut silent = EncoderStation::new(at(0), setup).unwrap();
    silent.power_cycle(at(1)).unwrap();
    assert!(told(&reports).is_empty(), "nobody was to be told");
    for (what, text) in [
        (What::PowerOn(Some(11)), "power on, station address 11"),
        (What::PowerOn(None), "power on, but the switches keep it off the bus"),
        (What::MasterCame(Some(Baudrate::B9600)), "a master has opened the bus at 9.6 kbit/s"),
        (What::MasterLeft, "the master has closed the bus"),
    ] {
        assert_eq!(what.to_string(), text);
    }
}
