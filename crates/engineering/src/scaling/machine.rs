//! From what a machine is to a scaling that suits it: units, range, what is lost by rounding, and whether the
//! overflow is ever reached.

use sch108bex::specification::Variant;
use serde::Serialize;

use super::{Plan, Wish};

/// How turns of the encoder and of the machine belong together: so many of one are so many of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Gear {
    /// Turns of the encoder, 1 and more.
    pub encoder: u32,
    /// Turns of the drum, wheel or table in the same time, 1 and more.
    pub machine: u32,
}

/// A machine whose position an encoder shall tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// The encoder.
    pub variant: Variant,
    /// What the machine counts in, such as `m`.
    pub unit: String,
    /// So many units in one turn of the drum; of a table 360 for degrees. Above 0.
    pub per_turn: f64,
    /// Between encoder and drum.
    pub gear: Gear,
    /// From one end to the other, in units; `None`: it turns on and on.
    pub travel: Option<f64>,
    /// One step shall be at most so many units. Above 0.
    pub resolution: f64,
}

/// A machine with a scaling that somebody has chosen already.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The machine; its resolution is what a step is taken for.
    pub machine: Machine,
    /// The scaling.
    pub wish: Wish,
}

impl Chosen {
    /// What the scaling means for the machine.
    pub fn judge(&self) -> Advice {
        let Self { machine, wish } = self;
        let turns = machine.travel.map_or_else(
            || f64::from(machine.gear.encoder) / f64::from(machine.gear.machine),
            |travel| travel / machine.per_encoder_turn(),
        );
        let mut advice = machine.advice(*wish, machine.resolution, turns);
        if machine.travel.is_none() {
            advice.warnings.extend(self.uneven_turn());
        } else if advice.range < machine.travel.unwrap_or_default() {
            advice.warnings.push(format!(
                "the range is {} {}, shorter than the travel: positions repeat",
                digits(advice.range, 6),
                machine.unit
            ));
        }
        advice
    }

    /// Where the range is no whole number of turns of the machine, the zero point creeps.
    fn uneven_turn(&self) -> Option<String> {
        let Self { machine, wish } = self;
        let Gear { encoder, machine: turns } = machine.gear;
        // One turn of the machine has so many units, over `turns`.
        let in_a_turn = u64::from(wish.units) * u64::from(encoder);
        let range = u64::from(wish.range) * u64::from(turns);
        if range == 0 || in_a_turn % range == 0 || (range % in_a_turn == 0) {
            return None;
        }
        let left = in_a_turn % range;
        #[expect(clippy::cast_precision_loss, reason = "told with six digits")]
        let off = left.min(range - left) as f64 / f64::from(turns);
        #[expect(clippy::cast_precision_loss, reason = "told with six digits")]
        let exact = in_a_turn as f64 / f64::from(turns);
        Some(format!(
            "creep: a turn of the machine has {} units, but the range is {}: the zero point creeps by {} units with each turn",
            digits(exact, 9),
            wish.range,
            digits(off, 6)
        ))
    }
}

/// A scaling for a [`Machine`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// What the machine counts in.
    pub unit: String,
    /// Units in one turn of the encoder.
    pub per_encoder_turn: f64,
    /// Turns of the encoder over the travel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel_turns: Option<f64>,
    /// What one step is called by the scaling, in units: a round number where there is one.
    pub step: f64,
    /// What one step really is: units of an encoder turn / measuring units.
    pub exact_step: f64,
    /// So many units the position is off after one turn of the encoder, if a step is taken for [`step`](Self::step).
    pub creep_per_turn: f64,
    /// After the travel; after one turn of the machine where it turns on and on.
    pub creep: f64,
    /// The range in units of the machine.
    pub range: f64,
    /// Whether the jump at the overflow is reached, in a sentence.
    pub overflow: String,
    /// What to beware of, in sentences.
    pub warnings: Vec<String>,
    /// The scaling itself.
    pub plan: Plan,
}

