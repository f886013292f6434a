//! What a user's GSD of this device changes, and what of it does not fit.
//!
//! Ident number and identifier octets are taken over. A parameter layout other than the manual's is
//! told, never adopted: the parameters that a master would make of the file are put together and read
//! as the device reads them.

use gsd_parser::{
    GenericStationDescription, Module, PrmValueConstraint, SupportedSpeeds, UserPrmData,
    UserPrmDataDefinition, UserPrmDataType,
};
use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::set_prm::{AsicOctet, STANDARD_OCTETS};
use sch108bex::configuration::Configurations;
use sch108bex::functionality::Functionality;
use sch108bex::parameterization::Parameters;
use sch108bex::specification::Variant;

/// The most remarks that are made; a file of another kind would have thousands.
const MOST_NOTES: usize = 40;

/// What an encoder offers to masters that know it by a GSD.
#[derive(Debug)]
pub struct Judgement {
    /// The file's.
    pub ident_number: u16,
    /// The file's for the functionalities that it has, the readings' for the others.
    pub configurations: Configurations,
    /// What does not fit, in sentences; empty if everything does.
    pub notes: Vec<String>,
}

/// Judges a GSD for an encoder of this variant. `text` is what `gsd` was read from.
///
/// # Errors
///
/// A sentence, if the file can be none of this device: no ident number, or no module that fits.
pub fn judge(gsd: &GenericStationDescription, text: &str, variant: Variant) -> Result<Judgement, String> {
    if gsd.ident_number == 0 {
        return Err("it has no Ident_Number; a master needs it to know the device".to_owned());
    }
    let mut notes = Vec::new();
    let mut configurations = Configurations::default();
    let mut found = Vec::new();
    for module in &gsd.available_modules {
        let Some(functionality) = functionality_of(module) else {
            notes.push(format!(
                "module \"{}\" ({:02X?}) is none of this device's: its octets are not those of class 1 \
                 (4 in), class 2 (4 in, 4 out) or Scancon 2.0 (12 in, 4 out)",
                module.name,
                &module.config[..module.config.len().min(8)]
            ));
            continue;
        };
        let taken = if found.contains(&functionality) {
            configurations.offer(functionality, &module.config)
        } else {
            configurations.replace(functionality, &module.config)
        };
        found.push(functionality);
        match taken {
            Ok(()) => notes.extend(of_module(gsd, module, functionality, variant)),
            Err(why) => notes.push(format!("module \"{}\" is not taken over: {why}", module.name)),
        }
    }
    let Some(richest) = found.iter().copied().max_by_key(|found| found.parameter_octets()) else {
        return Err(
            "it describes no module that this device could be; is it the file of another device?".to_owned()
        );
    };
    notes.extend(of_station(gsd, text, richest));
    if let Some(more) = notes.len().checked_sub(MOST_NOTES).filter(|&more| more > 0) {
        notes.truncate(MOST_NOTES);
        notes.push(format!("and {more} more; is it the file of another device?"));
    }
    Ok(Judgement { ident_number: gsd.ident_number, configurations, notes })
}

/// What a module's identifier octets amount to.
fn functionality_of(module: &Module) -> Option<Functionality> {
    let lengths = Lengths::of(&module.config)?;
    Functionality::ALL.into_iter().find(|functionality| functionality.lengths() == lengths)
}

/// Where the parameters of a module are not what the manual has.
fn of_module(
    gsd: &GenericStationDescription,
    module: &Module,
    functionality: Functionality,
    variant: Variant,
) -> Vec<String> {
    let before = usize::from(gsd.user_prm_data.length);
    let octets = STANDARD_OCTETS + before + usize::from(module.module_prm_data.length);
    let due = usize::from(functionality.parameter_octets());
    let mut notes = Vec::new();
    if octets < due {
        notes.push(format!(
            "module \"{}\" makes a Set_Prm of {octets} octets, but {functionality} needs {due}: a master that \
             uses it will be refused (manual 4.1)",
            module.name
        ));
    } else if octets != due {
        notes.push(format!(
            "module \"{}\" makes a Set_Prm of {octets} octets; {functionality} of the manual has {due}. \
             The manual's layout stays in force (manual 4.1)",
            module.name
        ));
    }
    let of_module =
        module.module_prm_data.data_ref.iter().map(|(offset, data)| (offset.saturating_add(before), data));
    for (offset, data) in
        gsd.user_prm_data.data_ref.iter().map(|(offset, data)| (*offset, data)).chain(of_module)
    {
        notes.extend(of_parameter(module, offset.saturating_add(STANDARD_OCTETS + 1), data, variant));
    }
    if octets == due {
        notes.extend(of_defaults(gsd, module, octets, variant));
    }
    notes
}

