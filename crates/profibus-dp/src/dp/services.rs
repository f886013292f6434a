//! The services of MS0: one function each.

use super::application::{Application, PrmVerdict};
use super::event::{Cause, Event};
use super::refusal::{Refusal, Service};
use super::slave::{Announcement, Faults, Fetch, OnSending, Session, Slave, State};
use crate::fdl::passive_station::MOST_DATA;
use crate::time::{BitTimes, Instant};
use crate::wire::chk_cfg::Lengths;
use crate::wire::function_code::ResponseCode;
use crate::wire::global_control::{GlobalControl, ModeCommand};
use crate::wire::set_slave_add::SetSlaveAdd;
use crate::wire::slave_diag::{self, StandardDiagnosis};
use crate::wire::{DataTelegram, Sap, SetPrm};

/// A slave at this address waits for a real one and never exchanges data.
const UNSET_ADDRESS: u8 = 126;

impl<A: Application, const IN: usize, const OUT: usize> Slave<A, IN, OUT> {
    /// Data_Exchange of the owner: outputs taken, inputs answered. `pending`: a change of the
    /// diagnosis is announced with them.
    #[inline(always)]
    pub(super) fn data_exchange(
        &mut self,
        now: Instant,
        master: u8,
        outputs: &[u8],
        lengths: Lengths,
        pending: bool,
    ) {
        if outputs.len() != usize::from(lengths.outputs) {
            return self.odd_data_exchange(now, master, outputs, lengths);
        }
        if self.modes.is_sync() {
            self.modes.hold(outputs);
        } else {
            self.application.write_outputs(now, outputs);
        }
        self.answer_inputs(master, lengths, pending);
    }

    #[inline(always)]
    fn answer_inputs(&mut self, master: u8, lengths: Lengths, pending: bool) {
        let high = pending || self.application.static_diagnosis();
        let code = if high { ResponseCode::DataHigh } else { ResponseCode::DataLow };
        if lengths.inputs == 0 {
            return if high { self.station.answer_short(master, code) } else { self.station.acknowledge() };
        }
        let (modes, application) = (&self.modes, &self.application);
        self.station.answer_inputs(master, code, lengths.inputs, |to| {
            if modes.is_frozen() { modes.read_frozen(to) } else { application.read_inputs(to) }
        });
    }

    /// Reading "Empty Data_Exchange": another number of octets than agreed on; empty clears the outputs of a fail-safe slave,
    /// everything else ends the exchange.
    #[cold]
    #[inline(never)]
    fn odd_data_exchange(&mut self, now: Instant, master: u8, outputs: &[u8], lengths: Lengths) {
        if outputs.is_empty() && self.application.is_fail_safe() {
            self.modes.drop_held();
            self.application.clear_outputs(now);
            return self.answer_inputs(master, lengths, self.announcement.pending);
        }
        self.station.answer_short(master, ResponseCode::NoService);
        let received = u8::try_from(outputs.len()).unwrap_or(u8::MAX);
        self.refused(now, Refusal::OutputLength { received, due: lengths.outputs });
        self.leave(now, Cause::OutputLength);
    }

    /// Every SDA, and every SRD but the owner's Data_Exchange.
    pub(super) fn serve(&mut self, now: Instant, request: &DataTelegram<'_>) {
        match request.dsap {
            sap if !request.fc.is_srd_request() => self.answer_no_service(now, request, service_of(sap)),
            Sap::SLAVE_DIAG => self.slave_diag(now, request),
            Sap::GET_CFG => self.get_cfg(now, request),
            Sap::SET_PRM => self.set_prm(now, request),
            Sap::CHK_CFG => self.chk_cfg(now, request),
            Sap::SET_SLAVE_ADD => self.set_slave_add(now, request),
            Sap::RD_INP => self.rd_inp(now, request),
            Sap::RD_OUTP => self.rd_outp(now, request),
            sap => self.answer_no_service(now, request, service_of(sap)),
        }
    }

