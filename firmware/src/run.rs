//! The main loop: the world, the memory, the lamp, the watchdog.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use logic::memory::Writing;
use logic::world::{self, Message, PowerOn as LinkPowerOn, World};
use logic::{analog, as5047p, turns};
use profibus_dp::fdl::{BaudSetting, ReceiverMode};
use profibus_dp::time::{Baudrate, Instant};
use sch108bex::device::{NonvolatileWrite, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, SlotContent, choose};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

use crate::bus::{BUS, Bus, Line};
use crate::clock::{Clock, Scale};
use crate::link::{LINK, Link, Wire};
use crate::shaft::{SHAFT, Shaft};

/// The counter in lock-step: a latch is so many ticks.
static VIRTUAL: AtomicU32 = AtomicU32::new(0);
const VIRTUAL_LATCH: u32 = 500_000;
const VIRTUAL_SCALE: Scale = Scale(1 << 24);

/// The bench plays the world: the latch takes what the world link told.
pub static ON_BENCH: AtomicBool = AtomicBool::new(false);

/// So many turns of the main loop, one each latch, a memory may be busy with one page.
const PATIENCE: u8 = 30;

/// What a memory did with a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// It is busy with the one before.
    Busy,
    /// It has it.
    Yes,
    /// It does not answer at all.
    No,
}

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
    /// Latches by the timer begin or stop.
    fn run_latches(&self, on: bool);
    /// The latch's interrupt comes now.
    fn latch(&self);
    /// Switches the interrupts on: all cells are filled.
    fn start(&self);
    /// The lamp.
    fn lamp(&self, on: bool);
    /// The watchdog is satisfied for now.
    fn feed(&self);
    /// Whether the jumper says that a host plays the world.
    fn on_bench(&self) -> bool;
    /// The eight lines of the rotary switches.
    fn switches(&self) -> u8;
    /// The two lines of the termination switches.
    fn termination(&self) -> u8;
    /// The voltages, measured now.
    fn readings(&self) -> analog::Readings;
    /// Whether the part's own supply falls.
    fn power_fails(&self) -> bool;
    /// What the battery's registers hold.
    fn kept(&self) -> [u32; turns::WORDS];
    /// Writes a piece to the memory.
    fn write(&self, address: u16, octets: &[u8]) -> Taken;
    /// Reads a slot of the memory; not even all FFh where it does not answer.
    fn read(&self, address: u16) -> [u8; SLOT_OCTETS];
}

fn power_on(baud: BaudSetting, switches: u8, variant: Variant, stored: Choice, battery: Battery) -> PowerOn {
    PowerOn {
        identity: Identity {
            variant,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(switches),
        },
        stored,
        battery,
        baud,
        receiver: ReceiverMode::Idle,
    }
}

/// The device from start to end.
pub fn run(board: &impl Board) -> ! {
    let bench = board.on_bench();
    ON_BENCH.store(bench, Ordering::Relaxed);
    let mut stage = Stage {
        measured: None,
        lock_step: false,
        lamp: false,
        writing: None,
        tries: 0,
        latches: 0,
        failing: false,
    };
    // SAFETY: no interrupt is on yet.
    unsafe {
        Bus::make(BUS.begin());
        SHAFT.begin().write(None);
        Link::make(LINK.begin());
    }
    board.start();
    if !bench {
        power_up(board);
    }
    loop {
        stage.feed(board);
        #[cfg(feature = "panic-on-purpose")]
        assert!(stage.latches != u32::MAX, "on purpose");
        if bench {
            stage.listen(board);
        } else {
            stage.measure(board);
            stage.keep(board);
            cortex_m::asm::wfi();
        }
    }
}

/// What the main loop knows.
#[derive(Debug)]
struct Stage {
    measured: Option<Measurement>,
    lock_step: bool,
    /// What the lamp shows on the bench.
    lamp: bool,
    writing: Option<Writing>,
    /// How often the memory was busy with a piece.
    tries: u8,
    latches: u32,
    failing: bool,
}

