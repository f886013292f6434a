//! The built-in master of a segment: brings everybody in its list into data exchange, and keeps him there.

use std::hash::Hasher;

use bus::EndError;
use master::light::Settings;
use master::line::ReplyBuffer;
use master::{Error, Heard, LightMaster, Line};
use profibus_dp::time::{Duration, Instant};
use sch108bex::diagnostics::{Alarms, Diagnostics, Warnings};

use super::{MasterPlan, PollPlan};
use crate::ground::{Virtual, lock};

/// A preset stands in the outputs for so many cycles.
const PRESET_CYCLES: u8 = 2;
/// Output bit 31 (manual 4.3.2).
const PRESET_BIT: u32 = 1 << 31;

/// A line to a segment in virtual time that notes each octet and when it was.
#[derive(Debug)]
pub(super) struct NotedLine {
    segment: Virtual,
    /// FNV-1a, 64 bits: the same on every machine and of every version.
    noted: Fnv,
    octets: u64,
}

#[derive(Debug)]
struct Fnv(u64);

impl Hasher for Fnv {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, octets: &[u8]) {
        for octet in octets {
            self.0 = (self.0 ^ u64::from(*octet)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

impl NotedLine {
    pub(super) fn new(segment: Virtual) -> Self {
        Self { segment, noted: Fnv(0xcbf2_9ce4_8422_2325), octets: 0 }
    }

    /// A sum of everything that was on the line.
    pub(super) fn sum(&self) -> u64 {
        self.noted.finish()
    }

    /// How many octets were on the line.
    pub(super) fn octets(&self) -> u64 {
        self.octets
    }

    fn note(&mut self, direction: u8, octets: &[u8]) {
        let at = Line::now(self);
        self.noted.write(&[direction]);
        self.noted.write(&at.as_nanos().to_le_bytes());
        self.noted.write(octets);
        self.octets += octets.len() as u64;
    }
}

impl Line for NotedLine {
    fn now(&self) -> Instant {
        lock(&self.segment).now()
    }

    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        self.note(0, request);
        let heard = lock(&self.segment).ask(request, reply)?;
        self.note(1, &reply[..heard.length]);
        Ok(heard)
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        self.note(0, octets);
        lock(&self.segment).tell(octets)
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        Line::wait(&mut *lock(&self.segment), span)
    }
}

/// A built-in master at work.
#[derive(Debug)]
pub(super) struct Poller {
    master: LightMaster<NotedLine>,
    slaves: Vec<Slave>,
    cycle: Duration,
    next_cycle: Instant,
    /// Who is next in this cycle.
    at: usize,
    running: bool,
    /// Cycles that have begun.
    pub(super) cycles: u64,
}

/// Somebody in the list.
#[derive(Debug)]
pub(super) struct Slave {
    pub(super) plan: PollPlan,
    pub(super) exchanging: bool,
    /// It was freed for other masters.
    left_alone: bool,
    outputs: u32,
    /// A preset and for how many cycles it still stands.
    preset: Option<(u32, u8)>,
    /// What came last.
    pub(super) inputs: Vec<u8>,
    /// What was fetched last.
    pub(super) diagnosis: Vec<u8>,
    /// Diagnoses that said something new.
    pub(super) seen: Vec<Sighting>,
    pub(super) exchanges: u64,
    pub(super) failures: u64,
    /// Why the last request failed.
    pub(super) trouble: Option<String>,
}

/// Alarms and warnings as a diagnosis had them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sighting {
    pub(super) at: Instant,
    pub(super) cycle: u64,
    pub(super) alarms: Alarms,
    pub(super) warnings: Warnings,
}

impl Poller {
    pub(super) fn new(line: NotedLine, plan: &MasterPlan) -> Self {
        let MasterPlan { address, retries, cycle, start, polls } = plan;
        let settings = Settings { address: *address, retries: *retries, ..Settings::default() };
        let slave = |plan: &PollPlan| Slave {
            plan: plan.clone(),
            exchanging: false,
            left_alone: false,
            outputs: 0,
            preset: None,
            inputs: Vec::new(),
            diagnosis: Vec::new(),
            seen: Vec::new(),
            exchanges: 0,
            failures: 0,
            trouble: None,
        };
        Self {
            master: LightMaster::new(line, settings),
            slaves: polls.iter().map(slave).collect(),
            cycle: *cycle,
            next_cycle: *start,
            at: 0,
            running: true,
            cycles: 0,
        }
    }

    pub(super) fn line(&self) -> &NotedLine {
        self.master.line()
    }

    /// Those in the list.
    pub(super) fn slaves(&self) -> &[Slave] {
        &self.slaves
    }

    pub(super) fn slave(&self, encoder: &str) -> Option<&Slave> {
        self.slaves.iter().find(|slave| slave.plan.encoder == encoder)
    }

    pub(super) fn slave_mut(&mut self, encoder: &str) -> Option<&mut Slave> {
        self.slaves.iter_mut().find(|slave| slave.plan.encoder == encoder)
    }

    /// Nobody is asked any more.
    pub(super) fn stop(&mut self) {
        self.running = false;
    }

    /// Goes on with a start-up of everybody.
    pub(super) fn start(&mut self) {
        if !std::mem::replace(&mut self.running, true) {
            for slave in &mut self.slaves {
                slave.exchanging = false;
            }
            (self.at, self.next_cycle) = (0, self.master.now());
        }
    }

    /// Gives a station another address.
    pub(super) fn set_address(&mut self, from: u8, to: u8, ident_number: u16) -> Result<(), Error> {
        self.master.set_address(from, to, ident_number, false)
    }

