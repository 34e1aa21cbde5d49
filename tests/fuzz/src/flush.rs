//! The processor's mode in which subnormal numbers are zeros.

/// Runs `work` with subnormal operands and results as zeros: flush-to-zero and denormals-are-zero of
/// x86_64. On other processors it runs `work` unchanged.
pub fn flushed<R>(work: impl FnOnce() -> R) -> R {
    let _mode = Mode::flush();
    apart(work)
}

/// Keeps the compiler from moving operations of `work` out of their mode.
#[inline(never)]
fn apart<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// The previous mode; restored when dropped, also by a panic.
struct Mode(u32);

#[cfg(target_arch = "x86_64")]
impl Mode {
    /// FTZ and DAZ of MXCSR.
    const FLUSH: u32 = 1 << 15 | 1 << 6;

    fn flush() -> Self {
        let mut before = 0_u32;
        // SAFETY: stores MXCSR in `before`.
        unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut before) };
        Self::load(before | Self::FLUSH);
        Self(before)
    }

    fn load(mxcsr: u32) {
        // SAFETY: the stored value with two bits that x86_64 defines.
        unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const mxcsr) };
    }
}

#[cfg(target_arch = "x86_64")]
impl Drop for Mode {
    fn drop(&mut self) {
        Self::load(self.0);
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Mode {
    fn flush() -> Self {
        Self(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn subnormals_are_zeros_within_and_only_there() {
        let half = || black_box(f32::MIN_POSITIVE) * black_box(0.5);
        let twice = || black_box(1.0e-40_f32) * black_box(2.0);
        assert_eq!((flushed(half), flushed(twice)), (0.0, 0.0));
        assert!(half() > 0.0 && twice() > 0.0);
        std::panic::catch_unwind(|| flushed(|| panic!("within"))).unwrap_err();
        assert!(half() > 0.0);
    }
}
