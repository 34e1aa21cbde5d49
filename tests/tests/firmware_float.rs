//! The firmware's arithmetic in plain Rust against the host's FPU, to the bit. The assembly is
//! tested in `emulated_float`.

use rp2040_float::rare;
use system_tests::float_pairs::{KINDS, Random, edge_pairs, same};

/// Number pairs per kind.
const PAIRS: usize = 1_000_000;

fn assert_same(kind: &str, a: u32, b: u32) {
    let (x, y) = (f32::from_bits(a), f32::from_bits(b));
    let (product, quotient) = (rare::multiply(a, b), rare::divide(a, b));
    assert!(same(product, x * y), "{kind}: {a:#010x} * {b:#010x} = {product:#010x}");
    assert!(same(quotient, x / y), "{kind}: {a:#010x} / {b:#010x} = {quotient:#010x}");
}

#[test]
fn products_and_quotients_are_those_of_the_fpu() {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for (kind, shape) in KINDS {
        for (a, b) in random.by_ref().take(PAIRS).map(|(a, b)| shape(a, b)) {
            assert_same(kind, a, b);
        }
    }
    for (a, b) in edge_pairs() {
        assert_same("edges", a, b);
    }
}

/// The two steps of the assembly's division, `routines.s`.
#[test]
fn two_steps_with_a_reciprocal_leave_at_most_the_last_bit() {
    let mut random = Random(1);
    let mut corrected = 0;
    for upper in 0x8000..=0xffff_u64 {
        let reciprocal = (1 << 31) / (upper + 1);
        let (r, t) = random.next().unwrap();
        for y in [upper << 8, upper << 8 | 0xff, upper << 8 | u64::from(r & 0xff)] {
            for x in [y, y + 1, 2 * y - 2, 2 * y - 1, y + u64::from(t) % y] {
                // Above 24 bits the number is a doubled one.
                let x = if x >= 1 << 24 { x & !1 } else { x };
                let product = (x >> 9) * reciprocal;
                let first = product >> 17;
                let remainder = (x << 13) - first * y;
                let second = (remainder >> 10) * reciprocal;
                assert!(product.max(remainder).max(second) < 1 << 32, "{x} / {y}");
                let quotient = (first << 10) + ((second + (1 << 18)) >> 19);
                let nearest = ((x << 24) / y).div_ceil(2);
                assert!([0, 1].contains(&(nearest - quotient)), "{x} / {y}");
                corrected += nearest - quotient;
            }
        }
    }
    assert!(corrected > 10_000, "{corrected}");
}
