//! The encoder of the product as a subject of the slave checks.

use conformance::rig::Battery as Cell;
use conformance::{Action, Device, Hand, Order, Subject};
use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Baudrate, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::event::PositionErrorCause;
use sch108bex::health::Battery;
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

/// The address that the switches say, but for cases about 126.
const ADDRESS: u8 = 5;

pub(crate) struct Encoder {
    variant: Variant,
    bits: (u8, u8),
}

impl Encoder {
    /// 16 and 15 bits.
    pub(crate) fn full() -> Self {
        Self::new(16, 15)
    }

    pub(crate) fn new(n: u8, m: u8) -> Self {
        let variant = Variant::new(n, m).expect("a variant");
        Self { variant, bits: (n, m) }
    }

    pub(crate) fn device(&self) -> Device {
        let mut device = Device::encoder(ADDRESS, self.bits.0, self.bits.1);
        device.ident = Some(PLACEHOLDER_IDENT);
        device.encoder.as_mut().expect("an encoder").serial = Some("1234567".to_owned());
        device
    }

    fn station(&self, now: Instant, order: Order) -> EncoderStation {
        let switches = order.address.unwrap_or(126);
        let setup = EncoderSetup {
            identity: Identity {
                variant: self.variant,
                ident_number: PLACEHOLDER_IDENT,
                serial_number: SerialNumber::DEFAULT,
                switches: RotarySwitches(switches),
            },
            configurations: Configurations::default(),
            rate: if order.search { Rate::Search(Baudrate::B12000000) } else { Rate::Fixed(order.rate) },
            termination: TerminationSwitches::ON,
            shaft: Shaft::still(0),
            world: World::default(),
            store: Store::forgetful(),
            reporter: Reporter::new("encoder", None),
        };
        EncoderStation::new(now, setup).expect("a forgetful store")
    }
}

impl Subject for Encoder {
    type Station = EncoderStation;

    fn power_on(&mut self, now: Instant, order: &Order) -> EncoderStation {
        self.station(now, *order)
    }

    fn has(&self, _: Hand) -> bool {
        true
    }

    fn act(&mut self, station: &mut Option<EncoderStation>, now: Instant, action: &Action, _: &Order) {
        let Some(encoder) = station else { return };
        let World(mut world) = encoder.world();
        let power =
            |encoder: &mut EncoderStation, on| encoder.switch_power(now, on).expect("a forgetful store");
        match *action {
            Action::PowerOff => return power(encoder, false),
            Action::PowerOn => return power(encoder, true),
            Action::Switches(switches) => return encoder.set_switches(RotarySwitches(switches)),
            Action::Shaft(raw) => return encoder.set_shaft(now, Shaft::still(raw)),
            Action::Turn(rpm) => {
                return encoder.set_shaft_from_here(now, Shaft::constant(rpm, 0, Instant::ZERO));
            }
            Action::PositionError => {
                return encoder.position_error(now, PositionErrorCause::Injected);
            }
            Action::OperatingTime(tenths) => {
                power(encoder, false);
                encoder.set_operating_time(tenths * 360_000).expect("without power it can be set");
                return power(encoder, true);
            }
            Action::Supply(tenths) => world.supply_mv = tenths * 100,
            Action::Temperature(tenths) => world.temperature_tenths = tenths,
            Action::Light(ok) => world.light_ok = ok,
            Action::Battery(cell) => {
                world.battery = match cell {
                    Cell::Ok => Battery::Ok,
                    Cell::Low => Battery::Low,
                    Cell::Empty => Battery::Empty,
                };
            }
        }
        encoder.set_world(now, World(world)).expect("a forgetful store");
    }
}
