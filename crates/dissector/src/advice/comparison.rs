//! What a master sent at a start-up against what the station says: the octet that does not fit.
//!
//! A slave only says "parameters refused" or "configuration refused". What it wanted is in its diagnosis, in Get_Cfg and,
//! for an encoder, in the manual.

use std::borrow::Cow;

use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::octet;
use profibus_dp::wire::slave_diag::StandardDiagnosis;
use sch108bex::configuration::Configurations;
use sch108bex::diagnostics::{Class2Part, Diagnostics};
use sch108bex::parameterization::Parameters;
use sch108bex::refusal::CfgRefusal;
use serde::Serialize;

use super::{of_configuration, of_parameters};
use crate::{hex, services};

/// Octets that do not fit: what was sent, and what the station wants or has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// `Set_Prm`, `Chk_Cfg`, or `Slave_Diag` where the station has something else in force than was asked for.
    pub telegram: &'static str,
    /// First and last octet of its data, from 1; none where it is the length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub octets: Option<[usize; 2]>,
    /// What was sent.
    pub sent: String,
    /// What was expected.
    pub expected: String,
    /// Both in a sentence without its full stop.
    pub text: String,
    /// What to do about it.
    pub advice: Cow<'static, str>,
}

/// What was sent at a start-up, and what the station said to it.
#[derive(Debug, Clone, Copy)]
pub struct StartUp<'a> {
    /// All of Set_Prm, octet 1 first.
    pub set_prm: &'a [u8],
    /// The identifier octets of Chk_Cfg.
    pub chk_cfg: &'a [u8],
    /// The diagnosis afterwards.
    pub diagnosis: &'a [u8],
    /// The identifier octets that Get_Cfg brought.
    pub get_cfg: Option<&'a [u8]>,
}

