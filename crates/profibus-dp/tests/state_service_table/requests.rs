//! What each row of the table sends; every telegram of a row is a case of its own.

use crate::telegrams::{BAD, CFG, OUTGROWN, PRM, SELF, Sent};

/// The telegrams of a row.
pub(crate) fn requests(row: &str) -> Vec<Sent> {
    reads(row)
        .or_else(|| set_prm(row))
        .or_else(|| chk_cfg(row))
        .or_else(|| set_slave_add(row))
        .or_else(|| data_exchange(row))
        .or_else(|| global_control(row))
        .or_else(|| others(row))
        .unwrap_or_else(|| panic!("the table asks for `{row}`, which nobody can send"))
}

fn srd(sap: u8, data: &[u8]) -> Vec<Sent> {
    vec![Sent::Srd(Some(sap), data.to_vec())]
}

/// Good parameters but for one octet.
fn prm(octet: usize, value: u8) -> Vec<u8> {
    let mut prm = PRM;
    prm[octet - 1] = value;
    prm.to_vec()
}

/// Global_Control as SDN low and high.
fn control(da: u8, data: &[u8]) -> Vec<Sent> {
    [0x44, 0x46].map(|fc| Sent::Sdn(fc, da, Some(0x3A), data.to_vec())).to_vec()
}

fn commands(commands: &[u8]) -> Vec<Sent> {
    commands.iter().flat_map(|&command| control(0x7F, &[command, 0])).collect()
}

fn reads(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "FDL status" => [0x49, 0x69, 0x59, 0x79].map(Sent::Bare).to_vec(),
        "Ident" => [0x4E, 0x6E, 0x7E].map(Sent::Bare).to_vec(),
        "LSAP status" => vec![Sent::Bare(0x4F), Sent::Lsap(0x3C), Sent::Lsap(0x05)],
        "Slave_Diag" => srd(0x3C, &[]),
        "Slave_Diag with data" => srd(0x3C, &[0]),
        "Get_Cfg" => srd(0x3B, &[]),
        "Get_Cfg with data" => srd(0x3B, &[0, 0]),
        "RD_Inp" => srd(0x38, &[]),
        "RD_Inp with data" => srd(0x38, &[0]),
        "RD_Outp" => srd(0x39, &[]),
        "RD_Outp with data" => srd(0x39, &[0]),
        _ => return None,
    })
}

fn set_prm(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Set_Prm good" => srd(0x3D, &PRM),
        "Set_Prm wrong ident" => srd(0x3D, &prm(6, 0x35)),
        "Set_Prm 0 octets" => srd(0x3D, &[]),
        "Set_Prm 6 octets" => srd(0x3D, &PRM[..6]),
        "Set_Prm reserved bit" => {
            [0x81, 0x82, 0x84].into_iter().flat_map(|status| srd(0x3D, &prm(1, status))).collect()
        }
        "Set_Prm watchdog factor 0" => [[0x88, 0, 0], [0x88, 0, 20], [0x88, 1, 0]]
            .into_iter()
            .flat_map(|first| srd(0x3D, &[&first, &PRM[3..]].concat()))
            .collect(),
        "Set_Prm DPV1_Enable" => srd(0x3D, &prm(8, 0x80)),
        "Set_Prm bad for the device" => srd(0x3D, &prm(9, BAD)),
        "Set_Prm outgrown" => srd(0x3D, &prm(9, OUTGROWN)),
        "Set_Prm with watchdog" => srd(0x3D, &[&[0x88, 1, 100], &PRM[3..]].concat()),
        "Set_Prm unlock" => [&prm(1, 0x40)[..], &prm(1, 0x40)[..7], &prm(1, 0x7F)[..7]]
            .into_iter()
            .flat_map(|data| srd(0x3D, data))
            .collect(),
        "Set_Prm lock and unlock" => srd(0x3D, &prm(1, 0xC0)),
        "Set_Prm unlock wrong ident" => srd(0x3D, &[0x40, 0, 0, 0, 0x12, 0x35, 0]),
        "Set_Prm only min T_SDR" => [&[0, 0, 0, 0x20, 0, 0, 0xFF][..], &prm(1, 0x00), &prm(1, 0x38)]
            .into_iter()
            .flat_map(|data| srd(0x3D, data))
            .collect(),
        _ => return None,
    })
}

