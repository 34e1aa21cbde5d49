//! model-core linked alone has no way to a panic.

use std::process::Command;
use system_tests::skip_emulator;

#[test]
fn the_core_and_its_wire_link_without_a_panic() {
    // It needs the chip's target, as the emulator's tests do.
    if skip_emulator() {
        return;
    }
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| root.join("target"), Into::into)
        .join("panic-free");
    let output = Command::new(env!("CARGO"))
        .args(["build", "--release", "--package", "panic-free", "--target", "thumbv6m-none-eabi"])
        .args(["--config", "profile.release.lto = 'fat'"])
        .args(["--config", "profile.release.codegen-units = 1"])
        .arg("--target-dir")
        .arg(target)
        .current_dir(root)
        .env_remove("RUSTFLAGS")
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!message.contains("model_core_can_panic"), "model-core can panic:\n{message}");
    assert!(output.status.success(), "{message}");
}
