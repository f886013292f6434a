//! Telegrams that come, read without mercy and without help of the product.

use std::fmt::Write as _;

/// A whole reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Reply {
    /// E5
    Ack,
    /// DC DA SA
    Token,
    /// SD1, SD2, SD3
    Data { da: u8, sa: u8, fc: u8, dsap: Option<u8>, ssap: Option<u8>, data: Vec<u8> },
}

impl Reply {
    /// Octets that are one telegram and nothing else.
    pub(crate) fn parse(octets: &[u8]) -> Result<Self, String> {
        let length =
            length(octets).ok_or("the reply is no telegram: its start delimiter or length is wrong")?;
        if octets.len() < length {
            return Err(format!("the reply breaks off: {} octets of {length}", octets.len()));
        }
        if octets.len() > length {
            return Err(format!("{} octets follow the reply", octets.len() - length));
        }
        let body = match octets[0] {
            0xE5 => return Ok(Self::Ack),
            0xDC => return Ok(Self::Token),
            0x68 => &octets[4..length - 2],
            _ => &octets[1..length - 2],
        };
        let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
        if octets[length - 2] != sum {
            return Err(format!("the check sum is {:02X}, but {sum:02X} is right", octets[length - 2]));
        }
        if octets[length - 1] != 0x16 {
            return Err(format!("the end delimiter is {:02X}, not 16", octets[length - 1]));
        }
        let mut pdu = body.get(3..).unwrap_or_default();
        let mut extension = |address: u8| -> Result<Option<u8>, String> {
            if address & 0x80 == 0 {
                return Ok(None);
            }
            let (sap, rest) = pdu.split_first().ok_or("an extension octet is missing")?;
            pdu = rest;
            Ok(Some(*sap))
        };
        let (dsap, ssap) = (extension(body[0])?, extension(body[1])?);
        let (da, sa, fc) = (body[0] & 0x7F, body[1] & 0x7F, body[2]);
        Ok(Self::Data { da, sa, fc, dsap, ssap, data: pdu.to_vec() })
    }
}

/// How long the telegram will be that these octets begin; `None`: none begins.
pub(crate) fn length(octets: &[u8]) -> Option<usize> {
    match *octets {
        [0xE5, ..] => Some(1),
        [0xDC, ..] => Some(3),
        [0x10, ..] => Some(6),
        [0xA2, ..] => Some(14),
        [0x68, le, repeat, start, ..] => {
            (le == repeat && start == 0x68 && (4..=249).contains(&le)).then(|| usize::from(le) + 6)
        }
        [0x68, ..] => Some(4.max(octets.len() + 1)),
        _ => None,
    }
}

/// Octets as two hex digits each.
pub(crate) fn hex(octets: &[u8]) -> String {
    let mut text = String::with_capacity(octets.len() * 3);
    for octet in octets {
        let _ = write!(text, "{}{octet:02X}", if text.is_empty() { "" } else { " " });
    }
    text
}
