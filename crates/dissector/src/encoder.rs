//! What the telegrams of an encoder of the profile, of this one first, hold (manual 4.1 to 4.3).

use sch108bex::diagnostics::{Alarms, Class2Part, Diagnostics, LONG_BLOCK, SHORT_BLOCK, Warnings};
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};
use sch108bex::preset::PRESET_BIT;
use sch108bex::specification::{PLACEHOLDER_IDENT, Variant};

use crate::field::{Data, Value};
use crate::services::Block;

/// Whether a Set_Prm can only be an encoder's, by its length and what must be 0 or 1 in it.
pub(crate) fn parameters_fit(set_prm: &[u8]) -> bool {
    let ident = set_prm.get(4..6) == Some(&PLACEHOLDER_IDENT.to_be_bytes());
    match set_prm.len() {
        9 => ident,
        25 | 26 => set_prm[8] & 0xF6 == 0x02 && set_prm[17..25].iter().all(|&octet| octet == 0),
        _ => false,
    }
}

/// Octets 9 and up of Set_Prm; the words, and what a device of this variant would refuse.
pub(crate) fn parameters(data: &mut Data<'_>, variant: Variant) -> (String, Option<(usize, String)>) {
    data.bit(9, 0, "encoder.code_sequence", ["increasing clockwise", "increasing counter-clockwise"]);
    data.bit(9, 1, "encoder.class_2", ["class 1", "class 2 functionality"]);
    data.bit(9, 2, "encoder.commissioning_diagnostics", ["", "asked for; this encoder has none"]);
    data.bit(9, 3, "encoder.scaling", ["off", "on"]);
    let scaled = data.octets.len() >= 25 && data.octet(9).is_some_and(|octet| octet & 0x08 != 0);
    let ignored = || if scaled { "".into() } else { "without effect, scaling is off".into() };
    let units = data.number([10, 13], "encoder.measuring_units_per_revolution", |_| ignored());
    let range = data.number([14, 17], "encoder.total_measuring_range", |_| ignored());
    data.raw([18, 25], "encoder.reserved", "");
    let base = data.number([26, 26], "encoder.time_base", |octet| time_base(octet).into());
    data.raw([27, usize::MAX], "rest", "");
    let mut words = vec![CodeSequence::from_bit(data.octet(9).unwrap_or(0)).to_string()];
    if let (Some(units), Some(range)) = (units, range) {
        words.push(if scaled {
            format!("{units} units a turn, {range} in all")
        } else {
            "scaling off".to_owned()
        });
    }
    words.extend(base.map(|octet| time_base(octet).to_owned()));
    let refusal = Parameters::parse(data.octets, &variant).err().map(|refusal| {
        let octet = refusal.octet().map_or(data.octets.len(), usize::from);
        (data.place(octet), format!("an SCH108BEX of {variant} bits refuses it: {refusal}"))
    });
    (words.join(", "), refusal)
}

fn time_base(octet: u32) -> &'static str {
    match u8::try_from(octet).ok().and_then(TimeBase::from_octet) {
        Some(TimeBase::Per10Ms) => "steps per 10 ms",
        Some(TimeBase::Per100Ms) => "steps per 100 ms",
        Some(TimeBase::Per1000Ms) => "steps per 1000 ms",
        Some(TimeBase::Rpm) => "revolutions per minute",
        None => "no such time base",
    }
}

/// The time base of a Set_Prm of 26 octets.
pub(crate) fn time_base_of(set_prm: &[u8]) -> Option<TimeBase> {
    if set_prm.len() == 26 { TimeBase::from_octet(set_prm[25]) } else { None }
}

/// The four outputs: a preset, or nothing.
pub(crate) fn outputs(data: &mut Data<'_>) -> String {
    let Some(output) = data.octets.first_chunk::<4>().map(|octets| u32::from_be_bytes(*octets)) else {
        return String::new();
    };
    data.bit(1, 7, "encoder.preset", ["", "preset at the rising edge of this bit"]);
    let value = output & !PRESET_BIT;
    data.add([1, 4], Some([30, 0]), "encoder.preset_value", Value::Number(i64::from(value)), "".into());
    if output & PRESET_BIT == 0 { "no preset".to_owned() } else { format!("preset to {value}") }
}

