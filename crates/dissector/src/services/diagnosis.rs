//! Slave_Diag: the standard's octets, and the blocks behind them.

use profibus_dp::wire::slave_diag::{STANDARD_OCTETS, StandardDiagnosis};

use crate::field::{Data, Value};

/// A block of the extended diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Block {
    /// First and last octet, from 1 over the whole diagnosis.
    pub(crate) octets: [usize; 2],
    /// Bits 7 and 6 of its header: 0 device, 1 identifiers, 2 channel, 3 revision.
    pub(crate) kind: u8,
}

/// Octets 1 to 6 as fields; the words, what is wrong, and the blocks that follow.
pub(crate) fn standard(data: &mut Data<'_>) -> (String, Option<(usize, String)>, Vec<Block>) {
    for (octet, bit, name, words) in BITS {
        data.bit(*octet, *bit, name, *words);
    }
    data.number([4, 4], "Master_Add", |master| match master {
        255 => "no owner".into(),
        master => format!("owned by master {master}").into(),
    });
    data.number([5, 6], "Ident_Number", |ident| format!("{ident:04X}h").into());
    let Some(standard) = StandardDiagnosis::parse(data.octets) else {
        let wrong =
            format!("{} octets of data, but a diagnosis has at least {STANDARD_OCTETS}", data.octets.len());
        return ("too short".to_owned(), Some((data.place(data.octets.len()), wrong)), Vec::new());
    };
    let fixed = data.octet(2).is_some_and(|octet| octet & 0x04 != 0);
    let mut wrong =
        (!fixed).then(|| (data.place(2), "bit 2 is 0, but a DP slave always sends it as 1".to_owned()));
    let (blocks, bad_block) = blocks(data);
    wrong = wrong.or(bad_block);
    (in_words(&standard), wrong, blocks)
}

/// Octet, bit, name, words for 0 and 1.
const BITS: &[(usize, u8, &str, [&str; 2])] = &[
    (1, 7, "Master_Lock", ["", "owned by another master (set by a master)"]),
    (1, 6, "Prm_Fault", ["", "the last parameters were refused"]),
    (1, 5, "Invalid_Slave_Response", ["", "the slave's answer was no good (set by a master)"]),
    (1, 4, "Not_Supported", ["", "a function was asked for that the slave has not"]),
    (1, 3, "Ext_Diag", ["", "the device reports a fault"]),
    (1, 2, "Cfg_Fault", ["", "the last configuration did not fit"]),
    (1, 1, "Station_Not_Ready", ["", "not ready for data exchange"]),
    (1, 0, "Station_Non_Existent", ["", "no answer (set by a master)"]),
    (2, 7, "Deactivated", ["", "taken out of exchange (set by a master)"]),
    (2, 5, "Sync_Mode", ["", "Sync in force"]),
    (2, 4, "Freeze_Mode", ["", "Freeze in force"]),
    (2, 3, "WD_On", ["", "the watchdog runs"]),
    (2, 1, "Stat_Diag", ["", "no valid data; the master shall keep fetching the diagnosis"]),
    (2, 0, "Prm_Req", ["", "parameters are needed"]),
    (3, 7, "Ext_Diag_Overflow", ["", "more diagnosis than fits"]),
];

fn in_words(standard: &StandardDiagnosis) -> String {
    let mut words = Vec::new();
    words.push(match (standard.prm_req, standard.station_not_ready) {
        (true, _) => "waits for parameters",
        (false, true) => "waits for the configuration",
        (false, false) => "in data exchange",
    });
    for (set, word) in [
        (standard.prm_fault, "parameters refused"),
        (standard.cfg_fault, "configuration refused"),
        (standard.not_supported, "function not supported"),
        (standard.ext_diag, "device fault reported"),
        (standard.stat_diag, "no valid data"),
        (standard.watchdog_on, "watchdog on"),
        (standard.freeze_mode, "Freeze"),
        (standard.sync_mode, "Sync"),
        (standard.ext_diag_overflow, "more diagnosis than fits"),
    ] {
        if set {
            words.push(word);
        }
    }
    let owner = standard.master_add.map_or_else(|| "no owner".to_owned(), |master| format!("owner {master}"));
    format!("{}, {owner}, ident {:04X}h", words.join(", "), standard.ident_number)
}

/// The blocks from octet 7 on; the first that cannot be.
fn blocks(data: &mut Data<'_>) -> (Vec<Block>, Option<(usize, String)>) {
    let mut blocks = Vec::new();
    let mut at = STANDARD_OCTETS + 1;
    while let Some(header) = data.octet(at) {
        let kind = header >> 6;
        let length = match kind {
            2 => 3,
            3 => 1,
            _ => usize::from(header & 0x3F),
        };
        let left = data.octets.len() + 1 - at;
        if length == 0 || length > left {
            let wrong = format!("the block says {length} octets, but {left} are left");
            data.raw([at, usize::MAX], "rest", "");
            return (blocks, Some((data.place(at), wrong)));
        }
        let block = Block { octets: [at, at + length - 1], kind };
        tell(data, block);
        blocks.push(block);
        at += length;
    }
    (blocks, None)
}

fn tell(data: &mut Data<'_>, Block { octets, kind }: Block) {
    let [first, last] = octets;
    match kind {
        0 => data.raw(octets, "Device_Block", format!("device related, {} octets", last + 1 - first)),
        1 => {
            let words = format!("diagnosis of {}", modules(data.octets, octets));
            data.raw(octets, "Identifier_Block", words);
        }
        2 => {
            let octet = |number| data.octet(number).unwrap_or(0);
            let words = channel([octet(first), octet(first + 1), octet(first + 2)]);
            data.raw(octets, "Channel_Block", words);
        }
        _ => {
            let value = Value::Number(i64::from(data.octet(first).unwrap_or(0) & 0x3F));
            data.add(octets, Some([5, 0]), "Diag_Revision", value, "".into());
        }
    }
}

/// The modules that a block of identifier related diagnosis names.
pub(crate) fn modules(octets: &[u8], [first, last]: [usize; 2]) -> String {
    let octet = |number| profibus_dp::wire::octet(octets, number);
    let faulty: Vec<_> = (first + 1..=last)
        .flat_map(|octet| (0..8).map(move |bit| (octet, bit)))
        .filter(|&(number, bit)| octet(number).is_some_and(|value| value >> bit & 1 == 1))
        .map(|(octet, bit)| ((octet - first - 1) * 8 + bit).to_string())
        .collect();
    if faulty.is_empty() { "no module".to_owned() } else { format!("module {}", faulty.join(", ")) }
}

/// What a block of channel related diagnosis says.
pub(crate) fn channel([identifier, number, kind]: [u8; 3]) -> String {
    let direction = ["", "input ", "output ", "input/output "][usize::from(number >> 6)];
    let width = ["", "1 bit", "2 bits", "4 bits", "octet", "word", "2 words", ""][usize::from(kind >> 5)];
    let error = match kind & 0x1F {
        1 => "short circuit",
        2 => "undervoltage",
        3 => "overvoltage",
        4 => "overload",
        5 => "overtemperature",
        6 => "line break",
        7 => "upper limit exceeded",
        8 => "lower limit exceeded",
        9 => "error",
        16.. => "the maker's error",
        _ => "reserved",
    };
    format!(
        "module {}, {direction}channel {} ({width}): {error} ({})",
        identifier & 0x3F,
        number & 0x3F,
        kind & 0x1F
    )
}
