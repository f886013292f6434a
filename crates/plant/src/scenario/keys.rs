//! The keys of a scenario file: the same for reading, for advice, for the schema and for the page.

use serde_json::{Map, Value, json};

use crate::control::COMMANDS;

/// A table of the file.
#[derive(Debug)]
pub struct Table {
    /// How it is written.
    pub heading: &'static str,
    /// What it is called in sentences.
    pub what: &'static str,
    /// Its keys.
    pub keys: &'static [Key],
    /// Whether keys are looked at elsewhere, too.
    pub open: bool,
}

/// A key of a table.
#[derive(Debug)]
pub struct Key {
    /// As it is written.
    pub name: &'static str,
    /// What kind of value it has.
    pub kind: Kind,
    /// Unit and range.
    pub values: &'static str,
    /// What counts where it is left out; `required` where it cannot be.
    pub default: &'static str,
    /// What it means.
    pub means: &'static str,
}

/// What kind of value a key has.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// A text.
    Text,
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// true or false.
    Boolean,
    /// A number, or a text with a unit.
    Quantity,
    /// A whole number or a text.
    IntegerOrText,
    /// A text or a table with fields of its own.
    TextOrFields,
    /// A list of texts.
    Texts,
    /// One of these texts.
    OneOf(&'static [&'static str]),
    /// A table with fields of its own.
    Fields,
    /// Another table.
    Table(&'static Table),
    /// A list of other tables.
    Tables(&'static Table),
}

/// What stands for a key that has to be there.
pub(super) const REQUIRED: &str = "required";

const fn key(
    name: &'static str,
    kind: Kind,
    values: &'static str,
    default: &'static str,
    means: &'static str,
) -> Key {
    Key { name, kind, values, default, means }
}

/// The functionalities by name.
pub(super) const FUNCTIONALITIES: &[&str] = &["class_1", "class_2", "scancon_2"];
/// The code sequences by name.
pub(super) const CODE_SEQUENCES: &[&str] = &["clockwise", "counter_clockwise"];
/// The time bases by name, in the order of their octets.
pub(super) const TIME_BASES: &[&str] = &["10 ms", "100 ms", "1000 ms", "rpm"];
/// How termination switches can be.
pub(super) const TERMINATIONS: &[&str] = &["auto", "on", "off", "one"];
/// The states of the DP state machine, and no power.
pub(super) const STATES: &[&str] = &["wait_prm", "wait_cfg", "data_exchange", "off"];
/// Alarms by name.
pub(super) const ALARMS: &[&str] = &["position_error", "supply_voltage"];
/// Warnings by name.
pub(super) const WARNINGS: &[&str] =
    &["temperature_exceeded", "light_control_reserve", "operating_time_limit", "battery_charge"];

const TIME: &str = "seconds, or a text with us, ms, s, min, h or d";

/// The file.
#[rustfmt::skip]
pub static FILE: Table = Table {
    heading: "",
    what: "the file",
    open: false,
    keys: &[
        key("title", Kind::Text, "a line", "none", "what the scenario is called"),
        key("description", Kind::Text, "text", "none", "the story, for those who read it"),
        key("duration", Kind::Quantity, TIME, "one second after the last event or expectation", "when `scenario run` ends"),
        key("segment", Kind::Tables(&SEGMENT), "1 to 64 tables `[[segment]]`", REQUIRED, "the buses"),
        key("event", Kind::Tables(&EVENT), "tables `[[event]]`, up to 10000", "none", "what happens when"),
        key("expect", Kind::Tables(&EXPECT), "tables `[[expect]]`, up to 10000", "none", "what must hold: it makes the scenario a test"),
    ],
};

/// A segment.
#[rustfmt::skip]
pub static SEGMENT: Table = Table {
    heading: "[[segment]]",
    what: "a segment",
    open: false,
    keys: &[
        key("name", Kind::Text, "letters, digits, - and _, up to 40", "bus", "what it is called; an encoder `hoist` on it is `NAME.hoist`"),
        key("port", Kind::Text, "as `run --port`", "pty", "where it is for `run FILE`; `scenario run` needs none"),
        key("link", Kind::Text, "a path", "none", "a symbolic link to the pseudo terminal, for `run FILE`"),
        key("rate", Kind::Integer, "bit/s, one of the ten: 9600 to 12000000", "500000; for `run FILE` the master's", "the rate"),
        key("search", Kind::Boolean, "true or false", "false", "the encoders have to find the rate, as real ones do"),
        key("pace", Kind::Boolean, "true or false", "false", "`run FILE`: take as long as a bus of the rate would"),
        key("cable", Kind::Texts, "names of encoders and `master`, each once", "the master, then the encoders in their order", "who is where in the cable"),
        key("reflections", Kind::Boolean, "true or false", "false", "whether a wrong termination damages bits, from 187.5 kbit/s on (docs/control.md)"),
        key("master_terminated", Kind::Boolean, "true or false", "true at an end of the cable, else false", "whether the master has its termination on"),
        key("encoder", Kind::Tables(&ENCODER), "1 to 126 tables `[[segment.encoder]]`", REQUIRED, "who is on it"),
        key("master", Kind::Table(&MASTER), "a table `[segment.master]`", "none", "the built-in master of `scenario run`"),
    ],
};

/// An encoder.
#[rustfmt::skip]
pub static ENCODER: Table = Table {
    heading: "[[segment.encoder]]",
    what: "an encoder",
    open: false,
    keys: &[
        key("name", Kind::Text, "letters, digits, - and _, up to 40", REQUIRED, "what it is called on its segment"),
        key("count", Kind::Integer, "1 to 126", "1", "so many of them: `NAME-1` and so on, switches and serial numbers counted up"),
        key("switches", Kind::Text, "two hexadecimal digits, X16 first", "7E", "the rotary switches (manual 3.4)"),
        key("bits", Kind::Text, "NxM, 2x0 to 16x15", "16x15", "singleturn and multiturn bits"),
        key("serial", Kind::Text, "6 or 7 digits", "1234567", "the serial number (manual 4.2.18)"),
        key("ident", Kind::IntegerOrText, "0 to 0xFFFF", "0x108B", "the ident number; the default is a placeholder"),
        key("gsd", Kind::Text, "a path, from the file's folder", "none", "your own GSD of the device: ident number and configurations are taken from it"),
        key("state", Kind::Text, "a path, from the file's folder", "as delivered at each start", "keeps the non-volatile memory"),
        key("termination", Kind::OneOf(TERMINATIONS), "auto, on, off, one", "auto", "the two switches (manual 3.3); auto: as the place in the cable demands"),
        key("shaft", Kind::TextOrFields, "as `run --shaft`, or fields as in docs/control.md", "still@0", "what turns it, from 0 s on"),
        key("per_revolution", Kind::Text, "a length or an angle, such as 0.5 m or 360 deg", "none", "what the machine moves in one revolution: expectations can use its unit"),
        key("machine", Kind::Fields, "as the request `units`: unit, zero, and per_turn or a drum", "that of the shaft", "the machine that turns the shaft: expectations can use its unit, a drum with rope in layers as well"),
        key("supply", Kind::Number, "volts, -100 to 100", "24", "the supply; off below 6, alarm outside 9 to 30"),
        key("temperature", Kind::Number, "degrees Celsius, -300 to 300", "20", "the temperature inside; warning above 65"),
        key("light", Kind::OneOf(&["ok", "low"]), "ok, low", "ok", "the light of the LED"),
        key("battery", Kind::OneOf(&["ok", "low", "empty"]), "ok, low, empty", "ok", "the battery that keeps the turn count"),
        key("supply_profile", Kind::Fields, "as the request: points, repeat", "none", "a supply that changes over time"),
        key("thermal", Kind::Fields, "as the request: ambient, time_constant_s, kelvin_per_watt, watts", "none", "the temperature inside runs after that around, from `temperature` on"),
        key("led_ageing", Kind::Number, "hours, 0 to 1000000", "none", "so long the reserve of the light lasts under power"),
        key("discharge", Kind::Fields, "as the request: charge, low, hours_without_power, hours_with_power", "none", "the battery gives its charge away"),
        key("endurance", Kind::Integer, "writes, from 0", "none", "after how many the memory is worn out"),
        key("joined", Kind::Boolean, "true or false", "true", "false: it has power, and is off the bus until an event `join`"),
        key("joins_at", Kind::Quantity, TIME, "0 s", "it is not there before: neither power nor a place on the bus"),
    ],
};

/// A built-in master.
#[rustfmt::skip]
pub static MASTER: Table = Table {
    heading: "[segment.master]",
    what: "a master",
    open: false,
    keys: &[
        key("address", Kind::Integer, "0 to 125", "2", "its station address"),
        key("cycle", Kind::Quantity, "time as above, 10 us to 1 h", "10 ms", "how often it goes through its list; again at once where that takes longer"),
        key("retries", Kind::Integer, "0 to 8", "1", "how often it repeats what is not answered"),
        key("start", Kind::Quantity, TIME, "0 s", "when it begins"),
        key("poll", Kind::Tables(&POLL), "tables `[[segment.master.poll]]`, up to 126", "none", "whom it asks"),
    ],
};

/// Whom a master asks.
#[rustfmt::skip]
pub static POLL: Table = Table {
    heading: "[[segment.master.poll]]",
    what: "an entry of a poll list",
    open: false,
    keys: &[
        key("encoder", Kind::Text, "an encoder of the segment", REQUIRED, "whom; of one with `count`: `NAME-1` and so on, or NAME for each of them"),
        key("address", Kind::Integer, "1 to 125", "what its switches say", "where the master looks for it"),
        key("functionality", Kind::OneOf(FUNCTIONALITIES), "class_1, class_2, scancon_2", "scancon_2", "manual 4"),
        key("code_sequence", Kind::OneOf(CODE_SEQUENCES), "clockwise, counter_clockwise", "clockwise", "manual 4.1.1"),
        key("measuring_units_per_revolution", Kind::Integer, "1 to 4294967295; the device takes up to its steps", "no scaling", "manual 4.1.2; turns scaling on"),
        key("total_measuring_range", Kind::Integer, "1 to 4294967295; the device takes up to its range", "units x revolutions", "manual 4.1.3; turns scaling on"),
        key("time_base", Kind::OneOf(TIME_BASES), "10 ms, 100 ms, 1000 ms, rpm", "100 ms", "the unit of velocity (manual 4.1.5)"),
        key("watchdog", Kind::Quantity, "time as above, 10 ms to 650 s; 0: none", "none", "how long the encoder waits for its master"),
        key("ident", Kind::IntegerOrText, "0 to 0xFFFF", "the encoder's", "the ident number that the master has in its project"),
        key("parameters", Kind::Text, "hexadecimal octets", "made of the keys above", "Set_Prm from octet 8 on, as they are"),
        key("configuration", Kind::Text, "hexadecimal octets", "the functionality's", "Chk_Cfg"),
    ],
};

/// An event.
#[rustfmt::skip]
pub static EVENT: Table = Table {
    heading: "[[event]]",
    what: "an event",
    open: true,
    keys: &[
        key("at", Kind::Quantity, TIME, REQUIRED, "when; events of one moment in the order of the file"),
        key("do", Kind::Text, "a request of docs/control.md, or of a master: preset, outputs, set_address, master_stop, master_start", REQUIRED, "what; the fields of the request stand beside"),
    ],
};

/// An expectation.
#[rustfmt::skip]
pub static EXPECT: Table = Table {
    heading: "[[expect]]",
    what: "an expectation",
    open: false,
    keys: &[
        key("name", Kind::Text, "a line", "made of the other keys", "what the report calls it"),
        key("at", Kind::Quantity, TIME, "none", "the moment that is looked at, before the events of that moment"),
        key("encoder", Kind::Text, "SEGMENT.ENCODER", "the only one", "which encoder"),
        key("position", Kind::Quantity, "steps, or a text in the unit of per_revolution or machine", "none", "the position, as a master reads it"),
        key("velocity", Kind::Number, "steps per time base", "none", "the velocity (manual 4.3.3)"),
        key("acceleration", Kind::Number, "as the velocity", "none", "the acceleration (manual 4.3.3)"),
        key("offset", Kind::Integer, "steps", "none", "the offset value (manual 4.2.14)"),
        key("within", Kind::Quantity, "as the value beside it", "0", "how far values may be off; with a position in the unit of the machine, only that one"),
        key("state", Kind::OneOf(STATES), "wait_prm, wait_cfg, data_exchange, off", "none", "the DP state; off: no power"),
        key("address", Kind::Integer, "1 to 126; 0: none", "none", "the station address that it answers to"),
        key("alarms", Kind::Texts, "position_error, supply_voltage", "none", "exactly these alarms are set"),
        key("warnings", Kind::Texts, "temperature_exceeded, light_control_reserve, operating_time_limit, battery_charge", "none", "exactly these warnings are set"),
        key("exchanging", Kind::Boolean, "true or false", "none", "whether the built-in master exchanges data with it"),
        key("inputs", Kind::Text, "hexadecimal octets", "none", "what the built-in master had from it last begins with these octets"),
        key("diagnosis", Kind::Fields, "{ octet = 1 to 57, bit = 0 to 7, is = true or false }", "none", "a bit of the diagnosis that the built-in master fetched last"),
        key("event", Kind::Text, "a kind of event of docs/control.md", "none", "such an event is seen, or not"),
        key("fields", Kind::Fields, "fields of that event", "none", "fields that the event has"),
        key("seen", Kind::Boolean, "true or false", "true", "false: the event must not come"),
        key("sees", Kind::OneOf(&["position_error", "supply_voltage", "temperature_exceeded", "light_control_reserve", "operating_time_limit", "battery_charge"]), "an alarm or a warning", "none", "the built-in master fetches a diagnosis in which it is set"),
        key("cycles", Kind::Integer, "1 to 1000000", "none", "`sees`: within so many cycles of the master"),
        key("after", Kind::Quantity, TIME, "0 s", "`event`, `sees`: from then on"),
        key("before", Kind::Quantity, TIME, "the end", "`event`, `sees`: until then"),
    ],
};

/// All tables, in the order in which a reader needs them.
pub static TABLES: [&Table; 7] = [&FILE, &SEGMENT, &ENCODER, &MASTER, &POLL, &EVENT, &EXPECT];

impl Table {
    /// The key of this name.
    pub fn key(&self, name: &str) -> Option<&'static Key> {
        self.keys.iter().find(|key| key.name == name)
    }
}

