//! One number for each zone of the gas, and arithmetic with them.

/// Number of zones.
pub const ZONES: usize = 4;
/// One number for each zone.
pub type PerZone = [f32; ZONES];

/// Sum over the zones.
pub fn total(values: &PerZone) -> f32 {
    let [a, b, c, d] = values;
    (a + b) + (c + d)
}

/// Product, zone by zone.
pub fn times(a: &PerZone, b: &PerZone) -> PerZone {
    let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (a, b);
    [a0 * b0, a1 * b1, a2 * b2, a3 * b3]
}

/// All zones times a factor.
pub fn scaled(a: &PerZone, by: f32) -> PerZone {
    times(a, &[by; ZONES])
}

/// Sum, zone by zone.
pub fn plus(a: &PerZone, b: &PerZone) -> PerZone {
    let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (a, b);
    [a0 + b0, a1 + b1, a2 + b2, a3 + b3]
}

/// Difference, zone by zone.
pub fn minus(a: &PerZone, b: &PerZone) -> PerZone {
    let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (a, b);
    [a0 - b0, a1 - b1, a2 - b2, a3 - b3]
}

/// The smaller one, zone by zone.
pub fn least(a: &PerZone, b: &PerZone) -> PerZone {
    let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (a, b);
    let least = |a: f32, b: f32| if a < b { a } else { b };
    [least(*a0, *b0), least(*a1, *b1), least(*a2, *b2), least(*a3, *b3)]
}
