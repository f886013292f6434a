//! The firmware, in an emulator, answers octet for octet what the virtual encoder answers: the same requests at the
//! same instants, the same shaft, the same world.

mod pair;
#[path = "../../../cli/tests/tools/mod.rs"]
mod tools;

use master::light::Settings;
use master::parameters::{Parameters, Watchdog};
use master::{LightMaster, Line};
use pair::Pair;
use plant::Shaft;
use profibus_dp::time::{Duration, Instant};
use sch108bex::health::Battery;
use sch108bex::specification::Variant;

const ADDRESS: u8 = 42;
const IDENT: u16 = 0x108B;

/// A master that hears both.
type Master = LightMaster<Pair>;

/// A functionality: its octets of Set_Prm from octet 8 on, its identifiers, its outputs (manual 4.1, 4.3).
struct Functionality {
    user: &'static [u8],
    cfg: &'static [u8],
    outputs: usize,
}

const CLASS_1: Functionality = Functionality { user: &[0x00, 0x01], cfg: &[0xD1], outputs: 0 };
// 3600 (0E10h) units, range 100 000 000 (05F5E100h); counter-clockwise, class 2, scaling.
const CLASS_2: Functionality = Functionality {
    user: &[0x00, 0x0B, 0, 0, 0x0E, 0x10, 0x05, 0xF5, 0xE1, 0x00, 0, 0, 0, 0, 0, 0, 0, 0],
    cfg: &[0xF1],
    outputs: 4,
};
// 4096 units, range 2^27; velocity in steps per 10 ms.
const SCANCON: Functionality = Functionality {
    user: &[0x00, 0x0A, 0, 0, 0x10, 0x00, 0x08, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x00],
    cfg: &[0xF1, 0xD1, 0xD1],
    outputs: 4,
};

fn pair(test: &str, switches: u8) -> Option<Master> {
    let tools = tools::firmware(test)?;
    let settings = Settings { retries: 0, ..Settings::default() };
    Some(LightMaster::new(Pair::start(&tools, switches, Variant::FULL), settings))
}

/// Into data exchange, with the diagnosis fetched before and after.
fn start_up(master: &mut Master, functionality: &Functionality, watchdog: Option<Watchdog>) {
    let parameters = Parameters {
        ident_number: IDENT,
        watchdog,
        min_tsdr: 11,
        sync: true,
        freeze: true,
        groups: 1,
        user: functionality.user.to_vec(),
    };
    master.diagnosis(ADDRESS).expect("a diagnosis");
    master.set_prm(ADDRESS, &parameters.set_prm()).expect("parameters");
    master.chk_cfg(ADDRESS, functionality.cfg).expect("a configuration");
    let diagnosis = master.diagnosis(ADDRESS).expect("a diagnosis");
    assert!(!diagnosis.standard.station_not_ready, "it does not exchange data");
}

/// Exchanges with pauses between; the diagnosis wherever there is news.
fn exchange(master: &mut Master, outputs: &[u8], times: usize, pause: Duration) {
    for _ in 0..times {
        let news = master.exchange(ADDRESS, outputs).expect("inputs").high_priority;
        if news {
            master.diagnosis(ADDRESS).expect("a diagnosis");
        }
        master.line_mut().wait(pause).expect("time");
    }
}

fn preset(value: u32) -> [u8; 4] {
    (value | 1 << 31).to_be_bytes()
}

const PAUSE: Duration = Duration::from_micros(1_700);

#[test]
fn a_day_of_each_functionality() {
    for functionality in [CLASS_1, CLASS_2, SCANCON] {
        let Some(mut master) = pair("lock_step::a_day_of_each_functionality", ADDRESS) else { return };
        assert!(master.status(ADDRESS).expect("a line").is_some());
        assert!(master.status(ADDRESS + 1).expect("a line").is_none());
        master.get_cfg(ADDRESS).expect("a configuration");
        start_up(&mut master, &functionality, None);
        let zero = [0; 4];
        let outputs = &zero[..functionality.outputs];
        exchange(&mut master, outputs, 3, PAUSE);
        master.line_mut().set_shaft(&Shaft::constant(1_500.0, 0, Instant::ZERO));
        exchange(&mut master, outputs, 40, PAUSE);
        master.line_mut().set_shaft(&Shaft::constant(-333.0, 0, Instant::ZERO));
        exchange(&mut master, outputs, 20, PAUSE);
        master.read_inputs(ADDRESS).expect("inputs");
        let read = master.read_outputs(ADDRESS).is_ok();
        assert_eq!(read, functionality.outputs == 4, "class 1 has none, and answers E5");
        if functionality.outputs == 4 {
            presets(&mut master);
        }
        warnings_and_alarms(&mut master, outputs);
        master.unlock(ADDRESS, IDENT).expect("unlocked");
        master.diagnosis(ADDRESS).expect("a diagnosis");
        master.line_mut().same_memory();
        assert!(master.line().compared > 90, "{}", master.line().compared);
    }
}

