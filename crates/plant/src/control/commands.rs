//! What can be asked for, with an example of each; the same for `help`, for advice and for tests.

use serde::Serialize;

/// The request that everybody can begin with.
pub(super) const FIRST: &str = r#"{"do":"help"}"#;

/// One request as `help` explains it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct CommandHelp {
    /// What `do` has.
    pub name: &'static str,
    /// What it does.
    pub does: &'static str,
    /// A line that does it.
    pub example: &'static str,
}

const fn command(name: &'static str, does: &'static str, example: &'static str) -> CommandHelp {
    CommandHelp { name, does, example }
}

/// All requests.
pub const COMMANDS: &[CommandHelp] = &[
    command(
        "shaft",
        "another movement of the shaft: still@RAW, constant:RPM[@RAW] or KIND:NAME=VALUE with ramp, sine, move, hoist, trip, walk, playback, coupled, @here for where it is; or the same in fields",
        r#"{"do":"shaft","shaft":"constant:60@here"}"#,
    ),
    command(
        "supply",
        "the supply voltage: alarm outside 9 to 30, off below 6",
        r#"{"do":"supply","volts":8.5}"#,
    ),
    command(
        "temperature",
        "the temperature inside: warning above 65",
        r#"{"do":"temperature","celsius":66}"#,
    ),
    command("light", "the light of the LED: ok or low", r#"{"do":"light","state":"low"}"#),
    command("battery", "the battery: ok, low or empty", r#"{"do":"battery","state":"low"}"#),
    command("switches", "the rotary switches, for the next power-on", r#"{"do":"switches","switches":"2B"}"#),
    command("power", "the power: off, on or cycle", r#"{"do":"power","state":"cycle"}"#),
    command(
        "sensor",
        "a fault of the sensor: once, held, position_error, turns_lost (at the next power-on) or off",
        r#"{"do":"sensor","fault":"once"}"#,
    ),
    command(
        "memory",
        "a fault of the memory: writes_fail, damage_a, damage_b, lost_at_power_on, torn_write or off",
        r#"{"do":"memory","fault":"writes_fail"}"#,
    ),
    command(
        "operating_time",
        "the operating time that is stored, while the power is off",
        r#"{"do":"operating_time","hours":87600}"#,
    ),
    command("leave", "it is taken off the bus and keeps its power", r#"{"do":"leave","encoder":2}"#),
    command("join", "it is on the bus again", r#"{"do":"join","encoder":2}"#),
    command(
        "supply_profile",
        "a supply voltage over time: points of seconds and volts, with repeat for ever",
        r#"{"do":"supply_profile","points":[[0,24],[2,24],[2,5],[2.5,24]]}"#,
    ),
    command("brown_out", "another supply voltage for a time", r#"{"do":"brown_out","volts":8,"for_s":0.2}"#),
    command(
        "thermal",
        "the temperature inside runs after that around it and its own heat",
        r#"{"do":"thermal","ambient":40,"time_constant_s":600,"kelvin_per_watt":10}"#,
    ),
    command(
        "led_ageing",
        "the LED has so many hours under power left",
        r#"{"do":"led_ageing","hours":1000}"#,
    ),
    command(
        "discharge",
        "the battery gives its charge away: how long a full one lasts without power and with it",
        r#"{"do":"discharge","charge":50,"hours_without_power":8760}"#,
    ),
    command(
        "endurance",
        "how many writes the memory takes until it is worn out; null for any number",
        r#"{"do":"endurance","writes":100000}"#,
    ),
    command(
        "units",
        "the machine that turns the shaft, for its units in the snapshot; null for that of the shaft",
        r#"{"do":"units","machine":{"unit":"m","per_turn":0.5,"zero":65536}}"#,
    ),
    command(
        "termination",
        "the two termination switches of an encoder",
        r#"{"do":"termination","first":true,"second":true}"#,
    ),
    command(
        "cut",
        "the cable is cut after so many devices, the master among them",
        r#"{"do":"cut","after":2}"#,
    ),
    command("mend", "the cable is whole again", r#"{"do":"mend"}"#),
    command("reflections", "whether a wrong termination damages bits", r#"{"do":"reflections","on":true}"#),
    command(
        "line",
        "what goes wrong by chance, as shares from 0 to 1; alone: nothing any more",
        r#"{"do":"line","seed":7,"bit_errors":1e-5,"lost_replies":0.01}"#,
    ),
    command("lose_requests", "nobody hears the next requests", r#"{"do":"lose_requests","count":2}"#),
    command(
        "lose_replies",
        "the master does not hear the next replies",
        r#"{"do":"lose_replies","count":2}"#,
    ),
    command("double_requests", "the next requests are heard twice", r#"{"do":"double_requests","count":1}"#),
    command("double_replies", "the next replies come twice", r#"{"do":"double_replies","count":1}"#),
    command("delay_replies", "the next replies come late", r#"{"do":"delay_replies","by_us":500,"count":1}"#),
    command(
        "damage_request",
        "bits of an octet of the next request flip unseen by the parity",
        r#"{"do":"damage_request","octet":4,"mask":"81"}"#,
    ),
    command(
        "damage_reply",
        "bits of an octet of the next reply flip",
        r#"{"do":"damage_reply","octet":8,"mask":"01"}"#,
    ),
    command(
        "character_error",
        "a character of the next request has a wrong parity",
        r#"{"do":"character_error","octet":3}"#,
    ),
    command("snapshot", "everything as it is now, or one encoder", r#"{"do":"snapshot","encoder":1}"#),
    command("subscribe", "what happens is told on this connection", r#"{"do":"subscribe"}"#),
    command("unsubscribe", "it is not any more", r#"{"do":"unsubscribe"}"#),
    command("help", "this list", FIRST),
    command("shutdown", "the program ends in order", r#"{"do":"shutdown"}"#),
];

/// What to write instead of something that cannot be read.
pub(super) fn advice(name: &str, error: &str) -> String {
    if let Some(command) = COMMANDS.iter().find(|command| command.name == name) {
        return format!("{name}: {error}; write for example {}", command.example);
    }
    let name: String = name.chars().take(40).collect();
    format!("there is no request {name:?}; {FIRST} lists those that there are")
}
