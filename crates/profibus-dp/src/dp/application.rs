//! What a device must bring to be a DP-V0 slave.

use super::event::Event;
use crate::time::Instant;
use crate::wire::SetPrm;
use crate::wire::chk_cfg::Lengths;

/// The device says no. Why, it tells its own observers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused;

/// What the device makes of a Set_Prm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PrmVerdict {
    /// Parameters taken.
    Accepted,
    /// Illegal parameters: nothing taken, Prm_Fault, back to Wait_Prm.
    Refused,
    /// Legal, but no longer enough for the configuration agreed on. Only in data exchange.
    /// Reading "Which functionality": the slave leaves its master without a fault bit.
    Outgrown,
}

/// The device's part of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ExtendedDiagnosis {
    /// Octets written, 0 to 238.
    pub length: usize,
    /// Ext_Diag_Overflow: there is more than fits.
    pub overflow: bool,
}

/// The device behind a slave: everything that is not PROFIBUS.
///
/// The slave calls these as telegrams come in; every call returns at once. Input and output are
/// as the master sees them. The slave has checked what the standard demands: the owner, the
/// state, the ident number, the standard's octets of Set_Prm. Methods with a default are those
/// that most devices need not change.
pub trait Application {
    /// Ident_Number, given by the PNO.
    #[doc(alias = "Ident_Number")]
    fn ident_number(&self) -> u16;

    /// Checks the parameters of a Set_Prm and takes them if they are good; `exchanging`: in data
    /// exchange, where they take effect at once. Octets 1 to 8 have been checked.
    fn set_prm(&mut self, now: Instant, prm: &SetPrm<'_>, exchanging: bool) -> PrmVerdict;

    /// Compares a configuration with those that the device offers under its parameters.
    ///
    /// # Errors
    ///
    /// [`Refused`] where it offers no such configuration: Cfg_Fault, back to Wait_Prm.
    fn chk_cfg(&mut self, now: Instant, configuration: &[u8]) -> Result<Lengths, Refused>;

    /// Get_Cfg: in data exchange the configuration agreed on, else the one it would accept.
    fn configuration(&self, exchanging: bool) -> &[u8];

    /// Writes the inputs of the moment, as many as agreed on, and returns the sum of the octets
    /// modulo 256, so that a device can prepare it when nothing waits. Nothing prepared?
    /// [`sum`](crate::wire::telegram::sum) has it. With a wrong one masters refuse the answer.
    fn read_inputs(&self, to: &mut [u8]) -> u8;

    /// Takes outputs, as many as agreed on, even if none. Under Sync: those passed on.
    fn write_outputs(&mut self, now: Instant, octets: &[u8]);

    /// Outputs go to 0, or whatever is safe: Clear_Data, a fail-safe Data_Exchange, or no master.
    fn clear_outputs(&mut self, now: Instant);

    /// RD_Outp: the outputs in force, as many as agreed on.
    fn read_outputs(&self, to: &mut [u8]);

    /// Writes the device's part of the diagnosis, from octet 7 on.
    fn diagnosis(&self, exchanging: bool, to: &mut [u8]) -> ExtendedDiagnosis;

    /// Ext_Diag: the device's part of the diagnosis reports a fault, and not only a status.
    #[doc(alias = "Ext_Diag")]
    fn external_diagnosis(&self, exchanging: bool) -> bool {
        let _ = exchanging;
        false
    }

    /// Stat_Diag: no valid data, the master shall keep fetching the diagnosis.
    #[doc(alias = "Stat_Diag")]
    fn static_diagnosis(&self) -> bool {
        false
    }

    /// Whether an empty Data_Exchange clears the outputs (GSD: Fail_Safe = 1); else it is one of
    /// a wrong length.
    ///
    /// Readings "Sync, Freeze, Fail_Safe" and "Empty Data_Exchange": supported, and answered as
    /// any other, since a master in Clear sends it.
    #[doc(alias = "Fail_Safe")]
    fn is_fail_safe(&self) -> bool {
        true
    }

    /// Whether Sync can be used (GSD: Sync_Mode_supp).
    fn supports_sync(&self) -> bool {
        true
    }

    /// Whether Freeze can be used (GSD: Freeze_Mode_supp).
    fn supports_freeze(&self) -> bool {
        true
    }

    /// Whether Set_Slave_Add is served at all (GSD: Set_Slave_Add_supp, switches).
    fn address_changeable(&self) -> bool {
        false
    }

    /// Whether this may become its address. The slave asks only where it is changeable.
    fn accepts_address(&self, address: u8) -> bool {
        (1..=125).contains(&address)
    }

    /// The E5 to a good Set_Slave_Add has been handed out: the slave answers to `address` now,
    /// and the device shall keep it over a power cycle.
    fn address_taken(&mut self, now: Instant, address: u8) {
        let _ = (now, address);
    }

    /// The slave is in Wait_Prm again and has no master.
    fn master_left(&mut self, now: Instant) {
        let _ = now;
    }

    /// Something worth telling has happened.
    fn observe(&mut self, now: Instant, event: &Event) {
        let _ = (now, event);
    }
}
