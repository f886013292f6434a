//! Timer 2 of the STM32F405, which the emulator advances by one for each instruction.

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};

const TIM2: usize = 0x4000_0000;
const CONTROL: usize = TIM2;
const EVENT: usize = TIM2 + 0x14;
const COUNT: *const u32 = (TIM2 + 0x24) as *const u32;
const PRESCALER: usize = TIM2 + 0x28;
const RELOAD: usize = TIM2 + 0x2c;
const CLOCK_ENABLE: usize = 0x4002_3840;

/// The running timer.
pub(crate) struct Timer {
    /// What two readings one after the other are apart.
    empty: u32,
}

impl Timer {
    /// Lets it run freely, at one tick an instruction.
    pub(crate) fn start() -> Self {
        for (register, value) in
            [(CLOCK_ENABLE, 1), (PRESCALER, 0), (RELOAD, u32::MAX), (EVENT, 1), (CONTROL, 1)]
        {
            // SAFETY: registers of the STM32F405, which nothing else uses in this image.
            unsafe { write_volatile(register as *mut u32, value) };
        }
        let mut timer = Self { empty: 0 };
        timer.empty = timer.count(|| ());
        timer
    }

    /// The instructions that `work` takes, its call included.
    #[inline(always)]
    pub(crate) fn count<T>(&self, work: impl FnOnce() -> T) -> u32 {
        let before = now();
        let result = work();
        let after = now();
        black_box(result);
        after.wrapping_sub(before).wrapping_sub(self.empty)
    }
}

#[inline(always)]
fn now() -> u32 {
    // SAFETY: as in `start`.
    unsafe { read_volatile(COUNT) }
}
