//! The STM32G474's clock and USARTs of the newer kind, which switch the bus driver themselves.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use logic::usart::{self, Received};
use profibus_dp::time::Baudrate;
use stm32g4::stm32g474 as pac;

use crate::bus::{Line, Transmitter};
use crate::link::Wire;

/// So often a ready flag is looked at, some milliseconds with 16 MHz.
const PATIENCE: u32 = 20_000;
/// The clock with PLL, of the core and of all peripherals.
const FULL: u32 = 168_000_000;
/// The internal oscillator alone.
const INTERNAL: u32 = 16_000_000;

static FULL_SPEED: AtomicBool = AtomicBool::new(false);

/// What [`set_up`] has come to, in hertz.
pub fn hertz() -> u32 {
    if FULL_SPEED.load(Ordering::Relaxed) { FULL } else { INTERNAL }
}

/// Sets the clock up: crystal and PLL, else the internal oscillator and PLL, else that alone.
pub fn set_up(peripherals: &pac::Peripherals) {
    let (clocks, power) = (&peripherals.RCC, &peripherals.PWR);
    let wait = |bit: u32| (0..PATIENCE).any(|_| clocks.cr().read().bits() & 1 << bit != 0);
    // SAFETY: fields of the reference manual (RM0440), named beside each.
    unsafe {
        // PWREN.
        clocks.apb1enr1().modify(|r, w| w.bits(r.bits() | 1 << 28));
        // HSEON, HSERDY.
        clocks.cr().modify(|r, w| w.bits(r.bits() | 1 << 16));
        let crystal = wait(17);
        // 4 MHz from 24 or 16, times 84, by 2: PLLSRC, PLLM, PLLN, PLLREN.
        let source = if crystal { 3 | 5 << 4 } else { 2 | 3 << 4 };
        clocks.pllcfgr().write(|w| w.bits(source | 84 << 8 | 1 << 24));
        // PLLON, PLLRDY.
        clocks.cr().modify(|r, w| w.bits(r.bits() | 1 << 24));
        if !wait(25) {
            return;
        }
        // Above 150 MHz: R1MODE off, four wait states, prefetch and both caches, and one step between.
        power.cr5().modify(|r, w| w.bits(r.bits() & !(1 << 8)));
        peripherals.FLASH.acr().write(|w| w.bits(4 | 0b111 << 8));
        clocks.cfgr().write(|w| w.bits(3 | 8 << 4));
        cortex_m::asm::delay(200);
        clocks.cfgr().write(|w| w.bits(3));
    }
    FULL_SPEED.store(true, Ordering::Relaxed);
}

/// USART1 at the bus; it switches the driver by its DE.
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

/// TXEIE and TCIE of CR1.
fn interrupts(room: bool, empty: bool) {
    let bits = u32::from(room) << 7 | u32::from(empty) << 6;
    // SAFETY: two bits that may be any.
    usart1().cr1().modify(|r, w| unsafe { w.bits(r.bits() & !0xC0 | bits) });
}

impl Line for BusUsart {
    #[inline(always)]
    fn received(&self) -> Received {
        let registers = usart1();
        let status = registers.isr().read().bits();
        if !usart::is_due(status) {
            return Received::Nothing;
        }
        let received = usart::received(status, registers.rdr().read().bits());
        if received == Received::Error {
            // SAFETY: PECF, FECF, NECF, ORECF.
            registers.icr().write(|w| unsafe { w.bits(usart::ERRORS) });
        }
        received
    }

    #[inline]
    fn transmitter(&self) -> Transmitter {
        let (status, on) = (usart1().isr().read().bits(), usart1().cr1().read().bits());
        // TXE with TXEIE, TC with TCIE: the same bits in both.
        match status & on & 0xC0 {
            0 => Transmitter::Busy,
            0x40 => Transmitter::Empty,
            _ => Transmitter::Room,
        }
    }

    #[inline(always)]
    fn send(&self, octet: u8) {
        // SAFETY: an octet.
        usart1().tdr().write(|w| unsafe { w.bits(octet.into()) });
    }

    #[inline(always)]
    fn begin_reply(&self, octet: u8) {
        self.send(octet);
    }

    fn go_on(&self) {
        interrupts(true, false);
    }

    fn end_reply(&self) {
        interrupts(false, true);
    }

    fn listen(&self) {
        interrupts(false, false);
    }

    fn set_rate(&self, rate: Baudrate) {
        // A rate that cannot be had is not heard either: the search goes on.
        let divider = usart::divider_of_newer(hertz(), rate.bits_per_second()).unwrap_or(0xFFF7);
        let registers = usart1();
        // SAFETY: UE off for the divider, which may be any, and on again.
        unsafe {
            registers.cr1().modify(|r, w| w.bits(r.bits() & !1));
            registers.brr().write(|w| w.bits(divider));
            registers.cr1().modify(|r, w| w.bits(r.bits() | 1));
        }
    }

    fn alarm(&self, ticks: Option<u32>) {
        // SAFETY: registers; any count, no flag, the first channel's interrupt.
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
        let registers = usart2();
        let status = registers.isr().read().bits();
        if !usart::is_due(status) {
            return None;
        }
        let [octet, ..] = registers.rdr().read().bits().to_le_bytes();
        // SAFETY: PECF, FECF, NECF, ORECF.
        registers.icr().write(|w| unsafe { w.bits(usart::ERRORS) });
        Some(octet)
    }

    fn send(&self, octet: u8) {
        let registers = usart2();
        while registers.isr().read().bits() & 1 << 7 == 0 {}
        // SAFETY: an octet.
        registers.tdr().write(|w| unsafe { w.bits(octet.into()) });
    }
}
