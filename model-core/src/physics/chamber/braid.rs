//! A McKibben muscle (paper eq. 10, 11 and Fig. 1; Chou and Hannaford 1994).
//!
//! A braid of threads of length b that turn n times around the muscle: L = b cos(theta),
//! D = b sin(theta)/(n pi), with theta the angle between thread and axis.
//!
//! # Force
//!
//! ```text
//! F = P_g (3 l^2 - b^2)/(4 pi n^2) - k (L_0 - l) - K1 s((L_0 - l)/(e1 L_0)),    l = L - d0
//! s(x) = 1 - exp(-x) beyond x = 0, x before it
//! ```
//!
//! The braid pulls as in Chou and Hannaford (-P_g dV/dL, eq. 11). The bladder holds back: with a linear part k, and
//! with a part that saturates after a few percent of contraction (K1, over the strain e1), like a rubber tube that is
//! bent and pressed against threads. d0 is the part of the length that is not braid: threads that have straightened,
//! fittings that have yielded. With k, K1 and d0 at zero it is the ideal braid of the paper. Measured on two muscles in
//! `docs/background/validation.md`.
//!
//! # Length for a force
//!
//! At gauge pressures from zero on, F rises with l, and so does its slope: F is convex. The saturating part never holds
//! back more than K1, nor more than K1 x, so the roots of the two quadratics with these in its place lie at or above
//! the solution. From there Newton's steps descend to it and never pass it: `STEPS` of them cannot fail.

use super::{Chamber, Springs};
use crate::math::{exp, limit, sqrt};
use crate::parameter::{ConfigError, within};
use core::f32::consts::PI;

/// Newton's steps to a length; see above.
const STEPS: u8 = 6;

/// The braid: the two coefficients b and n of Fig. 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Braid {
    /// Thread length b \[m\].
    pub thread_length_m: f32,
    /// Number of thread turns n \[-\].
    pub turns: f32,
}

/// Reason why a braid cannot be built from the given values.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum BraidError {
    /// A length or diameter is not a positive number.
    NotPositive {
        /// The value given \[m\].
        value_m: f32,
    },
    /// The braid angle at rest lies outside of 1 to 54 deg (54.7 deg is where the force vanishes).
    AngleOutOfRange {
        /// The value given \[deg\].
        angle_deg: f32,
    },
    /// Fewer than two pairs, or pairs of one diameter only: two unknowns need two equations.
    TooFewPairs,
    /// The pairs do not describe a braid: the diameter must grow as the length shrinks.
    NotABraid,
}

impl Braid {
    /// Coefficients from length, diameter and braid angle (to the axis) at rest, Fig. 1.
    ///
    /// ```
    /// use model_core::physics::chamber::Braid;
    ///
    /// let braid = Braid::from_rest(0.3, 0.02, 25.0)?;
    /// assert!((braid.thread_length_m - 0.331).abs() < 1.0e-3);
    /// # Ok::<(), model_core::physics::chamber::BraidError>(())
    /// ```
    ///
    /// # Errors
    /// [`BraidError`] for lengths that are not positive and angles outside of 1 to 54 deg.
    pub fn from_rest(
        length_m: f32,
        diameter_m: f32,
        braid_angle_deg: f32,
    ) -> Result<Self, BraidError> {
        for value_m in [length_m, diameter_m] {
            if !(value_m > 0.0 && value_m < f32::INFINITY) {
                return Err(BraidError::NotPositive { value_m });
            }
        }
        if !(1.0..=54.0).contains(&braid_angle_deg) {
            return Err(BraidError::AngleOutOfRange { angle_deg: braid_angle_deg });
        }
        let (sin, cos) = sin_cos(braid_angle_deg * (PI / 180.0));
        let thread_length_m = length_m / cos;
        Ok(Self { thread_length_m, turns: thread_length_m * sin / (PI * diameter_m) })
    }

