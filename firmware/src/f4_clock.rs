//! The clock of the STM32F405: crystal and PLL, else the internal oscillator and PLL, else that
//! alone. Every wait is bounded.

use core::sync::atomic::{AtomicU8, Ordering};

use stm32f4::stm32f405 as pac;

/// So often a ready flag is looked at, some milliseconds with 16 MHz.
const PATIENCE: u32 = 20_000;

/// What the core and its peripherals run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Speed {
    /// The internal oscillator alone, 16 MHz.
    Internal = 0,
    /// 168 MHz by PLL.
    Full = 1,
    /// An emulator without a clock tree: SysTick counts 168 MHz, timer 2 nanoseconds.
    Emulated = 2,
}

static SPEED: AtomicU8 = AtomicU8::new(0);

/// What [`set_up`] has come to.
pub fn speed() -> Speed {
    match SPEED.load(Ordering::Relaxed) {
        1 => Speed::Full,
        2 => Speed::Emulated,
        _ => Speed::Internal,
    }
}

impl Speed {
    /// What USART1 counts, in hertz.
    pub const fn usart1(self) -> u32 {
        match self {
            Self::Internal => 16_000_000,
            Self::Full | Self::Emulated => 84_000_000,
        }
    }

    /// What timer 2 counts, in hertz.
    pub const fn timer2(self) -> u32 {
        match self {
            Self::Internal => 16_000_000,
            Self::Full => 84_000_000,
            Self::Emulated => 1_000_000_000,
        }
    }

    /// Clocks of SysTick from latch to latch, 500 us.
    pub const fn latch(self) -> u32 {
        match self {
            Self::Internal => 8_000,
            Self::Full | Self::Emulated => 84_000,
        }
    }
}

fn wait(ready: impl Fn() -> bool) -> bool {
    (0..PATIENCE).any(|_| ready())
}

/// Sets the clock up, the best there is.
pub fn set_up(peripherals: &pac::Peripherals) {
    SPEED.store(choose(peripherals) as u8, Ordering::Relaxed);
}

fn choose(peripherals: &pac::Peripherals) -> Speed {
    let (clocks, flash) = (&peripherals.RCC, &peripherals.FLASH);
    // The part starts from its internal oscillator, so it is ready; but not in an emulator.
    if clocks.cr().read().hsirdy().bit_is_clear() {
        return Speed::Emulated;
    }
    clocks.cr().modify(|_, w| w.hseon().set_bit());
    let crystal = wait(|| clocks.cr().read().hserdy().bit_is_set());
    // 1 MHz from 8 or 16, times 336, by 2; bit 22 takes the crystal, 7 in bits 24-27 is for USB.
    let divided = if crystal { 8 | 1 << 22 } else { 16 };
    // SAFETY: fields as the reference manual (RM0090, 7.3.2) has them.
    clocks.pllcfgr().write(|w| unsafe { w.bits(divided | 336 << 6 | 7 << 24) });
    clocks.cr().modify(|_, w| w.pllon().set_bit());
    if !wait(|| clocks.cr().read().pllrdy().bit_is_set()) {
        return Speed::Internal;
    }
    // Five wait states at 168 MHz; prefetch and both caches.
    // SAFETY: as the reference manual (3.9.1) has them.
    flash.acr().write(|w| unsafe { w.bits(5 | 0b111 << 8) });
    // APB1 by 4, APB2 by 2, from the PLL.
    // SAFETY: as the reference manual (7.3.3) has them.
    clocks.cfgr().write(|w| unsafe { w.bits(0b10 | 0b101 << 10 | 0b100 << 13) });
    Speed::Full
}
