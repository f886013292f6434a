//! Nucleo-G474RE: an STM32G474 at 168 MHz, 14 clocks a bit at 12 Mbit/s. Built and measured in
//! octets; no emulator has this part.
//!
//! | what | where |
//! |---|---|
//! | bus | USART1: PA9 TXD, PA10 RXD; PA12 driver on, by the USART itself |
//! | world link | USART2: PA2 TXD, PA3 RXD, the virtual port of the ST-LINK; in use with PB2 at ground |
//! | sensor, AS5047P | SPI2: PB13 SCK, PB14 MISO, PB15 MOSI; PB12 select |
//! | memory, 24-series | I2C1: PA15 SCL, PB7 SDA; address 50h |
//! | rotary switches | PC2 to PC9, bit 0 first, contacts to ground |
//! | termination switches | PB0, PB1, contacts to ground |
//! | supply | PA0 by 100 kOhm, 10 kOhm to ground |
//! | lamp | PA5, lit while high |
//! | battery | VBAT |
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, SCB, scb::SystemHandler};
use cortex_m_rt::{entry, exception};
use firmware::cell::LATCH_PRIORITY;
use firmware::clock::Scale;
use firmware::g4::{BusUsart, WorldUsart};
use firmware::g4_end_cap::{self as end_cap, SPI, Spi};
use firmware::run::{Board, ON_BENCH, Taken, run};
use firmware::shaft::SHAFT;
use firmware::{bus, g4, link};
use logic::analog::Readings;
use logic::turns;
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::sensor::ShaftReading;
use stm32g4::stm32g474::{self as pac, Interrupt, interrupt};

/// Number of each exception that is used, and its priority as the register has it.
#[used]
#[unsafe(no_mangle)]
static INTERRUPT_PRIORITIES: [[u8; 2]; 6] = [
    [14, LATCH_PRIORITY],
    [15, LATCH_PRIORITY],
    [16 + 28, 0],
    [16 + 36, LATCH_PRIORITY],
    [16 + 37, 0],
    [16 + 38, LATCH_PRIORITY],
];

struct Nucleo;

#[entry]
fn main() -> ! {
    // SAFETY: nothing else runs yet.
    let (peripherals, core) = unsafe { (pac::Peripherals::steal(), cortex_m::Peripherals::steal()) };
    g4::set_up(&peripherals);
    pins(&peripherals);
    set_up(&peripherals);
    end_cap::start_converter();
    interrupts(core);
    run(&Nucleo)
}

/// Functions of the pins, two bits each in MODER and PUPDR: 0 input, 1 output, 2 other; 1 pull-up.
fn pins(peripherals: &pac::Peripherals) {
    let (a, b, c) = (&peripherals.GPIOA, &peripherals.GPIOB, &peripherals.GPIOC);
    // SAFETY: as the table above says; fields of the reference manual (RM0440, 9.4). All pins of
    // these ports are analog at first but the debugger's, PA13 and PA14.
    unsafe {
        peripherals.RCC.ahb2enr().write(|w| w.bits(0b111 | 1 << 13));
        // Select is off before it is an output.
        b.bsrr().write(|w| w.bits(1 << 12));
        a.afrl().write(|w| w.bits(7 << 8 | 7 << 12));
        a.afrh().write(|w| w.bits(7 << 4 | 7 << 8 | 7 << 16 | 4 << 28));
        a.otyper().write(|w| w.bits(1 << 15));
        let of_a = 2 << 4 | 2 << 6 | 1 << 10 | 2 << 18 | 2 << 20 | 2 << 24 | 2 << 30;
        let cleared = 3 << 4 | 3 << 6 | 3 << 10 | 3 << 18 | 3 << 20 | 3 << 24 | 3 << 30;
        a.moder().modify(|r, w| w.bits(r.bits() & !cleared | of_a));
        a.pupdr().modify(|r, w| w.bits(r.bits() & !(3 << 30) | 1 << 30 | 1 << 20));
        b.afrl().write(|w| w.bits(4 << 28));
        b.afrh().write(|w| w.bits(5 << 20 | 5 << 24 | 5 << 28));
        b.otyper().write(|w| w.bits(1 << 7));
        b.pupdr().modify(|r, w| w.bits(r.bits() & !(0x3F | 3 << 14) | 0b01_0101 | 1 << 14));
        let cleared = 0x3F | 3 << 14 | 0xFF << 24;
        b.moder()
            .modify(|r, w| w.bits(r.bits() & !cleared | 2 << 14 | 1 << 24 | 2 << 26 | 2 << 28 | 2 << 30));
        c.pupdr().write(|w| w.bits(0x5555 << 4));
        c.moder().modify(|r, w| w.bits(r.bits() & !(0xFFFF << 4)));
    }
}