fn chk_cfg(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Chk_Cfg good" => srd(0x3E, &CFG),
        "Chk_Cfg bad" => [&[0x10, 0x20][..], &[0x20, 0x11], &[0x11, 0x60], &[0x91, 0x20]]
            .into_iter()
            .flat_map(|cfg| srd(0x3E, cfg))
            .collect(),
        "Chk_Cfg longer" => {
            [&[0x11, 0x20, 0x00][..], &[0x11; 244]].into_iter().flat_map(|cfg| srd(0x3E, cfg)).collect()
        }
        "Chk_Cfg empty" => srd(0x3E, &[]),
        _ => return None,
    })
}

fn set_slave_add(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Set_Slave_Add good" => srd(0x37, &[12, 0x12, 0x34, 0]),
        "Set_Slave_Add wrong ident" => srd(0x37, &[12, 0x12, 0x35, 0]),
        "Set_Slave_Add to 0" => srd(0x37, &[0, 0x12, 0x34, 0]),
        "Set_Slave_Add to 126" => [126, 127, 128, 255]
            .into_iter()
            .flat_map(|address| srd(0x37, &[address, 0x12, 0x34, 0]))
            .collect(),
        "Set_Slave_Add 3 octets" => srd(0x37, &[12, 0x12, 0x34]),
        _ => return None,
    })
}

fn data_exchange(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Data_Exchange good" => vec![Sent::Srd(None, vec![0xC3])],
        "Data_Exchange empty" => vec![Sent::Srd(None, vec![])],
        "Data_Exchange 2 octets" => vec![Sent::Srd(None, vec![0xC3, 0]), Sent::Srd(None, vec![0; 246])],
        "Data_Exchange 8 octets SD3" => vec![Sent::Sd3([0xC3; 8])],
        _ => return None,
    })
}

fn global_control(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Clear_Data to all" => [control(0x7F, &[0x02, 0]), control(0x7F, &[0x02, 0x81])].concat(),
        "Clear_Data to the slave" => control(SELF, &[0x02, 0]),
        "Clear_Data other group" => control(0x7F, &[0x02, 0xFE]),
        "Sync" => control(0x7F, &[0x20, 0]),
        "Freeze" => control(0x7F, &[0x08, 0]),
        "Operate" => commands(&[0x00, 0x04, 0x10, 0x0C, 0x30]),
        "Global_Control reserved" => commands(&[0x01, 0x40, 0x80, 0x03, 0x42, 0x82]),
        "Global_Control 1 octet" => [control(0x7F, &[0x02]), control(0x7F, &[])].concat(),
        "Global_Control 3 octets" => control(0x7F, &[0x02, 0, 0]),
        _ => return None,
    })
}

fn others(row: &str) -> Option<Vec<Sent>> {
    Some(match row {
        "Global_Control as SRD" => srd(0x3A, &[0x02, 0]),
        "other SAPs, SRD" => (0..=0x36).chain([0x3F]).flat_map(|sap| srd(sap, &[])).collect(),
        "all SAPs, SDA" => (0..=0x3F)
            .flat_map(|sap| [0x43, 0x45, 0x63, 0x65].map(|fc| Sent::Sda(fc, Some(sap), PRM.to_vec())))
            .collect(),
        "no SAP, SDA" => [0x43, 0x45, 0x63, 0x65].map(|fc| Sent::Sda(fc, None, vec![0xC3])).to_vec(),
        "all SAPs but 58, SDN" => (0..=0x3F)
            .filter(|&sap| sap != 0x3A)
            .flat_map(|sap| [0x44, 0x46].map(|fc| Sent::Sdn(fc, SELF, Some(sap), PRM.to_vec())))
            .collect(),
        "no SAP, SDN" => [0x44, 0x46, 0x66, 0x76].map(|fc| Sent::Sdn(fc, SELF, None, vec![0xC3])).to_vec(),
        "reserved functions" => {
            [0x40, 0xC0, 0x41, 0x42, 0x47, 0x48, 0x4A, 0x4B, 0x61, 0x72, 0x58, 0x7A, 0x5B, 0xC9, 0xED]
                .map(Sent::Bare)
                .to_vec()
        }
        "responses" => {
            [0x00, 0x01, 0x02, 0x03, 0x08, 0x09, 0x0A, 0x0C, 0x0D, 0x18, 0x38].map(Sent::Bare).to_vec()
        }
        _ => return None,
    })
}