    /// Coefficients from measured pairs of length and diameter \[m\], by least squares.
    ///
    /// L^2 = b^2 - (n pi)^2 D^2 is linear in b^2 and (n pi)^2.
    ///
    /// ```
    /// use model_core::physics::chamber::Braid;
    ///
    /// let braid = Braid::from_pairs(&[(0.30, 0.020), (0.25, 0.031)])?;
    /// assert!(braid.thread_length_m > 0.30);
    /// # Ok::<(), model_core::physics::chamber::BraidError>(())
    /// ```
    ///
    /// # Errors
    /// [`BraidError`] when a value is not positive, when there are fewer than two different
    /// diameters, or when the line through the pairs rises.
    pub fn from_pairs(length_diameter_m: &[(f32, f32)]) -> Result<Self, BraidError> {
        let mut mean_x = 0.0;
        let mut mean_y = 0.0;
        let mut count = 0.0;
        for &(length_m, diameter_m) in length_diameter_m {
            for value_m in [length_m, diameter_m] {
                if !(value_m > 0.0 && value_m < f32::INFINITY) {
                    return Err(BraidError::NotPositive { value_m });
                }
            }
            count += 1.0;
            mean_x += diameter_m * diameter_m;
            mean_y += length_m * length_m;
        }
        if count < 2.0 {
            return Err(BraidError::TooFewPairs);
        }
        mean_x /= count;
        mean_y /= count;
        let mut variance = 0.0;
        let mut covariance = 0.0;
        for &(length_m, diameter_m) in length_diameter_m {
            let x = diameter_m * diameter_m - mean_x;
            variance += x * x;
            covariance += x * (length_m * length_m - mean_y);
        }
        if variance <= 1.0e-10 * mean_x * mean_x * count {
            return Err(BraidError::TooFewPairs);
        }
        let turns_pi_squared = -covariance / variance;
        let thread_squared = mean_y + turns_pi_squared * mean_x;
        if !(turns_pi_squared > 0.0 && thread_squared > 0.0) {
            return Err(BraidError::NotABraid);
        }
        Ok(Self { thread_length_m: sqrt(thread_squared), turns: sqrt(turns_pi_squared) / PI })
    }
}

/// Sine and cosine of an angle in the first octant and a little more (0 to 1 rad), to f32 accuracy.
fn sin_cos(angle_rad: f32) -> (f32, f32) {
    let x2 = angle_rad * angle_rad;
    let sin =
        angle_rad * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0))));
    let cos = 1.0
        - x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0))));
    (sin, cos)
}

/// A muscle: braid, bladder and fittings.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Muscle {
    /// The braid's coefficients.
    pub braid: Braid,
    /// Length at rest, also the longest length: the load rests on a stop there \[m\].
    pub rest_length_m: f32,
    /// Stiffness of the bladder against contraction \[N/m\].
    pub bladder_stiffness_n_m: f32,
    /// Force of the bladder once it saturates, K1 \[N\].
    pub bladder_saturation_n: f32,
    /// Strain over which the bladder saturates, e1 \[-\].
    pub bladder_strain: f32,
    /// Part of the length that is not braid, d0 \[m\].
    pub slack_m: f32,
    /// Volume of the end fittings and of the tube, not swept by the braid \[m3\].
    pub dead_volume_m3: f32,
}

impl Muscle {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let b = self.braid.thread_length_m;
        within("muscle.thread_length_m", b, 0.01, 10.0)?;
        within("muscle.turns", self.braid.turns, 0.1, 1000.0)?;
        within("muscle.rest_length_m", self.rest_length_m, 0.578 * b, 0.999 * b)?;
        within("muscle.bladder_stiffness_n_m", self.bladder_stiffness_n_m, 0.0, 1.0e6)?;
        within("muscle.bladder_saturation_n", self.bladder_saturation_n, 0.0, 1.0e6)?;
        within("muscle.bladder_strain", self.bladder_strain, 1.0e-3, 1.0)?;
        let rest = self.rest_length_m;
        within("muscle.slack_m", self.slack_m, rest - 0.999 * b, rest - 0.578 * b)?;
        within("muscle.dead_volume_m3", self.dead_volume_m3, 0.0, 0.1)
    }
}

