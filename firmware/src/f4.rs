//! The STM32F405's peripherals: USARTs of the older kind.

use cortex_m::peripheral::SCB;
use profibus_dp::time::Baudrate;
use stm32f4::stm32f405 as pac;

use logic::usart::{self, Received};

use crate::bus::{Line, Transmitter};
use crate::f4_clock::{self, Speed};
use crate::link::Wire;

/// USART1 at the bus, PB5 switches the driver.
#[derive(Debug)]
pub struct BusUsart;

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
        let registers = usart1();
        let status = u32::from(registers.sr().read().bits());
        if usart::is_due(status) {
            usart::received(status, registers.dr().read().bits().into())
        } else {
            Received::Nothing
        }
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

    fn set_rate(&self, rate: Baudrate) {
        let hertz = f4_clock::speed().usart1();
        // A rate that cannot be had is not heard either: the search goes on.
        let divider = usart::divider_of_eight(hertz, rate.bits_per_second());
        let divider = divider.and_then(|divider| u16::try_from(divider).ok()).unwrap_or(u16::MAX);
        // SAFETY: any divider is allowed.
        usart1().brr().write(|w| unsafe { w.bits(divider) });
    }

    fn alarm(&self, ticks: Option<u32>) {
        // An emulator's timer has no interrupt that works: there the latch looks.
        if f4_clock::speed() == Speed::Emulated {
            return;
        }
        // SAFETY: registers; what is written are any count, no flag, the first channel's interrupt.
        unsafe {
            let timer = &*pac::TIM2::ptr();
            timer.ccr1().write(|w| w.bits(ticks.unwrap_or(0)));
            timer.sr().write(|w| w.bits(0));
            timer.dier().write(|w| w.bits(if ticks.is_some() { 1 << 1 } else { 0 }));
        }
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
