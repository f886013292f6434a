//! Telegrams by hand, good ones.

/// SD1, SD3 or SD2, whichever fits the PDU; at most 246 octets of it are taken.
pub(crate) fn telegram(da: u8, sa: u8, fc: u8, pdu: &[u8]) -> Vec<u8> {
    let pdu = &pdu[..pdu.len().min(246)];
    let sum = pdu.iter().fold(da.wrapping_add(sa).wrapping_add(fc), |sum, octet| sum.wrapping_add(*octet));
    match pdu.len() {
        0 => vec![0x10, da, sa, fc, sum, 0x16],
        8 => [&[0xA2, da, sa, fc], pdu, &[sum, 0x16]].concat(),
        length => {
            let le = u8::try_from(length + 3).expect("246 at most");
            [&[0x68, le, le, 0x68, da, sa, fc], pdu, &[sum, 0x16]].concat()
        }
    }
}

/// A request by SAPs, from 62 of the master.
pub(crate) fn service(da: u8, sa: u8, fc: u8, dsap: u8, data: &[u8]) -> Vec<u8> {
    telegram(da | 0x80, sa | 0x80, fc, &[&[dsap, 62], data].concat())
}