    /// RS, with the reason.
    fn answer_no_service(&mut self, now: Instant, request: &DataTelegram<'_>, service: Service) {
        self.station.answer_short(request.sa, ResponseCode::NoService);
        let refusal = match self.state.owner() {
            Some(owner) if owner != request.sa => {
                Refusal::OtherMaster { service, owner, requester: request.sa }
            }
            _ => Refusal::NotInThisState(service),
        };
        self.refused(now, refusal);
    }

    /// Whether a read service came with data; it is answered RR then.
    fn has_data(&mut self, now: Instant, request: &DataTelegram<'_>, service: Service) -> bool {
        if request.data.is_empty() {
            return false;
        }
        self.station.answer_short(request.sa, ResponseCode::NoResource);
        self.refused(now, Refusal::DataInReadRequest(service));
        true
    }

    /// Slave_Diag: any state, any master. The owner's is the one that counts as fetching.
    fn slave_diag(&mut self, now: Instant, request: &DataTelegram<'_>) {
        if self.has_data(now, request, Service::SlaveDiag) {
            return;
        }
        let standard = self.standard_diagnosis();
        let (application, exchanging) = (&self.application, self.state.is_data_exchange());
        self.station.answer_data(request, |to| {
            let Some((head, extended)) = to.split_first_chunk_mut::<{ slave_diag::STANDARD_OCTETS }>() else {
                return 0;
            };
            let extended = application.diagnosis(exchanging, extended);
            *head = StandardDiagnosis { ext_diag_overflow: extended.overflow, ..standard }.emit();
            extended.length.saturating_add(slave_diag::STANDARD_OCTETS)
        });
        if self.announcement.pending && self.state.owner() == Some(request.sa) {
            self.announcement.fetch = Some(Fetch { fc: request.fc, sent: false });
            self.on_sending = OnSending::CountAsFetched;
        }
    }

    /// Octets 1 to 6 of the diagnosis as they are now.
    pub fn standard_diagnosis(&self) -> StandardDiagnosis {
        StandardDiagnosis {
            station_not_ready: !self.state.is_data_exchange(),
            cfg_fault: self.faults.cfg,
            not_supported: self.faults.not_supported,
            prm_fault: self.faults.prm,
            prm_req: self.state == State::WaitPrm,
            stat_diag: self.application.static_diagnosis(),
            watchdog_on: self.watchdog.is_on(),
            freeze_mode: self.modes.is_frozen(),
            sync_mode: self.modes.is_sync(),
            master_add: self.state.owner(),
            ident_number: self.application.ident_number(),
            ext_diag: self.application.external_diagnosis(self.state.is_data_exchange()),
            ext_diag_overflow: false,
        }
    }

    /// Get_Cfg: any state, any master.
    fn get_cfg(&mut self, now: Instant, request: &DataTelegram<'_>) {
        if self.has_data(now, request, Service::GetCfg) {
            return;
        }
        let configuration = self.application.configuration(self.state.is_data_exchange());
        self.station.answer_data(request, |to| copy(configuration, to));
    }

    /// RD_Inp: in data exchange, any master.
    fn rd_inp(&mut self, now: Instant, request: &DataTelegram<'_>) {
        let State::DataExchange(_, lengths) = self.state else {
            return self.answer_no_service(now, request, Service::RdInp);
        };
        if self.has_data(now, request, Service::RdInp) {
            return;
        }
        let (modes, application) = (&self.modes, &self.application);
        self.station.answer_data(request, |to| {
            let inputs = to.get_mut(..usize::from(lengths.inputs)).unwrap_or_default();
            if modes.is_frozen() {
                modes.read_frozen(inputs)
            } else {
                application.read_inputs(inputs)
            };
            inputs.len()
        });
    }

    /// RD_Outp: in data exchange, any master.
    fn rd_outp(&mut self, now: Instant, request: &DataTelegram<'_>) {
        let State::DataExchange(_, lengths) = self.state else {
            return self.answer_no_service(now, request, Service::RdOutp);
        };
        if self.has_data(now, request, Service::RdOutp) {
            return;
        }
        let application = &self.application;
        self.station.answer_data(request, |to| {
            let outputs = to.get_mut(..usize::from(lengths.outputs)).unwrap_or_default();
            application.read_outputs(outputs);
            outputs.len()
        });
    }

