//! Octets 7 to 57 of an encoder (manual 4.2).

use sch108bex::diagnostics::{Class2Part, Diagnostics};
use sch108bex::specification::ENCODER_TYPE;

use super::{Finding, Level};

/// Octet 8, bit by bit: name, meaning, what to do (manual 4.2.2).
const ALARMS: [[&str; 3]; 8] = [
    [
        "Position Error",
        "the position is wrong, or may be",
        "stop the axis; switch the encoder off and on: the alarm goes, and turn count and preset may go with it, so \
         compare with the machine and preset again; if it comes back, the battery or the sensor is at its end and the encoder goes to the factory",
    ],
    [
        "Supply Voltage Error",
        "the supply is outside 9 to 30 V",
        "measure between VSUP and GND at the end cap while the machine runs: cable too long or too thin, supply overloaded, terminal \
         loose; the alarm goes by itself once the voltage is back",
    ],
    ["Current Too High", "the device draws too much current; an SCH108BEX never sends this", NOT_THIS_DEVICE],
    [
        "Commissioning Diagnostics",
        "the device's check at commissioning has failed; an SCH108BEX never sends this",
        NOT_THIS_DEVICE,
    ],
    [
        "Memory Error",
        "the device's memory is no longer reliable; an SCH108BEX never sends this",
        NOT_THIS_DEVICE,
    ],
    UNKNOWN_ALARM,
    UNKNOWN_ALARM,
    UNKNOWN_ALARM,
];

const NOT_THIS_DEVICE: &str = "look into the manual of the device that answers";

const UNKNOWN_ALARM: [&str; 3] =
    ["Not Assigned Alarm", "the profile assigns no meaning to this alarm", NOT_THIS_DEVICE];

/// Octets 20-21, bit by bit from the lowest (manual 4.2.9).
const WARNINGS: [[&str; 3]; 7] = [
    [
        "Frequency Exceeded",
        "the shaft turns faster than the device can follow; an SCH108BEX never sends this",
        NOT_THIS_DEVICE,
    ],
    [
        "Temperature Exceeded",
        "it is above 65 degrees C inside; the position is still right",
        "look for heat from brake or gear, bearings that run dry, missing shade; the warning goes with the heat, but heat wears battery and LED",
    ],
    [
        "Light Control Reserve",
        "the LED has lost light and its reserve is used up; the position is still right",
        "plan an exchange: the LED is replaced at the factory",
    ],
    [
        "CPU Watchdog",
        "the device's processor was restarted by its watchdog; an SCH108BEX never sends this",
        NOT_THIS_DEVICE,
    ],
    [
        "Operating Time Limit",
        "the device has been powered for more than 87600 hours (10 years)",
        "plan a service at the factory; this warning does not go any more",
    ],
    [
        "Battery Charge",
        "the battery is below its limit; it keeps the turn count while the power is off",
        "have it replaced at the factory soon, leave the supply on until then, and write down position and offset: once it \
         is empty, a power-off loses them",
    ],
    ["Reference Point", "the reference point is not reached; an SCH108BEX never sends this", NOT_THIS_DEVICE],
];

const UNKNOWN_WARNING: [&str; 3] =
    ["Not Assigned Warning", "the profile assigns no meaning to this warning", NOT_THIS_DEVICE];

/// What to do about the alarm of this bit.
pub(super) fn alarm_advice(bit: u8) -> Option<&'static str> {
    ALARMS.get(usize::from(bit)).map(|[_, _, advice]| *advice)
}

/// What to do about the warning of this bit.
pub(super) fn warning_advice(bit: u8) -> Option<&'static str> {
    WARNINGS.get(usize::from(bit)).map(|[_, _, advice]| *advice)
}

/// What the encoder's octets tell.
pub(super) fn findings(octets: &[u8]) -> Vec<Finding> {
    let Some(diagnostics) = octets.get(6..).and_then(Diagnostics::parse) else { return Vec::new() };
    let alarm = |bit: u8| {
        (diagnostics.alarms.bits() >> bit & 1 == 1)
            .then(|| Finding::new([8, 8], Some(bit), Level::Alarm, ALARMS[usize::from(bit)]))
    };
    let mut findings: Vec<_> = (0..8).filter_map(alarm).collect();
    findings.extend(operating_status(octets, &diagnostics));
    findings.extend(kind(&diagnostics));
    match &diagnostics.class_2_part {
        Some(part) => long_form(&mut findings, &diagnostics, part),
        None => findings.push(short_form(octets)),
    }
    findings
}

/// Octet 9: bit, whether it is told when it is 1 or when it is 0, level; name, meaning, what to do (manual 4.2.3).
const OPERATING_STATUS: &[(u8, bool, Level, [&str; 3])] = &[
    (
        0,
        true,
        Level::Note,
        [
            "Code Sequence",
            "the position rises when the shaft turns counter-clockwise, seen from the shaft side",
            "",
        ],
    ),
    (
        1,
        false,
        Level::Note,
        ["Class 2 Functionality", "off, though the long diagnosis is sent", NOT_THIS_DEVICE],
    ),
    (2, true, Level::Note, ["Commissioning Diagnostics", "on; an SCH108BEX has none", NOT_THIS_DEVICE]),
    (
        3,
        false,
        Level::Note,
        [
            "Scaling Function Status",
            "scaling is off: positions are physical steps, whatever units and range are set",
            "set bit 3 of octet 9 in Set_Prm if the machine counts in units of its own",
        ],
    ),
];

