//! The STM32F405's peripherals: USARTs of the older kind.

use cortex_m::peripheral::SCB;
use profibus_dp::time::Baudrate;
use stm32f4::stm32f405 as pac;

use crate::bus::{Line, Received, Transmitter};
use crate::link::Wire;

/// USART1 at the bus, PB5 switches the driver.
#[derive(Debug)]
pub struct BusUsart {
    /// What feeds the USART, in hertz.
    pub hertz: u32,
}

/// USART2 at the world link.
#[derive(Debug)]
pub struct WorldUsart;

fn usart1() -> &'static pac::usart1::RegisterBlock {
    // SAFETY: registers; only the bus interrupt, and others while it waits, come here.
    unsafe { &*pac::USART1::ptr() }
}

fn usart2() -> &'static pac::usart1::RegisterBlock {
    // SAFETY: registers; the interrupt of the world link reads, the main loop writes.
    unsafe { &*pac::USART2::ptr() }
}

fn driver(on: bool) {
    // SAFETY: a write that sets or resets PB5 alone.
    unsafe {
        (*pac::GPIOB::ptr()).bsrr().write(|w| w.bits(if on { 1 << 5 } else { 1 << 21 }));
    }
}

impl Line for BusUsart {
    #[inline(always)]
    fn received(&self) -> Received {
        let usart = usart1();
        let status = usart.sr().read().bits();
        // RXNE, and PE, FE, NF, ORE.
        if status & 0x2F == 0 {
            return Received::Nothing;
        }
        let octet = usart.dr().read().bits();
        if status & 0x0F != 0 {
            return Received::Error;
        }
        // Bit 8 is the parity bit.
        Received::Octet((octet & 0xFF) as u8)
    }

    #[inline]
    fn transmitter(&self) -> Transmitter {
        let usart = usart1();
        let (status, on) = (usart.sr().read(), usart.cr1().read());
        if status.txe().bit() && on.txeie().bit() {
            Transmitter::Room
        } else if status.tc().bit() && on.tcie().bit() {
            Transmitter::Empty
        } else {
            Transmitter::Busy
        }
    }

    #[inline(always)]
    fn send(&self, octet: u8) {
        usart1().dr().write(|w| w.dr().set(octet.into()));
    }

    #[inline(always)]
    fn begin_reply(&self, octet: u8) {
        driver(true);
        self.send(octet);
    }

    #[inline(always)]
    fn go_on(&self) {
        usart1().cr1().modify(|_, w| w.txeie().set_bit());
    }

    fn end_reply(&self) {
        usart1().cr1().modify(|_, w| w.txeie().clear_bit().tcie().set_bit());
    }

    fn listen(&self) {
        usart1().cr1().modify(|_, w| w.txeie().clear_bit().tcie().clear_bit());
        driver(false);
    }

    #[expect(clippy::cast_possible_truncation, reason = "84 MHz over 9600 is 8750")]
    fn set_rate(&self, rate: Baudrate) {
        // Eight samples a bit: fractions are eighths, in the lower three bits.
        let eighths = (self.hertz + rate.bits_per_second() / 2) / rate.bits_per_second();
        let divider = ((eighths & !7) << 1) | (eighths & 7);
        // SAFETY: any divider is allowed.
        usart1().brr().write(|w| unsafe { w.bits(divider as u16) });
    }

    fn demand(&self) {
        SCB::set_pendsv();
    }
}

impl Wire for WorldUsart {
    fn take(&self) -> Option<u8> {
        let usart = usart2();
        if usart.sr().read().bits() & 0x2F == 0 {
            return None;
        }
        Some((usart.dr().read().bits() & 0xFF) as u8)
    }

    fn send(&self, octet: u8) {
        let usart = usart2();
        while usart.sr().read().txe().bit_is_clear() {}
        usart.dr().write(|w| w.dr().set(octet.into()));
    }
}
