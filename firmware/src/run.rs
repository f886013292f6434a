//! The main loop: the world, the memory, the lamp, the watchdog.

use core::sync::atomic::{AtomicU32, Ordering};

use logic::world::{self, Message, PowerOn as LinkPowerOn, World};
use profibus_dp::fdl::{BaudSetting, ReceiverMode};
use profibus_dp::time::{Baudrate, Instant};
use sch108bex::device::{Device, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::halves::{BusHalf, ShaftHalf};
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, choose};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

use crate::bus::{BUS, Bus, Line};
use crate::clock::{Clock, Scale};
use crate::link::{LINK, Link, Wire};
use crate::shaft::{SHAFT, Shaft};

/// The counter in lock-step: a latch is so many ticks.
static VIRTUAL: AtomicU32 = AtomicU32::new(0);
const VIRTUAL_LATCH: u32 = 500_000;
const VIRTUAL_SCALE: Scale = Scale(1 << 24);

/// What the main loop needs of a board.
pub trait Board {
    /// The bus USART.
    type Line: Line;
    /// The USART of the world link.
    type Wire: Wire;
    /// The bus USART.
    fn line(&self) -> &Self::Line;
    /// The USART of the world link.
    fn wire(&self) -> &Self::Wire;
    /// The free-running counter and its ticks.
    fn counter(&self) -> (*const u32, Scale);
    /// Latches by the timer begin or stop; the counter at the first.
    fn run_latches(&self, on: bool);
    /// The latch's interrupt comes now.
    fn latch(&self);
    /// Switches the interrupts on: all cells are filled.
    fn start(&self);
    /// The lamp.
    fn lamp(&self, on: bool);
    /// The watchdog is satisfied for now.
    fn feed(&self);
}

fn power_on(rate: BaudSetting, switches: u8, variant: Variant, stored: Choice, battery: Battery) -> PowerOn {
    PowerOn {
        identity: Identity {
            variant,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(switches),
        },
        stored,
        battery,
        baud: rate,
        receiver: ReceiverMode::Idle,
    }
}

#[inline(never)]
fn switch_on(power_on: PowerOn) -> (BusHalf, ShaftHalf) {
    Device::new(Instant::ZERO, power_on, ()).into_halves()
}

/// The device from start to end.
pub fn run(board: &impl Board) -> ! {
    let (counter, scale) = board.counter();
    // Without power, so to say: no address, no reply.
    let off =
        power_on(BaudSetting::Fixed(Baudrate::B500000), 0, Variant::FULL, Choice::AsDelivered, Battery::Ok);
    let (bus, shaft) = switch_on(off);
    // SAFETY: no interrupt is on; the counter is a register.
    unsafe {
        let clock = Clock::new(counter, scale);
        SHAFT.begin(Shaft::new(shaft, Instant::ZERO, &clock));
        BUS.begin(Bus::new(bus, clock));
        LINK.begin(Link::new());
    }
    board.start();
    let mut stage = Stage { measured: None, powered: false, lock_step: false };
    loop {
        board.feed();
        if stage.powered {
            stage.keep(board);
        }
        match LINK.lock(|link| link.message.take()) {
            Some(message) => stage.obey(board, &message),
            None => cortex_m::interrupt::free(|_| {
                // With interrupts off: none that comes now is slept over.
                if LINK.lock(|link| link.message.is_none()) {
                    cortex_m::asm::wfi();
                }
            }),
        }
    }
}

/// What the main loop knows.
#[derive(Debug)]
struct Stage {
    measured: Option<Measurement>,
    powered: bool,
    lock_step: bool,
}

impl Stage {
    fn obey(&mut self, board: &impl Board, message: &Message) {
        let kind = match message {
            Message::Memory(slot, octets) => {
                LINK.lock(|link| link.slots[usize::from(world::slot_number(*slot))] = *octets);
                b'M'
            }
            Message::PowerOn(on) => {
                self.power_on(board, on);
                b'P'
            }
            Message::Latch(world) => {
                self.latch(board, world);
                self.keep(board);
                b'L'
            }
            Message::Cut => {
                self.cut(board);
                b'C'
            }
            Message::Hello(number) => {
                world::frame(b'H', &[*number], |octet| board.wire().send(octet));
                return;
            }
        };
        let latches = SHAFT.lock(|shaft| shaft.latches);
        let [a, b, c, d] = latches.to_le_bytes();
        world::frame(b'A', &[kind, 0, a, b, c, d], |octet| board.wire().send(octet));
    }

