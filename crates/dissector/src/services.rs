//! The data of each service as fields, and a few words for the summary.

mod configuration;
mod diagnosis;
mod parameters;

use profibus_dp::wire::global_control::{GlobalControl, ModeCommand};
use profibus_dp::wire::set_slave_add::SetSlaveAdd;

pub(crate) use configuration::{identifiers, lengths_in_words};
pub(crate) use diagnosis::{Block, channel, modules, standard as standard_diagnosis};
pub(crate) use parameters::standard as standard_parameters;

use crate::field::Data;

/// Group_Ident or Group_Select in words.
fn groups(octet: u32, none: &str) -> String {
    let numbers: Vec<_> =
        (0..8).filter(|bit| octet >> bit & 1 == 1).map(|bit| (bit + 1).to_string()).collect();
    if numbers.is_empty() { none.to_owned() } else { format!("group {}", numbers.join(", ")) }
}

/// Global_Control: what is commanded, and what is wrong with it.
pub(crate) fn global_control(data: &mut Data<'_>) -> (String, Option<(usize, String)>) {
    for (bit, name, words) in [
        (1, "Clear_Data", ["", "outputs to 0"]),
        (2, "Unfreeze", ["", "end of Freeze"]),
        (3, "Freeze", ["", "inputs are kept as they are"]),
        (4, "Unsync", ["", "end of Sync"]),
        (5, "Sync", ["", "outputs are kept as they are"]),
    ] {
        data.bit(1, bit, name, words);
    }
    data.number([2, 2], "Group_Select", |octet| groups(octet, "all slaves").into());
    data.raw([3, usize::MAX], "rest", "");
    let Some(control) = GlobalControl::parse(data.octets) else {
        let wrong = if data.octets.len() == 2 {
            (data.place(1), "bits 0, 6 and 7 of the command are reserved and must be 0".to_owned())
        } else {
            (
                data.place(data.octets.len()),
                format!("{} octets of data, but Global_Control has 2", data.octets.len()),
            )
        };
        return ("not valid".to_owned(), Some(wrong));
    };
    let mut commands = Vec::new();
    for (mode, [on, off]) in [(control.sync, ["Sync", "Unsync"]), (control.freeze, ["Freeze", "Unfreeze"])] {
        match mode {
            ModeCommand::Leave => {}
            ModeCommand::Activate => commands.push(on),
            ModeCommand::Deactivate => commands.push(off),
        }
    }
    commands.push(if control.clear_data { "Clear" } else { "Operate" });
    let to = groups(u32::from(control.group_select), "all slaves");
    (format!("{} for {to}", commands.join(", ")), None)
}

/// Set_Slave_Add: from where to where.
pub(crate) fn set_slave_add(data: &mut Data<'_>) -> (String, Option<(usize, String)>) {
    data.number([1, 1], "New_Slave_Add", |_| "".into());
    data.number([2, 3], "Ident_Number", |ident| format!("{ident:04X}h").into());
    data.number([4, 4], "No_Add_Chg", |octet| {
        if octet == 0 { "may be changed again".into() } else { "no further change wanted".into() }
    });
    data.raw([5, usize::MAX], "Rem_Slave_Data", "for the slave to keep");
    match SetSlaveAdd::parse(data.octets) {
        None => {
            let wrong = format!("{} octets of data, but Set_Slave_Add has at least 4", data.octets.len());
            ("too short".to_owned(), Some((data.place(data.octets.len()), wrong)))
        }
        Some(SetSlaveAdd { new_address, ident_number, .. }) => {
            let words = format!("new address {new_address}, for ident {ident_number:04X}h");
            let wrong = (new_address > 125)
                .then(|| (data.place(1), format!("address {new_address}, but 0 to 125 can be given")));
            (words, wrong)
        }
    }
}
