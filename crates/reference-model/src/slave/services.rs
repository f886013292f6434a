//! The services and states of MS0.

use profibus_dp::time::{Duration, Instant};

use super::State::{DataExch, WaitCfg, WaitPrm};
use super::station::SRD;
use super::telegram::Request;
use super::{After, Slave};

impl Slave {
    pub(super) fn serve(&mut self, now: Instant, request: &Request, is_owner: bool) -> Vec<u8> {
        let rs = self.short(request, 0x03);
        let rr = self.short(request, 0x02);
        if !SRD.contains(&(request.fc & 0x0F)) {
            return rs;
        }
        let at_126 = self.address == 126;
        let is_read = matches!(request.dsap, Some(56 | 57 | 59 | 60));
        if matches!(request.dsap, Some(56 | 57)) && self.state != DataExch {
            return rs;
        }
        if is_read && !request.data.is_empty() {
            return rr;
        }
        match request.dsap {
            None if request.ssap.is_none() && self.state == DataExch && is_owner => {
                self.data_exchange(request)
            }
            Some(55) if self.state == WaitPrm && self.device.address_changeable => {
                self.set_slave_add(request)
            }
            Some(56) => self.data(request, 0x08, &self.inputs()),
            Some(57) => self.data(request, 0x08, &self.device.outputs),
            Some(59) => self.data(request, 0x08, &self.device.cfg),
            Some(60) => self.slave_diag(request, is_owner),
            Some(61) if !at_126 && (self.owner.is_none() || is_owner) => self.set_prm(now, request),
            Some(62) if !at_126 && self.state != WaitPrm && is_owner => self.chk_cfg(request),
            _ => rs,
        }
    }

    pub(super) fn data_exchange(&mut self, request: &Request) -> Vec<u8> {
        if request.data.len() == self.device.outputs.len() {
            if self.sync {
                self.kept_aside = Some(request.data.clone());
            } else {
                self.take_outputs(&request.data);
            }
        } else if request.data.is_empty() && self.device.fail_safe {
            self.clear_outputs();
        } else {
            self.leave();
            return self.short(request, 0x03);
        }
        let high = self.diag_flag || self.device.stat_diag;
        let inputs = self.inputs();
        match (inputs.is_empty(), high) {
            (true, true) => self.short(request, 0x0A),
            (_, true) => self.data(request, 0x0A, &inputs),
            (_, false) => self.data(request, 0x08, &inputs),
        }
    }

    pub(super) fn inputs(&self) -> Vec<u8> {
        self.frozen.clone().unwrap_or_else(|| self.device.inputs.clone())
    }

    pub(super) fn take_outputs(&mut self, outputs: &[u8]) {
        self.device.outputs = outputs.to_vec();
        self.device.taken += 1;
    }

    pub(super) fn clear_outputs(&mut self) {
        self.device.outputs.fill(0);
        self.kept_aside = None;
    }

    pub(super) fn set_slave_add(&mut self, request: &Request) -> Vec<u8> {
        if let [address, high, low, _no_add_chg, ..] = request.data[..]
            && u16::from_be_bytes([high, low]) == self.device.ident
            && (1..=125).contains(&address)
        {
            self.after = After::Address(address);
        }
        vec![0xE5]
    }

    pub(super) fn slave_diag(&mut self, request: &Request, is_owner: bool) -> Vec<u8> {
        let bit = |set: bool, bit: u8| u8::from(set) << bit;
        let octet_1 = bit(self.state != DataExch, 1)
            | bit(self.cfg_fault, 2)
            | bit(self.device.ext_diag, 3)
            | bit(self.not_supported, 4)
            | bit(self.prm_fault, 6);
        let octet_2 = bit(self.state == WaitPrm, 0)
            | bit(self.device.stat_diag, 1)
            | bit(true, 2)
            | bit(self.watchdog.is_some(), 3)
            | bit(self.frozen.is_some(), 4)
            | bit(self.sync, 5);
        let [high, low] = self.device.ident.to_be_bytes();
        let mut octets = vec![octet_1, octet_2, 0, self.owner.unwrap_or(0xFF), high, low];
        octets.extend(&self.device.user_diagnosis);
        if is_owner && self.diag_flag {
            self.after = After::Fetched(request.fc & 0x20 != 0);
            self.fetched = None;
        }
        self.data(request, 0x08, &octets)
    }

