//! Leaves out the tests that need Node.js or a board's target if `THERMYO_SKIP_EMULATOR` is 1.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(emulator)");
    println!("cargo::rerun-if-env-changed=THERMYO_SKIP_EMULATOR");
    if std::env::var_os("THERMYO_SKIP_EMULATOR").is_none_or(|value| value != "1") {
        println!("cargo::rustc-cfg=emulator");
    }
}
