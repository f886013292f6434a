//! profirust against encoders, in virtual time and over every kind of end.

mod common;

use bus::{PortAddress, ReplyFault, VirtualSegment, open_for_master, open_for_slaves};
use common::{ADDRESS, CLASS_1, CLASS_2, IDENT, SCANCON, encoder, encoder_at, new_encoder};
use master::commissioning::{Asked, Bus, Life, Outcome, RealBus, VirtualBus};
use master::{
    Commissioner, LightMaster, MasterSettings, Parameters, Service, Settings, SlaveSettings, Watchdog,
};
use plant::{EncoderStation, Rate};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};

const INPUTS: [u8; 4] = [0x12, 0x34, 0x56, 0x78];

fn slave(user: &[u8], configuration: &[u8], inputs: u8, outputs: u8) -> SlaveSettings {
    SlaveSettings {
        address: ADDRESS,
        parameters: Parameters {
            ident_number: IDENT,
            watchdog: Some(Watchdog { factor_1: 10, factor_2: 100 }),
            min_tsdr: 11,
            user: user.to_vec(),
            ..Parameters::default()
        },
        configuration: configuration.to_vec(),
        inputs,
        outputs,
        max_tsdr: 60,
    }
}

fn functionalities() -> [SlaveSettings; 3] {
    [slave(CLASS_1, &[0xD1], 4, 0), slave(CLASS_2, &[0xF1], 4, 4), slave(SCANCON, &[0xF1, 0xD1, 0xD1], 12, 4)]
}

fn settings(rate: Baudrate) -> MasterSettings {
    MasterSettings { address: 2, rate, slot_time: Duration::ZERO, retries: 1 }
}

fn bus(rate: Baudrate) -> VirtualBus<EncoderStation> {
    let mut segment = VirtualSegment::new(Instant::ZERO, rate);
    segment.add(encoder(rate));
    VirtualBus::new(segment)
}

/// A master that has exchanged data.
fn running(rate: Baudrate, slave: &SlaveSettings) -> Commissioner<'_, VirtualBus<EncoderStation>> {
    let mut master = Commissioner::new(bus(rate), settings(rate), slave).unwrap();
    exchange(&mut master, 1);
    master
}

#[track_caller]
fn exchange<B: Bus>(master: &mut Commissioner<'_, B>, times: usize) {
    let mut left = times;
    let done = master.run_until(Duration::from_secs(20), |_, event| {
        left -= usize::from(event == Some(Life::Exchanged));
        left == 0
    });
    assert!(done.unwrap(), "{left} of {times} exchanges are missing");
}

#[test]
fn it_exchanges_data_in_all_functionalities_at_all_rates() {
    for rate in Baudrate::ALL {
        for slave in functionalities() {
            let mut master = Commissioner::new(bus(rate), settings(rate), &slave).unwrap();
            let mut events = Vec::new();
            let done = master.run_until(Duration::from_secs(20), |_, event| {
                events.extend(event);
                events.iter().filter(|event| **event == Life::Exchanged).count() == 10
            });
            assert!(done.unwrap(), "{rate}: {events:?}");
            assert_eq!(events[..3], [Life::Online, Life::Configured, Life::Exchanged], "{rate}");
            assert_eq!(events.len(), 12, "{rate}: {events:?}");
            let due = [&INPUTS[..], &[0; 8]].concat();
            assert_eq!(master.inputs(), &due[..usize::from(slave.inputs)]);
            assert_eq!(master.diagnosis().unwrap().0.master_add, Some(2));
            let times = master.bus().times();
            let (least, most) = times.tsdr.unwrap();
            assert_eq!(least, rate.duration(BitTimes(11)), "{rate}");
            assert!(most <= rate.duration(rate.max_tsdr()), "{rate}");
            // profirust counts microseconds: above 1.5 Mbit/s they are too coarse.
            if rate <= Baudrate::B1500000 {
                assert!(times.idle.unwrap() >= rate.duration(BitTimes(33)), "{rate}: {:?}", times.idle);
            }
        }
    }
}

