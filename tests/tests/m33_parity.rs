//! The core on a Cortex-M33, which has an FPU, computes the same as on the host, to the bit.
//!
//! The emulator computes with the host's FPU: this shows that the compiled code does the same operations in the same
//! order. IEEE 754 ensures that the chip's FPU rounds like the host's.

use system_tests::m33::EmulatedM33;
use system_tests::parity;

/// Cycles of a step, compiled like the images: 3 676 in the mean and 6 114 at worst of the 150 000 in a millisecond at
/// 150 MHz.
const MEAN: std::ops::Range<u64> = 3400..3900;
const WORST: std::ops::Range<u32> = 5700..6500;

fn ten_thousand_steps(target: &str) {
    let started = std::time::Instant::now();
    let mut board = EmulatedM33::new(target);
    let built = started.elapsed();
    parity::run(&mut board, |_, _| ()).assert_same_on_the_host();
    let cycles = board.step_cycles();
    let mean = cycles.iter().map(|&cycles| u64::from(cycles)).sum::<u64>() / cycles.len() as u64;
    let worst = *cycles.iter().max().unwrap();
    println!("{target}: {mean} cycles a step, {worst} at worst; {:?}", started.elapsed() - built);
    assert!(MEAN.contains(&mean) && WORST.contains(&worst), "{mean}, {worst} at worst");
}

#[test]
fn code_for_the_cortex_m33_is_equal_to_the_bit() {
    ten_thousand_steps("thumbv8m.main-none-eabihf");
}

/// The code of the NUCLEO-G474RE, which a Cortex-M33 can run too.
#[test]
fn code_for_the_cortex_m4f_is_equal_to_the_bit() {
    ten_thousand_steps("thumbv7em-none-eabihf");
}
