//! What can be asked of a running plant.

use serde::{Deserialize, Serialize};

use crate::control::target::Which;
use crate::control::values::{BatteryState, Light, MemoryFault, Power, SensorFault, ShaftSpec};

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
