//! Octets: the stations of these tests, and how a request is put on the wire.

pub(crate) const SELF: u8 = 11;
pub(crate) const OWNER: u8 = 2;
pub(crate) const OTHER: u8 = 3;
pub(crate) const ONLOOKER: u8 = 9;
pub(crate) const CFG: [u8; 2] = [0x11, 0x20];
/// Values of octet 9 that the test device refuses, and that no longer fit what it has agreed on.
pub(crate) const BAD: u8 = 0xBB;
pub(crate) const OUTGROWN: u8 = 0xCC;

/// Set_Prm of master 2 without watchdog, group 1.
pub(crate) const PRM: [u8; 9] = [0x80, 0, 0, 0, 0x12, 0x34, 0x01, 0, 0];

#[derive(Debug, Clone)]
pub(crate) enum Sent {
    /// No data unit, this function code.
    Bare(u8),
    /// LSAP status of a SAP.
    Lsap(u8),
    /// SRD to a SAP (from SAP 62), or without.
    Srd(Option<u8>, Vec<u8>),
    /// Data_Exchange with eight octets as SD3.
    Sd3([u8; 8]),
    /// SDA with this function code.
    Sda(u8, Option<u8>, Vec<u8>),
    /// SDN with this function code to this station.
    Sdn(u8, u8, Option<u8>, Vec<u8>),
}

impl Sent {
    /// The function codes to send it with: all forms of SRD, or the one that it has.
    pub(crate) fn function_codes(&self) -> Vec<u8> {
        match *self {
            Self::Bare(fc) | Self::Sda(fc, ..) | Self::Sdn(fc, ..) => vec![fc],
            Self::Lsap(_) => vec![0x4F],
            Self::Srd(..) | Self::Sd3(_) => vec![0x6C, 0x6D, 0x4C, 0x4D],
        }
    }

    pub(crate) fn wire(&self, da: u8, sa: u8, fc: u8) -> Vec<u8> {
        match self {
            Self::Bare(_) => telegram(da, sa, fc, None, &[]),
            Self::Lsap(sap) => sd2(&[da | 0x80, sa, fc, *sap]),
            Self::Srd(sap, data) | Self::Sda(_, sap, data) => telegram(da, sa, fc, *sap, data),
            Self::Sdn(_, to, sap, data) => {
                let to = if *to == SELF { da } else { *to };
                telegram(to, sa, fc, *sap, data)
            }
            Self::Sd3(data) => {
                let body = [&[da, sa, fc], &data[..]].concat();
                [&[0xA2], &body[..], &[sum(&body), 0x16]].concat()
            }
        }
    }
}

pub(crate) fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum, &octet| sum.wrapping_add(octet))
}

pub(crate) fn sd2(body: &[u8]) -> Vec<u8> {
    let le = u8::try_from(body.len()).expect("a telegram of this test has 249 octets at most");
    [&[0x68, le, le, 0x68], body, &[sum(body), 0x16]].concat()
}

/// A request, from SAP 62 if it is for one.
pub(crate) fn telegram(da: u8, sa: u8, fc: u8, sap: Option<u8>, data: &[u8]) -> Vec<u8> {
    match sap {
        Some(sap) => sd2(&[&[da | 0x80, sa | 0x80, fc, sap, 0x3E], data].concat()),
        None if data.is_empty() => [0x10, da, sa, fc, sum(&[da, sa, fc]), 0x16].to_vec(),
        None => sd2(&[&[da, sa, fc], data].concat()),
    }
}

pub(crate) fn hex(octets: &[u8]) -> String {
    let octets: Vec<_> = octets.iter().map(|octet| format!("{octet:02X}")).collect();
    octets.join(" ")
}
