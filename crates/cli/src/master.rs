//! A scripted master, for the demonstration: it knows what to ask, and takes one answer at a time.

use bus::{Answer, VirtualSegment};
use plant::EncoderStation;
use profibus_dp::wire::function_code::ResponseCode;
use profibus_dp::wire::telegram::{self, DataTelegram, MAX_OCTETS, Parsed, SC, Telegram};
use profibus_dp::wire::{FunctionCode, Sap};

use crate::Failure;

/// This master's address.
pub(crate) const MASTER: u8 = 2;

/// What the slave answered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Reply {
    /// E5
    Acknowledged,
    /// A response code and data.
    Data(u8, Vec<u8>),
}

/// A master that talks to one slave on a virtual segment.
#[derive(Debug)]
pub(crate) struct Master {
    segment: VirtualSegment<EncoderStation>,
    slave: u8,
    /// The frame count bit of the next request; `None`: a new sequence begins.
    frame_count: Option<bool>,
}

impl Master {
    /// A master that has not spoken to `slave` yet.
    pub(crate) fn new(segment: VirtualSegment<EncoderStation>, slave: u8) -> Self {
        Self { segment, slave, frame_count: None }
    }

    /// The segment, to turn shafts and change worlds.
    pub(crate) fn segment(&mut self) -> &mut VirtualSegment<EncoderStation> {
        &mut self.segment
    }

    /// From now on the slave is at another address.
    pub(crate) fn follow(&mut self, slave: u8) {
        *self = Self { slave, frame_count: None, segment: std::mem::replace(&mut self.segment, empty()) };
    }

    /// Whether a station answers at the slave's address.
    pub(crate) fn find(&mut self) -> bool {
        let request = DataTelegram {
            da: self.slave,
            sa: MASTER,
            fc: FunctionCode(0x49),
            dsap: Sap::NIL,
            ssap: Sap::NIL,
            data: &[],
        };
        matches!(self.send(&request), Answer::Reply(_))
    }

    /// An MS0 service.
    pub(crate) fn service(&mut self, sap: Sap, data: &[u8]) -> Result<Reply, Failure> {
        self.request(sap, Sap::CHK_CFG, data)
    }

    /// Outputs for inputs; whether the answer was high priority.
    pub(crate) fn exchange(&mut self, outputs: &[u8]) -> Result<(Vec<u8>, bool), Failure> {
        match self.request(Sap::NIL, Sap::NIL, outputs)? {
            Reply::Data(code, inputs) if !inputs.is_empty() => {
                Ok((inputs, code == ResponseCode::DataHigh as u8))
            }
            other => Err(Failure::Failed(format!("Data_Exchange was answered with {other:02X?}"))),
        }
    }

    fn request(&mut self, dsap: Sap, ssap: Sap, data: &[u8]) -> Result<Reply, Failure> {
        // SRD high: FCV = 0, FCB = 1 at first, then FCV = 1 and FCB toggles.
        let fc = match self.frame_count {
            None => 0x6D,
            Some(bit) => 0x5D | u8::from(bit) << 5,
        };
        self.frame_count = Some(self.frame_count.is_some_and(|bit| !bit));
        let request = DataTelegram { da: self.slave, sa: MASTER, fc: FunctionCode(fc), dsap, ssap, data };
        let Answer::Reply(reply) = self.send(&request) else {
            return Err(Failure::Failed(format!("station {} does not answer", self.slave)));
        };
        match telegram::parse(&reply.octets) {
            Parsed::Complete(Telegram::ShortAcknowledgement, 1) => Ok(Reply::Acknowledged),
            Parsed::Complete(Telegram::Data(answer), _) => Ok(Reply::Data(answer.fc.0, answer.data.to_vec())),
            _ => Err(Failure::Failed(format!(
                "{:02X?} is no answer (a first octet {SC:02X} would be)",
                reply.octets
            ))),
        }
    }

    fn send(&mut self, request: &DataTelegram<'_>) -> Answer {
        let mut octets = [0; MAX_OCTETS];
        let length = request.emit(&mut octets).unwrap_or(0);
        self.segment.send(octets.get(..length).unwrap_or_default())
    }
}

fn empty() -> VirtualSegment<EncoderStation> {
    VirtualSegment::new(profibus_dp::time::Instant::ZERO, profibus_dp::time::Baudrate::B500000)
}
