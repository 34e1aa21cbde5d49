//! Single-precision arithmetic under the names by which compiled code calls it (`float.s`).

use super::float;

core::arch::global_asm!(include_str!("float.s"), options(raw));

/// Products of rare inputs.
#[unsafe(no_mangle)]
extern "C" fn float_multiply(a: u32, b: u32) -> u32 {
    float::multiply(a, b)
}

/// Quotients of rare inputs.
#[unsafe(no_mangle)]
extern "C" fn float_divide(a: u32, b: u32) -> u32 {
    float::divide(a, b)
}
