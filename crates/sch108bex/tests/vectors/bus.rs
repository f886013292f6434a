//! Vectors about what goes over the bus: parameters, configuration, data, diagnosis, address.

use profibus_dp::time::{Baudrate, Instant};
use sch108bex::configuration::Configurations;
use sch108bex::diagnostics::{Alarms, Diagnostics, Warnings, ext_diag, stat_diag};
use sch108bex::end_cap::{EffectiveAddress, RotarySwitches, effective_address};
use sch108bex::event::PositionErrorCause;
use sch108bex::functionality::Functionality;
use sch108bex::health::{Battery, Measurement, OperatingTime};
use sch108bex::nonvolatile::Record;
use sch108bex::parameterization::{ParameterLength, Parameters};
use sch108bex::refusal::PrmRefusal;
use sch108bex::specification::{SerialNumber, Variant};
use serde_json::Value;

use crate::bench::{Bench, functionality, parameters, variant};
use crate::frame::Header;
use crate::vector::Vector;

fn header(vector: &Vector, key: &str) -> Header {
    Header::new(vector.get(key).expect("a telegram header"))
}

/// Octets 1-8 of Set_Prm: the DP standard's and the slave ASIC's.
fn dp_part(vector: &Vector) -> [u8; 8] {
    let status = vector.hex("station_status").to_be_bytes()[3];
    let [.., high, low] = vector.hex("ident").to_be_bytes();
    let factors = [vector.number("wd_fact_1"), vector.number("wd_fact_2")];
    let (min_tsdr, group) = (vector.number("min_tsdr"), vector.number("group"));
    [status, factors[0], factors[1], min_tsdr, high, low, group, 0]
}

/// Category set_prm: emitted from values, and parsed back into them.
pub(crate) fn set_prm(vector: &Vector) {
    let variant = variant(vector);
    let length = functionality(vector.text("functionality")).parameter_length();
    let parameters = Parameters { length, ..parameters(vector, variant) };
    let mut octets = [0; 26];
    octets[..8].copy_from_slice(&dp_part(vector));
    let length = parameters.emit(&mut octets);
    let octets = &octets[..length];
    if Parameters::parse(octets, &variant) != Ok(parameters) {
        vector.fault("it is not parsed back");
    }
    vector.check("telegram_octets", length);
    vector.check_octets("set_prm_octets", octets);
    vector.check_octets("user_prm", &octets[7..]);
    vector.check_octets("fdl_frame", &header(vector, "fdl").telegram(octets));
}

/// Category prm_check: accepted, or refused for the right reason.
pub(crate) fn prm_check(vector: &Vector) {
    let outcome = Parameters::parse(&vector.octets("set_prm_octets"), &variant(vector));
    vector.check("accepted", outcome.is_ok());
    vector.check("prm_fault", outcome.is_err());
    let reason = match outcome {
        Ok(_) => "",
        Err(PrmRefusal::Length { .. }) => "length",
        Err(PrmRefusal::Class2Missing { .. }) => "octet 9 bit 1",
        Err(PrmRefusal::Commissioning { .. }) => "octet 9 bit 2",
        Err(PrmRefusal::NotAssigned { .. }) => "octet 9 bits 4-7",
        Err(PrmRefusal::MeasuringUnits { .. }) => "MUR",
        Err(PrmRefusal::MeasuringRange { .. }) => "TMR",
        Err(PrmRefusal::Reserved { .. }) => "octets 18-25",
        Err(PrmRefusal::TimeBase { .. }) => "octet 26",
        Err(other) => panic!("no reason for a first Set_Prm: {other}"),
    };
    vector.check("reason", reason);
}

/// Category chk_cfg: which functionality the octets choose.
pub(crate) fn chk_cfg(vector: &Vector) {
    let octets = vector.octets("cfg");
    let (chosen, own) = Configurations::default().find(&octets).expect("one of the three");
    vector.check("functionality", chosen.to_string());
    vector.check("input_octets", chosen.inputs());
    vector.check("output_octets", chosen.outputs());
    vector.check_octets("fdl_frame", &header(vector, "fdl").telegram(own.as_slice()));
}

/// Category mode: whether parameters and configuration go together.
pub(crate) fn mode(vector: &Vector) {
    let length = ParameterLength::from_octets(vector.number("set_prm_octets")).expect("a length");
    let chosen = Configurations::default().find(&vector.octets("cfg"));
    let good = chosen.is_some_and(|(functionality, _)| functionality.satisfied_by(length));
    vector.check("data_exchange", good);
    vector.check("cfg_fault", !good);
}

