//! Units of the machine that an encoder is on: metres of rope, degrees, millimetres.

use std::f64::consts::PI;

use sch108bex::specification::Variant;
use serde::{Deserialize, Serialize};

/// How turns of the shaft become units of the machine. Plain arithmetic, the same on every computer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// What the unit is called, such as `m` or `deg`.
    #[serde(default = "metres")]
    pub unit: String,
    /// The physical position in counts where the machine is at 0.
    #[serde(default)]
    pub zero: i64,
    /// Units for one turn clockwise; negative where it goes the other way. Not with a drum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub per_turn: Option<f64>,
    /// A drum on which rope is wound in layers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drum: Option<Drum>,
}

/// A drum with rope in layers. Lengths are in the unit of the machine; each layer adds twice the
/// thickness of the rope to the diameter, and clockwise winds up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drum {
    /// Of the bare drum.
    pub drum_diameter: f64,
    /// Of the rope.
    pub rope_diameter: f64,
    /// Turns of rope side by side.
    pub turns_per_layer: f64,
    /// Turns that are on the drum where the machine is at 0.
    #[serde(default)]
    pub wound_turns: f64,
    /// Lines strung between the blocks: the hook moves by so much less than the rope.
    #[serde(default = "one")]
    pub lines: f64,
}

fn metres() -> String {
    "m".to_owned()
}

const fn one() -> f64 {
    1.0
}

/// More layers than on any drum, so that nothing goes on for ever.
const MOST_LAYERS: u32 = 1_000;

impl Machine {
    /// So many units for a turn.
    pub fn linear(unit: &str, per_turn: f64) -> Self {
        Self { unit: unit.to_owned(), zero: 0, per_turn: Some(per_turn), drum: None }
    }

    /// Refuses what is no machine.
    ///
    /// # Errors
    ///
    /// A sentence that says what to write instead.
    pub fn check(&self) -> Result<(), String> {
        let positive = |name: &str, value: f64| {
            if value.is_finite() && value > 0.0 { Ok(()) } else { Err(format!("{name} is a number above 0")) }
        };
        match (self.per_turn, self.drum) {
            (Some(per_turn), None) if per_turn.is_finite() && per_turn != 0.0 => Ok(()),
            (Some(_), None) => Err("per_turn is a number, and not 0".to_owned()),
            (None, Some(drum)) => {
                positive("drum_diameter", drum.drum_diameter)?;
                positive("rope_diameter", drum.rope_diameter)?;
                positive("turns_per_layer", drum.turns_per_layer)?;
                positive("lines", drum.lines)?;
                if drum.wound_turns.is_finite() && drum.wound_turns >= 0.0 {
                    Ok(())
                } else {
                    Err("wound_turns is a number from 0".to_owned())
                }
            }
            _ => Err("a machine has either per_turn, the units for one turn, or a drum".to_owned()),
        }
    }

    /// The units of so many turns from zero.
    pub fn units(&self, turns: f64) -> f64 {
        match self.drum {
            Some(drum) => {
                let bare = drum.rope(drum.wound_turns);
                (drum.rope(drum.wound_turns + turns) - bare) / drum.lines
            }
            None => turns * self.per_turn.unwrap_or(1.0),
        }
    }

    /// The turns from zero for so many units.
    pub fn turns(&self, units: f64) -> f64 {
        match self.drum {
            Some(drum) => {
                let bare = drum.rope(drum.wound_turns);
                drum.turns(units * drum.lines + bare) - drum.wound_turns
            }
            None => units / self.per_turn.unwrap_or(1.0),
        }
    }

    /// Turns for one unit at this place.
    pub(crate) fn turns_per_unit(&self, units: f64) -> f64 {
        match self.drum {
            Some(drum) => {
                let (layer, _) = drum.layer(drum.turns(units * drum.lines + drum.rope(drum.wound_turns)));
                drum.lines / drum.around(layer)
            }
            None => 1.0 / self.per_turn.unwrap_or(1.0),
        }
    }

    /// The most turns for one unit at any place: with a drum, those of the first layer.
    pub(crate) fn most_turns_per_unit(&self) -> f64 {
        match self.drum {
            Some(drum) => drum.lines / drum.around(0),
            None => (1.0 / self.per_turn.unwrap_or(1.0)).abs(),
        }
    }

    /// The units at a physical position, turns included.
    #[expect(clippy::cast_precision_loss, reason = "positions stay far below 2^53")]
    pub fn position(&self, raw: i64, variant: Variant) -> f64 {
        let steps = f64::from(variant.steps_per_revolution());
        self.units((raw.wrapping_sub(self.zero)) as f64 / steps)
    }

    /// The physical position in counts at these units.
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    pub fn raw(&self, units: f64, variant: Variant) -> i64 {
        let steps = f64::from(variant.steps_per_revolution());
        self.zero.saturating_add((self.turns(units) * steps + 0.5).floor() as i64)
    }

