//! The two halves by themselves answer what the whole device answers.

use profibus_dp::Station;
use profibus_dp::fdl::{BaudSetting, Gathered, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use proptest::prelude::*;
use sch108bex::device::{Device, NonvolatileWrite, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::PositionErrorCause;
use sch108bex::halves::{BusHalf, ShaftHalf};
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::Choice;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SerialNumber, Variant};

const RATE: Baudrate = Baudrate::B1500000;
const LATCH: Duration = Duration::from_micros(500);

fn power_on(switches: u8, baud: BaudSetting) -> PowerOn {
    PowerOn {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: 0x108B,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(switches),
        },
        stored: Choice::AsDelivered,
        battery: Battery::Ok,
        baud,
        receiver: ReceiverMode::Idle,
    }
}

/// Both, at the same time; and one that hears whole slices, of which nothing is skipped.
struct Pair {
    whole: Device,
    slices: Device,
    /// The rate is the line's: else slices are taken apart at times that are none of the line's.
    fixed: bool,
    bus: BusHalf,
    shaft: ShaftHalf,
    now: Instant,
    latch: Instant,
    /// As firmware counts it, from the newest octet.
    heard: Instant,
}

impl Pair {
    fn new(switches: u8, baud: BaudSetting) -> Self {
        let start = Instant::from_millis(1);
        let whole = Device::new(start, power_on(switches, baud), ());
        let (bus, shaft) = Device::new(start, power_on(switches, baud), ()).into_halves();
        let slices = Device::new(start, power_on(switches, baud), ());
        let fixed = matches!(baud, BaudSetting::Fixed(_));
        let mut pair =
            Self { whole, slices, fixed, bus, shaft, now: start, latch: start, heard: Instant::ZERO };
        pair.latch(ShaftReading::Singleturn(0));
        pair
    }

    fn latch(&mut self, reading: ShaftReading) {
        self.now = self.now.max(self.latch);
        self.latch += LATCH;
        for device in [&mut self.whole, &mut self.slices] {
            device.poll(self.now);
            device.sample(self.now, reading);
        }
        self.bus.poll(self.now);
        self.carry();
        if self.shaft.poll(self.now, &mut ()) {
            self.bus.publish(self.shaft.health());
        }
        if self.shaft.sample(self.now, reading, &mut ()) {
            self.bus.publish(self.shaft.health());
        }
        self.bus.show(self.shaft.inputs());
    }

    fn carry(&mut self) {
        let mut obeyed = false;
        while let Some(demand) = self.bus.take_demand() {
            self.shaft.obey(self.now, demand, &mut ());
            obeyed = true;
        }
        if obeyed {
            self.bus.show(self.shaft.inputs());
            self.bus.publish(self.shaft.health());
        }
    }

    fn measure(&mut self, measurement: Measurement) {
        self.whole.measure(self.now, &measurement);
        self.slices.measure(self.now, &measurement);
        self.shaft.measure(self.now, &measurement, &mut ());
        self.bus.publish(self.shaft.health());
    }

    fn position_error(&mut self) {
        self.whole.position_error(self.now, PositionErrorCause::Injected);
        self.slices.position_error(self.now, PositionErrorCause::Injected);
        self.shaft.position_error(self.now, PositionErrorCause::Injected, &mut ());
        self.bus.publish(self.shaft.health());
    }

    fn written(&mut self) -> (Option<NonvolatileWrite>, Option<NonvolatileWrite>) {
        let whole = self.whole.take_nonvolatile(self.now);
        let (address, changed) = (self.bus.stored_address(), self.bus.take_address_change());
        let halves = self.shaft.take_nonvolatile(self.now, address, changed);
        if whole.is_some() {
            self.whole.confirm_nonvolatile();
        }
        if halves.is_some() {
            self.shaft.confirm_nonvolatile();
        }
        (whole, halves)
    }

    fn line_error(&mut self) {
        self.now += RATE.duration(BitTimes::CHARACTER);
        self.heard = self.now;
        self.whole.line_error(self.now);
        self.slices.line_error(self.now);
        self.bus.line_error(self.now);
    }

    /// Octets after so many bit times; the replies, where the last one is answered.
    fn octets(&mut self, pause: u32, octets: &[u8]) -> (Option<Vec<u8>>, Option<Vec<u8>>) {
        self.now += RATE.duration(BitTimes(pause));
        let mut replies = (None, None);
        for &octet in octets {
            self.now += RATE.duration(BitTimes::CHARACTER);
            let now = self.now;
            let window = self.whole.receive_octet(now, octet);
            let whole = window.and_then(|window| self.whole.transmit(window.not_before).map(<[u8]>::to_vec));
            if now.since(self.heard) >= self.bus.idle_gap() {
                self.bus.line_was_idle();
            }
            self.heard = now;
            let halves = self.half_octet(now, octet);
            self.carry();
            replies = (whole, halves);
        }
        let window = self.slices.receive(self.now, octets);
        let slices = window.and_then(|window| self.slices.transmit(window.not_before).map(<[u8]>::to_vec));
        assert!(!self.fixed || slices == replies.0, "{octets:02X?}: {slices:02X?} and {replies:02X?}");
        replies
    }

