//! Geometry of the braid, eq. (10), (11), and the force that follows from it.

use super::{Chamber, Tunable};
use thermyo_compute::math;

use model_core::physics::chamber::{self as configured, ChamberConfig};
use std::f64::consts::PI;

/// A braid of inextensible threads around a cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    pub thread_length_m: f64,
    /// Thread turns n \[-\].
    pub turns: f64,
    /// Volume of the end fittings \[m3\].
    pub dead_volume_m3: f64,
    /// b^2.
    thread_squared: f64,
    /// 1/(4 pi n^2).
    per_turns: f64,
}

impl Geometry {
    /// Braid of thread length b \[m\], turns n and dead volume \[m3\].
    pub fn new(thread_length_m: f64, turns: f64, dead_volume_m3: f64) -> Self {
        Self {
            thread_length_m,
            turns,
            dead_volume_m3,
            thread_squared: thread_length_m * thread_length_m,
            per_turns: 1.0 / (4.0 * PI * turns * turns),
        }
    }

    /// Braid of length \[m\], diameter \[m\] and braid angle to the axis \[deg\] at rest (paper, Fig. 1).
    pub fn from_braid(length_m: f64, diameter_m: f64, angle_deg: f64, dead_volume_m3: f64) -> Self {
        let angle = angle_deg.to_radians();
        let thread = length_m / math::cos(angle);
        Self::new(thread, thread * math::sin(angle) / (PI * diameter_m), dead_volume_m3)
    }

    /// Gas volume \[m3\], eq. (10) plus the dead volume.
    pub fn volume(&self, length: f64) -> f64 {
        length * (self.thread_squared - length * length) * self.per_turns + self.dead_volume_m3
    }

    /// Force per gauge pressure, -dV/dL, eq. (11) \[m2\]; positive: the muscle pulls.
    pub fn force_area(&self, length: f64) -> f64 {
        (3.0 * length * length - self.thread_squared) * self.per_turns
    }

    /// Slope of [`Self::force_area`] over length \[m\].
    pub fn force_area_slope(&self, length: f64) -> f64 {
        6.0 * length * self.per_turns
    }

    /// Lateral surface pi D L with D = sqrt(b^2 - L^2)/(n pi) \[m2\].
    pub fn surface(&self, length: f64) -> f64 {
        length * (self.thread_squared - length * length).sqrt() / self.turns
    }

    /// Diameter \[m\].
    pub fn diameter(&self, length: f64) -> f64 {
        (self.thread_squared - length * length).sqrt() / (self.turns * PI)
    }
}

/// A muscle: braid, bladder, and the stop on which its load rests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Muscle {
    braid: Geometry,
    rest_length_m: f64,
    bladder_n_m: f64,
    /// Force of the bladder once saturated \[N\], and the contraction of the braid over which it
    /// saturates \[m\].
    saturation_n: f64,
    filling_m: f64,
    /// Length without braid \[m\].
    slack_m: f64,
    zones: usize,
}

impl Muscle {
    pub fn of(muscle: &thermyo_scenario::Muscle) -> Self {
        Self {
            braid: Geometry::new(muscle.thread_length_m, muscle.turns, muscle.dead_volume_m3),
            rest_length_m: muscle.rest_length_m,
            bladder_n_m: muscle.bladder_stiffness_n_m,
            saturation_n: muscle.bladder_saturation_n,
            filling_m: muscle.bladder_strain * muscle.rest_length_m,
            slack_m: muscle.slack_m,
            zones: muscle.zones,
        }
    }

    /// Contraction of the braid over the contraction at which the bladder saturates \[-\].
    fn filled(&self, length: f64) -> f64 {
        (self.rest_length_m + self.slack_m - length) / self.filling_m
    }
}

impl Chamber for Muscle {
    fn rest_length(&self) -> f64 {
        self.rest_length_m
    }

    /// The force vanishes at b/sqrt(3).
    fn lengths(&self) -> [f64; 2] {
        [self.braid.thread_length_m / 3.0_f64.sqrt() + self.slack_m, self.rest_length_m]
    }

