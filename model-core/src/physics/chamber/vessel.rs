//! A vessel: gas at a constant volume, or at a volume that something else sets.

use super::Chamber;
use crate::parameter::parameters;

parameters! {
    /// A vessel of constant section; its length is its volume over the section. No load acts on it.
    "vessel": Vessel {
        section_m2: 0.008, "m2", 1.0e-7 to 1.0e5, "section";
        surface_m2: 0.06, "m2", 0.0 to 1.0e3, "inner surface";
    }
}

impl Chamber for Vessel {
    fn moves(&self) -> bool {
        false
    }

    /// Arbitrary: a vessel has no rest length.
    fn rest_length_m(&self) -> f32 {
        1.0
    }

    fn shortest_m(&self) -> f32 {
        1.0e-6
    }

    fn longest_m(&self) -> f32 {
        1.0e6
    }

    /// Any length that its sensor reads.
    fn can_have_length_m(&self, _length_m: f32) -> bool {
        true
    }

    fn volume_m3(&self, length_m: f32) -> f32 {
        self.section_m2 * length_m
    }

    fn volume_slope_m2(&self, _length_m: f32) -> f32 {
        self.section_m2
    }

    fn surface_m2(&self, _length_m: f32) -> f32 {
        self.surface_m2
    }

    /// Force on a lid of its section.
    fn force_n(&self, gauge_pressure_pa: f32, _length_m: f32) -> f32 {
        -gauge_pressure_pa * self.section_m2
    }

    fn stiffness_n_m(&self, _gauge_pressure_pa: f32, _length_m: f32) -> f32 {
        0.0
    }

    fn length_for_force_m(&self, _gauge_pressure_pa: f32, _force_n: f32) -> f32 {
        self.rest_length_m()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vessel_can_have_any_length() {
        let vessel = Vessel { section_m2: 0.01, surface_m2: 0.1 };
        assert!([-1.0, 0.0, 1.0e9].into_iter().all(|length_m| vessel.can_have_length_m(length_m)));
        assert_eq!(vessel.limit_length_m(-1.0), 1.0e-6);
    }
}
