//! A master that asks one thing at a time.
//!
//! It has no token and sees no other masters: it is alone on its bus, or asks in the pauses of others.
//! An exchange allocates nothing.

use bus::EndError;
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::function_code::ResponseCode;
use profibus_dp::wire::telegram::{self, BROADCAST, MAX_OCTETS, Parsed, Telegram};
use profibus_dp::wire::{DataTelegram, FunctionCode, Sap, StandardDiagnosis};

use crate::error::{Error, hex};
use crate::line::{Heard, Line, ReplyBuffer};
use crate::request::{FDL_STATUS, FrameCount, Priority, Request, SDN_HIGH, Service};

/// The highest address that a slave can have: the one of delivery.
pub const HIGHEST_ADDRESS: u8 = 126;

/// How a light master asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Its own address.
    pub address: u8,
    /// How often a request is repeated that is not answered.
    pub retries: u8,
    /// With which priority requests are sent.
    pub priority: Priority,
}

impl Default for Settings {
    /// Address 2, one retry, high priority.
    fn default() -> Self {
        Self { address: 2, retries: 1, priority: Priority::High }
    }
}

/// What was counted since the master was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Requests that an answer was expected to, retries not counted.
    pub requests: u64,
    /// Requests that were sent again.
    pub retries: u64,
    /// Requests that were not answered in the end.
    pub silent: u64,
    /// Replies that were no telegram.
    pub damaged: u64,
}

/// An answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// The code of the answer; `None`: E5.
    pub code: Option<u8>,
    /// Its data.
    pub data: &'a [u8],
    /// From the end of the request to the start of the answer.
    pub delay: Duration,
}

/// What Data_Exchange brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inputs<'a> {
    /// None from a slave without inputs.
    pub octets: &'a [u8],
    /// High priority: a diagnosis waits to be fetched.
    pub high_priority: bool,
}

/// What Slave_Diag brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Diagnosis<'a> {
    /// Octets 1 to 6.
    pub standard: StandardDiagnosis,
    /// All octets.
    pub octets: &'a [u8],
}

impl<'a> Diagnosis<'a> {
    /// The device's own octets, from 7 on.
    pub fn extended(&self) -> &'a [u8] {
        self.octets.get(6..).unwrap_or_default()
    }
}

/// What a station says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StationKind {
    /// A slave.
    Passive,
    /// A master that is not ready for the token ring.
    NotReady,
    /// A master that could get the token.
    Ready,
    /// A master in the token ring.
    InRing,
}

/// A master that asks one thing at a time, on a line of its own.
#[derive(Debug)]
pub struct LightMaster<L> {
    line: L,
    settings: Settings,
    /// For each slave what its next request begins with.
    frame_counts: [FrameCount; 128],
    request: [u8; MAX_OCTETS],
    reply: ReplyBuffer,
    /// How many octets of the two are those of the last exchange.
    last: (usize, usize),
    counters: Counters,
}

impl<L: Line> LightMaster<L> {
    /// A master that has not spoken to anybody yet.
    pub fn new(line: L, settings: Settings) -> Self {
        Self {
            line,
            settings,
            frame_counts: [FrameCount::First; 128],
            request: [0; MAX_OCTETS],
            reply: [0; 2 * MAX_OCTETS],
            last: (0, 0),
            counters: Counters::default(),
        }
    }

    /// The line.
    pub fn line(&self) -> &L {
        &self.line
    }

    /// The line, to do other things with.
    pub fn line_mut(&mut self) -> &mut L {
        &mut self.line
    }

    /// Ends the master and gives its line back.
    pub fn into_line(self) -> L {
        self.line
    }

    /// How it asks.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// Asks differently from now on.
    pub fn set_settings(&mut self, settings: Settings) {
        self.settings = settings;
    }

    /// What was counted.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The octets of the last exchange on the wire: the request, and what came back.
    pub fn last_exchange(&self) -> (&[u8], &[u8]) {
        (&self.request[..self.last.0], &self.reply[..self.last.1])
    }

