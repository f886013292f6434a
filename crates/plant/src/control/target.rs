//! Whom a request is for.

use profibus_dp::time::Instant;
use serde::{Deserialize, Serialize};

use crate::control::check::ControlError;
use crate::encoder::EncoderStation;
use crate::ground::Ground;
use crate::handle::{Found, Handle, Place};

/// An encoder or a segment, by number or name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "an encoder or a segment is a name, a number from 1, or \"all\"")]
pub enum Which {
    /// Counted from 1.
    Number(usize),
    /// Its name, or `all`.
    Name(String),
}

impl Which {
    /// Whether everybody is meant.
    pub(crate) fn is_all(&self) -> bool {
        matches!(self, Self::Name(name) if name == "all")
    }
}

impl Handle {
    /// Does something with each of the encoders that are meant, once all of them are found.
    pub(super) fn with<E: Into<ControlError> + Send + 'static>(
        &self,
        encoder: Option<&Which>,
        work: impl Fn(&mut EncoderStation, Instant) -> Result<(), E> + Copy + Send + 'static,
    ) -> Result<(), ControlError> {
        let results = self.each(encoder, |_| Ok(work))?;
        results.into_iter().try_for_each(|result| result.map_err(Into::into))
    }

    /// Does what `work` makes of each of the encoders that are meant, once it is made for all.
    pub(super) fn each<W, R>(
        &self,
        encoder: Option<&Which>,
        work: impl Fn(&Found<'_>) -> Result<W, ControlError>,
    ) -> Result<Vec<R>, ControlError>
    where
        W: FnOnce(&mut EncoderStation, Instant) -> R + Send + 'static,
        R: Send + 'static,
    {
        let names: Vec<_> = self.encoder_names().collect();
        let numbers = chosen("encoder", encoder, &names)?;
        let found: Vec<_> = numbers.into_iter().filter_map(|number| self.encoder(number)).collect();
        let work: Vec<_> = found.iter().map(work).collect::<Result<_, _>>()?;
        let asked = found.iter().zip(work).map(|(found, work)| found.ask(work));
        Ok(asked.collect::<Result<_, _>>()?)
    }

    /// Does something with each of the segments that are meant, once all of them are found.
    pub(super) fn with_segments<E: Into<ControlError> + Send + 'static>(
        &self,
        segment: Option<&Which>,
        work: impl Fn(&mut dyn Ground) -> Result<(), E> + Copy + Send + 'static,
    ) -> Result<(), ControlError> {
        let names: Vec<_> = self.places().iter().map(|place: &Place| place.name.as_str()).collect();
        let numbers = chosen("segment", segment, &names)?;
        for place in numbers.into_iter().filter_map(|number| self.places().get(number)) {
            place.ask(work)?.map_err(Into::into)?;
        }
        Ok(())
    }
}

/// The numbers, from 0, of those that are meant.
pub(super) fn chosen(
    what: &'static str,
    which: Option<&Which>,
    names: &[&str],
) -> Result<Vec<usize>, ControlError> {
    /// More names would make no sentence.
    const NAMED: usize = 16;
    let there = || match names {
        [first, .., last] if names.len() > NAMED => format!("{}, {first:?} to {last:?}", names.len()),
        _ => names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", "),
    };
    let nobody = |asked| ControlError::Nobody { what, asked, there: there() };
    match which {
        None if names.len() == 1 => Ok(vec![0]),
        None => Err(ControlError::Several { what, there: there() }),
        Some(which) if which.is_all() => Ok((0..names.len()).collect()),
        Some(Which::Name(name)) => {
            let found = names.iter().position(|known| known == name);
            Ok(vec![found.ok_or_else(|| nobody(format!("{name:?}")))?])
        }
        Some(Which::Number(number)) => match number.checked_sub(1) {
            Some(at) if at < names.len() => Ok(vec![at]),
            _ => Err(nobody(number.to_string())),
        },
    }
}