impl Stage {
    /// The watchdog is for latches that come no more; on the bench the host may take its time.
    fn feed(&mut self, board: &impl Board) {
        let latches = SHAFT.lock(|shaft| shaft.as_ref().map_or(0, |shaft| shaft.latches));
        if latches != self.latches || ON_BENCH.load(Ordering::Relaxed) {
            self.latches = latches;
            board.feed();
        }
    }

    /// Supply, temperature, battery, and whether the end is near.
    fn measure(&mut self, board: &impl Board) {
        let measurement = board.readings().measurement(true);
        let failing = board.power_fails();
        let newly = failing && !self.failing;
        self.failing = failing;
        SHAFT.lock(|shaft| {
            if let Some(shaft) = shaft {
                if newly {
                    shaft.half.shut_down();
                }
                shaft.measure(&measurement);
            }
        });
        board.lamp(analog::lamp(&measurement, analog::termination(board.termination())));
    }

    /// Whatever the host says next.
    fn listen(&mut self, board: &impl Board) {
        self.keep(board);
        match LINK.lock(|link| link.message.take()) {
            Some(message) => self.obey(board, message),
            None => cortex_m::interrupt::free(|_| {
                // With interrupts off: none that comes now is slept over.
                if LINK.lock(|link| link.message.is_none()) {
                    cortex_m::asm::wfi();
                }
            }),
        }
    }

    #[inline(never)]
    fn obey(&mut self, board: &impl Board, message: Message) {
        let kind = match message {
            Message::Memory(slot, octets) => {
                LINK.lock(|link| *link.slot(slot) = octets);
                b'M'
            }
            Message::PowerOn(on) => {
                self.power_on(board, &on);
                b'P'
            }
            Message::Latch(world) => {
                self.latch(board, &world);
                b'L'
            }
            Message::More(count) => {
                for _ in 0..count {
                    self.step(board);
                    self.keep(board);
                }
                b'T'
            }
            Message::Cut => {
                board.run_latches(false);
                SHAFT.lock(|shaft| *shaft = None);
                BUS.lock(|bus| bus.stop(board.line()));
                b'C'
            }
            Message::Hello(number) => {
                tell(board, b'H', &[number]);
                return;
            }
        };
        let latches = SHAFT.lock(|shaft| shaft.as_ref().map_or(0, |shaft| shaft.latches));
        let [a, b, c, d] = latches.to_le_bytes();
        tell(board, b'A', &[kind, u8::from(self.lamp), a, b, c, d]);
    }

    #[inline(never)]
    fn power_on(&mut self, board: &impl Board, on: &LinkPowerOn) {
        board.run_latches(false);
        let rate = Baudrate::ALL.get(usize::from(on.rate)).copied().unwrap_or(Baudrate::B500000);
        let baud = if on.search { BaudSetting::Search(rate) } else { BaudSetting::Fixed(rate) };
        let power_on = power_on(baud, on.switches, on.variant, played(on.as_delivered), on.battery);
        (self.measured, self.lock_step) = (None, on.lock_step);
        let (counter, scale) =
            if on.lock_step { (VIRTUAL.as_ptr().cast_const(), VIRTUAL_SCALE) } else { board.counter() };
        // SAFETY: both can be read for ever.
        let clock = unsafe { Clock::new(counter, scale) };
        begin(board, clock, on.paced, power_on);
        board.run_latches(!on.lock_step);
    }

    #[inline(never)]
    fn latch(&mut self, board: &impl Board, world: &World) {
        SHAFT.lock(|shaft| {
            if let Some(shaft) = shaft {
                shaft.reading = world.shaft;
            }
        });
        self.lamp = analog::lamp(&world.measurement, world.termination);
        board.lamp(self.lamp);
        self.step(board);
        if self.measured != Some(world.measurement) {
            self.measured = Some(world.measurement);
            SHAFT.lock(|shaft| {
                if let Some(shaft) = shaft {
                    shaft.measure(&world.measurement);
                }
            });
        }
        self.keep(board);
    }

