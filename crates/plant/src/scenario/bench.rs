//! The encoders of a scenario on segments in virtual time, with their built-in masters.

use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex};

use bus::{EndError, VirtualSegment};
use profibus_dp::time::Instant;

use super::events::{Act, MasterAct};
use super::poller::{NotedLine, Poller};
use super::run::RunError;
use super::{EncoderPlan, Scenario, SegmentPlan};
use crate::control::{ControlError, Couplings};
use crate::encoder::{EncoderSetup, EncoderStation, Rate};
use crate::ground::lock;
use crate::handle::{Handle, Known, Place, Way};
use crate::plant::{Terminated, tell_termination};
use crate::report::{Report, Reporter};
use crate::store::{Store, StoreError};

/// The encoders of a scenario in virtual time.
#[derive(Debug)]
pub struct Bench {
    handle: Handle,
    pub(super) segments: Vec<MasteredSegment>,
    reports: Receiver<Report>,
    /// Reports that were looked at and not taken yet.
    seen: Vec<Report>,
    now: Instant,
}

/// A segment and its master.
#[derive(Debug)]
pub(super) struct MasteredSegment {
    pub(super) name: String,
    pub(super) poller: Poller,
    idents: Vec<(u8, u16)>,
}

impl EncoderPlan {
    /// What makes it an encoder that runs.
    ///
    /// # Errors
    ///
    /// Its state file cannot be used.
    pub fn setup(&self, rate: Rate, reports: &Sender<Report>) -> Result<EncoderSetup, StoreError> {
        let store = match &self.state {
            None => Store::forgetful(),
            Some(path) => Store::open(path, self.identity.variant, false)?,
        };
        Ok(EncoderSetup {
            identity: self.identity,
            configurations: self.configurations,
            rate,
            termination: self.termination,
            shaft: self.shaft.clone(),
            world: self.world,
            store,
            reporter: Reporter::new(&self.name, Some(reports.clone())),
        })
    }
}

impl Bench {
    /// Gives everybody power at time 0.
    ///
    /// # Errors
    ///
    /// A state file cannot be used.
    pub fn new(scenario: &Scenario) -> Result<Self, RunError> {
        let (to, reports) = mpsc::channel();
        let mut segments = Vec::new();
        let mut places = Vec::new();
        for plan in &scenario.segments {
            let (place, segment) = make(plan, &to)?;
            places.push(place);
            segments.push(segment);
        }
        let handle = Handle::new(places.into_iter(), Couplings::default());
        for start in scenario.starts() {
            handle.apply(&start)?;
        }
        Ok(Self { handle, segments, reports, seen: Vec::new(), now: Instant::ZERO })
    }

    /// A hand on it: what it is asked for is done between two steps.
    pub fn handle(&self) -> &Handle {
        &self.handle
    }

    /// The time that it was brought to.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// What has happened since the last call, in order of time.
    pub fn take_reports(&mut self) -> Vec<Report> {
        let mut reports = std::mem::take(&mut self.seen);
        reports.extend(self.reports.try_iter());
        reports.sort_by_key(|report| report.at);
        reports
    }

    /// What has happened since the last look. It still waits for [`take_reports`](Self::take_reports).
    pub(super) fn look_at_reports(&mut self) -> &[Report] {
        let before = self.seen.len();
        self.seen.extend(self.reports.try_iter());
        self.seen.get(before..).unwrap_or_default()
    }

    /// Everything that begins before this moment.
    ///
    /// # Errors
    ///
    /// Never in virtual time.
    pub fn advance_to(&mut self, until: Instant) -> Result<(), EndError> {
        self.now = self.now.max(until);
        self.segments.iter_mut().try_for_each(|segment| segment.poller.advance_to(until))
    }

