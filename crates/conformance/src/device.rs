//! What is known of the slave under test.

use profibus_dp::time::{Baudrate, BitTimes};

/// The slave under test, as its GSD and its user describe it.
#[derive(Debug, Clone)]
pub struct Device {
    /// Its station address, 0 to 126.
    pub address: u8,
    /// Its Ident_Number; `None`: read from the diagnosis.
    pub ident: Option<u16>,
    /// What it can be configured as. The first is the usual one.
    pub modes: Vec<Mode>,
    /// What its GSD says that it can do.
    pub features: Features,
    /// What is known of it if it is an encoder of this kind.
    pub encoder: Option<EncoderFacts>,
    /// The latest start of a reply at each rate, in the order of [`Baudrate::ALL`].
    #[doc(alias = "MaxTsdr")]
    pub max_tsdr: [BitTimes; 10],
}

/// One way to parameterize and configure a slave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mode {
    /// How cases name it: `class 1`, `class 2`, `scancon`; anything for other slaves.
    pub name: String,
    /// User_Prm_Data: Set_Prm from octet 8 on.
    pub user_prm: Vec<u8>,
    /// The identifier octets that Chk_Cfg carries.
    pub cfg: Vec<u8>,
    /// Input octets, seen from the master.
    pub inputs: usize,
    /// Output octets, seen from the master.
    pub outputs: usize,
}

/// Abilities that a GSD names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Features {
    /// `Freeze_Mode_supp`
    pub freeze: bool,
    /// `Sync_Mode_supp`
    pub sync: bool,
    /// `Fail_Safe`: an empty Data_Exchange clears the outputs.
    pub fail_safe: bool,
    /// `Set_Slave_Add_supp`
    pub set_slave_add: bool,
    /// Octet 8 of Set_Prm is that of the slave ASIC (watchdog base and reserved bits).
    pub asic_octet_8: bool,
}

/// What the encoder's own cases need to know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncoderFacts {
    /// n of the manual.
    pub singleturn_bits: u8,
    /// m of the manual.
    pub multiturn_bits: u8,
    /// Diagnosis octets 48-57; `None`: not known, so only their form is checked.
    pub serial: Option<String>,
}

impl Device {
    /// The encoder of the manual at `address`: three modes, scaling off, everything that its GSD
    /// promises.
    pub fn encoder(address: u8, singleturn_bits: u8, multiturn_bits: u8) -> Self {
        let units = 1_u32 << singleturn_bits;
        let range = 1_u32 << (singleturn_bits + multiturn_bits);
        let scaling: Vec<u8> =
            [units.to_be_bytes(), range.to_be_bytes()].concat().into_iter().chain([0; 8]).collect();
        let mode = |name: &str, user_prm: Vec<u8>, cfg: &[u8], inputs, outputs| Mode {
            name: name.to_owned(),
            user_prm,
            cfg: cfg.to_vec(),
            inputs,
            outputs,
        };
        let class_2 = [vec![0x00, 0x02], scaling].concat();
        let scancon = [class_2.clone(), vec![0x01]].concat();
        Self {
            address,
            ident: None,
            modes: vec![
                mode("class 2", class_2, &[0xF1], 4, 4),
                mode("class 1", vec![0x00, 0x00], &[0xD1], 4, 0),
                mode("scancon", scancon, &[0xF1, 0xD1, 0xD1], 12, 4),
            ],
            features: Features {
                freeze: true,
                sync: true,
                fail_safe: true,
                set_slave_add: true,
                asic_octet_8: true,
            },
            encoder: Some(EncoderFacts { singleturn_bits, multiturn_bits, serial: None }),
            max_tsdr: USUAL_MAX_TSDR,
        }
    }

    /// Any DP-V0 slave with one mode.
    pub fn slave(address: u8, mode: Mode, features: Features) -> Self {
        Self { address, ident: None, modes: vec![mode], features, encoder: None, max_tsdr: USUAL_MAX_TSDR }
    }

    /// The mode called `name`; without a name the usual one.
    pub fn mode(&self, name: Option<&str>) -> Option<&Mode> {
        match name {
            None => self.modes.first(),
            Some(name) => self.modes.iter().find(|mode| mode.name == name),
        }
    }

    /// The latest start of a reply at `rate`.
    pub fn max_tsdr(&self, rate: Baudrate) -> BitTimes {
        let at = Baudrate::ALL.iter().position(|known| *known == rate).unwrap_or(0);
        self.max_tsdr[at]
    }
}

/// MaxTsdr as GSD files of plain DP slaves have it, in the order of [`Baudrate::ALL`].
pub const USUAL_MAX_TSDR: [BitTimes; 10] = [
    BitTimes(60),
    BitTimes(60),
    BitTimes(60),
    BitTimes(60),
    BitTimes(60),
    BitTimes(100),
    BitTimes(150),
    BitTimes(250),
    BitTimes(450),
    BitTimes(800),
];
