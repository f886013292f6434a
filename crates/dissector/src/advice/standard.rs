//! Octets 1 to 6, and the blocks of any slave behind them.

use profibus_dp::wire::octet;
use profibus_dp::wire::slave_diag::StandardDiagnosis;
use sch108bex::specification::PLACEHOLDER_IDENT;

use super::{Finding, Level};
use crate::services::{Block, channel};

/// Octet, bit, whether it is told when it is 1 or when it is 0, level; name, meaning, what to do.
type Row = (usize, u8, bool, Level, [&'static str; 3]);

const BITS: &[Row] = &[
    (1, 0, true, Level::Warning, ["Station_Non_Existent", BY_MASTER, WHOSE]),
    (
        1,
        1,
        true,
        Level::Note,
        [
            "Station_Not_Ready",
            "the station cannot exchange data yet",
            "a master has to send it parameters and configuration, and then fetch its diagnosis",
        ],
    ),
    (
        1,
        2,
        true,
        Level::Alarm,
        [
            "Cfg_Fault",
            "the last configuration (Chk_Cfg) was refused: no data is exchanged",
            "compare the identifier octets of the chosen module with those that Get_Cfg brings; an encoder takes D1 (class \
             1), F1 (class 2), F1 D1 D1 or F1 D3 (Scancon 2.0), and its Set_Prm must be as long as that needs: 9, 25 or 26 octets",
        ],
    ),
    (
        1,
        3,
        true,
        Level::Note,
        ["Ext_Diag", "the device reports a fault of its own", "see its alarms and warnings from octet 7 on"],
    ),
    (
        1,
        4,
        true,
        Level::Warning,
        [
            "Not_Supported",
            "a function was asked for that the station has not",
            "switch Sync, Freeze or DP-V1 off in the master for this station",
        ],
    ),
    (1, 5, true, Level::Warning, ["Invalid_Slave_Response", BY_MASTER, WHOSE]),
    (
        1,
        6,
        true,
        Level::Alarm,
        [
            "Prm_Fault",
            "the last parameters (Set_Prm) were refused: no data is exchanged",
            "compare octet by octet: octets 5-6 must be the ident number below, octet 8 is 0, reserved octets are 0, \
             and scaling values stay within 1 and the device's resolution",
        ],
    ),
    (1, 7, true, Level::Warning, ["Master_Lock", BY_MASTER, WHOSE]),
    (
        2,
        0,
        true,
        Level::Note,
        [
            "Prm_Req",
            "the station waits for parameters",
            "start a master that has this station in its project; if one runs, compare address and ident number there",
        ],
    ),
    (
        2,
        1,
        true,
        Level::Alarm,
        [
            "Stat_Diag",
            "the station says that its inputs are not valid; masters take it out of their process image",
            "deal with the alarm of the device; this bit goes with it",
        ],
    ),
    (
        2,
        2,
        false,
        Level::Warning,
        [
            "Always_1",
            "bit 2 is 0, but every DP slave sends it as 1",
            "the answer may come from something else than a DP slave, or be damaged; look at the line",
        ],
    ),
    (
        2,
        4,
        true,
        Level::Note,
        ["Freeze_Mode", "inputs stand still until the master sends Freeze again or Unfreeze", ""],
    ),
    (
        2,
        5,
        true,
        Level::Note,
        ["Sync_Mode", "outputs, and so a preset, wait until the master sends Sync again or Unsync", ""],
    ),
    (2, 7, true, Level::Warning, ["Deactivated", BY_MASTER, WHOSE]),
    (
        3,
        7,
        true,
        Level::Warning,
        [
            "Ext_Diag_Overflow",
            "the device has more to tell than fits in a diagnosis",
            "deal with what is told; the rest shows then",
        ],
    ),
];

const BY_MASTER: &str = "only masters set this bit, in what they tell their controller; a slave sends 0";
const WHOSE: &str = "the octets are a master's copy, or another device's; ask the station itself";

/// What the standard's octets tell; `None` where there are fewer than six.
pub(super) fn findings(octets: &[u8]) -> Option<Vec<Finding>> {
    let standard = StandardDiagnosis::parse(octets)?;
    let is = |place: usize, bit: u8| octet(octets, place).is_some_and(|octet| octet >> bit & 1 == 1);
    let mut findings: Vec<_> = BITS
        .iter()
        .filter(|(place, bit, when, ..)| is(*place, *bit) == *when)
        .map(|(place, bit, _, level, words)| Finding::new([*place; 2], Some(*bit), *level, *words))
        .collect();
    findings.extend(watchdog(&standard));
    findings.extend(owner(&standard));
    findings.push(ident(standard.ident_number));
    findings.sort_by_key(|finding| (finding.octets, finding.bit));
    Some(findings)
}

/// It matters only in data exchange.
fn watchdog(standard: &StandardDiagnosis) -> Option<Finding> {
    let owned = standard.master_add.is_some() && !standard.prm_req && !standard.station_not_ready;
    (owned && !standard.watchdog_on).then(|| {
        Finding::new(
            [2, 2],
            Some(3),
            Level::Warning,
            [
                "WD_On",
                "the watchdog is off: the station keeps its outputs and its owner for ever if the master dies",
                "switch the watchdog on in the master's project",
            ],
        )
    })
}

fn owner(standard: &StandardDiagnosis) -> Option<Finding> {
    let mut finding = Finding::new([4, 4], None, Level::Note, ["Master_Add", "", ""]);
    match standard.master_add {
        Some(owner) if owner > 125 => {
            finding.level = Level::Warning;
            finding.text = format!("owned by master {owner}, but masters are at 0 to 125").into();
            finding.advice = "the octets may be damaged; fetch the diagnosis again".into();
        }
        Some(owner) => {
            finding.text = format!("owned by the master at address {owner}").into();
            finding.advice =
                "only that one can change parameters and outputs; others can read, or wait until it lets go"
                    .into();
        }
        // That it has no owner is news only where it could have one.
        None if standard.prm_req => return None,
        None => finding.text = "no master owns the station".into(),
    }
    Some(finding)
}

fn ident(number: u16) -> Finding {
    let mut finding = Finding::new([5, 6], None, Level::Note, ["Ident_Number", "", ""]);
    finding.text = format!("the ident number is {number:04X}h").into();
    if number == PLACEHOLDER_IDENT {
        finding.text = format!(
            "the ident number is {number:04X}h: a placeholder of this software, not the maker's number"
        )
        .into();
        finding.advice =
            "a project made with the maker's GSD needs its number; give the virtual encoder that file".into();
    }
    finding
}

/// Blocks that are no encoder's.
pub(super) fn of_blocks(octets: &[u8], blocks: &[Block]) -> Vec<Finding> {
    let of = |block: &Block| {
        let [first, last] = block.octets;
        let octet = |number| octet(octets, number).unwrap_or(0);
        let words = match block.kind {
            0 => {
                ["Device_Block", "", "its meaning is in the device's manual and in its GSD file (Unit_Diag)"]
            }
            1 => ["Identifier_Block", "", "look at the module that is named"],
            2 => ["Channel_Block", "", "look at the channel that is named"],
            _ => return None,
        };
        let mut finding = Finding::new(block.octets, None, Level::Note, words);
        match block.kind {
            0 => finding.text = format!("{} octets of the device's own", last - first).into(),
            1 if (first + 1..=last).all(|number| octet(number) == 0) => return None,
            1 => {
                finding.level = Level::Warning;
                finding.text =
                    format!("diagnosis of {}", crate::services::modules(octets, block.octets)).into();
            }
            _ => {
                finding.level = Level::Warning;
                finding.text = channel([octet(first), octet(first + 1), octet(first + 2)]).into();
            }
        }
        Some(finding)
    };
    blocks.iter().filter_map(of).collect()
}