/// A muscle with the constants of its geometry computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    muscle: Muscle,
    /// b^2 \[m2\].
    thread_squared_m2: f32,
    /// 1/(4 pi n^2).
    per_4_pi_n2: f32,
    /// 1/(e1 L_0) \[1/m\].
    per_strain_m: f32,
    /// Shortest length that the equations cover: the force vanishes there, 3 l^2 = b^2 \[m\].
    shortest_m: f32,
}

impl From<Muscle> for Geometry {
    fn from(muscle: Muscle) -> Self {
        let b = muscle.braid.thread_length_m;
        let n = muscle.braid.turns;
        Self {
            muscle,
            thread_squared_m2: b * b,
            per_4_pi_n2: 1.0 / (4.0 * PI * n * n),
            per_strain_m: 1.0 / (muscle.bladder_strain * muscle.rest_length_m),
            shortest_m: b * 0.577_350_26 + muscle.slack_m,
        }
    }
}

impl Geometry {
    /// Diameter \[m\], Fig. 1: D = b sin(theta)/(n pi) = sqrt(b^2 - l^2)/(n pi).
    pub fn diameter_m(&self, length_m: f32) -> f32 {
        let braid_m = self.braid_m(length_m);
        sqrt(self.thread_squared_m2 - braid_m * braid_m) / (PI * self.muscle.braid.turns)
    }

    /// Length of the braid \[m\].
    fn braid_m(&self, length_m: f32) -> f32 {
        length_m - self.muscle.slack_m
    }

    /// Force of the bladder against shortening at a braid length \[N\], and its slope over the contraction \[N/m\].
    fn bladder(&self, braid_m: f32) -> (f32, f32) {
        let Muscle { bladder_stiffness_n_m, bladder_saturation_n, .. } = self.muscle;
        let way_m = self.muscle.rest_length_m - braid_m;
        let linear_n = bladder_stiffness_n_m * way_m;
        if !(bladder_saturation_n > 0.0) {
            return (linear_n, bladder_stiffness_n_m);
        }
        let strains = way_m * self.per_strain_m;
        let initial_n_m = bladder_saturation_n * self.per_strain_m;
        if strains <= 0.0 {
            let stiffness_n_m = bladder_stiffness_n_m + initial_n_m;
            return (stiffness_n_m * way_m, stiffness_n_m);
        }
        let left = exp(-strains);
        let saturating_n = bladder_saturation_n * (1.0 - left);
        (linear_n + saturating_n, bladder_stiffness_n_m + initial_n_m * left)
    }

    /// Braid length \[m\] at a force \[N\] with only a linear bladder of this stiffness \[N/m\]: the positive root of 3
    /// c P_g l^2 + k l - (c P_g b^2 + k L_0 + F) = 0, c = 1/(4 pi n^2), written without cancellation.
    fn braid_of_linear(
        &self,
        stiffness_n_m: f32,
        gauge_pressure_pa: f32,
        force_n: f32,
    ) -> Option<f32> {
        let pressure_term = self.per_4_pi_n2 * gauge_pressure_pa;
        let constant = pressure_term * self.thread_squared_m2
            + stiffness_n_m * self.muscle.rest_length_m
            + force_n;
        let discriminant = stiffness_n_m * stiffness_n_m + 12.0 * pressure_term * constant;
        let denominator = stiffness_n_m + sqrt(discriminant);
        (denominator > 0.0).then(|| 2.0 * constant / denominator)
    }