    /// The layer that is being wound, from 1; `None` without a drum.
    pub fn rope_layer(&self, raw: i64, variant: Variant) -> Option<u32> {
        let drum = self.drum?;
        let rope = self.position(raw, variant) * drum.lines + drum.rope(drum.wound_turns);
        Some(drum.layer(drum.turns(rope)).0 + 1)
    }
}

impl Drum {
    /// Rope for one turn in a layer, from 0.
    fn around(&self, layer: u32) -> f64 {
        PI * (self.drum_diameter + self.rope_diameter * f64::from(2 * layer + 1))
    }

    /// The layer, from 0, of the rope's end after so many turns, and the turns in the layers below.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the limit")]
    fn layer(&self, turns: f64) -> (u32, f64) {
        let layer = (turns / self.turns_per_layer).floor().clamp(0.0, f64::from(MOST_LAYERS));
        (layer as u32, layer * self.turns_per_layer)
    }

    /// The rope in so many whole layers.
    fn full(&self, layers: u32) -> f64 {
        let layers = f64::from(layers);
        // The diameters are D + d, D + 3 d, D + 5 d: their sum is n D + n^2 d.
        PI * self.turns_per_layer * layers * (self.drum_diameter + layers * self.rope_diameter)
    }

    /// The rope on the drum after so many turns.
    fn rope(&self, turns: f64) -> f64 {
        let (layer, below) = self.layer(turns);
        self.full(layer) + (turns - below) * self.around(layer)
    }

    /// The turns after which so much rope is on the drum.
    fn turns(&self, rope: f64) -> f64 {
        // The root of n^2 d + n D = rope / (pi t) is the layer; rounding can miss it by one.
        let [d, rope_d] = [self.drum_diameter, self.rope_diameter];
        let area = rope.max(0.0) / (PI * self.turns_per_layer);
        let near = ((d * d + 4.0 * rope_d * area).sqrt() - d) / (2.0 * rope_d);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the limit"
        )]
        let mut layer = near.floor().clamp(0.0, f64::from(MOST_LAYERS)) as u32;
        while layer > 0 && self.full(layer) > rope {
            layer -= 1;
        }
        while layer < MOST_LAYERS && self.full(layer + 1) <= rope {
            layer += 1;
        }
        f64::from(layer) * self.turns_per_layer + (rope - self.full(layer)) / self.around(layer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drum of 0.97 m with rope of 30 mm, ten turns a layer: the middle of the rope lies at 1.00 m
    /// in the first layer and at 1.06 m in the second.
    fn drum(wound_turns: f64, lines: f64) -> Machine {
        let drum =
            Drum { drum_diameter: 0.97, rope_diameter: 0.03, turns_per_layer: 10.0, wound_turns, lines };
        Machine { unit: "m".to_owned(), zero: 0, per_turn: None, drum: Some(drum) }
    }

    fn near(found: f64, due: f64) {
        assert!((found - due).abs() < 1e-9, "{found}, not {due}");
    }

    #[test]
    fn a_turn_in_the_second_layer_takes_more_rope() {
        let drum = drum(0.0, 1.0);
        near(drum.units(1.0), PI * 1.0);
        near(drum.units(10.0), PI * 10.0);
        near(drum.units(11.0), PI * 11.06);
        near(drum.units(20.0), PI * 20.6);
        near(drum.units(21.0), PI * (20.6 + 1.12));
        assert_eq!(drum.rope_layer(9 * 65_536, Variant::FULL), Some(1));
        assert_eq!(drum.rope_layer(11 * 65_536, Variant::FULL), Some(2));
    }

    #[test]
    fn lines_and_wound_turns_count() {
        let drum = drum(8.0, 4.0);
        near(drum.units(2.0), PI * 2.0 / 4.0);
        near(drum.units(3.0), PI * 3.06 / 4.0);
        near(drum.units(-8.0), -PI * 8.0 / 4.0);
    }

    #[test]
    fn turns_and_units_are_each_others_inverse_in_every_layer() {
        let drum = drum(3.5, 8.0);
        for quarter in -14..400 {
            let turns = f64::from(quarter) / 4.0;
            near(drum.turns(drum.units(turns)), turns);
        }
    }

    #[test]
    fn counts_become_units_and_back() {
        let mut degrees = Machine::linear("deg", 360.0);
        near(degrees.position(16_384, Variant::FULL), 90.0);
        assert_eq!(degrees.raw(90.0, Variant::FULL), 16_384);
        degrees.zero = 16_384;
        near(degrees.position(0, Variant::FULL), -90.0);
        assert_eq!(degrees.raw(-90.0, Variant::FULL), 0);
    }

    #[test]
    fn what_is_no_machine_is_told() {
        assert!(Machine::linear("m", 0.0).check().is_err());
        assert!(Machine::linear("m", f64::NAN).check().is_err());
        assert!(Machine { per_turn: None, ..Machine::linear("m", 1.0) }.check().is_err());
        assert!(Machine { per_turn: Some(1.0), ..drum(0.0, 1.0) }.check().is_err());
        assert!(drum(-1.0, 1.0).check().is_err());
        assert_eq!(drum(0.0, 10.0).check(), Ok(()));
    }
}
