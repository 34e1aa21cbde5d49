//! Detects a muscle that loses gas in a lock. Without the angle there are no volumes, and no balance of the gas.
//!
//! With four shut valves anything that turns the arm compresses one muscle's gas and expands the other's: the product
//! of both pressures stays. A hole lowers it twice: the arm follows the tight muscle, whose gas expands. Gas that is
//! warmer than its wall cools, and its pressure falls in proportion.

use crate::math::limit;
use crate::physics::gas::Reservoir;
use crate::step_counts::StepCounts;

/// Share of a muscle's gas that counts as missing, as in the balance of one muscle \[-\].
const TRIP: f32 = 0.25;
/// Share of the product that is forgotten in a second: 2 % of the gas of each muscle, as in that balance \[1/s\].
const FORGOTTEN_PER_S: f32 = 0.04;

/// State of the watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LockWatch {
    /// Product of both pressures below which gas is missing \[Pa2\].
    least_pa2: f32,
    /// Share of it that remains after a step \[-\].
    left: f32,
    patience_steps: u16,
    below_steps: u16,
    steps: u32,
}

impl LockWatch {
    /// Starts the watch at the beginning of a lock, with this gas and these wall temperatures \[K\].
    #[cold] // Once in a lock: as small as can be.
    pub fn new(step_s: f32, gas: [Reservoir; 2], wall_k: [f32; 2]) -> Self {
        let least_pa2 = gas.iter().zip(wall_k).fold(1.0 - TRIP, |product, (gas, wall_k)| {
            product * gas.pressure_pa * limit(wall_k / gas.temperature_k, 0.5, 1.0)
        });
        Self {
            least_pa2,
            left: 1.0 - FORGOTTEN_PER_S * step_s,
            patience_steps: StepCounts::new(step_s).patience_steps,
            below_steps: 0,
            steps: 0,
        }
    }

    /// Runs a step with these absolute pressures \[Pa\]; returns whether gas is missing.
    #[cold]
    pub fn step(&mut self, [of_a, of_b]: [f32; 2]) -> bool {
        self.steps = self.steps.saturating_add(1);
        self.least_pa2 *= self.left;
        let below = of_a * of_b < self.least_pa2;
        self.below_steps = if below { self.below_steps.saturating_add(1) } else { 0 };
        self.below_steps > self.patience_steps
    }

    /// Steps since the lock began.
    pub fn steps(&self) -> u32 {
        self.steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f32 = 1.0e-3;

    fn watch(gas_k: f32) -> LockWatch {
        let gas = [4.0e5, 2.5e5].map(|pressure_pa| Reservoir { pressure_pa, temperature_k: gas_k });
        LockWatch::new(STEP_S, gas, [300.0; 2])
    }

    /// Step in which gas is found missing, for pressures over time \[s\].
    fn missing(gas_k: f32, pressure_pa: impl Fn(f32) -> [f32; 2]) -> Option<u16> {
        let mut watch = watch(gas_k);
        (1..=30_000).find(|&step| watch.step(pressure_pa(STEP_S * f32::from(step))))
    }

    #[test]
    fn an_arm_that_is_pushed_loses_no_gas() {
        for swing in [0.25_f32, -0.25] {
            let pushed = |t: f32| {
                let ratio = 1.0 + swing * (6.0 * t).sin();
                [4.0e5 * ratio, 2.5e5 / ratio]
            };
            assert_eq!(missing(300.0, pushed), None);
        }
    }

    /// A fast fill warms the gas by a quarter; beside an equally warm wall, the same loss is a hole.
    #[test]
    fn gas_that_cools_is_not_missing() {
        let cools = |t: f32| [4.0e5, 2.5e5].map(|pa| pa * (0.8 + 0.2 * (-10.0 * t).exp()));
        assert_eq!(missing(375.0, cools), None);
        assert!(missing(300.0, cools).is_some());
    }

    /// A quarter of the gas of either muscle; a tenth of that rate is less than the day's changes.
    #[test]
    fn a_hole_in_either_muscle_is_found() {
        for side in 0..2 {
            let falls = |per_s: f32| {
                missing(300.0, |t| {
                    let mut pressure_pa = [4.0e5, 2.5e5];
                    pressure_pa[side] *= (-per_s * t).exp();
                    pressure_pa
                })
            };
            assert!(falls(0.2).is_some_and(|step| (1_300..2_100).contains(&step)), "{side}");
            assert!(falls(3.0).is_some_and(|step| (90..130).contains(&step)), "{side}");
            assert_eq!(falls(0.03), None);
        }
    }

    /// A reading may be disturbed for less than 10 ms.
    #[test]
    fn a_reading_that_jumps_is_no_hole() {
        let jumps = |t: f32| [if (1.0..1.008).contains(&t) { 1.0e5 } else { 4.0e5 }, 2.5e5];
        assert_eq!(missing(300.0, jumps), None);
    }
}
