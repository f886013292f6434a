//! The whole device: octets, time, shaft, world and power.
//!
//! Two devices live the same life. One gets whole telegrams as slices and the latches that matter;
//! the other octet by octet, and every latch. They must never differ.

mod pair;

use profibus_dp::time::{Baudrate, Duration};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::PositionErrorCause;
use sch108bex::health::{Battery, Measurement};
use sch108bex::specification::Variant;

use crate::tape::Tape;
use crate::telegrams::{service, telegram};
use pair::{Pair, Setting};

/// What a life costs at most.
const STEPS: usize = 200;

/// Times that matter: of a bit, a character, a latch, a watchdog, a velocity, a baud search, a write.
const SPANS_NS: [u64; 8] =
    [700, 22_000, 500_000, 2_000_000, 10_000_000, 100_000_000, 1_000_000_000, 3_000_000_000];

/// The first octets make the device, all others its life.
///
/// # Panics
///
/// When the two devices differ, or when one does what no device does.
pub fn device(octets: &[u8]) {
    let mut tape = Tape::new(octets);
    let mut pair = Pair::new(setting(&mut tape));
    for _ in 0..STEPS {
        if tape.is_over() {
            break;
        }
        step(&mut pair, &mut tape);
        pair.check();
    }
}

fn setting(tape: &mut Tape<'_>) -> Setting {
    let singleturn = 2 + tape.octet() % 15;
    let variant = Variant::new(singleturn, tape.octet() % 16).expect("2x0 to 16x15");
    let switches = match tape.octet() {
        0..=63 => 0x7E,
        64..=191 => 0x0B,
        other => other,
    };
    let rate = tape.pick(&Baudrate::ALL);
    Setting { variant, switches: RotarySwitches(switches), rate, search: tape.octet() & 1 == 1 }
}

fn step(pair: &mut Pair, tape: &mut Tape<'_>) {
    match tape.octet() % 16 {
        0..=3 => send(pair, tape),
        4 => pair.raw(tape_slice(tape)),
        5 | 6 => {
            let span = tape.pick(&SPANS_NS) * u64::from(tape.octet()) / 64;
            pair.pass(Duration::from_nanos(span));
        }
        7 => pair.shaft(i64::from(tape.double().cast_signed()), i64::from(tape.word().cast_signed())),
        8 => pair.measure(Measurement {
            supply_mv: i32::from(tape.word().cast_signed()),
            temperature_tenths: tape.word().cast_signed() / 16,
            light_ok: tape.octet() & 1 == 0,
            battery: tape.pick(&[Battery::Ok, Battery::Low, Battery::Empty]),
        }),
        9 => pair.power_cycle(usize::from(tape.octet())),
        10 => pair.line_error(),
        11 => pair.both(|device, now| device.position_error(now, PositionErrorCause::Injected)),
        12 => pair.both(|device, _| device.shut_down()),
        13 => pair.fail_next_write(),
        14 => start_up(pair, tape),
        _ => exchange(pair, tape),
    }
}

fn tape_slice<'a>(tape: &mut Tape<'a>) -> &'a [u8] {
    let length = usize::from(tape.octet());
    tape.slice(length)
}

/// A good telegram with any content.
fn send(pair: &mut Pair, tape: &mut Tape<'_>) {
    let address = pair.address().unwrap_or(11);
    let da = match tape.octet() {
        0..=199 => address,
        200..=219 => 127,
        other => other & 0x7F,
    };
    let (sa, fc) = (tape.octet() % 4, tape.octet());
    let dsap = tape.octet();
    let pdu = tape_slice(tape);
    let octets = match dsap & 0xC0 {
        0 => service(da, sa, fc | 0x40, dsap, pdu),
        0x40 => telegram(da, sa, fc | 0x40, pdu),
        _ => telegram(da | dsap & 0x80, sa | (dsap << 1) & 0x80, fc, pdu),
    };
    pair.telegram(&octets, tape.octet());
}

/// The way into data exchange, with any parameters.
fn start_up(pair: &mut Pair, tape: &mut Tape<'_>) {
    let address = pair.address().unwrap_or(11);
    let functionality = tape.octet() % 4;
    let choices = tape.octet();
    let watchdog = if choices & 1 == 0 { 0 } else { 0x08 };
    let mut parameters = vec![0x80 | 0x30 | watchdog, tape.octet(), tape.octet(), 11, 0x10, 0x8B, 1];
    parameters.push(if choices & 2 == 0 { 0 } else { 0x04 });
    parameters.push(if functionality == 0 { choices >> 7 } else { 0x02 | choices & 0x09 });
    if functionality > 0 {
        let units = tape.double() % 65_537;
        let range = tape.double() >> (tape.octet() % 32);
        parameters.extend(units.to_be_bytes());
        parameters.extend(range.to_be_bytes());
        parameters.resize(25, 0);
    }
    if functionality > 1 {
        parameters.push(tape.octet() % 5);
    }
    let configuration: &[u8] =
        [&[0xD1][..], &[0xF1], &[0xF1, 0xD1, 0xD1], &[0xF1, 0xD3]][usize::from(functionality)];
    pair.telegram(&service(address, 2, 0x6D, 61, &parameters), 0);
    pair.telegram(&service(address, 2, 0x6D, 62, configuration), 0);
    pair.telegram(&service(address, 2, 0x6D, 60, &[]), 0);
}

/// Data_Exchange with a new frame count bit each, or the same again.
fn exchange(pair: &mut Pair, tape: &mut Tape<'_>) {
    let address = pair.address().unwrap_or(11);
    for _ in 0..=tape.octet() % 4 {
        let fc = if tape.octet() & 1 == 0 { 0x5D } else { 0x7D };
        let outputs = tape.double().to_be_bytes();
        let outputs = if tape.octet().is_multiple_of(8) { &[][..] } else { &outputs };
        pair.telegram(&telegram(address, 2, fc, outputs), tape.octet());
    }
}
