//! Olimex STM32-H405: an STM32F405, up to 6 Mbit/s. Also what QEMU has as `netduinoplus2` and
//! `olimex-stm32-h405`.
//!
//! | what | where |
//! |---|---|
//! | bus | USART1: PB6 TXD, PB7 RXD; PB5 driver on |
//! | world link | USART2: PA2 TXD, PA3 RXD; in use with PB14 at ground (in QEMU all pins read 0) |
//! | sensor, AS5047P | SPI1: PA5 SCK, PA6 MISO, PA7 MOSI; PA4 select |
//! | memory, 24-series | I2C1: PB8 SCL, PB9 SDA; address 50h |
//! | rotary switches | PC2 to PC9, bit 0 first, contacts to ground |
//! | termination switches | PB12, PB13, contacts to ground |
//! | supply | PC0 by 100 kOhm, 10 kOhm to ground |
//! | lamp | PC12, lit while low |
//! | battery | VBAT |
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, SCB, scb::SystemHandler};
use cortex_m_rt::{entry, exception};
use firmware::cell::LATCH_PRIORITY;
use firmware::clock::Scale;
use firmware::f4::{BusUsart, WorldUsart};
use firmware::f4_end_cap::{self as end_cap, SPI, Spi};
use firmware::run::{Board, ON_BENCH, Taken, run};
use firmware::shaft::SHAFT;
use firmware::{bus, f4_clock, link};
use logic::analog::Readings;
use logic::turns;
use sch108bex::nonvolatile::SLOT_OCTETS;
use sch108bex::sensor::ShaftReading;
use stm32f4::stm32f405::{self as pac, Interrupt, interrupt};

/// Number of each exception that is used, and its priority as the register has it.
#[used]
#[unsafe(no_mangle)]
static INTERRUPT_PRIORITIES: [[u8; 2]; 6] = [
    [14, LATCH_PRIORITY],
    [15, LATCH_PRIORITY],
    [16 + 28, 0],
    [16 + 35, LATCH_PRIORITY],
    [16 + 37, 0],
    [16 + 38, LATCH_PRIORITY],
];

struct Olimex;

#[entry]
fn main() -> ! {
    // SAFETY: nothing else runs yet.
    let (peripherals, core) = unsafe { (pac::Peripherals::steal(), cortex_m::Peripherals::steal()) };
    f4_clock::set_up(&peripherals);
    pins(&peripherals);
    set_up(&peripherals);
    interrupts(core);
    run(&Olimex)
}

/// Functions of the pins, two bits each in MODER and PUPDR: 1 output, 2 other, 3 analog; 1 pull-up.
fn pins(peripherals: &pac::Peripherals) {
    peripherals.RCC.ahb1enr().write(|w| w.gpioaen().set_bit().gpioben().set_bit().gpiocen().set_bit());
    let (a, b, c) = (&peripherals.GPIOA, &peripherals.GPIOB, &peripherals.GPIOC);
    // SAFETY: as the table above says; fields of the reference manual (RM0090, 8.4).
    unsafe {
        // Select and lamp are off before they are outputs; the driver is, anyway.
        a.bsrr().write(|w| w.bits(1 << 4));
        c.bsrr().write(|w| w.bits(1 << 12));
        a.afrl().write(|w| w.bits(7 << 8 | 7 << 12 | 5 << 20 | 5 << 24 | 5 << 28));
        a.moder().modify(|r, w| {
            w.bits(r.bits() & !0xFFF0 | 2 << 4 | 2 << 6 | 1 << 8 | 2 << 10 | 2 << 12 | 2 << 14)
        });
        b.afrl().write(|w| w.bits(7 << 24 | 7 << 28));
        b.afrh().write(|w| w.bits(4 | 4 << 4));
        b.otyper().write(|w| w.bits(0b11 << 8));
        b.pupdr().modify(|r, w| w.bits(r.bits() | 1 << 14 | 0b01_0101 << 24));
        b.moder()
            .modify(|r, w| w.bits(r.bits() & !0xF_FC00 | 1 << 10 | 2 << 12 | 2 << 14 | 2 << 16 | 2 << 18));
        c.pupdr().write(|w| w.bits(0x5555 << 4));
        c.moder().write(|w| w.bits(3 | 1 << 24));
    }
}

