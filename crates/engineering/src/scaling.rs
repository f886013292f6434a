//! What measuring units and a total measuring range mean, before anybody parameterizes them
//! (manual 4.1.1 to 4.1.3).

mod machine;

use std::fmt::Write;

pub use machine::{Advice, Chosen, Gear, Machine, MachineError, digits};

use sch108bex::functionality::Functionality;
use sch108bex::parameterization::{ParameterLength, Parameters};
use sch108bex::refusal::PrmRefusal;
use sch108bex::scaling::Scaling;
use sch108bex::specification::Variant;
use serde::Serialize;

/// A scaling as somebody wants it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wish {
    /// The encoder that it is for.
    pub variant: Variant,
    /// Measuring units per revolution, any number.
    pub units: u32,
    /// Total measuring range in units, any number.
    pub range: u32,
    /// Octet 9 bit 3: without it the two are ignored, and positions are physical steps.
    pub scaling: bool,
}

/// Everything that there is to say about a [`Wish`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Singleturn x multiturn bits.
    pub bits: String,
    /// Octets 10-13 of Set_Prm.
    pub units_per_revolution: Number,
    /// Octets 14-17 of Set_Prm.
    pub total_range: Number,
    /// Whether scaling is on; off, the numbers above are ignored, and what follows is for physical steps.
    pub scaling: bool,
    /// Whether the device takes it.
    pub allowed: bool,
    /// Why not, in sentences with the manual's section.
    pub refusals: Vec<String>,
    /// What follows from it; only if it is allowed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub consequences: Option<Consequences>,
}

/// A number in the forms that tools ask for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Number {
    /// Decimal.
    pub value: u32,
    /// Eight hexadecimal digits.
    pub hex: String,
    /// The upper 16 bits, for tools that know no double words.
    pub high_word: u16,
    /// The lower 16 bits.
    pub low_word: u16,
}

/// What an allowed scaling does.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Consequences {
    /// Revolutions until the position begins again at 0: range / units.
    pub revolutions: f64,
    /// Revolutions that the encoder tells apart: 2^m.
    pub physical_revolutions: u32,
    /// Physical steps in one unit: 2^n / units.
    pub steps_per_unit: f64,
    /// Degrees of the shaft in one unit.
    pub degrees_per_unit: f64,
    /// Positions go from 0 to this one.
    pub highest_position: u32,
    /// Set if the position never comes to the end of the range: it is longer than all revolutions.
    pub range_is_reached: bool,
    /// `(2^m * units) mod range`: by so many units the position jumps where the turn count begins
    /// again. 0: it does not jump.
    pub jump: u32,
    /// Turns from the physical zero point to there, in either direction.
    pub jump_after_turns: u32,
    /// What to beware of, in sentences.
    pub warnings: Vec<String>,
    /// Set_Prm from octet 9 on, class 2: octets 9 to 25.
    pub set_prm_class_2: String,
    /// Set_Prm from octet 9 on, Scancon 2.0 with the default time base: octets 9 to 26.
    pub set_prm_scancon_2: String,
    /// The same from octet 8 on as a GSD file has it: constants of a module of class 2.
    pub gsd_class_2: String,
    /// Likewise of Scancon 2.0.
    pub gsd_scancon_2: String,
}

impl Number {
    fn new(value: u32) -> Self {
        let [high, low] = [value >> 16, value & 0xFFFF].map(|word| u16::try_from(word).unwrap_or(u16::MAX));
        Self { value, hex: format!("{value:08X}"), high_word: high, low_word: low }
    }
}

impl Wish {
    /// Octets 9 to 25 or 26 of a Set_Prm, or all its octets from 1 on: the way back.
    ///
    /// # Errors
    ///
    /// A sentence that says which octets are needed.
    pub fn from_set_prm(octets: &[u8], variant: Variant) -> Result<Self, String> {
        let from_octet_9 = match octets.len() {
            17 | 18 => octets,
            25 | 26 => &octets[8..],
            other => {
                return Err(format!(
                    "{other} octets, but scaling stands in Set_Prm of class 2 and Scancon 2.0: write octets 9 to \
                     25 or 26 (17 or 18 octets), or all from octet 1 on (25 or 26 octets)"
                ));
            }
        };
        let double_word = |at: usize| {
            from_octet_9[at..at + 4].iter().fold(0, |value: u32, octet| (value << 8) | u32::from(*octet))
        };
        let scaling = from_octet_9[0] & 0x08 != 0;
        Ok(Self { variant, units: double_word(1), range: double_word(5), scaling })
    }

