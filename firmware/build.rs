//! Hands the linker the memory map of the board and cortex-m-rt's script.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let has = |board: &str| env::var_os(format!("CARGO_FEATURE_{board}")).is_some();
    let map = if has("OLIMEX_H405") {
        include_str!("memory/stm32f405.x")
    } else if has("NUCLEO_G474RE") {
        include_str!("memory/stm32g474.x")
    } else {
        return;
    };
    fs::write(out.join("memory.x"), map).expect("OUT_DIR can be written");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rerun-if-changed=memory");
}
