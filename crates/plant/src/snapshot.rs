//! Everything that is shown anywhere of a running plant, at one moment; as JSON too.

use bus::{Cable, Counters, FaultCounters, Noise};
use profibus_dp::dp::{Application, State};
use profibus_dp::fdl::Station;
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::slave_diag::STANDARD_OCTETS;
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::functionality::Functionality;
use sch108bex::health::{Battery, OperatingTime};
use sch108bex::parameterization::{CodeSequence, TimeBase};
use sch108bex::scaling::Scaling;
use sch108bex::{Device, Identity};
use serde::{Serialize, Serializer};

use crate::encoder::{EncoderCounters, Injected, Reason};
use crate::report::Reporter;
use crate::shaft::Shaft;
use crate::world::World;

/// A plant at one moment. Segments are looked at one after the other.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlantSnapshot {
    /// The segments, in the order they were added.
    pub segments: Vec<SegmentSnapshot>,
    /// The encoders, in the order they were added.
    pub encoders: Vec<Snapshot>,
}

/// A segment at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentSnapshot {
    /// Its name.
    pub name: String,
    /// What a master opens.
    pub port: String,
    /// The moment, on its clock.
    pub at: Instant,
    /// The master's rate, where it is known.
    pub rate: Option<Baudrate>,
    /// What was counted.
    pub counters: Counters,
    /// The cable: the master's place, and a cut.
    pub cable: Cable,
    /// The share of bits that flip because of the termination.
    pub reflected: f64,
    /// What is wrong with the termination, as sentences.
    pub termination: Vec<String>,
    /// What goes wrong by chance.
    pub noise: Option<Noise>,
    /// Faults by request that wait for requests, and for replies.
    pub waiting: (usize, usize),
    /// What went wrong so far.
    pub faults: FaultCounters,
}

/// Where a machine is, in its unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MachineSnapshot {
    /// The unit.
    pub unit: String,
    /// So many of it.
    pub position: f64,
    /// The layer of rope that is being wound, from 1, on a drum.
    pub rope_layer: Option<u32>,
    /// Units for one turn clockwise; `None` on a drum, where it changes.
    #[serde(skip)]
    pub per_turn: Option<f64>,
    /// Units per second.
    #[serde(skip)]
    pub speed: f64,
}

/// An encoder at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Its name.
    pub name: String,
    /// The moment, on the clock of its segment.
    pub at: Instant,
    /// Who it is.
    pub identity: Identity,
    /// Where its switches are; the device looks at them at power-on.
    pub switches: RotarySwitches,
    /// Where its termination switches are.
    pub termination: TerminationSwitches,
    /// What is around it.
    pub world: World,
    /// What turns it.
    pub shaft: Shaft,
    /// Where the shaft is, in physical counts, turns included.
    pub shaft_position: i64,
    /// Its speed in revolutions per minute, positive clockwise.
    pub rpm: f64,
    /// Where the machine is that turns it, if it is known.
    pub machine: Option<MachineSnapshot>,
    /// What around it is not as it should be.
    pub reasons: Vec<Reason>,
    /// What is wrong by request.
    pub injected: Injected,
    /// What was counted.
    pub counters: EncoderCounters,
    /// What the device says of itself; `None` without power.
    pub device: Option<DeviceSnapshot>,
}

/// A device under power at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceSnapshot {
    /// The station address it answers to.
    pub address: Option<u8>,
    /// The station address set over the bus.
    pub stored_address: Option<u8>,
    /// The rate it listens at.
    pub baudrate: Baudrate,
    /// Where the DP state machine stands.
    pub state: State,
    /// What was agreed on; `None` outside data exchange.
    pub functionality: Option<Functionality>,
    /// The scaling in force, the last one outside data exchange.
    pub scaling: Scaling,
    /// In scaled steps, as the input image has it.
    pub position: u32,
    /// In the unit of the time base.
    pub velocity: i32,
    /// In the unit of the time base.
    pub acceleration: i32,
    /// In physical counts, turns included.
    pub physical_position: i64,
    /// In scaled steps.
    pub offset: i32,
    /// The alarms that are set.
    pub alarms: Alarms,
    /// The warnings that are set.
    pub warnings: Warnings,
    /// Time under power.
    pub operating_time: OperatingTime,
    /// The unit of velocity and acceleration.
    pub time_base: TimeBase,
    /// What it would answer to Slave_Diag.
    pub diagnosis: DiagnosisOctets,
}

/// The octets of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DiagnosisOctets {
    octets: [u8; MOST_DIAGNOSIS],
    length: usize,
}

