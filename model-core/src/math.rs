//! Functions that `core` lacks: square root, exponential, logarithm, sine, clamp to a range.
//!
//! `micromath` gives the seed (a bit trick, some 5 % off), and Newton's method does the rest, so the result is the same
//! to the bit on a soft-float Cortex-M0+, on an FPU and on the host: every operation is one IEEE 754 add, subtract or
//! multiply, and none is fused.

use micromath::F32Ext;

/// Smallest magnitude other than zero that the core accepts as input, in any unit: far from the subnormal numbers,
/// which are zeros on some processors.
pub(crate) const SMALLEST: f32 = 1.0e-20;

/// Reciprocal square root, relative error below 1e-6.
///
/// Returns 0 for arguments that are not positive: the callers' ranges exclude them, and a finite
/// value keeps a filter alive where a NaN would not.
pub fn inverse_sqrt(x: f32) -> f32 {
    // Below the smallest normal number the seed's bit trick does not hold.
    if !(x >= f32::MIN_POSITIVE) {
        return 0.0;
    }
    let half = 0.5 * x;
    let mut y = x.invsqrt();
    // Newton: e' = 1.5 e^2; 5 % becomes 4e-3, 2e-5, 1e-9.
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y
}

/// Reciprocal square root, relative error below 5 %, for limits that need no more; 0 for arguments that are not
/// positive.
pub fn rough_inverse_sqrt(x: f32) -> f32 {
    if x >= f32::MIN_POSITIVE { x.invsqrt() } else { 0.0 }
}

/// Square root, relative error below 1e-6; 0 for arguments that are not positive.
pub fn sqrt(x: f32) -> f32 {
    x * inverse_sqrt(x)
}

/// Reciprocal cube root, relative error below 4e-3, which is enough for laws of heat transfer; 0 for arguments that are not positive.
pub fn inverse_cube_root(x: f32) -> f32 {
    if !(x >= f32::MIN_POSITIVE) {
        return 0.0;
    }
    // The exponent times -1/3; with this constant the error is at most about 3.5 %.
    let mut y = f32::from_bits(0x54a2_fa8c_u32.wrapping_sub(x.to_bits() / 3));
    let third = (1.0 / 3.0) * x;
    // Newton: e' = 2 e^2.
    y *= 4.0 / 3.0 - third * y * y * y;
    y
}

/// ln 2 in two parts (Cody and Waite), so that the remainder of an argument keeps all its bits.
const LN_2_HIGH: f32 = 0.693_359_4;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// Exponential, relative error below 1e-6, arguments limited to -80 ..= 80.
pub fn exp(x: f32) -> f32 {
    const LOG2_E: f32 = core::f32::consts::LOG2_E;
    let x = limit(x, -80.0, 80.0);
    let scaled = x * LOG2_E;
    let n = if scaled >= 0.0 { scaled + 0.5 } else { scaled - 0.5 } as i32;
    let n_f32 = n as f32;
    let r = (x - n_f32 * LN_2_HIGH) - n_f32 * LN_2_LOW;
    // Taylor to r^6 for |r| <= ln(2)/2: remainder 1.2e-7.
    let polynomial = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    // 2^n through the exponent field; |n| <= 116 keeps it a normal number.
    polynomial * f32::from_bits(((n + 127) as u32) << 23)
}

/// Exponential of a small number, limited to -0.2 ..= 0.2: error x^3/12, but a rise by x and a fall by x give exactly
/// 1.
pub fn small_exp(x: f32) -> f32 {
    let half = 0.5 * limit(x, -0.2, 0.2);
    (1.0 + half) / (1.0 - half)
}

/// Natural logarithm, relative error below 1e-6; for arguments that are not positive, the logarithm of the smallest
/// normal number.
pub fn ln(x: f32) -> f32 {
    /// The bits of sqrt(1/2).
    const LEAST: u32 = 0x3f35_04f3;
    let bits = limit(x, f32::MIN_POSITIVE, f32::MAX).to_bits();
    // x = 2^n m, m from sqrt(1/2) to sqrt(2).
    let n = (bits.wrapping_sub(LEAST) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((n as u32) << 23));
    // ln m = 2 artanh s; |s| <= 0.172, and the series leaves a remainder of 1e-9 of it.
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = 1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    let n = n as f32;
    n * LN_2_HIGH + (n * LN_2_LOW + 2.0 * s * series)
}

/// Pi in two parts (Cody and Waite); the first has eight bits, so that a small multiple of it is exact.
const PI_HIGH: f32 = 3.140_625;
const PI_LOW: f32 = 9.676_536e-4;

/// Sine of an angle \[rad\], error below 3e-7 up to 100 rad, to which arguments are limited.
pub fn sin(angle_rad: f32) -> f32 {
    let x = limit(angle_rad, -100.0, 100.0);
    let scaled = x * core::f32::consts::FRAC_1_PI;
    let half_turns = if scaled >= 0.0 { scaled + 0.5 } else { scaled - 0.5 } as i32;
    let n = half_turns as f32;
    let r = (x - n * PI_HIGH) - n * PI_LOW;
    let z = r * r;
    // Taylor to r^11 for |r| <= pi/2: remainder 6e-8.
    let series = 1.0
        - z * (1.0 / 6.0)
            * (1.0
                - z * (1.0 / 20.0)
                    * (1.0
                        - z * (1.0 / 42.0) * (1.0 - z * (1.0 / 72.0) * (1.0 - z * (1.0 / 110.0)))));
    let sine = r * series;
    if half_turns & 1 == 0 { sine } else { -sine }
}

