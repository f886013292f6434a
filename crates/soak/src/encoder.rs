//! One encoder as its master knows it: what it asks next, and what must come back.

use master::{Diagnosis, Error, LightMaster};
use profibus_dp::time::{Duration, Instant};
use sch108bex::functionality::Functionality;
use sch108bex::specification::PLACEHOLDER_IDENT;

use crate::chance::Chance;
use crate::line::Shared;
use crate::truth::Truth;

pub(crate) type Master = LightMaster<Shared>;

/// Data exchange must be back so soon after whatever happened.
const BACK_WITHIN: Duration = Duration::from_secs(3);

/// What the master asks next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Who and how is it?
    Look,
    Parameterize,
    Configure,
    /// Has it taken everything?
    Check,
    Exchange,
    /// A diagnosis waits.
    Fetch,
    /// It is to get another address.
    Release(u8),
    Move(u8),
}

/// Whether a diagnosis waits to be fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pending {
    No,
    Yes,
    Perhaps,
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Counts {
    pub(crate) exchanges: u64,
    pub(crate) diagnoses: u64,
    pub(crate) presets: u64,
    pub(crate) unconfirmed: u64,
    pub(crate) start_ups: u64,
    pub(crate) moves: u64,
}

#[derive(Debug)]
pub(crate) struct Encoder {
    pub(crate) address: u8,
    /// The other one it may answer to, where a change of address was not confirmed.
    pub(crate) perhaps: Option<u8>,
    pub(crate) functionality: Functionality,
    pub(crate) watchdog: Option<(u8, u8)>,
    pub(crate) truth: Truth,
    pub(crate) phase: Phase,
    pub(crate) pending: Pending,
    pub(crate) powered: bool,
    pub(crate) paused_until: Instant,
    /// Nothing is asked before, after silence.
    pub(crate) not_before: Instant,
    pub(crate) good_since: Instant,
    pub(crate) preset_at: Instant,
    /// The next outputs have bit 31 set as those before.
    pub(crate) holds_preset_bit: bool,
    /// Tenths of an hour, as it showed them last.
    pub(crate) operating_time: u32,
    /// Octet 26 of Set_Prm.
    pub(crate) time_base: u8,
    pub(crate) counts: Counts,
}

/// What must hold does not.
pub(crate) type Checked = Result<(), String>;

impl Encoder {
    /// Whether its diagnosis has the long form, the one with warnings.
    pub(crate) fn sends_warnings(&self) -> bool {
        self.functionality != Functionality::Class1
    }

    /// One request, whatever is next.
    pub(crate) fn step(&mut self, master: &mut Master, chance: &mut Chance, now: Instant) -> Checked {
        if now < self.paused_until || now < self.not_before {
            return Ok(());
        }
        if !self.powered {
            self.good_since = now;
        } else if now.since(self.good_since) > BACK_WITHIN {
            return Err(format!(
                "no data exchange for {:?}, in {:?}",
                now.since(self.good_since),
                self.phase
            ));
        }
        master.line().begin_request();
        match self.phase {
            Phase::Exchange => return self.exchange(master, chance, now),
            Phase::Look => return self.look(master, now),
            Phase::Check | Phase::Fetch => return self.fetch(master, now),
            _ => {}
        }
        let done = match self.phase {
            Phase::Parameterize => master.set_prm(self.address, &self.parameters()),
            Phase::Configure => master.chk_cfg(self.address, configuration(self.functionality)),
            Phase::Release(_) => master.unlock(self.address, PLACEHOLDER_IDENT),
            Phase::Move(to) => master.set_address(self.address, to, PLACEHOLDER_IDENT, false),
            _ => Ok(()),
        };
        self.after(done.is_ok(), now);
        Ok(())
    }

    /// The next phase after one that is acknowledged or not.
    fn after(&mut self, done: bool, now: Instant) {
        self.phase = match (self.phase, done) {
            (Phase::Parameterize, true) => Phase::Configure,
            (Phase::Configure, true) => Phase::Check,
            (Phase::Release(to), true) => Phase::Move(to),
            (Phase::Move(to), _) => {
                self.perhaps = if done { None } else { Some(self.address) };
                self.counts.moves += u64::from(done);
                self.address = to;
                Phase::Look
            }
            _ => Phase::Look,
        };
        if !done {
            self.not_before = now + Duration::from_millis(20);
        }
    }

