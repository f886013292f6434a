//! The MS0 state machine of a DP-V0 slave.
//!
//! | state | owner | leaves it |
//! |-------|-------|-----------|
//! | Wait_Prm | none | good Set_Prm: Wait_Cfg |
//! | Wait_Cfg | who sent it | good Chk_Cfg: data exchange; fault, unlock, watchdog: Wait_Prm |
//! | Data_Exch | the same | fault, unlock, watchdog, wrong output length: Wait_Prm |

use super::application::Application;
use super::event::{Cause, Event};
use super::freeze_sync::FreezeSync;
use super::refusal::Refusal;
use super::watchdog::Watchdog;
use crate::fdl::baud_search::{BaudSearch, BaudSetting, Change};
use crate::fdl::passive_station::{self, Class, PassiveStation};
use crate::fdl::station::Window;
use crate::time::{Baudrate, Instant};
use crate::wire::chk_cfg::Lengths;
use crate::wire::function_code::FunctionCode;
use crate::wire::telegram::{ADDRESS, Frame, SD2};
use crate::wire::{DataTelegram, Sap, Telegram};

/// Where the slave stands, and what holds there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Waits for Set_Prm or Set_Slave_Add.
    #[doc(alias = "WAIT-PRM")]
    WaitPrm,
    /// Parameterized; waits for Chk_Cfg.
    #[doc(alias = "WAIT-CFG")]
    WaitCfg(Session),
    /// Exchanges so many octets.
    #[doc(alias = "DATA-EXCH")]
    DataExchange(Session, Lengths),
}

/// What a master's Set_Prm has settled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Session {
    /// Master_Add: who owns the slave.
    #[doc(alias = "Master_Add")]
    pub owner: u8,
    /// The groups it belongs to.
    #[doc(alias = "Group_Ident")]
    pub group_ident: u8,
}

impl State {
    /// The session, if there is an owner.
    pub const fn session(&self) -> Option<Session> {
        match *self {
            Self::WaitPrm => None,
            Self::WaitCfg(session) | Self::DataExchange(session, _) => Some(session),
        }
    }

    /// Master_Add.
    pub fn owner(&self) -> Option<u8> {
        self.session().map(|session| session.owner)
    }

    /// Whether data is exchanged.
    pub const fn is_data_exchange(&self) -> bool {
        matches!(self, Self::DataExchange(..))
    }
}

/// The fault bits of diagnosis octet 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Faults {
    pub(super) prm: bool,
    pub(super) cfg: bool,
    pub(super) not_supported: bool,
}

/// Whether the owner has seen the diagnosis as it is now (Diag_Flag).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Announcement {
    /// Diag_Flag: a change waits to be fetched.
    pub(super) pending: bool,
    /// The owner's Slave_Diag that was answered with all changes up to then.
    pub(super) fetch: Option<Fetch>,
}

/// A Slave_Diag of the owner: counts when its answer has been handed out and the owner's next
/// frame shows that it has arrived.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fetch {
    pub(super) fc: FunctionCode,
    pub(super) sent: bool,
}

/// What follows when an answer is handed out; a retry finds it waiting still.
///
/// Readings "Effective address" and "Replies": a new address holds from the moment its E5 is
/// handed out, for that counts as sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OnSending {
    Nothing,
    /// The diagnosis in it has been sent.
    CountAsFetched,
    /// The E5 to a Set_Slave_Add: the new address holds.
    TakeAddress(u8),
}

