//! A sequence of telegrams: which request an answer belongs to, and what each station agreed with its
//! master.

mod data;

use profibus_dp::wire::function_code::{Function, FunctionCode};
use profibus_dp::wire::sap::Sap;
use profibus_dp::wire::telegram::{BROADCAST, DataTelegram, Parsed, Telegram, parse};
use sch108bex::configuration::Configurations;
use sch108bex::functionality::Functionality;
use sch108bex::specification::Variant;
use serde::Serialize;

use crate::dissected::{Dissected, Places};
use crate::field::Data;
use crate::names::{self, Direction, Service};
use crate::splitter::{Piece, Splitter, Wrong};

/// Whose parameters, data and diagnoses are read beyond the standard's part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// An encoder's, where the telegrams can be nothing else.
    #[default]
    Auto,
    /// An encoder's: every station is one.
    Encoder,
    /// Nobody's: the standard only.
    Dp,
}

/// A part of the conversation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    /// From 1 on.
    pub number: u64,
    /// Where its first octet is in all that came, from 1 on.
    pub first_octet: u64,
    /// What it is.
    #[serde(flatten)]
    pub item: Item,
}

/// What a part of the conversation is.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Item {
    /// A telegram without a fault in its format.
    Telegram(Dissected),
    /// It began as a telegram.
    Bad {
        /// All of it, in hexadecimal.
        octets: String,
        /// The octet of it that is wrong, from 1.
        wrong_octet: usize,
        /// A sentence.
        words: String,
    },
    /// Octets that begin no telegram; skipped.
    Garbage {
        /// How many.
        count: u64,
        /// The first of them, in hexadecimal.
        octets: String,
        /// A sentence.
        words: String,
    },
}

/// Follows a conversation. Its memory is bounded, however long that is.
#[derive(Debug)]
pub struct Conversation {
    profile: Profile,
    configurations: Configurations,
    splitter: Splitter,
    stations: Vec<Station>,
    pending: Option<Pending>,
    number: u64,
}

/// What is known of a slave by its telegrams.
#[derive(Debug, Clone, Default)]
struct Station {
    /// Octets of the last Set_Prm that locks.
    set_prm: Option<Vec<u8>>,
    /// Octets of the last Chk_Cfg.
    configuration: Option<Vec<u8>>,
    /// Whether a telegram could only be an encoder's.
    encoder: bool,
    variant: Option<Variant>,
    /// The two above before the last request, which may be refused.
    before: (Option<Vec<u8>>, Option<Vec<u8>>),
    /// What a retry would have in common with the last request.
    last: Option<(Header, bool)>,
}

impl Station {
    /// Before a request changes what was agreed.
    fn remember(&mut self) {
        self.before = (self.set_prm.clone(), self.configuration.clone());
    }
}

/// SA, function, DSAP, SSAP.
type Header = (u8, u8, Sap, Sap);

/// A request that waits for its answer.
#[derive(Debug, Clone, Copy)]
struct Pending {
    number: u64,
    da: u8,
    sa: u8,
    dsap: Sap,
    ssap: Sap,
    service: Service,
}

impl Conversation {
    /// One that has heard nothing so far.
    pub fn new(profile: Profile) -> Self {
        Self {
            profile,
            configurations: Configurations::default(),
            splitter: Splitter::default(),
            stations: vec![Station::default(); usize::from(BROADCAST)],
            pending: None,
            number: 0,
        }
    }

    /// The identifier octets that choose a functionality of the encoder, where the user's GSD has others.
    pub fn set_configurations(&mut self, configurations: Configurations) {
        self.configurations = configurations;
    }

    /// Takes the next octets, cut anywhere.
    pub fn push(&mut self, octets: &[u8], take: &mut dyn FnMut(Entry)) {
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.push(octets, &mut |piece| take(self.entry(piece)));
        self.splitter = splitter;
    }

