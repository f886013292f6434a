//! Who does not read, and the end while he does not.

use std::time::{Duration, Instant};

use serde_json::Value;

use crate::client::{Stream, site};

/// Exchanges of status for so long; how many.
fn ask_for(master: &mut master::LightMaster<master::Wire>, span: Duration) -> u32 {
    let begun = Instant::now();
    let mut count = 0;
    while begun.elapsed() < span {
        assert!(master.status(5).expect("a bus").is_some(), "it answers");
        count += 1;
    }
    count
}

#[test]
fn a_stream_that_does_not_read_loses_telegrams_and_delays_nobody() {
    let mut site = site();
    let mut master = site.master();
    let alone = ask_for(&mut master, Duration::from_secs(1));
    let mut slow = site.stream("/api/stream");
    let mut reader = site.stream("/api/stream");
    let reading = std::thread::spawn(move || {
        let mut ledger = Ledger::default();
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(4) {
            ledger.note(&reader.until("telegrams", |_| true));
        }
        ledger
    });
    // So many more than its buffers hold: it is behind by more than the batches that wait for it.
    let watched = ask_for(&mut master, Duration::from_millis(4_500));
    assert!(
        f64::from(watched) / 4.5 > f64::from(alone) / 4.0,
        "{alone} in a second alone, {watched} in 4.5 s"
    );
    let read = reading.join().expect("it reads");
    assert!(read.count > 1_000, "{read:?}");
    // Now the slow one reads on. What it lost is counted in the batch behind.
    let mut ledger = Ledger::default();
    let begun = Instant::now();
    while ledger.count < read.count && begun.elapsed() < Duration::from_secs(10) {
        master.status(5).expect("a bus");
        ledger.note(&slow.until("telegrams", |_| true));
    }
    assert!(ledger.lost > 1_000, "it has lost nothing: {ledger:?}");
}

/// What a reader knows of all telegrams.
#[derive(Debug, Default)]
struct Ledger {
    /// The number of the last one that was shown or counted.
    count: u64,
    /// How many were lost between batches.
    lost: u64,
}

impl Ledger {
    /// Fails if a telegram is neither shown nor counted.
    fn note(&mut self, batch: &Value) {
        let dropped = batch["dropped"].as_u64().expect("a number");
        let shown = batch["telegrams"].as_array().expect("a list");
        let numbers: Vec<u64> = shown.iter().map(|one| one["n"].as_u64().expect("a number")).collect();
        let before = numbers.first().map_or(self.count, |first| first - 1);
        if self.count > 0 {
            assert!(before >= self.count, "{before} comes after {}", self.count);
            assert!(before - self.count <= dropped, "{} are missing, {dropped} counted", before - self.count);
            self.lost += before - self.count;
            self.count += dropped + numbers.len() as u64;
        } else {
            self.count = before + dropped + numbers.len() as u64;
        }
        assert!(numbers.last().is_none_or(|last| *last <= self.count), "{numbers:?}, {}", self.count);
    }
}

#[test]
fn the_end_comes_within_a_second() {
    let mut site = site();
    let streams: Vec<Stream> = (0..4).map(|_| site.stream("/api/stream")).collect();
    let mut master = site.master();
    ask_for(&mut master, Duration::from_millis(500));
    let idle = std::net::TcpStream::connect(site.address).expect("it listens");
    let half = site.request("POST", "/api/commands").header("Content-Length", "100").open();
    let address = site.address;
    let took = site.end();
    assert!(took < Duration::from_secs(1), "{took:?}");
    assert!(std::net::TcpStream::connect(address).is_err(), "nobody listens any more");
    for mut stream in streams {
        while stream.next().is_some() {}
    }
    drop((idle, half));
}