    /// Does what an event asks for.
    ///
    /// # Errors
    ///
    /// Why it was not done.
    pub fn act(&mut self, act: &Act) -> Result<(), ControlError> {
        match act {
            Act::Request(request) => self.handle.apply(request).map(drop),
            Act::Master(act) => self.ask_master(act),
        }
    }

    fn ask_master(&mut self, act: &MasterAct) -> Result<(), ControlError> {
        let wanted = act.segment();
        for segment in &mut self.segments {
            match act {
                MasterAct::Preset { encoder, value } => {
                    segment.poller.slave_mut(encoder).into_iter().for_each(|slave| slave.preset(*value));
                }
                MasterAct::Outputs { encoder, value } => {
                    segment.poller.slave_mut(encoder).into_iter().for_each(|slave| slave.set_outputs(*value));
                }
                _ if wanted == Some(segment.name.as_str()) => segment.ask_master(act)?,
                _ => {}
            }
        }
        Ok(())
    }

    pub(super) fn poller_of(&self, encoder: &str) -> Option<&Poller> {
        self.segments.iter().map(|segment| &segment.poller).find(|poller| poller.slave(encoder).is_some())
    }

    /// An orderly end of all encoders.
    pub fn shut_down(&mut self) {
        for place in self.handle.places() {
            if let Way::Virtual(segment) = &place.way {
                let mut segment = lock(segment);
                let now = segment.now();
                segment.stations_mut().iter_mut().for_each(|station| station.shut_down(now));
            }
        }
    }
}

impl MasteredSegment {
    fn ask_master(&mut self, act: &MasterAct) -> Result<(), ControlError> {
        match act {
            MasterAct::SetAddress { from, to, .. } => {
                let ident = self.idents.iter().find(|(address, _)| address == from);
                let ident = ident.or(self.idents.first()).map_or(0, |(_, ident)| *ident);
                self.poller
                    .set_address(*from, *to, ident)
                    .map_err(|error| ControlError::Value(error.to_string()))
            }
            MasterAct::MasterStop { .. } => {
                self.poller.stop();
                Ok(())
            }
            _ => {
                self.poller.start();
                Ok(())
            }
        }
    }
}

fn make(plan: &SegmentPlan, reports: &Sender<Report>) -> Result<(Place, MasteredSegment), StoreError> {
    let rate = plan.rate.unwrap_or(bus::segment::DEFAULT_RATE);
    let mut segment = VirtualSegment::new(Instant::ZERO, rate);
    let mut taps = Vec::new();
    for encoder in &plan.encoders {
        let rate = if plan.search { Rate::Search(rate) } else { Rate::Fixed(rate) };
        let setup = encoder.setup(rate, reports)?;
        taps.push(Terminated::of(&setup));
        let mut station = EncoderStation::new(Instant::ZERO, setup)?;
        station.start_shaft(Instant::ZERO);
        segment.add(station);
    }
    segment.faults_mut().set_cable(plan.tap.cable(plan.encoders.len()));
    tell_termination(&plan.name, plan.tap, &taps, reports);
    let segment = Arc::new(Mutex::new(segment));
    let encoders = plan.encoders.iter();
    let known =
        encoders.map(|encoder| Known { name: encoder.name.clone(), variant: encoder.identity.variant });
    let place = Place {
        name: plan.name.clone(),
        port: "virtual".to_owned(),
        encoders: known.collect(),
        way: Way::Virtual(Arc::clone(&segment)),
    };
    let nobody = super::MasterPlan {
        address: 2,
        retries: 1,
        cycle: profibus_dp::time::Duration::from_secs(3_600),
        start: Instant::ZERO,
        polls: Vec::new(),
    };
    let poller = Poller::new(NotedLine::new(segment), plan.master.as_ref().unwrap_or(&nobody));
    let idents =
        plan.encoders.iter().map(|encoder| (encoder.identity.switches.0, encoder.identity.ident_number));
    Ok((place, MasteredSegment { name: plan.name.clone(), poller, idents: idents.collect() }))
}
