//! What happened, as lines of JSON.

use profibus_dp::dp;
use profibus_dp::time::Baudrate;
use sch108bex::event::{Event, PositionErrorCause};
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::report::{Report, What};
use crate::snapshot::{alarms, functionality, warnings};

/// All kinds of events.
#[rustfmt::skip]
pub const EVENT_KINDS: &[&str] = &[
    "power_on", "power_off", "too_fast", "slow_again", "joined_bus", "left_bus", "not_stored", "termination", "master_came", "rate_changed",
    "master_connected", "master_left", "noted", "segment_broke", "late_replies", "alarm_raised", "alarm_cleared",
    "warning_raised", "warning_cleared", "position_error", "position_error_cleared", "preset_bit_held", "preset_taken",
    "preset_refused", "parameters_refused", "refused", "configuration_refused", "address_refused",
    "offset_kept_under_other_scaling", "jump_at_overflow", "functionality_chosen", "parameterized",
    "data_exchange_entered", "parameters_changed", "outputs_cleared", "waiting_for_parameters", "min_tsdr",
    "address_taken", "sync", "freeze", "listening", "baudrate_found",
];

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EventLine {
    /// `report`, or `dropped` where the reader was too slow.
    pub event: &'static str,
    /// When, on the clock of the segment, in nanoseconds since it began.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_ns: Option<u64>,
    /// The encoder's name, or the segment's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub who: Option<String>,
    /// What, in one word.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<&'static str>,
    /// What belongs to this kind.
    #[serde(flatten)]
    pub fields: Map<String, Value>,
    /// The whole as a sentence.
    pub text: String,
}

impl EventLine {
    /// So many reports were dropped here.
    pub fn dropped(count: u64) -> Self {
        Self {
            event: "dropped",
            at_ns: None,
            who: None,
            kind: None,
            fields: fields(json!({ "count": count })),
            text: format!("{count} events were dropped here: they came faster than they were read"),
        }
    }
}

impl From<&Report> for EventLine {
    fn from(report: &Report) -> Self {
        let (kind, value) = describe(&report.what);
        Self {
            event: "report",
            at_ns: Some(report.at.as_nanos()),
            who: Some(report.who.to_string()),
            kind: Some(kind),
            fields: fields(value),
            text: report.what.to_string(),
        }
    }
}

fn fields(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(fields) => fields,
        _ => Map::new(),
    }
}

/// What it is in one word, one of [`EVENT_KINDS`] in nearly all cases.
pub fn event_kind(what: &What) -> &'static str {
    describe(what).0
}

fn describe(what: &What) -> (&'static str, Value) {
    let rate = |rate: &Option<Baudrate>| json!({ "rate": rate.map(Baudrate::bits_per_second) });
    match what {
        What::Device(event) => describe_device(event),
        What::PowerOn(address) => ("power_on", json!({ "address": address })),
        What::Joined(address) => ("joined_bus", json!({ "address": address })),
        What::Left => ("left_bus", Value::Null),
        What::PowerOff => ("power_off", Value::Null),
        What::TooFast(rpm) => ("too_fast", json!({ "rpm": rpm })),
        What::SlowAgain => ("slow_again", Value::Null),
        What::Termination(_) => ("termination", Value::Null),
        What::NotStored(_) => ("not_stored", Value::Null),
        What::MasterCame(found) => ("master_came", rate(found)),
        What::MasterConnected => ("master_connected", Value::Null),
        What::RateChanged(found) => ("rate_changed", rate(found)),
        What::MasterLeft => ("master_left", Value::Null),
        What::SegmentBroke(_) => ("segment_broke", Value::Null),
        What::Noted(_) => ("noted", Value::Null),
        What::LateReplies(late) => (
            "late_replies",
            json!({ "count": late.count, "took_bit_times": late.took.0, "limit_bit_times": late.limit.0 }),
        ),
    }
}