    /// The owner has got the diagnosis if his next request toggles the frame count bit.
    pub(super) fn confirm_fetch(&mut self, fc: u8) {
        let (fcv, fcb) = (fc & 0x10 != 0, fc & 0x20 != 0);
        if self.fetched.is_some_and(|fetched| !fcv || fcb != fetched) {
            self.diag_flag = false;
            self.fetched = None;
        }
    }

    pub(super) fn set_prm(&mut self, now: Instant, request: &Request) -> Vec<u8> {
        let ack = vec![0xE5];
        let [status, factor_1, factor_2, min_tsdr, high, low, group, ..] = request.data[..] else {
            return self.bad_prm(ack);
        };
        let is_ident = u16::from_be_bytes([high, low]) == self.device.ident;
        let (lock, unlock) = (status & 0x80 != 0, status & 0x40 != 0);
        if unlock {
            if !is_ident {
                return self.bad_prm(ack);
            }
            self.leave();
            return ack;
        }
        if !lock {
            self.set_min_tsdr(min_tsdr);
            return ack;
        }
        if !is_ident {
            return self.bad_prm(ack);
        }
        if status & 0x07 != 0 {
            return self.bad_prm(ack);
        }
        let wd_on = status & 0x08 != 0;
        if wd_on && (factor_1 == 0 || factor_2 == 0) {
            return self.bad_prm(ack);
        }
        if (status & 0x20 != 0 && !self.device.sync) || (status & 0x10 != 0 && !self.device.freeze) {
            self.not_supported = true;
            return self.bad_prm(ack);
        }
        let octet_8 = request.data.get(7).copied().unwrap_or(0);
        if octet_8 & 0b1011_1000 != 0 {
            return self.bad_prm(ack);
        }
        let octet_9 = request.data.get(8).copied().unwrap_or(self.device.prm_octet_9);
        if request.data.len() != self.device.prm_octets || octet_9 != self.device.prm_octet_9 {
            return self.bad_prm(ack);
        }
        let base = if octet_8 & 0x04 != 0 { 1 } else { 10 };
        let span = base * u64::from(factor_1) * u64::from(factor_2);
        self.watchdog = wd_on.then_some(Duration::from_millis(span));
        self.alive = now;
        self.set_min_tsdr(min_tsdr);
        self.group = group;
        self.owner = Some(request.sa);
        (self.prm_fault, self.cfg_fault, self.not_supported) = (false, false, false);
        if self.state == WaitPrm {
            self.state = WaitCfg;
        }
        ack
    }

    pub(super) fn bad_prm(&mut self, ack: Vec<u8>) -> Vec<u8> {
        self.leave();
        self.prm_fault = true;
        ack
    }

    pub(super) fn set_min_tsdr(&mut self, value: u8) {
        if value != 0 {
            self.min_tsdr = u32::from(value).max(11);
        }
    }

    pub(super) fn chk_cfg(&mut self, request: &Request) -> Vec<u8> {
        if request.data != self.device.cfg {
            self.leave();
            self.cfg_fault = true;
        } else if self.state == WaitCfg {
            self.state = DataExch;
            self.cfg_fault = false;
            self.diag_flag = self.device.ext_diag;
        }
        vec![0xE5]
    }

    pub(super) fn global_control(&mut self, request: &Request) {
        let &[command, select] = &request.data[..] else {
            return;
        };
        if self.state != DataExch {
            return;
        }
        if self.owner != Some(request.sa) {
            return;
        }
        if request.dsap != Some(58) || command & 0b1100_0001 != 0 {
            return;
        }
        if select != 0 && select & self.group == 0 {
            return;
        }
        if command & 0x02 != 0 {
            self.clear_outputs();
        }
        if self.device.freeze {
            if command & 0x04 != 0 {
                self.frozen = None;
            } else if command & 0x08 != 0 {
                self.frozen = Some(self.device.inputs.clone());
            }
        }
        if self.device.sync && command & 0x30 != 0 {
            if let Some(outputs) = self.kept_aside.take() {
                self.take_outputs(&outputs);
            }
            self.sync = command & 0x10 == 0;
        }
    }

    /// LEAVE-MASTER.
    pub(super) fn leave(&mut self) {
        self.state = WaitPrm;
        self.owner = None;
        self.group = 0;
        self.watchdog = None;
        self.clear_outputs();
        self.sync = false;
        self.frozen = None;
        self.diag_flag = false;
        self.fetched = None;
    }

    pub(super) fn pass_time(&mut self, now: Instant) {
        if self.watchdog.is_some_and(|span| now >= self.alive + span) {
            self.leave();
        }
    }
}
