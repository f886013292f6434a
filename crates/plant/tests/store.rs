//! State files: what is kept in them, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};

use plant::{Store, StoreError};
use sch108bex::NonvolatileWrite;
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot};
use sch108bex::specification::Variant;
use tempfile::{TempDir, tempdir};

/// A record with this offset.
fn record(offset: i32) -> Record {
    Record { offset, ..Record::as_delivered(Variant::FULL) }
}

fn write(slot: Slot, sequence: u32, offset: i32) -> NonvolatileWrite {
    NonvolatileWrite { slot, octets: record(offset).encode(sequence) }
}

fn place() -> (TempDir, PathBuf) {
    let directory = tempdir().unwrap();
    let path = directory.path().join("memory");
    (directory, path)
}

fn open(path: &Path) -> Store {
    Store::open(path, Variant::FULL, false).unwrap()
}

/// The offset in force, and which slot was damaged.
fn loaded(store: &mut Store) -> (i32, Option<Slot>) {
    match store.load().unwrap() {
        Choice::Use { record, other_damaged, slot, .. } => {
            (record.offset, other_damaged.map(|_| slot.other()))
        }
        other => panic!("{other:?}"),
    }
}

fn names(directory: &TempDir) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(directory.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_new_file_is_as_delivered_in_both_slots() {
    let (_directory, path) = place();
    let mut store = open(&path);
    assert_eq!(loaded(&mut store), (0, None));
    let file = fs::read(&path).unwrap();
    assert_eq!(file.len(), 80);
    assert_eq!(file[..SLOT_OCTETS], file[SLOT_OCTETS..]);
    // `SC`, version 1, no flags, sequence number 0, no address.
    assert_eq!(file[..10], [b'S', b'C', 1, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn each_slot_has_its_place_and_the_newer_counts() {
    let (_directory, path) = place();
    let mut store = open(&path);
    let before = fs::read(&path).unwrap();
    let b = write(Slot::B, 1, 77);
    store.write(&b).unwrap();
    let file = fs::read(&path).unwrap();
    assert_eq!((&file[..40], &file[40..]), (&before[..40], &b.octets[..]));
    assert_eq!(loaded(&mut store), (77, None));
    let a = write(Slot::A, 2, -5);
    store.write(&a).unwrap();
    let file = fs::read(&path).unwrap();
    assert_eq!((&file[..40], &file[40..]), (&a.octets[..], &b.octets[..]));
    assert_eq!(loaded(&mut store), (-5, None));
    // Another program finds the same.
    store.sync().unwrap();
    drop(store);
    assert_eq!(loaded(&mut open(&path)), (-5, None));
}

#[test]
fn a_memory_that_forgets_keeps_as_long_as_it_lives() {
    let mut store = Store::forgetful();
    assert_eq!(store.load().unwrap(), Choice::AsDelivered);
    store.write(&write(Slot::A, 0, 1)).unwrap();
    store.write(&write(Slot::B, 1, 2)).unwrap();
    assert_eq!(loaded(&mut store), (2, None));
    store.write(&write(Slot::A, 2, 3)).unwrap();
    assert_eq!(loaded(&mut store), (3, None));
}

#[test]
fn every_single_wrong_octet_is_found() {
    let (_directory, path) = place();
    let mut store = open(&path);
    store.write(&write(Slot::B, 1, 20)).unwrap();
    store.write(&write(Slot::A, 2, 10)).unwrap();
    drop(store);
    let good = fs::read(&path).unwrap();
    for at in 0..80 {
        let mut file = good.clone();
        file[at] ^= 0x01;
        fs::write(&path, &file).unwrap();
        let due = if at < 40 { (20, Some(Slot::A)) } else { (10, Some(Slot::B)) };
        assert_eq!(loaded(&mut open(&path)), due, "octet {at}");
        assert_eq!(fs::read(&path).unwrap(), file, "reading changes nothing");
    }
}

#[test]
fn a_write_cut_short_leaves_the_record_before() {
    let (_directory, path) = place();
    let mut store = open(&path);
    store.write(&write(Slot::B, 1, 20)).unwrap();
    drop(store);
    let before = fs::read(&path).unwrap();
    let next = write(Slot::A, 2, 10).octets;
    for octets in 0..=40 {
        let mut file = before.clone();
        file[..octets].copy_from_slice(&next[..octets]);
        fs::write(&path, &file).unwrap();
        let (offset, _) = loaded(&mut open(&path));
        assert_eq!(offset, if octets == 40 { 10 } else { 20 }, "{octets} octets");
    }
}

#[test]
fn two_damaged_slots_are_an_error_that_names_file_and_remedy() {
    let (_directory, path) = place();
    fs::write(&path, [0x55; 80]).unwrap();
    let mut store = open(&path);
    let error = store.load().unwrap_err();
    assert!(matches!(error, StoreError::Damaged { .. }));
    let text = error.to_string();
    assert!(text.contains(path.to_str().unwrap()) && text.contains("--reset-state"), "{text}");
    assert_eq!(fs::read(&path).unwrap(), [0x55; 80]);
}

#[test]
fn another_size_is_an_error_and_the_file_stays() {
    let (_directory, path) = place();
    for size in [0, 1, 39, 40, 79, 81, 160] {
        fs::write(&path, vec![7; size]).unwrap();
        let error = Store::open(&path, Variant::FULL, false).unwrap_err();
        assert!(matches!(error, StoreError::Size { octets, .. } if octets == size as u64), "{error}");
        assert_eq!(fs::read(&path).unwrap(), vec![7; size]);
    }
}

#[test]
fn a_file_is_for_one_at_a_time() {
    let (directory, path) = place();
    let first = open(&path);
    for reset in [false, true] {
        let error = Store::open(&path, Variant::FULL, reset).unwrap_err();
        assert!(matches!(error, StoreError::InUse { .. }), "{error}");
    }
    assert_eq!(names(&directory), ["memory"]);
    drop(first);
    open(&path);
}

#[test]
fn a_reset_keeps_every_old_file() {
    let (directory, path) = place();
    for (round, names_due) in [
        (1, &["memory", "memory.bad"][..]),
        (2, &["memory", "memory.bad", "memory.bad2"]),
        (3, &["memory", "memory.bad", "memory.bad2", "memory.bad3"]),
    ] {
        fs::write(&path, [round; 80]).unwrap();
        let mut store = Store::open(&path, Variant::FULL, true).unwrap();
        assert_eq!(loaded(&mut store), (0, None));
        assert_eq!(names(&directory), names_due);
        // It is the new file that is locked.
        assert!(matches!(Store::open(&path, Variant::FULL, false), Err(StoreError::InUse { .. })));
    }
    for (name, octet) in [("memory.bad", 1), ("memory.bad2", 2), ("memory.bad3", 3)] {
        assert_eq!(fs::read(directory.path().join(name)).unwrap(), [octet; 80]);
    }
}

#[test]
fn what_is_no_file_is_refused() {
    let directory = tempdir().unwrap();
    for reset in [false, true] {
        let error = Store::open(Path::new("/dev/null"), Variant::FULL, reset).unwrap_err();
        assert!(matches!(error, StoreError::NoFile { .. }), "{error}");
        for path in [directory.path().to_owned(), directory.path().join("no/such/place")] {
            let error = Store::open(&path, Variant::FULL, reset).unwrap_err();
            assert!(matches!(error, StoreError::Io { step: "open" | "make", .. }), "{error}");
            assert!(error.to_string().contains("name a file in a directory that exists"), "{error}");
        }
    }
}
