//! The emulator's own instructions against those of rp2040js.

use std::process::Command;
use thermyo_boards::image::prepare_emulator;

/// Instructions that the emulator executes itself, of 1 572 864.
const COMPARED: std::ops::RangeInclusive<u32> = 950_000..=1_030_000;

#[test]
fn instructions_have_the_same_result_in_the_same_time() {
    prepare_emulator().unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/instructions.mjs");
    let output = Command::new("node").arg(script).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.trim().parse().is_ok_and(|count| COMPARED.contains(&count)), "{text}");
}