    fn half_octet(&mut self, now: Instant, octet: u8) -> Option<Vec<u8>> {
        match self.bus.gather(octet) {
            Gathered::Look if self.bus.look(octet) => {}
            Gathered::Foreign => {
                self.bus.hear_foreign(now);
                return None;
            }
            _ => return None,
        }
        let data = self.bus.answers_data(now);
        let window = self.bus.take_collected(now);
        let reply = window.and_then(|window| self.bus.transmit(window.not_before).map(<[u8]>::to_vec));
        if data {
            assert_eq!(reply.as_ref().map(|octets| octets[0]), Some(0x68), "the reply was begun with SD2");
            assert_eq!(window.map(|window| window.not_before), Some(now + self.bus.reply_delay()));
        }
        reply
    }
}

fn telegram(da: u8, sa: u8, fc: u8, saps: Option<[u8; 2]>, data: &[u8]) -> Vec<u8> {
    let extension = if saps.is_some() { 0x80 } else { 0 };
    let mut body = vec![da | extension, sa | extension, fc];
    body.extend(saps.into_iter().flatten());
    body.extend(data);
    let fcs = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    let mut all = if body.len() == 3 {
        vec![0x10]
    } else {
        let le = u8::try_from(body.len()).unwrap();
        vec![0x68, le, le, 0x68]
    };
    all.extend(body);
    all.extend([fcs, 0x16]);
    all
}

fn parameters(length: usize) -> Vec<u8> {
    let mut octets = vec![0x88, 1, 20, 11, 0x10, 0x8B, 0, 0, 0x0A];
    octets.extend(3600_u32.to_be_bytes());
    octets.extend(100_000_u32.to_be_bytes());
    octets.resize(25, 0);
    octets.push(0);
    octets.truncate(length);
    if length == 9 {
        octets[8] = 0;
    }
    octets
}

#[derive(Debug, Clone)]
enum Step {
    Octets { pause: u32, octets: Vec<u8> },
    Latch(u16),
    Fault,
    Measure(i32),
    PositionError,
    LineError,
    Wait(u64),
}

fn request() -> impl Strategy<Value = Vec<u8>> {
    let fc =
        prop_oneof![Just(0x6D_u8), Just(0x5D), Just(0x7D), Just(0x5C), Just(0x49), Just(0x4D), any::<u8>()];
    let address =
        prop_oneof![12 => Just(42_u8), 3 => Just(43), 1 => Just(0xAB), 1 => Just(127), 1 => any::<u8>()];
    let master = prop_oneof![12 => Just(2_u8), 1 => Just(0x82), 1 => Just(3), 1 => any::<u8>()];
    let body = prop_oneof![
        8 => Just((None::<[u8; 2]>, vec![0; 4])),
        1 => Just((None, vec![0x80, 0, 1, 2])),
        1 => Just((None, vec![])),
        1 => Just((None, vec![1])),
        1 => Just((Some([60, 62]), vec![])),
        2 => Just((Some([61, 62]), parameters(25))),
        1 => Just((Some([61, 62]), parameters(26))),
        1 => Just((Some([61, 62]), parameters(9))),
        3 => prop_oneof![Just(vec![0xF1]), Just(vec![0xD1]), Just(vec![0xF1, 0xD1, 0xD1])]
            .prop_map(|octets| (Some([62, 62]), octets)),
        1 => proptest::collection::vec(any::<u8>(), 0..12).prop_map(|octets| (Some([55, 62]), octets)),
        1 => proptest::collection::vec(any::<u8>(), 0..30).prop_map(|octets| (None, octets)),
    ];
    let head = (address, master, fc);
    (head, body).prop_map(|((da, sa, fc), (saps, data))| telegram(da, sa, fc, saps, &data))
}

fn steps() -> impl Strategy<Value = Step> {
    let pause = prop_oneof![6 => Just(33_u32), 1 => Just(0), 1 => Just(32), 1 => 0..100_u32];
    let octets = prop_oneof![
        20 => request(),
        // One octet wrong, or cut short.
        2 => (request(), any::<prop::sample::Index>(), any::<u8>()).prop_map(|(mut octets, at, octet)| {
            let at = at.index(octets.len());
            octets[at] = octet;
            octets
        }),
        1 => (request(), any::<prop::sample::Index>()).prop_map(|(mut octets, at)| {
            octets.truncate(at.index(octets.len()));
            octets
        }),
        1 => Just(vec![0xDC, 2, 2]),
        1 => Just(vec![0xE5]),
        1 => proptest::collection::vec(any::<u8>(), 0..20),
    ];
    prop_oneof![
        30 => (pause, octets).prop_map(|(pause, octets)| Step::Octets { pause, octets }),
        8 => any::<u16>().prop_map(Step::Latch),
        1 => Just(Step::Fault),
        1 => prop_oneof![Just(24_000), Just(8_000), Just(5_000)].prop_map(Step::Measure),
        1 => Just(Step::PositionError),
        1 => Just(Step::LineError),
        1 => prop_oneof![Just(1_u64), Just(150), Just(300), Just(6_000)].prop_map(Step::Wait),
    ]
}

