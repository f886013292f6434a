//! Master x slave x line, every way there is: the line loses telegrams, doubles the last one and
//! damages up to three bits of one; the master retries before it goes on.
//!
//! A way is what the line does to each of the first telegrams. All ways with up to three faults
//! anywhere, and all ways of shorter dialogues with any number of faults, are walked from power-on
//! and from data exchange, over the real slave and the real encoder. On each:
//!
//! - no outputs are taken twice, or out of order, or without having been sent;
//! - no preset is executed twice or without being asked, and none that was acknowledged is missing;
//! - when the faults are over, data exchange comes back.

mod master;
mod slaves;

use profibus_dp::time::{BitTimes, Duration, Instant};

use master::{Habits, Master};
use slaves::{RATE, Subject};

/// What the line does to a request and its reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    Fine,
    RequestLost,
    /// One bit of a character: its parity is wrong.
    OneBit,
    /// Two bits of one character: its parity is right.
    TwoBits,
    /// Two bits of one character and one of another.
    ThreeBits,
    /// The reply is lost, or so damaged that the master drops it.
    ReplyLost,
    /// The request comes twice, without a pause.
    DoubledAtOnce,
    /// The request comes once more when the reply is over.
    DoubledLater,
    /// The same, and the reply was lost.
    DoubledAndReplyLost,
}

use Fate::{
    DoubledAndReplyLost, DoubledAtOnce, DoubledLater, Fine, OneBit, ReplyLost, RequestLost, ThreeBits,
    TwoBits,
};

const FAULTS: [Fate; 8] =
    [RequestLost, OneBit, TwoBits, ThreeBits, ReplyLost, DoubledAtOnce, DoubledLater, DoubledAndReplyLost];

/// After the last fault data exchange has to be back within so many telegrams.
const PATIENCE: u32 = 16;
/// Telegrams from power-on to the second exchange, on a fine line.
const START_UP: usize = 6;

struct Line<S> {
    slave: S,
    now: Instant,
}

impl<S: Subject> Line<S> {
    fn pass(&mut self, bits: u32) {
        self.now += RATE.duration(BitTimes(bits));
    }

    /// Characters; `damage` says which of them come how.
    fn send(&mut self, octets: &[u8], damage: &[(usize, u8)]) -> Option<Vec<u8>> {
        let mut window = None;
        for (at, octet) in octets.iter().enumerate() {
            self.pass(11);
            self.slave.keep_up(self.now);
            let flip = damage.iter().find(|(damaged, _)| *damaged == at).map_or(0, |(_, flip)| *flip);
            window = if flip.count_ones() % 2 == 1 {
                self.slave.line_error(self.now);
                None
            } else {
                self.slave.receive(self.now, &[octet ^ flip])
            };
        }
        self.now = window?.not_before;
        let reply = self.slave.transmit(self.now).map(<[u8]>::to_vec);
        self.pass(11 * reply.as_ref().map_or(0, |reply| u32::try_from(reply.len()).expect("short")));
        reply
    }

    fn turn(&mut self, master: &mut Master, fate: Fate, cycle: Duration) {
        self.now += cycle;
        self.slave.keep_up(self.now);
        let request = master.request();
        let in_the_middle = request.len() / 2;
        let mut reply = match fate {
            RequestLost => None,
            OneBit => self.send(&request, &[(in_the_middle, 0x04)]),
            TwoBits => self.send(&request, &[(in_the_middle, 0x81)]),
            ThreeBits => self.send(&request, &[(in_the_middle, 0x81), (in_the_middle + 1, 0x01)]),
            DoubledAtOnce => self.send(&[&request[..], &request].concat(), &[]),
            _ => self.send(&request, &[]),
        };
        if matches!(fate, DoubledLater | DoubledAndReplyLost) {
            self.pass(40);
            // Its reply meets the end of a slot in which nobody listens.
            self.send(&request, &[]);
        }
        if matches!(fate, ReplyLost | DoubledAndReplyLost) {
            reply = None;
        }
        self.pass(if reply.is_some() { 40 } else { 240 });
        master.hear(reply.as_deref());
    }
}

fn walk<S: Subject>(make: fn(Instant) -> S, habits: Habits, watchdog: bool, fine: usize, way: &[Fate]) {
    let now = Instant::from_millis(1_000);
    let mut line = Line { slave: make(now), now };
    let mut master = Master::new(habits, S::facts(watchdog));
    let cycle = Duration::from_millis(if watchdog { 8 } else { 1 });
    for fate in std::iter::repeat_n(&Fine, fine).chain(way) {
        line.turn(&mut master, *fate, cycle);
    }
    master.in_a_row = 0;
    let mut telegrams = 0;
    while master.in_a_row < 3 {
        assert!(telegrams < PATIENCE, "no data exchange after {way:?} ({habits:?}, watchdog {watchdog})");
        line.turn(&mut master, Fine, cycle);
        telegrams += 1;
    }
    let done = line.slave.done();
    let what = || format!("{done:?} of {} sent, {way:?} ({habits:?}, watchdog {watchdog})", master.sent);
    assert!(done.windows(2).all(|pair| pair[0] < pair[1]), "twice, or out of order: {}", what());
    assert!(done.iter().all(|serial| (1..=master.sent).contains(serial)), "never sent: {}", what());
    for serial in S::due(&master.answered) {
        assert!(done.contains(&serial), "{serial} was acknowledged, but not done: {}", what());
    }
}

const HABITS: [Habits; 3] = [
    Habits { resets_count: true, renews_outputs: false },
    Habits { resets_count: false, renews_outputs: false },
    Habits { resets_count: true, renews_outputs: true },
];

/// All ways of `length` telegrams with at most `faults` faults.
fn ways(length: usize, faults: usize, mut visit: impl FnMut(&[Fate])) -> u64 {
    fn go(way: &mut Vec<Fate>, length: usize, faults: usize, visit: &mut impl FnMut(&[Fate])) -> u64 {
        // Fine telegrams at the end come anyway.
        let mut count = 0;
        if way.last() != Some(&Fine) {
            visit(way);
            count += 1;
        }
        if way.len() < length {
            way.push(Fine);
            count += go(way, length, faults, visit);
            way.pop();
            if faults > 0 {
                for fate in FAULTS {
                    way.push(fate);
                    count += go(way, length, faults - 1, visit);
                    way.pop();
                }
            }
        }
        count
    }
    go(&mut Vec::new(), length, faults, &mut visit)
}

fn explore<S: Subject>(make: fn(Instant) -> S) {
    let mut count = 0;
    for (habits, watchdog) in HABITS.into_iter().flat_map(|habits| [(habits, false), (habits, true)]) {
        for fine in [0, START_UP] {
            let mut visit = |way: &[Fate]| walk(make, habits, watchdog, fine, way);
            count += ways(10, 3, &mut visit);
            count += ways(4, 4, &mut visit);
        }
    }
    println!("{count} ways");
}

#[test]
fn outputs_are_taken_once_and_data_exchange_comes_back_on_every_way() {
    explore(slaves::noting);
}

#[test]
fn presets_are_executed_once_and_only_if_asked_on_every_way() {
    explore(slaves::encoder);
}

#[test]
fn a_line_that_is_dead_for_long_is_survived() {
    for habits in HABITS {
        for (fault, length) in FAULTS.into_iter().flat_map(|fault| (1..40).map(move |length| (fault, length)))
        {
            for watchdog in [false, true] {
                walk(slaves::encoder, habits, watchdog, START_UP, &vec![fault; length]);
                walk(slaves::noting, habits, watchdog, 0, &vec![fault; length]);
            }
        }
    }
}
