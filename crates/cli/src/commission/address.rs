//! `set-address`: gives a station another address.

use clap::Args;
use profibus_dp::wire::StandardDiagnosis;
use serde::Serialize;

use super::place::Place;
use super::session::owner;
use super::{Light, failed};
use crate::arguments::{ident_number, whole};
use crate::{Failure, output};

/// Give a station another address, and see that it is there
///
/// The station's ident number is read from its diagnosis. Nobody may answer at the new address before, and somebody with
/// this ident number has to afterwards. An SCH108BEX takes an address only while its rotary switches are at 7E
/// (126) and no master has it.
#[derive(Debug, Args)]
pub(crate) struct SetAddress {
    /// Where the station is, 0 to 126; 126 as delivered
    #[arg(value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
    from: u8,
    /// Where it shall be, 0 to 125, or 126 to give it back; an SCH108BEX takes 1 to 125
    #[arg(value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
    to: u8,
    #[command(flatten)]
    change: Change,
    #[command(flatten)]
    place: Place,
    /// One document
    #[arg(long)]
    json: bool,
}

/// How the address is changed.
#[derive(Debug, Clone, Args)]
pub(crate) struct Change {
    /// The station's ident number; without it the one in its diagnosis
    #[arg(long, value_name = "0xHHHH", value_parser = ident_number)]
    pub(crate) ident: Option<u16>,
    /// Ask it never to take another address again; some devices cannot be changed after that, an SCH108BEX can
    #[arg(long, alias = "for-good")]
    pub(crate) no_further_change: bool,
}

/// What was done.
#[derive(Debug, Serialize)]
pub(crate) struct Changed {
    from: u8,
    pub(crate) address: u8,
    ident_number: String,
}

impl SetAddress {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        self.place.check(Some(self.from))?;
        self.place.check(Some(self.to))?;
        let changed = self.place.with(|light| self.change.change(light, self.from, self.to))?;
        if self.json {
            output::json(&changed);
        } else {
            output::line(&changed.text());
        }
        Ok(())
    }
}

impl Changed {
    pub(crate) fn text(&self) -> String {
        format!("station {} is at address {} now", self.from, self.address)
    }
}

impl Change {
    /// Does it, and looks.
    pub(crate) fn change(&self, light: &mut Light, from: u8, to: u8) -> Result<Changed, Failure> {
        if to == from {
            return Err(Failure::Failed(format!("station {from} is at that address already; write another")));
        }
        if is_somebody(light, to)? {
            return Err(Failure::Failed(format!(
                "there is a station at address {to} already; two at one address answer at once"
            )));
        }
        let octets = light.diagnosis(from).map_err(failed)?.octets.to_vec();
        if let Some(owner) = owner(&octets) {
            return Err(Failure::Failed(format!(
                "station {from} belongs to master {owner}, and takes no address meanwhile; end that master first"
            )));
        }
        let found = StandardDiagnosis::parse(&octets).map_or(0, |standard| standard.ident_number);
        let ident = self.ident.unwrap_or(found);
        light.set_address(from, to, ident, self.no_further_change).map_err(failed)?;
        look(light, [from, to], [found, ident])?;
        Ok(Changed { from, address: to, ident_number: format!("{found:04X}") })
    }
}

/// Whether anything at all comes back from an address: two stations at one answer with octets that are no telegram. One
/// answer may be lost or late, so it is asked as often as other requests are.
fn is_somebody(light: &mut Light, address: u8) -> Result<bool, Failure> {
    /// Request FDL status.
    const FDL_STATUS: u8 = 0x49;
    let own = light.settings().address;
    let sum = address.wrapping_add(own).wrapping_add(FDL_STATUS);
    for _ in 0..=light.settings().retries {
        if !light.raw(&[0x10, address, own, FDL_STATUS, sum, 0x16]).map_err(failed)?.is_empty() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// An acknowledgement alone says nothing: switches may decide, and a wrong ident number is acknowledged too.
fn look(light: &mut Light, [from, to]: [u8; 2], [found, sent]: [u16; 2]) -> Result<(), Failure> {
    if !is_somebody(light, to)? {
        let why = if found == sent {
            "its rotary switches decide the address unless they are at 7E (126) when the power comes: turn them there, or \
             set the address itself there, and switch off and on"
                .to_owned()
        } else {
            format!("its ident number is {found:04X}, but {sent:04X} was sent (Set_Slave_Add octets 2-3)")
        };
        return Err(Failure::Failed(format!(
            "station {from} has acknowledged the new address {to}, but nobody answers there: {why}"
        )));
    }
    let there = light.diagnosis(to).map_err(failed)?.standard.ident_number;
    if there != found {
        return Err(Failure::Failed(format!(
            "at address {to} is ident number {there:04X} now, but the station had {found:04X}; somebody else came there"
        )));
    }
    if is_somebody(light, from)? {
        return Err(Failure::Failed(format!(
            "somebody still answers at address {from}: there were two stations at it; disconnect one and look again"
        )));
    }
    Ok(())
}
