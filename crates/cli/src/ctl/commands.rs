//! What can be asked for from a shell, and the requests that this makes.

use clap::Subcommand;
use serde_json::{Value, json};

use super::{pairs, usage};
use crate::Failure;
use crate::arguments::{decimal, whole};

/// What can be asked for.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Another movement of the shaft: still@RAW, constant:RPM[@RAW] or another kind (see docs/shafts.md);
    /// @here goes on from where it is
    Shaft {
        #[arg(allow_hyphen_values = true)]
        shaft: String,
    },
    /// Another supply voltage: alarm outside 9 to 30 V, off below 6 V
    Supply {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        volts: f64,
    },
    /// Another temperature inside: warning above 65 degrees Celsius
    Temperature {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        celsius: f64,
    },
    /// The light of the LED
    Light {
        #[arg(value_parser = ["ok", "low"])]
        state: String,
    },
    /// The battery that keeps the turn count
    Battery {
        #[arg(value_parser = ["ok", "low", "empty"])]
        state: String,
    },
    /// Another supply voltage for some seconds, then that of before
    BrownOut {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        volts: f64,
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        seconds: f64,
    },
    /// A supply voltage over time, in straight lines through points; two at one time are a jump, the last stays
    SupplyProfile {
        /// Seconds from now and volts, such as 0:24 2:24 2:5 2.5:24
        #[arg(required = true, value_name = "SECONDS:VOLTS")]
        points: Vec<String>,
        /// At the last point it begins anew
        #[arg(long)]
        repeat: bool,
    },
    /// The temperature inside runs after that around and the encoder's own heat
    Thermal {
        /// Degrees Celsius around it
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        ambient: f64,
        /// Seconds until 63 percent of a change have come
        #[arg(long, default_value = "600", value_parser = decimal, value_name = "SECONDS", allow_negative_numbers = true)]
        time_constant: f64,
        /// By how much a watt warms it
        #[arg(long, default_value = "0", value_parser = decimal, value_name = "KELVIN", allow_negative_numbers = true)]
        kelvin_per_watt: f64,
        /// What it takes from its supply: 70 mA at 24 V (manual 6) if left out
        #[arg(long, default_value = "1.68", value_parser = decimal, value_name = "WATTS", allow_negative_numbers = true)]
        watts: f64,
    },
    /// The reserve of the LED's light lasts for so many more hours under power
    LedAgeing {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        hours: f64,
    },
    /// The battery gives its charge away
    Discharge {
        /// How long a full one lasts without external power
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        hours_without_power: f64,
        /// How long a full one lasts with it; for ever if left out
        #[arg(long, value_parser = decimal, value_name = "HOURS", allow_negative_numbers = true)]
        with_power: Option<f64>,
        /// What is in it now
        #[arg(long, default_value = "100", value_parser = decimal, value_name = "PERCENT", allow_negative_numbers = true)]
        charge: f64,
        /// Below which it is low
        #[arg(long, default_value = "20", value_parser = decimal, value_name = "PERCENT", allow_negative_numbers = true)]
        low: f64,
    },
    /// The rotary switches, two hexadecimal digits, X16 first; they count at the next power-on
    Switches {
        #[arg(allow_hyphen_values = true)]
        switches: String,
    },
    /// The power, without warning
    Power {
        #[arg(value_parser = ["off", "on", "cycle"])]
        state: String,
    },
    /// A fault of the sensor, a position error, or the turn count lost at the next power-on
    Sensor {
        #[arg(value_parser = ["once", "held", "position_error", "turns_lost", "off"])]
        fault: String,
    },
    /// A fault of the non-volatile memory: of its writes, of a slot now, of both at the next power-on, or the power
    /// gone in the middle of the next write
    Memory {
        #[arg(value_parser = ["writes_fail", "damage_a", "damage_b", "lost_at_power_on", "torn_write", "off"])]
        fault: String,
    },
    /// The operating time that is stored, while the power is off
    OperatingTime {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        hours: f64,
    },
    /// After how many writes the memory is worn out and takes no more; any: never
    Endurance {
        #[arg(value_name = "WRITES|any", allow_negative_numbers = true)]
        writes: String,
    },
    /// The machine that turns the shaft, for its units in the snapshot; off: that of the shaft
    Units {
        /// unit (m if left out), zero (the counts where the machine is at 0), and either per_turn or the drum's
        /// drum_diameter, rope_diameter, turns_per_layer, wound_turns, lines; such as unit=m per_turn=0.5
        #[arg(required = true, value_name = "off|NAME=VALUE")]
        values: Vec<String>,
    },
    /// Take it off the bus; it keeps its power
    Leave,
    /// Put it on the bus again
    Join,
    /// The two termination switches; one: the first on, the second off, which is always wrong (manual 3.3)
    Termination {
        #[arg(value_parser = ["on", "off", "one"])]
        state: String,
    },
    /// Cut the cable: who is behind the cut, seen from the master, is off the bus
    Cut {
        /// So many devices are in front of the cut, the master among them
        #[arg(value_parser = whole::<u32>(0..=127), allow_negative_numbers = true)]
        after: u32,
        /// So many encoders are in front of the master; as many as there were if left out, 0 at first
        #[arg(long, value_parser = whole::<u32>(0..=126), value_name = "COUNT", allow_negative_numbers = true)]
        master_after: Option<u32>,
    },
    /// The cable is whole again
    Mend,
    /// Whether a wrong termination damages bits
    Reflections {
        #[arg(value_parser = ["on", "off"])]
        state: String,
    },
    /// What goes wrong on the line by chance, like seed=7 lost_replies=0.01; off for a quiet line
    Line {
        /// seed, late_by_us, burst_length, and as shares from 0 to 1 bit_errors, character_errors, lost_requests,
        /// lost_replies, doubled_requests, doubled_replies, late_replies, bursts, burst_bit_errors
        #[arg(required = true, value_name = "off|NAME=VALUE")]
        values: Vec<String>,
    },
    /// Nobody hears the next requests
    LoseRequests {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The master does not hear the next replies
    LoseReplies {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next requests are heard twice
    DoubleRequests {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next replies come twice
    DoubleReplies {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next replies come late
    DelayReplies {
        /// How late, in microseconds
        #[arg(value_parser = whole::<u64>(0..=10_000_000), allow_negative_numbers = true)]
        by_us: u64,
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// Bits of an octet of the next request flip, unseen by the parity
    DamageRequest {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
        /// Which bits, two hexadecimal digits
        #[arg(default_value = "01")]
        mask: String,
    },
    /// Bits of an octet of the next reply flip
    DamageReply {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
        /// Which bits, two hexadecimal digits
        #[arg(default_value = "01")]
        mask: String,
    },
    /// A character of the next request has a wrong parity
    CharacterError {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
    },
    /// Everything as it is now, or one encoder
    Snapshot,
    /// What happens from now on, until Ctrl-C
    Events,
    /// What can be asked for in JSON
    Requests,
    /// A request in JSON as it is
    Raw {
        /// Such as '{"do":"help"}'
        request: String,
    },
    /// End the program in order
    Shutdown,
    #[command(external_subcommand)]
    Unknown(Vec<String>),
}

/// What a command is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum About {
    Encoder,
    Segment,
    All,
}

impl About {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Encoder => "an encoder",
            Self::Segment => "a segment",
            Self::All => "one of them",
        }
    }
}

impl Command {
    pub(super) fn about(&self) -> About {
        match self {
            Self::Shaft { .. }
            | Self::Supply { .. }
            | Self::Temperature { .. }
            | Self::Light { .. }
            | Self::Battery { .. }
            | Self::BrownOut { .. }
            | Self::SupplyProfile { .. }
            | Self::Thermal { .. }
            | Self::LedAgeing { .. }
            | Self::Discharge { .. }
            | Self::Switches { .. }
            | Self::Power { .. }
            | Self::Sensor { .. }
            | Self::Memory { .. }
            | Self::OperatingTime { .. }
            | Self::Endurance { .. }
            | Self::Units { .. }
            | Self::Leave
            | Self::Join
            | Self::Termination { .. }
            | Self::Snapshot => About::Encoder,
            Self::Cut { .. }
            | Self::Mend
            | Self::Reflections { .. }
            | Self::Line { .. }
            | Self::LoseRequests { .. }
            | Self::LoseReplies { .. }
            | Self::DoubleRequests { .. }
            | Self::DoubleReplies { .. }
            | Self::DelayReplies { .. }
            | Self::DamageRequest { .. }
            | Self::DamageReply { .. }
            | Self::CharacterError { .. } => About::Segment,
            Self::Events | Self::Requests | Self::Raw { .. } | Self::Shutdown | Self::Unknown(_) => {
                About::All
            }
        }
    }

    /// What `do` has, and the other fields.
    pub(super) fn request(&self) -> Result<(&'static str, Value), Failure> {
        Ok(match self {
            Self::Shaft { shaft } => ("shaft", json!({ "shaft": shaft })),
            Self::Supply { volts } => ("supply", json!({ "volts": volts })),
            Self::Temperature { celsius } => ("temperature", json!({ "celsius": celsius })),
            Self::Light { state } => ("light", json!({ "state": state })),
            Self::Battery { state } => ("battery", json!({ "state": state })),
            Self::BrownOut { volts, seconds } => ("brown_out", json!({ "volts": volts, "for_s": seconds })),
            Self::SupplyProfile { points, repeat } => {
                ("supply_profile", json!({ "points": pairs::points(points)?, "repeat": repeat }))
            }
            Self::Thermal { ambient, time_constant, kelvin_per_watt, watts } => (
                "thermal",
                json!({ "ambient": ambient, "time_constant_s": time_constant, "kelvin_per_watt": kelvin_per_watt,
                    "watts": watts }),
            ),
            Self::LedAgeing { hours } => ("led_ageing", json!({ "hours": hours })),
            Self::Discharge { hours_without_power, with_power, charge, low } => (
                "discharge",
                json!({ "charge": charge, "low": low, "hours_without_power": hours_without_power,
                    "hours_with_power": with_power }),
            ),
            Self::Switches { switches } => ("switches", json!({ "switches": switches })),
            Self::Power { state } => ("power", json!({ "state": state })),
            Self::Sensor { fault } => ("sensor", json!({ "fault": fault })),
            Self::Memory { fault } => ("memory", json!({ "fault": fault })),
            Self::OperatingTime { hours } => ("operating_time", json!({ "hours": hours })),
            Self::Endurance { writes } => ("endurance", json!({ "writes": pairs::writes(writes)? })),
            Self::Units { values } => ("units", json!({ "machine": pairs::machine(values)? })),
            Self::Termination { state } => {
                ("termination", json!({ "first": state != "off", "second": state == "on" }))
            }
            Self::Cut { after, master_after } => {
                ("cut", json!({ "after": after, "master_after": master_after }))
            }
            Self::Mend => ("mend", Value::Null),
            Self::Reflections { state } => ("reflections", json!({ "on": state == "on" })),
            Self::Leave => ("leave", Value::Null),
            Self::Join => ("join", Value::Null),
            Self::Line { values } => ("line", pairs::noise(values)?),
            Self::LoseRequests { count } => ("lose_requests", json!({ "count": count })),
            Self::LoseReplies { count } => ("lose_replies", json!({ "count": count })),
            Self::DoubleRequests { count } => ("double_requests", json!({ "count": count })),
            Self::DoubleReplies { count } => ("double_replies", json!({ "count": count })),
            Self::DelayReplies { by_us, count } => {
                ("delay_replies", json!({ "by_us": by_us, "count": count }))
            }
            Self::DamageRequest { octet, mask } => {
                ("damage_request", json!({ "octet": octet, "mask": mask }))
            }
            Self::DamageReply { octet, mask } => ("damage_reply", json!({ "octet": octet, "mask": mask })),
            Self::CharacterError { octet } => ("character_error", json!({ "octet": octet })),
            Self::Snapshot => ("snapshot", Value::Null),
            Self::Events => ("subscribe", Value::Null),
            Self::Shutdown => ("shutdown", Value::Null),
            Self::Requests | Self::Raw { .. } => ("help", Value::Null),
            Self::Unknown(words) => {
                let word = words.first().map(String::as_str).unwrap_or_default();
                return Err(usage(format!(
                    "there is no command {word:?}; `sch108bex ctl --help` lists those that there are"
                )));
            }
        })
    }
}