/// Where a single parameter is not what the manual has at its octet of Set_Prm.
fn of_parameter(
    module: &Module,
    octet: usize,
    data: &UserPrmDataDefinition,
    variant: Variant,
) -> Vec<String> {
    let what = format!("parameter \"{}\" of module \"{}\"", data.name, module.name);
    let mut notes = Vec::new();
    if !is_the_manuals(octet, data.data_type) {
        notes.push(format!(
            "{what} is at octet {octet} as {:?}; the manual has none there (manual 4.1)",
            data.data_type
        ));
        return notes;
    }
    let whole = data.data_type == UserPrmDataType::Unsigned32;
    let most = match octet {
        10 if whole => i64::from(variant.steps_per_revolution()),
        14 if whole => i64::from(variant.total()),
        26 => 3,
        _ => i64::MAX,
    };
    if data.default_value > most {
        notes.push(format!(
            "{what} is {} by default, more than the {most} that {variant} bits allow: with scaling on it will \
             be refused; --bits takes another variant",
            data.default_value
        ));
    } else if let PrmValueConstraint::MinMax(_, limit) = data.constraint
        && limit > most
    {
        notes.push(format!("{what} may be up to {limit}, but more than {most} will be refused"));
    }
    let shortest_first =
        data.text_ref.as_ref().and_then(|texts| texts.iter().find(|(_, value)| **value == 0));
    if octet == 26
        && let Some((words, _)) = shortest_first
        && words.contains("1000")
    {
        notes.push(format!(
            "{what} calls 0 \"{words}\", as other makers do; with this device 0 is steps per 10 ms, \
             2 is steps per 1000 ms (manual 4.1.5)"
        ));
    }
    notes
}

/// Whether the manual has such a parameter at this octet of Set_Prm (manual 4.1).
fn is_the_manuals(octet: usize, kind: UserPrmDataType) -> bool {
    match octet {
        9 => matches!(kind, UserPrmDataType::Bit(0..=3) | UserPrmDataType::BitArea(0..=3, 0..=3)),
        10 | 14 => matches!(kind, UserPrmDataType::Unsigned32 | UserPrmDataType::Unsigned16),
        12 | 16 => kind == UserPrmDataType::Unsigned16,
        26 => matches!(kind, UserPrmDataType::Unsigned8 | UserPrmDataType::BitArea(0, _)),
        _ => false,
    }
}

/// What the device would say to the parameters as the file has them by default: once with the
/// constants alone, as masters send them that know no single parameters, once with those laid over.
fn of_defaults(
    gsd: &GenericStationDescription,
    module: &Module,
    octets: usize,
    variant: Variant,
) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    for with_references in [false, true] {
        let mut set_prm = vec![0; octets];
        let before = usize::from(gsd.user_prm_data.length);
        lay(&mut set_prm, STANDARD_OCTETS, &gsd.user_prm_data, with_references);
        lay(&mut set_prm, STANDARD_OCTETS + before, &module.module_prm_data, with_references);
        let asic = AsicOctet(set_prm.get(STANDARD_OCTETS).copied().unwrap_or(0));
        let refusal = if asic.refused_bits() == 0 {
            Parameters::parse(&set_prm, &variant).err().map(|refusal| refusal.to_string())
        } else {
            Some(format!("Set_Prm octet 8: {:02X}h asks for functions that DP-V0 has not", asic.0))
        };
        let Some(refusal) = refusal else { continue };
        let who = if with_references { "by default" } else { "by its constants alone" };
        if !notes.iter().any(|note| note.ends_with(&refusal)) {
            notes.push(format!("module \"{}\" would be refused {who}: {refusal}", module.name));
        }
    }
    notes
}

/// Lays constants, and defaults of single parameters over them, into a Set_Prm.
fn lay(set_prm: &mut [u8], from: usize, data: &UserPrmData, with_references: bool) {
    for (offset, octets) in &data.data_const {
        for (place, octet) in set_prm.iter_mut().skip(from.saturating_add(*offset)).zip(octets) {
            *place = *octet;
        }
    }
    for (offset, parameter) in data.data_ref.iter().filter(|_| with_references) {
        let value = parameter.default_value.to_be_bytes();
        let places = set_prm.iter_mut().skip(from.saturating_add(*offset));
        match parameter.data_type {
            UserPrmDataType::Bit(bit) => lay_bits(places, bit, bit, value[7]),
            UserPrmDataType::BitArea(first, last) => lay_bits(places, first, last, value[7]),
            other => {
                for (place, octet) in places.zip(&value[8 - other.size().min(8)..]) {
                    *place = *octet;
                }
            }
        }
    }
}

