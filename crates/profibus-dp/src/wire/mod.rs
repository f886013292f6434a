//! Wire formats: one file per format, each a value type with `parse` and `emit`.
//!
//! Octets of a service's data unit count from 1, as the standard and device manuals count them;
//! the one subtraction lives in [`octet`].

pub mod chk_cfg;
pub mod function_code;
pub mod global_control;
pub mod sap;
pub mod set_prm;
pub mod set_slave_add;
pub mod slave_diag;
pub mod telegram;

pub use function_code::{FunctionCode, ResponseCode};
pub use global_control::GlobalControl;
pub use sap::Sap;
pub use set_prm::{SetPrm, StationStatus};
pub use set_slave_add::SetSlaveAdd;
pub use slave_diag::StandardDiagnosis;
pub use telegram::{DataTelegram, Parsed, Telegram};

/// Octet `number` of a data unit, counted from 1; `None` where the unit is shorter.
pub fn octet(unit: &[u8], number: usize) -> Option<u8> {
    unit.get(number.checked_sub(1)?).copied()
}
