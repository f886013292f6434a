//! Telegrams of the data link layer.
//!
//! | name | layout | octets | use |
//! |------|--------|--------|-----|
//! | SD1 | `10` DA SA FC FCS ED | 6 | no data |
//! | SD2 | `68` LE LEr `68` DA SA FC PDU FCS ED | LE + 6 | 1 to 246 octets of PDU |
//! | SD3 | `A2` DA SA FC PDU FCS ED | 14 | 8 octets of PDU |
//! | SD4 | `DC` DA SA | 3 | token |
//! | SC  | `E5` | 1 | short acknowledgement |
//!
//! LE counts DA, SA, FC and PDU: 4 to 249. FCS is the sum modulo 256 of DA to the end of the
//! PDU; ED is `16`. Bit 7 of DA or SA: the PDU begins with an extension octet, the SAP.

use super::function_code::FunctionCode;
use super::sap::Sap;

/// Start delimiter of a telegram without data.
pub const SD1: u8 = 0x10;
/// Start delimiter of a telegram of variable length.
pub const SD2: u8 = 0x68;
/// Start delimiter of a telegram with eight octets of PDU.
pub const SD3: u8 = 0xA2;
/// Start delimiter of a token.
pub const SD4: u8 = 0xDC;
/// The short acknowledgement.
pub const SC: u8 = 0xE5;
/// End delimiter.
pub const ED: u8 = 0x16;

/// The longest telegram: SD2 with LE = 249.
pub const MAX_OCTETS: usize = 255;
/// The longest PDU, SAP octets included.
pub const MAX_PDU: usize = 246;
/// DA of a broadcast or multicast.
pub const BROADCAST: u8 = 127;
/// Octets of an SD1 telegram.
pub const SD1_OCTETS: usize = 6;
/// Octets of an SD3 telegram.
pub const SD3_OCTETS: usize = 14;
/// The least and the greatest LE of an SD2 telegram.
pub(crate) const LE_RANGE: core::ops::RangeInclusive<u8> = 4..=249;

/// The address without bit 7.
pub(crate) const ADDRESS: u8 = 0x7F;
const EXTENSION: u8 = 0x80;

/// A telegram without a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telegram<'a> {
    /// SD1, SD2 or SD3.
    Data(DataTelegram<'a>),
    /// SD4: the right to send passes from `sa` to `da`.
    Token {
        /// Who gets the token.
        da: u8,
        /// Who gives it away.
        sa: u8,
    },
    /// SC
    ShortAcknowledgement,
}

/// What an SD1, SD2 or SD3 telegram holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataTelegram<'a> {
    /// Destination address, 0 to 126, 127 for all.
    pub da: u8,
    /// Source address, 0 to 126.
    pub sa: u8,
    /// The FC octet.
    pub fc: FunctionCode,
    /// Destination SAP.
    pub dsap: Sap,
    /// Source SAP.
    pub ssap: Sap,
    /// The PDU without its SAP octets, 0 to 246 octets.
    pub data: &'a [u8],
}

/// Why octets are no telegram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The first octet is no start delimiter.
    StartDelimiter(u8),
    /// LE and its repetition differ.
    LengthRepetition(u8, u8),
    /// LE is outside 4 to 249.
    Length(u8),
    /// The fourth octet of an SD2 telegram is not 68.
    SecondStartDelimiter(u8),
    /// The check sum received, and the one that would be right.
    CheckSum(u8, u8),
    /// The end delimiter is not 16.
    EndDelimiter(u8),
    /// An address announces a SAP, but there is no octet left for it.
    MissingExtension,
}

/// The outcome of [`parse`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parsed<'a> {
    /// A whole telegram, and how many octets it took.
    Complete(Telegram<'a>, usize),
    /// So far no fault, but at least `missing` octets more are needed.
    Incomplete {
        /// At least one.
        missing: usize,
    },
    /// No telegram begins here.
    Invalid(Fault),
}

impl<'a> DataTelegram<'a> {
    /// Takes the SAPs off the PDU. Addresses are as on the wire, with their extension bits.
    #[inline(always)]
    pub(crate) fn from_wire(da: u8, sa: u8, fc: u8, pdu: &'a [u8]) -> Result<Self, Fault> {
        let mut telegram = Self {
            da: da & ADDRESS,
            sa: sa & ADDRESS,
            fc: FunctionCode(fc),
            dsap: Sap::NIL,
            ssap: Sap::NIL,
            data: pdu,
        };
        if (da | sa) & EXTENSION != 0 {
            if da & EXTENSION != 0 {
                telegram.dsap = telegram.take_sap()?;
            }
            if sa & EXTENSION != 0 {
                telegram.ssap = telegram.take_sap()?;
            }
        }
        Ok(telegram)
    }

