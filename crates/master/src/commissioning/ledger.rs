//! What profirust sends, as it goes by.

use profibus_dp::wire::telegram::{SD1, SD2, SD3};

/// What was sent so far.
#[derive(Debug, Clone)]
pub struct Traffic {
    /// Telegrams, tokens too.
    pub telegrams: u64,
    /// Telegrams that were sent again because no answer came.
    pub retries: u64,
    /// The FC octet, the DSAP octet and the length of the newest request to each station.
    last: [(u8, u8, u8); 128],
}

impl Default for Traffic {
    fn default() -> Self {
        Self { telegrams: 0, retries: 0, last: [(0, 0, 0); 128] }
    }
}

impl Traffic {
    /// The FC octet of the newest request to a station; 0: none was sent.
    pub fn last_function(&self, station: u8) -> u8 {
        self.last[usize::from(station & 0x7F)].0
    }

    /// The FC octet and the DSAP of the newest request to a station; 0 where there is none.
    pub(super) fn last_request(&self, station: u8) -> (u8, u8) {
        let (function, sap, _) = self.last[usize::from(station & 0x7F)];
        (function, sap)
    }

    /// Takes note of a telegram.
    pub(super) fn note(&mut self, octets: &[u8]) {
        self.telegrams += 1;
        let (da, fc, sap) = match *octets {
            [SD1, da, _, fc, ..] => (da, fc, 0),
            [SD2, _, _, SD2, da, _, fc, sap, ..] | [SD3, da, _, fc, sap, ..] => (da, fc, sap),
            _ => return,
        };
        // Requests whose frame count bit counts.
        if fc & 0x40 == 0 || !matches!(fc & 0x0F, 0x3 | 0x5 | 0xC | 0xD) {
            return;
        }
        let request =
            (fc, if da & 0x80 == 0 { 0 } else { sap }, u8::try_from(octets.len()).unwrap_or(u8::MAX));
        let last = &mut self.last[usize::from(da & 0x7F)];
        self.retries += u64::from(*last == request);
        *last = request;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_frame_count_bit_twice_is_a_retry() {
        let mut traffic = Traffic::default();
        for (fc, retries) in [(0x6D, 0), (0x5D, 0), (0x5D, 1), (0x7D, 1), (0x5D, 1)] {
            traffic.note(&[SD1, 5, 2, fc, 0, 0x16]);
            assert_eq!(traffic.retries, retries);
            assert_eq!(traffic.last_function(5), fc);
        }
        // Neither tokens nor FDL status have one.
        traffic.note(&[0xDC, 5, 2]);
        traffic.note(&[SD1, 5, 2, 0x49, 0, 0x16]);
        assert_eq!((traffic.telegrams, traffic.retries, traffic.last_function(5)), (7, 1, 0x5D));
    }
}