    /// The end, or a pause that no telegram survives.
    pub fn finish(&mut self, take: &mut dyn FnMut(Entry)) {
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.finish(&mut |piece| take(self.entry(piece)));
        self.splitter = splitter;
    }

    fn entry(&mut self, piece: Piece) -> Entry {
        self.number += 1;
        let number = self.number;
        let told = |wrong: Wrong| wrong.to_string();
        let (first_octet, item) = match piece {
            Piece::Telegram { at, octets } => (at, self.telegram(&octets)),
            Piece::Bad { at, octets, wrong } => {
                self.pending = None;
                let octets = crate::hex::text(&octets);
                (at, Item::Bad { octets, wrong_octet: wrong.octet, words: told(wrong) })
            }
            Piece::Garbage { at, count, first, wrong } => {
                self.pending = None;
                (at, Item::Garbage { count, octets: crate::hex::text(&first), words: told(wrong) })
            }
        };
        Entry { number, first_octet, item }
    }

    fn telegram(&mut self, octets: &[u8]) -> Item {
        let pending = self.pending.take();
        Item::Telegram(match parse(octets) {
            Parsed::Complete(Telegram::Data(telegram), _) if telegram.fc.is_request() => {
                self.request(octets, &telegram)
            }
            Parsed::Complete(Telegram::Data(telegram), _) => self.response(octets, &telegram, pending),
            Parsed::Complete(Telegram::Token { da, sa }, _) => Dissected::token(octets, da, sa),
            _ => acknowledgement(octets, pending),
        })
    }

    fn request(&mut self, octets: &[u8], telegram: &DataTelegram<'_>) -> Dissected {
        let DataTelegram { da, sa, fc, dsap, ssap, data } = *telegram;
        let mut dissected = Dissected::head(octets, telegram);
        let service = Service::of_request(fc, dsap);
        dissected.service = Some(service);
        dissected.retry = self.is_retry(telegram);
        let mut data = Data::new(data, Places::of(octets, telegram).before_data);
        let words = self.tell_request(service, da, &mut data, &mut dissected);
        dissected.fields.append(&mut data.fields);
        let to = if da == BROADCAST { "all".to_owned() } else { da.to_string() };
        let name = if service == Service::Other { names::function(fc) } else { service.name() };
        let request = if words.is_empty() { " request" } else { ": " };
        let retry = if dissected.retry { " (retry)" } else { "" };
        dissected.summary = format!("{sa} -> {to}  {name}{request}{words}{retry}");
        let answered = !matches!(fc.function(), Function::SendDataNoAcknowledge | Function::Other);
        self.pending = (da != BROADCAST && answered).then_some(Pending {
            number: self.number,
            da,
            sa,
            dsap,
            ssap,
            service,
        });
        dissected
    }

    /// Row 5 of the reference's table: the same station asks the same with the same FCB.
    fn is_retry(&mut self, telegram: &DataTelegram<'_>) -> bool {
        let fc: FunctionCode = telegram.fc;
        let memorable =
            matches!(fc.function(), Function::SendAndRequestData | Function::SendDataWithAcknowledge);
        let Some(station) = self.stations.get_mut(usize::from(telegram.da)).filter(|_| memorable) else {
            return false;
        };
        let header = (telegram.sa, fc.0 & 0x0F, telegram.dsap, telegram.ssap);
        let this = (header, fc.frame_count_bit());
        let retry = fc.frame_count_valid() && station.last == Some(this);
        station.last = (fc.frame_count_valid() || fc.frame_count_bit()).then_some(this);
        retry
    }

