//! Gives the linker the memory map of the chosen board.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let pico2 = env::var_os("CARGO_FEATURE_PICO2").is_some();
    let map = if pico2 { "memory/pico2.x" } else { "../memory.x" };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(map, out.join("memory.x")).expect("the memory map is part of the repository");
    println!("cargo:rerun-if-changed={map}");
    println!("cargo:rustc-link-search={}", out.display());

    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    if !pico2 {
        // The RP2040's second stage boot loader.
        println!("cargo:rustc-link-arg-bins=-Tlink-rp.x");
    }
}