fn describe_device(event: &Event) -> (&'static str, Value) {
    match event {
        Event::PresetTaken { from, to, offset } => {
            ("preset_taken", json!({ "from": from, "to": to, "offset": offset }))
        }
        Event::PresetRefused(refusal) => {
            ("preset_refused", json!({ "value": refusal.value, "limit": refusal.limit }))
        }
        Event::PresetBitHeld => ("preset_bit_held", Value::Null),
        Event::AlarmRaised(set) => ("alarm_raised", json!({ "alarms": alarms(*set) })),
        Event::AlarmCleared(set) => ("alarm_cleared", json!({ "alarms": alarms(*set) })),
        Event::WarningRaised(set) => ("warning_raised", json!({ "warnings": warnings(*set) })),
        Event::WarningCleared(set) => ("warning_cleared", json!({ "warnings": warnings(*set) })),
        Event::PositionErrorCause(cause) => ("position_error", json!({ "cause": cause_name(*cause) })),
        Event::PositionErrorCleared => ("position_error_cleared", Value::Null),
        Event::PrmRefused(refusal) => ("parameters_refused", json!({ "octet": refusal.octet() })),
        Event::CfgRefused(_) => ("configuration_refused", Value::Null),
        Event::AddressRefused(_) => ("address_refused", Value::Null),
        Event::OffsetKeptUnderOtherScaling { offset } => {
            ("offset_kept_under_other_scaling", json!({ "offset": offset }))
        }
        Event::JumpAtOverflow { residual } => ("jump_at_overflow", json!({ "residual": residual })),
        Event::FunctionalityChosen(chosen) => {
            ("functionality_chosen", json!({ "functionality": functionality(*chosen) }))
        }
        Event::Bus(event) => describe_bus(*event),
        _ => ("device", Value::Null),
    }
}

fn describe_bus(event: dp::Event) -> (&'static str, Value) {
    match event {
        dp::Event::Parameterized { master } => ("parameterized", json!({ "master": master })),
        dp::Event::ParametersChanged => ("parameters_changed", Value::Null),
        dp::Event::DataExchangeEntered { master } => ("data_exchange_entered", json!({ "master": master })),
        dp::Event::MasterLeft(cause) => ("waiting_for_parameters", json!({ "cause": left_name(cause) })),
        dp::Event::Refused(refusal) => ("refused", json!({ "octet": refusal.octet() })),
        dp::Event::MinTsdr { value, above_max } => {
            ("min_tsdr", json!({ "bit_times": value.0, "above_max": above_max }))
        }
        dp::Event::AddressTaken(address) => ("address_taken", json!({ "address": address })),
        dp::Event::Cleared => ("outputs_cleared", Value::Null),
        dp::Event::Sync(on) => ("sync", json!({ "on": on })),
        dp::Event::Freeze(on) => ("freeze", json!({ "on": on })),
        dp::Event::Listening(rate) => ("listening", json!({ "rate": rate.bits_per_second() })),
        dp::Event::BaudrateFound(rate) => ("baudrate_found", json!({ "rate": rate.bits_per_second() })),
    }
}

fn cause_name(cause: PositionErrorCause) -> &'static str {
    match cause {
        PositionErrorCause::TurnCountLost => "turn_count_lost",
        PositionErrorCause::BothRecordsDamaged => "both_records_damaged",
        PositionErrorCause::SensorFault => "sensor_fault",
        PositionErrorCause::ImplausibleStep => "implausible_step",
        PositionErrorCause::Injected => "injected",
    }
}

fn left_name(cause: dp::Cause) -> &'static str {
    match cause {
        dp::Cause::Unlocked => "unlocked",
        dp::Cause::PrmFault => "prm_fault",
        dp::Cause::CfgFault => "cfg_fault",
        dp::Cause::ParametersTooShort => "parameters_too_short",
        dp::Cause::OutputLength => "output_length",
        dp::Cause::WatchdogExpired => "watchdog_expired",
        dp::Cause::Application => "application",
    }
}
