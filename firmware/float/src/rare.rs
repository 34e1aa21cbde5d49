//! Single-precision multiply and divide in integers, for every input, short rather than fast. The
//! RP2040 uses them for rare inputs: subnormal, infinite, not a number, over- and underflow.
//! `routines.s` handles all others. The results equal an FPU's to the bit: round to nearest, ties
//! to even (IEEE 754).

const SIGN: u32 = 0x8000_0000;
const INFINITE: u32 = 0x7f80_0000;
const NOT_A_NUMBER: u32 = 0x7fc0_0000;
const HIDDEN: u32 = 0x0080_0000;

/// Product of two numbers given as their bits.
pub fn multiply(a: u32, b: u32) -> u32 {
    let sign = (a ^ b) & SIGN;
    let (a, b) = (a & !SIGN, b & !SIGN);
    if a > INFINITE || b > INFINITE {
        return NOT_A_NUMBER;
    }
    if a == INFINITE || b == INFINITE {
        return if a == 0 || b == 0 { NOT_A_NUMBER } else { sign | INFINITE };
    }
    if a == 0 || b == 0 {
        return sign;
    }
    let ((i, x), (j, y)) = (parts(a), parts(b));
    // 24 by 24 bits from three products, each of which fits 32 bits.
    let low = (x & 0xff) * y;
    let middle = (x >> 8) * (y & 0xfff) + (low >> 8);
    let high = (((x >> 8) * (y >> 12)) << 4) + (middle >> 8);
    sign | rounded(i + j - 126, high | u32::from((low | middle) & 0xff != 0))
}

/// Quotient of two numbers given as their bits.
pub fn divide(a: u32, b: u32) -> u32 {
    let sign = (a ^ b) & SIGN;
    let (a, b) = (a & !SIGN, b & !SIGN);
    if a > INFINITE || b > INFINITE || a == b && (a == 0 || a == INFINITE) {
        return NOT_A_NUMBER;
    }
    if a == INFINITE || b == 0 {
        return sign | INFINITE;
    }
    if a == 0 || b == INFINITE {
        return sign;
    }
    let ((i, mut x), (j, y)) = (parts(a), parts(b));
    let mut quotient = 0;
    for _ in 0..31 {
        quotient <<= 1;
        if x >= y {
            x -= y;
            quotient |= 1;
        }
        x <<= 1;
    }
    sign | rounded(i - j + 127, quotient << 1 | u32::from(x != 0))
}

/// Biased exponent and fraction of a positive number, normalised to the place of the hidden bit.
fn parts(x: u32) -> (i32, u32) {
    let (mut exponent, mut fraction) = ((x >> 23) as i32, x & (HIDDEN - 1));
    if exponent == 0 {
        exponent = 1;
    } else {
        fraction |= HIDDEN;
    }
    while fraction & HIDDEN == 0 {
        fraction <<= 1;
        exponent -= 1;
    }
    (exponent, fraction)
}

/// Rounds a positive number of this biased exponent and fraction. The fraction's first set bit is
/// the topmost or the next, and its last bit is sticky.
fn rounded(mut exponent: i32, mut fraction: u32) -> u32 {
    if fraction & SIGN == 0 {
        fraction <<= 1;
        exponent -= 1;
    }
    if exponent >= 255 {
        return INFINITE;
    }
    if exponent < 1 {
        let shift = (1 - exponent).min(31) as u32;
        fraction = fraction >> shift | u32::from(fraction & ((1 << shift) - 1) != 0);
        exponent = 1;
    }
    // The hidden bit adds one to the exponent, and a carry another, up to infinity.
    let fraction =
        (fraction >> 8) + u32::from(fraction & 0xff > 0x7f + u32::from(fraction & 0x100 == 0));
    ((exponent as u32 - 1) << 23) + fraction
}
