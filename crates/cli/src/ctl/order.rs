//! In which order people want to see the values of a snapshot: who and how first, what was counted last.

/// The names that come first, in this order; the others follow as they are.
const FIRST: [&str; 41] = [
    "name",
    "device",
    "address",
    "state",
    "master",
    "alarms",
    "warnings",
    "reasons",
    "position",
    "velocity",
    "acceleration",
    "offset",
    "functionality",
    "code_sequence",
    "measuring_units_per_revolution",
    "total_measuring_range",
    "physical_position",
    "stored_address",
    "rate",
    "operating_time_hours",
    "port",
    "termination",
    "machine",
    "shaft",
    "shaft_position",
    "rpm",
    "unit",
    "rope_layer",
    "volts",
    "celsius",
    "light",
    "battery",
    "switches",
    "bits",
    "ident_number",
    "serial_number",
    "injected",
    "line",
    "cable",
    "waiting_request_faults",
    "waiting_reply_faults",
];

/// Where a value stands; equal ones stay in the order that they had.
pub(super) fn place(name: &str) -> usize {
    FIRST.iter().position(|first| *first == name).unwrap_or(FIRST.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_and_how_comes_before_what_was_counted() {
        let mut names =
            ["acceleration", "alarms", "at_ns", "counters", "device", "name", "position", "volts"];
        names.sort_by_key(|name| place(name));
        assert_eq!(
            names,
            ["name", "device", "alarms", "position", "acceleration", "volts", "at_ns", "counters"]
        );
    }
}
