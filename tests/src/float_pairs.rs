//! Pairs of single-precision numbers, given as their bits, that are difficult for arithmetic.

/// Turns any pair into a pair of one kind.
pub type Shape = fn(u32, u32) -> (u32, u32);

/// Kinds of pairs and their names.
pub const KINDS: [(&str, Shape); 8] = [
    ("any", |a, b| (a, b)),
    ("alike", |a, b| (a, near(a, b))),
    ("short, so that sums tie", |a, b| (a & !0xfff, near(a, b) & !0x7fff)),
    ("half as long, so that products tie", |a, b| (a & !0x7ff, b & !0x7ff)),
    ("neighbours, so that digits cancel", |a, b| (a, a ^ b & 0x8000_0007)),
    ("ones, and few bits far below, so that sums carry and lose what decides a tie", |a, b| {
        (a | 0x007f_ff00, with_exponent(b & 0x807f_8001, (a >> 23).wrapping_sub(9 + (b >> 1 & 7))))
    }),
    ("tiny, so that results are subnormal", |a, b| (tiny(a), tiny(b))),
    ("small and large, so that products and quotients are subnormal or infinite", |a, b| {
        (with_exponent(a, a >> 23 & 0x3f), with_exponent(b, 0x50 + (b >> 23 & 0x7f)))
    }),
];

/// Limits of the number range and of its classes.
pub const EDGES: [u32; 20] = [
    0,
    1,
    2,
    0x0040_0000,
    0x007f_ffff,
    0x0080_0000,
    0x0080_0001,
    0x00ff_ffff,
    0x0100_0000,
    0x3eff_ffff,
    0x3f00_0000,
    0x3f7f_ffff,
    0x3f80_0000,
    0x3f80_0001,
    0x4b80_0000,
    0x7eff_ffff,
    0x7f00_0000,
    0x7f7f_ffff,
    0x7f80_0000,
    0x7fc0_0001,
];

/// Every pair of [`EDGES`], of either sign.
pub fn edge_pairs() -> impl Iterator<Item = (u32, u32)> {
    let signed = || EDGES.into_iter().flat_map(|edge| [edge, edge | 0x8000_0000]);
    signed().flat_map(move |a| signed().map(move |b| (a, b)))
}

/// Random pairs, the same every time: xorshift64 (Marsaglia 2003).
#[derive(Debug)]
pub struct Random(pub u64);

impl Iterator for Random {
    type Item = (u32, u32);

    fn next(&mut self) -> Option<(u32, u32)> {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        Some((self.0 as u32, (self.0 >> 32) as u32))
    }
}

/// Whether two results are equal to the bit, or both NaN.
pub fn same(bits: u32, expected: f32) -> bool {
    bits == expected.to_bits() || f32::from_bits(bits).is_nan() && expected.is_nan()
}

fn with_exponent(x: u32, exponent: u32) -> u32 {
    x & 0x807f_ffff | (exponent & 0xff) << 23
}

/// `b` with an exponent that differs from that of `a` by at most 15.
fn near(a: u32, b: u32) -> u32 {
    with_exponent(b, (a >> 23).wrapping_add((b >> 23) % 31).wrapping_sub(15))
}

/// `x` with an exponent of 0 to 15.
fn tiny(x: u32) -> u32 {
    with_exponent(x, x >> 23 & 0xf)
}