/// `x` limited to `low ..= high`; `low` for NaN. `f32::clamp` would panic on a bad range.
pub fn limit(x: f32, low: f32, high: f32) -> f32 {
    if order(x) < order(low) || order(x) > order(f32::INFINITY) {
        low
    } else if order(x) > order(high) {
        high
    } else {
        x
    }
}

/// Maps `x` to an integer with the same order, NaN beyond the infinities. A processor without floating point compares
/// integers in a tenth of the time.
const fn order(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits }
}

/// Whether `x` is greater than `y`; NaN counts as beyond the infinities.
pub fn is_above(x: f32, y: f32) -> bool {
    order(x) > order(y)
}

/// Whether `x` lies in `low ..= high`; false for NaN.
pub fn is_within(x: f32, low: f32, high: f32) -> bool {
    (order(low)..=order(high)).contains(&order(x))
}

/// Magnitude; NaN for NaN.
pub fn absolute(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

/// A sum that keeps the part that each addition rounds away (Kahan 1965), so that ten million small steps do not drift.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CompensatedSum {
    value: f32,
    lost: f32,
}

impl CompensatedSum {
    /// Creates a sum that starts at `value`.
    ///
    /// ```
    /// use model_core::math::CompensatedSum;
    ///
    /// let mut sum = CompensatedSum::new(1.0);
    /// (0..10_000_000).for_each(|_| sum.add(1.0e-7));
    /// assert!((sum.value() - 2.0).abs() < 1.0e-6);
    /// ```
    pub const fn new(value: f32) -> Self {
        Self { value, lost: 0.0 }
    }

    /// Adds `term`.
    pub fn add(&mut self, term: f32) {
        let corrected = term - self.lost;
        let sum = self.value + corrected;
        self.lost = (sum - self.value) - corrected;
        self.value = sum;
    }

    /// The sum.
    pub const fn value(&self) -> f32 {
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn inverse_cube_root_meets_its_bound() {
        let mut worst = 0.0_f64;
        for i in 0..4000 {
            let x = exp(-60.0 + 0.03 * i as f32);
            let exact = f64::from(x).powf(-1.0 / 3.0);
            worst = worst.max((f64::from(inverse_cube_root(x)) / exact - 1.0).abs());
        }
        assert!((5e-4..4e-3).contains(&worst), "{worst}");
        assert_eq!([0.0, -1.0, f32::NAN].map(inverse_cube_root), [0.0; 3]);
    }

    proptest! {
        #[test]
        fn limits_compare_as_numbers_do(x in any::<u32>(), a in any::<f32>(), b in any::<f32>()) {
            let (low, high) = (a.min(b), a.max(b));
            let some = [low, high, -low, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, -f32::NAN, f32::MAX];
            for x in some.into_iter().chain([f32::from_bits(x), 0.5 * low + 0.5 * high]) {
                let within = x >= low && x <= high;
                prop_assert_eq!(is_above(x, low), x > low || (x.is_nan() && x.is_sign_positive()), "{} {}", x, low);
                prop_assert_eq!(is_within(x, low, high), within, "{} {} {}", x, low, high);
                let limited = if within { x } else if x > high { high } else { low };
                prop_assert_eq!(limit(x, low, high), limited, "{} {} {}", x, low, high);
            }
        }

        #[test]
        fn sqrt_is_close(x in 1.0e-30_f32..1.0e30) {
            let exact = f64::from(x).sqrt();
            prop_assert!((f64::from(sqrt(x)) / exact - 1.0).abs() < 1e-6);
            prop_assert!((f64::from(inverse_sqrt(x)) * exact - 1.0).abs() < 1e-6);
        }

        #[test]
        fn sine_is_close(x in -100.0_f32..100.0) {
            prop_assert!((f64::from(sin(x)) - f64::from(x).sin()).abs() < 1e-6);
        }

        #[test]
        fn exp_is_close(x in -80.0_f32..80.0) {
            prop_assert!((f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs() < 1e-6);
        }

        #[test]
        fn small_exp_is_close(x in -0.2_f32..0.2) {
            let off = f64::from(small_exp(x)) - f64::from(x).exp();
            prop_assert!(off.abs() < 1e-6 + f64::from(x).abs().powi(3) / 8.0);
            prop_assert_eq!(small_exp(9.0), small_exp(0.2));
        }

        #[test]
        fn ln_is_close(x in -80.0_f64..80.0, near in 0.5_f32..2.0) {
            for x in [x.exp() as f32, near] {
                let exact = f64::from(x).ln();
                prop_assert!((f64::from(ln(x)) - exact).abs() <= 1e-6 * exact.abs(), "{x}");
            }
        }

        #[test]
        fn nothing_but_finite_values(bits in any::<u32>()) {
            let x = f32::from_bits(bits);
            prop_assert!(exp(x).is_finite());
            prop_assert!(ln(x).is_finite());
            prop_assert!(inverse_sqrt(x).is_finite());
            prop_assert!((-1.0..=2.0).contains(&limit(x, -1.0, 2.0)));
        }
    }

    #[test]
    fn compensated_sum_does_not_drift() {
        let mut compensated = CompensatedSum::new(1.0);
        let mut plain = 1.0_f32;
        for _ in 0..10_000_000 {
            compensated.add(1.0e-8);
            plain += 1.0e-8;
        }
        assert!((compensated.value() - 1.1).abs() < 2.0e-7);
        assert_eq!(plain, 1.0, "the plain sum shows why");
    }
}
