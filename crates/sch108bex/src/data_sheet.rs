//! The data sheet: the device's figures (manual 3.1, 3.2, 5, 6) for people to read.
//!
//! They describe the device of metal; the software has the electrical ones that it can have.

/// One figure of the data sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Which part of the data sheet it belongs to.
    pub group: Group,
    /// What it is.
    pub name: &'static str,
    /// The figure with its unit.
    pub value: &'static str,
    /// The section of the manual that has it.
    pub section: &'static str,
}

/// The parts of the data sheet, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Group {
    /// Electrical and bus figures (manual 6).
    Electrical,
    /// Material, weight, shaft (manual 6).
    Mechanical,
    /// Temperature, shock, enclosure (manual 6).
    Environmental,
    /// Terminals and cable outlets (manual 3.2, 6).
    Connections,
    /// Fits of bore and shaft (manual 5).
    Tolerances,
    /// Torques and lengths for mounting (manual 3.1, 3.2).
    Mounting,
}

impl Group {
    /// The heading, in English.
    pub const fn heading(self) -> &'static str {
        match self {
            Self::Electrical => "Electrical",
            Self::Mechanical => "Mechanical",
            Self::Environmental => "Environmental",
            Self::Connections => "Connections",
            Self::Tolerances => "Mechanical tolerances",
            Self::Mounting => "Mounting",
        }
    }
}

/// The rows of a group.
const fn row(group: Group, section: &'static str, name: &'static str, value: &'static str) -> Row {
    Row { group, name, value, section }
}

/// The whole data sheet, group by group.
///
/// Reading: the manual's "32,678" revolutions are a misprint for 32,768, 2^15.
pub static DATA_SHEET: &[Row] = &[
    row(Group::Electrical, "6", "Encoder type", "absolute multiturn encoder"),
    row(Group::Electrical, "6", "Code", "binary"),
    row(
        Group::Electrical,
        "6",
        "Protocol",
        "PROFIBUS DP-V0, Profile for Absolute Encoders 1.1, class 1 and class 2",
    ),
    row(Group::Electrical, "6", "Revolutions", "at most 32,768 (15 bits)"),
    row(Group::Electrical, "6", "Steps per revolution", "at most 65,536 (16 bits)"),
    row(
        Group::Electrical,
        "6",
        "Addressing",
        "rotary switches in the removable end cap, or Change Station Address over the bus",
    ),
    row(Group::Electrical, "6", "Address range", "1 to 126"),
    row(Group::Electrical, "6", "Baud rate", "all standard rates from 9,600 baud to 12 Mbaud"),
    row(Group::Electrical, "6", "Update rate", "2000 updates per second"),
    row(Group::Electrical, "6", "Termination resistors", "switched on and off in the removable end cap"),
    row(Group::Electrical, "6", "Supply voltage", "9 V to 30 V"),
    row(Group::Electrical, "6", "Current, typical, no load", "150 mA at 10 V, 70 mA at 24 V"),
    row(Group::Electrical, "6", "Power", "below 2.0 W"),
    row(Group::Electrical, "6", "Protection", "against reverse polarity"),
    row(Group::Electrical, "6", "Noise immunity", "tested to EN 61000-6-2:2005 and EN 61000-6-3:2007"),
    row(
        Group::Mechanical,
        "6",
        "Housing",
        "aluminium, treated with Chromital TCP; stainless steel (AISI 316) as an option",
    ),
    row(Group::Mechanical, "6", "Hollow shaft", "stainless steel (AISI 316)"),
    row(Group::Mechanical, "6", "Weight, aluminium", "2.4 kg (5.29 lb)"),
    row(Group::Mechanical, "6", "Weight, stainless steel", "5.5 kg (12.13 lb)"),
    row(Group::Mechanical, "6", "Bearing life", "more than 1.9 x 10^10 revolutions at rated load"),
    row(Group::Mechanical, "6", "Shaft speed", "at most 3000 RPM, continuous"),
    row(Group::Mechanical, "6", "Starting torque", "below 0.4 Nm (56 oz-in) at 25 degrees C"),
    row(Group::Mechanical, "6", "Mass moment of inertia", "1.62 kgcm2 (8.9 oz-in2)"),
    row(Group::Mechanical, "6", "Shaft load, axial", "at most 250 N (56 lb)"),
    row(Group::Mechanical, "6", "Shaft load, radial", "at most 500 N (112 lb)"),
    row(Group::Environmental, "6", "Operating temperature", "-40 to +70 degrees C"),
    row(Group::Environmental, "6", "Storage temperature", "-40 to +85 degrees C"),
    row(Group::Environmental, "6", "Shock", "100 g for 11 ms"),
    row(Group::Environmental, "6", "Vibration", "10 g at 10 to 2000 Hz"),
    row(Group::Environmental, "6", "Bump", "10 g for 16 ms, 1000 times in each of 3 axes"),
    row(Group::Environmental, "6", "Humidity", "98 % relative, without condensation"),
    row(Group::Environmental, "6", "Enclosure", "IP67 / about NEMA 6"),
    row(
        Group::Connections,
        "6",
        "Terminals",
        "two 5-pin blocks in the removable end cap, bus in and bus out",
    ),
    row(Group::Connections, "3.2", "VSUP", "supply, 9 V to 30 V"),
    row(Group::Connections, "3.2", "GND", "0 V of the supply (circuit ground)"),
    row(Group::Connections, "3.2", "A-LINE", "negative data line"),
    row(Group::Connections, "3.2", "B-LINE", "positive data line"),
    row(Group::Connections, "3.2", "Shield", "to case ground by the blue cable shoes, never left open"),
    row(
        Group::Connections,
        "6",
        "Cable outlets",
        "M20, M25 and 1/2 inch NPT threads; certified Ex d cable glands required",
    ),
    row(Group::Tolerances, "5", "Hollow bore, over 18 to 30 mm", "H7 (+0 / +0.021 mm)"),
    row(Group::Tolerances, "5", "Hollow bore, over 30 to 40 mm", "H7 (+0 / +0.025 mm)"),
    row(Group::Tolerances, "5", "Shaft, over 18 to 30 mm", "g6 (-0.007 / -0.020 mm), recommended"),
    row(Group::Tolerances, "5", "Shaft, over 30 to 40 mm", "g6 (-0.007 / -0.025 mm), recommended"),
    row(Group::Tolerances, "5", "Standard of the fits", "ISO 286-2, ANSI B4.2"),
    row(
        Group::Tolerances,
        "5",
        "Shaft runout (TIR), recommended",
        "+/- 0.05 mm (0.002 inch), NEMA MG1 4.9.7",
    ),
    row(Group::Mounting, "3.1", "Clamp of the hollow bore", "at most 1.5 Nm (13.3 lbf-in)"),
    row(Group::Mounting, "3.2", "Screws of the end cap", "at most 6 Nm (53 lbf-in)"),
    row(Group::Mounting, "3.2", "Length of each wire", "75 mm (3 inches)"),
];

