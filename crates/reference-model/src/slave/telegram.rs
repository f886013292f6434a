//! Telegrams: what a receiver takes for one, and how answers are made.

/// An SD1, SD2 or SD3 without fault; addresses without their extension bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) da: u8,
    pub(super) sa: u8,
    pub(super) fc: u8,
    pub(super) dsap: Option<u8>,
    pub(super) ssap: Option<u8>,
    pub(super) data: Vec<u8>,
}

/// What begins with the first of the octets collected.
pub(super) enum Parsed {
    /// So many octets that are a telegram; `None`: one that nobody answers.
    Whole(usize, Option<Request>),
    More,
    Bad,
}
/// FCS: the sum modulo 256.
pub(super) fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum, octet| sum.wrapping_add(*octet))
}

/// Looks for a telegram at the beginning of the octets.
pub(super) fn parse(octets: &[u8]) -> Parsed {
    let (head, total) = match *octets {
        [0xE5, ..] => return Parsed::Whole(1, None),
        [0xDC, ..] => return if octets.len() < 3 { Parsed::More } else { Parsed::Whole(3, None) },
        [0x10, ..] => (1, 6),
        [0xA2, ..] => (1, 14),
        [0x68, le, ler, start, ..] => {
            if le != ler || start != 0x68 || !(4..=249).contains(&le) {
                return Parsed::Bad;
            }
            (4, usize::from(le) + 6)
        }
        [0x68, ..] => return Parsed::More,
        _ => return Parsed::Bad,
    };
    if octets.len() < total {
        return Parsed::More;
    }
    let body = &octets[head..total - 2];
    if octets[total - 2] != sum(body) || octets[total - 1] != 0x16 {
        return Parsed::Bad;
    }
    let mut saps = body[3..].iter().copied();
    let mut extension = |address: u8| if address & 0x80 != 0 { saps.next().map(Some) } else { Some(None) };
    let (Some(dsap), Some(ssap)) = (extension(body[0]), extension(body[1])) else {
        return Parsed::Bad;
    };
    let (da, sa, fc) = (body[0] & 0x7F, body[1] & 0x7F, body[2]);
    Parsed::Whole(total, Some(Request { da, sa, fc, dsap, ssap, data: saps.collect() }))
}
