//! The STM32G474's part of the end cap: sensor on SPI2, memory on I2C1, voltages, battery's registers.

use logic::analog::{self, Readings};
use logic::{as5047p, turns};
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::sensor::ShaftReading;
use stm32g4::stm32g474 as pac;

use crate::cell::Latched;
use crate::run::Taken;

/// So often a flag of I2C or of the converter is looked at: a millisecond and more.
const PATIENCE: u32 = 20_000;
/// The memory's address on I2C, for writing.
const MEMORY: u32 = 0xA0;
/// Latches during which the sensor may say that it is not ready yet.
const WARM_UP: u8 = 40;

/// A latch on its way through SPI.
#[derive(Debug, Default)]
pub struct Spi {
    errors: u16,
    second: bool,
    warm: u8,
}

/// The one sensor.
pub static SPI: Latched<Spi> = Latched::new();

fn spi2() -> &'static pac::spi1::RegisterBlock {
    // SAFETY: registers; only interrupts of the latch's priority come here.
    unsafe { &*pac::SPI2::ptr() }
}

fn i2c1() -> &'static pac::i2c1::RegisterBlock {
    // SAFETY: registers; only the main loop comes here.
    unsafe { &*pac::I2C1::ptr() }
}

fn select(on: bool) {
    // SAFETY: a write that sets or resets PB12 alone.
    unsafe { (*pac::GPIOB::ptr()).bsrr().write(|w| w.bits(if on { 1 << 28 } else { 1 << 12 })) };
}

fn exchange(command: u16) {
    select(true);
    // SAFETY: a frame.
    spi2().dr().write(|w| unsafe { w.bits(command) });
}

impl Spi {
    /// Begins a latch.
    pub fn begin(&mut self) {
        self.second = false;
        exchange(as5047p::READ_ANGLE);
    }

    /// A frame is complete; what the latch has brought, if it was the second.
    pub fn complete(&mut self) -> Option<ShaftReading> {
        let answer = spi2().dr().read().bits();
        select(false);
        if !self.second {
            (self.errors, self.second) = (answer, true);
            // The sensor wants 350 ns between frames.
            cortex_m::asm::delay(60);
            exchange(as5047p::READ_ERRORS);
            return None;
        }
        let reading = as5047p::reading(self.errors, answer);
        if reading == ShaftReading::Fault && self.warm < WARM_UP {
            self.warm = self.warm.wrapping_add(1);
            return None;
        }
        self.warm = WARM_UP;
        Some(reading)
    }
}

/// Switches the converter on and lets it calibrate itself (RM0440, 21.4).
pub fn start_converter() {
    // SAFETY: registers; nothing else runs yet; fields of the reference manual, named beside each.
    unsafe {
        let (common, converter) = (&*pac::ADC12_COMMON::ptr(), &*pac::ADC1::ptr());
        // CKMODE: the bus clock by 4; VSENSESEL, VBATSEL.
        common.ccr().write(|w| w.bits(3 << 16 | 1 << 23 | 1 << 24));
        // DEEPPWD off, ADVREGEN on, 20 us; ADCAL.
        converter.cr().write(|w| w.bits(1 << 28));
        cortex_m::asm::delay(20 * 168);
        converter.cr().write(|w| w.bits(1 << 28 | 1 << 31));
        let _ = (0..PATIENCE).any(|_| converter.cr().read().bits() & 1 << 31 == 0);
        // ADEN, ADRDY.
        converter.cr().write(|w| w.bits(1 << 28 | 1));
        let _ = (0..PATIENCE).any(|_| converter.isr().read().bits() & 1 != 0);
        // 640 cycles for all channels: the temperature sensor and the battery want some us.
        converter.smpr1().write(|w| w.bits(0o7_777_777_777));
        converter.smpr2().write(|w| w.bits(0o777_777_777));
    }
}

