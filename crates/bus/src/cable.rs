//! The cable: where the master is on it, where it is cut, and what a wrong termination does.
//!
//! How reflections damage bits on a real cable depends on its length, its stubs and its drivers. The model
//! here is a simple one, ours and no measurement: each device whose termination is wrong, an end left open
//! by a cut among them, adds the same share of bit errors, which grows with the rate.
//!
//! | rate | for each |
//! |---|---|
//! | up to 93.75 kbit/s | 0 |
//! | 187.5 kbit/s | 0.000001 |
//! | 500 kbit/s | 0.00001 |
//! | 1.5 Mbit/s | 0.0001 |
//! | 3 Mbit/s | 0.0003 |
//! | 6 Mbit/s | 0.001 |
//! | 12 Mbit/s | 0.003 |

use profibus_dp::time::Baudrate;

/// A cable with stations in the order of the segment, and the master among them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cable {
    /// So many stations are in front of the master.
    pub master_after: usize,
    /// Whether the master has its termination on; `None`: as it has to be where it is.
    pub master_terminated: Option<bool>,
    /// So many devices, the master among them, are in front of a cut.
    pub cut_after: Option<usize>,
    /// Devices whose termination is wrong; `None`: that has no effect.
    pub mismatches: Option<usize>,
}

impl Cable {
    /// Whether the cut is between a station and the master.
    pub fn cuts_off(&self, station: usize) -> bool {
        let device = if station < self.master_after { station } else { station + 1 };
        self.cut_after.is_some_and(|cut| (device < cut) != (self.master_after < cut))
    }

    /// The share of bits that flip because of the termination.
    pub fn bit_errors(&self, rate: Baudrate) -> f64 {
        let each = match rate {
            Baudrate::B9600 | Baudrate::B19200 | Baudrate::B45450 | Baudrate::B93750 => 0.0,
            Baudrate::B187500 => 1e-6,
            Baudrate::B500000 => 1e-5,
            Baudrate::B1500000 => 1e-4,
            Baudrate::B3000000 => 3e-4,
            Baudrate::B6000000 => 1e-3,
            Baudrate::B12000000 => 3e-3,
        };
        let wrong = u16::try_from(self.mismatches.unwrap_or(0)).unwrap_or(u16::MAX);
        (each * f64::from(wrong)).min(0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gone(master_after: usize, cut_after: usize) -> Vec<usize> {
        let cable = Cable { master_after, cut_after: Some(cut_after), ..Cable::default() };
        (0..4).filter(|&station| cable.cuts_off(station)).collect()
    }

    #[test]
    fn what_is_on_the_far_side_of_the_cut_vanishes() {
        // M 0 1 2 3
        assert_eq!(gone(0, 1), [0, 1, 2, 3]);
        assert_eq!(gone(0, 3), [2, 3]);
        assert_eq!(gone(0, 5), [0; 0], "behind the last");
        // 0 1 M 2 3
        assert_eq!(gone(2, 1), [0]);
        assert_eq!(gone(2, 2), [0, 1]);
        assert_eq!(gone(2, 3), [2, 3]);
        // 0 1 2 3 M
        assert_eq!(gone(4, 4), [0, 1, 2, 3]);
        assert_eq!(gone(4, 0), [0; 0], "in front of the first");
        assert!(!Cable::default().cuts_off(0));
    }

    #[test]
    fn a_wrong_termination_hurts_fast_buses_only() {
        let cable = Cable { mismatches: Some(2), ..Cable::default() };
        assert!(cable.bit_errors(Baudrate::B93750) <= 0.0);
        assert!((cable.bit_errors(Baudrate::B12000000) - 0.006).abs() < 1e-12);
        assert!(Cable::default().bit_errors(Baudrate::B12000000) <= 0.0);
        assert!(Cable { mismatches: Some(100_000), ..cable }.bit_errors(Baudrate::B12000000) <= 0.5);
    }
}