    /// A scaling that is on.
    pub const fn scaled(variant: Variant, units: u32, range: u32) -> Self {
        Self { variant, units, range, scaling: true }
    }

    /// What the device counts by: physical steps where scaling is off.
    fn in_force(&self) -> Self {
        if self.scaling {
            return *self;
        }
        Self { units: self.variant.steps_per_revolution(), range: self.variant.total(), ..*self }
    }

    /// All of a Set_Prm from octet 1 on, in hexadecimal: locked, watchdog 1 s, min T_SDR 11.
    pub fn whole_set_prm(&self, ident: u16, functionality: Functionality) -> String {
        let [high, low] = ident.to_be_bytes();
        let rest = self.set_prm(functionality.parameter_length(), " ");
        format!("88 01 64 0B {high:02X} {low:02X} 00 00 {rest}")
    }

    fn parameters(&self, length: ParameterLength) -> Parameters {
        Parameters {
            length,
            scaling: self.scaling,
            measuring_units_per_revolution: self.units,
            total_measuring_range: self.range,
            ..Parameters::default_for(self.variant)
        }
    }

    /// Works it out.
    pub fn plan(&self) -> Plan {
        let refusals = self.refusals();
        Plan {
            bits: self.variant.to_string(),
            units_per_revolution: Number::new(self.units),
            total_range: Number::new(self.range),
            scaling: self.scaling,
            allowed: refusals.is_empty(),
            consequences: refusals.is_empty().then(|| self.consequences()),
            refusals,
        }
    }

    /// Both limits, as the device words them.
    fn refusals(&self) -> Vec<String> {
        if !self.scaling {
            return Vec::new();
        }
        let limits = [
            (
                self.units,
                self.variant.steps_per_revolution(),
                PrmRefusal::MeasuringUnits { value: self.units, variant: self.variant },
            ),
            (
                self.range,
                self.variant.total(),
                PrmRefusal::MeasuringRange { value: self.range, variant: self.variant },
            ),
        ];
        limits
            .into_iter()
            .filter(|(value, most, _)| *value == 0 || value > most)
            .map(|(_, _, refusal)| refusal.to_string())
            .collect()
    }

    fn consequences(&self) -> Consequences {
        let in_force = self.in_force();
        let mut consequences = in_force.consequences_in_force();
        if !self.scaling {
            let Self { units, range, .. } = self;
            let off = format!(
                "scaling is off (octet 9 bit 3 is 0): {units} units and a range of {range} are ignored, and positions are \
                 physical steps; set the bit, 0A or 0B in octet 9, to scale"
            );
            consequences.warnings.insert(0, off);
            consequences.set_prm_class_2 = self.set_prm(ParameterLength::TwentyFive, " ");
            consequences.set_prm_scancon_2 = self.set_prm(ParameterLength::TwentySix, " ");
            consequences.gsd_class_2 = self.gsd(ParameterLength::TwentyFive);
            consequences.gsd_scancon_2 = self.gsd(ParameterLength::TwentySix);
        }
        consequences
    }

    fn consequences_in_force(&self) -> Consequences {
        let parameters = self.parameters(ParameterLength::TwentySix);
        let scaling = Scaling::in_force(self.variant, Functionality::Scancon2, &parameters);
        let turns = self.variant.revolutions();
        let units_in_all = u64::from(turns) * u64::from(self.units);
        let range_is_reached = units_in_all >= u64::from(self.range);
        let reachable = units_in_all.min(u64::from(self.range)) - 1;
        let jump = scaling.overflow_residual();
        let mut consequences = Consequences {
            revolutions: f64::from(self.range) / f64::from(self.units),
            physical_revolutions: turns,
            steps_per_unit: f64::from(self.variant.steps_per_revolution()) / f64::from(self.units),
            degrees_per_unit: 360.0 / f64::from(self.units),
            highest_position: u32::try_from(reachable).unwrap_or(u32::MAX),
            range_is_reached,
            jump,
            jump_after_turns: turns,
            warnings: Vec::new(),
            set_prm_class_2: self.set_prm(ParameterLength::TwentyFive, " "),
            set_prm_scancon_2: self.set_prm(ParameterLength::TwentySix, " "),
            gsd_class_2: self.gsd(ParameterLength::TwentyFive),
            gsd_scancon_2: self.gsd(ParameterLength::TwentySix),
        };
        consequences.warnings = self.warnings(&consequences);
        consequences
    }

