//! From a GSD file to what a slave is given: ident number, user parameters, identifier octets.
//!
//! gsd-parser's own builder of parameters gives up by a panic on values that do not fit: that is looked after
//! here.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

use gsd_parser::{
    GenericStationDescription, Module, PrmValueConstraint, UserPrmData, UserPrmDataDefinition,
    UserPrmDataType,
};
use gsd_reader::ReadError;
use profibus_dp::time::Baudrate;
use profibus_dp::wire::chk_cfg::Lengths;

use crate::commissioning::SlaveSettings;
use crate::parameters::Parameters;

/// Octets of user parameters that fit into a Set_Prm.
const MOST_USER_OCTETS: usize = 237;

/// A GSD file that was read.
#[derive(Debug, Clone)]
pub struct Gsd {
    description: GenericStationDescription,
}

/// Why a GSD file does not do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GsdError {
    /// It is no GSD file.
    #[error(
        "it is no GSD file that can be read; is it the right one, and whole? The first that does not fit:\n{0}"
    )]
    Syntax(String),
    /// It is one, but broken.
    #[error(
        "it is broken: it refers to something that is not in it, or a value is of the wrong kind; ask the \
         maker of the device for another"
    )]
    Broken,
    /// `Ident_Number` is missing.
    #[error("it has no Ident_Number, without which no slave takes parameters; is it whole?")]
    NoIdent,
    /// There is no module.
    #[error("it describes no Module, so there is no configuration to choose; give one in hex instead")]
    NoModules,
    /// There are several modules.
    #[error("it describes {} modules, so one has to be chosen by its name: {}", .0.len(), list(.0))]
    ChooseModule(Vec<String>),
    /// There is no module of this name.
    #[error("it describes no module \"{name}\"; there are: {}", list(.known))]
    UnknownModule {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A module's identifier octets make no configuration.
    #[error("module \"{0}\" has identifier octets that make no configuration; the file is wrong there")]
    Configuration(String),
    /// There is no parameter of this name.
    #[error("there is no parameter \"{name}\" for this module; there are: {}", list(.known))]
    UnknownParameter {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A value that the parameter does not have.
    #[error("parameter \"{name}\" cannot be {value}: it takes {takes}")]
    Value {
        /// The parameter.
        name: String,
        /// What was asked for.
        value: String,
        /// What it can be.
        takes: String,
    },
    /// The file's own default does not fit its own type.
    #[error(
        "parameter \"{name}\" is {value} by default, which does not fit its type; set it to something that does"
    )]
    Default {
        /// The parameter.
        name: String,
        /// The default.
        value: i64,
    },
    /// There are more than a telegram takes.
    #[error("it makes {0} octets of user parameters, but {MOST_USER_OCTETS} fit into a Set_Prm")]
    TooLong(usize),
    /// The device does not know this rate.
    #[error("the device does not run at {0}; it does at: {1}")]
    Rate(Baudrate, String),
}

fn list(names: &[String]) -> String {
    if names.is_empty() {
        return "none".to_owned();
    }
    names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}

impl Gsd {
    /// Reads the text of a GSD file; `name` is only for its messages.
    ///
    /// # Errors
    ///
    /// It is none, or broken, or has no ident number.
    pub fn parse(name: &str, text: &str) -> Result<Self, GsdError> {
        match gsd_reader::read(Path::new(name), text) {
            Ok(description) if description.ident_number == 0 => Err(GsdError::NoIdent),
            Ok(description) => Ok(Self { description }),
            Err(ReadError::Syntax(why)) => Err(GsdError::Syntax(why)),
            Err(_) => Err(GsdError::Broken),
        }
    }

    /// What the file says of the device.
    pub fn description(&self) -> &GenericStationDescription {
        &self.description
    }

    /// The names of its modules.
    pub fn modules(&self) -> Vec<String> {
        self.description.available_modules.iter().map(|module| module.name.trim().to_owned()).collect()
    }

    /// The module of this name, or the only one.
    ///
    /// # Errors
    ///
    /// There is none, or several where none is named.
    pub fn module(&self, name: Option<&str>) -> Result<&Module, GsdError> {
        let modules = &self.description.available_modules;
        let Some(name) = name else {
            return match modules.as_slice() {
                [] => Err(GsdError::NoModules),
                [only] => Ok(only),
                _ => Err(GsdError::ChooseModule(self.modules())),
            };
        };
        let found = modules.iter().find(|module| module.name.trim() == name.trim());
        let found = found
            .or_else(|| modules.iter().find(|module| module.name.trim().eq_ignore_ascii_case(name.trim())));
        found
            .map(Arc::as_ref)
            .ok_or_else(|| GsdError::UnknownModule { name: name.to_owned(), known: self.modules() })
    }

