//! `sch108bex scaling`: what measuring units and a range mean, before a master is told them.

use std::fmt::Write;

use clap::Args;
use engineering::scaling::{Consequences, Number, Plan, Wish};
use sch108bex::specification::Variant;

use crate::arguments::whole;
use crate::{Failure, output};

/// The options of `scaling`.
#[derive(Debug, Args)]
#[command(after_help = "Status: 0 if the device takes it, 1 if not.")]
pub(crate) struct Scaling {
    /// Measuring units per revolution
    #[arg(long, value_name = "N", required_unless_present = "set_prm", value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true)]
    units: Option<u32>,
    /// Total measuring range in units; without it, all revolutions of the encoder
    #[arg(long, value_name = "N", conflicts_with = "revolutions", value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true)]
    range: Option<u32>,
    /// The range as so many whole revolutions
    #[arg(long, value_name = "N", value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true)]
    revolutions: Option<u32>,
    /// The way back: units and range out of the octets of a Set_Prm, from octet 9 or from octet 1 on
    #[arg(long, value_name = "HEX", conflicts_with_all = ["units", "range", "revolutions"])]
    set_prm: Option<String>,
    /// Singleturn x multiturn bits, 2x0 to 16x15
    #[arg(long, value_name = "NxM", default_value = "16x15")]
    bits: Variant,
    /// One document
    #[arg(long)]
    json: bool,
}

impl Scaling {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let plan = self.wish().map_err(Failure::Usage)?.plan();
        if self.json {
            output::json(&plan);
        } else {
            output::text(&table(&plan));
        }
        if plan.allowed {
            return Ok(());
        }
        Err(Failure::Failed(format!("the device would refuse it: {}", plan.refusals.join("; "))))
    }

    fn wish(&self) -> Result<Wish, String> {
        if let Some(text) = &self.set_prm {
            let octets = dissector::hex::octets(text).map_err(|error| format!("--set-prm: {error}"))?;
            return Wish::from_set_prm(&octets, self.bits).map_err(|error| format!("--set-prm: {error}"));
        }
        let units = self.units.unwrap_or_default();
        let revolutions = self.revolutions.unwrap_or(self.bits.revolutions());
        let range = self.range.or_else(|| units.checked_mul(revolutions)).ok_or_else(|| {
            format!(
                "{units} units in each of {revolutions} revolutions are more than 32 bits hold; \
                 write a smaller --units, --revolutions or --range"
            )
        })?;
        Ok(Wish { variant: self.bits, units, range })
    }
}

fn table(plan: &Plan) -> String {
    let mut text = format!("encoder              {} bits\n", plan.bits);
    for (name, number) in
        [("units per revolution", &plan.units_per_revolution), ("total range", &plan.total_range)]
    {
        let Number { value, hex, high_word, low_word } = number;
        let _ = writeln!(text, "{name:20} {value} = {hex}h, high word {high_word}, low word {low_word}");
    }
    if let Some(consequences) = &plan.consequences {
        text.push_str(&told(consequences));
    }
    text
}

fn told(consequences: &Consequences) -> String {
    let Consequences { revolutions, physical_revolutions, highest_position, .. } = consequences;
    let Consequences { degrees_per_unit, steps_per_unit, jump, .. } = consequences;
    let mut text = format!(
        "allowed              yes\n\
         one unit             {degrees_per_unit:.6} degrees, {steps_per_unit:.3} physical steps\n\
         positions            0 to {highest_position}, the range is {revolutions:.3} of {physical_revolutions} revolutions\n\
         jump                 {}\n\
         Set_Prm octets 9-25  {} (class 2)\n\
         Set_Prm octets 9-26  {} (Scancon 2.0, steps per 100 ms)\n",
        if *jump == 0 {
            "none".to_owned()
        } else {
            format!("{jump} units after {} turns", consequences.jump_after_turns)
        },
        consequences.set_prm_class_2,
        consequences.set_prm_scancon_2,
    );
    for warning in &consequences.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}