    #[inline]
    fn take_sap(&mut self) -> Result<Sap, Fault> {
        let (&sap, rest) = self.data.split_first().ok_or(Fault::MissingExtension)?;
        self.data = rest;
        // FF must not pass for no SAP at all: bits 6 and 7 tell that it is none, and so they do in FE.
        Ok(if sap == Sap::NIL.0 { Sap(0xFE) } else { Sap(sap) })
    }

    /// Writes the telegram into `to`: SD1 where the PDU is empty, else SD2.
    ///
    /// Returns its length, or `None` where `to` is too short or the PDU longer than 246 octets;
    /// then `to` may be partly written.
    pub fn emit(&self, to: &mut [u8]) -> Option<usize> {
        let saps = usize::from(!self.dsap.is_nil()).checked_add(usize::from(!self.ssap.is_nil()))?;
        let pdu = self.data.len().checked_add(saps)?;
        if pdu > MAX_PDU {
            return None;
        }
        let le = u8::try_from(pdu.checked_add(3)?).ok()?;
        let start = if pdu == 0 {
            *to.first_mut()? = SD1;
            1
        } else {
            to.get_mut(..4)?.copy_from_slice(&[SD2, le, le, SD2]);
            4
        };
        let body = to.get_mut(start..)?;
        let (head, body) = body.split_at_mut_checked(3)?;
        head.copy_from_slice(&[
            self.da | extension_bit(self.dsap),
            self.sa | extension_bit(self.ssap),
            self.fc.0,
        ]);
        let (data, tail) = body.split_at_mut_checked(pdu)?;
        let mut rest = &mut *data;
        for sap in [self.dsap, self.ssap] {
            if !sap.is_nil() {
                let (first, others) = rest.split_first_mut()?;
                *first = sap.0;
                rest = others;
            }
        }
        rest.copy_from_slice(self.data);
        let sum = sum(head).wrapping_add(sum(data));
        tail.get_mut(..2)?.copy_from_slice(&[sum, ED]);
        start.checked_add(usize::from(le))?.checked_add(2)
    }
}

/// Bit 7 of an address where a SAP follows.
pub(crate) const fn extension_bit(sap: Sap) -> u8 {
    if sap.is_nil() { 0 } else { EXTENSION }
}

/// What stands between the delimiters, before the SAPs are taken off the PDU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Frame<'a> {
    /// With bit 7, where a SAP follows.
    pub(crate) da: u8,
    /// With bit 7, where a SAP follows.
    pub(crate) sa: u8,
    pub(crate) fc: FunctionCode,
    pub(crate) pdu: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The frame with its SAPs read.
    #[inline]
    pub(crate) fn telegram(&self) -> Result<DataTelegram<'a>, Fault> {
        DataTelegram::from_wire(self.da, self.sa, self.fc.0, self.pdu)
    }

    /// Whether every SAP that the addresses announce is there.
    #[inline(always)]
    pub(crate) fn has_its_saps(&self) -> bool {
        (self.da | self.sa) & EXTENSION == 0 || self.telegram().is_ok()
    }
}

/// Reads the one SD1 or SD2 telegram that fills `octets`, the usual case, in fewer steps than
/// [`parse`]. `None` where there is anything unusual about them, a fault or not.
#[inline(always)]
pub(crate) fn parse_usual(octets: &[u8]) -> Option<Frame<'_>> {
    let start = *octets.first()?;
    let frame = if start == SD2 {
        let [_, le, ler, SD2, body @ .., ED] = octets else {
            return None;
        };
        let [da, sa, fc, pdu @ .., fcs] = body else {
            return None;
        };
        // The FCS is in the sum too: so often there are no more than eight octets.
        if le != ler
            || !LE_RANGE.contains(le)
            || octets.len() != usize::from(*le).wrapping_add(6)
            || sum_of_body(octets, body).wrapping_sub(*fcs) != *fcs
        {
            return None;
        }
        Frame { da: *da, sa: *sa, fc: FunctionCode(*fc), pdu }
    } else {
        let &[SD1, da, sa, fc, fcs, ED] = octets else {
            return None;
        };
        if da.wrapping_add(sa).wrapping_add(fc) != fcs {
            return None;
        }
        Frame { da, sa, fc: FunctionCode(fc), pdu: &[] }
    };
    frame.has_its_saps().then_some(frame)
}

