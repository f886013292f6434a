//! The three functionalities (manual 4) and what each exchanges (manual 4.1 to 4.3).
//!
//! | functionality | configuration | outputs | inputs | Set_Prm | Slave_Diag |
//! |---|---|---|---|---|---|
//! | class 1 | D1 | 0 | 4 | 9 octets | 16 octets |
//! | class 2 | F1 | 4 | 4 | 25 octets | 57 octets |
//! | Scancon 2.0 | F1 D1 D1 or F1 D3 | 4 | 12 | 26 octets | 57 octets |

use core::fmt;

use profibus_dp::wire::chk_cfg::Lengths;

use crate::parameterization::ParameterLength;

/// What the master made of the device (manual 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Functionality {
    /// Class 1 Multiturn: the position, in either direction.
    Class1,
    /// Class 2 Multiturn: also scaling and preset.
    Class2,
    /// Scancon 2.0 Multiturn: also velocity and acceleration.
    Scancon2,
}

impl Functionality {
    /// All three, poorest first.
    pub const ALL: [Self; 3] = [Self::Class1, Self::Class2, Self::Scancon2];

    /// Input octets, seen from the master: 4 or 12 (manual 4.3).
    pub const fn inputs(self) -> u8 {
        match self {
            Self::Class1 | Self::Class2 => 4,
            Self::Scancon2 => 12,
        }
    }

    /// Output octets, seen from the master: 0 or 4 (manual 4.3).
    pub const fn outputs(self) -> u8 {
        match self {
            Self::Class1 => 0,
            Self::Class2 | Self::Scancon2 => 4,
        }
    }

    /// Octets of Set_Prm that it needs at least: 9, 25 or 26 (manual 4.1).
    pub const fn parameter_octets(self) -> u8 {
        self.parameter_length().octets()
    }

    /// The length of Set_Prm that has just what it needs (manual 4.1).
    pub const fn parameter_length(self) -> ParameterLength {
        match self {
            Self::Class1 => ParameterLength::Nine,
            Self::Class2 => ParameterLength::TwentyFive,
            Self::Scancon2 => ParameterLength::TwentySix,
        }
    }

    /// Reading: outside data exchange Get_Cfg names the configuration of the functionality that
    /// needs just the length of the last good Set_Prm.
    pub const fn of_parameter_length(length: ParameterLength) -> Self {
        match length {
            ParameterLength::Nine => Self::Class1,
            ParameterLength::TwentyFive => Self::Class2,
            ParameterLength::TwentySix => Self::Scancon2,
        }
    }

    /// Octets of the whole diagnosis in data exchange: 16 or 57 (manual 4.2.1).
    pub const fn diagnosis_octets(self) -> u8 {
        match self {
            Self::Class1 => 16,
            Self::Class2 | Self::Scancon2 => 57,
        }
    }

    /// Reading: the configurations that choose it, the one that Get_Cfg names first. The maker's
    /// own octets for Scancon 2.0 are not public.
    #[doc(alias = "Cfg_Data")]
    pub const fn configurations(self) -> &'static [&'static [u8]] {
        match self {
            Self::Class1 => &[&[0xD1]],
            Self::Class2 => &[&[0xF1]],
            Self::Scancon2 => &[&[0xF1, 0xD1, 0xD1], &[0xF1, 0xD3]],
        }
    }

    /// The configuration that Get_Cfg names for it.
    pub const fn configuration(self) -> &'static [u8] {
        match self.configurations() {
            [first, ..] => first,
            [] => &[],
        }
    }

    /// Both numbers of octets in data exchange.
    pub const fn lengths(self) -> Lengths {
        Lengths { inputs: self.inputs(), outputs: self.outputs() }
    }

    /// Reading: parameters longer than the functionality needs are fine, shorter are not.
    pub const fn satisfied_by(self, length: ParameterLength) -> bool {
        length.octets() >= self.parameter_octets()
    }
}

impl fmt::Display for Functionality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Class1 => "class 1",
            Self::Class2 => "class 2",
            Self::Scancon2 => "Scancon 2.0",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // An identifier octet of the compact format: bits 0-3 length - 1, bit 4 inputs, bit 5
    // outputs, bit 6 words, bit 7 consistency over the whole (EN 50170).
    fn lengths(configuration: &[u8]) -> (u32, u32) {
        configuration.iter().fold((0, 0), |(inputs, outputs), &octet| {
            let octets = (u32::from(octet & 0x0F) + 1) * if octet & 0x40 == 0 { 1 } else { 2 };
            (
                inputs + if octet & 0x10 == 0 { 0 } else { octets },
                outputs + if octet & 0x20 == 0 { 0 } else { octets },
            )
        })
    }

    #[test]
    fn each_configuration_has_the_lengths_of_its_functionality() {
        for functionality in Functionality::ALL {
            for own in functionality.configurations() {
                let expected = (functionality.inputs().into(), functionality.outputs().into());
                assert_eq!(lengths(own), expected, "{functionality} {own:02X?}");
            }
        }
    }

    // Manual 4.1, 4.2.1, 4.3.
    #[test]
    fn the_lengths_are_the_manuals() {
        let lengths = |functionality: Functionality| {
            let (outputs, inputs) = (functionality.outputs(), functionality.inputs());
            [outputs, inputs, functionality.parameter_octets(), functionality.diagnosis_octets()]
        };
        let expected = [[0, 4, 9, 16], [4, 4, 25, 57], [4, 12, 26, 57]];
        assert_eq!(Functionality::ALL.map(lengths), expected);
    }

    #[test]
    fn get_cfg_names_the_first_configuration() {
        let named = Functionality::ALL.map(Functionality::configuration);
        assert_eq!(named, [&[0xD1][..], &[0xF1], &[0xF1, 0xD1, 0xD1]]);
    }

    #[test]
    fn longer_parameters_than_needed_are_fine() {
        use ParameterLength::{Nine, TwentyFive, TwentySix};
        let fits = |functionality: Functionality| {
            [Nine, TwentyFive, TwentySix].map(|length| functionality.satisfied_by(length))
        };
        assert_eq!(fits(Functionality::Class1), [true, true, true]);
        assert_eq!(fits(Functionality::Class2), [false, true, true]);
        assert_eq!(fits(Functionality::Scancon2), [false, false, true]);
        for functionality in Functionality::ALL {
            let length = functionality.parameter_length();
            assert_eq!(Functionality::of_parameter_length(length), functionality);
        }
    }
}
