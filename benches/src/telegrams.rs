//! The requests of the figures, as octets. Also part of the image for the Cortex-M4.

/// The encoder's address in all figures: switches at 2A.
pub(crate) const ADDRESS: u8 = 42;
const MASTER: u8 = 2;
const IDENT: [u8; 2] = [0x10, 0x8b];

/// SRD, high: the first request after a silence, and then with the FCB one and the other way.
pub(crate) const FIRST: u8 = 0x6d;
pub(crate) const FCB: [u8; 2] = [0x5d, 0x7d];

/// Units a revolution and in all: scaling as it is used, neither a power of two, and 32768 turns
/// more than the range.
pub(crate) const MEASURING_UNITS: u32 = 3_600;
pub(crate) const MEASURING_RANGE: u32 = 100_000_000;

/// A telegram of at most 255 octets.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Octets {
    buffer: [u8; 255],
    length: usize,
}

impl Octets {
    const EMPTY: Self = Self { buffer: [0; 255], length: 0 };

    pub(crate) fn as_slice(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    fn push(&mut self, octet: u8) {
        self.buffer[self.length] = octet;
        self.length += 1;
    }

    /// The check sum of what follows the start, and the end.
    fn close(&mut self, start: usize) {
        let sum = self.buffer[start..self.length].iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
        self.push(sum);
        self.push(0x16);
    }
}

/// SD1: a request without data.
pub(crate) fn sd1(to: u8, function_code: u8) -> Octets {
    let mut telegram = Octets::EMPTY;
    for octet in [0x10, to, MASTER, function_code] {
        telegram.push(octet);
    }
    telegram.close(1);
    telegram
}

/// SD2: a request with data, for a service access point or for none.
pub(crate) fn sd2(to: u8, function_code: u8, saps: Option<[u8; 2]>, data: &[u8]) -> Octets {
    let extension = if saps.is_some() { 0x80 } else { 0 };
    let mut telegram = Octets::EMPTY;
    let saps = saps.as_ref().map_or(&[][..], |saps| &saps[..]);
    let length = u8::try_from(3 + saps.len() + data.len()).unwrap_or(u8::MAX);
    let head = [0x68, length, length, 0x68, to | extension, MASTER | extension, function_code];
    for octet in head.iter().chain(saps).chain(data) {
        telegram.push(*octet);
    }
    telegram.close(4);
    telegram
}

/// Which of the encoder's functionalities a figure is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Functionality {
    /// 4 inputs.
    Class2,
    /// 12 inputs.
    Scancon20,
}

impl Functionality {
    /// How long the answer to a Data_Exchange is: SD2 around the inputs.
    pub(crate) const fn answer(self) -> usize {
        match self {
            Self::Class2 => 9 + 4,
            Self::Scancon20 => 9 + 12,
        }
    }
}

/// Set_Prm from its first octet on, and Chk_Cfg.
///
/// The watchdog is on, at 100 s.
pub(crate) fn parameters(functionality: Functionality) -> ([u8; 26], usize, &'static [u8]) {
    // Lock and watchdog; its factors; min T_SDR; ident; group; the slave ASIC's octet; class 2
    // with scaling, counter-clockwise: a shaft that turns clockwise from 0 is at the end of the
    // physical range, where the position is beyond the measuring range and has to be divided.
    let mut parameters = [0; 26];
    parameters[..9].copy_from_slice(&[0x88, 100, 100, 11, IDENT[0], IDENT[1], 0, 0, 0x0b]);
    parameters[9..13].copy_from_slice(&MEASURING_UNITS.to_be_bytes());
    parameters[13..17].copy_from_slice(&MEASURING_RANGE.to_be_bytes());
    parameters[25] = 3; // Time base RPM, the dearest.
    match functionality {
        Functionality::Class2 => (parameters, 25, &[0xf1]),
        Functionality::Scancon20 => (parameters, 26, &[0xf1, 0xd1, 0xd1]),
    }
}

/// What brings the encoder to data exchange: diagnosis, parameters, configuration, diagnosis.
///
/// The last of the four leaves the FCB so that [`exchange`] begins with the first of [`FCB`].
pub(crate) fn start_up(functionality: Functionality) -> [Octets; 4] {
    start_up_at(ADDRESS, functionality)
}

/// The same for an encoder with another address.
pub(crate) fn start_up_at(address: u8, functionality: Functionality) -> [Octets; 4] {
    let (parameters, length, configuration) = parameters(functionality);
    [
        sd2(address, FIRST, Some([60, 62]), &[]),
        sd2(address, FCB[0], Some([61, 62]), &parameters[..length]),
        sd2(address, FCB[1], Some([62, 62]), configuration),
        sd2(address, FIRST, Some([60, 62]), &[]),
    ]
}

/// A Data_Exchange with outputs 0, for the one FCB and for the other.
pub(crate) fn exchange() -> [Octets; 2] {
    exchange_at(ADDRESS)
}

/// The same with an encoder at another address.
pub(crate) fn exchange_at(address: u8) -> [Octets; 2] {
    FCB.map(|function_code| sd2(address, function_code, None, &[0; 4]))
}

/// A telegram for another station: as short as they come.
pub(crate) fn foreign_6() -> Octets {
    sd1(ADDRESS + 1, FIRST)
}

/// A telegram for another station: as long as they come.
pub(crate) fn foreign_255() -> Octets {
    sd2(ADDRESS + 1, FCB[0], None, &[0x55; 246])
}