/// Voltages, measured one after the other; 0 where the converter does not end.
pub fn readings() -> Readings {
    // SAFETY: registers; only the main loop comes here.
    let converter = unsafe { &*pac::ADC1::ptr() };
    let convert = |channel: u32| {
        // SAFETY: any channel may be first in the sequence; EOC off, ADSTART.
        unsafe {
            converter.sqr1().write(|w| w.bits(channel << 6));
            converter.isr().write(|w| w.bits(1 << 2));
            converter.cr().modify(|r, w| w.bits(r.bits() | 1 << 2));
        }
        let ended = (0..PATIENCE).any(|_| converter.isr().read().bits() & 1 << 2 != 0);
        let [low, high, ..] = converter.dr().read().bits().to_le_bytes();
        if ended { u16::from_le_bytes([low, high]) } else { 0 }
    };
    Readings { supply: convert(1), temperature: convert(16), battery: convert(17), part: analog::STM32G474 }
}

/// What the battery's registers hold.
pub fn kept() -> [u32; turns::WORDS] {
    // SAFETY: registers that can be read.
    let registers = unsafe { &*pac::TAMP::ptr() };
    [registers.bkp0r(), registers.bkp1r(), registers.bkp2r(), registers.bkp3r()]
        .map(|register| register.read().bits())
}

/// Into the battery's registers, in order.
pub fn keep(words: [u32; turns::WORDS]) {
    // SAFETY: registers; only interrupts of the latch's priority write them.
    let registers = unsafe { &*pac::TAMP::ptr() };
    let registers = [registers.bkp0r(), registers.bkp1r(), registers.bkp2r(), registers.bkp3r()];
    for (register, word) in registers.into_iter().zip(words) {
        // SAFETY: any value.
        register.write(|w| unsafe { w.bits(word) });
    }
}

/// TXIS, RXNE, NACKF, STOPF, TC of ISR.
const ROOM: u32 = 1 << 1;
const FULL: u32 = 1 << 2;
const REFUSED: u32 = 1 << 4;
const STOPPED: u32 = 1 << 5;
const COMPLETE: u32 = 1 << 6;
/// RD_WRN, START, AUTOEND of CR2.
const READ: u32 = 1 << 10;
const START: u32 = 1 << 13;
const BY_ITSELF: u32 = 1 << 25;

/// Waits for a flag.
fn wait(flag: u32) -> Taken {
    for _ in 0..PATIENCE {
        let status = i2c1().isr().read().bits();
        if status & REFUSED != 0 {
            return Taken::Busy;
        }
        if status & flag != 0 {
            return Taken::Yes;
        }
    }
    Taken::No
}

/// Start, the memory's address, and how many octets come.
fn start(count: usize, how: u32) {
    let [count, ..] = count.to_le_bytes();
    // SAFETY: as the reference manual has the fields (RM0440, 41.9.2).
    i2c1().cr2().write(|w| unsafe { w.bits(MEMORY | how | START | u32::from(count) << 16) });
}

/// Address and octets, then `after`.
fn transfer(place: u16, octets: &[u8], how: u32, after: u32) -> Taken {
    start(octets.len().wrapping_add(2), how);
    let mut taken = Taken::Yes;
    for octet in place.to_be_bytes().iter().chain(octets) {
        if taken == Taken::Yes {
            taken = wait(ROOM);
            // SAFETY: an octet.
            i2c1().txdr().write(|w| unsafe { w.bits((*octet).into()) });
        }
    }
    if taken == Taken::Yes { wait(after) } else { taken }
}

/// Takes NACKF and STOPF away.
fn clear() {
    // SAFETY: these two; and TXE, so that an octet that was not wanted goes nowhere.
    unsafe {
        i2c1().icr().write(|w| w.bits(REFUSED | STOPPED));
        i2c1().isr().write(|w| w.bits(1));
    }
}

/// Writes a piece; busy while the one before is being written.
pub fn write(place: u16, octets: &[u8]) -> Taken {
    let taken = transfer(place, octets, BY_ITSELF, STOPPED);
    clear();
    taken
}

/// Reads a slot; zeros from where the memory does not answer.
pub fn read(place: u16) -> [u8; SLOT_OCTETS] {
    let mut octets = [0; SLOT_OCTETS];
    if transfer(place, &[], 0, COMPLETE) == Taken::Yes {
        start(SLOT_OCTETS, READ | BY_ITSELF);
        for octet in &mut octets {
            if wait(FULL) == Taken::Yes {
                [*octet, ..] = i2c1().rxdr().read().bits().to_le_bytes();
            }
        }
    }
    clear();
    octets
}
