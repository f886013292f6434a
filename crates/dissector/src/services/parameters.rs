//! Set_Prm: the standard part, octets 1 to 8.

use profibus_dp::wire::set_prm::{STANDARD_OCTETS, SetPrm};

use super::groups;
use crate::field::Data;

/// The standard's octets as fields. Octet 8 is the slave ASIC's, or DP-V1's.
pub(crate) fn standard(data: &mut Data<'_>) -> (String, Option<(usize, String)>) {
    for (bit, name, words) in [
        (7, "Lock_Req", ["", "the slave shall be locked for other masters"]),
        (6, "Unlock_Req", ["", "the slave shall be free for other masters"]),
        (5, "Sync_Req", ["", "Sync will be used"]),
        (4, "Freeze_Req", ["", "Freeze will be used"]),
        (3, "WD_On", ["the watchdog is off", "the watchdog shall run"]),
    ] {
        data.bit(1, bit, name, words);
    }
    let watchdog = SetPrm::parse(data.octets).and_then(|parsed| parsed.watchdog());
    let span = watchdog.map(|span| format!("{} ms", span.as_nanos() / 1_000_000));
    data.number([2, 2], "WD_Fact_1", |_| "".into());
    data.number([3, 3], "WD_Fact_2", |_| {
        span.as_ref().map_or_else(|| "".into(), |span| format!("watchdog of {span}").into())
    });
    data.number([4, 4], "min_Tsdr", |bits| {
        if bits == 0 { "as before".into() } else { format!("{bits} bit times").into() }
    });
    data.number([5, 6], "Ident_Number", |ident| format!("{ident:04X}h").into());
    data.number([7, 7], "Group_Ident", |octet| groups(octet, "no group").into());
    for (bit, name, words) in [
        (7, "DPV1_Enable", ["", "DP-V1"]),
        (6, "Fail_Safe", ["", "the master sends empty outputs in Clear"]),
        (5, "Publisher_Enable", ["", "DP-V2: others listen"]),
        (2, "WD_Base", ["watchdog factors of 10 ms", "watchdog factors of 1 ms"]),
        (1, "Dis_Stop_Control", ["", "stop bits unchecked"]),
        (0, "Dis_Start_Control", ["", "start bits unchecked"]),
    ] {
        data.bit(8, bit, name, words);
    }
    let Some(parsed) = SetPrm::parse(data.octets) else {
        let wrong =
            format!("{} octets of data, but Set_Prm has at least {STANDARD_OCTETS}", data.octets.len());
        return ("too short".to_owned(), Some((data.place(data.octets.len()), wrong)));
    };
    let mut words = Vec::new();
    words.push(match (parsed.status.lock_req(), parsed.status.unlock_req()) {
        (_, true) => "unlock".to_owned(),
        (true, false) => "lock".to_owned(),
        (false, false) => "min T_SDR only".to_owned(),
    });
    match span {
        Some(span) => words.push(format!("watchdog {span}")),
        None if parsed.status.lock_req() => words.push("no watchdog".to_owned()),
        None => {}
    }
    words.push(format!("ident {:04X}h", parsed.ident_number));
    words.push(format!("{} octets", data.octets.len()));
    (words.join(", "), fault(&parsed, data))
}

/// What any DP slave refuses. Where it is not to be locked, it looks at none of this.
fn fault(parsed: &SetPrm<'_>, data: &Data<'_>) -> Option<(usize, String)> {
    if !parsed.status.lock_req() || parsed.status.unlock_req() {
        return None;
    }
    let reserved = parsed.status.reserved();
    if reserved != 0 {
        return Some((data.place(1), "bits 2 to 0 of Station_Status are reserved and must be 0".to_owned()));
    }
    let no_time = parsed.status.watchdog_on() && parsed.watchdog().is_none();
    no_time.then(|| (data.place(2), "the watchdog shall run, but a factor is 0".to_owned()))
}
