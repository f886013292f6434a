//! The device behind the slave, as simple as an encoder can be: octets in, octets out.

/// What of a slave is no PROFIBUS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Device {
    /// Ident_Number
    pub ident: u16,
    /// Octets of a Set_Prm with Lock_Req: so many and no others.
    pub prm_octets: usize,
    /// The only good content of octet 9 of Set_Prm, where there is one.
    pub prm_octet_9: u8,
    /// The identifier octets of Chk_Cfg and Get_Cfg.
    pub cfg: Vec<u8>,
    /// The inputs of the moment; always as many as configured.
    pub inputs: Vec<u8>,
    /// The outputs in force; always as many as configured.
    pub outputs: Vec<u8>,
    /// How often outputs were taken.
    pub taken: u64,
    /// The user's part of the diagnosis, from octet 7 on.
    pub user_diagnosis: Vec<u8>,
    /// Ext_Diag: the user's part reports a fault.
    pub ext_diag: bool,
    /// Stat_Diag: the inputs are not valid.
    pub stat_diag: bool,
    /// GSD: Fail_Safe
    pub fail_safe: bool,
    /// GSD: Sync_Mode_supp
    pub sync: bool,
    /// GSD: Freeze_Mode_supp
    pub freeze: bool,
    /// Set_Slave_Add is served: the switches say 126.
    pub address_changeable: bool,
}

impl Device {
    /// 4 octets in and 4 out as one unit, 9 octets of parameters, everything supported.
    pub fn new() -> Self {
        Self {
            ident: 0x4711,
            prm_octets: 9,
            prm_octet_9: 0,
            cfg: vec![0xF1],
            inputs: vec![0x00, 0x12, 0x34, 0x56],
            outputs: vec![0; 4],
            taken: 0,
            user_diagnosis: vec![0x02, 0x00],
            ext_diag: false,
            stat_diag: false,
            fail_safe: true,
            sync: true,
            freeze: true,
            address_changeable: false,
        }
    }

    /// The same with other lengths.
    #[must_use]
    pub fn with_lengths(self, cfg: &[u8], inputs: usize, outputs: usize) -> Self {
        let inputs = (0..inputs).map(|at| u8::try_from(at).unwrap_or(0)).collect();
        Self { cfg: cfg.to_vec(), inputs, outputs: vec![0; outputs], ..self }
    }
}

impl Default for Device {
    fn default() -> Self {
        Self::new()
    }
}