/// Why there is no scaling for a machine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MachineError {
    /// The encoder loses count.
    #[error(
        "the travel takes {turns:.1} turns of the encoder, but it tells only {most} apart; gear it down, or take one with \
         more multiturn bits"
    )]
    TooFar {
        /// Turns of the encoder.
        turns: f64,
        /// Turns that it tells apart.
        most: u32,
    },
    /// Too fine.
    #[error(
        "a step of {resolution} {unit} makes {units:.0} units per revolution, but the encoder has {most} steps; the finest step is \
         {finest} {unit}, or gear it up"
    )]
    TooFine {
        /// What was asked for.
        resolution: f64,
        /// Its unit.
        unit: String,
        /// Units per revolution that it makes.
        units: f64,
        /// Physical steps.
        most: u32,
        /// What can be had.
        finest: f64,
    },
    /// Coarser than a revolution.
    #[error(
        "a step of {resolution} {unit} is longer than a turn of the encoder, which is {per_turn} {unit}; ask for a finer one"
    )]
    TooCoarse {
        /// What was asked for.
        resolution: f64,
        /// Its unit.
        unit: String,
        /// Units in a turn of the encoder.
        per_turn: f64,
    },
    /// What turns on and on needs a whole number of steps in its turn.
    #[error(
        "with a gear of {encoder}:{machine} a turn of the machine has whole steps only as a multiple of {encoder}, and that \
         is too many for the encoder or its range; ask for a coarser step"
    )]
    Uneven {
        /// Turns of the encoder.
        encoder: u32,
        /// Turns of the machine.
        machine: u32,
    },
}

/// So many times finer than asked for, in round numbers, a step may become.
const FINER: [f64; 13] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4];
/// Nearer than this a number is whole: the rest is the computer's rounding.
const WHOLE: f64 = 1e-9;

impl Machine {
    /// Units in one turn of the encoder.
    pub fn per_encoder_turn(&self) -> f64 {
        self.per_turn * f64::from(self.gear.machine) / f64::from(self.gear.encoder)
    }

    /// Works out a scaling.
    ///
    /// # Errors
    ///
    /// This encoder cannot do it; the sentence says what to change.
    pub fn advise(&self) -> Result<Advice, MachineError> {
        let per_turn = self.per_encoder_turn();
        let most = self.variant.steps_per_revolution();
        let asked = per_turn / self.resolution;
        if asked < 0.5 {
            let (resolution, unit) = (self.resolution, self.unit.clone());
            return Err(MachineError::TooCoarse { resolution, unit, per_turn });
        }
        if asked > f64::from(most) * (1.0 + WHOLE) {
            return Err(MachineError::TooFine {
                resolution: self.resolution,
                unit: self.unit.clone(),
                units: asked,
                most,
                finest: per_turn / f64::from(most),
            });
        }
        match self.travel {
            Some(travel) => self.to_and_fro(travel),
            None => self.on_and_on(),
        }
    }

    /// Between two ends: a range of 2^k turns holds the travel and never jumps.
    fn to_and_fro(&self, travel: f64) -> Result<Advice, MachineError> {
        let turns = travel / self.per_encoder_turn();
        let most = self.variant.revolutions();
        if turns > f64::from(most) {
            return Err(MachineError::TooFar { turns, most });
        }
        let (units, step) = self.units(turns);
        let mut range_turns = 1_u32;
        // The far end is a position of its own, so the range is longer than the travel.
        while f64::from(range_turns) <= turns && range_turns < most {
            range_turns *= 2;
        }
        let range = units.saturating_mul(range_turns);
        Ok(self.advice(Wish::scaled(self.variant, units, range), step, turns))
    }

    /// The coarsest round step, as fine as asked for, whose rounding stays below half the step that was asked for; else the
    /// one with the least rounding.
    fn units(&self, turns: f64) -> (u32, f64) {
        let per_turn = self.per_encoder_turn();
        let candidates = FINER.iter().map(|finer| self.resolution / finer);
        let candidates = candidates.filter_map(|step| {
            let exact = per_turn / step;
            let units = whole(exact.round()).filter(|units| *units <= self.variant.steps_per_revolution())?;
            let creep = (exact - f64::from(units)).abs() * step * turns;
            (units > 0).then_some((units, step, creep))
        });
        let candidates: Vec<_> = candidates.collect();
        let good = candidates.iter().find(|(_, _, creep)| *creep <= self.resolution / 2.0);
        let least = candidates.iter().min_by(|one, other| one.2.total_cmp(&other.2));
        good.or(least).map_or((1, per_turn), |(units, step, _)| (*units, *step))
    }

