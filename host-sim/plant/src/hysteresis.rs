//! Slip of the braid and creep of the rubber, which hold a muscle back in addition to its force at rest.
//!
//! Slip is a spring whose far end, the slider, is dragged along when its force reaches the limit.
//! Creep is two springs, each with a dashpot in series that closes their stretch e in a time T:
//! e' = v - e/T, force m e, loss m e^2/T. Both are positive against contraction.

use super::pull::Pressed;
use thermyo_compute::math;
use thermyo_scenario::{Friction, PlantKind, Scenario};

/// Number of creeping arms.
pub const ARMS: usize = 2;

/// The law, without its state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    pub slip: Slip,
    pub creep: [Arm; ARMS],
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slip {
    force_n: f64,
    stiffness_n_m: f64,
    pressed: Pressed,
}

/// A spring with a dashpot in series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    pub stiffness_n_m: f64,
    /// 1 over the arm's time constant \[1/s\].
    pub per_s: f64,
}

impl Hysteresis {
    /// Hysteresis of a scenario's muscle; other chambers have none.
    pub fn of(scenario: &Scenario) -> Self {
        let muscle = &scenario.muscle;
        let is = if scenario.plant.kind == PlantKind::Muscle { 1.0 } else { 0.0 };
        let arm = |stiffness_n_m: f64, time_s: f64| Arm {
            stiffness_n_m: is * stiffness_n_m,
            per_s: 1.0 / time_s,
        };
        Self {
            slip: Slip {
                force_n: is * muscle.slip_force_n,
                stiffness_n_m: is * muscle.slip_stiffness_n_m,
                pressed: Pressed::new(muscle.slip_pressure_factor),
            },
            creep: [
                arm(muscle.creep_fast_n_m, muscle.creep_fast_s),
                arm(muscle.creep_slow_n_m, muscle.creep_slow_s),
            ],
        }
    }

    /// Force of the arms at their stretches \[m\] \[N\].
    pub fn creep_n(&self, stretches: &[f64]) -> f64 {
        self.over(stretches, |arm, e| arm.stiffness_n_m * e)
    }

    /// Rate at which creep falls at a held length \[N/s\].
    pub fn fading_n_s(&self, stretches: &[f64]) -> f64 {
        self.over(stretches, |arm, e| arm.stiffness_n_m * arm.per_s * e)
    }

    /// Heat in the dashpots \[W\].
    pub fn loss(&self, stretches: &[f64]) -> f64 {
        self.over(stretches, |arm, e| arm.stiffness_n_m * arm.per_s * e * e)
    }

    /// Energy that slip and arms hold \[J\].
    pub fn energy(&self, slip_n: f64, stretches: &[f64]) -> f64 {
        let slip =
            if slip_n == 0.0 { 0.0 } else { 0.5 * slip_n * slip_n / self.slip.stiffness_n_m };
        slip + self.over(stretches, |arm, e| 0.5 * arm.stiffness_n_m * e * e)
    }

    /// Stiffness of slip and arms together, for a motion too fast for creep \[N/m\].
    pub fn stiffness_n_m(&self) -> f64 {
        self.creep.iter().fold(self.slip.stiffness_n_m, |sum, arm| sum + arm.stiffness_n_m)
    }

    fn over(&self, stretches: &[f64], of: impl Fn(&Arm, f64) -> f64) -> f64 {
        self.creep.iter().zip(stretches).map(|(arm, e)| of(arm, *e)).sum()
    }
}

impl Slip {
    /// Dry friction with its presliding.
    pub fn coulomb(friction: &Friction) -> Self {
        Self {
            force_n: friction.force_n,
            stiffness_n_m: friction.presliding_stiffness_n_m,
            pressed: Pressed::new(friction.pressure_factor),
        }
    }

    /// Force at which it slips \[N\], at a gauge pressure \[Pa\] and a factor for the wall's temperature.
    pub fn limit(&self, gauge_pa: f64, softening: f64) -> f64 {
        softening * self.force_n * self.pressed.factor(gauge_pa)
    }

    /// Force at a length \[m\], with the slider at another length \[N\].
    pub fn force(&self, slider: f64, length: f64, limit: f64) -> f64 {
        (self.stiffness_n_m * (slider - length)).clamp(-limit, limit)
    }

    /// Slope of that force over contraction \[N/m\].
    pub fn slope(&self, slider: f64, length: f64, limit: f64) -> f64 {
        let spring = self.stiffness_n_m * (slider - length);
        if spring.abs() < limit { self.stiffness_n_m } else { 0.0 }
    }