// The FCB guard: profirust does not begin a new sequence when a station falls silent.
#[test]
fn it_recovers_from_two_lost_replies_in_a_row() {
    let [_, slave, _] = functionalities();
    for lost in 1..=6 {
        let mut master = running(Baudrate::B500000, &slave);
        for _ in 0..lost {
            master.bus_mut().segment_mut().fail_next_reply(ReplyFault::Lose);
        }
        exchange(&mut master, 5);
        assert_eq!(master.inputs(), INPUTS, "{lost}");
        assert!(master.is_running());
        assert!(master.bus().traffic().retries >= 1, "{lost}");
    }
}

#[test]
fn a_preset_that_is_asked_for_again_is_executed_once() {
    let [_, slave, _] = functionalities();
    let mut master = running(Baudrate::B500000, &slave);
    master.outputs_mut().copy_from_slice(&[0x80, 0, 0, 0x64]);
    master.bus_mut().segment_mut().fail_next_reply(ReplyFault::Lose);
    exchange(&mut master, 1);
    master.outputs_mut().fill(0);
    exchange(&mut master, 4);
    assert_eq!(master.inputs(), [0, 0, 0, 0x64]);
}

// The values of the encoder example that profirust publishes: class 2, 18 user octets, configuration F1,
// 4096 units a turn of a range of 2^24, slot time 4000, three retries, master 3. Only ident and address are
// ours.
#[test]
fn the_encoder_example_of_profirust_runs_with_only_ident_and_address_set() {
    let user = [0x00, 0x0A, 0, 0, 0x10, 0, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let rate = Baudrate::B500000;
    let mut example = slave(&user, &[0xF1], 4, 4);
    (example.parameters.watchdog, example.max_tsdr) = (None, 100);
    let master = MasterSettings { address: 3, rate, slot_time: rate.duration(BitTimes(4000)), retries: 3 };
    let mut master = Commissioner::new(bus(rate), master, &example).unwrap();
    exchange(&mut master, 20);
    // 12345678h counts of 2^16 a turn are 01234567h of 2^12, modulo 2^24.
    assert_eq!(master.inputs(), [0x00, 0x23, 0x45, 0x67]);
}

#[test]
fn refused_parameters_and_configurations_are_told() {
    for (slave, due) in [
        (slave(&[0, 0xF0], &[0xD1], 4, 0), Life::ParametersRefused),
        (slave(CLASS_2, &[0x10], 1, 0), Life::ConfigurationRefused),
    ] {
        let rate = Baudrate::B1500000;
        let mut master = Commissioner::new(bus(rate), settings(rate), &slave).unwrap();
        let told = master.run_until(Duration::from_secs(1), |_, event| event == Some(due)).unwrap();
        assert!(told, "{due:?}");
    }
}

#[test]
fn a_slave_that_goes_and_comes_back_is_taken_again() {
    let [_, slave, _] = functionalities();
    let mut master = running(Baudrate::B1500000, &slave);
    let bus = master.bus_mut().segment_mut();
    let now = bus.now();
    let off = plant::World(sch108bex::health::Measurement { supply_mv: 0, ..plant::World::default().0 });
    bus.stations_mut()[0].set_world(now, off).unwrap();
    let gone = master.run_until(Duration::from_secs(1), |_, event| event == Some(Life::Offline)).unwrap();
    assert!(gone && !master.is_live());
    let bus = master.bus_mut().segment_mut();
    let now = bus.now();
    bus.stations_mut()[0].set_world(now, plant::World::default()).unwrap();
    exchange(&mut master, 3);
}

#[test]
fn an_alarm_is_fetched_by_itself() {
    let [_, slave, _] = functionalities();
    let mut master = running(Baudrate::B1500000, &slave);
    let bus = master.bus_mut().segment_mut();
    let now = bus.now();
    let low = plant::World(sch108bex::health::Measurement { supply_mv: 8_000, ..plant::World::default().0 });
    bus.stations_mut()[0].set_world(now, low).unwrap();
    let told = master.run_until(Duration::from_secs(1), |_, event| event == Some(Life::Diagnosis)).unwrap();
    assert!(told);
    let (standard, extended) = master.diagnosis().unwrap();
    assert!(standard.ext_diag && standard.stat_diag);
    // Header 57 octets less 6: 33h.
    assert_eq!((extended.len(), extended[0]), (51, 0x33));
}

#[test]
fn between_its_cycles_it_asks_for_what_profirust_does_not_know() {
    let [_, _, slave] = functionalities();
    let mut master = running(Baudrate::B1500000, &slave);
    master.outputs_mut().copy_from_slice(&[0, 0, 0, 7]);
    exchange(&mut master, 2);
    let inputs = [&INPUTS[..], &[0; 8]].concat();
    for round in 0..20 {
        for (service, due) in [
            (Service::GetCfg, &[0xF1, 0xD1, 0xD1][..]),
            (Service::RdInp, &inputs),
            (Service::RdOutp, &[0, 0, 0, 7]),
        ] {
            let asked = Asked { slave: ADDRESS, service, data: Vec::new() };
            let outcome = master.ask_within(Duration::from_millis(100), asked).unwrap();
            assert_eq!(outcome, Some(Outcome::Answer(8, due.to_vec())), "{round} {service}");
        }
        exchange(&mut master, 1 + round % 3);
    }
    assert_eq!(master.bus().traffic().retries, 0);
    let silent = Asked { slave: 77, service: Service::GetCfg, data: Vec::new() };
    assert_eq!(master.ask_within(Duration::from_millis(100), silent).unwrap(), Some(Outcome::Silent));
    let unlock = Asked { slave: ADDRESS, service: Service::SetPrm, data: vec![0x40, 0, 0, 0, 0x10, 0x8B, 0] };
    let outcome = master.ask_within(Duration::from_millis(100), unlock).unwrap();
    assert_eq!(outcome, Some(Outcome::Acknowledged));
    // It is taken again.
    exchange(&mut master, 3);
}

/// A slave that knows no more of a request than its FCB: what it must not take for a retry has another
/// one than what came before.
#[test]
fn a_question_never_looks_like_a_retry_nor_makes_the_next_request_look_like_one() {
    let [_, slave, _] = functionalities();
    let mut master = running(Baudrate::B1500000, &slave);
    for round in 0..20 {
        exchange(&mut master, 1 + round % 3);
        master.ask(Asked { slave: ADDRESS, service: Service::GetCfg, data: Vec::new() });
        let mut asked = false;
        let mut last = master.bus().traffic().last_function(ADDRESS);
        let mut sent = master.bus().traffic().telegrams;
        let done = master.run_until(Duration::from_millis(100), |master, _| {
            asked |= master.answer().is_some();
            let traffic = master.bus().traffic();
            let function = traffic.last_function(ADDRESS);
            if traffic.telegrams != sent && function != last {
                sent = traffic.telegrams;
                let begins = function & 0x10 == 0;
                assert!(begins || function & 0x20 != last & 0x20, "{last:02X} {function:02X}");
                last = function;
                return asked && function & 0x10 != 0;
            }
            false
        });
        assert!(done.unwrap());
    }
}

#[test]
fn an_address_is_set_between_cycles_and_the_slave_is_taken_there() {
    let rate = Baudrate::B1500000;
    let mut segment = VirtualSegment::new(Instant::ZERO, rate);
    segment.add(encoder_at(126, rate));
    let [slave, ..] = functionalities();
    let mut master = Commissioner::new(VirtualBus::new(segment), settings(rate), &slave).unwrap();
    let asked = Asked { slave: 126, service: Service::SetSlaveAdd, data: vec![ADDRESS, 0x10, 0x8B, 0] };
    let outcome = master.ask_within(Duration::from_millis(500), asked).unwrap();
    assert_eq!(outcome, Some(Outcome::Acknowledged));
    exchange(&mut master, 3);
}

#[test]
fn another_master_reads_in_the_pauses_of_the_owner() {
    let [_, slave, _] = functionalities();
    let mut owner = running(Baudrate::B1500000, &slave);
    owner.outputs_mut().copy_from_slice(&[0, 0, 0, 9]);
    for _ in 0..10 {
        exchange(&mut owner, 3);
        let other = Settings { address: 3, ..Settings::default() };
        let mut reader = LightMaster::new(owner.bus_mut().segment_mut(), other);
        assert_eq!(reader.diagnosis(ADDRESS).unwrap().standard.master_add, Some(2));
        assert_eq!(reader.read_inputs(ADDRESS).unwrap(), INPUTS);
        assert_eq!(reader.read_outputs(ADDRESS).unwrap(), [0, 0, 0, 9]);
        assert_eq!(reader.get_cfg(ADDRESS).unwrap(), [0xF1]);
        assert!(reader.exchange(ADDRESS, &[0; 4]).is_err());
    }
    assert!(owner.is_running());
}

#[test]
fn settings_that_cannot_be_are_sentences() {
    let good = slave(CLASS_1, &[0xD1], 4, 0);
    let rate = Baudrate::B500000;
    let refusal = |change: &dyn Fn(&mut MasterSettings, &mut SlaveSettings)| {
        let (mut master, mut slave) = (settings(rate), good.clone());
        change(&mut master, &mut slave);
        Commissioner::new(bus(rate), master, &slave).err().map(|error| error.to_string()).unwrap_or_default()
    };
    assert_eq!(refusal(&|_, _| ()), "");
    assert!(refusal(&|_, slave| slave.address = 126).contains("0 to 125"));
    assert!(refusal(&|master, _| master.address = 126).contains("0 to 125"));
    assert!(refusal(&|master, slave| master.address = slave.address).contains("another"));
    assert!(refusal(&|_, slave| slave.parameters.user = vec![0; 238]).contains("237 do"));
    assert!(refusal(&|_, slave| slave.configuration = vec![0; 245]).contains("244 do"));
    assert!(refusal(&|_, slave| slave.max_tsdr = 190).contains("slot time is 200"));
    assert!(refusal(&|master, _| master.retries = 16).contains("1 to 15"));
    assert!(refusal(&|_, slave| slave.parameters.min_tsdr = 10).contains("11 to 255"));
    let longest = Watchdog { factor_1: 255, factor_2: 255 };
    assert!(refusal(&|_, slave| slave.parameters.watchdog = Some(longest)).contains("650 s"));
}

fn over(address: &PortAddress, rate: Baudrate) {
    let far = open_for_slaves(address, BaudSetting::Fixed(rate)).unwrap();
    let name = far.name().trim_start_matches("unix:").to_owned();
    let encoder = common::real(far);
    let port: PortAddress = match address {
        PortAddress::Unix(_) => address.clone(),
        _ => name.parse().unwrap(),
    };
    for slave in functionalities() {
        let near = open_for_master(&port, rate, Duration::from_secs(5)).unwrap();
        let slot_time = Duration::from_millis(100);
        let settings = MasterSettings { retries: 3, slot_time, ..settings(rate) };
        let mut master = Commissioner::new(RealBus::new(near, rate).alone(), settings, &slave).unwrap();
        exchange(&mut master, 30);
        assert_eq!(master.inputs()[..4], INPUTS, "{port}");
    }
    encoder.end();
}

#[test]
fn it_exchanges_data_over_a_pseudo_terminal() {
    over(&PortAddress::Pty, Baudrate::B500000);
}

#[test]
fn it_exchanges_data_over_tcp() {
    over(&"tcp-listen:127.0.0.1:0".parse().unwrap(), Baudrate::B500000);
}

#[test]
fn it_exchanges_data_over_a_unix_socket() {
    let directory = tempfile::tempdir().unwrap();
    over(&PortAddress::Unix(directory.path().join("bus")), Baudrate::B500000);
}

#[test]
fn an_ident_number_of_another_device_is_a_parameter_fault() {
    let rate = Baudrate::B500000;
    let mut segment = VirtualSegment::new(Instant::ZERO, rate);
    segment.add(new_encoder(ADDRESS, 0x4711, Rate::Fixed(rate)));
    let [_, slave, _] = functionalities();
    let mut master = Commissioner::new(VirtualBus::new(segment), settings(rate), &slave).unwrap();
    let told =
        master.run_until(Duration::from_secs(1), |_, event| event == Some(Life::ParametersRefused)).unwrap();
    assert!(told);
    assert_eq!(master.diagnosis().unwrap().0.ident_number, 0x4711);
}