    /// The time on the bus.
    pub fn now(&self) -> Instant {
        self.line.now()
    }

    /// The next request to a slave begins a new sequence: FCV = 0, FCB = 1.
    pub fn begin_sequence(&mut self, slave: u8) {
        self.frame_counts[usize::from(slave & 0x7F)] = FrameCount::First;
    }

    /// Sends a request, again where no telegram comes back, and takes the answer, be it positive or not.
    ///
    /// # Errors
    ///
    /// No answer in the end, or one that is none to this request.
    pub fn request(&mut self, request: &Request<'_>) -> Result<Reply<'_>, Error> {
        let at = usize::from(valid(request.slave)?);
        let fc = self.frame_counts[at].srd(self.settings.priority);
        let length = self.emit(request, fc)?;
        self.counters.requests += 1;
        let heard = self.attempts(length)?;
        if !heard.is_whole {
            return Err(self.unanswered(request, heard.length));
        }
        let reply = answer(&self.reply[..heard.length], request, self.settings.address, heard.delay);
        // Where somebody else spoke, nobody knows whether the slave has heard its request.
        self.frame_counts[at] = if reply.is_ok() { self.frame_counts[at].next() } else { FrameCount::First };
        reply
    }

    /// Sends the request that was written down until a telegram comes back.
    #[inline]
    fn attempts(&mut self, length: usize) -> Result<Attempt, EndError> {
        let mut last = Attempt { length: 0, delay: Duration::ZERO, is_whole: false };
        for attempt in 0..=self.settings.retries {
            self.counters.retries += u64::from(attempt > 0);
            let Heard { length: came, delay, damaged } =
                self.line.ask(&self.request[..length], &mut self.reply)?;
            let is_whole = !damaged
                && matches!(telegram::parse(&self.reply[..came]), Parsed::Complete(_, used) if used == came);
            last = Attempt { length: came, delay, is_whole };
            self.last = (length, came);
            if is_whole {
                break;
            }
            self.counters.damaged += u64::from(came > 0);
        }
        Ok(last)
    }

    #[cold]
    fn unanswered(&mut self, request: &Request<'_>, came: usize) -> Error {
        // Whatever it has heard of this sequence: the next request begins a new one.
        self.begin_sequence(request.slave);
        let (slave, service) = (request.slave, request.named());
        let attempts = self.settings.retries.saturating_add(1);
        self.counters.silent += 1;
        match &self.reply[..came] {
            [] => Error::Silent { slave, service, attempts },
            octets => Error::Damaged { slave, service, attempts, octets: hex(octets) },
        }
    }

    #[inline]
    fn emit(&mut self, request: &Request<'_>, fc: FunctionCode) -> Result<usize, Error> {
        let Request { slave, dsap, ssap, data } = *request;
        let telegram = DataTelegram { da: slave, sa: self.settings.address, fc, dsap, ssap, data };
        telegram
            .emit(&mut self.request)
            .ok_or(Error::TooLong { service: request.named(), octets: data.len() })
    }

    /// Asks whether a station is there, and of what kind. It is not repeated where nothing comes back.
    ///
    /// # Errors
    ///
    /// The line is broken.
    pub fn status(&mut self, station: u8) -> Result<Option<StationKind>, Error> {
        let request = Request { slave: valid(station)?, dsap: Sap::NIL, ssap: Sap::NIL, data: &[] };
        let length = self.emit(&request, FDL_STATUS)?;
        let heard = self.line.ask(&self.request[..length], &mut self.reply)?;
        let Parsed::Complete(Telegram::Data(answer), _) = telegram::parse(&self.reply[..heard.length]) else {
            return Ok(None);
        };
        if heard.damaged || answer.sa != station || answer.fc.is_request() {
            return Ok(None);
        }
        Ok(Some(match answer.fc.0 >> 4 & 3 {
            0 => StationKind::Passive,
            1 => StationKind::NotReady,
            2 => StationKind::Ready,
            _ => StationKind::InRing,
        }))
    }

    /// Asks every address from 0 to 126 but its own.
    ///
    /// # Errors
    ///
    /// The line is broken.
    pub fn live_list(&mut self) -> Result<Vec<(u8, StationKind)>, Error> {
        let mut stations = Vec::new();
        let own = self.settings.address;
        for address in (0..=HIGHEST_ADDRESS).filter(|&address| address != own) {
            stations.extend(self.status(address)?.map(|kind| (address, kind)));
        }
        Ok(stations)
    }

    /// Slave_Diag.
    ///
    /// # Errors
    ///
    /// As for [`request`](Self::request), and an answer that is shorter than six octets.
    pub fn diagnosis(&mut self, slave: u8) -> Result<Diagnosis<'_>, Error> {
        let octets = self.data_of(slave, Service::SlaveDiag, &[])?;
        match StandardDiagnosis::parse(octets) {
            Some(standard) => Ok(Diagnosis { standard, octets }),
            None => Err(unexpected(slave, Service::SlaveDiag, "a diagnosis of less than six octets", octets)),
        }
    }