/// Reads the telegram that begins with the first of `octets`.
pub fn parse(octets: &[u8]) -> Parsed<'_> {
    match octets.first() {
        Some(&SD2) => parse_sd2(octets),
        Some(&SD1) => match octets.first_chunk::<SD1_OCTETS>() {
            Some(&[_, da, sa, fc, fcs, ed]) => {
                let sum = da.wrapping_add(sa).wrapping_add(fc);
                data_telegram([da, sa, fc], &[], (fcs, sum), ed, SD1_OCTETS)
            }
            None => incomplete(SD1_OCTETS, octets),
        },
        Some(_) => parse_rare(octets),
        None => Parsed::Incomplete { missing: 1 },
    }
}

fn parse_sd2(octets: &[u8]) -> Parsed<'_> {
    let Some(&[_, le, ler, sd]) = octets.first_chunk::<4>() else {
        return incomplete(4, octets);
    };
    if le != ler {
        return Parsed::Invalid(Fault::LengthRepetition(le, ler));
    }
    if !LE_RANGE.contains(&le) {
        return Parsed::Invalid(Fault::Length(le));
    }
    if sd != SD2 {
        return Parsed::Invalid(Fault::SecondStartDelimiter(sd));
    }
    let total = usize::from(le).wrapping_add(6);
    let Some(telegram) = octets.get(..total) else {
        return incomplete(total, octets);
    };
    let Some(([_, _, _, _, da, sa, fc, pdu @ ..], &[fcs, ed])) = telegram.split_last_chunk::<2>() else {
        return incomplete(total, octets);
    };
    let sum = sum(&[*da, *sa, *fc]).wrapping_add(sum(pdu));
    data_telegram([*da, *sa, *fc], pdu, (fcs, sum), ed, total)
}

fn parse_rare(octets: &[u8]) -> Parsed<'_> {
    match *octets {
        [SC, ..] => Parsed::Complete(Telegram::ShortAcknowledgement, 1),
        [SD4, da, sa, ..] => Parsed::Complete(Telegram::Token { da: da & ADDRESS, sa: sa & ADDRESS }, 3),
        [SD4, ..] => incomplete(3, octets),
        [SD3, ..] => match octets.first_chunk::<SD3_OCTETS>() {
            Some([_, da, sa, fc, pdu @ .., fcs, ed]) => {
                let sum = sum(&[*da, *sa, *fc]).wrapping_add(sum(pdu));
                data_telegram([*da, *sa, *fc], pdu, (*fcs, sum), *ed, SD3_OCTETS)
            }
            None => incomplete(SD3_OCTETS, octets),
        },
        [other, ..] => Parsed::Invalid(Fault::StartDelimiter(other)),
        [] => Parsed::Incomplete { missing: 1 },
    }
}

fn data_telegram(
    [da, sa, fc]: [u8; 3],
    pdu: &[u8],
    (fcs, sum): (u8, u8),
    ed: u8,
    total: usize,
) -> Parsed<'_> {
    if fcs != sum {
        return Parsed::Invalid(Fault::CheckSum(fcs, sum));
    }
    if ed != ED {
        return Parsed::Invalid(Fault::EndDelimiter(ed));
    }
    match DataTelegram::from_wire(da, sa, fc, pdu) {
        Ok(telegram) => Parsed::Complete(Telegram::Data(telegram), total),
        Err(fault) => Parsed::Invalid(fault),
    }
}

fn incomplete(total: usize, octets: &[u8]) -> Parsed<'_> {
    Parsed::Incomplete { missing: total.saturating_sub(octets.len()).max(1) }
}

/// FCS: the sum of the octets modulo 256.
#[doc(alias = "FCS")]
pub fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum, &octet| sum.wrapping_add(octet))
}

#[expect(clippy::cast_possible_truncation, reason = "small counts; and the sum is modulo 256")]
/// [`sum`] of the body of a telegram, eight octets at a time; `telegram` is all of it, so that
/// a word may reach back over octets before the body, or over those that were counted already.
#[inline(always)]
fn sum_of_body(telegram: &[u8], body: &[u8]) -> u8 {
    // In front of the end delimiter. Little endian: what does not count lies in the low octets.
    let before_end = telegram.split_last().and_then(|(_, before)| before.last_chunk::<8>());
    let last = |count: usize| {
        let superfluous = 64u32.wrapping_sub((count as u32).wrapping_mul(8));
        before_end.map_or(0, |word| u64::from_le_bytes(*word)).wrapping_shr(superfluous)
    };
    let lanes = if body.len() <= 8 {
        pairs(last(body.len()))
    } else {
        let (words, rest) = body.as_chunks::<8>();
        // Four lanes of 16 bits take 128 words of pairs; a telegram has 32.
        let lanes =
            words.iter().fold(0u64, |lanes, word| lanes.wrapping_add(pairs(u64::from_le_bytes(*word))));
        if rest.is_empty() { lanes } else { lanes.wrapping_add(pairs(last(rest.len()))) }
    };
    (lanes.wrapping_mul(0x0001_0001_0001_0001) >> 48) as u8
}