/// The slave on whole telegrams: station, baud search, watchdog, MS0 states, application.
///
/// `IN` and `OUT` are the most input and output octets of any configuration.
#[derive(Debug)]
pub struct Slave<A, const IN: usize, const OUT: usize> {
    pub(super) station: PassiveStation,
    pub(super) watchdog: Watchdog,
    pub(super) state: State,
    pub(super) announcement: Announcement,
    pub(super) faults: Faults,
    /// What follows when the answer in the FCB memory is handed out.
    pub(super) on_sending: OnSending,
    pub(super) modes: FreezeSync<IN, OUT>,
    pub(super) application: A,
    baud: BaudSearch,
    /// Not later than the first thing that time brings; looked at before every telegram.
    alarm: Instant,
    /// The rate has changed since the receiver was told.
    retuned: bool,
    /// The telegram that comes in will be a Data_Exchange that is answered with data.
    ahead: bool,
    /// SD2, LE, DA and SA of such a telegram; nothing that there is where none is answered so.
    expected: [u8; 4],
}

impl<A: Application, const IN: usize, const OUT: usize> Slave<A, IN, OUT> {
    /// A slave at power-on.
    pub fn new(now: Instant, address: Option<u8>, baud: BaudSetting, application: A) -> Self {
        let mut slave = Self::blank(application);
        slave.restart(now, address, baud);
        slave
    }

    /// What [`restart`](Self::restart) makes a slave of, where it lies.
    pub(super) const fn blank(application: A) -> Self {
        Self {
            station: PassiveStation::blank(),
            watchdog: Watchdog::OFF,
            state: State::WaitPrm,
            announcement: Announcement { pending: false, fetch: None },
            faults: Faults { prm: false, cfg: false, not_supported: false },
            on_sending: OnSending::Nothing,
            modes: FreezeSync::new(),
            application,
            baud: BaudSearch::new(Instant::ZERO, BaudSetting::Fixed(Baudrate::B9600)),
            alarm: Instant::MAX,
            retuned: false,
            ahead: false,
            expected: [0; 4],
        }
    }

    /// As at power-on, but for the application.
    pub(super) fn restart(&mut self, now: Instant, address: Option<u8>, baud: BaudSetting) {
        self.baud = BaudSearch::new(now, baud);
        self.station.restart(address, self.baud.rate());
        self.watchdog = Watchdog::OFF;
        self.state = State::WaitPrm;
        self.announcement = Announcement::default();
        self.faults = Faults::default();
        self.on_sending = OnSending::Nothing;
        self.modes = FreezeSync::new();
        (self.retuned, self.ahead, self.expected) = (false, false, [0; 4]);
        self.rearm();
    }

    /// Where it stands.
    pub const fn state(&self) -> &State {
        &self.state
    }

    /// The passive station.
    pub const fn station(&self) -> &PassiveStation {
        &self.station
    }

    /// The application.
    pub const fn application(&self) -> &A {
        &self.application
    }

    /// The application, to feed it.
    pub const fn application_mut(&mut self) -> &mut A {
        &mut self.application
    }

    /// The rate in use or listened to.
    pub const fn baudrate(&self) -> Baudrate {
        self.baud.rate()
    }

    /// Whether the baud rate is known.
    pub const fn baudrate_is_found(&self) -> bool {
        self.baud.is_found()
    }

    /// [`indicate`](Self::indicate) for callers that are not in a hurry.
    #[inline(never)]
    pub(super) fn indicate_out_of_line(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        self.indicate(now, telegram)
    }