    /// Set_Prm with these octets, from the first on.
    ///
    /// # Errors
    ///
    /// As for [`request`](Self::request), and anything but an E5. Whether the slave likes the parameters
    /// is told by its diagnosis.
    pub fn set_prm(&mut self, slave: u8, octets: &[u8]) -> Result<(), Error> {
        self.acknowledged(slave, Service::SetPrm, octets)
    }

    /// Chk_Cfg with these identifier octets.
    ///
    /// # Errors
    ///
    /// As for [`set_prm`](Self::set_prm).
    pub fn chk_cfg(&mut self, slave: u8, octets: &[u8]) -> Result<(), Error> {
        self.acknowledged(slave, Service::ChkCfg, octets)
    }

    /// Frees the slave for other masters: Set_Prm with Unlock_Req.
    ///
    /// # Errors
    ///
    /// As for [`set_prm`](Self::set_prm).
    pub fn unlock(&mut self, slave: u8, ident_number: u16) -> Result<(), Error> {
        let [ident_high, ident_low] = ident_number.to_be_bytes();
        self.set_prm(slave, &[0x40, 0, 0, 0, ident_high, ident_low, 0])
    }

    /// Set_Slave_Add: the slave moves to `to`. With `for_good` it is asked never to move again.
    ///
    /// # Errors
    ///
    /// As for [`set_prm`](Self::set_prm).
    pub fn set_address(&mut self, slave: u8, to: u8, ident_number: u16, for_good: bool) -> Result<(), Error> {
        let [ident_high, ident_low] = ident_number.to_be_bytes();
        let for_good = if for_good { 0xFF } else { 0 };
        self.acknowledged(slave, Service::SetSlaveAdd, &[to, ident_high, ident_low, for_good])?;
        self.begin_sequence(slave);
        self.begin_sequence(to);
        Ok(())
    }

    /// Get_Cfg: identifier octets.
    ///
    /// # Errors
    ///
    /// As for [`request`](Self::request), and a negative answer.
    pub fn get_cfg(&mut self, slave: u8) -> Result<&[u8], Error> {
        self.data_of(slave, Service::GetCfg, &[])
    }

    /// RD_Inp: the inputs that the slave gives its owner.
    ///
    /// # Errors
    ///
    /// As for [`get_cfg`](Self::get_cfg).
    pub fn read_inputs(&mut self, slave: u8) -> Result<&[u8], Error> {
        self.data_of(slave, Service::RdInp, &[])
    }

    /// RD_Outp: the outputs that the slave has from its owner.
    ///
    /// # Errors
    ///
    /// As for [`get_cfg`](Self::get_cfg).
    pub fn read_outputs(&mut self, slave: u8) -> Result<&[u8], Error> {
        self.data_of(slave, Service::RdOutp, &[])
    }

    /// Global_Control to all: the command octet and the groups that it is for (0: all). Nobody answers.
    ///
    /// # Errors
    ///
    /// The line is broken.
    pub fn global_control(&mut self, command: u8, groups: u8) -> Result<(), Error> {
        let data = [command, groups];
        let request = Request::service(BROADCAST, Service::GlobalControl, &data);
        let length = self.emit(&request, SDN_HIGH)?;
        Ok(self.line.tell(&self.request[..length])?)
    }