    /// Braid length with the saturating part of the bladder: see the module.
    fn braid_of_saturating(&self, gauge_pressure_pa: f32, force_n: f32) -> Option<f32> {
        let Muscle { bladder_stiffness_n_m, bladder_saturation_n, rest_length_m, .. } = self.muscle;
        let gauge_pressure_pa = limit(gauge_pressure_pa, 0.0, f32::MAX);
        let initial_n_m = bladder_saturation_n * self.per_strain_m;
        let stiffest_n_m = bladder_stiffness_n_m + initial_n_m;
        let mut braid_m = self.braid_of_linear(stiffest_n_m, gauge_pressure_pa, force_n)?;
        if !(braid_m < rest_length_m) {
            return Some(braid_m);
        }
        let held_n = force_n + bladder_saturation_n;
        if let Some(full_m) = self.braid_of_linear(bladder_stiffness_n_m, gauge_pressure_pa, held_n)
            && full_m < braid_m
        {
            braid_m = full_m;
        }
        let pressure_term = self.per_4_pi_n2 * gauge_pressure_pa;
        for _ in 0..STEPS {
            let (bladder_n, bladder_n_m) = self.bladder(braid_m);
            let gas_n = pressure_term * (3.0 * braid_m * braid_m - self.thread_squared_m2);
            let slope_n_m = 6.0 * pressure_term * braid_m + bladder_n_m;
            if !(slope_n_m > 0.0) {
                break;
            }
            braid_m -= (gas_n - bladder_n - force_n) / slope_n_m;
        }
        Some(braid_m)
    }
}

impl Chamber for Geometry {
    fn rest_length_m(&self) -> f32 {
        self.muscle.rest_length_m
    }

    /// Braid length b/sqrt(3), where the force vanishes at any pressure.
    fn shortest_m(&self) -> f32 {
        self.shortest_m
    }

    fn longest_m(&self) -> f32 {
        self.muscle.rest_length_m
    }

    /// Eq. (10) plus the dead volume: V = l (b^2 - l^2)/(4 pi n^2) + V_dead.
    fn volume_m3(&self, length_m: f32) -> f32 {
        let braid_m = self.braid_m(length_m);
        braid_m * (self.thread_squared_m2 - braid_m * braid_m) * self.per_4_pi_n2
            + self.muscle.dead_volume_m3
    }

    /// From eq. (11): (b^2 - 3 l^2)/(4 pi n^2); negative while the muscle can pull.
    fn volume_slope_m2(&self, length_m: f32) -> f32 {
        let braid_m = self.braid_m(length_m);
        (self.thread_squared_m2 - 3.0 * braid_m * braid_m) * self.per_4_pi_n2
    }

    /// Surface of the braided length: pi D l.
    fn surface_m2(&self, length_m: f32) -> f32 {
        PI * self.diameter_m(length_m) * self.braid_m(length_m)
    }

    /// -P_g dV/dL (Chou and Hannaford) less the bladder's force towards the rest length. Below zero the muscle is
    /// slack: it cannot push.
    fn force_n(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        -gauge_pressure_pa * self.volume_slope_m2(length_m) - self.bladder(self.braid_m(length_m)).0
    }

    fn least_force_n(&self) -> f32 {
        0.0
    }

    /// 6 l P_g/(4 pi n^2) and the bladder.
    fn stiffness_n_m(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        let braid_m = self.braid_m(length_m);
        6.0 * braid_m * gauge_pressure_pa * self.per_4_pi_n2 + self.bladder(braid_m).1
    }

    /// Computes the bladder only once.
    fn springs(&self, length_m: f32) -> Springs {
        let braid_m = self.braid_m(length_m);
        let (held_n, stiffness_n_m) = self.bladder(braid_m);
        let stiffness_m = 6.0 * braid_m * self.per_4_pi_n2;
        Springs { force_n: -held_n, stiffness_n_m, stiffness_m }
    }

    fn gauge_pressure_for_force_pa(&self, force_n: f32, length_m: f32) -> f32 {
        let slope = -self.volume_slope_m2(length_m);
        if !(slope > 1.0e-9) {
            return 0.0;
        }
        (force_n + self.bladder(self.braid_m(length_m)).0) / slope
    }

