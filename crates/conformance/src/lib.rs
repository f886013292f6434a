//! A test laboratory for PROFIBUS DP-V0 slaves: cases as data, and a runner that plays them against
//! any slave on any port.
//!
//! A [`Case`] is one rule: where it begins, what is sent, what is due. They stand in
//! `cases/*.txt`, as a PROFIBUS engineer would write them down; [`cases`] reads them. A [`Runner`]
//! plays them on a [`Rig`]: [`VirtualRig`] for a slave in this process, in virtual time, and
//! [`PortRig`] for anything behind a [`bus::End`]. A [`Device`] says what is known of the slave.
//!
//! The tester makes and reads its telegrams by itself; it shares no code with the slaves of this
//! project but their types of time.

#![forbid(unsafe_code)]

mod begin;
pub mod case;
pub mod control;
pub mod device;
mod identifiers;
mod judge;
mod needs;
mod parser;
mod port_rig;
mod random;
mod reply;
pub mod report;
mod result;
pub mod rig;
mod runner;
pub mod telegram;
mod virtual_rig;

use std::sync::OnceLock;

pub use case::{Case, Profile};
pub use control::{Control, ControlSocket};
pub use device::{Device, EncoderFacts, Features, Mode};
pub use parser::{ParseError, parse};
pub use port_rig::{PATIENCE, PortRig};
pub use result::{CaseResult, Outcome, Record};
pub use rig::{Action, Expect, Hand, Order, Rig, RigError, Signal};
pub use runner::{NoMode, Options, Runner};
pub use virtual_rig::{Fresher, Subject, VirtualRig};

/// The files of cases with their texts, in the order in which they are played.
pub const FILES: [(&str, &str); 17] = [
    ("receiving.txt", include_str!("../cases/receiving.txt")),
    ("frame_count.txt", include_str!("../cases/frame_count.txt")),
    ("services.txt", include_str!("../cases/services.txt")),
    ("set_prm.txt", include_str!("../cases/set_prm.txt")),
    ("chk_cfg.txt", include_str!("../cases/chk_cfg.txt")),
    ("slave_diag.txt", include_str!("../cases/slave_diag.txt")),
    ("data_exchange.txt", include_str!("../cases/data_exchange.txt")),
    ("global_control.txt", include_str!("../cases/global_control.txt")),
    ("watchdog.txt", include_str!("../cases/watchdog.txt")),
    ("timing.txt", include_str!("../cases/timing.txt")),
    ("masters.txt", include_str!("../cases/masters.txt")),
    ("encoder_address.txt", include_str!("../cases/encoder_address.txt")),
    ("encoder_parameters.txt", include_str!("../cases/encoder_parameters.txt")),
    ("encoder_diagnosis.txt", include_str!("../cases/encoder_diagnosis.txt")),
    ("encoder_position.txt", include_str!("../cases/encoder_position.txt")),
    ("encoder_preset.txt", include_str!("../cases/encoder_preset.txt")),
    ("encoder_velocity.txt", include_str!("../cases/encoder_velocity.txt")),
];

/// All cases, in the order in which they are played.
///
/// # Panics
///
/// Never: a test reads every file.
pub fn cases() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| {
        FILES
            .iter()
            .flat_map(|(file, text)| parse(file, text).unwrap_or_else(|error| panic!("{error}")))
            .collect()
    })
}

/// Plays `cases` against a slave in virtual time, one after the other, each with a fresh slave.
///
/// # Errors
///
/// The device has no mode. A virtual rig does not break.
pub fn run_virtual<S: Subject>(
    cases: &[Case],
    device: &Device,
    rig: &mut VirtualRig<S>,
    options: Options,
) -> Result<Vec<CaseResult>, NoMode> {
    let mut runner = Runner::new(device, rig, options)?;
    Ok(cases.iter().filter_map(|case| runner.run(case).ok()).collect())
}
