//! Radii of the pulley over the angle.
//!
//! ```text
//! r_i(q) = radius_m s_i(q),   s_i = 1 + k1 q + k2 q^2 + k3 q^3 (muscle b: its share in place of 1)
//! L_a = mid_length_a_m - integral of r_a from 0 to q,   L_b = mid_length_b_m + integral of r_b
//! ```
//!
//! A muscle on a radius s r acts like another muscle on r: [`Lever`] holds the difference. For a constant radius,
//! lengths and levers equal those of a plain pulley to the bit, at the cost of a comparison of integers.

/// Coefficients of a muscle's radius over `radius_m`, by rising powers of the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape(pub [f32; 4]);

/// How a muscle acts at an angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lever {
    /// The muscle's radius over `radius_m` \[-\].
    pub share: f32,
    /// Change of the share per way on `radius_m`, positive if the muscle thereby pulls the joint back \[1/m\].
    pub turn_per_m: f32,
}

impl Lever {
    /// Lever of a constant radius.
    pub const PLAIN: Self = Self { share: 1.0, turn_per_m: 0.0 };

    /// Converts a way \[m\] or a radius \[m\] of the pulley to the muscle's.
    pub fn scaled(&self, of_pulley: f32) -> f32 {
        if self.is_plain() { of_pulley } else { of_pulley * self.share }
    }

    /// Whether the lever changes nothing.
    pub fn is_plain(&self) -> bool {
        let Self { share, turn_per_m } = self;
        (share.to_bits() ^ 1.0_f32.to_bits()) | turn_per_m.to_bits() == 0
    }
}

impl Shape {
    /// Angle on `radius_m` that winds up as much as this one \[rad\].
    #[inline(never)]
    pub fn wound_rad(&self, angle_rad: f32) -> f32 {
        let Self([share, one, two, three]) = *self;
        let mean = Self([share, 0.5 * one, (1.0 / 3.0) * two, 0.25 * three]);
        angle_rad * mean.share(angle_rad)
    }

    /// The lever at an angle; `pulls_m`: `radius_m`, negative for a muscle that shortens as the angle grows.
    #[inline(never)]
    pub fn lever(&self, angle_rad: f32, pulls_m: f32) -> Lever {
        let Self([_, one, two, three]) = *self;
        let slope = Self([one, 2.0 * two, 3.0 * three, 0.0]).share(angle_rad);
        Lever { share: self.share(angle_rad), turn_per_m: slope / pulls_m }
    }

    #[inline(never)] // In three places: as small as can be.
    fn share(&self, angle_rad: f32) -> f32 {
        let Self([share, one, two, three]) = *self;
        share + angle_rad * (one + angle_rad * (two + angle_rad * three))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with sums over small ways.
    #[test]
    fn a_length_is_the_integral_of_the_radius() {
        let shape = Shape([0.9, 0.2, -0.1, 0.05]);
        let share = |angle_rad: f32| {
            let q = f64::from(angle_rad);
            0.9 + 0.2 * q - 0.1 * q * q + 0.05 * q * q * q
        };
        for end_rad in [-1.2_f32, -0.3, 0.4, 1.1] {
            let steps = 2000_u16;
            let at = |i: u16| f64::from(end_rad) * (f64::from(i) + 0.5) / f64::from(steps);
            let sum: f64 = (0..steps).map(|i| share(at(i) as f32)).sum();
            let wound = shape.wound_rad(end_rad);
            let lever = shape.lever(end_rad, -0.02);
            let expected = f64::from(end_rad) * sum / f64::from(steps);
            assert!((f64::from(wound) - expected).abs() < 1e-6, "{wound} at {end_rad}");
            assert!((f64::from(lever.share) - share(end_rad)).abs() < 1e-6, "{lever:?}");
            let slope = (share(end_rad + 0.01) - share(end_rad - 0.01)) / 0.02;
            let turn = -0.02 * f64::from(lever.turn_per_m);
            assert!((turn - slope).abs() < 1e-4, "{slope} at {end_rad}");
        }
    }

    #[test]
    fn a_constant_radius_is_plain() {
        let lever = |shape| Shape(shape).lever(0.7, 0.02);
        assert!(Lever::PLAIN.is_plain() && Lever::PLAIN.scaled(0.3) == 0.3);
        assert!(!lever([1.1, 0.0, 0.0, 0.0]).is_plain());
        assert!(!lever([1.0, 0.0, 0.0, 0.1]).is_plain());
        let wound_rad = Shape([1.0, 0.0, 0.0, 0.0]).wound_rad(0.7);
        assert_eq!(wound_rad.to_bits(), 0.7_f32.to_bits());
    }
}