    /// Set_Prm: from anyone while there is no owner, else from the owner.
    ///
    /// Reading "Set_Prm lengths": fewer than 7 octets are a fault; with Unlock_Req or without
    /// Lock_Req any length from 7 will do; else the device says which.
    fn set_prm(&mut self, now: Instant, request: &DataTelegram<'_>) {
        if self.station.address() == Some(UNSET_ADDRESS) {
            return self.refuse_at_126(now, request, Service::SetPrm);
        }
        if self.state.owner().is_some_and(|owner| owner != request.sa) {
            return self.answer_no_service(now, request, Service::SetPrm);
        }
        self.station.acknowledge();
        let Some(prm) = SetPrm::parse(request.data) else {
            let length = u8::try_from(request.data.len()).unwrap_or(u8::MAX);
            return self.prm_fault(now, Some(Refusal::PrmTooShort(length)));
        };
        if prm.status.unlock_req() {
            self.unlock(now, &prm);
        } else if prm.status.lock_req() {
            self.lock(now, request.sa, &prm);
        } else {
            self.set_min_tsdr(now, prm.min_tsdr);
        }
    }

    /// Unlock_Req: the slave is free for other masters. Nothing else is taken.
    fn unlock(&mut self, now: Instant, prm: &SetPrm<'_>) {
        if let Err(refusal) = self.check_ident(prm) {
            self.prm_fault(now, Some(refusal));
        } else if self.state.session().is_some() {
            self.leave(now, Cause::Unlocked);
        }
    }

    /// Lock_Req: the slave becomes (or stays) this master's.
    fn lock(&mut self, now: Instant, master: u8, prm: &SetPrm<'_>) {
        if let Err(refusal) = self.check_standard(prm) {
            return self.prm_fault(now, Some(refusal));
        }
        let exchanging = self.state.is_data_exchange();
        match self.application.set_prm(now, prm, exchanging) {
            PrmVerdict::Refused => return self.prm_fault(now, None),
            PrmVerdict::Outgrown => return self.leave(now, Cause::ParametersTooShort),
            PrmVerdict::Accepted => {}
        }
        self.faults = Faults::default();
        self.watchdog.set(now, prm.watchdog());
        if prm.watchdog().is_none() {
            self.baud_control(now);
        }
        self.rearm();
        self.set_min_tsdr(now, prm.min_tsdr);
        let session = Session { owner: master, group_ident: prm.group_ident };
        self.state = match self.state {
            State::DataExchange(_, lengths) => {
                self.expect(session, lengths);
                State::DataExchange(session, lengths)
            }
            _ => State::WaitCfg(session),
        };
        self.tell(now, if exchanging { Event::ParametersChanged } else { Event::Parameterized { master } });
    }

    fn check_ident(&self, prm: &SetPrm<'_>) -> Result<(), Refusal> {
        let own = self.application.ident_number();
        if prm.ident_number == own {
            Ok(())
        } else {
            Err(Refusal::PrmIdent { received: prm.ident_number, own })
        }
    }

    /// What the standard demands of a Set_Prm with Lock_Req.
    fn check_standard(&self, prm: &SetPrm<'_>) -> Result<(), Refusal> {
        self.check_ident(prm)?;
        let status = prm.status;
        if status.reserved() != 0 {
            return Err(Refusal::StationStatus(status.0));
        }
        if status.watchdog_on() {
            let [factor_1, factor_2] = prm.watchdog_factors;
            if factor_1 == 0 {
                return Err(Refusal::WatchdogFactor(2));
            }
            if factor_2 == 0 {
                return Err(Refusal::WatchdogFactor(3));
            }
        }
        if status.sync_req() && !self.application.supports_sync() {
            return Err(Refusal::SyncNotSupported);
        }
        if status.freeze_req() && !self.application.supports_freeze() {
            return Err(Refusal::FreezeNotSupported);
        }
        if prm.asic_octet().refused_bits() != 0 {
            return Err(Refusal::AsicOctet(prm.asic_octet().0));
        }
        Ok(())
    }

