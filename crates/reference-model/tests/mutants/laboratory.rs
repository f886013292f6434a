//! Plays the slave checks on any version of the model.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

use conformance::{Case, CaseResult, Device, Options, Outcome, Runner, VirtualRig, cases};
use profibus_dp::time::{Baudrate, Duration, Instant};

use crate::list::Mutant;
use crate::subject::{Kind, Version};
use crate::wrong::{PowerOn, Setting, model};

/// What is disputed counts as the model reads it, so that a slave that reads it otherwise is wrong.
fn options() -> Options {
    Options { strict: true, ..Options::default() }
}

/// The cases and, for each, the kind of device that it is played on.
pub(crate) struct Laboratory {
    devices: Vec<(Kind, Device)>,
    model: Vec<(Kind, CaseResult)>,
}

/// What became of the model; the tests of one process share it.
static MODEL: OnceLock<Vec<(Kind, CaseResult)>> = OnceLock::new();

impl Laboratory {
    pub(crate) fn new() -> Self {
        let devices: Vec<_> = Kind::ALL.into_iter().map(|kind| (kind, kind.described())).collect();
        let model = MODEL.get_or_init(|| cases().iter().map(|case| home(case, &devices)).collect()).clone();
        Self { devices, model }
    }

    pub(crate) fn model(&self) -> impl Iterator<Item = &CaseResult> {
        self.model.iter().map(|(_, result)| result)
    }

    /// Whether the model passes the case, so that it says something about its wrong versions.
    pub(crate) fn plays(&self, case: usize) -> bool {
        self.model[case].1.outcome == Outcome::Pass
    }

    /// Which cases each of them fails; on two threads.
    pub(crate) fn try_all(&self, mutants: &[Mutant]) -> Vec<Vec<bool>> {
        let (next, results) = (AtomicUsize::new(0), Mutex::new(vec![Vec::new(); mutants.len()]));
        let work = || {
            while let Some((at, mutant)) = {
                let at = next.fetch_add(1, Ordering::Relaxed);
                mutants.get(at).map(|mutant| (at, mutant))
            } {
                let failed = self.failed(mutant.power_on);
                results.lock().expect("the other thread goes on")[at] = failed;
            }
        };
        std::thread::scope(|scope| {
            scope.spawn(work);
            work();
        });
        results.into_inner().expect("both threads have ended")
    }

    fn failed(&self, power_on: PowerOn) -> Vec<bool> {
        let mut failed = vec![false; cases().len()];
        for (kind, device) in &self.devices {
            let mut rig = rig(*kind, power_on);
            let mut runner = Runner::new(device, &mut rig, options()).expect("it has a mode");
            for (at, case) in cases().iter().enumerate() {
                if self.plays(at) && self.model[at].0 == *kind {
                    let result = runner.run(case).expect("a virtual rig does not break");
                    failed[at] = result.outcome == Outcome::Fail;
                }
            }
        }
        failed
    }
}

fn rig(kind: Kind, power_on: PowerOn) -> VirtualRig<Version> {
    let rig = VirtualRig::new(Version::new(kind, power_on), false);
    if kind.is_stream() { rig.with_stream_receivers() } else { rig }
}

/// The first kind of device on which the case can be played, and what the model made of it; a
/// case about finding the next telegram is played on a stream.
fn home(case: &Case, devices: &[(Kind, Device)]) -> (Kind, CaseResult) {
    let on_a_stream = case.tags.iter().any(|tag| tag == "resync");
    let mut skipped = None;
    for (kind, device) in devices.iter().filter(|(kind, _)| kind.is_stream() || !on_a_stream) {
        let mut rig = rig(*kind, model);
        let mut runner = Runner::new(device, &mut rig, options()).expect("it has a mode");
        let mut result = runner.run(case).expect("a virtual rig does not break");
        if case.before.search {
            result.outcome = Outcome::Skip;
            "the model does not search its rate".clone_into(&mut result.reason);
        }
        if *kind == Kind::Encoder && result.outcome == Outcome::Fail {
            result.outcome = Outcome::Skip;
            "it is about what makes the device an encoder, which the model is not"
                .clone_into(&mut result.reason);
        }
        if result.outcome != Outcome::Skip {
            return (*kind, result);
        }
        skipped = Some((*kind, result));
    }
    skipped.expect("there are kinds")
}

/// Whether a start-up as masters do it leads to inputs.
pub(crate) fn exchanges(power_on: PowerOn) -> bool {
    let (kind, mut now) = (Kind::Full, Instant::from_millis(1_000));
    let setting = Setting { address: 11, rate: Baudrate::B500000, stream: false };
    let mut slave = power_on(now, setting, kind.device());
    let mut ask = |request: &[u8]| {
        now += Duration::from_millis(5);
        let window = slave.receive(now, request)?;
        now = window.not_before;
        slave.transmit(now).map(<[u8]>::to_vec)
    };
    ask(&[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16]);
    ask(&[
        0x68, 0x0E, 0x0E, 0x68, 0x8B, 0x82, 0x5D, 0x3D, 0x3E, 0x80, 0x01, 0x14, 0x0B, 0x47, 0x11, 0x00, 0x00,
        0x00, 0xDD, 0x16,
    ]);
    ask(&[0x68, 0x06, 0x06, 0x68, 0x8B, 0x82, 0x7D, 0x3E, 0x3E, 0xF1, 0xF7, 0x16]);
    ask(&[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x5D, 0x3C, 0x3E, 0xE4, 0x16]);
    let inputs = ask(&[0x68, 0x07, 0x07, 0x68, 0x0B, 0x02, 0x7D, 0x00, 0x00, 0x00, 0x00, 0x8A, 0x16]);
    matches!(
        inputs.as_deref(),
        Some([0x68, 0x07, 0x07, 0x68, 0x02, 0x0B, 0x08 | 0x0A, 0x00, 0x12, 0x34, 0x56, _, 0x16])
    )
}
