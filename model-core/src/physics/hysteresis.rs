//! Hysteresis of a muscle in motion: the braid slips, the rubber creeps.
//!
//! ```text
//! F   = P_g A(L) - bladder - z - q1 - q2          beside the chamber's force at rest
//! z'  = s x',  |z| <= F_s (1 + f (P_g/4 bar - 1)) softening      slip: a spring that lets go
//! qi' = mi x' - qi/Ti                                            creep: a spring and a dashpot in series
//! ```
//!
//! x is the contraction (positive where the muscle shortens); z and q are positive where they oppose it. A step with a
//! constant speed is exact: z is clamped, and
//!
//! ```text
//! qi <- di qi + mi phi_i dx,   di = exp(-dt/Ti),   phi_i = (1 - di) Ti/dt
//! ```
//!
//! One Prandtl element and two Maxwell arms: muscles measured by others need no more of either
//! (`docs/background/validation.md`). All defaults were measured on a Festo DMSP-10-250.

use super::friction::at_pressure;
use crate::math::{exp, limit};
use crate::parameter::parameters;

/// Share of an arm's time below which the series of exp holds to 1e-7 and its difference from 1 does not.
const SHORT: f32 = 0.02;

parameters! {
    /// Hysteresis of a muscle in motion; 0 N or 0 N/m: none.
    "muscle": Hysteresis {
        slip_force_n: 6.5, "N", 0.0 to 1.0e5, "force at which the braid slips, at 4 bar gauge and friction.reference_temperature_k";
        slip_stiffness_n_m: 3.1e3, "N/m", 0.0 to 1.0e9, "stiffness with which it builds up after a turn";
        slip_pressure_factor: 0.0, "", 0.0 to 2.0, "share f of the slip force that follows gauge pressure: factor 1 + f (P/4 bar - 1), no less than 0";
        creep_fast_n_m: 2.47e3, "N/m", 0.0 to 1.0e6, "stiffness of the fast creep; 0: none";
        creep_fast_s: 0.45, "s", 0.01 to 1.0e5, "time in which the fast creep falls to 1/e at a held length";
        creep_slow_n_m: 1.5e3, "N/m", 0.0 to 1.0e6, "stiffness of the slow creep; 0: none";
        creep_slow_s: 26.0, "s", 0.01 to 1.0e5, "time in which the slow creep falls to 1/e at a held length";
    }
}

impl Hysteresis {
    /// Hysteresis of a chamber without any, such as a cylinder.
    pub const NONE: Self = Self {
        slip_force_n: 0.0,
        slip_stiffness_n_m: 0.0,
        slip_pressure_factor: 0.0,
        creep_fast_n_m: 0.0,
        creep_fast_s: 1.0,
        creep_slow_n_m: 0.0,
        creep_slow_s: 1.0,
    };

    /// Force at which the braid slips \[N\], at a gauge pressure and a factor for the wall's temperature
    /// ([`super::friction::Friction::softening`]).
    pub fn slip_n(&self, gauge_pressure_pa: f32, softening: f32) -> f32 {
        softening * self.slip_force_n * at_pressure(self.slip_pressure_factor, gauge_pressure_pa)
    }
}

/// Forces that hold the muscle back, positive against contraction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Held {
    /// Slip \[N\].
    pub slip_n: f32,
    /// Fast creep \[N\].
    pub fast_n: f32,
    /// Slow creep \[N\].
    pub slow_n: f32,
}

impl Held {
    /// Sum of slip and creep \[N\].
    pub fn force_n(&self) -> f32 {
        self.slip_n + self.fast_n + self.slow_n
    }
}

/// A Maxwell arm over one interval.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Arm {
    /// Share of the arm's force that remains after an interval \[-\].
    keeps: f32,
    /// Force per way at a constant speed \[N/m\].
    gains_n_m: f32,
    /// Heat in an interval per squared force \[J/N2\]: dt/(m T).
    loses_j_n2: f32,
}

impl Arm {
    fn new(stiffness_n_m: f32, time_s: f32, interval_s: f32) -> Self {
        let share = interval_s / time_s;
        // (1 - exp(-x))/x, which rounding spoils for small x.
        let mean = if share < SHORT {
            1.0 - share * (0.5 - share * (1.0 / 6.0 - share * (1.0 / 24.0)))
        } else {
            (1.0 - exp(-share)) / share
        };
        let loses_j_n2 = if stiffness_n_m > 0.0 { share / stiffness_n_m } else { 0.0 };
        Self { keeps: 1.0 - share * mean, gains_n_m: stiffness_n_m * mean, loses_j_n2 }
    }

