//! What can be asked of a running plant.

use serde::{Deserialize, Serialize};

use crate::control::target::Which;
use crate::control::values::{BatteryState, Light, MemoryFault, Power, SensorFault, ShaftSpec};
use crate::machine::Machine;

/// A request. In JSON `do` names it, and its fields stand beside.
///
/// Where `encoder` is left out, the only one is meant; `"all"` means each of them. The same holds for
/// `segment`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Another movement of the shaft, from now on.
    Shaft {
        /// Which encoder.
        encoder: Option<Which>,
        /// The movement.
        shaft: ShaftSpec,
    },
    /// Another supply voltage.
    Supply {
        /// Which encoder.
        encoder: Option<Which>,
        /// -100 to 100; below 6 V and with reversed poles the device is off.
        volts: f64,
    },
    /// A supply voltage that changes over time, in straight lines through points.
    SupplyProfile {
        /// Which encoder.
        encoder: Option<Which>,
        /// Seconds from now and volts, in order of time; two at one time are a jump. The last one stays.
        points: Vec<(f64, f64)>,
        /// At the time of the last point it begins anew.
        #[serde(default)]
        repeat: bool,
    },
    /// Another supply voltage for a time, then that of before again.
    BrownOut {
        /// Which encoder.
        encoder: Option<Which>,
        /// -100 to 100.
        volts: f64,
        /// Seconds.
        for_s: f64,
    },
    /// From now on the temperature inside runs after that around and the heat of the encoder itself.
    Thermal {
        /// Which encoder.
        encoder: Option<Which>,
        /// Degrees Celsius around it.
        ambient: f64,
        /// Seconds until 63 percent of a change have come.
        #[serde(default = "ten_minutes")]
        time_constant_s: f64,
        /// By how much a watt warms it.
        #[serde(default)]
        kelvin_per_watt: f64,
        /// What it takes from its supply: 70 mA at 24 V (manual 6) if left out.
        #[serde(default = "usual_watts")]
        watts: f64,
    },
    /// The LED ages: its reserve lasts for so much more time under power.
    LedAgeing {
        /// Which encoder.
        encoder: Option<Which>,
        /// Hours.
        hours: f64,
    },
    /// The battery gives its charge away.
    Discharge {
        /// Which encoder.
        encoder: Option<Which>,
        /// Percent that are in it now.
        #[serde(default = "hundred")]
        charge: f64,
        /// Percent below which it is low.
        #[serde(default = "twenty")]
        low: f64,
        /// How many hours a full one lasts without external power.
        hours_without_power: f64,
        /// And with it; left out: for ever.
        hours_with_power: Option<f64>,
    },
    /// How many writes the memory takes until it is worn out.
    Endurance {
        /// Which encoder.
        encoder: Option<Which>,
        /// As `memory_writes` in the snapshot counts them; `null`: any number.
        writes: Option<u64>,
    },
    /// The machine that turns the shaft, for its units in the snapshot.
    Units {
        /// Which encoder.
        encoder: Option<Which>,
        /// The machine; `null`: that of the shaft.
        machine: Option<Machine>,
    },
    /// The two termination switches of an encoder (manual 3.3).
    Termination {
        /// Which encoder.
        encoder: Option<Which>,
        /// The first is on.
        first: bool,
        /// The second is on.
        second: bool,
    },
    /// The cable is cut: who is on the far side from the master is not heard, and hears nothing.
    Cut {
        /// Which segment.
        segment: Option<Which>,
        /// So many devices, the master among them, are in front of the cut.
        after: usize,
        /// So many encoders are in front of the master; left out: as many as there were, 0 at first.
        master_after: Option<usize>,
    },
    /// The cable is whole again.
    Mend {
        /// Which segment.
        segment: Option<Which>,
    },
    /// Whether a wrong termination damages bits.
    Reflections {
        /// Which segment.
        segment: Option<Which>,
        /// Whether it does.
        on: bool,
    },
    /// Another temperature inside.
    Temperature {
        /// Which encoder.
        encoder: Option<Which>,
        /// -300 to 300.
        celsius: f64,
    },
    /// The light of the LED.
    Light {
        /// Which encoder.
        encoder: Option<Which>,
        /// How much there is.
        state: Light,
    },
    /// The battery that keeps the turn count.
    Battery {
        /// Which encoder.
        encoder: Option<Which>,
        /// Its state.
        state: BatteryState,
    },
    /// The rotary switches are turned; they count at the next power-on (manual 3.4).
    Switches {
        /// Which encoder.
        encoder: Option<Which>,
        /// Two hexadecimal digits, X16 first.
        switches: String,
    },
    /// The power, without warning.
    Power {
        /// Which encoder.
        encoder: Option<Which>,
        /// Off, on, or off and on at once.
        state: Power,
    },
    /// Something wrong with the sensor or the position.
    Sensor {
        /// Which encoder.
        encoder: Option<Which>,
        /// What.
        fault: SensorFault,
    },
    /// Something wrong with the non-volatile memory.
    Memory {
        /// Which encoder.
        encoder: Option<Which>,
        /// What.
        fault: MemoryFault,
    },
    /// The operating time that is stored (manual 4.2.13), while the power is off.
    OperatingTime {
        /// Which encoder.
        encoder: Option<Which>,
        /// 0 to 10 000 000, kept to a hundredth.
        hours: f64,
    },
    /// It is taken off the bus, and keeps its power: it hears nothing and nobody hears it.
    Leave {
        /// Which encoder.
        encoder: Option<Which>,
    },
    /// It is on the bus again.
    Join {
        /// Which encoder.
        encoder: Option<Which>,
    },
    /// What goes wrong on the line by chance. What is left out does not; alone: a quiet line, and no
    /// fault by request waits any more.
    Line {
        /// Which segment.
        segment: Option<Which>,
        /// Where chance begins.
        #[serde(default)]
        seed: u64,
        /// The share of bits that flip.
        #[serde(default)]
        bit_errors: f64,
        /// The share of characters with a wrong parity.
        #[serde(default)]
        character_errors: f64,
        /// The share of requests that nobody hears.
        #[serde(default)]
        lost_requests: f64,
        /// The share of replies that the master does not hear.
        #[serde(default)]
        lost_replies: f64,
        /// The share of requests that are heard twice.
        #[serde(default)]
        doubled_requests: f64,
        /// The share of replies that come twice.
        #[serde(default)]
        doubled_replies: f64,
        /// The share of replies that come late.
        #[serde(default)]
        late_replies: f64,
        /// How late, in microseconds; at most 10 s.
        #[serde(default)]
        late_by_us: u64,
        /// The share of characters with which a burst of noise begins.
        #[serde(default)]
        bursts: f64,
        /// How many characters a burst lasts on average.
        #[serde(default = "ten")]
        burst_length: f64,
        /// The share of bits that flip within a burst.
        #[serde(default = "tenth")]
        burst_bit_errors: f64,
    },
    /// The next requests to an encoder are heard by nobody.
    LoseRequests {
        /// Which segment.
        segment: Option<Which>,
        /// How many, 1 to 1000.
        #[serde(default = "one")]
        count: usize,
    },
    /// The next replies are not heard by the master.
    LoseReplies {
        /// Which segment.
        segment: Option<Which>,
        /// How many, 1 to 1000.
        #[serde(default = "one")]
        count: usize,
    },
    /// The next requests to an encoder are heard twice.
    DoubleRequests {
        /// Which segment.
        segment: Option<Which>,
        /// How many, 1 to 1000.
        #[serde(default = "one")]
        count: usize,
    },
    /// The next replies come twice.
    DoubleReplies {
        /// Which segment.
        segment: Option<Which>,
        /// How many, 1 to 1000.
        #[serde(default = "one")]
        count: usize,
    },
    /// The next replies come late.
    DelayReplies {
        /// Which segment.
        segment: Option<Which>,
        /// How late, in microseconds; at most 10 s.
        by_us: u64,
        /// How many, 1 to 1000.
        #[serde(default = "one")]
        count: usize,
    },
    /// Bits of an octet of the next request to an encoder flip, and its parity fits all the same.
    DamageRequest {
        /// Which segment.
        segment: Option<Which>,
        /// Which octet of the telegram, from 1; past the end: the last.
        octet: usize,
        /// Which bits, as two hexadecimal digits.
        #[serde(default = "lowest_bit")]
        mask: String,
    },
    /// Bits of an octet of the next reply flip.
    DamageReply {
        /// Which segment.
        segment: Option<Which>,
        /// Which octet of the telegram, from 1; past the end: the last.
        octet: usize,
        /// Which bits, as two hexadecimal digits.
        #[serde(default = "lowest_bit")]
        mask: String,
    },
    /// A character of the next request to an encoder comes with a wrong parity.
    CharacterError {
        /// Which segment.
        segment: Option<Which>,
        /// Which octet of the telegram, from 1; past the end: the last.
        octet: usize,
    },
    /// Everything as it is now.
    Snapshot {
        /// Of this encoder only, without segments.
        encoder: Option<Which>,
    },
    /// From now on what happens is told on this connection.
    Subscribe {},
    /// That ends.
    Unsubscribe {},
    /// What can be asked for.
    Help {},
    /// The program ends in order, as at Ctrl-C.
    Shutdown {},
}

const fn one() -> usize {
    1
}

const fn ten_minutes() -> f64 {
    600.0
}

const fn usual_watts() -> f64 {
    1.68
}

const fn hundred() -> f64 {
    100.0
}

const fn twenty() -> f64 {
    20.0
}

const fn ten() -> f64 {
    10.0
}

const fn tenth() -> f64 {
    0.1
}

fn lowest_bit() -> String {
    "01".to_owned()
}

impl Request {
    /// The name that `do` has for it.
    pub fn name(&self) -> String {
        let value = serde_json::to_value(self).unwrap_or_default();
        value.get("do").and_then(serde_json::Value::as_str).unwrap_or_default().to_owned()
    }
}
