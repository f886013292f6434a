//! Whether a case can be played here; if not, why.

use crate::case::{Case, Feature, Need, Profile, Start};
use crate::device::Device;
use crate::rig::{Hand, Rig};
use crate::runner::Options;

/// The reason to leave a case out, as `Err`.
pub(crate) fn check(case: &Case, device: &Device, rig: &dyn Rig, options: Options) -> Result<(), String> {
    let abilities = rig.abilities();
    if case.profile == Profile::Encoder && device.encoder.is_none() {
        return Err("it is about the encoder of the manual, which this slave is not".to_owned());
    }
    if case.long && !options.long && !abilities.exact_time {
        return Err("it takes long: ask for it with --long".to_owned());
    }
    if let Some(mode) = &case.before.mode
        && device.mode(Some(mode)).is_none()
    {
        return Err(format!("this slave has no {mode}"));
    }
    if matches!(case.before.state, Start::PowerOn | Start::At126) {
        hand(rig, Hand::Power)?;
    }
    if case.before.state == Start::At126 {
        hand(rig, Hand::Switches)?;
    }
    if (case.before.search || case.before.rate.is_some_and(|rate| rate != rig.rate())) && !abilities.rates {
        return Err("it needs a bus on which the rate can be chosen".to_owned());
    }
    case.needs.iter().try_for_each(|need| met(need, device, rig))
}

fn hand(rig: &dyn Rig, hand: Hand) -> Result<(), String> {
    if rig.has(hand) { Ok(()) } else { Err(format!("it needs control of {}", hand.what())) }
}

fn met(need: &Need, device: &Device, rig: &dyn Rig) -> Result<(), String> {
    let abilities = rig.abilities();
    let demand = |met: bool, what: &str| if met { Ok(()) } else { Err(format!("it needs {what}")) };
    let (inputs, outputs, prm) =
        device.modes.first().map_or((0, 0, 0), |mode| (mode.inputs, mode.outputs, mode.user_prm.len()));
    match need {
        Need::Hand(which) => hand(rig, *which),
        Need::ExactTime => demand(abilities.exact_time, "a bus whose times are exact (a virtual one)"),
        Need::LineErrors => demand(abilities.line_errors, "a line that can damage characters"),
        Need::Stream => demand(abilities.stream, "a slave that sees a stream of octets"),
        Need::Idle => demand(!abilities.stream, "a slave that sees idle times"),
        Need::Rates => demand(abilities.rates, "a bus on which the rate can be chosen"),
        Need::Outputs(true) => demand(outputs > 0, "a slave with outputs"),
        Need::Outputs(false) => demand(outputs == 0, "a slave without outputs"),
        Need::Inputs(true) => demand(inputs > 0, "a slave with inputs"),
        Need::Inputs(false) => demand(inputs == 0, "a slave without inputs"),
        Need::OutputOctets(count) => {
            demand(outputs == *count, &format!("a slave with {count} output octets"))
        }
        Need::UserPrm(count) => {
            demand(prm >= *count, &format!("a slave with {count} octets of user parameters or more"))
        }
        Need::Bits(n, m) => demand(
            device
                .encoder
                .as_ref()
                .is_some_and(|facts| (facts.singleturn_bits, facts.multiturn_bits) == (*n, *m)),
            &format!("an encoder with {n}x{m} bits"),
        ),
        Need::Serial => demand(
            device.encoder.as_ref().is_some_and(|facts| facts.serial.is_some()),
            "the serial number of the encoder",
        ),
        Need::Feature(feature, due) => {
            let features = &device.features;
            let (has, name) = match feature {
                Feature::Freeze => (features.freeze, "Freeze"),
                Feature::Sync => (features.sync, "Sync"),
                Feature::FailSafe => (features.fail_safe, "Fail_Safe"),
                Feature::SetSlaveAdd => (features.set_slave_add, "Set_Slave_Add"),
                Feature::AsicOctet8 => (features.asic_octet_8, "the slave ASIC's octet 8 of Set_Prm"),
            };
            demand(has == *due, &format!("a slave {} {name}", if *due { "with" } else { "without" }))
        }
    }
}
