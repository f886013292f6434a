//! Requests as a master, a careless one or a broken one may send them.

use reference_model::{Device, State};

/// A kind of telegram; the rows of the table of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Service {
    FdlStatus,
    Ident,
    Lsap,
    Diag,
    GetCfg,
    RdInp,
    RdOutp,
    DiagWithData,
    GetCfgWithData,
    RdInpWithData,
    RdOutpWithData,
    PrmGood,
    PrmWatchdog,
    PrmGroup,
    PrmMinTsdr,
    PrmSyncFreeze,
    PrmIdent,
    PrmShort,
    PrmLength,
    PrmReserved,
    PrmFactor,
    PrmOctet8,
    PrmOctet9,
    PrmUnlock,
    PrmUnlockIdent,
    PrmOnlyMinTsdr,
    CfgGood,
    CfgBad,
    CfgEmpty,
    SsaGood,
    SsaRange,
    SsaIdent,
    SsaShort,
    Exchange,
    ExchangeEmpty,
    ExchangeLength,
    Clear,
    Freeze,
    Unfreeze,
    Sync,
    Unsync,
    GcGroup,
    GcReserved,
    GcLength,
    GcToUs,
    GcLow,
    GcAsSrd,
    OtherSap,
    Sda,
    Sdn,
    ReservedFunction,
    Response,
    Foreign,
    Broadcast,
    FromUs,
    SegmentSap,
}

use Service as S;

pub(crate) const ALL: [Service; 56] = [
    S::FdlStatus,
    S::Ident,
    S::Lsap,
    S::Diag,
    S::GetCfg,
    S::RdInp,
    S::RdOutp,
    S::DiagWithData,
    S::GetCfgWithData,
    S::RdInpWithData,
    S::RdOutpWithData,
    S::PrmGood,
    S::PrmWatchdog,
    S::PrmGroup,
    S::PrmMinTsdr,
    S::PrmSyncFreeze,
    S::PrmIdent,
    S::PrmShort,
    S::PrmLength,
    S::PrmReserved,
    S::PrmFactor,
    S::PrmOctet8,
    S::PrmOctet9,
    S::PrmUnlock,
    S::PrmUnlockIdent,
    S::PrmOnlyMinTsdr,
    S::CfgGood,
    S::CfgBad,
    S::CfgEmpty,
    S::SsaGood,
    S::SsaRange,
    S::SsaIdent,
    S::SsaShort,
    S::Exchange,
    S::ExchangeEmpty,
    S::ExchangeLength,
    S::Clear,
    S::Freeze,
    S::Unfreeze,
    S::Sync,
    S::Unsync,
    S::GcGroup,
    S::GcReserved,
    S::GcLength,
    S::GcToUs,
    S::GcLow,
    S::GcAsSrd,
    S::OtherSap,
    S::Sda,
    S::Sdn,
    S::ReservedFunction,
    S::Response,
    S::Foreign,
    S::Broadcast,
    S::FromUs,
    S::SegmentSap,
];

/// A column of the table of cells: where the slave stands, and who asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Place {
    WaitPrm,
    At126,
    WaitCfgOwner,
    WaitCfgOther,
    DataExchOwner,
    DataExchOther,
}

impl Place {
    pub(crate) const ALL: [Self; 6] = [
        Self::WaitPrm,
        Self::At126,
        Self::WaitCfgOwner,
        Self::WaitCfgOther,
        Self::DataExchOwner,
        Self::DataExchOther,
    ];

    pub(crate) fn of(state: State, is_owner: bool, address: u8) -> Self {
        match (state, is_owner) {
            (State::WaitPrm, _) if address == 126 => Self::At126,
            (State::WaitPrm, _) => Self::WaitPrm,
            (State::WaitCfg, true) => Self::WaitCfgOwner,
            (State::WaitCfg, false) => Self::WaitCfgOther,
            (State::DataExch, true) => Self::DataExchOwner,
            (State::DataExch, false) => Self::DataExchOther,
        }
    }
}

/// What a telegram is made of.
pub(crate) struct Asked {
    pub(crate) da: u8,
    pub(crate) sa: u8,
    pub(crate) fc: u8,
    pub(crate) dsap: Option<u8>,
    pub(crate) data: Vec<u8>,
}

impl Asked {
    pub(crate) fn octets(&self, sd3: bool) -> Vec<u8> {
        let extension = if self.dsap.is_some() { 0x80 } else { 0 };
        let saps: Vec<u8> = self.dsap.into_iter().flat_map(|dsap| [dsap, 0x3E]).collect();
        let body = [&[self.da | extension, self.sa | extension, self.fc], &saps[..], &self.data].concat();
        let sum = body.iter().fold(0u8, |sum, octet| sum.wrapping_add(*octet));
        let le = u8::try_from(body.len()).expect("249 octets at most");
        match le {
            3 => [&[0x10], &body[..], &[sum, 0x16]].concat(),
            11 if sd3 => [&[0xA2], &body[..], &[sum, 0x16]].concat(),
            _ => [&[0x68, le, le, 0x68], &body[..], &[sum, 0x16]].concat(),
        }
    }
}