    /// When so many more cycles are over, at the latest.
    pub(super) fn after_cycles(&self, cycles: u64) -> Instant {
        let begins = self.next_cycle.max(self.master.now());
        begins + Duration::from_nanos(self.cycle.as_nanos().saturating_mul(cycles))
    }

    /// Global_Control to all.
    pub(super) fn global_control(&mut self, command: u8) -> Result<(), Error> {
        self.master.global_control(command, 0)
    }

    /// Frees an encoder of the list, and leaves it alone from now on.
    pub(super) fn unlock(&mut self, encoder: &str) -> Result<(), Error> {
        let Self { master, slaves, .. } = self;
        let Some(slave) = slaves.iter_mut().find(|slave| slave.plan.encoder == encoder) else {
            return Ok(());
        };
        (slave.left_alone, slave.exchanging) = (true, false);
        let ident = slave.plan.set_prm.get(4..6).and_then(|octets| octets.first_chunk());
        master.unlock(slave.plan.address, u16::from_be_bytes(*ident.unwrap_or(&[0; 2])))
    }

    /// Everything that begins before `until`; then it is at least `until`.
    pub(super) fn advance_to(&mut self, until: Instant) -> Result<(), EndError> {
        loop {
            let now = self.master.now();
            let due = if self.at == 0 { self.next_cycle.max(now) } else { now };
            let begins = self.running && due < until && !self.slaves.is_empty();
            let next = if begins { due } else { until };
            if next > now {
                self.master.line_mut().wait(next.since(now))?;
            }
            if !begins {
                return Ok(());
            }
            if self.at == 0 {
                self.cycles += 1;
                self.next_cycle = (due + self.cycle).max(self.next_cycle + self.cycle);
            }
            self.serve()?;
            self.at = (self.at + 1) % self.slaves.len();
        }
    }

    /// Asks the next in the list.
    fn serve(&mut self) -> Result<(), EndError> {
        let Self { master, slaves, at, cycles, .. } = self;
        let slave = &mut slaves[*at];
        if slave.left_alone {
            return Ok(());
        }
        let result =
            if slave.exchanging { slave.exchange(master, *cycles) } else { slave.start_up(master, *cycles) };
        match result {
            Ok(()) => Ok(()),
            Err(Error::Line(error)) => Err(error),
            Err(error) => {
                slave.exchanging = false;
                slave.failures += 1;
                slave.trouble = Some(error.to_string());
                Ok(())
            }
        }
    }
}

impl Slave {
    /// The next outputs carry this preset.
    pub(super) fn preset(&mut self, value: u32) {
        self.preset = Some((value | PRESET_BIT, PRESET_CYCLES));
    }

    /// It is started up with the next cycle, at this address if that is known.
    pub(super) fn begin_anew(&mut self, address: Option<u8>) {
        self.plan.address = address.unwrap_or(self.plan.address);
        (self.exchanging, self.left_alone, self.trouble) = (false, false, None);
    }

    /// The outputs from now on.
    pub(super) fn set_outputs(&mut self, value: u32) {
        self.outputs = value;
    }

    fn start_up(&mut self, master: &mut LightMaster<NotedLine>, cycle: u64) -> Result<(), Error> {
        let address = self.plan.address;
        self.fetch(master, cycle)?;
        master.set_prm(address, &self.plan.set_prm)?;
        master.chk_cfg(address, &self.plan.configuration)?;
        let standard = self.fetch(master, cycle)?;
        let refused = if standard.prm_fault {
            Some("it refuses the parameters")
        } else if standard.cfg_fault {
            Some("it refuses the configuration")
        } else if standard.station_not_ready || standard.prm_req {
            Some("it is not ready")
        } else {
            None
        };
        self.exchanging = refused.is_none();
        if let Some(refused) = refused {
            self.failures += 1;
            self.trouble = Some(refused.to_owned());
        }
        Ok(())
    }

    fn exchange(&mut self, master: &mut LightMaster<NotedLine>, cycle: u64) -> Result<(), Error> {
        let word = self.preset.map_or(self.outputs, |(word, _)| word);
        let octets = word.to_be_bytes();
        let outputs = octets.get(..self.plan.outputs).unwrap_or_default();
        let inputs = master.exchange(self.plan.address, outputs)?;
        let news = inputs.high_priority;
        self.inputs.clear();
        self.inputs.extend_from_slice(inputs.octets);
        self.exchanges += 1;
        self.preset =
            self.preset.and_then(|(word, left)| Some((word, left.checked_sub(1).filter(|left| *left > 0)?)));
        if news {
            let standard = self.fetch(master, cycle)?;
            self.exchanging = !(standard.station_not_ready || standard.prm_req || standard.prm_fault);
        }
        Ok(())
    }

    /// Fetches the diagnosis.
    fn fetch(
        &mut self,
        master: &mut LightMaster<NotedLine>,
        cycle: u64,
    ) -> Result<profibus_dp::wire::StandardDiagnosis, Error> {
        let diagnosis = master.diagnosis(self.plan.address)?;
        let standard = diagnosis.standard;
        self.diagnosis.clear();
        self.diagnosis.extend_from_slice(diagnosis.octets);
        if let Some(own) = Diagnostics::parse(self.diagnosis.get(6..).unwrap_or_default()) {
            let warnings = own.class_2_part.map_or(Warnings::empty(), |part| part.warnings);
            let sighting = Sighting { at: master.now(), cycle, alarms: own.alarms, warnings };
            let news =
                self.seen.last().is_none_or(|last| (last.alarms, last.warnings) != (own.alarms, warnings));
            if news {
                self.seen.push(sighting);
            }
        }
        Ok(standard)
    }
}