    fn warnings(&self, consequences: &Consequences) -> Vec<String> {
        let mut warnings = Vec::new();
        let Consequences { jump, jump_after_turns: turns, .. } = *consequences;
        if !consequences.range_is_reached {
            warnings.push(format!(
                "the range is never reached: {turns} turns have {} units, then the position begins again at 0",
                u64::from(turns) * u64::from(self.units)
            ));
        } else if jump != 0 {
            warnings.push(format!(
                "every {turns} turns, at the physical zero point, the position jumps by {jump} units: {} is followed \
                 by 0 (a preset shifts both); a range that divides {} does not jump",
                jump - 1,
                u64::from(turns) * u64::from(self.units)
            ));
        }
        if self.range < self.units {
            warnings
                .push("the range is shorter than one revolution: positions repeat within a turn".to_owned());
        }
        warnings
    }

    fn set_prm(&self, length: ParameterLength, between: &str) -> String {
        let mut set_prm = [0; 26];
        let octets = self.parameters(length).emit(&mut set_prm);
        let mut text = String::new();
        for octet in &set_prm[8..octets] {
            let _ = write!(text, "{}{octet:02X}", if text.is_empty() { "" } else { between });
        }
        text
    }

    /// The constants of a module, octet 8 first.
    fn gsd(&self, length: ParameterLength) -> String {
        format!("Ext_User_Prm_Data_Const(0) = 0x00,0x{}", self.set_prm(length, ",0x"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(bits: &str, units: u32, range: u32) -> Plan {
        Wish::scaled(bits.parse().expect("bits"), units, range).plan()
    }

    fn vectors(category: &str) -> Vec<serde_json::Value> {
        let all: serde_json::Value =
            serde_json::from_str(include_str!("../../sch108bex/tests/data/encoder-vectors.json"))
                .expect("JSON");
        let vectors = all["vectors"].as_array().expect("vectors").iter();
        vectors.filter(|vector| vector["category"] == category).cloned().collect()
    }

    fn small(value: &serde_json::Value) -> u32 {
        u32::try_from(value.as_u64().expect("a number")).expect("32 bits")
    }

    #[test]
    fn residuals_are_those_of_the_vectors() {
        let mut seen = 0;
        for vector in vectors("scaling") {
            let input = &vector["input"];
            let bits = format!("{}x{}", input["n"], input["m"]);
            let plan = plan(&bits, small(&input["mur"]), small(&input["tmr"]));
            let consequences = plan.consequences.expect("allowed");
            assert_eq!(
                consequences.jump,
                small(&vector["expected"]["overflow_residual"]),
                "{}",
                vector["id"]
            );
            let warned = consequences.warnings.iter().any(|warning| warning.contains("jumps by"));
            assert_eq!(warned, consequences.jump != 0, "{}", vector["id"]);
            seen += 1;
        }
        assert_eq!(seen, 12);
    }

    #[test]
    fn the_jump_test_of_the_vectors() {
        let vector = vectors("overflow").into_iter().find(|vector| vector["id"] == "E121").expect("E121");
        let pairs = vector["input"]["mur_and_tmr"].as_array().expect("pairs");
        let residuals = vector["expected"]["residuals"].as_array().expect("residuals");
        assert_eq!((pairs.len(), residuals.len()), (5, 5));
        for (pair, residual) in pairs.iter().zip(residuals) {
            let plan = plan("16x15", small(&pair[0]), small(&pair[1]));
            assert_eq!(plan.consequences.expect("allowed").jump, small(residual), "{pair}");
        }
    }

    // E119: 100 units, 5000 in all: 1799 is followed by 0, after 32768 turns.
    #[test]
    fn the_jump_is_told_with_both_positions_and_the_turns() {
        let consequences = plan("16x15", 100, 5_000).consequences.expect("allowed");
        assert_eq!((consequences.jump, consequences.jump_after_turns), (1_800, 32_768));
        assert_eq!(consequences.warnings.len(), 1);
        assert!(consequences.warnings[0].contains("jumps by 1800 units: 1799 is followed by 0"));
        assert!(consequences.warnings[0].contains("32768 turns"));
    }

    // Vectors E055, E058 with the default time base; octets 9 to 26.
    #[test]
    fn the_octets_are_the_manuals() {
        let consequences = plan("16x15", 4_096, 134_217_728).consequences.expect("allowed");
        assert_eq!(consequences.set_prm_class_2, "0A 00 00 10 00 08 00 00 00 00 00 00 00 00 00 00 00");
        assert_eq!(consequences.set_prm_scancon_2, "0A 00 00 10 00 08 00 00 00 00 00 00 00 00 00 00 00 01");
        assert!(consequences.warnings.is_empty(), "{:?}", consequences.warnings);
    }

    // Profile notes 6.2: 12 800 000 is 195 / 20 480 for tools without double words.
    #[test]
    fn high_and_low_words_are_decimal() {
        let number = plan("13x12", 4_000, 12_800_000).total_range;
        assert_eq!((number.high_word, number.low_word, number.hex.as_str()), (195, 20_480, "00C35000"));
    }

    // E061, E062, E064, E065.
    #[test]
    fn limits_are_the_manuals() {
        for (units, range, section) in
            [(0, 16, "4.1.2"), (65_537, 16, "4.1.2"), (65_536, 0x8000_0001, "4.1.3"), (65_536, 0, "4.1.3")]
        {
            let plan = plan("16x15", units, range);
            assert!(!plan.allowed && plan.consequences.is_none());
            assert!(plan.refusals.len() == 1 && plan.refusals[0].contains(section), "{:?}", plan.refusals);
        }
        assert!(plan("16x15", 65_536, 0x8000_0000).allowed);
        assert_eq!(plan("16x15", 0, 0).refusals.len(), 2, "both are told");
    }

    #[test]
    fn resolution_is_told_per_unit() {
        let consequences = plan("16x15", 3_600, 7_200).consequences.expect("allowed");
        assert!((consequences.degrees_per_unit - 0.1).abs() < 1e-12);
        assert!((consequences.steps_per_unit - 18.204_444_444).abs() < 1e-6);
        assert!((consequences.revolutions - 2.0).abs() < 1e-12);
        assert_eq!(consequences.highest_position, 7_199);
    }

    #[test]
    fn a_range_beyond_all_turns_is_told() {
        let consequences = plan("13x0", 100, 8_192).consequences.expect("allowed");
        assert!(!consequences.range_is_reached);
        assert_eq!(consequences.highest_position, 99);
        assert!(consequences.warnings[0].contains("never reached"), "{:?}", consequences.warnings);
        assert!(!consequences.warnings.iter().any(|warning| warning.contains("jumps")));
        let short = plan("13x12", 100, 50).consequences.expect("allowed");
        assert!(short.warnings.iter().any(|warning| warning.contains("within a turn")));
    }

    #[test]
    fn the_way_back_reads_either_form() {
        let variant = Variant::FULL;
        let from_9 = [0x0A, 0, 0, 0x10, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
        let whole = [&[0x88, 1, 0x14, 0x0B, 0x10, 0x8B, 0, 0][..], &from_9].concat();
        let wish = Wish::scaled(variant, 4_096, 134_217_728);
        for octets in [&from_9[..], &from_9[..17], &whole, &whole[..25]] {
            assert_eq!(Wish::from_set_prm(octets, variant), Ok(wish));
        }
        for length in [0, 1, 9, 16, 19, 24, 27] {
            assert!(
                Wish::from_set_prm(&vec![0; length], variant)
                    .expect_err("a wrong length")
                    .contains("write octets")
            );
        }
    }

    #[test]
    fn with_scaling_off_everything_is_allowed_and_positions_are_physical_steps() {
        // Octet 9 is 02: class 2, no scaling; 0 units and a range of 7 would be refused.
        let from_9 = [0x02, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 0];
        let wish = Wish::from_set_prm(&from_9, "13x12".parse().expect("bits")).expect("17 octets");
        let plan = wish.plan();
        assert!(plan.allowed && !plan.scaling, "{plan:?}");
        let consequences = plan.consequences.expect("allowed");
        assert_eq!((consequences.highest_position, consequences.jump), ((1 << 25) - 1, 0));
        assert!(consequences.warnings[0].starts_with("scaling is off"), "{:?}", consequences.warnings);
        assert!(consequences.set_prm_class_2.starts_with("02 00 00 00 00 00 00 00 07"), "{consequences:?}");
    }

    // 3600 = 0E10h, 7200 = 1C20h.
    #[test]
    fn a_set_prm_and_the_constants_of_a_gsd_are_ready_to_be_used() {
        let wish = Wish::scaled(Variant::FULL, 3_600, 7_200);
        assert_eq!(
            wish.whole_set_prm(0x4711, Functionality::Scancon2),
            "88 01 64 0B 47 11 00 00 0A 00 00 0E 10 00 00 1C 20 00 00 00 00 00 00 00 00 01"
        );
        let consequences = wish.plan().consequences.expect("allowed");
        assert_eq!(
            consequences.gsd_class_2,
            "Ext_User_Prm_Data_Const(0) = 0x00,0x0A,0x00,0x00,0x0E,0x10,0x00,0x00,0x1C,0x20,0x00,0x00,0x00,0x00,0x00,0x00,\
             0x00,0x00"
        );
        assert!(consequences.gsd_scancon_2.ends_with(",0x00,0x01"));
    }
}