/// What octet 9 tells; outside data exchange, and in class 1, it is no news that bits are 0.
fn operating_status(octets: &[u8], diagnostics: &Diagnostics) -> Vec<Finding> {
    let Some(status) = octets.get(8) else { return Vec::new() };
    OPERATING_STATUS
        .iter()
        .filter(|(bit, when, ..)| (status >> bit & 1 == 1) == *when)
        .filter(|(_, when, ..)| *when || diagnostics.class_2_part.is_some())
        .map(|(bit, _, level, words)| Finding::new([9, 9], Some(*bit), *level, *words))
        .collect()
}

/// What device answers.
fn kind(diagnostics: &Diagnostics) -> Option<Finding> {
    let words =
        ["Encoder Type", "", "the advice here is for an SCH108BEX; compare with that device's manual"];
    (diagnostics.encoder_type != ENCODER_TYPE).then(|| {
        let mut finding = Finding::new([10, 10], None, Level::Note, words);
        let kind = crate::encoder::encoder_type(u32::from(diagnostics.encoder_type));
        finding.text = format!(
            "type {} ({kind}) is another kind of encoder than an SCH108BEX",
            diagnostics.encoder_type
        )
        .into();
        finding
    })
}

/// The 16 octets: warnings, offset and scaling are not in them.
fn short_form(octets: &[u8]) -> Finding {
    let in_exchange = octets.first().is_some_and(|octet| octet & 0x02 == 0)
        && octets.get(1).is_some_and(|octet| octet & 0x01 == 0);
    let words = if in_exchange {
        [
            "Header",
            "class 1: no scaling and no preset, and warnings, offset and scaling are not told",
            "choose the class 2 or the Scancon 2.0 module in the master's project to have them",
        ]
    } else {
        [
            "Header",
            "16 octets: outside data exchange warnings, offset and scaling are not told",
            "look again while a master exchanges data with it as class 2 or Scancon 2.0",
        ]
    };
    Finding::new([7, 7], None, Level::Note, words)
}

fn long_form(findings: &mut Vec<Finding>, diagnostics: &Diagnostics, part: &Class2Part) {
    if part.additional_alarms != 0 {
        let words = ["Additional Alarms", "the device raises alarms of its own", NOT_THIS_DEVICE];
        findings.push(Finding::new([17, 17], None, Level::Alarm, words));
    }
    let warning = |bit: u8| {
        let words = WARNINGS.get(usize::from(bit)).copied().unwrap_or(UNKNOWN_WARNING);
        (part.warnings.bits() >> bit & 1 == 1)
            .then(|| Finding::new([20, 21], Some(bit), Level::Warning, words))
    };
    findings.extend((0..16).filter_map(warning));
    if part.operating_time.0 == u32::MAX {
        let words = ["Operating Time", "the device does not count its operating time", ""];
        findings.push(Finding::new([28, 31], None, Level::Note, words));
    }
    findings.extend(offset(part));
    if part.manufacturer_offset != 0 {
        let mut finding =
            Finding::new([36, 39], None, Level::Note, ["Manufacturer Offset Value", "", NOT_THIS_DEVICE]);
        finding.text =
            format!("the maker adds {:+} physical steps; in an SCH108BEX it is 0", part.manufacturer_offset)
                .into();
        findings.push(finding);
    }
    findings.extend(scaling(diagnostics, part));
}

/// What a preset has left behind.
fn offset(part: &Class2Part) -> Option<Finding> {
    if part.offset == 0 {
        return None;
    }
    let mut finding = Finding::new([32, 35], None, Level::Note, ["Offset Value", "", ""]);
    if part.offset.unsigned_abs() < part.total_measuring_range {
        finding.text = format!("a preset is in force: {:+} is added to the position", part.offset).into();
    } else {
        finding.level = Level::Warning;
        finding.text = format!(
            "the offset {:+} is longer than the measuring range of {}: it was made under another scaling",
            part.offset, part.total_measuring_range
        )
        .into();
        finding.advice = "compare the position with the machine, and preset again".into();
    }
    Some(finding)
}

/// Whether the position keeps its meaning where the turn count begins again.
fn scaling(diagnostics: &Diagnostics, part: &Class2Part) -> Option<Finding> {
    let (units, range) = (part.measuring_units_per_revolution, part.total_measuring_range);
    let turns = u32::from(diagnostics.revolutions);
    let in_all = u64::from(turns) * u64::from(units);
    let jump = in_all.checked_rem(u64::from(range))?;
    if !diagnostics.scaling || jump == 0 || in_all < u64::from(range) {
        return None;
    }
    let mut finding = Finding::new([40, 47], None, Level::Warning, ["Scaling", "", ""]);
    finding.text = format!(
        "{units} units a turn and a range of {range}: the position jumps by {jump} units where the {turns} turns \
         of the encoder begin again"
    )
    .into();
    finding.advice = format!(
        "no matter if the machine never comes there; else take a range that divides {in_all} ({turns} turns of {units} units)"
    )
    .into();
    Some(finding)
}
