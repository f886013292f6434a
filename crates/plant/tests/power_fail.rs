//! Encoders whose program or whose power ends in the middle: what their state files hold then.

use std::fs;
use std::path::Path;

use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::fdl::Station;
use profibus_dp::time::{Duration, Instant};
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::nonvolatile::{Choice, Record, Slot};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Identity, NonvolatileWrite};
use tempfile::tempdir;

const FIVE_MINUTES: Duration = Duration::from_secs(300);

fn station(state: &Path) -> EncoderStation {
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(11),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches::ON,
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::open(state, Variant::FULL, false).unwrap(),
        reporter: Reporter::new("it", None),
    };
    EncoderStation::new(Instant::ZERO, setup).unwrap()
}

/// Polls at every deadline, as a segment does.
fn run(station: &mut EncoderStation, span: Duration) -> Instant {
    let end = Instant::ZERO + span;
    while let Some(due) = station.next_deadline().filter(|&due| due < end) {
        station.poll(due);
    }
    station.poll(end);
    end
}

fn tenths(station: &mut EncoderStation) -> u32 {
    station.snapshot(Instant::ZERO).device.expect("power").operating_time.tenths()
}

// 500 minutes are 8.3 h: not even one tenth of an hour may get lost between the runs.
#[test]
fn a_hundred_runs_of_five_minutes_that_end_orderly_add_up() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    for _ in 0..100 {
        let mut station = station(&state);
        let end = run(&mut station, FIVE_MINUTES);
        station.shut_down(end);
    }
    let shown = tenths(&mut station(&state));
    assert_eq!(shown, 83, "tenths of an hour");
}

// Each of them would lose all its time if only every sixth minute counted; a cut loses six at most.
#[test]
fn a_cut_loses_six_minutes_at_most_and_what_was_counted_stays() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut counted = 0;
    for minutes in [5, 6, 7, 11, 12, 13, 59, 60] {
        let mut cut = station(&state);
        run(&mut cut, Duration::from_secs(minutes * 60));
        drop(cut);
        let shown = tenths(&mut station(&state));
        // A tenth of an hour is six minutes.
        let ran = u32::try_from(minutes).unwrap() / 6;
        assert!(shown >= counted + ran.saturating_sub(1) && shown <= counted + ran, "{minutes}: {shown}");
        counted = shown;
    }
}

/// What is in the directory, but for the state file.
fn left_over(directory: &Path) -> usize {
    let names = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name());
    names.filter(|name| name != "memory").count()
}

// A new file comes to be under another name: until it is whole, there is none.
#[test]
fn a_cut_while_a_new_file_is_made_leaves_the_state_at_delivery() {
    let slot = Record::as_delivered(Variant::FULL).encode(0);
    let whole = [slot, slot].concat();
    for octets in 0..=whole.len() {
        let directory = tempdir().unwrap();
        let state = directory.path().join("memory");
        fs::write(directory.path().join("memory.new"), &whole[..octets]).unwrap();
        let mut store = Store::open(&state, Variant::FULL, false).unwrap();
        let Choice::Use { record, other_damaged: None, .. } = store.load().unwrap() else {
            panic!("{octets} octets: no good record")
        };
        assert_eq!(record, Record::as_delivered(Variant::FULL), "{octets} octets");
        assert_eq!(fs::read(&state).unwrap(), whole, "{octets} octets");
        assert_eq!(left_over(directory.path()), 0, "{octets} octets");
    }
}

// Between the new name and the end of the old one both names are there.
#[test]
fn a_cut_between_the_names_of_a_new_file_leaves_a_good_one() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    drop(Store::open(&state, Variant::FULL, false).unwrap());
    fs::hard_link(&state, directory.path().join("memory.new")).unwrap();
    let mut store = Store::open(&state, Variant::FULL, false).unwrap();
    assert!(matches!(store.load(), Ok(Choice::Use { .. })));
}

// Every octet of every write of a file, over every pair of slots that writes leave.
#[test]
fn a_program_that_ends_at_any_octet_of_any_write_leaves_the_value_before_or_the_new_one() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut store = Store::open(&state, Variant::FULL, false).unwrap();
    let mut before = 0;
    for sequence in 1..=4_i32 {
        let offset = sequence * 1_000 + 77;
        let slot = if sequence % 2 == 0 { Slot::A } else { Slot::B };
        let record = Record { offset, ..Record::as_delivered(Variant::FULL) };
        let write = NonvolatileWrite { slot, octets: record.encode(sequence.unsigned_abs()) };
        let earlier = fs::read(&state).unwrap();
        store.write(&write).unwrap();
        let whole = fs::read(&state).unwrap();
        for done in 0..=80 {
            let file = [&whole[..done], &earlier[done..]].concat();
            fs::write(&state, &file).unwrap();
            let Choice::Use { record, .. } = store.load().unwrap() else { panic!("a record") };
            let due = if file == whole { offset } else { before };
            assert_eq!(record.offset, due, "write {sequence}, {done} octets");
        }
        before = offset;
    }
}
