//! What a diagnosis means for the machine, and what to do about it.
//!
//! A [`Finding`] is a bit or a value of Slave_Diag that somebody should know of, with its octets, how grave it
//! is, what it means and what to do. The words are data: a table for the six octets of the standard
//! and one for each octet of the encoder (manual 4.2). [`of_refusal`] and its neighbours give the same for refusals, of which a
//! master hears nothing but "refused".
//!
//! ```
//! use dissector::advice::{Diagnosis, Level};
//!
//! // Supply voltage alarm of an encoder that waits for parameters.
//! let octets =
//!     [0x0A, 0x07, 0, 0xFF, 0x10, 0x8B, 10, 0x02, 0, 2, 0, 1, 0, 0, 0x80, 0];
//! let read = Diagnosis::read(&octets).expect("6 octets or more");
//! assert_eq!(read.findings[0].level, Level::Alarm);
//! assert_eq!(read.findings[0].name, "Stat_Diag");
//! assert_eq!(read.findings[1].octets, [8, 8]);
//! ```

mod comparison;
mod encoder;
mod refusals;
mod standard;

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;

pub use comparison::{Difference, StartUp};
pub use refusals::{of_address, of_configuration, of_event, of_parameters, of_preset, of_refusal};

use crate::conversation::Profile;
use crate::field::{Data, Field};
use crate::{hex, services};

/// How grave a finding is, the gravest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// The position is not to be trusted, or no data can be exchanged.
    Alarm,
    /// It works, but somebody should do something about it.
    Warning,
    /// Good to know.
    Note,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Alarm => "alarm",
            Self::Warning => "warning",
            Self::Note => "note",
        })
    }
}

/// Something in a diagnosis that somebody should know of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// First and last octet of the diagnosis, from 1 as the manual counts.
    pub octets: [usize; 2],
    /// The bit, where it is one; of two octets bit 0 is the lowest of the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bit: Option<u8>,
    /// How grave it is.
    pub level: Level,
    /// The standard's or the manual's name. Names do not change.
    pub name: Cow<'static, str>,
    /// What it means: a sentence without its full stop.
    pub text: Cow<'static, str>,
    /// What to do about it; empty where there is nothing to do.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub advice: Cow<'static, str>,
}

impl Finding {
    pub(crate) fn new(
        octets: [usize; 2],
        bit: Option<u8>,
        level: Level,
        [name, text, advice]: [&'static str; 3],
    ) -> Self {
        Self { octets, bit, level, name: name.into(), text: text.into(), advice: advice.into() }
    }

    /// Where it stands: "octet 8 bit 0", "octets 5-6".
    pub fn place(&self) -> String {
        let [first, last] = self.octets;
        let octets = if first == last { format!("octet {first}") } else { format!("octets {first}-{last}") };
        self.bit.map_or(octets.clone(), |bit| format!("{octets} bit {bit}"))
    }
}

/// A diagnosis in words.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// All octets, in hexadecimal.
    pub octets: String,
    /// One line.
    pub summary: String,
    /// Whether it has an encoder's block: octets 7 to 16 or 57.
    pub is_encoder: bool,
    /// What somebody should know of: alarms first, then warnings, then notes, each in the order of the octets.
    pub findings: Vec<Finding>,
    /// Every value, in the order of the octets but for alarms and warnings, which come first of the encoder's.
    pub fields: Vec<Field>,
}

impl Diagnosis {
    /// Reads the data of an answer to Slave_Diag, octet 1 first; `None` where there are fewer than six octets.
    /// An encoder's block is known by its length.
    pub fn read(octets: &[u8]) -> Option<Self> {
        Self::read_as(octets, Profile::Auto)
    }

    /// The same, and which stations are taken for encoders: with [`Profile::Dp`] none.
    pub fn read_as(octets: &[u8], profile: Profile) -> Option<Self> {
        let mut findings = standard::findings(octets)?;
        let mut data = Data::new(octets, 0);
        let (mut summary, _, blocks) = services::standard_diagnosis(&mut data);
        let fits = crate::encoder::diagnosis_fits(&data, &blocks) && profile != Profile::Dp;
        let told = if fits { crate::encoder::diagnosis(&mut data) } else { None };
        match &told {
            Some((words, _)) => {
                summary = format!("{words}; {summary}");
                findings.extend(encoder::findings(octets));
            }
            None => findings.extend(standard::of_blocks(octets, &blocks)),
        }
        // Stable: octets stay in their order.
        findings.sort_by_key(|finding| finding.level);
        Some(Self {
            octets: hex::text(octets),
            summary,
            is_encoder: told.is_some(),
            findings,
            fields: data.fields,
        })
    }

    /// The gravest of its findings.
    pub fn level(&self) -> Option<Level> {
        self.findings.first().map(|finding| finding.level)
    }
}
