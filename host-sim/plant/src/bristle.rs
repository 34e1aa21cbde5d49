//! Friction with presliding: the LuGre model.

use thermyo_compute::math;
use thermyo_scenario::Friction;

/// Damping ratio of the bristles with the moving mass, at which presliding motion rings out.
const BRISTLE_DAMPING_RATIO: f64 = 0.5;

/// Upper limit on the rate at which sliding bristles yield: still stable at 2.5e-4 s, the longest step of the plant. It
/// only slows the transition to steady sliding, and only for friction far below its stiffness: 15 N at 40 kN/m and 0.5
/// m/s yield at 1333 /s.
const FASTEST_SLIP_PER_S: f64 = 8e3;

/// LuGre friction (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automat. Contr. 40, 1995)
/// with Stribeck and viscous parts. Speeds and forces are positive in contraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristle {
    coulomb_n: f64,
    stribeck_n: f64,
    stribeck_m_s: f64,
    viscous_n_s_m: f64,
    stiffness_n_m: f64,
    damping_n_s_m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drag {
    /// Force against contraction \[N\].
    pub force: f64,
    /// Rate of the bristles' deflection \[m/s\].
    pub deflection_rate: f64,
    /// Heat: power of the force less the power that the bristles store \[W\].
    pub heat: f64,
}

impl Bristle {
    /// Friction of `[friction]`, for the moving mass \[kg\].
    pub fn new(friction: &Friction, mass_kg: f64) -> Self {
        let stiffness = friction.presliding_stiffness_n_m;
        Self {
            coulomb_n: friction.force_n,
            stribeck_n: friction.stribeck_force_n,
            stribeck_m_s: friction.stribeck_speed_m_s,
            viscous_n_s_m: friction.viscous_n_s_m,
            stiffness_n_m: stiffness,
            damping_n_s_m: 2.0 * BRISTLE_DAMPING_RATIO * (stiffness * mass_kg).sqrt(),
        }
    }

    /// Fastest rate of bristles and mass together \[1/s\], with the factor of the viscous part at
    /// the coldest wall.
    pub fn fastest_rate(&self, mass_kg: f64, softening: f64) -> f64 {
        (self.damping_n_s_m + softening * self.viscous_n_s_m) / mass_kg
            + (self.stiffness_n_m / mass_kg).sqrt()
    }

    /// Returns the friction at a speed \[m/s\] and deflection \[m\]. `softening` scales all parts; `pressed` scales
    /// Coulomb and Stribeck friction too.
    pub fn drag(&self, speed: f64, deflection: f64, softening: f64, pressed: f64) -> Drag {
        let ratio = speed / self.stribeck_m_s;
        // Beyond 6 Stribeck speeds the term is negligible.
        let still = if ratio.abs() > 6.5 { 0.0 } else { math::exp(-ratio * ratio) };
        let sliding = softening * pressed * (self.coulomb_n + self.stribeck_n * still);
        let spring = self.stiffness_n_m * deflection;
        // The authors' rate, v - stiffness |v| z / g, is a lag that ends at z = g / stiffness in
        // the direction of v. Without friction g is zero, and the bristles' force decays.
        let rate = if self.stiffness_n_m * speed.abs() < FASTEST_SLIP_PER_S * sliding {
            speed - speed.abs() * spring / sliding
        } else {
            let steady = sliding.copysign(speed) / self.stiffness_n_m.max(f64::MIN_POSITIVE);
            FASTEST_SLIP_PER_S * (steady - deflection)
        };
        // The bristles' damping fades as they slide (a remark of the same authors), which keeps the model passive.
        let damping = self.damping_n_s_m * still * rate;
        let viscous = softening * self.viscous_n_s_m * speed;
        let force = spring + damping + viscous;
        Drag { force, deflection_rate: rate, heat: force * speed - spring * rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ode::rk4;

    #[test]
    fn steady_sliding_is_stribeck_and_viscous() {
        let friction = Friction::default();
        let bristle = Bristle::new(&friction, 2.0);
        for speed in [-0.1, -0.004, 0.002, 0.05] {
            let mut deflection = 0.0;
            for _ in 0..2_000_000 {
                let drag = bristle.drag(speed, deflection, 0.8, 1.0);
                deflection += 1e-5 * drag.deflection_rate;
            }
            let drag = bristle.drag(speed, deflection, 0.8, 1.0);
            let r: f64 = speed / friction.stribeck_speed_m_s;
            let expected = 0.8
                * ((friction.force_n + friction.stribeck_force_n * math::exp(-r * r))
                    * speed.signum()
                    + friction.viscous_n_s_m * speed);
            assert!((drag.force / expected - 1.0).abs() < 1e-6, "at {speed} m/s: {drag:?}");
            assert!((drag.heat / (expected * speed) - 1.0).abs() < 1e-6);
        }
    }

    /// The bristles are stable at the plant's step even with little friction.
    #[test]
    fn hardly_any_friction_is_no_stiff_one() {
        for coulomb_n in [0.0, 1e-9, 0.01, 0.1, 1.0] {
            for presliding_stiffness_n_m in [4e4, 1e7] {
                let friction = Friction {
                    force_n: coulomb_n,
                    presliding_stiffness_n_m,
                    viscous_n_s_m: 0.0,
                    ..Friction::default()
                };
                let bristle = Bristle::new(&friction, 2.0);
                for speed in [0.05_f64, -0.5] {
                    let mut state = [0.002 * speed.signum()];
                    for _ in 0..400 {
                        state = rk4(&state, 2.5e-4, |z| {
                            [bristle.drag(speed, z[0], 1.0, 1.0).deflection_rate]
                        });
                    }
                    let drag = bristle.drag(speed, state[0], 1.0, 1.0);
                    let expected = coulomb_n.copysign(speed);
                    assert!(
                        (drag.force - expected).abs() < 1e-6 + 1e-6 * coulomb_n,
                        "{coulomb_n} N: {drag:?}"
                    );
                }
            }
        }
        for presliding_stiffness_n_m in [0.0, 4e4] {
            let none = Friction {
                force_n: 0.0,
                stribeck_force_n: 0.0,
                presliding_stiffness_n_m,
                ..Friction::default()
            };
            assert_eq!(Bristle::new(&none, 2.0).drag(0.0, 0.0, 1.0, 1.0), Drag::default());
        }
    }

    #[test]
    fn small_motion_is_elastic() {
        let bristle = Bristle::new(&Friction::default(), 2.0);
        let drag = bristle.drag(0.0, 1e-4, 1.0, 1.0);
        assert!((drag.force - 4.0).abs() < 1e-12 && drag.deflection_rate == 0.0);
    }
}