    /// Heat in an interval over which the force changes linearly \[J\].
    fn heat_j(&self, before_n: f32, after_n: f32) -> f32 {
        let squared_n2 = before_n * before_n + before_n * after_n + after_n * after_n;
        self.loses_j_n2 * (1.0 / 3.0) * squared_n2
    }

    fn after(&self, force_n: f32, way_m: f32) -> f32 {
        self.keeps * force_n + self.gains_n_m * way_m
    }
}

/// The law over a fixed interval, with its exponentials computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    configured: Hysteresis,
    /// Reciprocal of the slip's stiffness \[m/N\].
    slip_m_n: f32,
    fast: Arm,
    slow: Arm,
}

impl Law {
    /// Computes the law for an interval \[s\], such as the valves' PWM period.
    ///
    /// ```
    /// use model_core::physics::hysteresis::{Held, Hysteresis, Law};
    ///
    /// let law = Law::new(&Hysteresis::default(), 0.01);
    /// let contracted = law.after(&Held::default(), 1.0e-3, 3.0e5, 1.0);
    /// assert!(contracted.slip_n > 3.0 && contracted.slow_n > 1.4);
    /// ```
    pub fn new(configured: &Hysteresis, interval_s: f32) -> Self {
        let Hysteresis { creep_fast_n_m, creep_fast_s, creep_slow_n_m, creep_slow_s, .. } =
            *configured;
        let slip_n_m = configured.slip_stiffness_n_m;
        Self {
            configured: *configured,
            slip_m_n: if slip_n_m > 0.0 { 1.0 / slip_n_m } else { 0.0 },
            fast: Arm::new(creep_fast_n_m, creep_fast_s, interval_s),
            slow: Arm::new(creep_slow_n_m, creep_slow_s, interval_s),
        }
    }

    /// Forces after an interval in which the muscle contracted by `way_m`, at a gauge pressure and a
    /// factor for the wall's temperature.
    pub fn after(&self, held: &Held, way_m: f32, gauge_pressure_pa: f32, softening: f32) -> Held {
        let slips_n = self.configured.slip_n(gauge_pressure_pa, softening);
        let slip_n = held.slip_n + self.configured.slip_stiffness_n_m * way_m;
        Held {
            slip_n: limit(slip_n, -slips_n, slips_n),
            fast_n: self.fast.after(held.fast_n, way_m),
            slow_n: self.slow.after(held.slow_n, way_m),
        }
    }

    /// Heat of slip and creep in an interval from one state to another over `way_m` \[J\].
    pub fn heat_j(&self, before: &Held, after: &Held, way_m: f32) -> f32 {
        let slid_m = way_m - (after.slip_n - before.slip_n) * self.slip_m_n;
        after.slip_n * slid_m
            + self.fast.heat_j(before.fast_n, after.fast_n)
            + self.slow.heat_j(before.slow_n, after.slow_n)
    }