#[cfg(test)]
mod tests {
    use super::*;

    // R6-8: every figure of manual 5 and 6 can be found. The numbers are the manual's.
    #[test]
    fn every_figure_of_the_manual_is_there() {
        let figures = [
            (Group::Electrical, "32,768"),
            (Group::Electrical, "65,536"),
            (Group::Electrical, "1 to 126"),
            (Group::Electrical, "9,600 baud to 12 Mbaud"),
            (Group::Electrical, "2000 updates"),
            (Group::Electrical, "9 V to 30 V"),
            (Group::Electrical, "150 mA at 10 V, 70 mA at 24 V"),
            (Group::Electrical, "2.0 W"),
            (Group::Electrical, "61000-6-2:2005"),
            (Group::Electrical, "61000-6-3:2007"),
            (Group::Mechanical, "AISI 316"),
            (Group::Mechanical, "2.4 kg (5.29 lb)"),
            (Group::Mechanical, "5.5 kg (12.13 lb)"),
            (Group::Mechanical, "1.9 x 10^10"),
            (Group::Mechanical, "3000 RPM"),
            (Group::Mechanical, "0.4 Nm (56 oz-in) at 25"),
            (Group::Mechanical, "1.62 kgcm2 (8.9 oz-in2)"),
            (Group::Mechanical, "250 N (56 lb)"),
            (Group::Mechanical, "500 N (112 lb)"),
            (Group::Environmental, "-40 to +70"),
            (Group::Environmental, "-40 to +85"),
            (Group::Environmental, "100 g for 11 ms"),
            (Group::Environmental, "10 to 2000 Hz"),
            (Group::Environmental, "16 ms, 1000 times in each of 3 axes"),
            (Group::Environmental, "98 %"),
            (Group::Environmental, "IP67"),
            (Group::Connections, "5-pin"),
            (Group::Connections, "M20, M25 and 1/2 inch NPT"),
            (Group::Tolerances, "+0.021"),
            (Group::Tolerances, "H7 (+0 / +0.025"),
            (Group::Tolerances, "-0.020"),
            (Group::Tolerances, "g6 (-0.007 / -0.025"),
            (Group::Tolerances, "0.05 mm (0.002 inch)"),
            (Group::Mounting, "1.5 Nm (13.3 lbf-in)"),
            (Group::Mounting, "6 Nm (53 lbf-in)"),
            (Group::Mounting, "75 mm"),
        ];
        for (group, figure) in figures {
            let found = DATA_SHEET.iter().any(|row| row.group == group && row.value.contains(figure));
            assert!(found, "{group:?} {figure}");
        }
    }

    #[test]
    fn rows_stand_group_by_group() {
        assert!(DATA_SHEET.is_sorted_by_key(|row| row.group));
        assert!(!DATA_SHEET.iter().any(|row| row.value.contains("32,678")));
    }

    // What the device works with and what the data sheet says must not drift apart.
    #[test]
    fn the_figures_are_those_that_the_device_works_with() {
        use crate::specification as specified;
        use std::format;
        let value = |name| DATA_SHEET.iter().find(|row| row.name == name).unwrap().value;
        let (low, high) = (specified::SUPPLY_MIN_MV / 1000, specified::SUPPLY_MAX_MV / 1000);
        assert_eq!(value("Supply voltage"), format!("{low} V to {high} V"));
        let updates = 1_000_000_000 / specified::LATCH_PERIOD.as_nanos();
        assert_eq!(value("Update rate"), format!("{updates} updates per second"));
        assert!(value("Shaft speed").contains(&format!("{}", specified::SHAFT_SPEED_MAX_RPM)));
    }
}
