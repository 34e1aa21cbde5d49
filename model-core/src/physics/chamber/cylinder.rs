//! A single-acting cylinder: one piston, gas on one side of it, a spring on the other.

use super::Chamber;
use crate::math::sqrt;
use crate::parameter::parameters;
use core::f32::consts::PI;

parameters! {
    /// A single-acting cylinder, from the rest length, where its gas volume is smallest, to the end of its stroke.
    "cylinder": Cylinder {
        rest_length_m: 0.25, "m", 0.001 to 10.0, "length at rest, between what holds its ends";
        stroke_m: -0.1, "m", -10.0 to 10.0, "way of the piston; positive where pressure shortens the cylinder";
        area_m2: 1.25e-3, "m2", 1.0e-7 to 10.0, "area of the piston under pressure";
        dead_volume_m3: 2.0e-5, "m3", 1.0e-9 to 0.1, "gas volume at rest";
        spring_n: 50.0, "N", 0.0 to 1.0e6, "force of the return spring at rest";
        spring_stiffness_n_m: 500.0, "N/m", 0.0 to 1.0e6, "stiffness of the return spring";
    }
}

/// A cylinder with its constants computed once. Way, area and spring have the sign of the stroke: a pushing cylinder is
/// a mirrored pulling one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piston {
    configured: Cylinder,
    /// -dV/dL \[m2\].
    pull_area_m2: f32,
    per_pull_area: f32,
    spring_n: f32,
    /// Circumference of the bore over its area \[1/m\].
    per_hydraulic_m: f32,
}

impl From<Cylinder> for Piston {
    fn from(configured: Cylinder) -> Self {
        let sign = if configured.stroke_m < 0.0 { -1.0 } else { 1.0 };
        let pull_area_m2 = sign * configured.area_m2;
        Self {
            configured,
            pull_area_m2,
            per_pull_area: 1.0 / pull_area_m2,
            spring_n: sign * configured.spring_n,
            per_hydraulic_m: 2.0 * sqrt(PI / configured.area_m2),
        }
    }
}

impl Piston {
    /// Way from rest, positive into contraction \[m\].
    fn way_m(&self, length_m: f32) -> f32 {
        self.configured.rest_length_m - length_m
    }

    fn end_m(&self) -> f32 {
        self.configured.rest_length_m - self.configured.stroke_m
    }
}

impl Chamber for Piston {
    fn rest_length_m(&self) -> f32 {
        self.configured.rest_length_m
    }

    fn shortest_m(&self) -> f32 {
        if self.configured.stroke_m < 0.0 { self.configured.rest_length_m } else { self.end_m() }
    }

    fn longest_m(&self) -> f32 {
        if self.configured.stroke_m < 0.0 { self.end_m() } else { self.configured.rest_length_m }
    }

    /// V = V_dead + A way.
    fn volume_m3(&self, length_m: f32) -> f32 {
        self.configured.dead_volume_m3 + self.pull_area_m2 * self.way_m(length_m)
    }

    fn volume_slope_m2(&self, _length_m: f32) -> f32 {
        -self.pull_area_m2
    }

    /// Bore, piston and head; the dead volume counts as a piece of the bore.
    fn surface_m2(&self, length_m: f32) -> f32 {
        self.per_hydraulic_m * self.volume_m3(length_m) + 2.0 * self.configured.area_m2
    }

    /// P_g A less the spring.
    fn force_n(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        gauge_pressure_pa * self.pull_area_m2
            - self.spring_n
            - self.configured.spring_stiffness_n_m * self.way_m(length_m)
    }

    fn stiffness_n_m(&self, _gauge_pressure_pa: f32, _length_m: f32) -> f32 {
        self.configured.spring_stiffness_n_m
    }

    /// Without a spring stiffness, one end or the other.
    fn length_for_force_m(&self, gauge_pressure_pa: f32, force_n: f32) -> f32 {
        let excess_n = gauge_pressure_pa * self.pull_area_m2 - self.spring_n - force_n;
        let way_m = excess_n / self.configured.spring_stiffness_n_m;
        self.limit_length_m(self.configured.rest_length_m - way_m)
    }

    fn gauge_pressure_for_force_pa(&self, force_n: f32, length_m: f32) -> f32 {
        let spring_n = self.spring_n + self.configured.spring_stiffness_n_m * self.way_m(length_m);
        (force_n + spring_n) * self.per_pull_area
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn both() -> [Piston; 2] {
        let pushes = Cylinder::default();
        let pulls = Cylinder { rest_length_m: 0.35, stroke_m: 0.1, ..pushes };
        [pushes.into(), pulls.into()]
    }

    #[test]
    fn volume_is_dead_volume_and_area_times_stroke() {
        for (cylinder, middle_m) in both().into_iter().zip([0.3, 0.3]) {
            assert!((cylinder.shortest_m() - 0.25).abs() < 1e-6, "{cylinder:?}");
            assert!((cylinder.longest_m() - 0.35).abs() < 1e-6, "{cylinder:?}");
            let volumes = [cylinder.rest_length_m(), middle_m, cylinder.end_m()]
                .map(|length_m| cylinder.volume_m3(length_m));
            for (volume_m3, expected_m3) in volumes.into_iter().zip([20.0e-6, 82.5e-6, 145.0e-6]) {
                assert!((volume_m3 / expected_m3 - 1.0).abs() < 1e-5, "{volume_m3} m3");
            }
            // 39.89 mm bore: 125.33 mm around, filled over 66 mm, and both ends.
            let surface_m2 = cylinder.surface_m2(middle_m);
            assert!((surface_m2 / (0.125_331 * 0.066 + 2.5e-3) - 1.0).abs() < 1e-4, "{surface_m2}");
        }
    }

    /// 3 bar on 12.5 cm2 are 375 N; 50 mm from rest the spring takes 75 N of them.
    #[test]
    fn one_pushes_and_the_other_pulls() {
        for (cylinder, sign) in both().into_iter().zip([-1.0, 1.0]) {
            let force_n = cylinder.force_n(3.0e5, 0.3);
            assert!((force_n - sign * 300.0).abs() < 1e-3, "{force_n} N");
            assert!(sign * cylinder.volume_slope_m2(0.3) < 0.0);
        }
    }

    #[test]
    fn without_a_spring_it_lies_at_one_end_or_the_other() {
        let configured =
            Cylinder { spring_n: 0.0, spring_stiffness_n_m: 0.0, ..Cylinder::default() };
        let cylinder = Piston::from(configured);
        assert_eq!(cylinder.length_for_force_m(3.0e5, -374.0), cylinder.longest_m());
        assert_eq!(cylinder.length_for_force_m(3.0e5, -376.0), cylinder.shortest_m());
    }

    proptest! {
        #[test]
        fn length_and_pressure_invert_the_force(
            gauge_pa in 0.0_f32..6.0e5, length_m in 0.25_f32..0.35, second in any::<bool>()
        ) {
            let cylinder = both()[usize::from(second)];
            let force_n = cylinder.force_n(gauge_pa, length_m);
            let back_m = cylinder.length_for_force_m(gauge_pa, force_n);
            prop_assert!((back_m - length_m).abs() < 1e-6, "{back_m} for {length_m}");
            let back_pa = cylinder.gauge_pressure_for_force_pa(force_n, length_m);
            prop_assert!((back_pa - gauge_pa).abs() < 1.0, "{back_pa} for {gauge_pa}");
        }
    }
}
