//! `sch108bex scaling`: what measuring units and a range mean, before a master is told them; and which suit a machine.

use std::f64::consts::PI;
use std::fmt::Write;
use std::str::FromStr;

use clap::Args;
use engineering::scaling::{Advice, Chosen, Consequences, Gear, Machine, Number, Plan, Wish, digits};
use sch108bex::functionality::Functionality;
use sch108bex::specification::Variant;

use crate::arguments::{decimal, ident_number, whole};
use crate::{Failure, output};

/// The options of `scaling`.
#[derive(Debug, Args)]
#[command(
    after_help = "Give units and range to have them judged, what the machine is to have them worked out, or both to have them judged for it. Status: 0 if the device takes it, 1 if not."
)]
pub(crate) struct Scaling {
    /// Measuring units per revolution
    #[arg(long, value_name = "N", required_unless_present_any = ["set_prm", "rope_per_turn", "drum_diameter"], value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true)]
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
    #[command(flatten)]
    machine: MachineData,
    /// Singleturn x multiturn bits, 2x0 to 16x15
    #[arg(long, value_name = "NxM", default_value = "16x15")]
    bits: Variant,
    /// The ident number in the whole Set_Prm; that of your GSD
    #[arg(long, value_name = "0xHHHH", value_parser = ident_number, default_value = "0x108B")]
    ident: u16,
    /// One document
    #[arg(long)]
    json: bool,
}

/// What the machine is.
#[derive(Debug, Args)]
struct MachineData {
    /// Rope, or any way of the machine, in one turn of the drum or wheel; 360 for a table in degrees
    #[arg(long, alias = "per-turn", value_name = "N", conflicts_with_all = ["set_prm", "drum_diameter"], value_parser = positive, allow_negative_numbers = true, help_heading = "Machine")]
    rope_per_turn: Option<f64>,
    /// Instead: the diameter of the bare drum
    #[arg(long, value_name = "N", conflicts_with = "set_prm", value_parser = positive, allow_negative_numbers = true, help_heading = "Machine")]
    drum_diameter: Option<f64>,
    /// With a drum: the diameter of the rope, whose middle lies by half of it outside the drum
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true, requires = "drum_diameter", help_heading = "Machine")]
    rope_diameter: Option<f64>,
    /// Lines strung between the blocks: the hook moves by so much less than the rope
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true, help_heading = "Machine")]
    lines: Option<f64>,
    /// Turns of the encoder to turns of the drum, such as 25:2 or 12.5
    #[arg(long, value_name = "E:M", default_value = "1:1", help_heading = "Machine")]
    gear: Ratio,
    /// From one end to the other; without it the machine turns on and on
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true, help_heading = "Machine")]
    travel: Option<f64>,
    /// One step shall be at most so much; beside --units: what a step is taken for
    #[arg(long, value_name = "N", required_unless_present_any = ["units", "set_prm"], value_parser = positive, allow_negative_numbers = true, help_heading = "Machine")]
    resolution: Option<f64>,
    /// What all of these are in
    #[arg(long, value_name = "NAME", default_value = "m", help_heading = "Machine")]
    unit: String,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = decimal(text)?;
    if number > 0.0 { Ok(number) } else { Err("write a number above 0, like 1.2566".to_owned()) }
}

/// Turns of the encoder to turns of the machine.
#[derive(Debug, Clone, Copy)]
struct Ratio(Gear);

impl FromStr for Ratio {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (encoder, machine) = text.split_once(':').unwrap_or((text, "1"));
        ratio(encoder, machine).ok_or_else(|| {
            "write turns of the encoder, a colon and turns of the drum, such as 25:2, or a number like 12.5".to_owned()
        })
    }
}

/// Decimals as whole numbers: 12.5 to 1 are 25 to 2.
fn ratio(encoder: &str, machine: &str) -> Option<Ratio> {
    const MOST_DIGITS: usize = 6;
    let parts = |text: &str| {
        let (whole, rest) = text.split_once('.').unwrap_or((text, ""));
        let digits = |text: &str| text.bytes().all(|digit| digit.is_ascii_digit());
        let fits = !whole.is_empty() && rest.len() <= MOST_DIGITS && digits(whole) && digits(rest);
        fits.then(|| format!("{whole}{rest:0<MOST_DIGITS$}").parse::<u64>().ok()).flatten()
    };
    let (encoder, machine) = (parts(encoder)?, parts(machine)?);
    let common = (1..).scan((encoder, machine), |(one, other), _: u32| {
        (*one, *other) = (*other, one.checked_rem(*other)?);
        Some(*one)
    });
    let common = common.last().filter(|common| *common > 0)?;
    let reduced = |number: u64| u32::try_from(number / common).ok().filter(|number| *number > 0);
    Some(Ratio(Gear { encoder: reduced(encoder)?, machine: reduced(machine)? }))
}

impl MachineData {
    /// Units of the machine in one turn of the drum, where it was described.
    fn per_turn(&self) -> Option<f64> {
        let drum = self.drum_diameter.map(|drum| PI * (drum + self.rope_diameter.unwrap_or(0.0)));
        Some(self.rope_per_turn.or(drum)? / self.lines.unwrap_or(1.0))
    }