/// Timer, USARTs, sensor, memory, battery's registers, supply supervision, watchdog.
fn set_up(peripherals: &pac::Peripherals) {
    // SAFETY: fields of the reference manual (RM0440), named beside each.
    unsafe {
        // TIM2, RTCAPB, SPI2, USART2, I2C1, PWR; SPI and converter; I2C1 from the internal oscillator.
        let clocks = &peripherals.RCC;
        clocks.apb1enr1().write(|w| w.bits(1 | 1 << 10 | 1 << 14 | 1 << 17 | 1 << 21 | 1 << 28));
        clocks.apb2enr().write(|w| w.bits(1 << 14));
        clocks.ccipr().write(|w| w.bits(2 << 12));
        // Free-running.
        peripherals.TIM2.arr().write(|w| w.bits(u32::MAX));
        peripherals.TIM2.egr().write(|w| w.bits(1));
        peripherals.TIM2.cr1().write(|w| w.bits(1));
        // DEM; then OVER8, M0, PCE (even), RXNEIE, TE, RE: eight data bits and the parity.
        peripherals.USART1.cr3().write(|w| w.bits(1 << 14));
        peripherals.USART1.cr1().write(|w| w.bits(1 << 15 | 1 << 12 | 1 << 10 | 1 << 5 | 1 << 3 | 1 << 2));
        // 460.8 kbit/s, 8N1: 168 MHz by 365; RXNEIE, TE, RE, UE.
        peripherals.USART2.brr().write(|w| w.bits(365));
        peripherals.USART2.cr1().write(|w| w.bits(1 << 5 | 1 << 3 | 1 << 2 | 1));
        // 16 bits, RXNEIE; software select, by 32, master, second edge.
        peripherals.SPI2.cr2().write(|w| w.bits(0xF << 8 | 1 << 6));
        peripherals.SPI2.cr1().write(|w| w.bits(0b11 << 8 | 1 << 6 | 4 << 3 | 1 << 2 | 1));
        // 100 kHz from 16 MHz.
        peripherals.I2C1.timingr().write(|w| w.bits(0x3042_0F13));
        peripherals.I2C1.cr1().write(|w| w.bits(1));
        // DBP: battery's registers writable; PVDE, PLS: supervision below 2.9 V.
        peripherals.PWR.cr1().modify(|r, w| w.bits(r.bits() | 1 << 8));
        peripherals.PWR.cr2().write(|w| w.bits(6 << 1 | 1));
        // 32 kHz by 32, 250 ms.
        peripherals.IWDG.kr().write(|w| w.bits(0xCCCC));
        peripherals.IWDG.kr().write(|w| w.bits(0x5555));
        peripherals.IWDG.pr().write(|w| w.bits(3));
        peripherals.IWDG.rlr().write(|w| w.bits(250));
    }
}

fn interrupts(mut core: cortex_m::Peripherals) {
    core.SYST.set_clock_source(SystClkSource::Core);
    core.SYST.set_reload(g4::hertz() / 2_000 - 1);
    // SAFETY: priorities before interrupts; 0 is that of the bus from the beginning.
    unsafe {
        core.NVIC.set_priority(Interrupt::USART2, LATCH_PRIORITY);
        core.NVIC.set_priority(Interrupt::SPI2, LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::SysTick, LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::PendSV, LATCH_PRIORITY);
    }
}

