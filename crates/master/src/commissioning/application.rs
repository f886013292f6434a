//! profirust's master for cyclic data, and questions between its cycles.
//!
//! A question begins a sequence of its own, FCB = 1. So that no slave takes profirust's next request for
//! a retry of it, it is only sent when that will have FCB = 0.

use profibus_dp::wire::Sap;
use profirust::dp::DpMaster;
use profirust::fdl::{
    DataTelegramHeader, FdlActiveStation, FdlApplication, FrameCountBit, FunctionCode, RequestType,
    ResponseStatus, Telegram, TelegramTx, TelegramTxResponse,
};
use profirust::time::Instant;

use crate::request::{Request, Service};

/// The FCB in an FC octet.
const FCB: u8 = 0x20;

/// A question to a slave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asked {
    /// Whom.
    pub slave: u8,
    /// For what.
    pub service: Service,
    /// With which data, at most 244 octets; more are left off.
    pub data: Vec<u8>,
}

/// What came of a question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// E5
    Acknowledged,
    /// The code of the answer, and its data.
    Answer(u8, Vec<u8>),
    /// No answer at any attempt.
    Silent,
}

/// What profirust runs.
pub(super) struct Application<'a> {
    pub(super) dp: DpMaster<'a>,
    /// The slave of `dp`.
    address: u8,
    asked: Option<Asked>,
    attempts: u8,
    on_the_line: bool,
    outcome: Option<Outcome>,
    /// The FC octet and the DSAP of the newest request of `dp`, and whether it was answered.
    last_function: u8,
    last_sap: u8,
    answered: bool,
    /// The slave has refused a Chk_Cfg since it was last heard of: it did not take the parameters before.
    pub(super) wants_parameters: bool,
}

impl<'a> Application<'a> {
    pub(super) fn new(dp: DpMaster<'a>, address: u8) -> Self {
        Self {
            dp,
            address,
            asked: None,
            attempts: 0,
            on_the_line: false,
            outcome: None,
            last_function: 0,
            last_sap: 0,
            answered: true,
            wants_parameters: false,
        }
    }

    pub(super) fn address(&self) -> u8 {
        self.address
    }

    pub(super) fn set_last_request(&mut self, (function, sap): (u8, u8)) {
        if !self.on_the_line {
            (self.last_function, self.last_sap) = (function, sap);
        }
    }

    pub(super) fn ask(&mut self, mut asked: Asked) {
        asked.data.truncate(244);
        (self.asked, self.attempts, self.outcome) = (Some(asked), 0, None);
    }

    pub(super) fn take_outcome(&mut self) -> Option<Outcome> {
        self.outcome.take()
    }

    /// Whether the question may be sent now.
    fn may_ask(&self, asked: &Asked) -> bool {
        let others = asked.slave != self.address || self.last_function == 0;
        let offline = !self.dp.iter().any(|(_, peripheral)| peripheral.is_live());
        others || offline || self.answered && self.last_function & FCB != 0
    }

    fn finish(&mut self, outcome: Outcome) {
        (self.asked, self.outcome) = (None, Some(outcome));
    }
}

impl FdlApplication for Application<'_> {
    fn transmit_telegram(
        &mut self,
        now: Instant,
        fdl: &FdlActiveStation,
        tx: TelegramTx<'_>,
        high_prio_only: bool,
    ) -> Option<TelegramTxResponse> {
        if let Some(asked) = &self.asked
            && (self.attempts > 0 || self.may_ask(asked))
        {
            self.attempts += 1;
            self.on_the_line = true;
            let request = Request::service(asked.slave, asked.service, &asked.data);
            let sap = |sap: Sap| (!sap.is_nil()).then_some(sap.0);
            let header = DataTelegramHeader {
                da: request.slave,
                sa: fdl.parameters().address,
                dsap: sap(request.dsap),
                ssap: sap(request.ssap),
                fc: FunctionCode::Request { fcb: FrameCountBit::First, req: RequestType::SrdHigh },
            };
            return Some(
                tx.send_data_telegram(header, request.data.len(), |to| to.copy_from_slice(request.data)),
            );
        }
        let sent = self.dp.transmit_telegram(now, fdl, tx, high_prio_only);
        if sent.is_some_and(|sent| sent.expects_reply().is_some()) {
            self.answered = false;
        }
        sent
    }

    fn receive_reply(&mut self, now: Instant, fdl: &FdlActiveStation, addr: u8, telegram: Telegram<'_>) {
        if !std::mem::take(&mut self.on_the_line) {
            self.answered = true;
            // profirust waits for an E5 that never comes, and believes the slave to be gone then.
            let refused = matches!(&telegram, Telegram::Data(answer)
                if answer.is_response() == Some(ResponseStatus::SapNotEnabled));
            self.wants_parameters |= refused && self.last_sap == Sap::CHK_CFG.0;
            self.dp.receive_reply(now, fdl, addr, telegram);
            return;
        }
        match telegram {
            Telegram::Data(answer) => {
                self.finish(Outcome::Answer(answer.h.fc.to_byte() & 0x0F, answer.pdu.to_vec()));
            }
            _ => self.finish(Outcome::Acknowledged),
        }
    }

    fn handle_timeout(&mut self, now: Instant, fdl: &FdlActiveStation, addr: u8) {
        if !std::mem::take(&mut self.on_the_line) {
            self.dp.handle_timeout(now, fdl, addr);
        } else if self.attempts > fdl.parameters().max_retry_limit {
            self.finish(Outcome::Silent);
        }
    }
}