    fn length_for_force_m(&self, gauge_pressure_pa: f32, force_n: f32) -> f32 {
        let Muscle { bladder_stiffness_n_m, bladder_saturation_n, slack_m, .. } = self.muscle;
        let braid_m = if bladder_saturation_n > 0.0 {
            self.braid_of_saturating(gauge_pressure_pa, force_n)
        } else {
            self.braid_of_linear(bladder_stiffness_n_m, gauge_pressure_pa, force_n)
        };
        braid_m.map_or(self.muscle.rest_length_m, |braid_m| self.limit_length_m(braid_m + slack_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn muscle() -> Geometry {
        Geometry::from(Muscle {
            braid: Braid::from_rest(0.3, 0.02, 23.0).unwrap(),
            rest_length_m: 0.3,
            bladder_stiffness_n_m: 600.0,
            bladder_saturation_n: 0.0,
            bladder_strain: 0.02,
            slack_m: 0.0,
            dead_volume_m3: 5.0e-6,
        })
    }

    /// A muscle like the measured ones: 28 mm, 32 deg, its bladder saturated after 1.3 %.
    fn measured() -> Geometry {
        Geometry::from(Muscle {
            braid: Braid::from_rest(0.296, 0.028_57, 31.84).unwrap(),
            rest_length_m: 0.296,
            bladder_stiffness_n_m: 0.0,
            bladder_saturation_n: 302.4,
            bladder_strain: 0.0126,
            slack_m: 1.75e-3,
            dead_volume_m3: 0.0,
        })
    }

    /// Readings of a DMSP-20-300 (Martens and Boblan 2017, Appendix A).
    #[test]
    fn it_pulls_as_a_measured_muscle_does() {
        let muscle = measured();
        for (gauge_pa, length_m, force_n) in [
            (675_000.0, 0.296, 1653.5),
            (675_000.0, 0.267, 840.7),
            (675_000.0, 0.237, 253.3),
            (312_500.0, 0.282, 380.4),
            (135_000.0, 0.296, 241.8),
        ] {
            let found_n = muscle.force_n(gauge_pa, length_m);
            assert!((found_n - force_n).abs() < 20.0, "{found_n} N for {force_n} N");
        }
        assert!(muscle.force_n(35_000.0, 0.25) < 0.0, "slack");
        let full_n = -muscle.force_n(0.0, 0.23);
        assert!((full_n / 302.4 - 1.0).abs() < 1e-4, "{full_n} N");
    }

    #[test]
    fn a_slack_beyond_the_braid_is_refused() {
        let field = |slack_m: f32| {
            let configured = Muscle { slack_m, ..measured().muscle };
            configured.check().map_err(|error| error.field)
        };
        for slack_m in [-0.005, 0.0, 0.002, 0.05] {
            assert_eq!(field(slack_m), Ok(()), "{slack_m} m");
        }
        for slack_m in [-0.06, 0.1, f32::NAN] {
            assert_eq!(field(slack_m), Err("muscle.slack_m"), "{slack_m} m");
        }
    }

    #[test]
    fn rest_geometry_comes_back() {
        let geometry = muscle();
        assert!((geometry.diameter_m(0.3) / 0.02 - 1.0).abs() < 1e-5);
        // A cylinder of 20 mm by 300 mm, and the dead volume.
        let cylinder = core::f64::consts::PI / 4.0 * 0.02 * 0.02 * 0.3 + 5.0e-6;
        assert!((f64::from(geometry.volume_m3(0.3)) / cylinder - 1.0).abs() < 1e-5);
        assert!(geometry.force_n(3.0e5, geometry.shortest_m()) < 0.0, "bladder pulls back");
    }

    #[test]
    fn pairs_with_noise_give_the_braid_back() {
        let braid = Braid::from_rest(0.3, 0.02, 23.0).unwrap();
        let geometry = muscle();
        let mut pairs = [(0.0, 0.0); 6];
        for (i, pair) in pairs.iter_mut().enumerate() {
            let length = 0.3 - 0.015 * i as f32;
            let wobble = if i % 2 == 0 { 1.002 } else { 0.998 };
            *pair = (length, geometry.diameter_m(length) * wobble);
        }
        let fitted = Braid::from_pairs(&pairs).unwrap();
        assert!((fitted.thread_length_m / braid.thread_length_m - 1.0).abs() < 2e-3);
        assert!((fitted.turns / braid.turns - 1.0).abs() < 1e-2);
    }

    #[test]
    fn bad_braids_are_refused() {
        assert_eq!(
            Braid::from_rest(-0.3, 0.02, 23.0),
            Err(BraidError::NotPositive { value_m: -0.3 })
        );
        assert!(matches!(
            Braid::from_rest(0.3, f32::NAN, 23.0),
            Err(BraidError::NotPositive { .. })
        ));
        assert_eq!(
            Braid::from_rest(0.3, 0.02, 60.0),
            Err(BraidError::AngleOutOfRange { angle_deg: 60.0 })
        );
        assert_eq!(Braid::from_pairs(&[(0.3, 0.02)]), Err(BraidError::TooFewPairs));
        assert_eq!(Braid::from_pairs(&[(0.3, 0.02), (0.29, 0.02)]), Err(BraidError::TooFewPairs));
        assert_eq!(Braid::from_pairs(&[(0.3, 0.03), (0.25, 0.02)]), Err(BraidError::NotABraid));
    }

    proptest! {
        /// The volume's slope against numerical differentiation in f64 of eq. (10).
        #[test]
        fn slope_is_the_derivative(length in 0.19_f32..0.3) {
            let geometry = muscle();
            let b2 = f64::from(geometry.thread_squared_m2);
            let volume = |l: f64| l * (b2 - l * l) * f64::from(geometry.per_4_pi_n2);
            let h = 1e-5;
            let l = f64::from(length);
            let numeric = (volume(l + h) - volume(l - h)) / (2.0 * h);
            prop_assert!((f64::from(geometry.volume_slope_m2(length)) - numeric).abs() < 1e-8);
        }

        #[test]
        fn length_and_pressure_invert_the_force(
            gauge in 1.0e4_f32..6.0e5, length in 0.2_f32..0.3
        ) {
            let geometry = muscle();
            let force = geometry.force_n(gauge, length);
            let back = geometry.length_for_force_m(gauge, force);
            prop_assert!((back - length).abs() < 1e-5, "{back} for {length}");
            let pressure = geometry.gauge_pressure_for_force_pa(force, length);
            prop_assert!((pressure / gauge - 1.0).abs() < 1e-3);
        }

        /// For any bladder: from nearly linear to one that saturates at once.
        #[test]
        fn length_and_pressure_invert_a_force_that_fills(
            gauge_pa in 0.0_f32..8.0e5, contraction in 0.0_f32..0.25, saturation_n in 1.0_f32..2.0e3,
            strain in 1.0e-3_f32..1.0, stiffness_n_m in 0.0_f32..2.0e3, slack in -0.01_f32..0.02,
        ) {
            let configured = Muscle {
                bladder_stiffness_n_m: stiffness_n_m,
                bladder_saturation_n: saturation_n,
                bladder_strain: strain,
                slack_m: slack * 0.296,
                ..measured().muscle
            };
            let muscle = Geometry::from(configured);
            let length_m = 0.296 * (1.0 - contraction);
            let force_n = muscle.force_n(gauge_pa, length_m);
            let back_n = muscle.force_n(gauge_pa, muscle.length_for_force_m(gauge_pa, force_n));
            prop_assert!((back_n - force_n).abs() < 0.1 + 1e-3 * force_n.abs(), "{back_n} for {force_n}");
            let back_pa = muscle.gauge_pressure_for_force_pa(force_n, length_m);
            prop_assert!((back_pa - gauge_pa).abs() < 1.0 + 1e-3 * gauge_pa, "{back_pa} for {gauge_pa}");
        }

        /// The stiffness is the slope of the force, in f64 by differences.
        #[test]
        fn stiffness_is_the_slope(gauge_pa in 0.0_f32..8.0e5, length_m in 0.22_f32..0.29) {
            let muscle = measured();
            let h = 1.0e-3_f32;
            let [above, below] = [h, -h].map(|by| f64::from(muscle.force_n(gauge_pa, length_m + by)));
            let numeric = (above - below) / (2.0 * f64::from(h));
            let slope = f64::from(muscle.stiffness_n_m(gauge_pa, length_m));
            prop_assert!((slope / numeric - 1.0).abs() < 2e-2, "{slope} {numeric}");
        }
    }
}