    /// Prm_Fault: nothing taken, no owner, Wait_Prm. `None`: the application has told the reason.
    fn prm_fault(&mut self, now: Instant, refusal: Option<Refusal>) {
        self.faults.prm = true;
        self.faults.not_supported |=
            matches!(refusal, Some(Refusal::SyncNotSupported | Refusal::FreezeNotSupported));
        if let Some(refusal) = refusal {
            self.refused(now, refusal);
        }
        if self.state.session().is_some() {
            self.leave(now, Cause::PrmFault);
        }
    }

    /// min T_SDR: 0 keeps it, less than 11 is 11; holds from the next answer on.
    fn set_min_tsdr(&mut self, now: Instant, value: u8) {
        if value == 0 {
            return;
        }
        let value = value.max(11);
        let rate = self.baudrate();
        let news = value != self.station.min_tsdr();
        self.station.set_times(rate, value);
        if news {
            let value = BitTimes(u32::from(value));
            self.tell(now, Event::MinTsdr { value, above_max: value > rate.max_tsdr() });
        }
    }

    /// Chk_Cfg: from the owner.
    fn chk_cfg(&mut self, now: Instant, request: &DataTelegram<'_>) {
        if self.station.address() == Some(UNSET_ADDRESS) {
            return self.refuse_at_126(now, request, Service::ChkCfg);
        }
        match self.state {
            State::WaitCfg(session) if session.owner == request.sa => {
                self.station.acknowledge();
                self.check_configuration(now, session, request.data);
            }
            State::DataExchange(session, _) if session.owner == request.sa => {
                self.station.acknowledge();
                self.recheck_configuration(now, request.data);
            }
            _ => self.answer_no_service(now, request, Service::ChkCfg),
        }
    }

    fn check_configuration(&mut self, now: Instant, session: Session, octets: &[u8]) {
        let Ok(lengths) = self.application.chk_cfg(now, octets) else {
            return self.cfg_fault(now, None);
        };
        if usize::from(lengths.inputs) > IN.min(MOST_DATA) || usize::from(lengths.outputs) > OUT {
            return self.cfg_fault(now, Some(Refusal::TooManyOctets));
        }
        self.faults.cfg = false;
        self.state = State::DataExchange(session, lengths);
        self.expect(session, lengths);
        self.announcement = Announcement {
            // What the master has not seen in this form yet waits to be fetched.
            pending: self.application.external_diagnosis(true),
            fetch: None,
        };
        self.tell(now, Event::DataExchangeEntered { master: session.owner });
    }

    /// In data exchange only the configuration agreed on is good.
    fn recheck_configuration(&mut self, now: Instant, octets: &[u8]) {
        let agreed = self.application.configuration(true);
        if octets != agreed {
            let same = agreed.iter().zip(octets).take_while(|(agreed, octet)| agreed == octet).count();
            let refusal = Refusal::OtherConfiguration {
                octet: u8::try_from(same).unwrap_or(u8::MAX).saturating_add(1),
                received: octets.get(same).copied(),
                agreed: agreed.get(same).copied(),
            };
            self.cfg_fault(now, Some(refusal));
        }
    }

    /// Cfg_Fault: no owner, Wait_Prm. `None`: the application has told the reason.
    fn cfg_fault(&mut self, now: Instant, refusal: Option<Refusal>) {
        self.faults.cfg = true;
        if let Some(refusal) = refusal {
            self.refused(now, refusal);
        }
        self.leave(now, Cause::CfgFault);
    }

    /// Reading "At 126": a slave there is found, diagnosed and given an address, nothing else.
    fn refuse_at_126(&mut self, now: Instant, request: &DataTelegram<'_>, service: Service) {
        self.station.answer_short(request.sa, ResponseCode::NoService);
        self.refused(now, Refusal::AtAddress126(service));
    }

