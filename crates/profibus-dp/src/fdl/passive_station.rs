//! The passive station: which telegrams are for it, the FCB memory, the reply and its window.
//!
//! | FCV | FCB | condition | class |
//! |-----|-----|-----------|-------|
//! | 0 | 1 | - | first: executed |
//! | 1 | x | SA, FCB, function, DSAP and SSAP as stored | retry: the stored octets again |
//! | 1 | x | else | new: executed |
//! | 0 | 0 | - | executed, nothing stored |
//!
//! FDL status, Ident and LSAP status have six octets of their own and leave the memory alone.

use super::station::Window;
use crate::time::{Baudrate, BitTimes, Duration, Instant};
use crate::wire::Sap;
use crate::wire::function_code::{Function, FunctionCode, ResponseCode};
use crate::wire::telegram::{self, BROADCAST, DataTelegram, ED, SC, SD1, SD2, extension_bit};

/// What a telegram is to the station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Class {
    /// Not for us, or nothing that is ever answered.
    Ignored,
    /// SDN, to us or to all.
    Unacknowledged,
    /// FDL status, Ident or LSAP status: the answer is ready.
    Status,
    /// SDA or SRD as before: the stored answer is ready.
    Retry,
    /// SDA or SRD to execute.
    Request,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Due {
    Nothing,
    /// The six octets of a status answer.
    Status,
    /// What the FCB memory holds.
    Memory,
}

/// Octets of an answer with 255 inputs, if there were such an answer.
const MOST_INPUTS: usize = 7 + 255 + 2;
/// Data octets beside two SAP octets.
pub(crate) const MOST_DATA: usize = telegram::MAX_PDU - 2;
/// Off the bus: no telegram has this destination.
const NO_ADDRESS: u8 = 0xFF;

/// What of a request its retry must repeat: FC without FCV, SA, DSAP and SSAP, as one number,
/// so that one comparison does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stored(u32);

impl Stored {
    /// No request is like this: bit 6 of its FC is 1.
    const NOTHING: Self = Self(0);

    #[inline(always)]
    const fn new(sa: u8, fc: FunctionCode, dsap: Sap, ssap: Sap) -> Self {
        Self(u32::from_le_bytes([fc.without_fcv(), sa, dsap.0, ssap.0]))
    }
}

/// Address, FCB memory and reply of a passive station.
#[derive(Debug, Clone)]
pub struct PassiveStation {
    address: u8,
    min_tsdr: u8,
    due: Due,
    /// How many octets the stored answer has.
    length: u8,
    status: [u8; telegram::SD1_OCTETS],
    stored: Stored,
    /// End of request to the window's edges, in nanoseconds.
    delays: (u32, u32),
    window: Window,
    // Longer than any telegram: as many inputs as an octet can count are always inside.
    octets: [u8; MOST_INPUTS],
}

impl PassiveStation {
    /// A station that has heard nothing yet; `address` 0 to 126, `None`: off the bus.
    pub fn new(address: Option<u8>, rate: Baudrate) -> Self {
        let mut station = Self::blank();
        station.restart(address, rate);
        station
    }

    /// What [`restart`](Self::restart) makes a station of, where it lies.
    pub(crate) const fn blank() -> Self {
        Self {
            address: NO_ADDRESS,
            min_tsdr: 11,
            due: Due::Nothing,
            length: 0,
            status: [0; telegram::SD1_OCTETS],
            stored: Stored::NOTHING,
            delays: (0, 0),
            window: Window { not_before: Instant::ZERO, not_after: Instant::ZERO },
            octets: [0; MOST_INPUTS],
        }
    }

    /// As new.
    pub(crate) fn restart(&mut self, address: Option<u8>, rate: Baudrate) {
        self.set_address(address);
        self.set_times(rate, 11);
    }

    /// The address it answers to.
    pub const fn address(&self) -> Option<u8> {
        if self.address == NO_ADDRESS { None } else { Some(self.address) }
    }

    /// Takes another address; the FCB memory is cleared.
    pub fn set_address(&mut self, address: Option<u8>) {
        self.address = address.filter(|&address| address < BROADCAST).unwrap_or(NO_ADDRESS);
        self.forget();
    }

    /// min T_SDR in force, in bit times: 11 to 255.
    #[doc(alias = "min Tsdr")]
    pub const fn min_tsdr(&self) -> u8 {
        self.min_tsdr
    }

    /// From the end of a request to the earliest start of its reply: min T_SDR in force.
    #[inline]
    pub const fn reply_delay(&self) -> Duration {
        Duration::from_nanos(self.delays.0 as u64)
    }