fn lay_bits<'a>(mut places: impl Iterator<Item = &'a mut u8>, first: u8, last: u8, value: u8) {
    let width = u32::from(last.saturating_sub(first)) + 1;
    let mask = u8::MAX.checked_shr(8_u32.saturating_sub(width)).unwrap_or(0);
    let shift = u32::from(first);
    if let Some(place) = places.next() {
        let mask = mask.checked_shl(shift).unwrap_or(0);
        *place = (*place & !mask) | (value.checked_shl(shift).unwrap_or(0) & mask);
    }
}

/// Where the file says of the whole station what does not hold for it.
fn of_station(gsd: &GenericStationDescription, text: &str, richest: Functionality) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |wrong: bool, words: String| {
        if wrong {
            notes.push(words);
        }
    };
    let missing: Vec<_> =
        rates().filter(|(rate, _)| !gsd.supported_speeds.contains(*rate)).map(|(_, name)| name).collect();
    note(
        !missing.is_empty(),
        format!("it leaves out the rates {} that the device has (manual 6)", missing.join(", ")),
    );
    let diagnosis = richest.diagnosis_octets();
    note(
        gsd.max_diag_data_length < diagnosis,
        format!(
            "Max_Diag_Data_Len is {}, but {richest} sends {diagnosis} octets of diagnosis: a master may cut or \
             refuse them (manual 4.2)",
            gsd.max_diag_data_length
        ),
    );
    let user = richest.parameter_octets() - 7;
    if let Some(most) = number(text, "Max_User_Prm_Data_Len") {
        let words = format!("Max_User_Prm_Data_Len is {most}, but {richest} needs {user} (manual 4.1)");
        note(most < u64::from(user), words);
    }
    if gsd.modular_station {
        let (inputs, outputs) = (richest.inputs(), richest.outputs());
        note(
            gsd.max_input_length < inputs || gsd.max_output_length < outputs,
            format!(
                "Max_Input_Len {} and Max_Output_Len {} are less than the {inputs} and {outputs} of {richest}",
                gsd.max_input_length, gsd.max_output_length
            ),
        );
        let both = u16::from(inputs) + u16::from(outputs);
        let words =
            format!("Max_Data_Len is {}, but {richest} has {both} octets of data", gsd.max_data_length);
        note(gsd.max_data_length < both, words);
        let words = format!("Max_Module is {}, but the device takes exactly one module", gsd.max_modules);
        note(gsd.max_modules != 1, words);
    } else {
        note(
            gsd.available_modules.len() > 1,
            "it has several modules, but no Modular_Station = 1: a master will configure all of them at once"
                .to_owned(),
        );
    }
    note(
        number(text, "DPV1_Slave").is_some_and(|value| value != 0),
        "DPV1_Slave is set, but the device is DP-V0: parameters with DPV1_Enable will be refused".to_owned(),
    );
    note(
        !gsd.set_slave_addr_supported,
        "Set_Slave_Add_supp is not set; the device takes its address over the bus too (manual 3.4)"
            .to_owned(),
    );
    notes
}

/// The rates of the manual (6), with their names in a GSD.
fn rates() -> impl Iterator<Item = (SupportedSpeeds, &'static str)> {
    [
        (SupportedSpeeds::B9600, "9.6"),
        (SupportedSpeeds::B19200, "19.2"),
        (SupportedSpeeds::B93750, "93.75"),
        (SupportedSpeeds::B187500, "187.5"),
        (SupportedSpeeds::B500000, "500"),
        (SupportedSpeeds::B1500000, "1.5M"),
        (SupportedSpeeds::B3000000, "3M"),
        (SupportedSpeeds::B6000000, "6M"),
        (SupportedSpeeds::B12000000, "12M"),
    ]
    .into_iter()
}

/// The number that a keyword has; the parser does not keep all of them.
fn number(text: &str, keyword: &str) -> Option<u64> {
    text.lines().find_map(|line| {
        let (key, value) = line.split(';').next()?.split_once('=')?;
        let value = value.trim();
        let number = match value.strip_prefix("0x").or_else(|| value.strip_prefix("0X")) {
            Some(digits) => u64::from_str_radix(digits, 16),
            None => value.parse(),
        };
        key.trim().eq_ignore_ascii_case(keyword).then_some(number.ok()).flatten()
    })
}

#[cfg(test)]
#[path = "judgement_tests.rs"]
mod tests;