    fn range(&self) -> [f64; 2] {
        [self.slack_m, self.slack_m + self.braid.thread_length_m]
    }

    /// There is no inner stop: the force vanishes first.
    fn stops(&self) -> [f64; 2] {
        [f64::NEG_INFINITY, self.rest_length_m]
    }

    fn volume(&self, length: f64) -> f64 {
        self.braid.volume(length - self.slack_m)
    }

    fn force_area(&self, length: f64) -> f64 {
        self.braid.force_area(length - self.slack_m)
    }

    fn force_area_slope(&self, length: f64) -> f64 {
        self.braid.force_area_slope(length - self.slack_m)
    }

    /// A spring, and a rubber that saturates: the slope of the rubber's force falls with the force, dF/dx = (K1 -
    /// F)/filling.
    fn elastic(&self, length: f64) -> f64 {
        let spring = self.bladder_n_m * (length - self.slack_m - self.rest_length_m);
        // Skips the exponential for muscles without rubber; most have none.
        if self.saturation_n == 0.0 {
            return spring;
        }
        let filled = self.filled(length);
        let saturating = if filled > 0.0 { -math::expm1(-filled) } else { filled };
        spring - self.saturation_n * saturating
    }

    fn elastic_slope(&self, length: f64) -> f64 {
        if self.saturation_n == 0.0 {
            return self.bladder_n_m;
        }
        let left = math::exp(-self.filled(length).max(0.0));
        self.bladder_n_m + self.saturation_n / self.filling_m * left
    }

    fn surface(&self, length: f64) -> f64 {
        self.braid.surface(length - self.slack_m)
    }

    fn diameter(&self, length: f64) -> f64 {
        self.braid.diameter(length - self.slack_m)
    }

    /// Braid and bladder would buckle.
    fn pushes(&self) -> bool {
        false
    }

    /// A ~ 1/n^2.
    fn tunable(&self) -> Option<Tunable> {
        Some(Tunable {
            area: &[("muscle.turns", -0.5), ("muscle.diameter_m", 0.5)],
            stiffness: "muscle.bladder_stiffness_n_m",
        })
    }

    fn zones(&self) -> usize {
        self.zones
    }

    fn configured(&self, tube_m3: f64) -> ChamberConfig {
        ChamberConfig::Muscle(configured::Muscle {
            braid: configured::Braid {
                thread_length_m: self.braid.thread_length_m as f32,
                turns: self.braid.turns as f32,
            },
            rest_length_m: self.rest_length_m as f32,
            bladder_stiffness_n_m: self.bladder_n_m as f32,
            bladder_saturation_n: self.saturation_n as f32,
            bladder_strain: (self.filling_m / self.rest_length_m) as f32,
            slack_m: self.slack_m as f32,
            dead_volume_m3: (self.braid.dead_volume_m3 + tube_m3) as f32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_braid_returns_its_own_dimensions() {
        let braid = Geometry::from_braid(0.3, 0.02, 23.0, 0.0);
        assert!((braid.diameter(0.3) - 0.02).abs() < 1e-15);
        let cylinder = PI / 4.0 * 0.02 * 0.02 * 0.3;
        assert!((braid.volume(0.3) / cylinder - 1.0).abs() < 1e-12);
        assert!((braid.surface(0.3) / (PI * 0.02 * 0.3) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn force_is_virtual_work() {
        let braid = Geometry::from_braid(0.3, 0.02, 23.0, 5e-6);
        for length in [0.2, 0.22, 0.25, 0.28, 0.3] {
            // The volume is a cubic: the five-point difference is exact but for rounding.
            let h = 0.01;
            let v = |i: f64| braid.volume(length + i * h);
            let slope = (v(-2.0) - 8.0 * v(-1.0) + 8.0 * v(1.0) - v(2.0)) / (12.0 * h);
            assert!((-slope / braid.force_area(length) - 1.0).abs() < 1e-9, "at {length} m");
        }
    }
}