    /// Sets the window of the replies to come: from min T_SDR to
    /// max(max T_SDR of the rate, min T_SDR) + 11 bit times.
    pub(crate) fn set_times(&mut self, rate: Baudrate, min_tsdr: u8) {
        self.min_tsdr = min_tsdr;
        let earliest = BitTimes(u32::from(min_tsdr));
        let latest = BitTimes(earliest.max(rate.max_tsdr()).0.saturating_add(11));
        let nanos = |bits| u32::try_from(rate.duration(bits).as_nanos()).unwrap_or(u32::MAX);
        self.delays = (nanos(earliest), nanos(latest));
    }

    /// Takes a new address with the reply that is due; the FCB memory is cleared.
    pub(crate) fn rename(&mut self, address: u8) {
        self.address = address;
        self.stored = Stored::NOTHING;
    }

    /// Whether [`transmit`](Self::transmit) hands out the answer in the FCB memory now.
    pub(crate) fn answer_is_due(&self, now: Instant) -> bool {
        self.due == Due::Memory && self.window_is_open(now)
    }

    #[inline]
    fn window_is_open(&self, now: Instant) -> bool {
        now >= self.window.not_before && now <= self.window.not_after
    }

    /// Empties the FCB memory and drops the reply.
    pub(crate) fn forget(&mut self) {
        self.stored = Stored::NOTHING;
        self.due = Due::Nothing;
    }

    /// Drops the reply that has not been fetched; the FCB memory keeps it for a retry.
    #[inline]
    pub(crate) fn drop_reply(&mut self) {
        self.due = Due::Nothing;
    }

    /// Whether this is our address, without a SAP.
    #[inline(always)]
    pub(crate) const fn is_address(&self, da: u8) -> bool {
        da == self.address
    }

    /// Whether a telegram with this destination concerns us at all.
    #[inline(always)]
    pub(crate) const fn is_meant(&self, da: u8) -> bool {
        da == self.address || da == BROADCAST
    }

    /// Says what a telegram is to us, and prepares the answers that need nobody else.
    pub(crate) fn classify(&mut self, request: &DataTelegram<'_>) -> Class {
        if !self.is_meant(request.da)
            || self.address == NO_ADDRESS
            || request.sa == self.address
            || request.sa >= BROADCAST
            || !request.fc.is_request()
            || !request.dsap.is_plain()
            || !request.ssap.is_plain()
        {
            return Class::Ignored;
        }
        match request.fc.function() {
            Function::SendDataNoAcknowledge => Class::Unacknowledged,
            _ if request.da == BROADCAST => Class::Ignored,
            Function::SendAndRequestData | Function::SendDataWithAcknowledge => {
                if self.is_retry(request.sa, request.fc, request.dsap, request.ssap) {
                    Class::Retry
                } else {
                    Class::Request
                }
            }
            Function::FdlStatus => self.answer_status(request.sa, ResponseCode::Ok),
            Function::Ident => self.answer_status(request.sa, ResponseCode::NoResponseData),
            Function::LsapStatus => self.answer_status(request.sa, ResponseCode::NoService),
            Function::Other => Class::Ignored,
        }
    }

    /// Reading "FCB guard": a retry repeats SA, FCB, function, DSAP and SSAP; its data may differ.
    ///
    /// Whether an SDA or SRD is a retry; then the stored answer is due again. If not, it is
    /// remembered for its own retries.
    #[inline(always)]
    pub(crate) fn is_retry(&mut self, sa: u8, fc: FunctionCode, dsap: Sap, ssap: Sap) -> bool {
        let request = Stored::new(sa, fc, dsap, ssap);
        let counted = if fc.frame_count_valid() {
            if request == self.stored {
                self.due = Due::Memory;
                return true;
            }
            true
        } else {
            fc.frame_count_bit()
        };
        self.stored = if counted { request } else { Stored::NOTHING };
        false
    }

    fn answer_status(&mut self, master: u8, code: ResponseCode) -> Class {
        self.status = self.short_telegram(master, code);
        self.due = Due::Status;
        Class::Status
    }

    fn short_telegram(&self, master: u8, code: ResponseCode) -> [u8; telegram::SD1_OCTETS] {
        let fcs = master.wrapping_add(self.address).wrapping_add(code as u8);
        [SD1, master, self.address, code as u8, fcs, ED]
    }