    /// Force per way that an interval adds while nothing slips \[N/m\].
    pub fn stiffness_n_m(&self) -> f32 {
        self.configured.slip_stiffness_n_m + self.fast.gains_n_m + self.slow.gains_n_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A step is held: each arm relaxes as exp(-t/T), and slip does not.
    #[test]
    fn a_step_relaxes_by_its_times() {
        let law = Law::new(&Hysteresis::default(), 0.01);
        let mut held = law.after(&Held::default(), 0.01, 4.0e5, 1.0);
        let start = held;
        for _ in 0..100 {
            held = law.after(&held, 0.0, 4.0e5, 1.0);
        }
        assert_eq!(held.slip_n, 6.5);
        let left = |time_s: f64| (-1.0 / time_s).exp();
        for (is_n, was_n, expected) in
            [(held.fast_n, start.fast_n, left(0.45)), (held.slow_n, start.slow_n, left(26.0))]
        {
            let share = f64::from(is_n / was_n);
            assert!((share / expected - 1.0).abs() < 2e-5, "{share} for {expected}");
        }
    }

    /// Between turns far apart the force changes by twice the slip force, over twice F/s of way.
    #[test]
    fn a_loop_is_as_wide_as_twice_the_slip_and_develops_over_its_way() {
        let creepless =
            Hysteresis { creep_fast_n_m: 0.0, creep_slow_n_m: 0.0, ..Hysteresis::default() };
        let law = Law::new(&creepless, 0.01);
        let mut held = Held::default();
        let (mut area_j, mut heat_j) = (0.0_f64, 0.0_f64);
        for step in 0..6000 {
            // 10 mm up and down, in steps of 5 um.
            let way_m = if step % 4000 < 2000 { 5.0e-6 } else { -5.0e-6 };
            let after = law.after(&held, way_m, 2.0e5, 1.0);
            if step >= 2000 {
                area_j += 0.5 * f64::from(held.slip_n + after.slip_n) * f64::from(way_m);
                heat_j += f64::from(law.heat_j(&held, &after, way_m));
            }
            held = after;
            let turned_m = 5.0e-6 * f64::from(step - 1999);
            if (2000..2800).contains(&step) {
                let expected_n = 6.5 - 3100.0 * turned_m;
                assert!((f64::from(held.slip_n) - expected_n).abs() < 2e-3, "{held:?}");
            }
        }
        // The parallelogram: 2 F (X - 2 F/s), X from turn to turn.
        let expected_j = 2.0 * 6.5 * (0.01 - 2.0 * 6.5 / 3100.0);
        assert!((area_j / expected_j - 1.0).abs() < 1e-3, "{area_j} {expected_j}");
        assert!((heat_j / expected_j - 1.0).abs() < 1e-2, "{heat_j} {expected_j}");
    }

    #[test]
    fn slip_follows_pressure_and_wall() {
        let configured = Hysteresis { slip_pressure_factor: 1.6, ..Hysteresis::default() };
        for (gauge_pa, softening, expected_n) in
            [(4.0e5, 1.0, 6.5), (1.5e5, 1.0, 0.0), (5.0e5, 0.5, 0.5 * 6.5 * 1.4), (0.0, 1.0, 0.0)]
        {
            let slip_n = configured.slip_n(gauge_pa, softening);
            assert!((slip_n - expected_n).abs() < 1e-4, "{slip_n} N at {gauge_pa} Pa");
        }
        assert_eq!(Hysteresis::default().slip_n(0.0, 1.0), 6.5);
    }

    /// A held step turns all the energy that the arms store into heat: m x^2/2 each.
    #[test]
    fn what_creep_stores_becomes_heat() {
        let law = Law::new(&Hysteresis { slip_force_n: 0.0, ..Hysteresis::default() }, 0.01);
        let (mut held, mut heat_j) = (law.after(&Held::default(), 0.01, 0.0, 1.0), 0.0_f64);
        for _ in 0..30_000 {
            let after = law.after(&held, 0.0, 0.0, 1.0);
            heat_j += f64::from(law.heat_j(&held, &after, 0.0));
            held = after;
        }
        let expected_j = 0.5 * (2470.0 + 1500.0) * 1.0e-4;
        // Of the fast arm, 2 % are gone within the step itself.
        assert!((heat_j / expected_j - 0.99).abs() < 0.01, "{heat_j} {expected_j}");
    }

    #[test]
    fn nothing_is_held_without_hysteresis() {
        let law = Law::new(&Hysteresis::NONE, 0.01);
        assert_eq!(Hysteresis::NONE.check(), Ok(()));
        assert_eq!(law.after(&Held::default(), 0.05, 4.0e5, 1.0), Held::default());
    }

    proptest! {
        /// At a constant speed a step of any length is exact: q = m T v (1 - exp(-t/T)).
        #[test]
        fn a_constant_speed_is_exact(
            time_s in 0.01_f32..1.0e3, interval_s in 1.0e-3_f32..0.1, speed_m_s in -0.5_f32..0.5
        ) {
            let configured = Hysteresis { creep_slow_s: time_s, ..Hysteresis::default() };
            let law = Law::new(&configured, interval_s);
            let mut held = Held::default();
            for _ in 0..50 {
                held = law.after(&held, speed_m_s * interval_s, 4.0e5, 1.0);
            }
            let [t, time] = [50.0 * interval_s, time_s].map(f64::from);
            let expected = 1500.0 * time * f64::from(speed_m_s) * -(-t / time).exp_m1();
            prop_assert!(
                (f64::from(held.slow_n) - expected).abs() <= 3e-5 * expected.abs() + 1e-6,
                "{held:?} {expected}"
            );
        }

        /// Nothing grows without end.
        #[test]
        fn a_held_muscle_forgets(
            slip_n in -1.0e5_f32..1.0e5, fast_n in -1.0e6_f32..1.0e6, time_s in 0.01_f32..1.0e5
        ) {
            let configured = Hysteresis { creep_fast_s: time_s, ..Hysteresis::default() };
            let law = Law::new(&configured, 0.01);
            let held = Held { slip_n, fast_n, slow_n: 0.0 };
            let after = law.after(&held, 0.0, 4.0e5, 1.0);
            prop_assert!(after.slip_n.abs() <= 6.5 && after.fast_n.abs() <= fast_n.abs());
            prop_assert!(after.fast_n * fast_n >= 0.0);
        }
    }
}