    /// Data_Exchange: outputs for inputs.
    ///
    /// # Errors
    ///
    /// As for [`get_cfg`](Self::get_cfg).
    #[inline]
    pub fn exchange(&mut self, slave: u8, outputs: &[u8]) -> Result<Inputs<'_>, Error> {
        let reply = self.request(&Request::service(slave, Service::DataExchange, outputs))?;
        let high_priority = reply.code == Some(ResponseCode::DataHigh as u8);
        match reply.code {
            Some(code) if high_priority || code == ResponseCode::DataLow as u8 => {
                Ok(Inputs { octets: reply.data, high_priority })
            }
            None => Ok(Inputs { octets: &[], high_priority: false }),
            Some(code) => Err(Error::Refused { slave, service: Service::DataExchange, code }),
        }
    }

    /// Octets as they are, and whatever comes back, until the slot time is over. Nothing is repeated.
    ///
    /// # Errors
    ///
    /// The line is broken.
    pub fn raw(&mut self, octets: &[u8]) -> Result<&[u8], Error> {
        let heard = self.line.ask(octets, &mut self.reply)?;
        Ok(&self.reply[..heard.length])
    }

    fn data_of(&mut self, slave: u8, service: Service, data: &[u8]) -> Result<&[u8], Error> {
        let reply = self.request(&Request::service(slave, service, data))?;
        match reply.code {
            Some(code) if is_data(code) => Ok(reply.data),
            Some(code) => Err(Error::Refused { slave, service, code }),
            None => Err(unexpected(slave, service, "an E5, where data was due", &[])),
        }
    }

    fn acknowledged(&mut self, slave: u8, service: Service, data: &[u8]) -> Result<(), Error> {
        let reply = self.request(&Request::service(slave, service, data))?;
        match reply.code {
            None => Ok(()),
            Some(code) if is_data(code) => {
                Err(unexpected(slave, service, "data, where an E5 was due", reply.data))
            }
            Some(code) => Err(Error::Refused { slave, service, code }),
        }
    }
}

/// The last attempt at a request.
#[derive(Debug, Clone, Copy)]
struct Attempt {
    length: usize,
    delay: Duration,
    /// The octets are one telegram without a fault.
    is_whole: bool,
}

const fn is_data(code: u8) -> bool {
    code == ResponseCode::DataLow as u8 || code == ResponseCode::DataHigh as u8
}

const fn valid(address: u8) -> Result<u8, Error> {
    if address <= HIGHEST_ADDRESS { Ok(address) } else { Err(Error::NoAddress(address)) }
}

/// What octets are as the answer to a request.
#[inline]
fn answer<'a>(
    octets: &'a [u8],
    request: &Request<'_>,
    master: u8,
    delay: Duration,
) -> Result<Reply<'a>, Error> {
    match telegram::parse(octets) {
        Parsed::Complete(Telegram::ShortAcknowledgement, _) => Ok(Reply { code: None, data: &[], delay }),
        Parsed::Complete(Telegram::Data(answer), _)
            if answer.da == master
                && answer.sa == request.slave
                && !answer.fc.is_request()
                // A negative answer may come without SAPs.
                && (answer.dsap == request.ssap && answer.ssap == request.dsap || answer.data.is_empty()) =>
        {
            Ok(Reply { code: Some(answer.fc.0 & 0x0F), data: answer.data, delay })
        }
        _ => Err(unexpected(request.slave, request.named(), "", octets)),
    }
}

#[cold]
fn unexpected(slave: u8, service: Service, what: &str, octets: &[u8]) -> Error {
    let what = match (what, octets) {
        (what, []) => what.to_owned(),
        ("", octets) => hex(octets),
        (what, octets) => format!("{what} ({})", hex(octets)),
    };
    Error::Unexpected { slave, service, what }
}
