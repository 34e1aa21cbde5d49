//! A single-acting pneumatic cylinder: gas on one side of the piston, a spring and the surroundings on
//! the other.

use super::{Chamber, Tunable};
use model_core::physics::chamber::{self as configured, ChamberConfig};
use std::f64::consts::PI;
use thermyo_scenario::{Acts, Cylinder};

/// Piston, bore and spring; the piston's travel counts from the smallest gas volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piston {
    /// dL per travel: 1 if it lengthens, -1 if it shortens \[-\].
    per_way: f64,
    rest_length_m: f64,
    stroke_m: f64,
    area_m2: f64,
    dead_volume_m3: f64,
    spring_n: f64,
    spring_n_m: f64,
    bore_m: f64,
    zones: usize,
}

impl Piston {
    pub fn of(cylinder: &Cylinder) -> Self {
        Self {
            per_way: match cylinder.acts {
                Acts::Push => 1.0,
                Acts::Pull => -1.0,
            },
            rest_length_m: cylinder.rest_length_m,
            stroke_m: cylinder.stroke_m,
            area_m2: cylinder.area_m2,
            dead_volume_m3: cylinder.dead_volume_m3,
            spring_n: cylinder.spring_n,
            spring_n_m: cylinder.spring_stiffness_n_m,
            bore_m: (4.0 * cylinder.area_m2 / PI).sqrt(),
            zones: cylinder.zones,
        }
    }

    fn way(&self, length: f64) -> f64 {
        (length - self.rest_length_m) * self.per_way
    }
}

impl Chamber for Piston {
    fn rest_length(&self) -> f64 {
        self.rest_length_m
    }

    fn lengths(&self) -> [f64; 2] {
        self.stops()
    }

    fn range(&self) -> [f64; 2] {
        self.stops()
    }

    fn stops(&self) -> [f64; 2] {
        let end = self.rest_length_m + self.per_way * self.stroke_m;
        [end.min(self.rest_length_m), end.max(self.rest_length_m)]
    }

    fn volume(&self, length: f64) -> f64 {
        self.dead_volume_m3 + self.area_m2 * self.way(length)
    }

    fn force_area(&self, _length: f64) -> f64 {
        -self.per_way * self.area_m2
    }

    fn force_area_slope(&self, _length: f64) -> f64 {
        0.0
    }

    /// The spring acts against the travel.
    fn elastic(&self, length: f64) -> f64 {
        self.per_way * (self.spring_n + self.spring_n_m * self.way(length))
    }

    fn elastic_slope(&self, _length: f64) -> f64 {
        self.spring_n_m
    }

    /// The gas is a column in the bore, with two ends.
    fn surface(&self, length: f64) -> f64 {
        PI * self.bore_m * self.gas_length(length) + 2.0 * self.area_m2
    }

    fn diameter(&self, _length: f64) -> f64 {
        self.bore_m
    }

    fn gas_length(&self, length: f64) -> f64 {
        self.volume(length) / self.area_m2
    }

    fn tunable(&self) -> Option<Tunable> {
        Some(Tunable {
            area: &[("cylinder.area_m2", 1.0)],
            stiffness: "cylinder.spring_stiffness_n_m",
        })
    }

    fn zones(&self) -> usize {
        self.zones
    }

    fn configured(&self, tube_m3: f64) -> ChamberConfig {
        ChamberConfig::Cylinder(configured::Cylinder {
            rest_length_m: self.rest_length_m as f32,
            stroke_m: (-self.per_way * self.stroke_m) as f32,
            area_m2: self.area_m2 as f32,
            dead_volume_m3: (self.dead_volume_m3 + tube_m3) as f32,
            spring_n: self.spring_n as f32,
            spring_stiffness_n_m: self.spring_n_m as f32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_is_virtual_work_and_the_spring() {
        for (acts, sign) in [(Acts::Push, -1.0), (Acts::Pull, 1.0)] {
            let cylinder = Piston::of(&Cylinder { acts, ..Cylinder::default() });
            let [shortest, longest] = cylinder.stops();
            let middle = 0.5 * (shortest + longest);
            let h = 0.01;
            let slope = (cylinder.volume(middle + h) - cylinder.volume(middle - h)) / (2.0 * h);
            assert!((-slope / cylinder.force_area(middle) - 1.0).abs() < 1e-12, "{acts:?}");
            assert_eq!(cylinder.direction(), sign);
            // 50 N, and 500 N/m over 50 mm.
            assert!((cylinder.elastic(middle) + sign * 75.0).abs() < 1e-12, "{acts:?}");
            assert!((cylinder.volume(middle) - 82.5e-6).abs() < 1e-18, "{acts:?}");
        }
    }
}
