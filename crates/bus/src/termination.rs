//! Whether a bus is terminated where it has to be.
//!
//! A bus is one cable with a resistor network at each of its two ends and nowhere else. A device
//! that has the network built in switches it on and off with two switches, which belong together.
//!
//! | where in the cable | both on | both off | one on, one off |
//! |---|---|---|---|
//! | first or last | right | wrong | wrong |
//! | between | wrong | right | wrong |

use std::fmt;

/// One device as it stands in the cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tap<'a> {
    /// What a reader knows it by.
    pub name: &'a str,
    /// Whether each of its two switches is on.
    pub switches: [bool; 2],
}

/// What is wrong with one device's switches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Complaint<'a> {
    /// The device.
    pub name: &'a str,
    /// What is wrong.
    pub fault: Fault,
}

/// What can be wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Fault {
    /// Both off at an end of the cable.
    EndIsOff,
    /// Both on between the ends.
    MiddleIsOn,
    /// One on, one off, at an end of the cable.
    MixedAtEnd,
    /// One on, one off, between the ends.
    MixedInTheMiddle,
}

/// Says what is wrong with a bus, device by device, in the order of the cable; nothing if it is
/// terminated well. A device that is alone on its cable is both ends of it.
pub fn judge<'a>(cable: &[Tap<'a>]) -> Vec<Complaint<'a>> {
    let last = cable.len().saturating_sub(1);
    let complaints = cable.iter().enumerate().filter_map(|(place, tap)| {
        let fault = fault(tap.switches, place == 0 || place == last)?;
        Some(Complaint { name: tap.name, fault })
    });
    complaints.collect()
}

/// What is wrong with one device's switches.
const fn fault(switches: [bool; 2], at_end: bool) -> Option<Fault> {
    match (switches, at_end) {
        ([true, true], true) | ([false, false], false) => None,
        ([false, false], true) => Some(Fault::EndIsOff),
        ([true, true], false) => Some(Fault::MiddleIsOn),
        (_, true) => Some(Fault::MixedAtEnd),
        (_, false) => Some(Fault::MixedInTheMiddle),
    }
}

impl fmt::Display for Complaint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, fault } = self;
        match fault {
            Fault::EndIsOff => write!(
                f,
                "{name}: both termination switches are off, but it is an end of the bus: switch both on"
            ),
            Fault::MiddleIsOn => write!(
                f,
                "{name}: both termination switches are on, but it is no end of the bus: switch both off"
            ),
            Fault::MixedAtEnd => write!(
                f,
                "{name}: one termination switch is on and one off; it is an end of the bus: switch both on"
            ),
            Fault::MixedInTheMiddle => write!(
                f,
                "{name}: one termination switch is on and one off; it is no end of the bus: switch both off"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ON: [bool; 2] = [true, true];
    const OFF: [bool; 2] = [false, false];

    fn bus<'a>(switches: &[(&'a str, [bool; 2])]) -> Vec<Tap<'a>> {
        switches.iter().map(|&(name, switches)| Tap { name, switches }).collect()
    }

    fn words(switches: &[(&str, [bool; 2])]) -> Vec<String> {
        judge(&bus(switches)).iter().map(ToString::to_string).collect()
    }

    // Manual 3.3.
    #[test]
    fn a_bus_ended_at_both_ends_is_right() {
        assert_eq!(
            words(&[("master", ON), ("encoder 3", OFF), ("encoder 4", OFF), ("encoder 5", ON)]),
            [""; 0]
        );
        assert_eq!(words(&[("encoder 3", ON), ("encoder 4", ON)]), [""; 0]);
        assert_eq!(words(&[("encoder 3", ON)]), [""; 0]);
        assert_eq!(words(&[]), [""; 0]);
    }

    #[test]
    fn a_middle_that_is_on_is_wrong() {
        assert_eq!(
            words(&[("master", ON), ("encoder 3", ON), ("encoder 4", ON)]),
            ["encoder 3: both termination switches are on, but it is no end of the bus: switch both off"]
        );
    }

    #[test]
    fn an_end_that_is_off_is_wrong() {
        let off = "both termination switches are off, but it is an end of the bus: switch both on";
        assert_eq!(words(&[("master", ON), ("encoder 3", OFF)]), [format!("encoder 3: {off}")]);
        assert_eq!(words(&[("encoder 3", OFF), ("master", ON)]), [format!("encoder 3: {off}")]);
        assert_eq!(words(&[("encoder 3", OFF)]), [format!("encoder 3: {off}")]);
    }

    #[test]
    fn one_switch_on_and_one_off_is_wrong_everywhere() {
        for mixed in [[true, false], [false, true]] {
            assert_eq!(
                words(&[("a", mixed), ("b", mixed), ("c", mixed)]),
                [
                    "a: one termination switch is on and one off; it is an end of the bus: switch both on",
                    "b: one termination switch is on and one off; it is no end of the bus: switch both off",
                    "c: one termination switch is on and one off; it is an end of the bus: switch both on",
                ]
            );
        }
    }

    #[test]
    fn every_bus_of_up_to_five_devices() {
        let names = ["a", "b", "c", "d", "e"];
        for devices in 1..=names.len() {
            for setting in 0..1_u32 << (2 * devices) {
                let switch = |bit: usize| setting >> bit & 1 == 1;
                let taps = (0..devices).map(|at| (names[at], [switch(2 * at), switch(2 * at + 1)]));
                let taps: Vec<_> = taps.collect();
                let wrong = judge(&bus(&taps)).into_iter().map(|complaint| complaint.name);
                let due = taps.iter().enumerate().filter(|(at, (_, switches))| {
                    let end = *at == 0 || at + 1 == devices;
                    *switches != [end; 2]
                });
                let due = due.map(|(_, (name, _))| *name);
                assert!(wrong.eq(due), "{taps:?}");
            }
        }
    }
}