/// Category data_exchange: the answer's octets, and its frame check from the prepared sum.
pub(crate) fn data_exchange(vector: &Vector) {
    let variant = variant(vector);
    let functionality = functionality(vector.text("functionality"));
    let mut bench = Bench::delivered(variant);
    bench.exchange(functionality, parameters(vector, variant));
    match vector.int("raw") {
        Some(raw) => bench.latch(raw),
        None => {
            for raw in vector.ints("raw_unwrapped_at_samples") {
                bench.stand(100, raw);
            }
        }
    }
    let image = bench.half.inputs();
    let (data, sum) = match functionality.inputs() {
        4 => (&image.octets[..4], image.sum_4),
        _ => (&image.octets[..], image.sum_12),
    };
    let header = header(vector, "response");
    let response = header.telegram(data);
    vector.check_octets("response", &response);
    if response[response.len() - 2] != header.fcs_from_sum(sum) {
        vector.fault("the prepared sum is wrong");
    }
    if vector.get("request").is_some() {
        let request = self::header(vector, "request").telegram(&[]);
        vector.check_octets("request", &request);
    }
}

/// Category diagnostics: whole diagnoses, and single figures in them.
pub(crate) fn diagnostics(vector: &Vector) {
    if vector.expects("slave_diag_octets") {
        whole_diagnosis(vector);
    } else if vector.expects("warning_at_876000") {
        operating_time_limit(vector);
    } else if vector.expects("hours") {
        let time = OperatingTime(vector.number("raw"));
        vector.check_octets("octets", &time.tenths().to_be_bytes());
        vector.check("hours", time.hours());
        vector.check("minutes", time.minutes());
    } else if vector.expects("octets_18_19") {
        let block = long_block(&mut Bench::delivered(Variant::FULL));
        vector.check_octets("octets_18_19", &block[18 - 7..=19 - 7]);
        vector.check_octets("octets_22_23", &block[22 - 7..=23 - 7]);
    } else {
        unit_diag_bits(vector);
    }
}

/// Octets 7-57 in class 2.
fn long_block(bench: &mut Bench) -> [u8; 51] {
    bench.exchange(Functionality::Class2, Parameters::default_for(Variant::FULL));
    let mut block = [0; 51];
    bench.half.diagnostics(&SerialNumber::DEFAULT).emit_long(&mut block);
    block
}

/// A device with the vector's alarms, warnings, time and offset.
fn sick_device(vector: &Vector, variant: Variant) -> Bench {
    let tenths: u64 = vector.number("operating_time_tenths");
    let record = Record {
        operating_time_ms: tenths * 360_000,
        offset: vector.number("offset"),
        ..Record::as_delivered(variant)
    };
    let mut bench = Bench::power_on(&record, variant);
    let (alarms, warnings) = (vector.words("alarms"), vector.words("warnings"));
    let has = |list: &[&str], name: &str| list.contains(&name);
    let measurement = Measurement {
        supply_mv: if has(&alarms, "supply voltage") { 8_500 } else { 24_000 },
        temperature_tenths: if has(&warnings, "temperature") { 651 } else { 200 },
        light_ok: !has(&warnings, "light"),
        battery: if has(&warnings, "battery") { Battery::Low } else { Battery::Ok },
    };
    bench.half.measure(bench.now, &measurement, &mut ());
    if has(&alarms, "position error") {
        bench.half.position_error(bench.now, PositionErrorCause::Injected, &mut ());
    }
    let warned = bench.half.warnings().contains(Warnings::OPERATING_TIME_LIMIT);
    if warned != has(&warnings, "operating time") {
        vector.fault("the operating time warning is wrong");
    }
    bench
}

fn whole_diagnosis(vector: &Vector) {
    let variant = variant(vector);
    let mut bench = sick_device(vector, variant);
    let parameters = parameters(vector, variant);
    let name = vector.text("functionality");
    if vector.flag("data_exchange") {
        bench.exchange(functionality(name), parameters);
    }
    let serial = vector.text("serial").parse().unwrap_or_default();
    let diagnostics = bench.half.diagnostics(&serial);
    let (mut short, mut long) = ([0; 10], [0; 51]);
    let block: &[u8] = if diagnostics.class_2_part.is_some() {
        diagnostics.emit_long(&mut long);
        &long
    } else {
        diagnostics.emit_short(&mut short);
        &short
    };
    if Diagnostics::parse(block) != Some(diagnostics) {
        vector.fault("it is not parsed back");
    }
    let mut octets = standard_part(vector, &diagnostics).to_vec();
    octets.extend(block);
    vector.check("octets", octets.len());
    vector.check_octets("slave_diag_octets", &octets);
    vector.check_octets("fdl_frame", &header(vector, "fdl").telegram(&octets));
}

