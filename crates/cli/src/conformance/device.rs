//! What is known of the slave: from its GSD, from its diagnosis, or by default the encoder.

use std::path::Path;

use conformance::{Device, EncoderFacts, Features, Mode};
use master::Gsd;
use profibus_dp::time::{Baudrate, BitTimes};
use profibus_dp::wire::chk_cfg::Lengths;
use sch108bex::specification::Variant;

use crate::Failure;

/// The slave as the command line describes it.
pub(super) fn described(address: u8, ident: Option<u16>, gsd: Option<&Path>) -> Result<Device, Failure> {
    let Some(path) = gsd else {
        // The bits are read from the diagnosis.
        return Ok(Device { ident, ..Device::encoder(address, 16, 15) });
    };
    let fault = |why: String| Failure::Failed(format!("--gsd {}: {why}", path.display()));
    let text = gsd_reader::read_text(path).map_err(|error| fault(error.to_string()))?;
    let name = path.display().to_string();
    let gsd = Gsd::parse(&name, &text).map_err(|error| fault(error.to_string()))?;
    let mut device = from_gsd(address, &gsd).map_err(fault)?;
    device.ident = Some(ident.unwrap_or(gsd.description().ident_number));
    Ok(device)
}

fn from_gsd(address: u8, gsd: &Gsd) -> Result<Device, String> {
    let description = gsd.description();
    let mut modes = Vec::new();
    for module in &description.available_modules {
        let Some(lengths) = Lengths::of(&module.config) else { continue };
        let user_prm = gsd.user_parameters(module, &[]).map_err(|error| error.to_string())?;
        modes.push(Mode {
            name: module.name.trim().to_owned(),
            user_prm,
            cfg: module.config.clone(),
            inputs: lengths.inputs.into(),
            outputs: lengths.outputs.into(),
        });
    }
    let encoder = name_functionalities(&mut modes);
    let first = modes.first().ok_or("it has no module with a configuration")?.clone();
    let features = Features {
        freeze: description.freeze_mode_supported,
        sync: description.sync_mode_supported,
        fail_safe: description.fail_safe,
        set_slave_add: description.set_slave_addr_supported,
        asic_octet_8: first.user_prm.first() == Some(&0),
    };
    let mut device = Device { modes, ..Device::slave(address, first, features) };
    for (at, rate) in Baudrate::ALL.into_iter().enumerate() {
        if let Ok(bits) = gsd.max_tsdr(rate) {
            device.max_tsdr[at] = BitTimes(bits.into());
        }
    }
    if encoder {
        device.encoder = Device::encoder(address, 16, 15).encoder;
    }
    Ok(device)
}

/// Gives the encoder's functionalities the names that cases know, class 2 first; whether all are there.
fn name_functionalities(modes: &mut [Mode]) -> bool {
    for mode in modes.iter_mut() {
        let name = match (mode.user_prm.len(), mode.inputs, mode.outputs) {
            (2, 4, 0) => "class 1",
            (18, 4, 4) => "class 2",
            (19, 12, 4) => "scancon",
            _ => continue,
        };
        name.clone_into(&mut mode.name);
    }
    modes.sort_by_key(|mode| mode.name != "class 2");
    ["class 1", "class 2", "scancon"].iter().all(|name| modes.iter().any(|mode| mode.name == *name))
}

/// What the diagnosis says of an encoder; `None`: it is none.
pub(super) fn facts(diagnosis: &[u8]) -> Option<EncoderFacts> {
    let (header, kind) = (*diagnosis.get(6)?, *diagnosis.get(9)?);
    let is_encoder = matches!((header, diagnosis.len()), (0x0A, 16) | (0x33, 57)) && kind == 2;
    let units = u32::from_be_bytes(diagnosis.get(10..14)?.try_into().ok()?);
    let turns = u16::from_be_bytes(diagnosis.get(14..16)?.try_into().ok()?);
    if !is_encoder || !units.is_power_of_two() || !turns.is_power_of_two() {
        return None;
    }
    let bits = |zeros: u32| u8::try_from(zeros).ok();
    let (singleturn_bits, multiturn_bits) = (bits(units.trailing_zeros())?, bits(turns.trailing_zeros())?);
    // Others are encoders too, but not of this kind.
    Variant::new(singleturn_bits, multiturn_bits).ok()?;
    Some(EncoderFacts { singleturn_bits, multiturn_bits, serial: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diagnosis of class 1 (manual 4.2): octets 11 to 14 and 15, 16 are the resolution.
    fn diagnosis(units: u32, turns: u16) -> Vec<u8> {
        let head = [0x02, 0x05, 0x00, 0xFF, 0x10, 0x8B, 0x0A, 0x00, 0x00, 0x02];
        [&head[..], &units.to_be_bytes(), &turns.to_be_bytes()].concat()
    }

    #[test]
    fn the_resolution_is_the_one_in_the_diagnosis() {
        for (units, turns, bits) in [(0x1_0000, 0x8000, (16, 15)), (0x2000, 0x1000, (13, 12)), (4, 1, (2, 0))]
        {
            let found = facts(&diagnosis(units, turns)).expect("an encoder");
            assert_eq!((found.singleturn_bits, found.multiturn_bits), bits);
        }
    }

    #[test]
    fn an_encoder_that_this_device_is_not_made_as_is_a_slave_like_others() {
        for (units, turns) in [(0x8000_0000, 0x8000), (0x2_0000, 1), (2, 1), (0x3000, 0x1000), (0x2000, 0)] {
            assert_eq!(facts(&diagnosis(units, turns)), None, "{units} {turns}");
        }
    }
}
