//! Tells the linker the memory map of the chosen board.

use std::env;

fn main() {
    let folder = env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let runtime = ["-Tlink.x", "-Tdefmt.x", "--nmagic"];
    let arguments = if env::var_os("CARGO_FEATURE_PICO2").is_some() {
        // Before the runtime's script, which only provides what is not defined yet.
        [&["--defsym=PICO2=1", "-Tpico2.x"][..], &runtime].concat()
    } else {
        // With the RP2040's second stage boot loader.
        [&runtime[..], &["-Tlink-rp.x"]].concat()
    };
    for argument in arguments {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    // `memory.x` for a linker that does not run in the workspace's folder, and `pico2.x`.
    println!("cargo:rustc-link-search={folder}/..");
    println!("cargo:rustc-link-search={folder}");
    println!("cargo:rerun-if-changed=../memory.x");
    println!("cargo:rerun-if-changed=pico2.x");
}