/// 6 octets of the standard and 51 of the encoder (manual 4.2).
const MOST_DIAGNOSIS: usize = 57;

impl DiagnosisOctets {
    fn of(device: &Device<Reporter>) -> Self {
        let slave = device.bus().slave();
        let mut octets = [0; MOST_DIAGNOSIS];
        let (standard, own) = octets.split_at_mut(STANDARD_OCTETS);
        standard.copy_from_slice(&slave.standard_diagnosis().emit());
        let extended = device.encoder().diagnosis(slave.state().is_data_exchange(), own);
        Self { octets, length: (STANDARD_OCTETS + extended.length).min(MOST_DIAGNOSIS) }
    }

    /// Octet 1 first.
    pub fn octets(&self) -> &[u8] {
        self.octets.get(..self.length).unwrap_or_default()
    }
}

impl DeviceSnapshot {
    /// What a device says of itself.
    pub(crate) fn of(device: &Device<Reporter>) -> Self {
        let sensor = device.sensor();
        let health = sensor.health();
        Self {
            address: device.address(),
            stored_address: device.encoder().stored_address(),
            baudrate: device.listening_rate(),
            state: *device.bus().slave().state(),
            functionality: device.encoder().functionality(),
            scaling: *sensor.scaling(),
            position: sensor.position(),
            velocity: sensor.velocity(),
            acceleration: sensor.acceleration(),
            physical_position: sensor.physical_position(),
            offset: health.offset,
            alarms: health.alarms,
            warnings: health.warnings,
            operating_time: health.operating_time,
            time_base: sensor.time_base(),
            diagnosis: DiagnosisOctets::of(device),
        }
    }
}

/// A snapshot of a segment as JSON has it.
#[derive(Serialize)]
struct SegmentView<'a> {
    name: &'a str,
    port: &'a str,
    at_ns: u64,
    rate: Option<u32>,
    counters: serde_json::Value,
    cable: serde_json::Value,
    termination: &'a [String],
    line: Option<NoiseView>,
    waiting_request_faults: usize,
    waiting_reply_faults: usize,
    faults: serde_json::Value,
}

#[derive(Serialize)]
struct NoiseView {
    seed: u64,
    bit_errors: f64,
    character_errors: f64,
    lost_requests: f64,
    lost_replies: f64,
    doubled_requests: f64,
    doubled_replies: f64,
    late_replies: f64,
    late_by_us: u64,
    bursts: f64,
    burst_length: f64,
    burst_bit_errors: f64,
}

#[derive(Serialize)]
struct EncoderView<'a> {
    name: &'a str,
    at_ns: u64,
    bits: String,
    ident_number: String,
    serial_number: String,
    switches: String,
    shaft: String,
    shaft_position: i64,
    rpm: f64,
    machine: Option<&'a MachineSnapshot>,
    volts: f64,
    celsius: f64,
    light: &'static str,
    battery: &'static str,
    reasons: &'a [Reason],
    injected: Injected,
    counters: EncoderCounters,
    device: Option<DeviceView>,
}

#[derive(Serialize)]
struct DeviceView {
    address: Option<u8>,
    stored_address: Option<u8>,
    rate: u32,
    state: &'static str,
    master: Option<u8>,
    functionality: Option<&'static str>,
    code_sequence: &'static str,
    measuring_units_per_revolution: u32,
    total_measuring_range: u32,
    position: u32,
    velocity: i32,
    acceleration: i32,
    physical_position: i64,
    offset: i32,
    alarms: Vec<String>,
    warnings: Vec<String>,
    operating_time_hours: f64,
}

impl Serialize for SegmentSnapshot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Counters {
            telegrams,
            replies,
            overtaken,
            late,
            collisions,
            dropped,
            refused,
            line_errors,
            after_max_tsdr,
        } = self.counters;
        let faults = self.faults;
        SegmentView {
            name: &self.name,
            port: &self.port,
            at_ns: self.at.as_nanos(),
            rate: self.rate.map(Baudrate::bits_per_second),
            counters: serde_json::json!({
                "telegrams": telegrams, "replies": replies, "overtaken": overtaken, "late": late,
                "collisions": collisions, "dropped": dropped, "refused_masters": refused,
                "line_errors": line_errors,
                "after_max_tsdr": after_max_tsdr,
            }),
            cable: serde_json::json!({
                "master_after": self.cable.master_after,
                "cut_after": self.cable.cut_after,
                "reflections": self.cable.mismatches.is_some(),
                "reflected_bit_errors": self.reflected,
            }),
            termination: &self.termination,
            line: self.noise.map(NoiseView::from),
            waiting_request_faults: self.waiting.0,
            waiting_reply_faults: self.waiting.1,
            faults: serde_json::json!({
                "lost_requests": faults.lost_requests,
                "doubled_requests": faults.doubled_requests,
                "damaged_request_characters": faults.damaged_request_characters,
                "lost_replies": faults.lost_replies,
                "doubled_replies": faults.doubled_replies,
                "late_replies": faults.late_replies,
                "damaged_reply_characters": faults.damaged_reply_characters,
            }),
        }
        .serialize(serializer)
    }
}