impl Service {
    /// The request of master `sa` to `da`; `fc` is that of an SRD, `any` makes some of them differ.
    pub(crate) fn asked(self, da: u8, sa: u8, fc: u8, device: &Device, any: u8) -> Asked {
        let prm = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut data = vec![0x80, 1, 1, 0, 0x47, 0x11, 0, 0, device.prm_octet_9];
            change(&mut data);
            (fc, Some(61), data)
        };
        let (fc, dsap, data) = match self {
            S::PrmGood => prm(&|_| ()),
            S::PrmWatchdog => prm(&|data| (data[0], data[2], data[7]) = (0x88, 1 + any % 4, any & 0x47)),
            S::PrmGroup => prm(&|data| data[6] = any),
            S::PrmMinTsdr => prm(&|data| data[3] = any),
            S::PrmSyncFreeze => prm(&|data| data[0] = 0x80 | any & 0x30),
            S::PrmIdent => prm(&|data| data[4 + usize::from(any & 1)] ^= any | 1),
            S::PrmShort => prm(&|data| data.truncate(usize::from(any % 7))),
            S::PrmLength => prm(&|data| data.resize(if any & 1 == 0 { 7 } else { 10 }, 0)),
            S::PrmReserved => prm(&|data| data[0] |= 1 << (any % 3)),
            S::PrmFactor => prm(&|data| (data[0], data[1 + usize::from(any & 1)]) = (0x88, 0)),
            S::PrmOctet8 => prm(&|data| data[7] = any),
            S::PrmOctet9 => prm(&|data| data[8] ^= any | 1),
            S::PrmUnlock => prm(&|data| data[0] = 0x40 | any & 0x80),
            S::PrmUnlockIdent => prm(&|data| (data[0], data[5]) = (0x40, 0)),
            S::PrmOnlyMinTsdr => prm(&|data| (data[0], data[3], data[4]) = (0x08, any, 0)),
            _ => self.others(fc, device, any),
        };
        let da = match self {
            S::Foreign => 12,
            S::Broadcast
            | S::Clear
            | S::Freeze
            | S::Unfreeze
            | S::Sync
            | S::Unsync
            | S::GcGroup
            | S::GcReserved
            | S::GcLength
            | S::GcLow => 127,
            _ => da,
        };
        let sa = if self == S::FromUs { da } else { sa };
        Asked { da, sa, fc, dsap, data }
    }

    fn others(self, fc: u8, device: &Device, any: u8) -> (u8, Option<u8>, Vec<u8>) {
        let gc = |octet: u8| (0x46, Some(58), vec![octet, 0]);
        let outputs = device.outputs.len();
        let ssa = |address: u8| vec![address, 0x47, 0x11, 0];
        match self {
            S::FdlStatus => (0x49 | any & 0x30, None, vec![]),
            S::Ident => (0x4E, None, vec![]),
            S::Lsap => (0x4F, Some(60), vec![]),
            S::GetCfg => (fc, Some(59), vec![]),
            S::RdInp => (fc, Some(56), vec![]),
            S::RdOutp => (fc, Some(57), vec![]),
            S::DiagWithData => (fc, Some(60), vec![any]),
            S::GetCfgWithData => (fc, Some(59), vec![any; 6]),
            S::RdInpWithData => (fc, Some(56), vec![any]),
            S::RdOutpWithData => (fc, Some(57), vec![any]),
            S::CfgGood => (fc, Some(62), device.cfg.clone()),
            S::CfgBad => (fc, Some(62), [device.cfg.clone(), vec![any; 1 + usize::from(any % 6)]].concat()),
            S::CfgEmpty => (fc, Some(62), vec![]),
            S::SsaGood => (fc, Some(55), ssa(11 + any % 2)),
            S::SsaRange => (fc, Some(55), ssa([0, 126, 127, 255][usize::from(any % 4)])),
            S::SsaIdent => (fc, Some(55), vec![12, 0x47, 0x10, 0]),
            S::SsaShort => (fc, Some(55), ssa(12)[..3].to_vec()),
            S::Exchange => (fc, None, vec![any; outputs]),
            S::ExchangeEmpty => (fc, None, vec![]),
            S::ExchangeLength => (fc, None, vec![any; outputs + 1 + usize::from(any % 4)]),
            S::Clear => gc(0x02),
            S::Freeze => gc(0x08),
            S::Unfreeze => gc(0x04 | any & 0x08),
            S::Sync => gc(0x20 | any & 0x0A),
            S::Unsync => gc(0x10 | any & 0x20),
            S::GcGroup => (0x46, Some(58), vec![0x02, any]),
            S::GcReserved => gc(0x02 | [0x01, 0x40, 0x80][usize::from(any % 3)]),
            S::GcLength => (0x46, Some(58), vec![0x02; [0, 1, 3][usize::from(any % 3)]]),
            S::GcToUs => (0x76, Some(58), vec![0x02, 0]),
            S::GcLow => (0x44, Some(58), vec![0x02, 0]),
            S::GcAsSrd => (fc, Some(58), vec![0x02, 0]),
            S::OtherSap => {
                (fc, Some([0, 48, 53, 54, 63][usize::from(any % 5)]), vec![any; usize::from(any % 2)])
            }
            S::Sda => ((fc & 0xF0) | (3 + 2 * (any & 1)), Some(55 + any % 8), vec![0x02, 0]),
            S::Sdn => (0x44 | any & 2, [Some(60), Some(61), None][usize::from(any % 3)], vec![0x40; 9]),
            S::ReservedFunction => {
                let function =
                    [0x40, 0x41, 0x42, 0x47, 0x48, 0x4A, 0x4B, 0xC0, 0xCD, 0xC9][usize::from(any % 10)];
                (function, Some(60), vec![])
            }
            S::Response => (any & 0x0F, Some(60), vec![]),
            S::SegmentSap => (fc, Some(0x3C | [0x40, 0x80, 0xC0][usize::from(any % 3)]), vec![]),
            _ => (fc, Some(60), vec![]),
        }
    }
}