impl Board for Nucleo {
    type Line = BusUsart;
    type Wire = WorldUsart;

    fn line(&self) -> &BusUsart {
        &BusUsart
    }

    fn wire(&self) -> &WorldUsart {
        &WorldUsart
    }

    fn counter(&self) -> (*const u32, Scale) {
        // SAFETY: an address is made, nothing is read.
        let register = unsafe { (*pac::TIM2::ptr()).cnt().as_ptr() };
        (register.cast_const(), Scale::of(g4::hertz()))
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
        // SAFETY: the cells hold what the interrupts touch, but for this one.
        unsafe {
            SPI.begin().write(Spi::default());
            NVIC::unmask(Interrupt::USART1);
            NVIC::unmask(Interrupt::USART2);
            NVIC::unmask(Interrupt::SPI2);
            NVIC::unmask(Interrupt::TIM2);
        }
    }

    fn lamp(&self, on: bool) {
        // SAFETY: a write that sets or resets PA5 alone.
        unsafe { (*pac::GPIOA::ptr()).bsrr().write(|w| w.bits(if on { 1 << 5 } else { 1 << 21 })) };
    }

    fn feed(&self) {
        // SAFETY: the key that starts the watchdog's time anew.
        unsafe { (*pac::IWDG::ptr()).kr().write(|w| w.bits(0xAAAA)) };
    }

    fn on_bench(&self) -> bool {
        // SAFETY: a register that can be read.
        unsafe { (*pac::GPIOB::ptr()).idr().read().bits() & 1 << 2 == 0 }
    }

    fn switches(&self) -> u8 {
        // SAFETY: a register that can be read.
        let [low, high, ..] = unsafe { (*pac::GPIOC::ptr()).idr().read().bits() }.to_le_bytes();
        low >> 2 | high << 6
    }

    fn termination(&self) -> u8 {
        // SAFETY: a register that can be read.
        let [low, ..] = unsafe { (*pac::GPIOB::ptr()).idr().read().bits() }.to_le_bytes();
        low
    }

    fn readings(&self) -> Readings {
        end_cap::readings()
    }

    fn power_fails(&self) -> bool {
        // SAFETY: a register that can be read.
        unsafe { (*pac::PWR::ptr()).sr2().read().bits() & 1 << 11 != 0 }
    }

    fn kept(&self) -> [u32; turns::WORDS] {
        end_cap::kept()
    }

    fn write(&self, address: u16, octets: &[u8]) -> Taken {
        end_cap::write(address, octets)
    }

    fn read(&self, address: u16) -> [u8; SLOT_OCTETS] {
        end_cap::read(address)
    }
}

#[interrupt]
fn USART1() {
    // SAFETY: of the highest priority.
    unsafe { bus::interrupt(&BusUsart) }
}

#[interrupt]
fn TIM2() {
    // SAFETY: of the highest priority, like the other one.
    unsafe { bus::alarm(&BusUsart) }
}

#[interrupt]
fn USART2() {
    // SAFETY: of the latch's priority.
    unsafe { link::interrupt(&WorldUsart) }
}

#[exception]
fn SysTick() {
    if ON_BENCH.load(core::sync::atomic::Ordering::Relaxed) {
        latch(None);
    } else {
        // SAFETY: of the latch's priority.
        unsafe { SPI.own() }.begin();
    }
}

#[interrupt]
fn SPI2() {
    // SAFETY: of the latch's priority.
    if let Some(reading) = unsafe { SPI.own() }.complete() {
        latch(Some(reading));
    }
}

/// The latch, with what the sensor delivers or what the world link told.
fn latch(reading: Option<ShaftReading>) {
    // SAFETY: of the latch's priority.
    if let Some(shaft) = unsafe { SHAFT.own() } {
        shaft.latch(reading.unwrap_or(shaft.reading), &BusUsart);
        if reading.is_some() {
            end_cap::keep(shaft.kept());
        }
    }
}

#[exception]
fn PendSV() {
    // SAFETY: of the latch's priority.
    if let Some(shaft) = unsafe { SHAFT.own() } {
        shaft.obey();
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}