/// A rising edge presets, a bit that stays does not, one above the range does not.
fn presets(master: &mut Master) {
    for outputs in [preset(1_000), preset(1_000), [0; 4], preset(0x7FFF_FFFF), [0; 4], preset(77), [0; 4]] {
        exchange(master, &outputs, 2, PAUSE);
    }
    // The record of the last is written within a second after that of the first.
    for _ in 0..11 {
        exchange(master, &[0; 4], 1, Duration::from_millis(100));
    }
    master.line_mut().same_memory();
}

fn warnings_and_alarms(master: &mut Master, outputs: &[u8]) {
    let mut after = |change: fn(&mut plant::World)| {
        master.line_mut().set_world(change);
        exchange(master, outputs, 2, PAUSE);
    };
    after(|world| world.0.temperature_tenths = 651);
    after(|world| world.0.light_ok = false);
    after(|world| world.0.battery = Battery::Low);
    after(|world| world.0.supply_mv = 8_900);
    after(|world| world.0.supply_mv = 30_100);
    after(|world| world.0.supply_mv = 24_000);
    // The alarm is cleared after 100 ms within the range.
    exchange(master, outputs, 8, Duration::from_millis(20));
    let mut after = |change: fn(&mut plant::World)| {
        master.line_mut().set_world(change);
        exchange(master, outputs, 2, PAUSE);
    };
    after(|world| world.0.temperature_tenths = 650);
    after(|world| world.0.light_ok = true);
    after(|world| world.0.battery = Battery::Ok);
}

#[test]
fn what_is_refused() {
    let Some(mut master) = pair("lock_step::what_is_refused", ADDRESS) else { return };
    let standard = |user: &[u8]| {
        Parameters { ident_number: IDENT, min_tsdr: 11, user: user.to_vec(), ..Parameters::default() }
            .set_prm()
    };
    // 70000 (11170h) units; a foreign ident number; too short; a reserved bit of octet 8.
    let mut units = CLASS_2.user.to_vec();
    units[2..6].copy_from_slice(&[0x00, 0x01, 0x11, 0x70]);
    let mut foreign = standard(CLASS_2.user);
    foreign[4] = 0x47;
    for octets in [standard(&units), foreign, standard(&[])[..6].to_vec(), standard(&[0x80, 0x01])] {
        master.set_prm(ADDRESS, &octets).expect("acknowledged");
        master.diagnosis(ADDRESS).expect("a diagnosis");
    }
    master.chk_cfg(ADDRESS, &[0xF1]).expect_err("refused in Wait_Prm");
    master.set_prm(ADDRESS, &standard(CLASS_1.user)).expect("acknowledged");
    master.chk_cfg(ADDRESS, &[0xF1]).expect("acknowledged");
    master.diagnosis(ADDRESS).expect("a diagnosis");
    master.exchange(ADDRESS, &[0; 4]).expect_err("refused before data exchange");
    start_up(&mut master, &CLASS_2, None);
    master.exchange(ADDRESS, &[0; 3]).expect_err("a length that was not agreed");
    master.diagnosis(ADDRESS).expect("a diagnosis");
}

#[test]
fn retries_and_telegrams_that_are_wrong() {
    let Some(mut master) = pair("lock_step::retries_and_telegrams_that_are_wrong", ADDRESS) else { return };
    start_up(&mut master, &SCANCON, None);
    master.line_mut().set_shaft(&Shaft::constant(600.0, 0, Instant::ZERO));
    for round in 0..10_u32 {
        exchange(&mut master, &preset(1_000 * round), 1, PAUSE);
        let (request, reply) = master.last_exchange();
        let (request, reply) = (request.to_vec(), reply.to_vec());
        // The shaft has gone on, the answer has not: it is the one that was lost.
        assert_eq!(master.raw(&request).expect("a line"), reply);
        exchange(&mut master, &[0; 4], 1, PAUSE);
        let mut wrong = request.clone();
        let at = 4 + usize::try_from(round).expect("small") % (request.len() - 4);
        wrong[at] ^= 0x10;
        assert_eq!(master.raw(&wrong).expect("a line"), b"");
        // A pause, after which the receiver hears again.
        master.line_mut().wait(PAUSE).expect("time");
    }
}