impl From<Noise> for NoiseView {
    fn from(noise: Noise) -> Self {
        Self {
            seed: noise.seed,
            bit_errors: noise.bit_errors,
            character_errors: noise.character_errors,
            lost_requests: noise.lost_requests,
            lost_replies: noise.lost_replies,
            doubled_requests: noise.doubled_requests,
            doubled_replies: noise.doubled_replies,
            late_replies: noise.late_replies,
            late_by_us: noise.late_by.as_nanos() / 1_000,
            bursts: noise.bursts,
            burst_length: noise.burst_length,
            burst_bit_errors: noise.burst_bit_errors,
        }
    }
}

impl Serialize for Snapshot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let World(measured) = self.world;
        EncoderView {
            name: &self.name,
            at_ns: self.at.as_nanos(),
            bits: self.identity.variant.to_string(),
            ident_number: format!("0x{:04X}", self.identity.ident_number),
            serial_number: self.identity.serial_number.to_string(),
            switches: self.switches.to_string(),
            shaft: self.shaft.to_string(),
            shaft_position: self.shaft_position,
            rpm: self.rpm,
            machine: self.machine.as_ref(),
            volts: f64::from(measured.supply_mv) / 1e3,
            celsius: f64::from(measured.temperature_tenths) / 10.0,
            light: if measured.light_ok { "ok" } else { "low" },
            battery: match measured.battery {
                Battery::Ok => "ok",
                Battery::Low => "low",
                Battery::Empty => "empty",
            },
            reasons: &self.reasons,
            injected: self.injected,
            counters: self.counters,
            device: self.device.as_ref().map(DeviceView::from),
        }
        .serialize(serializer)
    }
}

impl Serialize for DeviceSnapshot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        DeviceView::from(self).serialize(serializer)
    }
}

impl From<&DeviceSnapshot> for DeviceView {
    fn from(device: &DeviceSnapshot) -> Self {
        let DeviceSnapshot { scaling, .. } = device;
        Self {
            address: device.address,
            stored_address: device.stored_address,
            rate: device.baudrate.bits_per_second(),
            state: state(device.state),
            master: device.state.owner(),
            functionality: device.functionality.map(functionality),
            code_sequence: match scaling.code_sequence() {
                CodeSequence::Clockwise => "clockwise",
                CodeSequence::CounterClockwise => "counter_clockwise",
            },
            measuring_units_per_revolution: scaling.measuring_units_per_revolution(),
            total_measuring_range: scaling.total_measuring_range(),
            position: device.position,
            velocity: device.velocity,
            acceleration: device.acceleration,
            physical_position: device.physical_position,
            offset: device.offset,
            alarms: alarms(device.alarms),
            warnings: warnings(device.warnings),
            operating_time_hours: f64::from(device.operating_time.tenths()) / 10.0,
        }
    }
}

/// How a state is called in JSON.
pub(crate) fn state(state: State) -> &'static str {
    match state {
        State::WaitPrm => "wait_prm",
        State::WaitCfg(_) => "wait_cfg",
        State::DataExchange(..) => "data_exchange",
    }
}

/// How a functionality is called in JSON.
pub(crate) fn functionality(functionality: Functionality) -> &'static str {
    match functionality {
        Functionality::Class1 => "class_1",
        Functionality::Class2 => "class_2",
        Functionality::Scancon2 => "scancon_2",
    }
}

/// How alarms are called in JSON: `position_error`, `supply_voltage`.
pub(crate) fn alarms(alarms: Alarms) -> Vec<String> {
    alarms.iter_names().map(|(name, _)| name.to_lowercase()).collect()
}

/// How warnings are called in JSON: `temperature_exceeded` and so on.
pub(crate) fn warnings(warnings: Warnings) -> Vec<String> {
    warnings.iter_names().map(|(name, _)| name.to_lowercase()).collect()
}