/// A JSON schema of scenario files, for editors.
pub fn schema() -> Value {
    let mut schema = of_table(&FILE);
    schema["$schema"] = json!("http://json-schema.org/draft-07/schema#");
    schema["title"] = json!("A scenario of sch108bex: encoders, what happens to them, and what must hold");
    schema
}

fn of_table(table: &Table) -> Value {
    let properties: Map<String, Value> =
        table.keys.iter().map(|key| (key.name.to_owned(), of_key(key))).collect();
    let required = table.keys.iter().filter(|key| key.default == REQUIRED).map(|key| key.name);
    let mut schema = json!({
        "type": "object",
        "properties": properties,
        "required": required.collect::<Vec<_>>(),
        "additionalProperties": table.open,
    });
    if std::ptr::eq(table, &raw const EVENT) {
        let names =
            COMMANDS.iter().map(|command| command.name).filter(|name| !super::events::REFUSED.contains(name));
        let all: Vec<_> = names.chain(super::events::MASTER_REQUESTS).collect();
        schema["properties"]["do"]["enum"] = json!(all);
    }
    schema
}

fn of_key(key: &Key) -> Value {
    let mut schema = match key.kind {
        Kind::Text => json!({ "type": "string" }),
        Kind::Integer => json!({ "type": "integer" }),
        Kind::Number => json!({ "type": "number" }),
        Kind::Boolean => json!({ "type": "boolean" }),
        Kind::Quantity => json!({ "type": ["number", "string"] }),
        Kind::IntegerOrText => json!({ "type": ["integer", "string"] }),
        Kind::TextOrFields => json!({ "type": ["string", "object"] }),
        Kind::Texts => json!({ "type": "array", "items": { "type": "string" } }),
        Kind::OneOf(texts) => json!({ "type": "string", "enum": texts }),
        Kind::Fields => json!({ "type": "object" }),
        Kind::Table(table) => of_table(table),
        Kind::Tables(table) => json!({ "type": "array", "items": of_table(table) }),
    };
    schema["description"] = json!(format!("{} ({}; default: {})", key.means, key.values, key.default));
    schema
}