/// Four inputs, or twelve.
pub(crate) fn inputs(data: &mut Data<'_>, base: Option<TimeBase>) -> String {
    let position = data.number([1, 4], "encoder.position", |_| "".into());
    let unit = base.map_or_else(String::new, |base| base.to_string());
    let velocity = data.signed([5, 8], "encoder.velocity", |_| unit.clone().into());
    let change = base.map_or("", |base| match base {
        TimeBase::Rpm => "RPM per second",
        _ => "change of the velocity from one time base to the next",
    });
    let acceleration = data.signed([9, 12], "encoder.acceleration", |_| change.into());
    let mut words = Vec::new();
    words.extend(position.map(|position| format!("position {position}")));
    words.extend(velocity.map(|velocity| format!("velocity {velocity} {unit}").trim_end().to_owned()));
    words.extend(acceleration.map(|acceleration| format!("acceleration {acceleration}")));
    words.join(", ")
}

/// Whether the only block of a diagnosis can be an encoder's: header 10 in 16 octets or 51 in 57.
pub(crate) fn diagnosis_fits(data: &Data<'_>, blocks: &[Block]) -> bool {
    let lengths = [usize::from(SHORT_BLOCK), usize::from(LONG_BLOCK)];
    matches!(blocks, [Block { octets: [7, last], kind: 0 }] if lengths.contains(&(last - 6)))
        && data.octet(10).is_some_and(|kind| kind <= 8)
}

/// Octets 7 to 16 or 57: alarms and warnings first. Which variant it is, if it can be one of this device.
pub(crate) fn diagnosis(data: &mut Data<'_>) -> Option<(String, Option<Variant>)> {
    let diagnostics = Diagnostics::parse(data.octets.get(6..)?)?;
    let long = diagnostics.class_2_part.as_ref();
    let alarms = words_of_alarms(diagnostics.alarms);
    data.number([8, 8], "encoder.alarms", |_| alarms.clone().into());
    let warnings = long.map(|part| words_of_warnings(part.warnings));
    if let Some(warnings) = warnings.clone() {
        data.number([20, 21], "encoder.warnings", |_| warnings.into());
    }
    data.number([7, 7], "encoder.header", |octets| format!("{octets} octets in this block").into());
    data.bit(9, 0, "encoder.code_sequence", ["increasing clockwise", "increasing counter-clockwise"]);
    data.bit(9, 1, "encoder.class_2", ["", "class 2 functionality"]);
    data.bit(9, 2, "encoder.commissioning_diagnostics", ["", "on"]);
    data.bit(9, 3, "encoder.scaling", ["off", "on"]);
    data.number([10, 10], "encoder.type", |kind| encoder_type(kind).into());
    data.number([11, 14], "encoder.singleturn_resolution", |_| "steps per revolution".into());
    data.number([15, 16], "encoder.revolutions", |_| "revolutions told apart".into());
    if let Some(part) = long {
        long_form(data, part);
    }
    let mut words = alarms;
    if let Some(warnings) = warnings {
        words = format!("{words}; {warnings}");
    }
    Some((words, variant(&diagnostics)))
}

