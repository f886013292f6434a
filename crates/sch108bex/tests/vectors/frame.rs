//! Telegrams built by the rules of EN 50170 alone, to compare with.

use serde_json::Value;

/// Addresses, function code and SAPs of a telegram.
pub(crate) struct Header {
    da: u8,
    sa: u8,
    fc: u8,
    saps: Option<(u8, u8)>,
}

impl Header {
    pub(crate) fn new(value: &Value) -> Self {
        let octet = |key: &str| value[key].as_u64().and_then(|number| u8::try_from(number).ok());
        let fc = value["fc"].as_str().and_then(|digits| u8::from_str_radix(digits, 16).ok());
        Self {
            da: octet("da").expect("da"),
            sa: octet("sa").expect("sa"),
            fc: fc.expect("fc"),
            saps: octet("dsap").zip(octet("ssap")),
        }
    }

    fn octets(&self) -> Vec<u8> {
        match self.saps {
            // Bit 7 of an address says that a SAP follows.
            Some((dsap, ssap)) => vec![self.da | 0x80, self.sa | 0x80, self.fc, dsap, ssap],
            None => vec![self.da, self.sa, self.fc],
        }
    }

    /// The telegram with this data: SD1 without, SD2 with.
    pub(crate) fn telegram(&self, data: &[u8]) -> Vec<u8> {
        let mut body = self.octets();
        body.extend(data);
        let fcs = sum(&body);
        let length = u8::try_from(body.len()).expect("short enough");
        let start = if data.is_empty() { vec![0x10] } else { vec![0x68, length, length, 0x68] };
        [start, body, vec![fcs, 0x16]].concat()
    }

    /// The FCS of a telegram whose data have this sum.
    pub(crate) fn fcs_from_sum(&self, data_sum: u8) -> u8 {
        sum(&self.octets()).wrapping_add(data_sum)
    }
}

fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum: u8, octet| sum.wrapping_add(*octet))
}
