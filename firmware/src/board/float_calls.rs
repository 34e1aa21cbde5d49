//! The names under which compiled code calls for single-precision arithmetic (Arm's run-time ABI for
//! floating point, 4.1.2), bound to [`crate::float`]. The linker takes these instead of the
//! compiler's, which are weak.

use crate::float;

unsafe extern "C" {
    fn __addsf3(a: u32, b: u32) -> u32;
    fn __mulsf3(a: u32, b: u32) -> u32;
}

#[unsafe(no_mangle)]
extern "C" fn __aeabi_fadd(a: u32, b: u32) -> u32 {
    // SAFETY: the compiler's own addition; it takes and gives floats in integer registers here.
    float::add(a, b).unwrap_or_else(|| unsafe { __addsf3(a, b) })
}

#[unsafe(no_mangle)]
extern "C" fn __aeabi_fsub(a: u32, b: u32) -> u32 {
    __aeabi_fadd(a, b ^ 0x8000_0000)
}

#[unsafe(no_mangle)]
extern "C" fn __aeabi_fmul(a: u32, b: u32) -> u32 {
    // SAFETY: as above.
    float::multiply(a, b).unwrap_or_else(|| unsafe { __mulsf3(a, b) })
}
