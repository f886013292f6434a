//! Olimex STM32-H405: an STM32F405, up to 6 Mbit/s. Also what QEMU has as `netduinoplus2` and
//! `olimex-stm32-h405`.
//!
//! | what | where |
//! |---|---|
//! | bus | USART1: PB6 TXD, PB7 RXD, PB5 driver on |
//! | world link | USART2: PA2 TXD, PA3 RXD |
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, SCB, scb::SystemHandler};
use cortex_m_rt::{entry, exception};
use firmware::bus;
use firmware::clock::Scale;
use firmware::f4::{BusUsart, WorldUsart};
use firmware::link;
use firmware::run::{Board, run};
use firmware::shaft::SHAFT;
use stm32f4::stm32f405::{self as pac, Interrupt, interrupt};

const LINE: BusUsart = BusUsart { hertz: 84_000_000 };

struct Olimex;

#[entry]
fn main() -> ! {
    set_up();
    run(&Olimex)
}

fn set_up() {
    // SAFETY: nothing else runs yet.
    let (peripherals, mut core) = unsafe { (pac::Peripherals::steal(), cortex_m::Peripherals::steal()) };
    peripherals.RCC.apb1enr().modify(|_, w| w.tim2en().set_bit().usart2en().set_bit());
    peripherals.RCC.apb2enr().modify(|_, w| w.usart1en().set_bit());
    // Free-running.
    peripherals.TIM2.psc().write(|w| w.psc().set(0));
    peripherals.TIM2.arr().write(|w| w.arr().set(u32::MAX));
    peripherals.TIM2.egr().write(|w| w.ug().set_bit());
    peripherals.TIM2.cr1().write(|w| w.cen().set_bit());
    let usart = &peripherals.USART1;
    usart.cr1().write(|w| {
        w.over8().set_bit().m().set_bit().pce().set_bit().re().set_bit().te().set_bit().ue().set_bit()
    });
    usart.cr1().modify(|_, w| w.rxneie().set_bit());
    let usart = &peripherals.USART2;
    usart.cr1().write(|w| w.re().set_bit().te().set_bit().ue().set_bit());
    usart.cr1().modify(|_, w| w.rxneie().set_bit());
    core.SYST.set_clock_source(SystClkSource::Core);
    core.SYST.set_reload(84_000 - 1);
    // SAFETY: priorities before interrupts: the bus above the rest.
    unsafe {
        core.NVIC.set_priority(Interrupt::USART1, 0);
        core.NVIC.set_priority(Interrupt::USART2, firmware::cell::LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::SysTick, firmware::cell::LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::PendSV, firmware::cell::LATCH_PRIORITY);
    }
}

impl Board for Olimex {
    type Line = BusUsart;
    type Wire = WorldUsart;

    fn line(&self) -> &BusUsart {
        &LINE
    }

    fn wire(&self) -> &WorldUsart {
        &WorldUsart
    }

    fn counter(&self) -> (*const u32, Scale) {
        // SAFETY: an address is made, nothing is read.
        let register = unsafe { (*pac::TIM2::ptr()).cnt().as_ptr() };
        (register.cast_const(), Scale::of(1_000_000_000))
    }

    fn run_latches(&self, on: bool) {
        // SAFETY: the main loop alone does this.
        let mut timer = unsafe { cortex_m::Peripherals::steal() }.SYST;
        if on {
            timer.clear_current();
            timer.enable_counter();
            timer.enable_interrupt();
        } else {
            timer.disable_interrupt();
            timer.disable_counter();
        }
    }

    fn latch(&self) {
        SCB::set_pendst();
        cortex_m::asm::isb();
    }

    fn start(&self) {
        // SAFETY: all that the interrupts touch is there.
        unsafe {
            NVIC::unmask(Interrupt::USART1);
            NVIC::unmask(Interrupt::USART2);
        }
    }

    fn lamp(&self, _: bool) {}

    fn feed(&self) {}
}

#[interrupt]
fn USART1() {
    // SAFETY: the one interrupt of the highest priority.
    unsafe { bus::interrupt(&LINE) }
}

#[interrupt]
fn USART2() {
    // SAFETY: of the latch's priority.
    unsafe { link::interrupt(&WorldUsart) }
}

#[exception]
fn SysTick() {
    // SAFETY: of the latch's priority.
    let shaft = unsafe { SHAFT.own() };
    let reading = shaft.reading;
    shaft.latch(reading, &LINE);
}

#[exception]
fn PendSV() {
    // SAFETY: of the latch's priority.
    unsafe { SHAFT.own() }.obey();
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}
