//! The world around an encoder.

pub(crate) mod model;

use sch108bex::health::{Battery, Measurement};
use sch108bex::specification::SUPPLY_OFF_BELOW_MV;

/// Supply, temperature, light and battery, as the device measures them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct World(pub Measurement);

impl Default for World {
    /// 24 V, 20 degrees, everything fine.
    fn default() -> Self {
        Self(Measurement { supply_mv: 24_000, temperature_tenths: 200, light_ok: true, battery: Battery::Ok })
    }
}

impl World {
    /// Whether the device runs at all. Reading "Supply": below 6.0 V, at 0 and with reversed poles
    /// it is off; 6.0 V is simulated, the manual has no such figure.
    pub const fn is_powered(&self) -> bool {
        self.0.supply_mv >= SUPPLY_OFF_BELOW_MV
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_device_is_off_below_6_volts_and_with_reversed_poles() {
        for (supply_mv, powered) in
            [(24_000, true), (6_000, true), (5_999, false), (0, false), (-24_000, false)]
        {
            let world = World(Measurement { supply_mv, ..World::default().0 });
            assert_eq!(world.is_powered(), powered, "{supply_mv} mV");
        }
    }
}