    /// Position of the slider once the muscle has moved to a length \[m\], and the heat of the slider's way \[J\]: it
    /// slides against the limit.
    pub fn settle(&self, slider: f64, length: f64, limit: f64) -> (f64, f64) {
        let force = self.force(slider, length, limit);
        if self.stiffness_n_m * (slider - length) == force {
            return (slider, 0.0);
        }
        // Without friction it follows at once.
        let settled = length + if force == 0.0 { 0.0 } else { force / self.stiffness_n_m };
        (settled, force * (slider - settled))
    }
}

/// Share of an arm's stretch that remains after a time, and what a way within that time adds to it at constant speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elapsed {
    /// The time \[s\].
    duration: f64,
    arms: [(f64, f64); ARMS],
}

impl Elapsed {
    /// No time.
    pub const NONE: Self = Self { duration: 0.0, arms: [(1.0, 1.0); ARMS] };

    pub fn new(hysteresis: &Hysteresis, duration: f64) -> Self {
        let arms = hysteresis.creep.map(|arm| {
            let share = duration * arm.per_s;
            let closed = -math::expm1(-share);
            (1.0 - closed, closed / share)
        });
        Self { duration, arms }
    }

    /// The time \[s\].
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Stretches \[m\] after a way \[m\].
    pub fn stretches(&self, from: &[f64; ARMS], way: f64) -> [f64; ARMS] {
        std::array::from_fn(|i| self.arms[i].0 * from[i] + self.arms[i].1 * way)
    }

    /// Slope of the arms' force over that way \[N/m\].
    pub fn slope(&self, hysteresis: &Hysteresis) -> f64 {
        hysteresis
            .creep
            .iter()
            .zip(&self.arms)
            .map(|(arm, (_, gain))| arm.stiffness_n_m * gain)
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured() -> Hysteresis {
        Hysteresis::of(&Scenario::default())
    }

    /// The heat of a loop is its area: 2 F (X - 2 F/s), X from turn to turn.
    #[test]
    fn the_heat_of_a_loop_is_its_area() {
        let slip = measured().slip;
        let limit = slip.limit(1e5, 1.0);
        let (mut slider, mut heat, mut work, mut length) = (0.25, 0.0, 0.0, 0.25);
        for step in 0..4000 {
            let way = if step % 2000 < 1000 { -1e-5 } else { 1e-5 };
            let before = slip.force(slider, length, limit);
            length += way;
            let (settled, loss) = slip.settle(slider, length, limit);
            // The first cycle starts in the middle.
            if step >= 2000 {
                heat += loss;
                work -= 0.5 * (before + slip.force(settled, length, limit)) * way;
            }
            slider = settled;
        }
        let expected = 2.0 * limit * (0.01 - 2.0 * limit / 3100.0);
        assert!((heat / expected - 1.0).abs() < 1e-3, "{heat} {expected}");
        assert!((work / expected - 1.0).abs() < 1e-3, "{work} {expected}");
    }

    /// Compares with the core's form, step by step over a wandering motion.
    #[test]
    fn the_core_holds_as_much() {
        use model_core::physics::hysteresis as core;
        let plant = measured();
        let law = core::Law::new(&core::Hysteresis::default(), 0.01);
        let elapsed = Elapsed::new(&plant, 0.01);
        let (mut held, mut slider, mut stretches) = (core::Held::default(), 0.25, [0.0; ARMS]);
        let mut length = 0.25;
        for step in 0..5000 {
            let t = 0.01 * f64::from(step);
            let to = 0.235 + 0.01 * math::cos(0.7 * t) + 0.005 * math::cos(3.1 * t);
            let way = length - to;
            stretches = elapsed.stretches(&stretches, way);
            let limit = plant.slip.limit(2e5, 0.9);
            slider = plant.slip.settle(slider, to, limit).0;
            held = law.after(&held, way as f32, 2e5, 0.9);
            length = to;
            let slip = plant.slip.force(slider, to, limit);
            assert!((f64::from(held.slip_n) - slip).abs() < 0.01, "{held:?} {slip}");
            let creep = plant.creep_n(&stretches);
            let core_creep = f64::from(held.fast_n + held.slow_n);
            assert!((core_creep - creep).abs() < 0.01, "{held:?} {creep}");
        }
    }

    #[test]
    fn without_friction_the_slider_follows() {
        let mut scenario = Scenario::default();
        scenario.muscle.slip_force_n = 0.0;
        let slip = Hysteresis::of(&scenario).slip;
        assert_eq!(slip.settle(0.25, 0.2, slip.limit(1e5, 1.0)), (0.2, 0.0));
        scenario.muscle.slip_stiffness_n_m = 0.0;
        let slip = Hysteresis::of(&scenario).slip;
        assert_eq!(slip.force(0.25, 0.2, 5.0), 0.0);
        assert_eq!(slip.settle(0.25, 0.2, 5.0).1, 0.0);
    }
}