    /// Octets 8 on of Set_Prm for a module: its constants and defaults, with some parameters set by their
    /// names to a number or to one of their texts.
    ///
    /// # Errors
    ///
    /// A name or a value that the file does not have.
    pub fn user_parameters(&self, module: &Module, set: &[(String, String)]) -> Result<Vec<u8>, GsdError> {
        let station = &self.description.user_prm_data;
        let mut octets = Octets::default();
        octets.begin(station);
        let behind = octets.0.len();
        octets.begin_at(behind, &module.module_prm_data);
        if octets.0.len() > MOST_USER_OCTETS {
            return Err(GsdError::TooLong(octets.0.len()));
        }
        let of_module = module.module_prm_data.data_ref.iter().map(|(at, data)| (behind + at, data));
        let all: Vec<_> = station.data_ref.iter().map(|(at, data)| (*at, data)).chain(of_module).collect();
        let mut chosen: Vec<Option<i64>> = vec![None; all.len()];
        for (name, text) in set {
            // A parameter that is there more than once is set everywhere.
            let mut known = false;
            for ((_, data), chosen) in all.iter().zip(&mut chosen) {
                if data.name.trim().eq_ignore_ascii_case(name.trim()) {
                    *chosen = Some(value_of(data, text)?);
                    known = true;
                }
            }
            if !known {
                let known = all.iter().map(|(_, data)| data.name.trim().to_owned()).collect();
                return Err(GsdError::UnknownParameter { name: name.clone(), known });
            }
        }
        for ((at, data), chosen) in all.iter().zip(chosen) {
            let value = chosen.unwrap_or(data.default_value);
            if !octets.write(*at, data.data_type, value) {
                return Err(GsdError::Default { name: data.name.clone(), value });
            }
        }
        Ok(octets.0)
    }

    /// max T_SDR at a rate, in bit times.
    ///
    /// # Errors
    ///
    /// The device does not run at it.
    pub fn max_tsdr(&self, rate: Baudrate) -> Result<u16, GsdError> {
        let tsdr = &self.description.max_tsdr;
        let supported = self.description.supported_speeds;
        let (bits, flag) = at_rate(tsdr, rate);
        // A file without any rate says nothing of rates.
        if supported.is_empty() || supported.contains(flag) {
            return Ok(bits);
        }
        let rates = Baudrate::ALL.into_iter().filter(|&rate| supported.contains(at_rate(tsdr, rate).1));
        Err(GsdError::Rate(rate, rates.map(|rate| rate.to_string()).collect::<Vec<_>>().join(", ")))
    }

    /// All that a slave is given for a module, at a rate. Watchdog, min T_SDR, groups, Sync and Freeze are
    /// left to the master.
    ///
    /// # Errors
    ///
    /// See [`module`](Self::module), [`user_parameters`](Self::user_parameters) and
    /// [`max_tsdr`](Self::max_tsdr).
    pub fn slave(
        &self,
        address: u8,
        rate: Baudrate,
        module: Option<&str>,
        set: &[(String, String)],
    ) -> Result<SlaveSettings, GsdError> {
        let module = self.module(module)?;
        let lengths =
            Lengths::of(&module.config).ok_or_else(|| GsdError::Configuration(module.name.clone()))?;
        Ok(SlaveSettings {
            address,
            parameters: Parameters {
                ident_number: self.description.ident_number,
                user: self.user_parameters(module, set)?,
                ..Parameters::default()
            },
            configuration: module.config.clone(),
            inputs: lengths.inputs,
            outputs: lengths.outputs,
            max_tsdr: self.max_tsdr(rate)?,
        })
    }
}

fn at_rate(tsdr: &gsd_parser::MaxTsdr, rate: Baudrate) -> (u16, gsd_parser::SupportedSpeeds) {
    use gsd_parser::SupportedSpeeds as Speeds;
    match rate {
        Baudrate::B9600 => (tsdr.b9600, Speeds::B9600),
        Baudrate::B19200 => (tsdr.b19200, Speeds::B19200),
        Baudrate::B45450 => (tsdr.b45450, Speeds::B45450),
        Baudrate::B93750 => (tsdr.b93750, Speeds::B93750),
        Baudrate::B187500 => (tsdr.b187500, Speeds::B187500),
        Baudrate::B500000 => (tsdr.b500000, Speeds::B500000),
        Baudrate::B1500000 => (tsdr.b1500000, Speeds::B1500000),
        Baudrate::B3000000 => (tsdr.b3000000, Speeds::B3000000),
        Baudrate::B6000000 => (tsdr.b6000000, Speeds::B6000000),
        Baudrate::B12000000 => (tsdr.b12000000, Speeds::B12000000),
    }
}

