//! `sch108bex master`: a master on any port, for any slave.

mod exchange;
mod script;

use clap::{Args, Subcommand};
use serde_json::json;

use crate::arguments::{ident_number, whole};
use crate::commission::address::Change;
use crate::commission::find::{self, NOBODY};
use crate::commission::place::Place;
use crate::commission::{Light, failed, words};
use crate::{Failure, output};

/// The options of `master`.
#[derive(Debug, Args)]
#[command(
    after_help = "It is the only master: it asks without a token. Status: 0 if the station did what was asked for, else 1."
)]
pub(crate) struct Master {
    #[command(flatten)]
    place: Place,
    /// The station, 0 to 126; without it the only one that answers
    #[arg(long, value_name = "N", value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
    address: Option<u8>,
    /// Print documents instead of sentences
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Ask every address from 0 to 126 whether somebody is there
    LiveList,
    /// Ask whether the station is there
    Status,
    /// Fetch the diagnosis
    Diag,
    /// Fetch the configuration
    GetCfg,
    /// Give the station another address
    SetAddress {
        /// The new address, 0 to 125, or 126 to give it back
        #[arg(value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
        new: u8,
        #[command(flatten)]
        change: Change,
    },
    /// Read the inputs that the station gives its owner
    ReadInputs,
    /// Read the outputs that the station has from its owner
    ReadOutputs,
    /// Free the station for other masters
    Unlock {
        /// The station's ident number; without it the one in its diagnosis
        #[arg(long, value_name = "0xHHHH", value_parser = ident_number)]
        ident: Option<u16>,
    },
    /// Parameterize the station, and exchange data with it
    Run(Box<exchange::Exchange>),
    /// Do what the lines of a file say, or of standard input; on a terminal at a prompt
    #[command(visible_alias = "shell")]
    Script(script::Script),
}

impl Master {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        if let Action::Run(exchange) = &self.action {
            exchange.check()?;
        }
        self.place.check(self.address)?;
        if let Action::Run(exchange) = &self.action {
            let mut light = self.place.open()?;
            let slave = self.station(&mut light)?;
            return exchange.run(self, light, slave);
        }
        self.place.with(|light| self.act(light))
    }

    fn act(&self, light: &mut Light) -> Result<(), Failure> {
        match &self.action {
            Action::LiveList => return self.live_list(light),
            Action::Script(script) => return script.run(self, light),
            _ => {}
        }
        let slave = self.station(light)?;
        match &self.action {
            // They have been dealt with.
            Action::LiveList | Action::Run(_) | Action::Script(_) => Ok(()),
            Action::Status => match light.status(slave).map_err(failed)? {
                Some(kind) => {
                    self.tell(&json!({"address": slave, "station": words::kind(kind)}), || {
                        format!("station {slave}: {}", words::kind(kind))
                    });
                    Ok(())
                }
                None => Err(Failure::Failed(format!("nobody answers at address {slave}"))),
            },
            Action::Diag => {
                let octets = light.diagnosis(slave).map_err(failed)?.octets.to_vec();
                self.answer(slave, words::SLAVE_DIAG, &octets);
                Ok(())
            }
            Action::GetCfg => {
                let octets = light.get_cfg(slave).map_err(failed)?.to_vec();
                self.answer(slave, words::GET_CFG, &octets);
                Ok(())
            }
            Action::ReadInputs => {
                let octets = light.read_inputs(slave).map_err(failed)?.to_vec();
                self.data(slave, "inputs", &octets);
                Ok(())
            }
            Action::ReadOutputs => {
                let octets = light.read_outputs(slave).map_err(failed)?.to_vec();
                self.data(slave, "outputs", &octets);
                Ok(())
            }
            Action::SetAddress { new, change } => {
                let changed = change.change(light, slave, *new)?;
                self.tell(&json!(changed), || changed.text());
                Ok(())
            }
            Action::Unlock { ident } => {
                let ident = ident_of(light, slave, *ident)?;
                light.unlock(slave, ident).map_err(failed)?;
                let owner = light.diagnosis(slave).map_err(failed)?.standard.master_add;
                match owner {
                    None => {
                        self.tell(&json!({"address": slave, "free": true}), || {
                            format!("station {slave} belongs to no master now")
                        });
                        Ok(())
                    }
                    Some(owner) => Err(Failure::Failed(format!(
                        "station {slave} still belongs to master {owner}; only its owner can free it"
                    ))),
                }
            }
        }
    }

    fn live_list(&self, light: &mut Light) -> Result<(), Failure> {
        let found = find::live_list(light)?;
        let document: Vec<_> = found
            .iter()
            .map(|(address, kind)| json!({"address": address, "station": words::kind(*kind)}))
            .collect();
        self.tell(&json!(document), || match found.as_slice() {
            [] => NOBODY.to_owned(),
            found => found
                .iter()
                .map(|(address, kind)| format!("{address:3}  {}", words::kind(*kind)))
                .collect::<Vec<_>>()
                .join("\n"),
        });
        Ok(())
    }

    fn station(&self, light: &mut Light) -> Result<u8, Failure> {
        find::station(light, self.address, "--address")
    }

    fn tell(&self, document: &serde_json::Value, text: impl FnOnce() -> String) {
        if self.json {
            output::json(document);
        } else {
            output::line(&text());
        }
    }

    /// Octets that a service has brought, in words.
    fn answer(&self, slave: u8, sap: profibus_dp::wire::Sap, octets: &[u8]) {
        let fields = words::fields(slave, self.place.own_address, sap, octets);
        let document = json!({
            "address": slave,
            "octets": words::hex(octets),
            "fields": fields.iter().map(|field| json!({
                "name": field.name, "value": field.value, "words": field.words, "octets": field.data_octets,
            })).collect::<Vec<_>>(),
        });
        self.tell(&document, || words::text(octets, &fields));
    }

    fn data(&self, slave: u8, name: &str, octets: &[u8]) {
        self.tell(&json!({"address": slave, name: words::hex(octets)}), || words::hex(octets));
    }
}

/// The ident number that was given, or the one in the station's diagnosis.
fn ident_of(light: &mut Light, slave: u8, ident: Option<u16>) -> Result<u16, Failure> {
    match ident {
        Some(ident) => Ok(ident),
        None => Ok(light.diagnosis(slave).map_err(failed)?.standard.ident_number),
    }
}
