//! Single-precision add, subtract and multiply for the RP2040, which has no FPU but multiplies 32
//! bits in one cycle. They take the place of the compiler's own, which are written for every machine
//! and take twice as long. Same results to the bit: round to nearest, ties to even (IEEE 754); what is
//! rare (zero, subnormal, infinite, not a number, over- and underflow) is left to the compiler's.
//!
//! Plain integer functions, so that a test on the host compares them with the host's FPU.

const SIGN: u32 = 0x8000_0000;
const HIDDEN: u32 = 0x0080_0000;
const FRACTION: u32 = 0x007f_ffff;

/// Biased exponent.
const fn exponent(x: u32) -> u32 {
    (x >> 23) & 0xff
}

/// Neither zero nor subnormal, nor infinite, nor not a number.
const fn is_normal(x: u32) -> bool {
    exponent(x).wrapping_sub(1) < 254
}

/// Product of two numbers given as their bits; `None` for the rare cases.
#[inline(always)]
pub fn multiply(a: u32, b: u32) -> Option<u32> {
    if !is_normal(a) || !is_normal(b) {
        return None;
    }
    let (x, y) = (a & FRACTION | HIDDEN, b & FRACTION | HIDDEN);
    // 24 by 24 bits from three products, none of which leaves 32 bits. `product` is the upper 26 to
    // 28 bits of the 48, with a sticky bit for the twenty below.
    let low = (x & 0xff) * y;
    let middle = (x >> 8) * (y & 0xfff) + (low >> 8);
    let mut product = (x >> 8) * (y >> 12) + (middle >> 12);
    product |= u32::from((middle << 20 | low & 0xff) != 0);
    let mut biased = (exponent(a) + exponent(b)).wrapping_sub(126);
    if product & HIDDEN << 4 == 0 {
        product <<= 1;
        biased = biased.wrapping_sub(1);
    }
    assemble((a ^ b) & SIGN, biased, product)
}

/// Sum of two numbers given as their bits; `None` for the rare cases.
#[inline(always)]
pub fn add(a: u32, b: u32) -> Option<u32> {
    // The larger magnitude first.
    let (a, b) = if a << 1 >= b << 1 { (a, b) } else { (b, a) };
    if !is_normal(a) {
        return None;
    }
    if !is_normal(b) {
        return if b << 1 == 0 { Some(a) } else { None };
    }
    let mut biased = exponent(a);
    let shift = biased - exponent(b);
    // Less than a quarter of the last place of the larger, even below a power of two.
    if shift > 26 {
        return Some(a);
    }
    // Two guard bits and a sticky one.
    let x = (a & FRACTION | HIDDEN) << 3;
    let y = (b & FRACTION | HIDDEN) << 3;
    let lost = y & ((1 << shift) - 1);
    let y = y >> shift | u32::from(lost != 0);
    let mut sum;
    if (a ^ b) & SIGN == 0 {
        sum = x + y;
        if sum & HIDDEN << 4 != 0 {
            sum = sum >> 1 | sum & 1;
            biased += 1;
        }
    } else {
        sum = x - y;
        if sum == 0 {
            return Some(0);
        }
        while sum & HIDDEN << 3 == 0 {
            sum <<= 1;
            biased -= 1;
            if biased == 0 {
                return None;
            }
        }
    }
    assemble(a & SIGN, biased, sum << 1)
}

/// The number of a sign, a biased exponent and 28 bits of fraction, the hidden bit being the first of
/// them and four too many: rounded to nearest, ties to even. The hidden bit adds the one by which the
/// exponent is put in too small, and so does a carry out of the fraction.
#[inline(always)]
fn assemble(sign: u32, biased: u32, fraction: u32) -> Option<u32> {
    // Rounding up can only reach 254, which is a number still.
    if biased.wrapping_sub(1) >= 253 {
        return None;
    }
    let rounded = (fraction + 7 + (fraction >> 4 & 1)) >> 4;
    Some(sign | (((biased - 1) << 23) + rounded))
}