    /// The machine; `units` in a turn of the encoder, where somebody has chosen them.
    fn machine(&self, variant: Variant, units: Option<u32>) -> Option<Machine> {
        let (per_turn, Ratio(gear)) = (self.per_turn()?, self.gear);
        let step = units
            .filter(|units| *units > 0)
            .map(|units| per_turn * f64::from(gear.machine) / f64::from(gear.encoder) / f64::from(units));
        let resolution = self.resolution.or(step)?;
        Some(Machine { variant, unit: self.unit.clone(), per_turn, gear, travel: self.travel, resolution })
    }

    /// What a length of rope that lies in layers makes of all this.
    fn note(&self) {
        if self.drum_diameter.is_some() {
            output::aside(
                "note: this is for one layer of rope; each further layer adds two diameters of the rope to that of the drum",
            );
        }
    }
}

impl Scaling {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let MachineData { travel, resolution, lines, .. } = self.machine;
        if self.machine.per_turn().is_none() && (travel.is_some() || resolution.is_some() || lines.is_some())
        {
            return Err(Failure::Usage(
                "say what one turn of the machine is: --rope-per-turn or --drum-diameter".to_owned(),
            ));
        }
        if let Some(machine) = self.machine.machine(self.bits, self.units) {
            let advice = if self.units.is_some() {
                Chosen { machine, wish: self.wish().map_err(Failure::Usage)? }.judge()
            } else {
                machine.advise().map_err(|error| Failure::Failed(error.to_string()))?
            };
            if self.json {
                output::json(&advice);
            } else {
                output::text(&format!("{}{}", advised(&advice), self.table(&advice.plan)));
            }
            self.machine.note();
            return verdict(&advice.plan);
        }
        let plan = self.wish().map_err(Failure::Usage)?.plan();
        if self.json {
            output::json(&plan);
        } else {
            output::text(&self.table(&plan));
        }
        verdict(&plan)
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
        Ok(Wish::scaled(self.bits, units, range))
    }

    fn table(&self, plan: &Plan) -> String {
        let mut text = format!("encoder              {} bits\n", plan.bits);
        for (name, number) in
            [("units per revolution", &plan.units_per_revolution), ("total range", &plan.total_range)]
        {
            let Number { value, hex, high_word, low_word } = number;
            let _ = writeln!(text, "{name:20} {value} = {hex}h, high word {high_word}, low word {low_word}");
        }
        if let Some(consequences) = &plan.consequences {
            let (units, range) = (plan.units_per_revolution.value, plan.total_range.value);
            let wish = Wish { scaling: plan.scaling, ..Wish::scaled(self.bits, units, range) };
            text.push_str(&self.told(consequences, &wish));
        }
        text
    }

    fn told(&self, consequences: &Consequences, wish: &Wish) -> String {
        let Consequences { revolutions, physical_revolutions, highest_position, .. } = consequences;
        let Consequences { degrees_per_unit, steps_per_unit, jump, .. } = consequences;
        let mut text = format!(
            "allowed              yes\n\
             one unit             {degrees_per_unit:.6} degrees, {steps_per_unit:.3} physical steps\n\
             positions            0 to {highest_position}, the range is {revolutions:.3} of {physical_revolutions} revolutions\n\
             jump                 {}\n\
             Set_Prm octets 9-25  {} (class 2)\n\
             Set_Prm octets 9-26  {} (Scancon 2.0, steps per 100 ms)\n\
             whole Set_Prm        {}\n\
             GSD, class 2         {}\n\
             GSD, Scancon 2.0     {}\n",
            if *jump == 0 {
                "none".to_owned()
            } else {
                format!("{jump} units after {} turns", consequences.jump_after_turns)
            },
            consequences.set_prm_class_2,
            consequences.set_prm_scancon_2,
            wish.whole_set_prm(self.ident, Functionality::Scancon2),
            consequences.gsd_class_2,
            consequences.gsd_scancon_2,
        );
        for warning in &consequences.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        text
    }
}

fn verdict(plan: &Plan) -> Result<(), Failure> {
    if plan.allowed {
        return Ok(());
    }
    Err(Failure::Failed(format!("the device would refuse it: {}", plan.refusals.join("; "))))
}

/// What was worked out for a machine.
fn advised(advice: &Advice) -> String {
    let unit = &advice.unit;
    let mut text = format!("a turn of encoder    {} {unit}\n", digits(advice.per_encoder_turn, 12));
    if let Some(turns) = advice.travel_turns {
        let _ = writeln!(text, "travel               {turns:.3} turns of the encoder");
    }
    let _ = writeln!(
        text,
        "one step             {} {unit}, exactly {} {unit}",
        digits(advice.step, 6),
        digits(advice.exact_step, 12)
    );
    let _ = writeln!(text, "range                {} {unit}", digits(advice.range, 9));
    let _ = writeln!(text, "overflow             {}", advice.overflow);
    for warning in &advice.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gears_are_whole_numbers() {
        for (text, encoder, machine) in
            [("25:2", 25, 2), ("12.5", 25, 2), ("1:1", 1, 1), ("3", 3, 1), ("1:2.4", 5, 12), ("50:4", 25, 2)]
        {
            let Ratio(gear) = text.parse().expect(text);
            assert_eq!((gear.encoder, gear.machine), (encoder, machine), "{text}");
        }
        for text in
            ["", "0", "0:1", "1:0", "a", "1:", "-1", "1.1234567", "1:2:3", "1e3", "99999999999999999999"]
        {
            assert!(text.parse::<Ratio>().is_err(), "{text}");
        }
    }
}