    fn cut(&mut self, board: &impl Board) {
        board.run_latches(false);
        self.powered = false;
        let off = power_on(
            BaudSetting::Fixed(Baudrate::B500000),
            0,
            Variant::FULL,
            Choice::AsDelivered,
            Battery::Ok,
        );
        let (bus, shaft) = switch_on(off);
        let (counter, scale) = board.counter();
        // SAFETY: the counter is a register.
        let clock = unsafe { Clock::new(counter, scale) };
        SHAFT.lock(|place| *place = Shaft::new(shaft, Instant::ZERO, &clock));
        BUS.lock(|place| place.restart(bus, clock, false, board.line()));
    }

    fn power_on(&mut self, board: &impl Board, on: &LinkPowerOn) {
        board.run_latches(false);
        let slots = LINK.lock(|link| {
            if on.as_delivered {
                link.slots = [[0xFF; SLOT_OCTETS]; 2];
            }
            link.slots
        });
        let stored = choose(Record::decode(&slots[0]), Record::decode(&slots[1]));
        let rate = Baudrate::ALL[usize::from(on.rate % 10)];
        let baud = if on.search { BaudSetting::Search(rate) } else { BaudSetting::Fixed(rate) };
        let power_on = power_on(baud, on.switches, on.variant, stored, on.battery);
        let (bus, shaft) = switch_on(power_on);
        self.measured = None;
        self.powered = true;
        self.lock_step = on.lock_step;
        // SAFETY: both can be read for ever.
        let clock = unsafe {
            if on.lock_step {
                Clock::new(VIRTUAL.as_ptr(), VIRTUAL_SCALE)
            } else {
                let (counter, scale) = board.counter();
                Clock::new(counter, scale)
            }
        };
        SHAFT.lock(|place| *place = Shaft::new(shaft, Instant::ZERO, &clock));
        BUS.lock(|place| place.restart(bus, clock, on.paced, board.line()));
        if !on.lock_step {
            board.run_latches(true);
        }
    }

    fn latch(&mut self, board: &impl Board, world: &World) {
        if !self.powered {
            return;
        }
        let first = SHAFT.lock(|shaft| {
            shaft.reading = world.shaft;
            shaft.latches == 0
        });
        if self.lock_step {
            if !first {
                VIRTUAL.fetch_add(VIRTUAL_LATCH, Ordering::Relaxed);
            }
            board.latch();
        }
        if self.measured != Some(world.measurement) {
            self.measured = Some(world.measurement);
            SHAFT.lock(|shaft| {
                let now = BUS.lock(|bus| bus.clock.now());
                shaft.half.measure(now, &world.measurement, &mut ());
                shaft.publish();
            });
        }
    }

    /// Time and memory.
    fn keep(&mut self, board: &impl Board) {
        if !self.powered {
            return;
        }
        BUS.lock(|bus| bus.poll(board.line()));
        let (now, address, changed) =
            BUS.lock(|bus| (bus.clock.now(), bus.half.stored_address(), bus.half.take_address_change()));
        let write = SHAFT.lock(|shaft| {
            if shaft.half.poll(now, &mut ()) {
                shaft.publish();
            }
            shaft.half.take_nonvolatile(now, address, changed)
        });
        if let Some(write) = write {
            let slot = world::slot_number(write.slot);
            LINK.lock(|link| link.slots[usize::from(slot)] = write.octets);
            let mut payload = [slot; SLOT_OCTETS + 1];
            payload[1..].copy_from_slice(&write.octets);
            world::frame(b'N', &payload, |octet| board.wire().send(octet));
            SHAFT.lock(|shaft| shaft.half.confirm_nonvolatile());
        }
    }
}