    fn response(
        &mut self,
        octets: &[u8],
        telegram: &DataTelegram<'_>,
        pending: Option<Pending>,
    ) -> Dissected {
        let DataTelegram { da, sa, fc, dsap, ssap, data } = *telegram;
        let mut dissected = Dissected::head(octets, telegram);
        let pending = pending.filter(|pending| (pending.sa, pending.da) == (da, sa));
        let mirrored = pending.is_some_and(|pending| (pending.ssap, pending.dsap) == (dsap, ssap));
        let negative = data.is_empty() && dsap.is_nil() && ssap.is_nil();
        dissected.answers = pending.map(|pending| pending.number);
        match pending {
            None => dissected.remark(None, "the request that it answers is not here".to_owned()),
            Some(_) if mirrored || negative => {}
            Some(_) => {
                dissected
                    .remark(None, "its SAPs are not those of the request the other way round".to_owned());
            }
        }
        // The SAPs tell the service without the request; without SAPs only the request does.
        let by_sap = (!ssap.is_nil()).then(|| Service::of_sap(ssap));
        let by_request = pending.map(|pending| pending.service);
        let by_data = (!data.is_empty()).then_some(Service::DataExchange);
        dissected.service = by_sap.or(by_request).or(by_data);
        let mut data = Data::new(data, Places::of(octets, telegram).before_data);
        let has_data = matches!(fc.0 & 0x0F, 0x8 | 0xA | 0xC | 0xD);
        let words = match dissected.service {
            Some(service) if has_data => self.tell_response(service, sa, &mut data, &mut dissected),
            _ => {
                data.raw([1, usize::MAX], "Data", "");
                names::response(fc).to_owned()
            }
        };
        if matches!(fc.0 & 0x0F, 0x3) && pending.is_some() {
            self.refused(sa, dissected.service);
        }
        dissected.fields.append(&mut data.fields);
        let name = dissected.service.map_or("answer", Service::name);
        let waits = if fc.0 & 0x0F == 0xA { " (a diagnosis waits)" } else { "" };
        dissected.summary = format!("{sa} -> {da}  {name}: {words}{waits}");
        dissected
    }

    /// RS: what was asked for is not in force, but what was before.
    fn refused(&mut self, address: u8, service: Option<Service>) {
        if let Some(station) = self.stations.get_mut(usize::from(address))
            && matches!(service, Some(Service::SetPrm | Service::ChkCfg))
        {
            (station.set_prm, station.configuration) = std::mem::take(&mut station.before);
        }
    }

    fn station(&self, address: u8) -> Option<&Station> {
        self.stations.get(usize::from(address))
    }

    fn is_encoder(&self, address: u8) -> bool {
        match self.profile {
            Profile::Encoder => true,
            Profile::Dp => false,
            Profile::Auto => self.station(address).is_some_and(|station| station.encoder),
        }
    }

    /// What the last Chk_Cfg chose, if it is one of the encoder's.
    fn functionality(&self, address: u8) -> Option<Functionality> {
        let configuration = self.station(address)?.configuration.as_deref()?;
        self.configurations.find(configuration).map(|(functionality, _)| functionality)
    }
}

/// A short acknowledgement: it says only that something came.
fn acknowledgement(octets: &[u8], pending: Option<Pending>) -> Dissected {
    let mut dissected = Dissected::new(octets, Direction::Response);
    let Some(Pending { number, da, sa, service, .. }) = pending else {
        dissected.summary.push_str("short acknowledgement");
        dissected.remark(None, "the request that it answers is not here".to_owned());
        return dissected;
    };
    (dissected.service, dissected.answers) = (Some(service), Some(number));
    let words = match service {
        Service::SetPrm | Service::ChkCfg | Service::SetSlaveAdd => {
            "received; whether it is good, the diagnosis tells"
        }
        _ => "done, no data",
    };
    if matches!(service, Service::FdlStatus | Service::Ident | Service::SlaveDiag | Service::GetCfg) {
        dissected.remark(Some(1), format!("{} is never answered by E5", service.name()));
    }
    dissected.summary = format!("{da} -> {sa}  {}: {words}", service.name());
    dissected
}

impl Dissected {
    /// A remark, if there is one.
    pub(crate) fn remarks(&mut self, wrong: Option<(usize, String)>) {
        if let Some((octet, words)) = wrong {
            self.remark(Some(octet), words);
        }
    }
}
