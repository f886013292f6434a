//! Everything from the shaft to the input image: the half of the device that a timer drives.
//!
//! It meets the half that the bus drives in two places: the [`InputImage`] goes one way, a
//! [`Demand`] the other.
//!
//! # Order of calls
//!
//! [`SensorHalf::sample`] at every latch, 500 us apart from power-on. Or only where it matters:
//! before [`SensorHalf::obey`], and before anything is read, a host runs
//!
//! ```
//! # use profibus_dp::time::Instant;
//! # use sch108bex::{nonvolatile::Record, sensor::ShaftReading, sensor_half::SensorHalf};
//! # use sch108bex::{health::Battery, specification::Variant};
//! # let (now, shaft) = (Instant::from_millis(7), |_| ShaftReading::Full(42));
//! # let record = Record::as_delivered(Variant::FULL);
//! # let mut half = SensorHalf::new(Instant::ZERO, Variant::FULL, &record, Battery::Ok, &mut ());
//! while let Some(latch) = half.latch_needed(now) {
//!     half.sample(latch, shaft(latch), &mut ());
//! }
//! # assert_eq!(half.position(), 42);
//! ```
//!
//! and every answer is the same as if it had been called at every latch.

use profibus_dp::time::Instant;

pub use crate::data_exchange::InputImage;
use crate::diagnostics::{Alarms, Diagnostics, Warnings};
use crate::event::{Event, Observer, PositionErrorCause};
use crate::functionality::Functionality;
use crate::health::{Battery, Health, Measurement, Supervision};
use crate::motion::Motion;
use crate::nonvolatile::{OffsetScaling, Record};
use crate::parameterization::{CodeSequence, Parameters, TimeBase};
use crate::preset;
use crate::scaling::Scaling;
use crate::sensor::{Sensor, ShaftReading, Taken, latest_latch};
use crate::specification::{LATCH_PERIOD, SerialNumber, Variant};

/// What the bus asks of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demand {
    /// Preset the position to bits 0-30 (manual 4.3.2); bit 31 is not looked at. Nothing happens
    /// in class 1 and outside data exchange, where there are no outputs.
    Preset(u32),
    /// Data exchange begins, or new parameters come in it.
    Parameterize {
        /// What was agreed in Chk_Cfg.
        functionality: Functionality,
        /// What the last Set_Prm had.
        parameters: Parameters,
    },
    /// Data exchange is over.
    Leave,
}

/// The half of the device that looks at the shaft and at the world.
#[derive(Debug, Clone, Copy)]
pub struct SensorHalf {
    image: InputImage,
    record_changed: bool,
    functionality: Option<Functionality>,
    /// From then on a latch has more to it than a new position.
    special_from: Instant,
    sensor: Sensor,
    scaling: Scaling,
    /// The offset as a latch adds it: reduced to the range, 0 in class 1.
    shift: u32,
    motion: Motion,
    offset: i32,
    offset_scaling: OffsetScaling,
    supervision: Supervision,
}

impl SensorHalf {
    /// Reading: a power-on that follows a position error clears the alarm, the turn count and the
    /// offset, also with an empty battery. One that follows a run without raises it if the battery
    /// is empty (the turn count is lost and restarts at 0) or if both records are damaged. The run
    /// at the factory counts as one without.
    ///
    /// `now` is the power-on, the instant of the first latch.
    pub fn new(
        now: Instant,
        variant: Variant,
        record: &Record,
        battery: Battery,
        observer: &mut impl Observer,
    ) -> Self {
        let cleared = record.position_error;
        let turns_lost = cleared || battery == Battery::Empty;
        let mut half = Self {
            image: InputImage::default(),
            record_changed: false,
            functionality: None,
            special_from: Instant::ZERO,
            sensor: Sensor::new(now, variant, record.turn_base, record.raw, turns_lost),
            scaling: Scaling::physical(variant, CodeSequence::Clockwise),
            shift: 0,
            motion: Motion::STOPPED,
            offset: if cleared { 0 } else { record.offset },
            offset_scaling: record.offset_scaling,
            supervision: Supervision::new(now, record.operating_time_ms, battery, observer),
        };
        if cleared {
            observer.observe(now, &Event::PositionErrorCleared);
        } else if battery == Battery::Empty {
            half.position_error(now, PositionErrorCause::TurnCountLost, observer);
        }
        if record.both_slots_damaged {
            half.position_error(now, PositionErrorCause::BothRecordsDamaged, observer);
        }
        half
    }

    /// Takes the latch that is due at `now`; says whether one was. Latches that were due before
    /// it are skipped.
    #[inline]
    pub fn sample(&mut self, now: Instant, reading: ShaftReading, observer: &mut impl Observer) -> bool {
        let latch = self.sensor.next();
        if now < latch {
            return false;
        }
        let ordinary = now < latch + LATCH_PERIOD && latch < self.special_from;
        if !ordinary || !self.sensor.take_ordinary(reading) {
            return self.sample_specially(now, reading, observer);
        }
        self.refresh_position();
        true
    }

