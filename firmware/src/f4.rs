//! The STM32F405's peripherals: USARTs of the older kind.

use cortex_m::peripheral::SCB;
use profibus_dp::time::Baudrate;
use stm32f4::stm32f405 as pac;

use crate::bus::{Happened, Line};
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
    fn happened(&self) -> Happened {
        let usart = usart1();
        let status = usart.sr().read();
        // RXNE, and PE, FE, NF, ORE.
        if status.bits() & 0x2F != 0 {
            let octet = usart.dr().read().bits();
            if status.bits() & 0x0F != 0 {
                return Happened::Error;
            }
            // Bit 8 is the parity bit.
            return Happened::Octet((octet & 0xFF) as u8);
        }
        let enabled = usart.cr1().read();
        if status.txe().bit_is_set() && enabled.txeie().bit_is_set() {
            Happened::Room
        } else if status.tc().bit_is_set() && enabled.tcie().bit_is_set() {
            Happened::Empty
        } else {
            Happened::Nothing
        }
    }

    #[inline(always)]
    fn send(&self, octet: u8) {
        usart1().dr().write(|w| w.dr().set(octet.into()));
    }

    fn begin_reply(&self) {
        driver(true);
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
