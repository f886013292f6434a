//! Ends in memory, from two threads.

use std::thread;
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::{CAPACITY, pair};
use bus::{End, Event, Written};
use profibus_dp::time::{Baudrate, Duration};

const SECOND: Option<Duration> = Some(Duration::from_secs(1));

#[test]
fn octets_cross_and_the_far_side_is_announced_first() {
    let (mut here, mut there) = pair();
    let mut buffer = [0; 16];
    assert_eq!(there.write(&[1, 2, 3]).unwrap(), Written::All);
    assert_eq!(there.write(&[4]).unwrap(), Written::All);
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Came(None));
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Octets(4));
    assert_eq!(buffer[..4], [1, 2, 3, 4]);
    assert_eq!(here.wait(Some(Duration::from_millis(1)), &mut buffer).unwrap(), Event::TimedOut);
    drop(there);
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Left);
    assert_eq!(here.write(&[1]).unwrap(), Written::Dropped(1));
}

#[test]
fn a_waiting_side_wakes_up_for_octets_and_for_its_waker() {
    let (mut here, mut there) = pair();
    let waker = here.waker();
    let far = thread::spawn(move || {
        thread::sleep(Time::from_millis(20));
        waker.wake();
        thread::sleep(Time::from_millis(20));
        there.write(&[7]).unwrap()
    });
    let mut buffer = [0; 16];
    assert_eq!(here.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Woken);
    assert_eq!(here.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Came(None));
    assert_eq!(here.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Octets(1));
    assert_eq!(far.join().unwrap(), Written::All);
}

#[test]
fn a_wake_up_before_the_wait_is_not_lost() {
    let (mut here, _there) = pair();
    here.waker().wake();
    assert_eq!(here.wait(SECOND, &mut [0; 1]).unwrap(), Event::Woken);
    let begun = Moment::now();
    assert_eq!(here.wait(Some(Duration::from_millis(5)), &mut [0; 1]).unwrap(), Event::TimedOut);
    assert!(begun.elapsed() >= Time::from_millis(5));
}

#[test]
fn the_rate_of_one_side_is_news_for_the_other() {
    let (mut here, mut there) = pair();
    let mut buffer = [0; 16];
    there.set_rate(Some(Baudrate::B19200));
    assert_eq!(there.write(&[1]).unwrap(), Written::All);
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Came(Some(Baudrate::B19200)));
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Octets(1));
    there.set_rate(Some(Baudrate::B19200));
    assert_eq!(here.wait(Some(Duration::ZERO), &mut buffer).unwrap(), Event::TimedOut);
    there.set_rate(None);
    assert_eq!(here.wait(SECOND, &mut buffer).unwrap(), Event::Rate(None));
}

#[test]
fn a_side_that_does_not_read_loses_octets_and_blocks_nobody() {
    let (_here, mut there) = pair();
    assert_eq!(there.write(&[0; CAPACITY - 1]).unwrap(), Written::All);
    assert_eq!(there.write(&[0; 10]).unwrap(), Written::Dropped(9));
}