fn walk(pair: &mut Pair, steps: &[Step]) -> Result<(), TestCaseError> {
    for step in steps {
        match step {
            Step::Octets { pause, octets } => {
                let (whole, halves) = pair.octets(*pause, octets);
                prop_assert_eq!(whole, halves, "{:02X?}", octets);
            }
            Step::Latch(angle) => pair.latch(ShaftReading::Singleturn(*angle)),
            Step::Fault => pair.latch(ShaftReading::Fault),
            Step::Measure(supply_mv) => {
                pair.measure(Measurement { supply_mv: *supply_mv, ..Measurement::GOOD });
            }
            Step::PositionError => pair.position_error(),
            Step::LineError => pair.line_error(),
            Step::Wait(millis) => {
                pair.now += Duration::from_millis(*millis);
                pair.latch = pair.latch.max(pair.now);
                pair.latch(ShaftReading::Singleturn(7));
            }
        }
        let (whole, halves) = pair.written();
        prop_assert_eq!(whole, halves);
        prop_assert_eq!(pair.whole.bus().slave().state(), pair.bus.bus().slave().state());
        if pair.fixed {
            prop_assert_eq!(pair.whole.bus().slave().state(), pair.slices.bus().slave().state());
        }
        prop_assert_eq!(pair.whole.listening_rate(), pair.bus.bus().listening_rate());
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_halves_answer_what_the_whole_answers(
        steps in proptest::collection::vec(steps(), 0..60),
        searching in prop_oneof![4 => Just(false), 1 => Just(true)],
    ) {
        let baud = if searching { BaudSetting::Search(RATE) } else { BaudSetting::Fixed(RATE) };
        let mut pair = Pair::new(42, baud);
        walk(&mut pair, &steps)?;
    }

    // From data exchange on: what is known ahead has to hold there.
    #[test]
    fn a_reply_with_data_is_known_before_the_last_octet(
        steps in proptest::collection::vec(steps(), 0..60),
        which in 0..3_usize,
    ) {
        let mut pair = Pair::new(42, BaudSetting::Fixed(RATE));
        let start = start_up(which).map(|octets| Step::Octets { pause: 33, octets });
        walk(&mut pair, &start)?;
        prop_assert!(pair.bus.bus().slave().state().is_data_exchange());
        walk(&mut pair, &steps)?;
    }
}

fn start_up(which: usize) -> [Vec<u8>; 3] {
    let (length, configuration): (usize, &[u8]) =
        [(9, &[0xD1][..]), (25, &[0xF1]), (26, &[0xF1, 0xD1, 0xD1])][which];
    [
        telegram(42, 2, 0x6D, Some([60, 62]), &[]),
        telegram(42, 2, 0x5D, Some([61, 62]), &parameters(length)),
        telegram(42, 2, 0x7D, Some([62, 62]), configuration),
    ]
}

#[test]
fn the_usual_exchange_is_known_ahead_and_no_other_telegram_is() {
    let known = |pair: &mut Pair, octets: &[u8]| {
        pair.now += RATE.duration(BitTimes(33));
        pair.bus.line_was_idle();
        let mut known = false;
        for &octet in octets {
            pair.now += RATE.duration(BitTimes::CHARACTER);
            if pair.bus.gather(octet) == Gathered::Look && pair.bus.look(octet) {
                known = pair.bus.answers_data(pair.now);
                pair.bus.take_collected(pair.now);
                pair.carry();
            }
        }
        known
    };
    let mut pair = Pair::new(42, BaudSetting::Fixed(RATE));
    let exchange = telegram(42, 2, 0x5D, None, &[0; 4]);
    assert!(!known(&mut pair, &exchange), "not parameterized");
    for octets in start_up(1) {
        assert!(!known(&mut pair, &octets));
    }
    assert!(known(&mut pair, &exchange));
    assert!(known(&mut pair, &exchange), "a retry");
    assert!(!known(&mut pair, &telegram(42, 3, 0x5D, None, &[0; 4])), "another master");
    assert!(!known(&mut pair, &telegram(42, 2, 0x49, None, &[])), "FDL status");
    assert!(!known(&mut pair, &telegram(43, 2, 0x7D, None, &[0; 4])), "another station");
    assert!(!known(&mut pair, &telegram(42, 2, 0x7D, Some([60, 62]), &[0; 2])), "a service");
    assert!(!known(&mut pair, &telegram(42, 2, 0x5D, None, &[])), "no outputs");
    assert!(known(&mut pair, &exchange));
    // The watchdog, 1 * 20 * 10 ms, runs out before the last octet is looked at.
    pair.now += Duration::from_millis(201);
    assert!(!known(&mut pair, &telegram(42, 2, 0x7D, None, &[0; 4])), "too late");
}