/// Octets 17 to 57 but for the warnings.
fn long_form(data: &mut Data<'_>, part: &Class2Part) {
    data.number([17, 17], "encoder.additional_alarms", |_| "".into());
    data.number([18, 19], "encoder.supported_alarms", |bits| {
        let bits = u8::try_from(bits).unwrap_or(u8::MAX);
        words_of_alarms(Alarms::from_bits_retain(bits)).into()
    });
    data.number([22, 23], "encoder.supported_warnings", |_| {
        words_of_warnings(part.supported_warnings).into()
    });
    let version = |[major, minor]: [u8; 2]| format!("{major}.{minor}").into();
    data.number([24, 25], "encoder.profile_version", |_| version(part.profile_version));
    data.number([26, 27], "encoder.software_version", |_| version(part.software_version));
    data.number([28, 31], "encoder.operating_time", |tenths| match tenths {
        u32::MAX => "not counted".into(),
        tenths => format!("{}.{} h", tenths / 10, tenths % 10).into(),
    });
    data.signed([32, 35], "encoder.offset", |_| "".into());
    data.signed([36, 39], "encoder.manufacturer_offset", |_| "".into());
    data.number([40, 43], "encoder.measuring_units_per_revolution", |_| "in force".into());
    data.number([44, 47], "encoder.total_measuring_range", |_| "in force".into());
    let serial =
        part.serial_number.map(|octet| if octet.is_ascii_graphic() { char::from(octet) } else { ' ' });
    let serial: String = serial.iter().collect();
    data.add([48, 57], None, "encoder.serial_number", Value::Text(serial.trim_end().to_owned()), "".into());
}

fn words_of_alarms(alarms: Alarms) -> String {
    let count = alarms.bits().count_ones();
    told(
        "alarm",
        count,
        [
            (alarms.contains(Alarms::POSITION_ERROR), "position error"),
            (alarms.contains(Alarms::SUPPLY_VOLTAGE), "supply voltage"),
            (alarms.contains(Alarms::CURRENT_TOO_HIGH), "current too high"),
            (alarms.contains(Alarms::COMMISSIONING), "commissioning diagnostics"),
            (alarms.contains(Alarms::MEMORY_ERROR), "memory error"),
            (alarms.bits() & 0xE0 != 0, "others"),
        ],
    )
}

fn words_of_warnings(warnings: Warnings) -> String {
    let count = warnings.bits().count_ones();
    told(
        "warning",
        count,
        [
            (warnings.contains(Warnings::FREQUENCY_EXCEEDED), "frequency exceeded"),
            (warnings.contains(Warnings::TEMPERATURE_EXCEEDED), "temperature exceeded"),
            (warnings.contains(Warnings::LIGHT_CONTROL_RESERVE), "light control reserve used up"),
            (warnings.contains(Warnings::CPU_WATCHDOG), "CPU watchdog"),
            (warnings.contains(Warnings::OPERATING_TIME_LIMIT), "operating time limit exceeded"),
            (warnings.contains(Warnings::BATTERY_CHARGE), "battery low"),
            (warnings.contains(Warnings::REFERENCE_POINT), "reference point not reached"),
            (warnings.bits() & 0xFF80 != 0, "others"),
        ],
    )
}

fn told<const N: usize>(what: &str, count: u32, bits: [(bool, &str); N]) -> String {
    let set: Vec<_> = bits.into_iter().filter(|(set, _)| *set).map(|(_, words)| words).collect();
    match count {
        0 => format!("no {what}"),
        1 => format!("{what}: {}", set.join(", ")),
        _ => format!("{what}s: {}", set.join(", ")),
    }
}

pub(crate) fn encoder_type(kind: u32) -> &'static str {
    match kind {
        0 => "singleturn absolute",
        1 => "multiturn absolute",
        2 => "singleturn absolute with electronic turn count",
        3 => "incremental",
        4 => "incremental with battery",
        5 | 6 => "linear incremental",
        7 | 8 => "linear absolute",
        _ => "unknown",
    }
}

/// The variant by its resolution, if it is one that this device exists in.
pub(crate) fn variant(diagnostics: &Diagnostics) -> Option<Variant> {
    let bits =
        |number: u32| number.is_power_of_two().then(|| u8::try_from(number.trailing_zeros()).ok()).flatten();
    let singleturn = bits(diagnostics.singleturn_resolution)?;
    Variant::new(singleturn, bits(u32::from(diagnostics.revolutions))?).ok()
}