    /// Opens the window for the answer prepared; the request ended at `now`.
    #[inline(always)]
    pub(crate) fn open_window(&mut self, now: Instant) -> Window {
        let (earliest, latest) = self.delays;
        self.window = Window {
            not_before: now + Duration::from_nanos(u64::from(earliest)),
            not_after: now + Duration::from_nanos(u64::from(latest)),
        };
        self.window
    }

    /// The reply, once, if `now` lies in its window.
    #[inline]
    pub(crate) fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        if !self.window_is_open(now) {
            return None;
        }
        match core::mem::replace(&mut self.due, Due::Nothing) {
            Due::Nothing => None,
            Due::Memory => self.octets.get(..usize::from(self.length)),
            Due::Status => Some(&self.status),
        }
    }

    /// Answers E5.
    pub(crate) fn acknowledge(&mut self) {
        self.octets[0] = SC;
        self.keep(1);
    }

    /// Answers an SD1 without data: RS, RR, or DH of a slave without inputs.
    pub(crate) fn answer_short(&mut self, master: u8, code: ResponseCode) {
        let answer = self.short_telegram(master, code);
        if let Some(place) = self.octets.first_chunk_mut() {
            *place = answer;
        }
        self.keep(6);
    }

    /// Answers a Data_Exchange with `inputs` octets, [`MOST_DATA`] at most, that `fill` writes; it
    /// returns their sum.
    #[inline(always)]
    pub(crate) fn answer_inputs(
        &mut self,
        master: u8,
        code: ResponseCode,
        inputs: u8,
        fill: impl FnOnce(&mut [u8]) -> u8,
    ) {
        let le = u32::from(inputs).wrapping_add(3);
        let end = usize::from(inputs).wrapping_add(7);
        if let Some(head) = self.octets.first_chunk_mut() {
            // SD2, LE, LE, SD2 at one stroke.
            *head = le.wrapping_mul(0x0001_0100).wrapping_add(0x6800_0068).to_le_bytes();
        }
        if let Some(addresses) = self.octets.get_mut(4..).and_then(|octets| octets.first_chunk_mut()) {
            *addresses = [master, self.address, code as u8];
        }
        let Some(place) = self.octets.get_mut(7..end) else {
            return;
        };
        let sum = fill(place).wrapping_add(master).wrapping_add(self.address).wrapping_add(code as u8);
        if let Some(tail) = self.octets.get_mut(end..).and_then(|tail| tail.first_chunk_mut()) {
            *tail = [sum, ED];
        }
        self.keep(inputs.wrapping_add(9));
    }

    /// Answers a service with data that `fill` writes into up to 244 octets, returning how many;
    /// E5 where there are none.
    pub(crate) fn answer_data(&mut self, request: &DataTelegram<'_>, fill: impl FnOnce(&mut [u8]) -> usize) {
        let saps = [request.ssap, request.dsap];
        let mut start = 7usize;
        for sap in saps.into_iter().filter(|sap| !sap.is_nil()) {
            if let Some(place) = self.octets.get_mut(start) {
                *place = sap.0;
            }
            start = start.wrapping_add(1);
        }
        let Some(place) = self.octets.get_mut(start..start.wrapping_add(MOST_DATA)) else {
            return;
        };
        let length = fill(place).min(MOST_DATA);
        if length == 0 {
            return self.acknowledge();
        }
        let end = start.wrapping_add(length);
        let le = u8::try_from(end.wrapping_sub(4)).unwrap_or(0);
        if let Some(head) = self.octets.first_chunk_mut() {
            let [da, sa] = [(request.sa, request.ssap), (self.address, request.dsap)]
                .map(|(address, sap)| address | extension_bit(sap));
            *head = [SD2, le, le, SD2, da, sa, ResponseCode::DataLow as u8];
        }
        let sum = telegram::sum(self.octets.get(4..end).unwrap_or(&[]));
        if let Some(tail) = self.octets.get_mut(end..).and_then(|tail| tail.first_chunk_mut()) {
            *tail = [sum, ED];
        }
        self.keep(le.wrapping_add(6));
    }

    #[inline]
    fn keep(&mut self, length: u8) {
        self.length = length;
        self.due = Due::Memory;
    }
}

/// Whether a later request of the same master shows that it has got the answer to `earlier`: only
/// then has the frame count bit toggled, or a new sequence begun.
pub(crate) const fn confirms(earlier: FunctionCode, later: FunctionCode) -> bool {
    !later.frame_count_valid() || later.frame_count_bit() != earlier.frame_count_bit()
}
