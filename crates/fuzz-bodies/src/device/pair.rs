//! Two devices with one life.

use profibus_dp::dp::State;
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::{Parsed, parse};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::Measurement;
use sch108bex::nonvolatile::{Record, SLOT_OCTETS, Slot, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{LATCH_PERIOD, PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Device, Identity, NonvolatileWrite, PowerOn};

/// What a device is before it gets power.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    pub(super) variant: Variant,
    pub(super) switches: RotarySwitches,
    pub(super) rate: Baudrate,
    /// It searches for the rate.
    pub(super) search: bool,
}

/// Physical counts as a function of time.
#[derive(Debug, Clone, Copy)]
struct Shaft {
    start: i64,
    since: Instant,
    /// Counts in a millisecond.
    speed: i64,
}

#[derive(Debug)]
pub(super) struct Pair {
    setting: Setting,
    /// Whole telegrams, and the latches that matter.
    lazy: Device,
    /// Octet by octet, and every latch.
    eager: Device,
    power_on: Instant,
    next_latch: Instant,
    now: Instant,
    shaft: Shaft,
    world: Measurement,
    memory: [[u8; SLOT_OCTETS]; 2],
    /// The newest write, and what was there before.
    newest: Option<(NonvolatileWrite, [u8; SLOT_OCTETS])>,
    writes_fail: bool,
}

impl Pair {
    pub(super) fn new(setting: Setting) -> Self {
        let now = Instant::from_millis(3);
        let memory = [[0xFF; SLOT_OCTETS]; 2];
        let world = Measurement::GOOD;
        let new = || power_on(now, setting, &memory, world);
        let mut pair = Self {
            setting,
            lazy: new(),
            eager: new(),
            power_on: now,
            next_latch: now,
            now,
            shaft: Shaft { start: 5 * 65_536 + 7, since: now, speed: 3 },
            world,
            memory,
            newest: None,
            writes_fail: false,
        };
        pair.latch();
        pair.keep();
        pair
    }

    pub(super) fn address(&self) -> Option<u8> {
        self.lazy.address()
    }

    pub(super) fn both(&mut self, act: impl Fn(&mut Device, Instant)) {
        act(&mut self.lazy, self.now);
        act(&mut self.eager, self.now);
        self.keep();
    }

    /// A good telegram after idle time, and its reply; `choice` says when that is asked for.
    pub(super) fn telegram(&mut self, octets: &[u8], choice: u8) {
        let rate = self.setting.rate;
        self.pass(rate.duration(BitTimes(37)));
        let end = self.now + rate.duration(BitTimes::CHARACTER).times(octets.len() as u64);
        // Where it meets a deadline, such as that of a search, a slice would come after it.
        let deadlines = [self.lazy.next_deadline(), self.eager.next_deadline()];
        let cut = deadlines.into_iter().flatten().any(|due| due <= end) || !self.is_tuned();
        let (mut by_octets, mut by_slice) = (None, None);
        for &octet in octets {
            (by_slice, by_octets) = self.character(octet, cut);
        }
        if !cut {
            by_slice = self.lazy.receive(self.now, octets);
        }
        assert_eq!(by_slice, by_octets, "windows for {octets:02X?}");
        if let Some(window) = by_slice {
            self.reply(window, choice);
        }
        self.keep();
    }

    fn reply(&mut self, window: Window, choice: u8) {
        assert!(self.now <= window.not_before && window.not_before <= window.not_after, "{window:?}");
        let address = self.address();
        let when = match choice % 16 {
            // The master has gone on.
            15 => return,
            14 => Instant::from_nanos(window.not_after.as_nanos() + 1),
            13 => window.not_after,
            _ => window.not_before,
        };
        self.poll_until(when);
        let reply = self.lazy.transmit(when).map(<[u8]>::to_vec);
        let same = self.eager.transmit(when).map(<[u8]>::to_vec);
        assert_eq!(reply, same, "replies");
        assert_eq!(reply.is_some(), choice % 16 != 14, "asked for at {when:?}, due {window:?}");
        let Some(octets) = reply else { return };
        match parse(&octets) {
            Parsed::Complete(Telegram::Data(data), count) => {
                assert_eq!((count, Some(data.sa)), (octets.len(), address), "{octets:02X?}");
            }
            Parsed::Complete(Telegram::ShortAcknowledgement, 1) => {}
            other => panic!("{octets:02X?} is {other:?}"),
        }
    }

    /// Any octets straight one after the other.
    pub(super) fn raw(&mut self, octets: &[u8]) {
        for &octet in octets {
            let (by_slice, by_octets) = self.character(octet, true);
            assert_eq!(by_slice, by_octets, "windows");
            self.keep();
        }
    }

    fn is_tuned(&self) -> bool {
        self.lazy.listening_rate() == self.setting.rate
    }

    /// An octet on the line, for both devices or for the one that gets no slices; the windows that
    /// follow from it. Who listens at another rate hears a fault.
    fn character(&mut self, octet: u8, both: bool) -> (Option<Window>, Option<Window>) {
        self.poll_until(self.now + self.setting.rate.duration(BitTimes::CHARACTER));
        if !self.is_tuned() {
            self.both(Station::line_error);
            return (None, None);
        }
        let by_slice = if both { self.lazy.receive(self.now, &[octet]) } else { None };
        (by_slice, self.eager.receive_octet(self.now, octet))
    }

    pub(super) fn line_error(&mut self) {
        self.poll_until(self.now + self.setting.rate.duration(BitTimes::CHARACTER));
        self.both(Station::line_error);
    }