    /// Set_Slave_Add: in Wait_Prm, from any master, where the device lets its address be set.
    fn set_slave_add(&mut self, now: Instant, request: &DataTelegram<'_>) {
        if self.state != State::WaitPrm {
            return self.answer_no_service(now, request, Service::SetSlaveAdd);
        }
        if !self.application.address_changeable() {
            self.station.answer_short(request.sa, ResponseCode::NoService);
            return self.refused(now, Refusal::AddressFixed);
        }
        self.station.acknowledge();
        match self.check_address(request.data) {
            Ok(address) => self.on_sending = OnSending::TakeAddress(address),
            Err(refusal) => self.refused(now, refusal),
        }
    }

    fn check_address(&self, octets: &[u8]) -> Result<u8, Refusal> {
        let Some(request) = SetSlaveAdd::parse(octets) else {
            return Err(Refusal::AddressTooShort(u8::try_from(octets.len()).unwrap_or(u8::MAX)));
        };
        let own = self.application.ident_number();
        if request.ident_number != own {
            return Err(Refusal::AddressIdent { received: request.ident_number, own });
        }
        let address = request.new_address;
        if self.application.accepts_address(address) {
            Ok(address)
        } else {
            Err(Refusal::AddressRange(address))
        }
    }

    /// SDN: only Global_Control means anything, and is never answered.
    pub(super) fn unacknowledged(&mut self, now: Instant, request: &DataTelegram<'_>) {
        let State::DataExchange(session, lengths) = self.state else {
            return;
        };
        if request.dsap != Sap::GLOBAL_CONTROL || session.owner != request.sa {
            return;
        }
        match GlobalControl::parse(request.data) {
            Some(command) if command.addresses(session.group_ident) => {
                self.global_control(now, command, lengths);
            }
            Some(_) => {}
            None => {
                let octet = request.data.first().copied().unwrap_or(0);
                self.refused(now, Refusal::GlobalControl(octet));
            }
        }
    }

    /// Clear first, then Freeze, then Sync.
    fn global_control(&mut self, now: Instant, command: GlobalControl, lengths: Lengths) {
        if command.clear_data {
            self.modes.drop_held();
            self.application.clear_outputs(now);
            self.tell(now, Event::Cleared);
        }
        match command.freeze {
            ModeCommand::Activate if self.application.supports_freeze() => {
                let application = &self.application;
                self.modes.freeze(lengths.inputs, |to| application.read_inputs(to));
                self.tell(now, Event::Freeze(true));
            }
            ModeCommand::Deactivate if self.modes.is_frozen() => {
                self.modes.unfreeze();
                self.tell(now, Event::Freeze(false));
            }
            _ => {}
        }
        let on = match command.sync {
            ModeCommand::Activate if self.application.supports_sync() => true,
            ModeCommand::Deactivate if self.modes.is_sync() => false,
            _ => return,
        };
        if let Some(outputs) = self.modes.sync(on, lengths.outputs) {
            self.application.write_outputs(now, outputs);
        }
        self.tell(now, Event::Sync(on));
    }
}

fn service_of(sap: Sap) -> Service {
    match sap {
        Sap::NIL => Service::DataExchange,
        Sap::SET_SLAVE_ADD => Service::SetSlaveAdd,
        Sap::RD_INP => Service::RdInp,
        Sap::RD_OUTP => Service::RdOutp,
        Sap::GLOBAL_CONTROL => Service::GlobalControl,
        Sap::GET_CFG => Service::GetCfg,
        Sap::SLAVE_DIAG => Service::SlaveDiag,
        Sap::SET_PRM => Service::SetPrm,
        Sap::CHK_CFG => Service::ChkCfg,
        Sap(other) => Service::Sap(other),
    }
}

/// Copies as much as fits; how many octets that is.
fn copy(from: &[u8], to: &mut [u8]) -> usize {
    to.iter_mut().zip(from).map(|(to, from)| *to = *from).count()
}