    /// A latch with more to it: the first, one after skipped ones, a sample of velocity and
    /// acceleration, a doubtful reading.
    #[inline(never)]
    fn sample_specially(
        &mut self,
        now: Instant,
        reading: ShaftReading,
        observer: &mut impl Observer,
    ) -> bool {
        let latch = self.sensor.due(now);
        match self.sensor.take(latch, reading) {
            Taken::Position => {}
            Taken::TurnsRestarted => self.record_changed = true,
            Taken::Doubtful(cause) => self.position_error(now, cause, observer),
        }
        if latch.at >= self.motion.next() {
            self.motion.sample(latch.at, &self.scaling, self.sensor.physical());
            self.refresh_motion();
        }
        self.refresh_position();
        self.plan();
        true
    }

    /// Works out from when on a latch has more to it.
    fn plan(&mut self) {
        self.special_from = if self.sensor.is_started() { self.motion.next() } else { Instant::ZERO };
    }

    /// The position from the latest latch into the input image.
    #[inline]
    fn refresh_position(&mut self) {
        let position = self.current_position();
        self.image.set_position(position);
    }

    /// The position of the latest latch with the offset as it is now.
    #[inline]
    fn current_position(&self) -> u32 {
        let position = self.scaling.position_without_offset(self.sensor.raw());
        preset::shifted(position, self.shift, self.scaling.modulus())
    }

    /// Velocity and acceleration into the input image.
    fn refresh_motion(&mut self) {
        let motion = &self.motion;
        self.image.set_motion(motion.velocity(), motion.acceleration());
    }

    /// Reading "Latch": only latches that matter need be taken.
    ///
    /// The earliest latch at or before `now` that must still be sampled so that every answer is
    /// the one of having sampled all of them: the samples of velocity and acceleration that
    /// matter, then the latest latch. `None` when there is nothing left to sample.
    ///
    /// For a shaft that delivers its full position. One that delivers its angle only must be
    /// sampled at every latch.
    pub fn latch_needed(&self, now: Instant) -> Option<Instant> {
        let next = self.sensor.next();
        if now < next {
            return None;
        }
        let latest = if now < next + LATCH_PERIOD { next } else { latest_latch(next, now) };
        Some(self.motion.needed(latest).unwrap_or(latest))
    }

    /// Does what the bus asks. All latches up to `now` must have been sampled.
    pub fn obey(&mut self, now: Instant, demand: Demand, observer: &mut impl Observer) {
        match demand {
            Demand::Preset(value) => self.preset(now, value & !preset::PRESET_BIT, observer),
            Demand::Parameterize { functionality, parameters } => {
                self.parameterize(now, functionality, &parameters, observer);
            }
            Demand::Leave => {
                self.functionality = None;
                self.motion.stop();
                self.plan();
            }
        }
    }

    /// Reading: a preset takes the latest latch, at any speed; the input image still shows that
    /// latch as it was, and the shift from the next latch on.
    fn preset(&mut self, now: Instant, value: u32, observer: &mut impl Observer) {
        if matches!(self.functionality, None | Some(Functionality::Class1)) {
            return;
        }
        match preset::offset_for(value, &self.scaling, self.sensor.raw()) {
            Ok(offset) => {
                let from = self.current_position();
                self.offset = offset;
                self.offset_scaling = OffsetScaling::of(&self.scaling);
                self.shift = preset::reduced(offset, self.scaling.modulus());
                self.record_changed = true;
                observer.observe(now, &Event::PresetTaken { from, to: value, offset });
            }
            Err(refusal) => observer.observe(now, &Event::PresetRefused(refusal)),
        }
    }

    /// New parameters act at once on the latest latch; velocity and acceleration, which only
    /// Scancon 2.0 has, start anew with the next.
    fn parameterize(
        &mut self,
        now: Instant,
        functionality: Functionality,
        parameters: &Parameters,
        observer: &mut impl Observer,
    ) {
        self.functionality = Some(functionality);
        self.scaling = Scaling::in_force(self.scaling.variant(), functionality, parameters);
        let offset = offset_in_force(functionality, self.offset);
        self.shift = preset::reduced(offset, self.scaling.modulus());
        self.motion = match functionality {
            Functionality::Scancon2 => Motion::starting(self.sensor.next(), parameters.time_base),
            Functionality::Class1 | Functionality::Class2 => Motion::STOPPED,
        };
        self.refresh_motion();
        self.refresh_position();
        self.plan();
        if offset != 0 && self.offset_scaling != OffsetScaling::of(&self.scaling) {
            observer.observe(now, &Event::OffsetKeptUnderOtherScaling { offset });
        }
        let residual = self.scaling.overflow_residual();
        if residual != 0 {
            observer.observe(now, &Event::JumpAtOverflow { residual });
        }
    }