    #[inline]
    fn exchange(&mut self, master: &mut Master, chance: &mut Chance, now: Instant) -> Checked {
        let class_1 = self.functionality == Functionality::Class1;
        // A bit that stays set presets nothing, whatever comes with it.
        let held = std::mem::take(&mut self.holds_preset_bit);
        let preset = !class_1 && !held && now >= self.preset_at;
        let bit = preset || held;
        let value = if bit { chance.below_32(self.truth.scale.range) } else { 0 };
        let outputs = (u32::from(bit) << 31 | value).to_be_bytes();
        let outcome = master.exchange(self.address, if class_1 { &[] } else { &outputs });
        let mut position = None;
        let mut high_priority = false;
        if let Ok(inputs) = &outcome {
            let due = if self.functionality == Functionality::Scancon2 { 12 } else { 4 };
            let Some(octets) = inputs.octets.first_chunk::<4>().filter(|_| inputs.octets.len() == due) else {
                return Err(format!("inputs {:02X?}, where {due} octets are due", inputs.octets));
            };
            position = Some(u32::from_be_bytes(*octets));
            high_priority = inputs.high_priority;
        }
        let (attempts, count) = master.line().attempts();
        let asked = &attempts[..count];
        if let Some(position) = position {
            self.counts.exchanges += 1;
            self.good_since = now;
            if !self.truth.takes_position(position, asked) {
                return Err(self.wrong_position(position, asked));
            }
            if count == 1 {
                self.check_priority(high_priority, asked[0])?;
            }
            if high_priority {
                self.phase = Phase::Fetch;
            }
        } else {
            (self.phase, self.pending) = (Phase::Look, Pending::Perhaps);
        }
        if preset {
            self.note_preset(value, asked, position.is_some());
            self.preset_at = now + chance.millis(1_500, 15_000);
            self.holds_preset_bit = position.is_some() && chance.is(3);
        }
        Ok(())
    }

    #[cold]
    fn note_preset(&mut self, value: u32, asked: &[Instant], confirmed: bool) {
        self.truth.preset(value, asked, confirmed);
        self.counts.presets += u64::from(confirmed);
        self.counts.unconfirmed += u64::from(!confirmed);
    }

    #[cold]
    fn wrong_position(&self, position: u32, asked: &[Instant]) -> String {
        let scaled = asked.iter().map(|&at| self.truth.scaled(at)).collect::<Vec<_>>();
        format!(
            "position {position}, but the shaft was at {scaled:?} when it was asked, offset {:?}, scale {:?}",
            self.truth.offsets.values(),
            self.truth.scale
        )
    }

    /// High priority as long as an alarm is set, and after changes until they are fetched.
    fn check_priority(&self, high: bool, asked: Instant) -> Checked {
        let due = match (self.truth.alarms(asked), self.pending) {
            (Some(0x02), _) | (_, Pending::Yes) => Some(true),
            (Some(0), Pending::No) => Some(false),
            _ => None,
        };
        if due.is_some_and(|due| due != high) {
            return Err(format!("an answer of high priority: {high}, with {:?} pending", self.pending));
        }
        Ok(())
    }

    /// The first look, and the one after silence.
    fn look(&mut self, master: &mut Master, now: Instant) -> Checked {
        self.counts.start_ups += 1;
        let outcome = master.diagnosis(self.address);
        (self.pending, self.holds_preset_bit) = (Pending::Perhaps, false);
        let Ok(diagnosis) = outcome else {
            self.not_before = now + Duration::from_millis(20);
            if let Some(other) = self.perhaps {
                // It is at the one or the other.
                self.perhaps = Some(self.address);
                self.address = other;
            }
            return Ok(());
        };
        let standard = diagnosis.standard;
        if standard.ident_number != PLACEHOLDER_IDENT || standard.prm_fault || standard.cfg_fault {
            return Err(format!("a diagnosis of {:02X?}", diagnosis.octets));
        }
        (self.perhaps, self.phase) = (None, Phase::Parameterize);
        Ok(())
    }

