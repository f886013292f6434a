//! What a master gives a slave before data can be exchanged.

use profibus_dp::time::Duration;

/// The standard part of Set_Prm, octets 1 to 7; the rest is the device's own.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Parameters {
    /// The slave must have this one.
    pub ident_number: u16,
    /// How long the slave lives without hearing of its master; `None`: for ever.
    pub watchdog: Option<Watchdog>,
    /// min T_SDR in bit times; 0: the slave keeps its own.
    pub min_tsdr: u8,
    /// Bit n: member of group n + 1.
    pub groups: u8,
    /// Sync will be used.
    pub sync: bool,
    /// Freeze will be used.
    pub freeze: bool,
    /// Octets 8 on, 0 to 237.
    pub user: Vec<u8>,
}

/// The two watchdog factors: 10 ms x one x other, or 1 ms where octet 8 of Set_Prm says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Watchdog {
    /// WD_Fact_1, 1 to 255.
    pub factor_1: u8,
    /// WD_Fact_2, 1 to 255.
    pub factor_2: u8,
}

/// A watchdog time that no two factors make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a watchdog takes 10 ms to 650 s; give a time within that, or none")]
pub struct WatchdogOutOfRange;

impl Watchdog {
    /// The shortest watchdog of at least this time, in steps of 10 ms.
    ///
    /// # Errors
    ///
    /// The time is 0 or longer than 650.25 s.
    pub fn at_least(span: Duration) -> Result<Self, WatchdogOutOfRange> {
        let steps = span.as_nanos().div_ceil(10_000_000);
        if steps == 0 {
            return Err(WatchdogOutOfRange);
        }
        (1..=255u8)
            .filter_map(|factor_1| {
                let factor_2 = u8::try_from(steps.div_ceil(u64::from(factor_1))).ok()?;
                Some(Self { factor_1, factor_2 })
            })
            .min_by_key(|watchdog| u16::from(watchdog.factor_1) * u16::from(watchdog.factor_2))
            .ok_or(WatchdogOutOfRange)
    }

    /// How long it runs.
    pub fn span(self) -> Duration {
        Duration::from_millis(10 * u64::from(self.factor_1) * u64::from(self.factor_2))
    }
}

impl Parameters {
    /// Octets 1 to 7 of Set_Prm, with Lock_Req.
    pub fn standard_octets(&self) -> [u8; 7] {
        let bit = |set: bool, number: u8| u8::from(set) << number;
        let status = 0x80 | bit(self.sync, 5) | bit(self.freeze, 4) | bit(self.watchdog.is_some(), 3);
        let (factor_1, factor_2) =
            self.watchdog.map_or((0, 0), |watchdog| (watchdog.factor_1, watchdog.factor_2));
        let [ident_high, ident_low] = self.ident_number.to_be_bytes();
        [status, factor_1, factor_2, self.min_tsdr, ident_high, ident_low, self.groups]
    }

    /// All of Set_Prm.
    pub fn set_prm(&self) -> Vec<u8> {
        [&self.standard_octets(), &self.user[..]].concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 4.4: 88 WD_On and Lock_Req.
    #[test]
    fn the_standard_octets_are_where_the_standard_has_them() {
        let parameters = Parameters {
            ident_number: 0x108B,
            watchdog: Some(Watchdog { factor_1: 1, factor_2: 20 }),
            min_tsdr: 11,
            groups: 0x81,
            sync: true,
            freeze: false,
            user: vec![0, 2],
        };
        assert_eq!(parameters.set_prm(), [0xA8, 1, 20, 11, 0x10, 0x8B, 0x81, 0, 2]);
        let plain = Parameters { freeze: true, ..Parameters::default() };
        assert_eq!(plain.set_prm(), [0x90, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_watchdog_is_never_shorter_than_asked_for() {
        for (millis, due) in [(1, 10), (10, 10), (200, 200), (2_570, 2_580), (650_250, 650_250)] {
            let watchdog = Watchdog::at_least(Duration::from_millis(millis)).unwrap();
            assert_eq!(watchdog.span(), Duration::from_millis(due), "{millis}");
        }
        assert_eq!(Watchdog::at_least(Duration::ZERO), Err(WatchdogOutOfRange));
        assert_eq!(Watchdog::at_least(Duration::from_millis(650_251)), Err(WatchdogOutOfRange));
    }
}