    /// Raises the position error alarm. It stays until the next power-on.
    pub fn position_error(&mut self, now: Instant, cause: PositionErrorCause, observer: &mut impl Observer) {
        if self.supervision.raise_position_error(now, observer) {
            observer.observe(now, &Event::PositionErrorCause(cause));
            self.record_changed = true;
        }
    }

    /// Takes what was measured of the world.
    pub fn measure(&mut self, now: Instant, measurement: &Measurement, observer: &mut impl Observer) {
        self.supervision.measure(now, measurement, observer);
    }

    /// Lets time pass for alarms, warnings and operating time. The shaft is not looked at.
    pub fn poll(&mut self, now: Instant, observer: &mut impl Observer) {
        self.supervision.poll(now, observer);
    }

    /// When [`SensorHalf::poll`] has something to do next. Latches are not in it.
    pub fn next_deadline(&self) -> Option<Instant> {
        let deadline = self.supervision.next_deadline();
        (deadline != Instant::MAX).then_some(deadline)
    }
}

/// What others read.
impl SensorHalf {
    /// The input octets for the next answer.
    #[inline]
    pub const fn inputs(&self) -> &InputImage {
        &self.image
    }

    /// Alarms, warnings, operating time and offset value for the diagnosis.
    pub const fn health(&self) -> Health {
        Health {
            alarms: self.supervision.alarms(),
            warnings: self.supervision.warnings(),
            operating_time: self.supervision.operating_time(),
            offset: self.offset,
        }
    }

    /// The alarms now.
    #[inline]
    pub const fn alarms(&self) -> Alarms {
        self.supervision.alarms()
    }

    /// The warnings now.
    #[inline]
    pub const fn warnings(&self) -> Warnings {
        self.supervision.warnings()
    }

    /// The encoder's part of the diagnosis as it is now.
    pub fn diagnostics(&self, serial_number: &SerialNumber) -> Diagnostics {
        let health = self.health();
        match self.functionality {
            None => Diagnostics::outside_data_exchange(self.variant(), &health),
            Some(functionality) => {
                Diagnostics::in_data_exchange(functionality, &self.scaling, &health, serial_number)
            }
        }
    }

    /// What was agreed; `None` outside data exchange.
    pub const fn functionality(&self) -> Option<Functionality> {
        self.functionality
    }

    /// The scaling in force, the last one outside data exchange.
    pub const fn scaling(&self) -> &Scaling {
        &self.scaling
    }

    /// The variant.
    pub const fn variant(&self) -> Variant {
        self.scaling.variant()
    }

    /// The unit of velocity and acceleration in Scancon 2.0.
    pub const fn time_base(&self) -> TimeBase {
        self.motion.time_base()
    }

    /// The position that the input image shows, in scaled steps.
    pub const fn position(&self) -> u32 {
        self.image.position()
    }

    /// The velocity of the last full window, in the unit of the time base; 0 but in Scancon 2.0.
    pub const fn velocity(&self) -> i32 {
        self.motion.velocity()
    }

    /// The acceleration of the last two windows, in the unit of the time base; 0 but in
    /// Scancon 2.0.
    pub const fn acceleration(&self) -> i32 {
        self.motion.acceleration()
    }

    /// The physical position of the latest latch in counts from the physical zero point, clockwise
    /// positive, no range applied.
    pub const fn physical_position(&self) -> i64 {
        self.sensor.physical()
    }

    /// The offset value (manual 4.2.14), in scaled steps.
    pub const fn offset(&self) -> i32 {
        self.offset
    }

    /// Whether something changed that must be kept at once: offset value, position error or turn
    /// count. Asking takes the answer away.
    pub fn take_record_change(&mut self) -> bool {
        core::mem::take(&mut self.record_changed)
    }

    /// What is to be kept as of `now`, with the station address set over the bus.
    pub fn record(&self, now: Instant, stored_address: Option<u8>) -> Record {
        Record {
            stored_address,
            offset: self.offset,
            offset_scaling: self.offset_scaling,
            operating_time_ms: self.supervision.operating_time_ms(now),
            // Until the turn count has been restarted the next power-on has to do it.
            position_error: self.alarms().contains(Alarms::POSITION_ERROR) || self.sensor.turns_lost(),
            turn_base: self.sensor.turn_base(),
            raw: self.sensor.known_raw(),
            both_slots_damaged: false,
        }
    }
}

/// Reading: class 1 has no offset. It is kept, and in force again in the others.
const fn offset_in_force(functionality: Functionality, offset: i32) -> i32 {
    match functionality {
        Functionality::Class1 => 0,
        Functionality::Class2 | Functionality::Scancon2 => offset,
    }
}

impl OffsetScaling {
    /// The scaling in force, as it is kept with an offset.
    const fn of(scaling: &Scaling) -> Self {
        Self {
            measuring_units_per_revolution: scaling.measuring_units_per_revolution(),
            total_measuring_range: scaling.total_measuring_range(),
            code_sequence: scaling.code_sequence(),
        }
    }
}