    /// A diagnosis in data exchange.
    fn fetch(&mut self, master: &mut Master, now: Instant) -> Checked {
        let own = master.settings().address;
        let (is_back, operating_time) = match master.diagnosis(self.address) {
            Err(Error::Silent { .. } | Error::Damaged { .. } | Error::Refused { .. }) => (false, None),
            Err(error) => return Err(error.to_string()),
            Ok(diagnosis) if diagnosis.standard.prm_req || diagnosis.standard.station_not_ready => {
                (false, None)
            }
            Ok(diagnosis) => {
                let operating_time = self.check_diagnosis(&diagnosis, own, now)?;
                (true, operating_time)
            }
        };
        if !is_back {
            (self.phase, self.pending) = (Phase::Look, Pending::Perhaps);
            return Ok(());
        }
        self.counts.diagnoses += 1;
        self.operating_time = operating_time.unwrap_or(self.operating_time);
        self.phase = Phase::Exchange;
        let (attempts, count) = master.line().attempts();
        // While the supply settles the alarm goes by itself, which is a change again.
        let settles = attempts[..count].iter().any(|&at| self.truth.alarms(at) != Some(0));
        self.pending = if settles { Pending::Perhaps } else { Pending::No };
        Ok(())
    }

    /// Checks all octets that the truth knows, and gives the operating time in tenths of an hour.
    fn check_diagnosis(
        &self,
        diagnosis: &Diagnosis<'_>,
        own: u8,
        now: Instant,
    ) -> Result<Option<u32>, String> {
        let octets = diagnosis.octets;
        let standard = diagnosis.standard;
        let fault = |what: &str| Err(format!("{what} in the diagnosis {octets:02X?}; {:?}", self.truth));
        let long = self.functionality != Functionality::Class1;
        if octets.len() != if long { 57 } else { 16 } {
            return fault("another length than due");
        }
        if standard.master_add != Some(own) || standard.watchdog_on != self.watchdog.is_some() {
            return fault("another master or watchdog");
        }
        let end = now + Duration::from_millis(3);
        let alarms = octets[7];
        let due = [self.truth.alarms(now), self.truth.alarms(end)];
        if !due.contains(&None) && !due.contains(&Some(alarms)) {
            return fault("other alarms than due");
        }
        let warnings = if long { u16::from_be_bytes([octets[19], octets[20]]) } else { 0 };
        if long && warnings != self.truth.warnings() {
            return fault("other warnings than due");
        }
        if standard.stat_diag != (alarms != 0) || standard.ext_diag != (alarms != 0 || warnings != 0) {
            return fault("Stat_Diag or Ext_Diag that does not fit");
        }
        let Some(&[t3, t2, t1, t0, o3, o2, o1, o0]) =
            octets.get(27..).and_then(|octets| octets.first_chunk())
        else {
            return Ok(None);
        };
        let offset = i64::from(i32::from_be_bytes([o3, o2, o1, o0]));
        if !self.truth.offsets.values().contains(&offset) {
            return fault("another offset than due");
        }
        let time = u32::from_be_bytes([t3, t2, t1, t0]);
        // Each cut costs a tenth of an hour at most; the bus has run for so many.
        let most = now.since(Instant::ZERO).as_millis() / 360_000;
        if u64::from(time) > most || time + 1 < self.operating_time {
            return fault("another operating time than due");
        }
        Ok(Some(time))
    }

    /// Octets of Set_Prm.
    fn parameters(&self) -> Vec<u8> {
        let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
        let (on, one, two) = self.watchdog.map_or((0, 0, 0), |(one, two)| (0x08, one, two));
        let mut octets = vec![0x80 | on, one, two, 11, high, low, 0, 0];
        let scale = self.truth.scale;
        let turned = u8::from(scale.counter_clockwise);
        if self.functionality == Functionality::Class1 {
            octets.push(turned);
            return octets;
        }
        octets.push(turned | 0x02 | 0x08);
        octets.extend(scale.units.to_be_bytes());
        octets.extend(scale.range.to_be_bytes());
        octets.resize(25, 0);
        if self.functionality == Functionality::Scancon2 {
            octets.push(self.time_base);
        }
        octets
    }
}

/// Octets of Chk_Cfg.
fn configuration(functionality: Functionality) -> &'static [u8] {
    match functionality {
        Functionality::Class1 => &[0xD1],
        Functionality::Class2 => &[0xF1],
        Functionality::Scancon2 => &[0xF1, 0xD1, 0xD1],
    }
}