    /// Round and round: the range is one turn of the machine, to the step.
    fn on_and_on(&self) -> Result<Advice, MachineError> {
        let Gear { encoder, machine } = self.gear;
        let uneven = || MachineError::Uneven { encoder, machine };
        let common = gcd(encoder, machine);
        let (encoder_turns, machine_turns) = (encoder / common, machine / common);
        let wanted = self.per_turn / self.resolution;
        let multiples = (wanted / f64::from(encoder_turns) * (1.0 - WHOLE)).ceil().max(1.0);
        let range = whole(multiples * f64::from(encoder_turns)).ok_or_else(uneven)?;
        let units = whole(multiples * f64::from(machine_turns)).ok_or_else(uneven)?;
        if units > self.variant.steps_per_revolution() || range > self.variant.total() {
            return Err(uneven());
        }
        let step = self.per_turn / f64::from(range);
        Ok(self.advice(
            Wish::scaled(self.variant, units, range),
            step,
            f64::from(encoder) / f64::from(machine),
        ))
    }

    fn advice(&self, wish: Wish, step: f64, turns: f64) -> Advice {
        let per_turn = self.per_encoder_turn();
        let exact_step = per_turn / f64::from(wish.units);
        let creep_per_turn = (f64::from(wish.units) * step - per_turn).abs();
        let creep_per_turn = if creep_per_turn < per_turn * WHOLE { 0.0 } else { creep_per_turn };
        let mut advice = Advice {
            unit: self.unit.clone(),
            per_encoder_turn: per_turn,
            travel_turns: self.travel.map(|_| turns),
            step,
            exact_step,
            creep_per_turn,
            creep: creep_per_turn * turns,
            range: f64::from(wish.range) * exact_step,
            overflow: String::new(),
            warnings: Vec::new(),
            plan: wish.plan(),
        };
        advice.overflow = self.overflow(&advice);
        advice.warnings = self.warnings(&advice, wish);
        advice
    }

    /// Whether the jump is ever seen.
    fn overflow(&self, advice: &Advice) -> String {
        let turns = self.variant.revolutions();
        let jump = advice.plan.consequences.as_ref().map_or(0, |consequences| consequences.jump);
        match (jump, advice.travel_turns) {
            (0, _) => "the position does not jump where the turn count begins again".to_owned(),
            (jump, None) => {
                let machine = f64::from(turns) * f64::from(self.gear.machine) / f64::from(self.gear.encoder);
                format!(
                    "it matters: every {turns} turns of the encoder, {machine:.1} of the machine, the position jumps by {jump} \
                     units, and the zero point is off from then on; a gear of 1, 2, 4, 8 and so on does not jump, or a reference mark sets it \
                     right again"
                )
            }
            (jump, Some(travel)) => {
                let spare = (f64::from(turns) - travel) / 2.0;
                format!(
                    "it jumps by {jump} units where the encoder's own turns begin again, once in {turns} turns; the travel takes \
                     {travel:.1}. No matter if that point lies outside of it: mount the encoder so that it is at {} turns \
                     (unscaled) at mid travel, then {spare:.1} are left on both sides",
                    turns / 2
                )
            }
        }
    }

    fn warnings(&self, advice: &Advice, wish: Wish) -> Vec<String> {
        let mut warnings = Vec::new();
        let unit = &self.unit;
        if advice.creep_per_turn > 0.0 {
            warnings.push(format!(
                "creep: {} steps of {} {unit} are not a turn of {} {unit}; the position is off by {} {unit} more with each turn, \
                 {} {unit} over the travel. It is not if the controller multiplies by {} {unit} instead",
                wish.units,
                digits(advice.step, 6),
                digits(advice.per_encoder_turn, 6),
                digits(advice.creep_per_turn, 6),
                digits(advice.creep, 6),
                digits(advice.exact_step, 12)
            ));
        }
        let steps = f64::from(self.variant.steps_per_revolution());
        if f64::from(wish.units) > steps / 2.0 && f64::from(wish.units) < steps {
            warnings.push(
                "nearly as many units as physical steps: some steps are twice as wide as others".to_owned(),
            );
        }
        if let Some(travel) = advice.travel_turns
            && travel > f64::from(self.variant.revolutions()) / 2.0
        {
            warnings.push(format!(
                "the travel takes {travel:.1} of {} turns: little is left on both sides of it",
                self.variant.revolutions()
            ));
        }
        warnings
    }
}

