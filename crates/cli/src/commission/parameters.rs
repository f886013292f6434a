//! What a station is given at a start-up: from its GSD, in hex, or the manual's own defaults.

use std::path::PathBuf;

use ::master::{Gsd, Parameters, SlaveSettings, Watchdog};
use clap::{Args, ValueEnum};
use profibus_dp::time::{Baudrate, Duration};
use profibus_dp::wire::chk_cfg::Lengths;
use sch108bex::diagnostics::Diagnostics;
use sch108bex::functionality::Functionality;
use sch108bex::parameterization::{CodeSequence, Parameters as Encoder, TimeBase};
use sch108bex::specification::Variant;

use super::words;
use crate::Failure;
use crate::arguments::{ident_number, whole};

/// Octets from the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Octets(pub(crate) Vec<u8>);

pub(crate) fn octets(text: &str) -> Result<Octets, String> {
    dissector::hex::octets(text).map(Octets).map_err(|error| error.to_string())
}

pub(crate) fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("write a parameter's name, = and its value, like \"Code sequence=0\"".to_owned()),
    }
}

/// What the encoder is made by its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Class {
    /// Class 1 Multiturn: the position
    #[value(name = "1")]
    One,
    /// Class 2 Multiturn: also scaling and preset
    #[value(name = "2")]
    Two,
    /// Scancon 2.0 Multiturn: also velocity and acceleration
    Scancon,
}

impl From<Class> for Functionality {
    fn from(class: Class) -> Self {
        match class {
            Class::One => Self::Class1,
            Class::Two => Self::Class2,
            Class::Scancon => Self::Scancon2,
        }
    }
}

/// Parameters and configuration. Without any of these an SCH108BEX gets the manual's defaults.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct Project {
    /// The GSD file of the device
    #[arg(long, value_name = "FILE", conflicts_with_all = ["prm", "cfg"], help_heading = "Parameters")]
    pub(crate) gsd: Option<PathBuf>,
    /// The module, by its name in the GSD file
    #[arg(long, value_name = "NAME", requires = "gsd", help_heading = "Parameters")]
    pub(crate) module: Option<String>,
    /// A parameter, by its name in the GSD file, and its value or text; may be repeated
    #[arg(long, value_name = "NAME=VALUE", requires = "gsd", value_parser = pair, help_heading = "Parameters")]
    pub(crate) set: Vec<(String, String)>,
    /// Set_Prm from octet 8 on, in hex
    #[arg(long, value_name = "HEX", requires = "cfg", value_parser = octets, help_heading = "Parameters")]
    pub(crate) prm: Option<Octets>,
    /// The identifier octets of Chk_Cfg, in hex
    #[arg(long, value_name = "HEX", requires = "prm", value_parser = octets, help_heading = "Parameters")]
    pub(crate) cfg: Option<Octets>,
    /// Without --gsd and --prm: what the encoder is to be
    #[arg(long, value_name = "1|2|scancon", conflicts_with_all = ["gsd", "prm"], help_heading = "Parameters")]
    pub(crate) class: Option<Class>,
    /// Likewise: measuring units per revolution; with --range, else scaling is off
    #[arg(long, value_name = "N", requires = "range", conflicts_with_all = ["gsd", "prm"], value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true, help_heading = "Parameters")]
    pub(crate) units: Option<u32>,
    /// Likewise: total measuring range in units
    #[arg(long, value_name = "N", requires = "units", conflicts_with_all = ["gsd", "prm"], value_parser = whole::<u32>(0..=u32::MAX.into()), allow_negative_numbers = true, help_heading = "Parameters")]
    pub(crate) range: Option<u32>,
    /// Likewise: the position rises counter-clockwise
    #[arg(long, conflicts_with_all = ["gsd", "prm"], help_heading = "Parameters")]
    pub(crate) counter_clockwise: bool,
    /// The ident number that is sent; without it the GSD's, or the one in the diagnosis
    #[arg(long, value_name = "0xHHHH", value_parser = ident_number, conflicts_with = "gsd", help_heading = "Parameters")]
    pub(crate) ident: Option<u16>,
}

