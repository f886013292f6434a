//! The whole public device behind one entry point, without a way to panic.
//!
//! The panic handler calls a function that exists nowhere, so that this links only if the linker
//! can throw the handler away: `cargo xtask test` tries it.
#![no_std]

use core::hint::black_box;
use core::panic::PanicInfo;

use profibus_dp::Station;
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Window};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::telegram::{Parsed, parse};
use sch108bex::device::{Device, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::{Event, Observer, PositionErrorCause};
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Record, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SerialNumber, Variant};

unsafe extern "C" {
    /// Exists nowhere.
    fn a_panic_can_be_reached() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    // SAFETY: never linked.
    unsafe { a_panic_can_be_reached() }
}

/// Looks at every event, so that none is optimised away.
pub struct Told;

impl Observer for Told {
    fn observe(&mut self, now: Instant, event: &Event) {
        black_box((now, event));
    }
}

/// What is called, and with what: nothing that the compiler knows anything about.
pub struct Call<'a> {
    which: u8,
    now: Instant,
    number: i64,
    octets: &'a [u8],
}

/// Does a call, on a device that may be in any state.
#[unsafe(no_mangle)]
pub fn entry(device: &mut Option<Device<Told>>, call: &Call<'_>) -> bool {
    #[cfg(feature = "panic-on-purpose")]
    if call.which == u8::MAX {
        black_box(call.octets[3]);
    }
    if device.is_none() {
        *device = switch_on(call);
    }
    device
        .as_mut()
        .is_some_and(|device| if call.which < 8 { bus_side(device, call) } else { other_side(device, call) })
}

/// Any identity, any content of the non-volatile memory.
fn switch_on(call: &Call<'_>) -> Option<Device<Told>> {
    let [n, m, switches, rate, ident @ ..] = call.number.to_be_bytes();
    let (one, two) = call.octets.split_at_checked(usize::from(n))?;
    let rate = *Baudrate::ALL.get(usize::from(rate))?;
    let identity = Identity {
        variant: Variant::new(n, m).ok()?,
        ident_number: u16::from_be_bytes(*ident.first_chunk()?),
        serial_number: SerialNumber::from_octets(*call.octets.first_chunk()?)?,
        switches: RotarySwitches(switches),
    };
    let power_on = PowerOn {
        identity,
        stored: choose(Record::decode(one), Record::decode(two)),
        battery: battery(call),
        baud: if m == 0 { BaudSetting::Fixed(rate) } else { BaudSetting::Search(rate) },
        receiver: if n == 9 { ReceiverMode::Idle } else { ReceiverMode::Stream },
    };
    Some(Device::new(call.now, power_on, Told))
}

/// The calls of the station.
fn bus_side(device: &mut Device<Told>, call: &Call<'_>) -> bool {
    let now = call.now;
    let told = |window: Option<Window>| black_box(window).is_some();
    match call.which {
        0 => told(device.receive(now, call.octets)),
        1 => match parse(call.octets) {
            Parsed::Complete(telegram, _) => told(device.indicate(now, &telegram)),
            other => black_box(other) == Parsed::Incomplete { missing: 1 },
        },
        2 => {
            device.line_error(now);
            true
        }
        3 => black_box(device.transmit(now)).is_some(),
        4 => {
            device.poll(now);
            true
        }
        5 => black_box(device.next_deadline()).is_some(),
        6 => black_box((device.listening_rate(), device.address())).1.is_some(),
        _ => {
            device.forget_unfinished();
            device.set_baudrate(now, device.listening_rate().next_lower());
            true
        }
    }
}

/// The calls of the shaft, the world and the non-volatile memory.
fn other_side(device: &mut Device<Told>, call: &Call<'_>) -> bool {
    let (now, number) = (call.now, call.number);
    match call.which {
        8 => device.sample(now, ShaftReading::Full(number)),
        9 => device.sample(now, ShaftReading::Singleturn(number as u16)),
        10 => device.sample(now, ShaftReading::Fault),
        11 => black_box(device.latch_needed(now)).is_some(),
        12 => {
            let measurement = Measurement {
                supply_mv: number as i32,
                temperature_tenths: (number >> 32) as i16,
                light_ok: number < 0,
                battery: battery(call),
            };
            device.measure(now, &measurement);
            true
        }
        13 => {
            device.position_error(now, PositionErrorCause::Injected);
            true
        }
        14 => black_box(device.take_nonvolatile(now)).is_some(),
        15 => {
            device.confirm_nonvolatile();
            true
        }
        16 => {
            device.nonvolatile_failed(now);
            true
        }
        17 => {
            device.shut_down();
            true
        }
        18 => {
            let sensor = device.sensor();
            black_box((sensor.position(), sensor.velocity(), sensor.acceleration(), sensor.offset()));
            black_box((
                sensor.diagnostics(&device.encoder().identity().serial_number),
                device.effective_address(),
            ));
            true
        }
        _ => false,
    }
}

fn battery(call: &Call<'_>) -> Battery {
    match call.octets.len() {
        0..30 => Battery::Ok,
        30..60 => Battery::Low,
        _ => Battery::Empty,
    }
}