impl StartUp<'_> {
    /// What does not fit, in the order of the telegrams; none, where nothing is known to be wrong.
    pub fn differences(&self) -> Vec<Difference> {
        let Some(standard) = StandardDiagnosis::parse(self.diagnosis) else { return Vec::new() };
        let encoder = self.diagnosis.get(6..).and_then(Diagnostics::parse);
        let mut differences = Vec::new();
        differences.extend(self.ident(standard.ident_number));
        if standard.prm_fault {
            differences.extend(self.standard_part());
            differences.extend(encoder.as_ref().and_then(|encoder| self.encoder_part(encoder)));
        }
        // Where the parameters were refused, no configuration would have been good.
        if standard.cfg_fault && !standard.prm_fault {
            differences.extend(self.configuration(encoder.is_some()));
        }
        if !standard.prm_req && !standard.station_not_ready {
            let part = encoder.as_ref().and_then(|encoder| encoder.class_2_part.as_ref());
            differences.extend(part.into_iter().flat_map(|part| self.scaling(part)));
        }
        differences
    }

    fn ident(&self, own: u16) -> Option<Difference> {
        let sent = u16::from_be_bytes(*self.set_prm.get(4..)?.first_chunk::<2>()?);
        (sent != own).then(|| Difference {
            telegram: "Set_Prm",
            octets: Some([5, 6]),
            sent: format!("{sent:04X}h"),
            expected: format!("{own:04X}h"),
            text: format!(
                "Set_Prm octets 5-6: ident number {sent:04X}h was sent, but the station has {own:04X}h"
            ),
            advice: "take the GSD file of this very device, or the address where the other one is".into(),
        })
    }

    /// What any DP-V0 slave refuses.
    fn standard_part(&self) -> Option<Difference> {
        let at = |number| octet(self.set_prm, number);
        let wrong = |number: usize, expected: &str, why: &str, advice: &'static str| {
            let sent = at(number).map_or_else(|| "nothing".to_owned(), |octet| format!("{octet:02X}h"));
            Difference {
                telegram: "Set_Prm",
                octets: Some([number, number]),
                text: format!("Set_Prm octet {number}: {sent} was sent, but {why}"),
                sent,
                expected: expected.to_owned(),
                advice: advice.into(),
            }
        };
        let status = at(1)?;
        if status & 0x07 != 0 {
            let why = "bits 0 to 2 are reserved and must be 0";
            return Some(wrong(1, "bits 0 to 2 off", why, "clear these bits"));
        }
        let zero = [2, 3].into_iter().find(|number| status & 0x08 != 0 && at(*number) == Some(0));
        if let Some(number) = zero {
            let why = "with the watchdog on both factors are 1 to 255";
            return Some(wrong(number, "1 to 255", why, "give a watchdog time, or switch it off"));
        }
        if at(8).is_some_and(|octet| octet & 0xB8 != 0) {
            let why = "a DP-V0 slave knows only bits 0, 1, 2 and 6 there";
            let advice = "write 0; the master may take the station for a DP-V1 slave, or miss that octet";
            return Some(wrong(8, "00h", why, advice));
        }
        None
    }

    /// What an encoder of this resolution refuses.
    fn encoder_part(&self, encoder: &Diagnostics) -> Option<Difference> {
        let variant = crate::encoder::variant(encoder)?;
        let refusal = Parameters::parse(self.set_prm, &variant).err()?;
        let octets = refusal.octet().map(|first| match first {
            10 | 14 => [first.into(), usize::from(first) + 3],
            _ => [usize::from(first); 2],
        });
        let sent = octets.and_then(|[first, last]| self.set_prm.get(first - 1..last));
        let text = refusal.to_string();
        Some(Difference {
            telegram: "Set_Prm",
            octets,
            sent: sent.map_or_else(|| format!("{} octets", self.set_prm.len()), hex::text),
            expected: text.split_once(", but ").map_or_else(|| text.clone(), |(_, due)| due.to_owned()),
            advice: of_parameters(&refusal).into(),
            text,
        })
    }

    fn configuration(&self, is_encoder: bool) -> Option<Difference> {
        let found = Configurations::default().find(self.chk_cfg).filter(|_| is_encoder);
        if let Some((functionality, _)) = found
            && self.set_prm.len() < functionality.parameter_octets().into()
        {
            let have = u8::try_from(self.set_prm.len()).unwrap_or(u8::MAX);
            let refusal = CfgRefusal::ParametersTooShort { functionality, have };
            return Some(Difference {
                telegram: "Set_Prm",
                octets: None,
                sent: format!("{have} octets"),
                expected: format!("{} octets", functionality.parameter_octets()),
                text: refusal.to_string(),
                advice: of_configuration(&refusal).into(),
            });
        }
        let own = self.get_cfg?;
        let at =
            (1..=self.chk_cfg.len().max(own.len())).find(|at| octet(self.chk_cfg, *at) != octet(own, *at))?;
        let one =
            |octets: &[u8]| octet(octets, at).map_or("nothing".to_owned(), |octet| format!("{octet:02X}h"));
        let (sent, expected) = (one(self.chk_cfg), one(own));
        let lengths = |octets: &[u8]| match Lengths::of(octets) {
            Some(_) => format!("{} ({})", hex::text(octets), services::lengths_in_words(octets)),
            None => hex::text(octets),
        };
        let offers = if is_encoder {
            "; an SCH108BEX offers D1, F1, F1 D1 D1 and F1 D3, each with its own parameters"
        } else {
            ""
        };
        Some(Difference {
            telegram: "Chk_Cfg",
            octets: Some([at, at]),
            text: format!(
                "Chk_Cfg octet {at}: {sent} was sent, but the station has {expected}: yours is {}, its own {}{offers}",
                lengths(self.chk_cfg),
                lengths(own)
            ),
            sent,
            expected,
            advice: "choose the module whose identifier octets and lengths are the station's".into(),
        })
    }

    /// Whether the scaling that was asked for is in force.
    fn scaling(&self, part: &Class2Part) -> Vec<Difference> {
        let asked = |first: usize| {
            let octets = self.set_prm.get(first - 1..)?.first_chunk::<4>()?;
            Some(u32::from_be_bytes(*octets))
        };
        if self.set_prm.len() < 25 || octet(self.set_prm, 9).is_none_or(|octet| octet & 0x08 == 0) {
            return Vec::new();
        }
        [
            ("measuring units per revolution", 10, [40, 43], part.measuring_units_per_revolution),
            ("total measuring range", 14, [44, 47], part.total_measuring_range),
        ]
        .into_iter()
        .filter_map(|(name, at, octets, in_force)| {
            let asked = asked(at).filter(|asked| *asked != in_force)?;
            Some(Difference {
                telegram: "Slave_Diag",
                octets: Some(octets),
                sent: asked.to_string(),
                expected: in_force.to_string(),
                text: format!(
                    "Slave_Diag octets {}-{}: {in_force} {name} in force, but Set_Prm octets {at}-{} asked for {asked}",
                    octets[0],
                    octets[1],
                    at + 3
                ),
                advice: "the device has adapted the value: positions are scaled by what is in force".into(),
            })
        })
        .collect()
    }
}