    pub(super) fn pass(&mut self, span: Duration) {
        self.poll_until(self.now + span);
    }

    /// Lets time pass, polling at every deadline.
    fn poll_until(&mut self, until: Instant) {
        let mut polls = 0;
        loop {
            // They may be earlier than anything happens, and so differ.
            let deadlines = [self.lazy.next_deadline(), self.eager.next_deadline()];
            let Some(due) = deadlines.into_iter().flatten().min().filter(|due| *due <= until) else { break };
            assert!(polls < 10_000, "polled again and again at {due:?}");
            polls += if due <= self.now { 100 } else { 1 };
            self.now = self.now.max(due);
            self.latch();
            self.both(Station::poll);
        }
        self.now = until;
        self.latch();
    }

    fn latch(&mut self) {
        let (shaft, now) = (self.shaft, self.now);
        while let Some(latch) = self.lazy.latch_needed(now) {
            assert!(self.lazy.sample(latch, shaft.reading(latch)), "a latch that is not due");
        }
        while self.next_latch <= now {
            assert!(self.eager.sample(self.next_latch, shaft.reading(self.next_latch)));
            self.next_latch += LATCH_PERIOD;
        }
    }

    pub(super) fn shaft(&mut self, start: i64, speed: i64) {
        self.shaft = Shaft { start, since: self.now, speed };
    }

    pub(super) fn measure(&mut self, world: Measurement) {
        self.world = world;
        self.both(|device, now| device.measure(now, &world));
    }

    pub(super) fn fail_next_write(&mut self) {
        self.writes_fail = true;
    }

    /// Power off and on; `cut` octets of the newest write are done, all if that is more than there
    /// are.
    pub(super) fn power_cycle(&mut self, cut: usize) {
        if let Some((write, before)) = self.newest.take()
            && cut < SLOT_OCTETS
        {
            let slot = &mut self.memory[usize::from(write.slot == Slot::B)];
            slot[cut..].copy_from_slice(&before[cut..]);
        }
        self.now += Duration::from_millis(50);
        self.lazy = power_on(self.now, self.setting, &self.memory, self.world);
        self.eager = power_on(self.now, self.setting, &self.memory, self.world);
        (self.power_on, self.next_latch) = (self.now, self.now);
        self.latch();
        self.keep();
    }

    /// Writes what both devices want written.
    fn keep(&mut self) {
        for round in 0.. {
            let write = self.lazy.take_nonvolatile(self.now);
            assert_eq!(write, self.eager.take_nonvolatile(self.now), "what is kept");
            let Some(write) = write else { return };
            assert!(round < 4, "it writes and writes");
            let (record, _) = Record::decode(&write.octets).expect("a record");
            assert_eq!(record.stored_address, self.lazy.encoder().stored_address());
            if std::mem::take(&mut self.writes_fail) {
                self.lazy.nonvolatile_failed(self.now);
                self.eager.nonvolatile_failed(self.now);
                return;
            }
            let slot = &mut self.memory[usize::from(write.slot == Slot::B)];
            self.newest = Some((write, *slot));
            *slot = write.octets;
            self.lazy.confirm_nonvolatile();
            self.eager.confirm_nonvolatile();
        }
    }

    /// What holds after each step.
    pub(super) fn check(&self) {
        let (lazy, eager) = (&self.lazy, &self.eager);
        assert_eq!(lazy.bus().slave().state(), eager.bus().slave().state());
        assert_eq!(lazy.sensor().inputs(), eager.sensor().inputs());
        assert_eq!(lazy.sensor().health(), eager.sensor().health());
        assert_eq!(lazy.sensor().record(self.now, None), eager.sensor().record(self.now, None));
        assert_eq!(lazy.address(), eager.address());
        assert_eq!(lazy.listening_rate(), eager.listening_rate());
        let exchanging = matches!(lazy.bus().slave().state(), State::DataExchange(..));
        assert_eq!(exchanging, lazy.encoder().functionality().is_some());
        assert_eq!(lazy.encoder().functionality(), lazy.sensor().functionality());
        assert_eq!(lazy.encoder().identity().switches, self.setting.switches);
        assert!(lazy.address().is_none_or(|address| address <= 126));
        let sensor = lazy.sensor();
        assert!(sensor.position() < sensor.scaling().modulus().get() || !exchanging);
        assert!(!exchanging || lazy.address() != Some(126), "no data exchange at 126");
    }
}

impl Shaft {
    fn reading(&self, at: Instant) -> ShaftReading {
        let micros = at.since(self.since).as_nanos() / 1_000;
        let micros = i64::try_from(micros).expect("hours, not ages");
        ShaftReading::Full(self.start + self.speed * micros / 1_000)
    }
}

fn power_on(now: Instant, setting: Setting, memory: &[[u8; SLOT_OCTETS]; 2], world: Measurement) -> Device {
    let identity = Identity {
        variant: setting.variant,
        ident_number: PLACEHOLDER_IDENT,
        serial_number: SerialNumber::DEFAULT,
        switches: setting.switches,
    };
    let power_on = PowerOn {
        identity,
        stored: choose(Record::decode(&memory[0]), Record::decode(&memory[1])),
        battery: world.battery,
        baud: if setting.search {
            BaudSetting::Search(setting.rate)
        } else {
            BaudSetting::Fixed(setting.rate)
        },
        receiver: ReceiverMode::Idle,
    };
    let mut device = Device::new(now, power_on, ());
    device.measure(now, &world);
    device
}
