//! Friction of the moving parts, and the heat that it makes.

use crate::math::{exp, limit};
use crate::parameter::parameters;

/// Largest factor by which a wall may increase friction over its value at the reference temperature \[-\].
const STIFFEST: f32 = 1.0e3;

/// Gauge pressure at which the configured friction and slip apply \[Pa\].
const CONFIGURED_AT_PA: f32 = 4.0e5;

/// Factor on a force, `share` of which follows gauge pressure \[-\].
pub(super) fn at_pressure(share: f32, gauge_pressure_pa: f32) -> f32 {
    let above = gauge_pressure_pa * (1.0 / CONFIGURED_AT_PA) - 1.0;
    limit(1.0 + share * above, 0.0, f32::MAX)
}

parameters! {
    /// Coulomb friction of braid and bladder; it softens as the wall warms.
    "friction": Friction {
        force_n: 15.0, "N", 0.0 to 1.0e5, "Coulomb friction at the reference temperature";
        reference_temperature_k: 298.0, "K", 100.0 to 1000.0, "reference temperature";
        softening_per_k: 0.01, "1/K", -0.2 to 0.2, "beta in F = F_ref exp(-beta (T_wall - T_ref))";
        pressure_factor: 0.0, "", 0.0 to 2.0, "share f of it that follows gauge pressure, as a seal's: factor 1 + f (P/4 bar - 1), no less than 0";
        heat_fraction: 0.9, "", 0.0 to 1.0, "share of the friction heat that the wall gets";
        presliding_stiffness_n_m: 1.0e5, "N/m", 0.0 to 1.0e9, "stiffness with which it builds up after a turn";
        viscous_n_s_m: 0.0, "N s/m", 0.0 to 1.0e6, "viscous part beside it";
    }
}

impl Friction {
    /// Friction force \[N\] at a wall temperature: F_ref exp(-beta (T_w - T_ref)). The exponential and
    /// its 1 %/K are assumptions: no published measurement of a muscle was found.
    pub fn force_n(&self, wall_temperature_k: f32) -> f32 {
        self.force_n * self.softening(wall_temperature_k)
    }

    /// Factor of a gauge pressure on the Coulomb friction \[-\], 1 at 4 bar.
    pub fn at_pressure(&self, gauge_pressure_pa: f32) -> f32 {
        at_pressure(self.pressure_factor, gauge_pressure_pa)
    }

    /// Factor of a wall temperature on every part of friction \[-\]: exp(-beta (T_w - T_ref)), at most 1000.
    pub fn softening(&self, wall_temperature_k: f32) -> f32 {
        let warmer_k = wall_temperature_k - self.reference_temperature_k;
        limit(exp(-self.softening_per_k * warmer_k), 0.0, STIFFEST)
    }

    /// Friction heat that goes into the wall \[W\]: a share of |F dL/dt|.
    pub fn wall_heat_w(&self, wall_temperature_k: f32, speed_m_s: f32) -> f32 {
        let power = self.force_n(wall_temperature_k) * speed_m_s;
        self.heat_fraction * if power < 0.0 { -power } else { power }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A configuration mistake that gives e^140 still leaves a number.
    #[test]
    fn no_wall_stiffens_friction_without_end() {
        let friction = Friction { softening_per_k: -0.2, ..crate::Config::default().friction };
        assert_eq!(friction.softening(1000.0), STIFFEST);
        assert_eq!(friction.force_n(1000.0), STIFFEST * friction.force_n);
    }

    /// An O-ring of 25.7 mm (`docs/background/validation.md`): 4.7 N at 1 bar, 7.9 N at 7 bar.
    #[test]
    fn the_friction_of_a_seal_grows_with_pressure() {
        let seal =
            Friction { force_n: 6.3, pressure_factor: 0.34, ..crate::Config::default().friction };
        for (gauge_pa, expected_n) in [(1.0e5, 4.7), (4.0e5, 6.3), (7.0e5, 7.9)] {
            let force_n = seal.force_n * seal.at_pressure(gauge_pa);
            assert!((force_n - expected_n).abs() < 0.1, "{force_n} N at {gauge_pa} Pa");
        }
        assert_eq!(Friction { pressure_factor: 2.0, ..seal }.at_pressure(1.0e5), 0.0);
    }

    proptest! {
        #[test]
        fn friction_softens_and_heats(t in 270.0_f32..330.0, speed in -1.0_f32..1.0) {
            let friction = Friction {
                force_n: 15.0, reference_temperature_k: 298.0, softening_per_k: 0.01,
                        heat_fraction: 0.9, ..crate::Config::default().friction
            };
            let expected = 15.0 * (-0.01 * (f64::from(t) - 298.0)).exp();
            prop_assert!((f64::from(friction.force_n(t)) / expected - 1.0).abs() < 1e-5);
            prop_assert!(friction.wall_heat_w(t, speed) >= 0.0);
        }
    }
}
