//! The receiver and the passive station: is it a telegram, is it for us, have we had it before?

use profibus_dp::fdl::Window;
use profibus_dp::time::{Duration, Instant};

use super::telegram::{Parsed, Request, parse, sum};
use super::{After, Memory, Reply, Slave};

pub(super) const SRD: [u8; 2] = [0x0C, 0x0D];
const SDA: [u8; 2] = [0x03, 0x05];
const SDN: [u8; 2] = [0x04, 0x06];

impl Slave {
    pub(super) fn octet(&mut self, now: Instant, octet: u8) {
        // From the end of one octet to the end of the next; edges are known to half a bit.
        let idle = Duration::from_nanos(self.bits(2 * (33 + 11) - 1).as_nanos() / 2);
        let gap = if self.setting.stream { idle.max(Duration::from_millis(10)) } else { idle };
        if now.since(self.last) >= gap {
            self.octets.clear();
            self.deaf = false;
        }
        self.last = now;
        self.reply = None;
        self.octets.push(octet);
        while !self.octets.is_empty() && !self.deaf {
            match parse(&self.octets) {
                Parsed::More => return,
                Parsed::Whole(count, request) => {
                    self.octets.drain(..count);
                    if let Some(request) = request {
                        self.hear(now, &request);
                    }
                }
                Parsed::Bad if self.setting.stream => drop(self.octets.remove(0)),
                Parsed::Bad => self.deaf = true,
            }
        }
        self.octets.clear();
    }

    pub(super) fn hear(&mut self, now: Instant, request: &Request) {
        self.pass_time(now);
        let function = request.fc & 0x0F;
        let is_request = request.fc & 0xC0 == 0x40;
        let is_ours = request.da == self.address;
        let is_plain = |sap: Option<u8>| sap.is_none_or(|sap| sap <= 63);
        if !is_request || !is_plain(request.dsap) || !is_plain(request.ssap) {
            return;
        }
        if request.sa == self.address || request.sa == 127 {
            return;
        }
        if (is_ours || request.da == 127) && SDN.contains(&function) {
            return self.global_control(request);
        }
        if !is_ours {
            return;
        }
        // A new min T_SDR holds from the next answer on.
        let window = self.window(now);
        let (octets, is_answer) = match function {
            0x09 => (self.short(request, 0x00), false),
            0x0E => (self.short(request, 0x09), false),
            0x0F => (self.short(request, 0x03), false),
            _ if SRD.contains(&function) || SDA.contains(&function) => (self.answer(now, request), true),
            _ => return,
        };
        self.reply = Some(Reply { octets, window, is_answer });
    }

    pub(super) fn answer(&mut self, now: Instant, request: &Request) -> Vec<u8> {
        let is_owner = self.owner == Some(request.sa);
        if is_owner {
            self.alive = now;
        }
        if !self.is_retry(request) {
            self.after = After::Nothing;
            if is_owner {
                self.confirm_fetch(request.fc);
            }
            self.answer = self.serve(now, request, is_owner);
        }
        self.answer.clone()
    }

    /// From the end of the request: not before min T_SDR, not after max T_SDR and a character.
    pub(super) fn window(&self, now: Instant) -> Window {
        let latest = self.min_tsdr.max(self.setting.rate.max_tsdr().0) + 11;
        Window { not_before: now + self.bits(self.min_tsdr), not_after: now + self.bits(latest) }
    }

    pub(super) fn is_retry(&mut self, request: &Request) -> bool {
        let (fcv, fcb) = (request.fc & 0x10 != 0, request.fc & 0x20 != 0);
        let service = (request.fc & 0x0F, request.dsap, request.ssap);
        let is_known = |memory: &Memory| memory.sa == request.sa && memory.fcb == fcb;
        let is_same = |memory: &Memory| memory.service == service;
        if fcv && self.memory.as_ref().is_some_and(|memory| is_known(memory) && is_same(memory)) {
            return true;
        }
        self.memory = (fcv || fcb).then_some(Memory { sa: request.sa, fcb, service });
        false
    }

    /// SD1: status, RS, RR, or DH without inputs.
    pub(super) fn short(&self, request: &Request, code: u8) -> Vec<u8> {
        let body = [request.sa, self.address, code];
        [&[0x10], &body[..], &[sum(&body), 0x16]].concat()
    }

    /// SD2 with the SAPs the other way round; E5 where there are no data.
    pub(super) fn data(&self, request: &Request, code: u8, data: &[u8]) -> Vec<u8> {
        if data.is_empty() {
            return vec![0xE5];
        }
        let extension = |sap: Option<u8>| if sap.is_some() { 0x80 } else { 0 };
        let [da, sa] = [request.sa | extension(request.ssap), self.address | extension(request.dsap)];
        let saps: Vec<u8> = [request.ssap, request.dsap].into_iter().flatten().collect();
        let body = [&[da, sa, code], &saps[..], data].concat();
        let le = u8::try_from(body.len()).unwrap_or(0);
        [&[0x68, le, le, 0x68], &body[..], &[sum(&body), 0x16]].concat()
    }
}
