//! `preset`: gives the position a value, and sees that it took.

use std::time::{Duration, Instant};

use clap::Args;
use sch108bex::functionality::Functionality;
use sch108bex::refusal::PresetRefusal;
use serde::Serialize;

use super::parameters::{Project, watchdog};
use super::place::Place;
use super::readings::{Sample, Scale};
use super::session::{PRESET, Session, class_2_part, meet};
use crate::arguments::whole;
use crate::{Failure, output};

/// Before the preset the shaft is looked at for so long.
const LOOKED_AT: Duration = Duration::from_millis(200);
/// The position changes with the latch after the request, 500 us later at most; pseudo terminals take longer.
const TAKES: Duration = Duration::from_millis(20);
/// The device has stored the offset after 40 ms; it is left alone a little longer.
const STORED_AFTER: Duration = Duration::from_millis(100);
/// A shaft that does not quite keep its speed.
const SLACK_STEPS: f64 = 2.0;

/// Give the position a value: with the position and the offset before and after, and a look whether it took
///
/// The offset counts in steps of the scaling that is in force: give the parameters of your project (--gsd with --set, or
/// --units and --range), or the value means something else to your controller. The encoder is started up as
/// class 2 for it, and left free.
#[derive(Debug, Args)]
pub(crate) struct Preset {
    /// The station, 0 to 125
    #[arg(value_parser = whole::<u8>(0..=125), allow_negative_numbers = true)]
    address: u8,
    /// The position that it shall have now, 0 to the total measuring range minus 1
    #[arg(value_parser = whole::<u32>(0..=0x7FFF_FFFF), allow_negative_numbers = true)]
    value: u32,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    project: Project,
    /// One document
    #[arg(long)]
    json: bool,
}

/// What was done.
#[derive(Debug, Serialize)]
struct Done {
    address: u8,
    value: u32,
    position_before: u32,
    position_after: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset_before: Option<i32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    offset_after: Option<i32>,
    /// Steps per second while it was looked at.
    steps_per_second: f64,
    /// By how much the position after it is off the value, the way of the shaft meanwhile included.
    off_by: i64,
}

impl Preset {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        self.place.check(Some(self.address))?;
        self.project.check()?;
        let done = self.place.with(|light| {
            let diagnosis = meet(light, self.address)?;
            let mut slave =
                self.project.slave(self.address, self.place.baud, &diagnosis, Functionality::Class2)?;
            if slave.outputs < 4 {
                return Err(Failure::Failed(format!(
                    "with {} output octets there is nothing to preset with: class 1 has no preset; take class 2 or Scancon 2.0",
                    slave.outputs
                )));
            }
            // Longer than all attempts at two requests: it shall not expire between two steps of this.
            let attempts = u32::from(self.place.retries) + 1;
            slave.parameters.watchdog = watchdog(1_000.max(2 * attempts * u32::from(self.place.reply_within)))?;
            let mut session = Session::begin(light, slave, &diagnosis)?;
            let done = self.preset(&mut session);
            // Bit 31 back to 0, or the next master's preset is no edge.
            session.set_output(0);
            let _ = session.exchange();
            session.end();
            done
        })?;
        if self.project.is_default() {
            output::aside(
                "note: scaling was off, so the offset counts in physical steps; if your project scales, preset with its \
                 parameters (--gsd with --set, or --units and --range)",
            );
        }
        self.tell(&done);
        self.judge(&done)
    }

    fn preset(&self, session: &mut Session<'_>) -> Result<Done, Failure> {
        let set_prm = session.slave().parameters.set_prm();
        let scale = Scale::of(session.diagnosis(), &set_prm);
        let offset_before = class_2_part(session.diagnosis()).map(|part| part.offset);
        if let Some(range) = scale.range.filter(|range| self.value >= *range) {
            let refusal = PresetRefusal { value: self.value, limit: range.saturating_sub(1) };
            return Err(Failure::Failed(format!(
                "the encoder would ignore it: {refusal}; {}",
                dissector::advice::of_preset(&refusal)
            )));
        }
        let position = |session: &mut Session<'_>| {
            let inputs = session.exchange()?;
            let sample = Sample::of(&inputs);
            sample.map(|sample| (Instant::now(), sample.position)).ok_or_else(|| {
                Failure::Failed(format!("{} octets of inputs have no position in them", inputs.len()))
            })
        };
        // Without bit 31 first: only its rising edge presets.
        session.set_output(0);
        let first = position(session)?;
        session.wait(LOOKED_AT)?;
        let before = position(session)?;
        let seconds = before.0.duration_since(first.0).as_secs_f64();
        let speed = steps(scale.distance(first.1, before.1)) / seconds;
        session.set_output(PRESET | self.value);
        session.exchange()?;
        let asked = Instant::now();
        session.wait(TAKES)?;
        let after = position(session)?;
        session.set_output(0);
        session.exchange()?;
        session.wait(STORED_AFTER)?;
        let offset_after = class_2_part(session.fetch_diagnosis()?).map(|part| part.offset);
        let moved = speed * after.0.duration_since(asked).as_secs_f64();
        #[expect(clippy::cast_possible_truncation, reason = "far below 2^53")]
        let off_by = scale.distance(self.value, after.1) - moved.round() as i64;
        Ok(Done {
            address: self.address,
            value: self.value,
            position_before: before.1,
            position_after: after.1,
            offset_before,
            offset_after,
            steps_per_second: speed,
            off_by,
        })
    }

    fn tell(&self, done: &Done) {
        if self.json {
            output::json(done);
            return;
        }
        let offset = |offset: Option<i32>| offset.map_or_else(|| "?".to_owned(), |offset| offset.to_string());
        output::line(&format!(
            "station {}: position {} before, {} after; offset {} before, {} after",
            done.address,
            done.position_before,
            done.position_after,
            offset(done.offset_before),
            offset(done.offset_after)
        ));
    }

    /// Whether it took: to the step where the shaft stands, else as near as its speed tells.
    fn judge(&self, done: &Done) -> Result<(), Failure> {
        let moving = done.steps_per_second.abs() > 0.0;
        // The time between latch and answer is only known to some milliseconds.
        let allowed = if moving { SLACK_STEPS + done.steps_per_second.abs() * 0.1 } else { 0.0 };
        if steps(done.off_by).abs() <= allowed {
            if !self.json {
                output::line(&if moving {
                    format!(
                        "it took, as near as can be told: the shaft moves at {:.0} steps per second; preset at standstill \
                         to be exact",
                        done.steps_per_second
                    )
                } else {
                    "it took: the shaft stands, and the position is the value".to_owned()
                });
            }
            return Ok(());
        }
        Err(Failure::Failed(format!(
            "it has not taken: the position is {}, {} steps off {}{}; fetch the diagnosis, and see that no other master \
             exchanges data with it",
            done.position_after,
            done.off_by,
            self.value,
            if done.offset_before == done.offset_after { ", and the offset is the old one" } else { "" }
        )))
    }
}

#[expect(clippy::cast_precision_loss, reason = "at most 2^31")]
fn steps(steps: i64) -> f64 {
    steps as f64
}
