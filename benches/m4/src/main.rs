//! Counts the instructions of the core on a Cortex-M4 and prints them, one `name count` a line.
//!
//! Runs under QEMU (`-machine netduinoplus2 -icount shift=0`) and prints by semihosting.
#![no_std]
#![no_main]

mod device;
#[path = "../../src/telegrams.rs"]
mod telegrams;
mod timer;

use core::panic::PanicInfo;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use timer::Timer;

#[entry]
fn main() -> ! {
    let timer = Timer::start();
    // What the emulator has to count right before the rest can be believed.
    hprintln!("known_loop_instructions {}", timer.count(known_loop));
    match device::figures(&timer) {
        Some(figures) => {
            hprintln!("m4_octet_instructions {}", figures.octet);
            hprintln!("m4_reply_instructions {}", figures.reply);
            hprintln!("m4_sample_instructions {}", figures.sample);
            end(debug::EXIT_SUCCESS)
        }
        None => {
            hprintln!("The device does not exchange data.");
            end(debug::EXIT_FAILURE)
        }
    }
}

/// 1000 rounds of two instructions, and one before them.
#[inline(always)]
fn known_loop() {
    // SAFETY: counts in a register of its own, touches no memory.
    unsafe {
        core::arch::asm!("movw {n}, #1000", "2: subs {n}, {n}, #1", "bne 2b", n = out(reg) _);
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    hprintln!("The image panicked.");
    end(debug::EXIT_FAILURE)
}

fn end(how: debug::ExitStatus) -> ! {
    debug::exit(how);
    loop {
        core::hint::spin_loop();
    }
}