impl Project {
    /// What can be said before a port is opened.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        self.cfg.as_ref().map_or(Ok(()), |Octets(cfg)| lengths(cfg).map(|_| ()))
    }

    /// Whether nothing was said of the parameters.
    pub(crate) fn is_default(&self) -> bool {
        self.gsd.is_none() && self.prm.is_none() && self.units.is_none()
    }

    /// All that the station is given. `diagnosis` is what it says of itself; `usual` is the functionality where none
    /// was chosen.
    pub(crate) fn slave(
        &self,
        address: u8,
        rate: Baudrate,
        diagnosis: &[u8],
        usual: Functionality,
    ) -> Result<SlaveSettings, Failure> {
        let found = diagnosis.get(4..6).map_or(0, |octets| u16::from_be_bytes([octets[0], octets[1]]));
        let mut slave = match (&self.gsd, &self.prm, &self.cfg) {
            (Some(path), ..) => {
                let wrong = |why: String| Failure::Failed(format!("--gsd {}: {why}", path.display()));
                let text = gsd_reader::read_text(path).map_err(|error| wrong(error.to_string()))?;
                let gsd = Gsd::parse(&path.display().to_string(), &text)
                    .map_err(|error| wrong(error.to_string()))?;
                gsd.slave(address, rate, self.module.as_deref(), &self.set)
                    .map_err(|error| wrong(error.to_string()))?
            }
            (None, Some(Octets(prm)), Some(Octets(cfg))) => {
                self.raw(address, rate, found, prm.clone(), cfg.clone())?
            }
            _ => self.encoder(address, rate, diagnosis, found, usual)?,
        };
        slave.parameters.min_tsdr = 11;
        Ok(slave)
    }

    fn raw(
        &self,
        address: u8,
        rate: Baudrate,
        found: u16,
        user: Vec<u8>,
        configuration: Vec<u8>,
    ) -> Result<SlaveSettings, Failure> {
        let Lengths { inputs, outputs } = lengths(&configuration)?;
        Ok(SlaveSettings {
            address,
            parameters: Parameters {
                ident_number: self.ident.unwrap_or(found),
                user,
                ..Parameters::default()
            },
            configuration,
            inputs,
            outputs,
            max_tsdr: u16::try_from(rate.max_tsdr().0).unwrap_or(u16::MAX),
        })
    }

    /// The manual's defaults for the resolution that the station says it has.
    fn encoder(
        &self,
        address: u8,
        rate: Baudrate,
        diagnosis: &[u8],
        found: u16,
        usual: Functionality,
    ) -> Result<SlaveSettings, Failure> {
        let functionality = self.class.map_or(usual, Functionality::from);
        let variant = diagnosis.get(6..).and_then(Diagnostics::parse).as_ref().and_then(variant).ok_or_else(|| {
            Failure::Failed(format!(
                "station {address} does not look like an SCH108BEX, whose defaults would be sent; give its parameters with \
                 --gsd, or with --prm and --cfg"
            ))
        })?;
        let mut parameters =
            Encoder { length: functionality.parameter_length(), ..Encoder::default_for(variant) };
        if self.counter_clockwise {
            parameters.code_sequence = CodeSequence::CounterClockwise;
        }
        if let (Some(units), Some(range)) = (self.units, self.range) {
            if functionality == Functionality::Class1 {
                return Err(Failure::Usage(
                    "class 1 has no scaling; leave --units and --range out".to_owned(),
                ));
            }
            parameters.scaling = true;
            parameters.measuring_units_per_revolution = units;
            parameters.total_measuring_range = range;
        }
        parameters.time_base = TimeBase::Per100Ms;
        let mut octets = [0; 26];
        let length = parameters.emit(&mut octets);
        let user = octets[7..length].to_vec();
        self.raw(address, rate, found, user, functionality.configuration().to_vec())
    }
}

/// The watchdog of an option in milliseconds.
pub(crate) fn watchdog(millis: u32) -> Result<Option<Watchdog>, Failure> {
    match millis {
        0 => Ok(None),
        millis => Watchdog::at_least(Duration::from_millis(millis.into()))
            .map(Some)
            .map_err(|error| Failure::Usage(format!("--watchdog {millis}: {error}"))),
    }
}

/// The variant of this resolution, if it is one that this device exists in.
pub(crate) fn variant(encoder: &Diagnostics) -> Option<Variant> {
    let bits =
        |number: u32| number.is_power_of_two().then(|| u8::try_from(number.trailing_zeros()).ok()).flatten();
    let singleturn = bits(encoder.singleturn_resolution)?;
    Variant::new(singleturn, bits(u32::from(encoder.revolutions))?).ok()
}

/// How many octets identifiers make.
pub(crate) fn lengths(cfg: &[u8]) -> Result<Lengths, Failure> {
    Lengths::of(cfg).ok_or_else(|| {
        Failure::Usage(format!(
            "--cfg {}: these identifier octets are cut off, or ask for more than 244 octets",
            words::hex(cfg)
        ))
    })
}