/// Octets 1-6 by the DP standard, from the state that the vector tells.
fn standard_part(vector: &Vector, diagnostics: &Diagnostics) -> [u8; 6] {
    let warnings = diagnostics.class_2_part.map_or(Warnings::empty(), |part| part.warnings);
    let long_form = diagnostics.class_2_part.is_some();
    let waits = !vector.flag("data_exchange");
    let bit = |mask, set| if set { mask } else { 0 };
    let status_1 = bit(0x02, waits)
        | bit(0x04, vector.flag("cfg_fault"))
        | bit(0x08, ext_diag(diagnostics.alarms, warnings, long_form));
    let status_2 = 0x04
        | bit(0x01, waits)
        | bit(0x02, stat_diag(diagnostics.alarms))
        | bit(0x08, vector.flag("watchdog_on"));
    let owner = vector.int("owner").map_or(0xFF, |owner| u8::try_from(owner).expect("address"));
    let [.., high, low] = vector.hex("ident").to_be_bytes();
    [status_1, status_2, 0, owner, high, low]
}

fn operating_time_limit(vector: &Vector) {
    let hours: u64 = vector.number("hours");
    let limit = OperatingTime::from_millis(hours * 3_600_000);
    vector.check("raw", limit.tenths());
    vector.check_octets("octets", &limit.tenths().to_be_bytes());
    let record = Record { operating_time_ms: hours * 3_600_000, ..Record::as_delivered(Variant::FULL) };
    let mut bench = Bench::power_on(&record, Variant::FULL);
    let warned = |bench: &Bench| !bench.half.warnings().is_empty();
    vector.check("warning_at_876000", warned(&bench));
    bench.half.poll(Instant::from_millis(1 + 360_000), &mut ());
    vector.check("warning_at_876001", warned(&bench));
}

/// Each bit alone, found in the octets from octet 8 on.
fn unit_diag_bits(vector: &Vector) {
    let number = |alarms: Alarms, warnings: Warnings| {
        let mut diagnostics = Bench::delivered(Variant::FULL).half.diagnostics(&SerialNumber::DEFAULT);
        let clean = Diagnostics::parse(&long_block(&mut Bench::delivered(Variant::FULL)));
        diagnostics.class_2_part = clean.and_then(|clean| clean.class_2_part);
        let (mut without, mut with) = ([0; 51], [0; 51]);
        diagnostics.emit_long(&mut without);
        diagnostics.alarms = alarms;
        diagnostics.class_2_part.as_mut().expect("the long form").warnings = warnings;
        diagnostics.emit_long(&mut with);
        let octets = with.iter().zip(without).skip(1).enumerate();
        let (index, octet) = octets
            .map(|(index, (with, without))| (index, with ^ without))
            .find(|(_, octet)| *octet != 0)
            .expect("a bit");
        Value::from(index * 8 + usize::try_from(octet.trailing_zeros()).expect("few"))
    };
    let none = Alarms::empty();
    vector.check("position error", number(Alarms::POSITION_ERROR, Warnings::empty()));
    vector.check("supply voltage error", number(Alarms::SUPPLY_VOLTAGE, Warnings::empty()));
    vector.check("temperature", number(none, Warnings::TEMPERATURE_EXCEEDED));
    vector.check("light control reserve", number(none, Warnings::LIGHT_CONTROL_RESERVE));
    vector.check("operating time", number(none, Warnings::OPERATING_TIME_LIMIT));
    vector.check("battery", number(none, Warnings::BATTERY_CHARGE));
}

/// Category address: the switches, and a change over the bus.
pub(crate) fn address(vector: &Vector) {
    let switches = RotarySwitches::from_digits(vector.number("x16"), vector.number("x1"));
    let switches = switches.expect("two digits");
    if let Some(new) = vector.int("new_address") {
        let new = u8::try_from(new).expect("an address");
        let [.., high, low] = vector.hex("ident").to_be_bytes();
        let lock = if vector.flag("no_add_chg") { 0xFF } else { 0 };
        let frame = header(vector, "fdl").telegram(&[new, high, low, lock]);
        vector.check_octets("fdl_frame", &frame);
        vector.check("further_change_possible", switches.address_changeable());
        let effective = effective_address(switches, Some(new));
        vector.check("stored_address_in_force", effective.octet());
        return;
    }
    let effective = effective_address(switches, None);
    vector.check("switch_value", switches.0);
    vector.check("data_exchange_possible", effective.data_exchange_possible());
    vector.check("bus_address_change_possible", switches.address_changeable());
    if effective.data_exchange_possible() && effective != EffectiveAddress::Station(switches.0) {
        vector.fault("the switches do not decide");
    }
}

/// Category timing: max T_SDR of the ten rates in microseconds, two decimals.
pub(crate) fn timing(vector: &Vector) {
    let micros = |rate: i64| {
        let rate = u32::try_from(rate).ok().and_then(Baudrate::from_bits_per_second);
        let rate = rate.expect("a rate of PROFIBUS");
        let nanos = rate.duration(rate.max_tsdr()).as_nanos();
        let hundredths = u32::try_from((nanos + 5) / 10).expect("short");
        f64::from(hundredths) / 100.0
    };
    let rates = vector.ints("bits_per_second");
    vector.check("max_tsdr_us", rates.into_iter().map(micros).collect::<Vec<_>>());
}
