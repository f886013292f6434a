//! What a tap sees, in real and in virtual time.

mod common;

use std::sync::{Arc, Mutex};
use std::thread;

use bus::end::Written;
use bus::memory::pair;
use bus::{
    Commands, Control, End, FaultCounters, Handler, ReplyFault, RequestFault, Segment, Settings, Sight,
    VirtualSegment, WallClock, WireTap,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, wait_until};
use profibus_dp::time::{Baudrate, Duration, Instant};

/// What was seen, in words.
#[derive(Debug, Clone, Default)]
struct Notes(Arc<Mutex<Vec<(Instant, String)>>>);

impl WireTap for Notes {
    fn saw(&mut self, at: Instant, sight: Sight<'_>) {
        let told = |faults: FaultCounters| {
            if faults == FaultCounters::default() { String::new() } else { " with faults".to_owned() }
        };
        let words = match sight {
            Sight::Request { octets, faults } => format!("request {octets:02X?}{}", told(faults)),
            Sight::Reply { octets, faults, collision, written } => {
                let lost = if written == Written::All { "" } else { " lost" };
                let both = if collision { " of two" } else { "" };
                format!("reply {octets:02X?}{}{both}{lost}", told(faults))
            }
            other => format!("{other:?}"),
        };
        self.0.lock().unwrap().push((at, words));
    }
}

impl Notes {
    fn take(&self) -> Vec<(Instant, String)> {
        std::mem::take(&mut self.0.lock().unwrap())
    }

    fn words(&self) -> Vec<String> {
        self.take().into_iter().map(|(_, words)| words).collect()
    }
}

fn request() -> String {
    format!("request {STATUS_11:02X?}")
}

fn reply() -> String {
    format!("reply {STATUS_11_ANSWER:02X?}")
}

fn tapped() -> (VirtualSegment<Listener>, Notes) {
    let mut segment = VirtualSegment::new(Instant::from_millis(10), Baudrate::B500000);
    let notes = Notes::default();
    segment.add(Listener::at(11));
    segment.set_tap(Some(Box::new(notes.clone())));
    (segment, notes)
}

// At 500 kbit/s a bit is 2 us: 6 octets are 132 us, and min T_SDR of 11 bit times is 22 us.
#[test]
fn in_virtual_time_every_telegram_has_the_time_of_its_first_edge() {
    let (mut segment, notes) = tapped();
    segment.send(&STATUS_11);
    let seen = notes.take();
    assert_eq!(seen.iter().map(|(_, words)| words.clone()).collect::<Vec<_>>(), [request(), reply()]);
    assert_eq!(seen[1].0.since(seen[0].0), Duration::from_micros(132 + 22));
    segment.set_tap(None);
    segment.send(&STATUS_11);
    assert_eq!(notes.take(), []);
}

#[test]
fn in_virtual_time_faults_are_seen_at_the_telegram_that_has_them() {
    let (mut segment, notes) = tapped();
    segment.faults_mut().fail_next_request(RequestFault::Corrupt { octet: 4, mask: 1 });
    segment.send(&STATUS_11);
    assert_eq!(notes.words(), ["request [10, 0B, 02, 49, 57, 16] with faults"]);
    segment.faults_mut().fail_next_request(RequestFault::Lose);
    segment.send(&STATUS_11);
    assert_eq!(notes.words(), [format!("{} with faults", request())]);
    segment.fail_next_reply(ReplyFault::Lose);
    segment.send(&STATUS_11);
    assert_eq!(notes.words(), [request(), format!("{} with faults lost", reply())]);
    segment.fail_next_reply(ReplyFault::Corrupt { octet: 3, mask: 0x80 });
    segment.send(&STATUS_11);
    assert_eq!(notes.words(), [request(), "reply [10, 02, 0B, 80, 0D, 16] with faults".to_owned()]);
    segment.send(&STATUS_11);
    assert_eq!(notes.words(), [request(), reply()]);
}

