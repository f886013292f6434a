//! What can go wrong between a master and a slave, in sentences.

use bus::EndError;
use profibus_dp::wire::function_code::ResponseCode;

use crate::request::Service;

/// Why a request has not brought what was asked for.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nothing came, at no attempt.
    #[error(
        "station {slave} does not answer {service} (asked {attempts} times); check its address, the rate, \
         the wiring and that it has power"
    )]
    Silent {
        /// The slave's address.
        slave: u8,
        /// What it was asked for.
        service: Service,
        /// How often.
        attempts: u8,
    },
    /// Octets came, at the last attempt too, but no telegram.
    #[error(
        "what comes back from station {slave} after {service} is no telegram (asked {attempts} times): \
         {octets}; is the rate right, are two stations at one address, is the line terminated?"
    )]
    Damaged {
        /// The slave's address.
        slave: u8,
        /// What it was asked for.
        service: Service,
        /// How often.
        attempts: u8,
        /// The octets of the last attempt, in hex.
        octets: String,
    },
    /// A negative answer.
    #[error("station {slave} refuses {service}: {}", refusal(*.service, *.code))]
    Refused {
        /// The slave's address.
        slave: u8,
        /// What it was asked for.
        service: Service,
        /// The code of its answer.
        code: u8,
    },
    /// A telegram that is no answer to this.
    #[error("station {slave} answers {service} with something else: {what}")]
    Unexpected {
        /// The slave's address.
        slave: u8,
        /// What it was asked for.
        service: Service,
        /// What it is.
        what: String,
    },
    /// The request fits in no telegram.
    #[error("{service} with {octets} octets fits in no telegram; 244 is the most, 246 in Data_Exchange")]
    TooLong {
        /// What was to be asked for.
        service: Service,
        /// With how many octets.
        octets: usize,
    },
    /// No address that a slave can have.
    #[error("{0} is no station address; a slave has one from 0 to 126")]
    NoAddress(u8),
    /// The line is broken.
    #[error(transparent)]
    Line(#[from] EndError),
}

/// What a negative answer means, and what to do.
fn refusal(service: Service, code: u8) -> String {
    const RS: u8 = ResponseCode::NoService as u8;
    const UE: u8 = ResponseCode::UserError as u8;
    const RR: u8 = ResponseCode::NoResource as u8;
    const NR: u8 = ResponseCode::NoResponseData as u8;
    let (name, meaning) = match (code, service) {
        (RS, Service::DataExchange) => (
            "RS",
            "it does not exchange data with this master; it wants parameters and configuration first, or \
             belongs to another master (the diagnosis tells)",
        ),
        (RS, Service::SetPrm | Service::ChkCfg) => (
            "RS",
            "it takes none now; another master may own it, or it is at address 126 and needs an address first",
        ),
        (RS, Service::SetSlaveAdd) => (
            "RS",
            "it takes no address over the bus now; its switches may decide, or it exchanges data with a master",
        ),
        (RS, Service::RdInp | Service::RdOutp) => {
            ("RS", "there are none to be read; it exchanges no data with any master, or does not have any")
        }
        (RS, _) => ("RS", "it has no such service, or not in its present state"),
        (UE, _) => ("UE", "it has taken the request but cannot work with it"),
        (RR, _) => ("RR", "it has no room for it now; ask again later"),
        (NR, _) => ("NR", "it has no data for an answer"),
        _ => return format!("code {code:02X}, which has no meaning in an answer of a slave"),
    };
    format!("{name}, {meaning}")
}

/// Octets in hex, the first few of them.
pub(crate) fn hex(octets: &[u8]) -> String {
    const MOST: usize = 32;
    let mut text: Vec<String> = octets.iter().take(MOST).map(|octet| format!("{octet:02X}")).collect();
    if octets.len() > MOST {
        text.push(format!("... ({} octets)", octets.len()));
    }
    text.join(" ")
}