#[test]
fn sync_freeze_and_clear() {
    let Some(mut master) = pair("lock_step::sync_freeze_and_clear", ADDRESS) else { return };
    start_up(&mut master, &CLASS_2, None);
    master.line_mut().set_shaft(&Shaft::constant(600.0, 0, Instant::ZERO));
    // Freeze, Unfreeze, Sync, Unsync, Clear_Data (bits 3, 2, 5, 4, 1), to group 1 and to group 2.
    for command in [0x08, 0x08, 0x04, 0x20, 0x10, 0x02] {
        for groups in [0x01, 0x02] {
            master.global_control(command, groups).expect("a line");
            exchange(&mut master, &preset(u32::from(command)), 2, PAUSE);
            exchange(&mut master, &[0; 4], 2, PAUSE);
        }
    }
    exchange(&mut master, &[], 2, PAUSE);
}

#[test]
fn the_watchdog_expires_at_the_same_time() {
    let Some(mut master) = pair("lock_step::the_watchdog_expires_at_the_same_time", ADDRESS) else { return };
    let watchdog = Watchdog { factor_1: 2, factor_2: 5 };
    start_up(&mut master, &CLASS_2, Some(watchdog));
    for pause in [50, 95, 105] {
        master.line_mut().wait(Duration::from_millis(pause)).expect("time");
        let answer = master.exchange(ADDRESS, &[0; 4]).map(|_| ());
        assert_eq!(answer.is_ok(), pause < 100, "after {pause} ms: {answer:?}");
    }
    start_up(&mut master, &SCANCON, Some(watchdog));
    exchange(&mut master, &[0; 4], 5, Duration::from_millis(60));
}

#[test]
fn power_cuts() {
    let Some(mut master) = pair("lock_step::power_cuts", ADDRESS) else { return };
    for round in 0..4_u32 {
        start_up(&mut master, &SCANCON, None);
        master.line_mut().set_shaft(&Shaft::constant(1_000.0, 0, Instant::ZERO));
        exchange(&mut master, &preset(50_000 + round), 3, PAUSE);
        exchange(&mut master, &[0; 4], 12, Duration::from_millis(100));
        if round == 2 {
            master.line_mut().set_world(|world| world.0.battery = Battery::Empty);
            exchange(&mut master, &[0; 4], 2, PAUSE);
        }
        if round == 3 {
            master.line_mut().set_world(|world| world.0.battery = Battery::Ok);
        }
        master.line_mut().cut_power(Duration::from_millis(30));
        master.line_mut().wait(Duration::from_millis(5)).expect("time");
        master.begin_sequence(ADDRESS);
        master.diagnosis(ADDRESS).expect("a diagnosis");
    }
}

#[test]
fn a_fault_of_the_sensor_is_kept_until_the_next_power_on() {
    let test = "lock_step::a_fault_of_the_sensor_is_kept_until_the_next_power_on";
    let Some(mut master) = pair(test, ADDRESS) else { return };
    start_up(&mut master, &CLASS_2, None);
    exchange(&mut master, &[0; 4], 2, PAUSE);
    master.line_mut().fault_once();
    exchange(&mut master, &[0; 4], 3, PAUSE);
    for _ in 0..2 {
        master.line_mut().cut_power(Duration::from_millis(30));
        master.line_mut().wait(Duration::from_millis(5)).expect("time");
        master.begin_sequence(ADDRESS);
        start_up(&mut master, &CLASS_2, None);
        exchange(&mut master, &[0; 4], 2, PAUSE);
    }
}

#[test]
fn an_address_is_set_and_kept() {
    let Some(mut master) = pair("lock_step::an_address_is_set_and_kept", 126) else { return };
    master.diagnosis(126).expect("a diagnosis");
    master.get_cfg(126).expect("a configuration");
    master.set_prm(126, &[0x88, 1, 1, 11, 0x10, 0x8B, 0, 0, 1]).expect_err("refused at 126");
    master.set_address(126, ADDRESS, IDENT ^ 1, false).expect("acknowledged, and not done");
    assert!(master.status(ADDRESS).expect("a line").is_none());
    master.set_address(126, ADDRESS, IDENT, false).expect("acknowledged");
    assert!(master.status(126).expect("a line").is_none());
    start_up(&mut master, &CLASS_2, None);
    exchange(&mut master, &[0; 4], 2, PAUSE);
    master.line_mut().cut_power(Duration::from_millis(30));
    master.line_mut().wait(Duration::from_millis(5)).expect("time");
    master.begin_sequence(ADDRESS);
    master.diagnosis(ADDRESS).expect("at the address that was set");
    // The switches win, at the next power-on.
    master.line_mut().set_switches(7);
    master.line_mut().cut_power(Duration::from_millis(30));
    master.line_mut().wait(Duration::from_millis(5)).expect("time");
    assert!(master.status(ADDRESS).expect("a line").is_none());
    assert!(master.status(7).expect("a line").is_some());
}