/// What a text means to a parameter: one of its texts, or a number in decimal or, after `0x`, in hex.
fn value_of(data: &UserPrmDataDefinition, text: &str) -> Result<i64, GsdError> {
    let text = text.trim();
    let named = data.text_ref.as_ref().and_then(|texts| {
        texts.iter().find(|(name, _)| name.trim().eq_ignore_ascii_case(text)).map(|(_, value)| *value)
    });
    let number = || match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(hex) => i64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    };
    let value = named.or_else(number);
    let value = value.filter(|&value| data.constraint.is_valid(value) && fits(data.data_type, value));
    value.ok_or_else(|| GsdError::Value {
        name: data.name.clone(),
        value: text.to_owned(),
        takes: takes(data),
    })
}

/// What a parameter can be, in words.
fn takes(data: &UserPrmDataDefinition) -> String {
    let numbers = match &data.constraint {
        PrmValueConstraint::MinMax(least, most) => format!("{least} to {most}"),
        PrmValueConstraint::Enum(values) => {
            values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
        }
        PrmValueConstraint::Unconstrained => range(data.data_type)
            .map_or_else(String::new, |range| format!("{} to {}", range.start(), range.end())),
    };
    match &data.text_ref {
        Some(texts) => {
            let texts: Vec<_> =
                texts.iter().map(|(text, value)| format!("\"{}\" ({value})", text.trim())).collect();
            format!("{numbers}, or {}", texts.join(", "))
        }
        None => numbers,
    }
}

/// The values that fit a type; none where the file has bits that an octet does not have.
fn range(kind: UserPrmDataType) -> Option<RangeInclusive<i64>> {
    Some(match kind {
        UserPrmDataType::Unsigned8 => 0..=0xFF,
        UserPrmDataType::Unsigned16 => 0..=0xFFFF,
        UserPrmDataType::Unsigned32 => 0..=0xFFFF_FFFF,
        UserPrmDataType::Signed8 => i8::MIN.into()..=i8::MAX.into(),
        UserPrmDataType::Signed16 => i16::MIN.into()..=i16::MAX.into(),
        UserPrmDataType::Signed32 => i32::MIN.into()..=i32::MAX.into(),
        UserPrmDataType::Bit(0..=7) => 0..=1,
        UserPrmDataType::BitArea(first, last) if first <= last && last <= 7 => {
            0..=(1 << (last - first + 1)) - 1
        }
        UserPrmDataType::Bit(_) | UserPrmDataType::BitArea(..) => return None,
    })
}

fn fits(kind: UserPrmDataType, value: i64) -> bool {
    range(kind).is_some_and(|range| range.contains(&value))
}

/// User parameters as they grow.
#[derive(Debug, Default)]
struct Octets(Vec<u8>);

impl Octets {
    fn begin(&mut self, data: &UserPrmData) {
        self.begin_at(0, data);
    }

    /// The constants of a part that begins at `start`, and room for all of it.
    fn begin_at(&mut self, start: usize, data: &UserPrmData) {
        let ends = data.data_const.iter().map(|(at, octets)| at + octets.len());
        let ends = ends.chain(data.data_ref.iter().map(|(at, data)| at + data.data_type.size()));
        let length = ends.max().unwrap_or(0).max(data.length.into());
        // Longer than any telegram is refused later; no more than that is made.
        self.0.resize((start + length).min(4 * MOST_USER_OCTETS).max(self.0.len()), 0);
        for (at, octets) in &data.data_const {
            if let Some(place) = self.0.get_mut(start + at..start + at + octets.len()) {
                place.copy_from_slice(octets);
            }
        }
    }

    /// Writes a value, high octet first; whether it fits.
    fn write(&mut self, at: usize, kind: UserPrmDataType, value: i64) -> bool {
        if !fits(kind, value) {
            return false;
        }
        let size = kind.size();
        let Some(place) = self.0.get_mut(at..at + size) else {
            return false;
        };
        let octets = value.to_be_bytes();
        let low = octets[7];
        match kind {
            UserPrmDataType::Bit(bit) => place[0] = place[0] & !(1 << bit) | low << bit,
            UserPrmDataType::BitArea(first, last) => {
                let mask = 0xFF >> (7 - (last - first)) << first;
                place[0] = place[0] & !mask | low << first;
            }
            _ => place.copy_from_slice(&octets[8 - size..]),
        }
        true
    }
}

#[cfg(test)]
mod tests;