/// Timer, USARTs, sensor, memory, converter, battery's registers, supply supervision, watchdog.
fn set_up(peripherals: &pac::Peripherals) {
    let clocks = &peripherals.RCC;
    clocks
        .apb1enr()
        .write(|w| w.tim2en().set_bit().usart2en().set_bit().i2c1en().set_bit().pwren().set_bit());
    clocks.apb2enr().write(|w| w.usart1en().set_bit().spi1en().set_bit().adc1en().set_bit());
    // SAFETY: fields of the reference manual.
    unsafe {
        // Free-running.
        peripherals.TIM2.arr().write(|w| w.bits(u32::MAX));
        peripherals.TIM2.egr().write(|w| w.bits(1));
        peripherals.TIM2.cr1().write(|w| w.bits(1));
        // OVER8, UE, M, PCE (even), RXNEIE, TE, RE: eight data bits and the parity.
        peripherals
            .USART1
            .cr1()
            .write(|w| w.bits(1 << 15 | 1 << 13 | 1 << 12 | 1 << 10 | 1 << 5 | 1 << 3 | 1 << 2));
        // 460.8 kbit/s, 8N1: 42 MHz by 91.
        peripherals.USART2.brr().write(|w| w.bits(91));
        peripherals.USART2.cr1().write(|w| w.bits(1 << 13 | 1 << 5 | 1 << 3 | 1 << 2));
        // RXNEIE; 16 bits, software select, by 16, master, second edge.
        peripherals.SPI1.cr2().write(|w| w.bits(1 << 6));
        peripherals.SPI1.cr1().write(|w| w.bits(1 << 11 | 0b11 << 8 | 1 << 6 | 3 << 3 | 1 << 2 | 1));
        // 100 kHz from 42 MHz.
        peripherals.I2C1.cr2().write(|w| w.bits(42));
        peripherals.I2C1.ccr().write(|w| w.bits(210));
        peripherals.I2C1.trise().write(|w| w.bits(43));
        peripherals.I2C1.cr1().write(|w| w.bits(1));
        // 480 cycles a sample for all channels: the temperature sensor wants 10 us.
        peripherals.ADC1.smpr1().write(|w| w.bits(0o777_777_777));
        peripherals.ADC1.cr2().write(|w| w.bits(1));
        // Battery's registers writable; supervision below 2.9 V.
        peripherals.PWR.cr().write(|w| w.bits(1 << 8 | 0b111 << 5 | 1 << 4 | 1 << 14));
        // 32 kHz by 32, 250 ms.
        peripherals.IWDG.kr().write(|w| w.bits(0xCCCC));
        peripherals.IWDG.kr().write(|w| w.bits(0x5555));
        peripherals.IWDG.pr().write(|w| w.bits(3));
        peripherals.IWDG.rlr().write(|w| w.bits(250));
    }
}

fn interrupts(mut core: cortex_m::Peripherals) {
    core.SYST.set_clock_source(SystClkSource::Core);
    core.SYST.set_reload(f4_clock::speed().latch() - 1);
    // SAFETY: priorities before interrupts; 0 is that of the bus from the beginning.
    unsafe {
        core.NVIC.set_priority(Interrupt::USART2, LATCH_PRIORITY);
        core.NVIC.set_priority(Interrupt::SPI1, LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::SysTick, LATCH_PRIORITY);
        core.SCB.set_priority(SystemHandler::PendSV, LATCH_PRIORITY);
    }
}

impl Board for Olimex {
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
        (register.cast_const(), Scale::of(f4_clock::speed().timer2()))
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
            NVIC::unmask(Interrupt::SPI1);
            NVIC::unmask(Interrupt::TIM2);
        }
    }

    fn lamp(&self, on: bool) {
        // SAFETY: a write that sets or resets PC12 alone.
        unsafe { (*pac::GPIOC::ptr()).bsrr().write(|w| w.bits(if on { 1 << 28 } else { 1 << 12 })) };
    }

    fn feed(&self) {
        // SAFETY: the key that starts the watchdog's time anew.
        unsafe { (*pac::IWDG::ptr()).kr().write(|w| w.bits(0xAAAA)) };
    }

    fn on_bench(&self) -> bool {
        // SAFETY: a register that can be read.
        unsafe { (*pac::GPIOB::ptr()).idr().read().bits() & 1 << 14 == 0 }
    }

    fn switches(&self) -> u8 {
        // SAFETY: a register that can be read.
        let [low, high, ..] = unsafe { (*pac::GPIOC::ptr()).idr().read().bits() }.to_le_bytes();
        low >> 2 | high << 6
    }

    fn termination(&self) -> u8 {
        // SAFETY: a register that can be read.
        let [_, high, ..] = unsafe { (*pac::GPIOB::ptr()).idr().read().bits() }.to_le_bytes();
        high >> 4
    }

    fn readings(&self) -> Readings {
        end_cap::readings()
    }

    fn power_fails(&self) -> bool {
        // SAFETY: a register that can be read.
        unsafe { (*pac::PWR::ptr()).csr().read().pvdo().bit_is_set() }
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
fn SPI1() {
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
