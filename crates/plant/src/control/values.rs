//! The values that requests have.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::shaft::{Coupling, Shaft, ShaftError, ShaftFields};

/// The movement of a shaft.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "a shaft is a text like \"still@1000\" or \"constant:60@here\", or fields like {\"kind\":\"constant\",\"rpm\":60,\"raw\":1000}"
)]
pub enum ShaftSpec {
    /// As `run --shaft` has it; `@here` goes on from where the shaft is.
    Text(String),
    /// In fields.
    Fields(Box<ShaftFields>),
}

/// The light of the LED.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// Within its limits.
    Ok,
    /// Its reserve is used up: a warning.
    Low,
}

/// The battery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BatteryState {
    /// Above its limit.
    Ok,
    /// Below its limit: a warning.
    Low,
    /// Keeps nothing: the turn count is lost with the power.
    Empty,
}

/// What happens to the power.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Power {
    /// Cut, until it is switched on.
    Off,
    /// Given back, if the supply suffices.
    On,
    /// Cut, and given back at once.
    Cycle,
}

/// What is wrong with the sensor or the position (manual 4.2.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorFault {
    /// The sensor reports a fault once.
    Once,
    /// The sensor reports a fault until `off`, also at power-on; the position stands still.
    Held,
    /// The position is wrong for a reason that nobody knows.
    PositionError,
    /// The next power-on finds the turn count lost, as with an empty battery.
    TurnsLost,
    /// Nothing any more. The alarm stays until the next power-on.
    Off,
}

/// What is wrong with the non-volatile memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MemoryFault {
    /// Writes fail, until `off`.
    WritesFail,
    /// Slot A is damaged now.
    DamageA,
    /// Slot B is damaged now.
    DamageB,
    /// The next power-on finds both slots damaged.
    LostAtPowerOn,
    /// The power goes during the next write, and stays off.
    TornWrite,
    /// Writes succeed again, and the next power-on finds what was written.
    Off,
}

impl ShaftSpec {
    /// The movement, and whether it begins where the shaft is.
    ///
    /// # Errors
    ///
    /// What cannot be read, and a coupled shaft: see [`coupling`](Self::coupling).
    pub fn resolve(&self) -> Result<(Shaft, bool), ShaftError> {
        let (fields, here) = self.fields()?;
        Ok((Shaft::try_from(&fields)?, here))
    }

    /// What drives a coupled shaft; `None` for another kind.
    ///
    /// # Errors
    ///
    /// What cannot be read.
    pub fn coupling(&self) -> Result<Option<Coupling>, ShaftError> {
        self.fields()?.0.coupling()
    }

    /// The same with the file of a playback taken from this folder on.
    pub(crate) fn in_folder(self, folder: &Path) -> Self {
        let Ok((mut fields, here)) = self.fields() else { return self };
        let Some(file) = fields.file.as_ref().filter(|file| !Path::new(file).is_absolute()) else {
            return self;
        };
        let Ok(file) = folder.join(file).into_os_string().into_string() else { return self };
        fields.file = Some(file);
        if !here {
            fields.raw.get_or_insert(0);
        }
        Self::Fields(Box::new(fields))
    }

    /// The fields, and whether it begins where the shaft is: left out, that is so in fields, while a text
    /// begins at 0.
    pub(super) fn fields(&self) -> Result<(ShaftFields, bool), ShaftError> {
        match self {
            Self::Text(text) => match text.strip_suffix("@here") {
                // A position of its own and this one too: neither is meant.
                Some(kind) if kind.contains('@') => Err(ShaftError::Form(text.clone())),
                Some(kind) => Ok((ShaftFields::parse(kind)?, true)),
                None => Ok((ShaftFields::parse(text)?, false)),
            },
            Self::Fields(fields) => Ok((fields.as_ref().clone(), fields.raw.is_none())),
        }
    }
}
