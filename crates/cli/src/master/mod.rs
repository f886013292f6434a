//! `sch108bex master`: a master on any port, for any slave.

mod exchange;
mod words;

use ::master::light::StationKind;
use ::master::{Error, LightMaster, Settings, Wire};
use bus::{PortAddress, open_for_master};
use clap::{Args, Subcommand};
use profibus_dp::time::{Baudrate, BitTimes, Duration};
use serde_json::json;

use crate::arguments::{Baud, ident_number, whole};
use crate::{Failure, output};

/// The options of `master`.
#[derive(Debug, Args)]
#[command(
    after_help = "It is the only master: it asks without a token. Status: 0 if the station did what was asked for, else 1."
)]
pub(crate) struct Master {
    /// Where the slaves are: /dev/ttyUSB0, /dev/pts/4, tcp:ADDRESS:PORT, tcp-listen:ADDRESS:PORT, unix:PATH
    #[arg(long, value_name = "PORT")]
    port: PortAddress,
    /// The rate in bits per second; sockets have none
    #[arg(long, value_name = "RATE", default_value = "500000", value_parser = rate)]
    baud: Baudrate,
    /// The station, 0 to 126; without it the only one that answers
    #[arg(long, value_name = "N", value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
    address: Option<u8>,
    /// This master's own address
    #[arg(long = "master-address", value_name = "N", default_value_t = 2, value_parser = whole::<u8>(0..=125), allow_negative_numbers = true)]
    own_address: u8,
    /// How long to wait for a reply, in milliseconds
    #[arg(long, value_name = "MS", default_value_t = 20, value_parser = whole::<u16>(1..=10_000), allow_negative_numbers = true)]
    reply_within: u16,
    /// How often a request is repeated that is not answered
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = whole::<u8>(1..=15), allow_negative_numbers = true)]
    retries: u8,
    /// How long to wait for somebody at the far side of the port, in seconds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole::<u16>(0..=3_600), allow_negative_numbers = true)]
    wait: u16,
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
        /// The station's ident number; without it the one in its diagnosis
        #[arg(long, value_name = "0xHHHH", value_parser = ident_number)]
        ident: Option<u16>,
        /// Ask it never to take another address again; some devices cannot be changed after that
        #[arg(long)]
        for_good: bool,
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
    Run(exchange::Exchange),
}

fn rate(text: &str) -> Result<Baudrate, String> {
    match text.parse::<Baud>() {
        Ok(Baud::Fixed(rate)) => Ok(rate),
        Ok(Baud::Auto) => Err("a master has to know its rate; write one like 500000".to_owned()),
        Err(why) => Err(why.replace("; or write auto", "")),
    }
}

type Light = LightMaster<Wire>;

impl Master {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        if let Action::Run(exchange) = &self.action {
            exchange.check()?;
        }
        if self.address == Some(self.own_address) {
            return Err(Failure::Usage(format!(
                "master and station are both at address {}; --master-address takes another",
                self.own_address
            )));
        }
        let mut light = self.open()?;
        if let Action::Run(exchange) = &self.action {
            let slave = self.station(&mut light)?;
            return exchange.run(self, light, slave);
        }
        let done = self.act(&mut light);
        if done.is_err() && light.line().is_gone() {
            return Err(Failure::Failed(format!(
                "the far side of {} has closed the line; is its program still running?",
                self.port
            )));
        }
        done
    }

    fn open(&self) -> Result<Light, Failure> {
        let patience = Duration::from_secs(self.wait.into());
        let end = open_for_master(&self.port, self.baud, patience)
            .map_err(|error| Failure::Failed(error.to_string()))?;
        let mut wire = Wire::new(end)
            .with_slot_time(self.slot())
            .with_octet_time(self.baud.duration(BitTimes::CHARACTER));
        if !wire.await_peer(patience).map_err(|error| Failure::Failed(error.to_string()))? {
            return Err(Failure::Failed(format!(
                "nobody has connected to {} within {} s; start the slave's side, or give it longer with --wait",
                self.port, self.wait
            )));
        }
        let settings = Settings { address: self.own_address, retries: self.retries, ..Settings::default() };
        Ok(LightMaster::new(wire, settings))
    }

    fn slot(&self) -> Duration {
        Duration::from_millis(self.reply_within.into())
    }

    fn act(&self, light: &mut Light) -> Result<(), Failure> {
        if let Action::LiveList = self.action {
            return self.live_list(light);
        }
        let slave = self.station(light)?;
        match &self.action {
            // Both have been dealt with.
            Action::LiveList | Action::Run(_) => Ok(()),
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
            Action::SetAddress { new, ident, for_good } => {
                self.set_address(light, slave, *new, *ident, *for_good)
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
        let found = light.live_list().map_err(failed)?;
        let document: Vec<_> = found
            .iter()
            .map(|(address, kind)| json!({"address": address, "station": words::kind(*kind)}))
            .collect();
        self.tell(&json!(document), || match found.as_slice() {
            [] => "nobody answers at any address; check the rate, the wiring and the power".to_owned(),
            found => found
                .iter()
                .map(|(address, kind)| format!("{address:3}  {}", words::kind(*kind)))
                .collect::<Vec<_>>()
                .join("\n"),
        });
        Ok(())
    }

    /// The station to talk to: the one that was named, or the only one there is.
    fn station(&self, light: &mut Light) -> Result<u8, Failure> {
        if let Some(address) = self.address {
            return Ok(address);
        }
        let found = light.live_list().map_err(failed)?;
        let slaves: Vec<u8> = found
            .into_iter()
            .filter(|(_, kind)| *kind == StationKind::Passive)
            .map(|(address, _)| address)
            .collect();
        match slaves.as_slice() {
            [only] => Ok(*only),
            [] => Err(Failure::Failed(
                "nobody answers at any address; check the rate, the wiring and the power".to_owned(),
            )),
            several => Err(Failure::Failed(format!(
                "there are several stations, at {}; choose one with --address",
                several.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
            ))),
        }
    }

    fn set_address(
        &self,
        light: &mut Light,
        slave: u8,
        new: u8,
        ident: Option<u16>,
        for_good: bool,
    ) -> Result<(), Failure> {
        if new == slave {
            return Err(Failure::Failed(format!(
                "station {slave} is at that address already; write another"
            )));
        }
        if light.status(new).map_err(failed)?.is_some() {
            return Err(Failure::Failed(format!(
                "there is a station at address {new} already; two at one address answer at once"
            )));
        }
        let ident = ident_of(light, slave, ident)?;
        light.set_address(slave, new, ident, for_good).map_err(failed)?;
        if light.status(new).map_err(failed)?.is_none() {
            return Err(Failure::Failed(format!(
                "station {slave} has acknowledged the new address {new}, but nobody answers there; is {ident:04X} \
                 its ident number, and do its switches allow a change?"
            )));
        }
        self.tell(&json!({"from": slave, "address": new}), || {
            format!("station {slave} is at address {new} now")
        });
        Ok(())
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
        let fields = words::fields(slave, self.own_address, sap, octets);
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

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn failed(error: Error) -> Failure {
    Failure::Failed(error.to_string())
}
