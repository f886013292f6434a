//! Which entries are shown.

use clap::Args;
use dissector::{Dissected, Entry, Item, Service};

use crate::arguments::whole;

/// The options that choose.
#[derive(Debug, Args)]
pub(super) struct Filter {
    /// Only telegrams from or to this station
    #[arg(long, value_name = "N", value_parser = whole::<u8>(0..=127), allow_hyphen_values = true)]
    address: Option<u8>,
    /// Only telegrams of this service, like Data_Exchange or Slave_Diag
    #[arg(long, value_name = "NAME", value_parser = service)]
    service: Option<Service>,
    /// Of a capture: only from so many seconds after its first packet on
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    from: Option<f64>,
    /// Of a capture: only until so many seconds after its first packet
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    to: Option<f64>,
    /// Only what is wrong or unusual: bad telegrams, retries, remarks, faults
    #[arg(long)]
    errors: bool,
}

const SERVICES: [Service; 12] = [
    Service::DataExchange,
    Service::SetSlaveAdd,
    Service::RdInp,
    Service::RdOutp,
    Service::GlobalControl,
    Service::GetCfg,
    Service::SlaveDiag,
    Service::SetPrm,
    Service::ChkCfg,
    Service::FdlStatus,
    Service::Ident,
    Service::LsapStatus,
];

fn service(text: &str) -> Result<Service, String> {
    let plain = |name: &str| name.replace(['_', '-'], "").to_ascii_lowercase();
    SERVICES.into_iter().find(|service| plain(service.name()) == plain(text)).ok_or_else(|| {
        let names: Vec<_> = SERVICES.iter().map(|service| service.name()).collect();
        format!("write one of {}", names.join(", "))
    })
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err("write seconds like 1.5".to_owned()),
    }
}

/// The last request, which a short acknowledgement belongs to.
#[derive(Debug, Default)]
pub(super) struct Followed {
    number: u64,
    addresses: [Option<u8>; 2],
}

impl Filter {
    /// Whether it asks for times.
    pub(super) fn needs_times(&self) -> bool {
        self.from.is_some() || self.to.is_some()
    }

    /// Whether it leaves anything out.
    pub(super) fn is_set(&self) -> bool {
        self.errors || self.needs_times() || self.needs_telegram()
    }

    /// Whether it asks for telegrams of a certain kind.
    fn needs_telegram(&self) -> bool {
        self.address.is_some() || self.service.is_some()
    }

    /// Whether an entry is shown.
    pub(super) fn shows(
        &self,
        entry: &Entry,
        seconds: Option<f64>,
        commented: bool,
        followed: &mut Followed,
    ) -> bool {
        let Item::Telegram(telegram) = &entry.item else {
            return self.is_time(seconds) && !self.needs_telegram();
        };
        let addresses = addresses(telegram, followed);
        if telegram.source.is_some() {
            *followed = Followed { number: entry.number, addresses };
        }
        let unusual = telegram.retry || !telegram.remarks.is_empty() || commented;
        self.is_time(seconds)
            && (!self.errors || unusual)
            && self.address.is_none_or(|address| addresses.contains(&Some(address)))
            && self.service.is_none_or(|service| telegram.service == Some(service))
    }

    /// Whether something that happened is shown.
    pub(super) fn shows_note(&self, seconds: f64) -> bool {
        self.is_time(Some(seconds)) && !self.needs_telegram()
    }

    fn is_time(&self, seconds: Option<f64>) -> bool {
        seconds.is_none_or(|seconds| {
            self.from.is_none_or(|from| seconds >= from) && self.to.is_none_or(|to| seconds <= to)
        })
    }
}

fn addresses(telegram: &Dissected, followed: &Followed) -> [Option<u8>; 2] {
    match telegram.answers {
        Some(number) if telegram.source.is_none() && number == followed.number => followed.addresses,
        _ => [telegram.source, telegram.destination],
    }
}