    /// Takes a telegram that ended at `now`; the window of the reply, where there is one.
    #[inline]
    pub fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        self.station.drop_reply();
        let Telegram::Data(request) = telegram else {
            return None;
        };
        if !self.is_heard(now) || !self.station.is_meant(request.da) {
            return None;
        }
        if request.dsap.is_nil()
            && request.ssap.is_nil()
            && self.station.is_address(request.da)
            && let Some(lengths) = self.is_exchange(request.sa, request.fc)
        {
            return Some(self.exchange(now, request.sa, request.fc, request.data, lengths));
        }
        self.request(now, *request)
    }

    /// [`indicate`](Self::indicate) for the frame that was just received, which has all its SAPs.
    /// Replies have been dropped already, and the telegram [is heard](Self::is_heard).
    #[inline(always)]
    pub(super) fn frame(&mut self, now: Instant, frame: Frame<'_>) -> Option<Window> {
        // An address that announces a SAP is none of those compared with.
        if self.station.is_address(frame.da) {
            if let Some(lengths) = self.is_exchange(frame.sa, frame.fc) {
                return Some(self.exchange(now, frame.sa, frame.fc, frame.pdu, lengths));
            }
        } else if !self.is_meant(frame.da) {
            return None;
        }
        // Piece by piece: in registers, not by way of memory.
        self.request_in_frame(now, [frame.da, frame.sa, frame.fc.0], frame.pdu)
    }

    /// [`frame`](Self::frame) for an SD1 or SD3: in fewer octets of text, not in fewer steps.
    pub(super) fn rarer_frame(&mut self, now: Instant, frame: Frame<'_>) -> Option<Window> {
        if !self.is_meant(frame.da) {
            return None;
        }
        if self.station.is_address(frame.da)
            && let Some(lengths) = self.is_exchange(frame.sa, frame.fc)
        {
            self.watchdog.retrigger(now);
            if !self.station.is_retry(frame.sa, frame.fc, Sap::NIL, Sap::NIL) {
                self.on_sending = OnSending::Nothing;
                self.announcing_exchange(now, frame.sa, frame.fc, frame.pdu, lengths);
            }
            return Some(self.station.open_window(now));
        }
        self.request_in_frame(now, [frame.da, frame.sa, frame.fc.0], frame.pdu)
    }

    /// Whether a frame with this destination concerns us at all.
    #[inline(always)]
    pub(super) const fn is_meant(&self, da: u8) -> bool {
        self.station.is_meant(da & ADDRESS)
    }

    /// What every error-free telegram on the bus does: time is looked at, and the baud rate is
    /// alive. `false`: it ended the search for the rate, and is not answered itself. Only then
    /// may the rate be another one.
    #[inline(always)]
    pub(super) fn is_heard(&mut self, now: Instant) -> bool {
        if now >= self.alarm {
            self.pass_time(now);
        }
        if self.baud.life(now) {
            self.baudrate_found(now);
            return false;
        }
        true
    }

    /// Whether this is the owner's Data_Exchange, the usual telegram to us; and its lengths.
    #[inline(always)]
    fn is_exchange(&self, sa: u8, fc: FunctionCode) -> Option<Lengths> {
        match self.state {
            State::DataExchange(session, lengths) if session.owner == sa && fc.is_srd_request() => {
                Some(lengths)
            }
            _ => None,
        }
    }

    /// A telegram begins: the reply before it is dropped, and nothing is known ahead.
    #[inline(always)]
    pub(super) fn begin(&mut self) {
        self.drop_reply();
        self.ahead = false;
    }

    /// All of a telegram has come but its end delimiter.
    ///
    /// Remembers whether it is to be answered with data. A retry is, too: the answer before was
    /// given in data exchange as well, or else a Set_Prm and a Chk_Cfg had come since.
    #[inline(always)]
    pub(super) fn anticipate(&mut self, start: u8, le: u8, [da, sa, fc]: [u8; 3]) {
        self.ahead = FunctionCode(fc).is_srd_request()
            && u32::from_ne_bytes([start, le, da, sa]) == u32::from_ne_bytes(self.expected);
    }

    /// Data is exchanged from now on; works out what can be known ahead.
    pub(super) fn expect(&mut self, session: Session, lengths: Lengths) {
        let address = self.station.address();
        self.expected = match address.filter(|_| lengths.inputs != 0) {
            Some(address) => [SD2, lengths.outputs.wrapping_add(3), address, session.owner],
            None => [0; 4],
        };
    }

    /// Whether what has come by now is answered with data, if time brings nothing before.
    #[inline(always)]
    pub(super) fn answers_data(&self, now: Instant) -> bool {
        self.ahead && self.baud.is_found() && now < self.alarm
    }

    /// The owner's Data_Exchange.
    #[inline(always)]
    fn exchange(
        &mut self,
        now: Instant,
        sa: u8,
        fc: FunctionCode,
        outputs: &[u8],
        lengths: Lengths,
    ) -> Window {
        self.watchdog.retrigger(now);
        if !self.station.is_retry(sa, fc, Sap::NIL, Sap::NIL) {
            self.on_sending = OnSending::Nothing;
            if self.announcement.pending {
                self.announcing_exchange(now, sa, fc, outputs, lengths);
            } else {
                self.data_exchange(now, sa, outputs, lengths, false);
            }
        }
        self.station.open_window(now)
    }

    /// A Data_Exchange while a change of the diagnosis waits to be fetched. By itself, so that
    /// all others need not look at that twice.
    #[cold]
    #[inline(never)]
    fn announcing_exchange(
        &mut self,
        now: Instant,
        sa: u8,
        fc: FunctionCode,
        outputs: &[u8],
        lengths: Lengths,
    ) {
        self.confirm_fetch(fc);
        self.data_exchange(now, sa, outputs, lengths, self.announcement.pending);
    }

    #[cold]
    #[inline(never)]
    fn request_in_frame(&mut self, now: Instant, [da, sa, fc]: [u8; 3], pdu: &[u8]) -> Option<Window> {
        self.request(now, DataTelegram::from_wire(da, sa, fc, pdu).ok()?)
    }

    /// Every telegram to us but the owner's Data_Exchange.
    #[inline(never)]
    fn request(&mut self, now: Instant, request: DataTelegram<'_>) -> Option<Window> {
        let class = self.station.classify(&request);
        // Before the service: a new min T_SDR holds from the next answer on.
        let window = match class {
            Class::Ignored | Class::Unacknowledged => None,
            Class::Status | Class::Retry | Class::Request => Some(self.station.open_window(now)),
        };
        let is_owner = self.state.owner() == Some(request.sa);
        match class {
            Class::Unacknowledged => self.unacknowledged(now, &request),
            Class::Retry | Class::Request if is_owner => self.watchdog.retrigger(now),
            _ => {}
        }
        if class == Class::Request {
            self.on_sending = OnSending::Nothing;
            if is_owner {
                self.confirm_fetch(request.fc);
            }
            self.serve(now, &request);
        }
        window
    }

    #[cold]
    #[inline(never)]
    fn confirm_fetch(&mut self, later: FunctionCode) {
        if let Some(Fetch { fc, sent: true }) = self.announcement.fetch
            && passive_station::confirms(fc, later)
        {
            self.announcement = Announcement::default();
        }
    }

    /// A bit of the diagnosis that is sent has changed: answers are high priority until the
    /// owner has fetched it. Without effect outside data exchange.
    pub fn diagnosis_changed(&mut self) {
        self.announcement = Announcement { pending: self.state.is_data_exchange(), fetch: None };
    }

    /// Whether a change of the diagnosis waits to be fetched (Diag_Flag).
    pub const fn diagnosis_is_pending(&self) -> bool {
        self.announcement.pending
    }

    /// The reply, once, if `now` lies in its window. An address set with it holds from here on.
    #[inline]
    pub fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        if self.on_sending != OnSending::Nothing {
            self.sending(now);
        }
        self.station.transmit(now)
    }

    /// What holds from the moment an answer is handed out.
    #[cold]
    fn sending(&mut self, now: Instant) {
        if !self.station.answer_is_due(now) {
            return;
        }
        match core::mem::replace(&mut self.on_sending, OnSending::Nothing) {
            OnSending::Nothing => {}
            OnSending::CountAsFetched => {
                if let Some(fetch) = &mut self.announcement.fetch {
                    fetch.sent = true;
                }
            }
            OnSending::TakeAddress(address) => {
                self.station.rename(address);
                self.application.address_taken(now, address);
                self.tell(now, Event::AddressTaken(address));
            }
        }
    }

    /// Drops a reply that was not fetched: the master has gone on.
    #[inline]
    pub fn drop_reply(&mut self) {
        self.station.drop_reply();
    }

    /// A character with an error.
    pub fn line_error(&mut self, now: Instant) {
        self.drop_reply();
        if let Some(change) = self.baud.line_error(now) {
            self.baudrate_changed(now, change);
        }
    }

    /// Lets time pass.
    pub fn poll(&mut self, now: Instant) {
        if now >= self.alarm {
            self.pass_time(now);
        }
    }

    /// When time brings something; never later, maybe earlier.
    pub fn next_deadline(&self) -> Option<Instant> {
        (self.alarm < Instant::MAX).then_some(self.alarm)
    }

    /// The host tells the baud rate.
    pub fn set_baudrate(&mut self, now: Instant, rate: Baudrate) {
        let news = !self.baud.is_found() || self.baud.rate() != rate;
        self.baud.fix(rate);
        if news {
            self.baudrate_changed(now, Change::Found(rate));
        }
    }

    /// The device cannot exchange data any longer.
    pub fn leave_master(&mut self, now: Instant) {
        if self.state.session().is_some() {
            self.leave(now, Cause::Application);
        }
    }

    /// LEAVE-MASTER: outputs cleared, modes off, no owner, watchdog stopped, Wait_Prm.
    pub(super) fn leave(&mut self, now: Instant, cause: Cause) {
        self.state = State::WaitPrm;
        (self.ahead, self.expected) = (false, [0; 4]);
        self.announcement = Announcement::default();
        self.modes.leave();
        self.watchdog.set(now, None);
        self.baud.begin_control(now);
        self.rearm();
        self.application.clear_outputs(now);
        self.application.master_left(now);
        self.tell(now, Event::MasterLeft(cause));
    }

    #[cold]
    #[inline(never)]
    fn pass_time(&mut self, now: Instant) {
        if let Some(expired) = self.watchdog.deadline().filter(|&deadline| now >= deadline) {
            self.leave(expired, Cause::WatchdogExpired);
        }
        while let Some(change) = self.baud.poll(now, self.watchdog.is_on()) {
            self.baudrate_changed(now, change);
        }
        self.rearm();
    }

    /// Sets the alarm to what comes first: watchdog or baud search.
    pub(super) fn rearm(&mut self) {
        let expires = self.watchdog.deadline().unwrap_or(Instant::MAX);
        let searches = self.baud.deadline(self.watchdog.is_on()).unwrap_or(Instant::MAX);
        self.alarm = if expires < searches { expires } else { searches };
    }

    #[cold]
    fn baudrate_found(&mut self, now: Instant) {
        self.baudrate_changed(now, Change::Found(self.baud.rate()));
    }

    fn baudrate_changed(&mut self, now: Instant, change: Change) {
        self.station.forget();
        self.on_sending = OnSending::Nothing;
        self.station.set_times(self.baud.rate(), self.station.min_tsdr());
        self.retuned = true;
        self.rearm();
        self.tell(
            now,
            match change {
                Change::Listening(rate) => Event::Listening(rate),
                Change::Found(rate) => Event::BaudrateFound(rate),
            },
        );
    }

    /// No DP watchdog any longer: the baud rate is supervised from now on.
    pub(super) fn baud_control(&mut self, now: Instant) {
        self.baud.begin_control(now);
    }

    /// The new rate, if it has changed since the last call.
    #[inline(always)]
    pub(super) fn take_retuned(&mut self) -> Option<Baudrate> {
        if !self.retuned {
            return None;
        }
        self.retuned = false;
        Some(self.baud.rate())
    }

    pub(super) fn tell(&mut self, now: Instant, event: Event) {
        self.application.observe(now, &event);
    }

    pub(super) fn refused(&mut self, now: Instant, refusal: Refusal) {
        self.tell(now, Event::Refused(refusal));
    }
}
