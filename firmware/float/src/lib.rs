//! Single-precision arithmetic for the RP2040, whose Cortex-M0+ has no FPU. A program that links
//! this crate (`use rp2040_float as _;`) calls it wherever it adds, subtracts, multiplies, divides
//! or compares f32: the routines have the names of Arm's run-time ABI, and the linker prefers them
//! to the compiler's, which are weak.
//!
//! The results equal an FPU's to the bit. Therefore board, emulator and host can compute the same;
//! the boot ROM's routines would flush subnormal numbers to zero.
//!
//! It also saves time. Mean cycles for ordinary numbers on the emulated chip, including the return,
//! without the call:
//!
//! | routine | cycles |
//! |---|---|
//! | sum, difference | 43, 46 |
//! | product | 52 |
//! | quotient | 76 |
//! | comparison | 17 to 21 |
//!
//! When they were introduced, the core's step fell from 119 to 50 us at 125 MHz. `cargo test -p
//! system-tests emulated_float -- --nocapture` measures them in the firmware's image and compares
//! every kind of number with the host's FPU.
//!
//! The routines are in `routines.s`. Rare inputs go to [`rare`]: subnormal, infinite, not a number,
//! over- and underflow.

#![no_std]

pub mod rare;

/// Entry points by which compiled code and `routines.s` call the routines.
#[cfg(all(target_arch = "arm", target_os = "none"))]
mod calls {
    use crate::rare;

    core::arch::global_asm!(include_str!("routines.s"), options(raw));

    #[unsafe(no_mangle)]
    extern "C" fn float_multiply(a: u32, b: u32) -> u32 {
        rare::multiply(a, b)
    }

    #[unsafe(no_mangle)]
    extern "C" fn float_divide(a: u32, b: u32) -> u32 {
        rare::divide(a, b)
    }
}