/// The eight octets of a word added up in pairs.
#[inline(always)]
const fn pairs(word: u64) -> u64 {
    const EVEN: u64 = 0x00FF_00FF_00FF_00FF;
    (word & EVEN).wrapping_add((word >> 8) & EVEN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn data(octets: &[u8]) -> DataTelegram<'_> {
        match parse(octets) {
            Parsed::Complete(Telegram::Data(telegram), used) => {
                assert_eq!(used, octets.len());
                telegram
            }
            other => panic!("{other:?}"),
        }
    }

    const DIAG: [u8; 11] = [0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16];

    // DP slave reference, section 1.5.
    #[test]
    fn the_formats_of_the_reference_parse() {
        let status = data(&[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16]);
        assert_eq!((status.da, status.sa, status.fc.0), (11, 2, 0x49));
        assert!(status.dsap.is_nil() && status.ssap.is_nil() && status.data.is_empty());

        let diag = data(&DIAG);
        assert_eq!((diag.da, diag.sa, diag.dsap.0, diag.ssap.0), (11, 2, 60, 62));
        assert!(diag.data.is_empty());

        let sd2 = data(&[
            0x68, 0x0B, 0x0B, 0x68, 0x82, 0x8B, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x47, 0x11, 0xED,
            0x16,
        ]);
        let sd3 = data(&[0xA2, 0x82, 0x8B, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x47, 0x11, 0xED, 0x16]);
        assert_eq!(sd2, sd3);
        assert_eq!(sd2.data, [0x02, 0x05, 0x00, 0xFF, 0x47, 0x11]);

        assert_eq!(parse(&[0xDC, 0x03, 0x02]), Parsed::Complete(Telegram::Token { da: 3, sa: 2 }, 3));
        assert_eq!(parse(&[0xE5]), Parsed::Complete(Telegram::ShortAcknowledgement, 1));
    }

    // DP slave reference, sections 1.5 and 3.5: written as they were read.
    #[test]
    fn telegrams_of_the_reference_emit() {
        for octets in [
            &DIAG[..],
            &[0x10, 0x02, 0x0B, 0x00, 0x0D, 0x16],
            &[0x68, 0x07, 0x07, 0x68, 0xFF, 0x82, 0x46, 0x3A, 0x3E, 0x02, 0x00, 0x41, 0x16],
            &[0x68, 0x07, 0x07, 0x68, 0x02, 0x0B, 0x08, 0x00, 0x12, 0x34, 0x56, 0xB1, 0x16],
        ] {
            let mut to = [0; MAX_OCTETS];
            let length = data(octets).emit(&mut to).expect("fits");
            assert_eq!(&to[..length], octets);
        }
    }

    // Cases 2, 3, 4, 6, 8, 9, 34, 35.
    #[test]
    fn every_fault_has_its_name() {
        let fault = |octets: &[u8]| match parse(octets) {
            Parsed::Invalid(fault) => fault,
            other => panic!("{other:?}"),
        };
        assert_eq!(fault(&[0x10, 0x0B, 0x02, 0x49, 0x57, 0x16]), Fault::CheckSum(0x57, 0x56));
        assert_eq!(fault(&[0x10, 0x0B, 0x02, 0x49, 0x56, 0x17]), Fault::EndDelimiter(0x17));
        assert_eq!(fault(&[0x68, 0x05, 0x05, 0x69]), Fault::SecondStartDelimiter(0x69));
        assert_eq!(fault(&[0x68, 0x05, 0x06, 0x68]), Fault::LengthRepetition(5, 6));
        assert_eq!(fault(&[0x68, 0x03, 0x03, 0x68, 0x0B, 0x02, 0x49, 0x56, 0x16]), Fault::Length(3));
        assert_eq!(fault(&[0x68, 0xFA, 0xFA, 0x68]), Fault::Length(250));
        assert_eq!(fault(&[0x55]), Fault::StartDelimiter(0x55));
        assert_eq!(fault(&[0x10, 0x8B, 0x82, 0x6D, 0x7A, 0x16]), Fault::MissingExtension);
        assert_eq!(
            fault(&[0x68, 0x04, 0x04, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0xB6, 0x16]),
            Fault::MissingExtension
        );
        let mut bad = DIAG;
        bad[9] = 0xF5;
        assert_eq!(fault(&bad), Fault::CheckSum(0xF5, 0xF4));
    }

    // By hand: 8B + 82 + 6D + FF + 3E and 8B + 82 + 6D + 3C + FF.
    #[test]
    fn an_extension_octet_of_ff_is_not_no_sap() {
        let first = data(&[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0xFF, 0x3E, 0xB7, 0x16]);
        assert!(!first.dsap.is_nil() && !first.dsap.is_plain() && first.ssap == Sap::CHK_CFG);
        let second = data(&[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0xFF, 0xB5, 0x16]);
        assert!(!second.ssap.is_nil() && !second.ssap.is_plain() && second.dsap == Sap::SLAVE_DIAG);
    }

    #[test]
    fn the_longest_telegram_parses_and_a_longer_one_is_not_emitted() {
        let pdu = [0x5A; MAX_PDU + 1];
        let telegram = |data| DataTelegram {
            da: 11,
            sa: 2,
            fc: FunctionCode(0x7D),
            dsap: Sap::NIL,
            ssap: Sap::NIL,
            data,
        };
        let mut to = [0; 300];
        assert_eq!(telegram(&pdu[..MAX_PDU]).emit(&mut to), Some(MAX_OCTETS));
        assert_eq!(to[1], 0xF9);
        assert_eq!(data(&to[..MAX_OCTETS]).data, &pdu[..MAX_PDU]);
        assert_eq!(telegram(&pdu).emit(&mut to), None);
        assert_eq!(telegram(&pdu[..4]).emit(&mut to[..12]), None);
    }

    proptest! {
        #[test]
        fn the_usual_case_is_read_as_any_other(
            mut octets in prop_oneof![
                (any::<[u8; 3]>(), proptest::collection::vec(any::<u8>(), 0..=246)).prop_map(|(head, pdu)| {
                    let fcs = sum(&head).wrapping_add(sum(&pdu));
                    let le = u8::try_from(pdu.len() + 3).expect("249 at most");
                    let start = if pdu.is_empty() { std::vec![SD1] } else { std::vec![SD2, le, le, SD2] };
                    [&start[..], &head, &pdu, &[fcs, ED]].concat()
                }),
                proptest::collection::vec(any::<u8>(), 0..20),
            ],
            fault in proptest::option::of((any::<prop::sample::Index>(), 1u8..)),
            more in 0usize..2,
        ) {
            octets.resize(octets.len() + more, ED);
            if let Some((at, flip)) = fault && !octets.is_empty() {
                let at = at.index(octets.len());
                octets[at] ^= flip;
            }
            let due = match parse(&octets) {
                Parsed::Complete(Telegram::Data(telegram), used) if used == octets.len() && octets[0] != SD3 => Some(telegram),
                _ => None,
            };
            prop_assert_eq!(parse_usual(&octets).map(|frame| frame.telegram().expect("its SAPs")), due);
        }

        #[test]
        fn any_octets_parse_to_something(octets in proptest::collection::vec(any::<u8>(), 0..300)) {
            match parse(&octets) {
                Parsed::Complete(_, used) => prop_assert!(used <= octets.len()),
                Parsed::Incomplete { missing } => prop_assert!(missing >= 1),
                Parsed::Invalid(_) => prop_assert!(!octets.is_empty()),
            }
        }

        #[test]
        fn what_is_emitted_parses_back(
            da in 0u8..=127, sa in 0u8..=126, fc: u8, dsap in 0u8..=64, ssap in 0u8..=64,
            payload in proptest::collection::vec(any::<u8>(), 0..=244),
        ) {
            let sap = |n: u8| if n == 64 { Sap::NIL } else { Sap(n) };
            let telegram = DataTelegram { da, sa, fc: FunctionCode(fc), dsap: sap(dsap), ssap: sap(ssap), data: &payload };
            let mut to = [0; MAX_OCTETS];
            let length = telegram.emit(&mut to).expect("fits");
            prop_assert_eq!(parse(&to[..length]), Parsed::Complete(Telegram::Data(telegram), length));
            for cut in 0..length {
                prop_assert!(matches!(parse(&to[..cut]), Parsed::Incomplete { missing } if missing <= length - cut), "cut at {}", cut);
            }
        }
    }
}
