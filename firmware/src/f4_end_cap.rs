//! The STM32F405's part of the end cap: sensor on SPI1, memory on I2C1, voltages, battery's registers.

use logic::analog::{self, Readings};
use logic::{as5047p, turns};
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::sensor::ShaftReading;
use stm32f4::stm32f405 as pac;

use crate::cell::Latched;
use crate::run::Taken;

/// So often a flag of I2C or of the converter is looked at: a millisecond and more.
const PATIENCE: u32 = 20_000;
/// The memory's address on I2C, for writing; one more for reading.
const MEMORY: u16 = 0xA0;
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

fn spi1() -> &'static pac::spi1::RegisterBlock {
    // SAFETY: registers; only interrupts of the latch's priority come here.
    unsafe { &*pac::SPI1::ptr() }
}

fn i2c1() -> &'static pac::i2c1::RegisterBlock {
    // SAFETY: registers; only the main loop comes here.
    unsafe { &*pac::I2C1::ptr() }
}

fn select(on: bool) {
    // SAFETY: a write that sets or resets PA4 alone.
    unsafe { (*pac::GPIOA::ptr()).bsrr().write(|w| w.bits(if on { 1 << 20 } else { 1 << 4 })) };
}

fn exchange(command: u16) {
    select(true);
    spi1().dr().write(|w| w.dr().set(command));
}

impl Spi {
    /// Begins a latch.
    pub fn begin(&mut self) {
        self.second = false;
        exchange(as5047p::READ_ANGLE);
    }

    /// A frame is complete; what the latch has brought, if it was the second.
    pub fn complete(&mut self) -> Option<ShaftReading> {
        let answer = spi1().dr().read().dr().bits();
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

/// Voltages, measured one after the other; 0 where the converter does not end.
pub fn readings() -> Readings {
    // SAFETY: registers; only the main loop comes here.
    let (common, converter) = unsafe { (&*pac::ADC_COMMON::ptr(), &*pac::ADC1::ptr()) };
    let convert = |channel: u32, battery: bool| {
        // One at a time: with both on only the battery can be measured.
        common.ccr().write(|w| w.vbate().bit(battery).tsvrefe().bit(!battery).adcpre().set(1));
        // SAFETY: any channel may be first in the sequence.
        converter.sqr3().write(|w| unsafe { w.bits(channel) });
        converter.cr2().modify(|_, w| w.swstart().set_bit());
        let ended = (0..PATIENCE).any(|_| converter.sr().read().eoc().bit_is_set());
        if ended { converter.dr().read().data().bits() } else { 0 }
    };
    Readings {
        supply: convert(10, false),
        temperature: convert(16, false),
        battery: convert(18, true),
        part: analog::STM32F405,
    }
}

/// What the battery's registers hold.
pub fn kept() -> [u32; turns::WORDS] {
    // SAFETY: registers that can be read.
    let clock = unsafe { &*pac::RTC::ptr() };
    [clock.bkp0r(), clock.bkp1r(), clock.bkp2r(), clock.bkp3r()].map(|register| register.read().bits())
}

/// Into the battery's registers, in order.
pub fn keep(words: [u32; turns::WORDS]) {
    // SAFETY: registers; only interrupts of the latch's priority write them.
    let clock = unsafe { &*pac::RTC::ptr() };
    let registers = [clock.bkp0r(), clock.bkp1r(), clock.bkp2r(), clock.bkp3r()];
    for (register, word) in registers.into_iter().zip(words) {
        // SAFETY: any value.
        register.write(|w| unsafe { w.bits(word) });
    }
}

/// SB, ADDR, BTF, RXNE, TXE of SR1.
const STARTED: u16 = 1;
const ADDRESSED: u16 = 1 << 1;
const FINISHED: u16 = 1 << 2;
const FULL: u16 = 1 << 6;
const ROOM: u16 = 1 << 7;
/// AF of SR1: not acknowledged.
const REFUSED: u16 = 1 << 10;

/// Waits for a flag.
fn wait(flag: u16) -> Taken {
    for _ in 0..PATIENCE {
        let status = i2c1().sr1().read().bits();
        if status & flag != 0 {
            return Taken::Yes;
        }
        if status & REFUSED != 0 {
            return Taken::Busy;
        }
    }
    Taken::No
}

/// Start, and the memory's address.
fn address(octet: u16) -> Taken {
    i2c1().cr1().modify(|_, w| w.ack().set_bit().start().set_bit());
    if wait(STARTED) != Taken::Yes {
        return Taken::No;
    }
    send(octet);
    let taken = wait(ADDRESSED);
    if taken == Taken::Yes {
        // Reading it takes the flag away.
        let _ = i2c1().sr2().read();
    }
    taken
}

fn send(octet: u16) {
    // SAFETY: an octet.
    i2c1().dr().write(|w| unsafe { w.bits(octet) });
}

fn stop(taken: Taken) -> Taken {
    // SAFETY: 0 takes the refusal away.
    i2c1().sr1().write(|w| unsafe { w.bits(0) });
    i2c1().cr1().modify(|_, w| w.stop().set_bit());
    taken
}

/// Address and octets, then `after`.
fn transfer(place: u16, octets: &[u8]) -> Taken {
    let mut taken = address(MEMORY);
    for octet in place.to_be_bytes().iter().chain(octets) {
        if taken == Taken::Yes {
            taken = wait(ROOM);
            send(u16::from(*octet));
        }
    }
    if taken == Taken::Yes { wait(FINISHED) } else { taken }
}

/// Writes a piece; busy while the one before is being written.
pub fn write(place: u16, octets: &[u8]) -> Taken {
    let taken = transfer(place, octets);
    stop(taken)
}

/// Reads a slot; zeros from where the memory does not answer.
pub fn read(place: u16) -> [u8; SLOT_OCTETS] {
    let mut octets = [0; SLOT_OCTETS];
    if transfer(place, &[]) == Taken::Yes && address(MEMORY | 1) == Taken::Yes {
        for octet in &mut octets {
            if wait(FULL) == Taken::Yes {
                [*octet, _] = i2c1().dr().read().bits().to_le_bytes();
            }
        }
    }
    i2c1().cr1().modify(|_, w| w.ack().clear_bit());
    stop(Taken::Yes);
    octets
}