#[test]
fn two_stations_that_answer_at_once_are_seen_as_two() {
    let (mut segment, notes) = tapped();
    segment.add(Listener::at(11));
    segment.send(&STATUS_11);
    assert!(notes.words()[1].ends_with(" of two"));
}

struct Host;

impl Handler<Listener> for Host {
    type Command = ();

    fn command(&mut self, _: &mut Segment<Listener>, (): ()) -> std::ops::ControlFlow<()> {
        std::ops::ControlFlow::Continue(())
    }
}

/// Runs a segment with a tap while `master` does something at the other end.
fn in_real_time(
    station: Listener,
    settings: Settings,
    change: impl FnOnce(&mut Segment<Listener>),
    master: impl FnOnce(&mut bus::MemoryEnd, &Notes),
) {
    let (end, mut far) = pair();
    let mut segment = Segment::new(Box::new(end), WallClock::new(), settings);
    segment.add(station);
    change(&mut segment);
    let notes = Notes::default();
    segment.set_tap(Some(Box::new(notes.clone())));
    let (control, commands): (Control<()>, Commands<()>) = segment.control();
    let running = thread::spawn(move || segment.run(&commands, &mut Host));
    master(&mut far, &notes);
    control.stop();
    running.join().unwrap().unwrap();
}

fn wait_for(notes: &Notes, due: &str) {
    wait_until(due, || notes.0.lock().unwrap().iter().any(|(_, words)| words == due));
}

#[test]
fn in_real_time_requests_and_replies_are_seen_in_their_order() {
    in_real_time(
        Listener::at(11),
        Settings::default(),
        |_| (),
        |far, notes| {
            let _ = far.write(&STATUS_11).unwrap();
            wait_for(notes, &reply());
            let seen = notes.take();
            let words: Vec<_> = seen.iter().map(|(_, words)| words.clone()).collect();
            assert_eq!(words[words.len() - 2..], [request(), reply()]);
            assert!(seen.iter().map(|(at, _)| *at).is_sorted());
        },
    );
}

#[test]
fn in_real_time_a_reply_that_is_not_sent_is_seen() {
    let paced = Settings { pace: true, reply_limit: Duration::from_millis(2_000), ..Settings::default() };
    // 60000 bit times are 120 ms: time enough to go on.
    let slow = Listener::at(11).with_min_tsdr(60_000);
    in_real_time(
        slow,
        paced,
        |_| (),
        |far, notes| {
            let _ = far.write(&STATUS_11).unwrap();
            wait_for(notes, &request());
            let _ = far.write(&STATUS_11).unwrap();
            wait_for(notes, "Overtaken");
            let words = notes.words();
            let overtaken = words.iter().position(|words| words == "Overtaken").unwrap();
            assert_eq!(words[overtaken + 1], request(), "what came has overtaken it: {words:?}");
        },
    );
    let mut held_up = Listener::at(11);
    held_up.slow = std::time::Duration::from_millis(30);
    in_real_time(
        held_up,
        Settings::default(),
        |_| (),
        |far, notes| {
            let _ = far.write(&STATUS_11).unwrap();
            wait_for(notes, "TooLate");
        },
    );
}

#[test]
fn in_real_time_faults_are_seen_at_the_telegram_that_has_them() {
    let change = |segment: &mut Segment<Listener>| {
        let faults = segment.faults_mut();
        faults.fail_next_request(RequestFault::Corrupt { octet: 4, mask: 1 });
        faults.fail_next_reply(ReplyFault::Lose);
    };
    in_real_time(Listener::at(11), Settings::default(), change, |far, notes| {
        let _ = far.write(&STATUS_11).unwrap();
        wait_for(notes, "request [10, 0B, 02, 49, 57, 16] with faults");
        thread::sleep(std::time::Duration::from_millis(20));
        let _ = far.write(&STATUS_11).unwrap();
        wait_for(notes, &format!("{} with faults lost", reply()));
        let _ = far.write(&STATUS_11).unwrap();
        wait_for(notes, &reply());
    });
}