    /// In lock-step the next latch.
    fn step(&mut self, board: &impl Board) {
        let latches = SHAFT.lock(|shaft| shaft.as_ref().map(|shaft| shaft.latches));
        if let (true, Some(latches)) = (self.lock_step, latches) {
            if latches != 0 {
                VIRTUAL.store(VIRTUAL.load(Ordering::Relaxed).wrapping_add(VIRTUAL_LATCH), Ordering::Relaxed);
            }
            board.latch();
        }
    }

    /// Time and memory.
    #[inline(never)]
    fn keep(&mut self, board: &impl Board) {
        let (address, changed) = BUS.lock(|bus| (bus.half.stored_address(), bus.half.take_address_change()));
        let write = SHAFT.lock(|shaft| shaft.as_mut().and_then(|shaft| shaft.take(address, changed)));
        if let Some(write) = write {
            self.write(board, &write);
        }
        if let Some(writing) = &mut self.writing {
            let taken = writing.piece().map(|piece| board.write(piece.address, piece.octets));
            match taken {
                Some(Taken::Busy) if self.tries < PATIENCE => self.tries = self.tries.wrapping_add(1),
                Some(Taken::Yes) => {
                    self.tries = 0;
                    writing.taken();
                }
                Some(Taken::Busy | Taken::No) => self.finish(false),
                None => self.finish(true),
            }
        }
    }

    fn write(&mut self, board: &impl Board, write: &NonvolatileWrite) {
        if !ON_BENCH.load(Ordering::Relaxed) {
            self.writing = Some(Writing::new(write.slot, write.octets));
            return;
        }
        LINK.lock(|link| *link.slot(write.slot) = write.octets);
        let mut payload = [world::slot_number(write.slot); 1 + SLOT_OCTETS];
        let [_, octets @ ..] = &mut payload;
        *octets = write.octets;
        tell(board, b'N', &payload);
        self.finish(true);
    }

    fn finish(&mut self, written: bool) {
        (self.writing, self.tries) = (None, 0);
        SHAFT.lock(|shaft| {
            if let Some(shaft) = shaft {
                shaft.written(written);
            }
        });
    }
}

/// Power has come, with a shaft of its own.
#[inline(never)]
fn power_up(board: &impl Board) {
    let (stored, battery) = stored(board);
    let Ok(variant) = Variant::new(as5047p::BITS, 15) else { return };
    let baud = BaudSetting::Search(Baudrate::B1500000);
    let switches = analog::switches(board.switches());
    let (counter, scale) = board.counter();
    // SAFETY: the counter is a register.
    let clock = unsafe { Clock::new(counter, scale) };
    begin(board, clock, true, power_on(baud, switches, variant, stored, battery));
    board.run_latches(true);
}

/// Both halves begin.
#[inline(never)]
fn begin(board: &impl Board, clock: Clock, paced: bool, power_on: PowerOn) {
    let timing = clock.timing();
    SHAFT.lock(|place| {
        *place = Some(Shaft::new(
            BUS.lock(|bus| bus.restart(clock, paced, power_on, board.line())),
            Instant::ZERO,
            timing,
        ));
    });
}

/// What the memory, the battery's registers and the battery have kept.
// By itself: what it needs on the stack is gone when the halves begin.
#[inline(never)]
fn stored(board: &impl Board) -> (Choice, Battery) {
    let (a, b) = (load(board, Slot::A), load(board, Slot::B));
    let voltage = turns::battery(board.readings().battery_mv());
    turns::start(choose(a, b), turns::kept(board.kept()), voltage)
}

/// What the world link's memory holds.
#[inline(never)]
fn played(as_delivered: bool) -> Choice {
    LINK.lock(|link| {
        if as_delivered {
            link.slots = [[0xFF; SLOT_OCTETS]; 2];
        }
        choose(Record::decode(link.slot(Slot::A)), Record::decode(link.slot(Slot::B)))
    })
}

/// What a slot of the memory holds.
#[inline(never)]
fn load(board: &impl Board, slot: Slot) -> SlotContent {
    Record::decode(&board.read(logic::memory::address(slot)))
}

#[inline(never)]
fn tell(board: &impl Board, kind: u8, payload: &[u8]) {
    world::frame(kind, payload, |octet| board.wire().send(octet));
}