/// A number with so many digits that count, and no zeros behind them.
pub fn digits(number: f64, count: i32) -> String {
    if number == 0.0 {
        return "0".to_owned();
    }
    #[expect(clippy::cast_possible_truncation, reason = "an exponent of ten")]
    let behind = (count - 1 - number.abs().log10().floor() as i32).clamp(0, 17);
    let text = format!("{number:.*}", usize::try_from(behind).unwrap_or(0));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded before")]
fn whole(number: f64) -> Option<u32> {
    (number >= 0.0 && number <= f64::from(u32::MAX)).then_some(number as u32)
}

const fn gcd(one: u32, other: u32) -> u32 {
    if other == 0 { one } else { gcd(other, one % other) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(per_turn: f64, gear: (u32, u32), travel: Option<f64>, resolution: f64) -> Machine {
        Machine {
            variant: Variant::FULL,
            unit: "m".to_owned(),
            per_turn,
            gear: Gear { encoder: gear.0, machine: gear.1 },
            travel,
            resolution,
        }
    }

    fn near(one: f64, other: f64) -> bool {
        (one - other).abs() <= other.abs() * 1e-9
    }

    // 1.2 m in 3 turns of the encoder are 0.4 m each: 400 steps of 1 mm. 50 m are 125 turns; 128 are 51.2 m.
    #[test]
    fn a_hoist_gets_whole_units_and_a_range_that_does_not_jump() {
        let advice = machine(1.2, (3, 1), Some(50.0), 0.001).advise().expect("a scaling");
        let plan = &advice.plan;
        assert_eq!((plan.units_per_revolution.value, plan.total_range.value), (400, 51_200));
        assert!(near(advice.travel_turns.expect("turns"), 125.0) && near(advice.range, 51.2), "{advice:?}");
        assert!(advice.creep == 0.0 && near(advice.step, 0.001) && near(advice.exact_step, 0.001));
        assert_eq!(plan.consequences.as_ref().expect("allowed").jump, 0);
        assert!(advice.overflow.contains("does not jump") && advice.warnings.is_empty(), "{advice:?}");
    }

    // A third of a metre a turn: 333 steps of 1 mm leave 0.333 mm a turn, 50 mm in 150 turns. 33333 steps of 0.01 mm
    // leave a hundredth of that a turn, 0.5 mm: half of the millimetre that was asked for.
    #[test]
    fn an_uneven_ratio_gets_finer_steps_until_it_no_longer_creeps() {
        let advice = machine(1.0, (3, 1), Some(50.0), 0.001).advise().expect("a scaling");
        assert_eq!(advice.plan.units_per_revolution.value, 33_333);
        assert!(near(advice.step, 0.000_01) && near(advice.exact_step, 1.0 / 3.0 / 33_333.0));
        assert!((advice.creep - 0.000_5).abs() < 1e-6, "{}", advice.creep);
        assert!(advice.warnings[0].starts_with("creep: 33333 steps of 0.00001 m"), "{:?}", advice.warnings);
        // With 13 bits 8192 is the most: 6667 steps of 0.05 mm are 0.01667 mm too many a turn, 2.5 mm in all.
        let coarse =
            Machine { variant: "13x12".parse().expect("bits"), ..machine(1.0, (3, 1), Some(50.0), 0.001) };
        let coarse = coarse.advise().expect("a scaling");
        assert_eq!(coarse.plan.units_per_revolution.value, 6_667);
        assert!((coarse.creep - 0.002_5).abs() < 1e-6, "{}", coarse.creep);
    }

    // A table with a gear of 9:2 and steps of 0.2 degrees: 1800 a turn; 400 steps in a turn of the encoder are 1800 in
    // 4.5. 32768 x 400 mod 1800 = 13107200 - 7281 x 1800 = 1400.
    #[test]
    fn what_turns_on_and_on_has_whole_steps_and_is_told_of_the_jump() {
        let table = machine(360.0, (9, 2), None, 0.2);
        let advice = table.advise().expect("a scaling");
        let plan = &advice.plan;
        assert_eq!((plan.units_per_revolution.value, plan.total_range.value), (400, 1_800));
        assert_eq!(plan.consequences.as_ref().expect("allowed").jump, 1_400);
        assert!(advice.creep == 0.0 && advice.overflow.starts_with("it matters"), "{advice:?}");
        assert!(advice.overflow.contains("7281.8 of the machine"), "{}", advice.overflow);
        // 1804 steps with that gear are no multiple of 9: the next is 1809, 402 in a turn of the encoder.
        let arm = Machine { resolution: 360.0 / 1804.0, ..table };
        let arm = arm.advise().expect("a scaling");
        assert_eq!((arm.plan.units_per_revolution.value, arm.plan.total_range.value), (402, 1_809));
        let even = machine(360.0, (4, 1), None, 0.1).advise().expect("a scaling");
        assert_eq!((even.plan.units_per_revolution.value, even.plan.total_range.value), (900, 3_600));
        assert!(even.overflow.contains("does not jump"), "{}", even.overflow);
    }

    #[test]
    fn what_cannot_be_says_what_to_change() {
        let error = |machine: Machine| machine.advise().expect_err("impossible").to_string();
        let single =
            Machine { variant: "13x0".parse().expect("bits"), ..machine(1.0, (1, 1), Some(2.0), 0.001) };
        assert!(error(single).contains("2.0 turns of the encoder, but it tells only 1 apart"));
        assert!(error(machine(1.0, (1, 1), Some(2.0), 0.000_001)).contains("65536 steps"));
        assert!(error(machine(1.0, (1, 1), Some(20.0), 3.0)).contains("longer than a turn"));
        // 65537 turns of the encoder for one: 65537 steps at least, 1 in a turn of the encoder; that can be had. With 65537
        // turns of the machine a turn of the encoder would need as many.
        assert!(error(machine(1.0, (1, 65_537), None, 60_000.0)).contains("coarser step"));
        let full = machine(1.0, (1, 1), Some(32_768.0), 1.0).advise().expect("just enough");
        assert_eq!(full.plan.total_range.value, 32_768);
        assert!(full.warnings.iter().any(|warning| warning.contains("little is left")), "{full:?}");
    }

    #[test]
    fn numbers_are_told_with_the_digits_that_count() {
        for (number, text) in
            [(0.0, "0"), (1.0, "1"), (0.000_01, "0.00001"), (1.0 / 3.0, "0.333333"), (1234.5, "1234.5")]
        {
            assert_eq!(digits(number, 6), text);
        }
    }

    // The manual's arithmetic, reference vector E121: 32768 x 360 mod 1804 = 124.
    #[test]
    fn a_chosen_scaling_is_judged_for_the_travel() {
        let hoist = machine(0.36, (1, 1), Some(7.2), 0.001);
        let advice = Chosen { machine: hoist.clone(), wish: Wish::scaled(Variant::FULL, 360, 1_804) }.judge();
        assert_eq!(advice.plan.consequences.as_ref().expect("allowed").jump, 124);
        // 20 turns of 32768: 16374 on both sides.
        assert!(advice.overflow.contains("jumps by 124 units"), "{}", advice.overflow);
        assert!(advice.overflow.contains("at 16384 turns") && advice.overflow.contains("16374.0 are left"));
        assert!(advice.creep == 0.0, "{advice:?}");
        // 1.804 m of range for 7.2 m of travel.
        assert!(
            advice.warnings.iter().any(|warning| warning.contains("positions repeat")),
            "{:?}",
            advice.warnings
        );
        let even = Chosen { machine: hoist, wish: Wish::scaled(Variant::FULL, 360, 11_520) }.judge();
        assert!(even.overflow.contains("does not jump") && even.warnings.is_empty(), "{even:?}");
    }

    // An arm with a gear of 5:1: 361 units a turn of the encoder are 1805 in one of the arm, but the range is 1804.
    #[test]
    fn a_range_that_is_no_turn_of_the_machine_creeps() {
        let arm = machine(360.0, (5, 1), None, 0.2);
        let judged = |units, range| {
            let advice =
                Chosen { machine: arm.clone(), wish: Wish::scaled(Variant::FULL, units, range) }.judge();
            advice.warnings.into_iter().find(|warning| warning.contains("zero point"))
        };
        let creep = judged(361, 1_804).expect("a warning");
        assert!(
            creep.contains("has 1805 units, but the range is 1804") && creep.contains("creeps by 1 units"),
            "{creep}"
        );
        assert_eq!(judged(361, 1_805), None);
        assert_eq!(judged(361, 3_610), None, "two turns");
    }
}
