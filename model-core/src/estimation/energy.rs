//! The gas's internal energy, between the prediction of the balance and the measurement by pressure and length.
//!
//! While a valve is open, measured energy beyond the prediction came in by flow, and is followed as a trend. Once both
//! are shut, the energy is the running mean of the measured energies about the prediction, and for the first 25 ms its
//! corrections still count as flow: they show better than the last open step how much came in. Without that, the noise
//! of the pressure would leave a step in the mass with every pulse.

use super::Openings;
use super::trend::{Trend, Uncertainty, on_within};
use crate::math::limit;
use crate::step_counts::StepCounts;

/// Numbers of steps over which it averages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Averaging {
    /// Steps after the valves have shut during which corrections of the energy still count as flow.
    late_steps: u16,
    /// Share of each measured energy in the averaged one after that.
    shut_share: f32,
    /// Share of a step in the mean flow: over a PWM period.
    flow_share: f32,
}

impl Averaging {
    /// Averaging with these step counts.
    pub fn new(counts: &StepCounts, pwm_period_steps: u16) -> Self {
        Self {
            late_steps: counts.late_steps,
            shut_share: 1.0 / f32::from(counts.shut_steps),
            flow_share: 1.0 / f32::from(pwm_period_steps.max(1)),
        }
    }
}

/// Internal energy of the gas, and the flow that changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    averaging: Averaging,
    energy_j: f32,
    /// Enthalpy that flow brings with each step \[J\].
    flow: Trend,
    /// Mean of the flow over about one PWM period in which a valve was driven \[J\].
    mean_flow_j: f32,
    closed_steps: u16,
}

impl Energy {
    /// Creates an energy \[J\] without flow.
    pub fn new(energy_j: f32, averaging: Averaging) -> Self {
        Self {
            averaging,
            energy_j,
            flow: Trend::REST,
            mean_flow_j: 0.0,
            closed_steps: averaging.late_steps,
        }
    }

    /// Starts again from this energy \[J\] at rest, with the same averaging.
    pub fn restart(&mut self, energy_j: f32) {
        *self = Self::new(energy_j, self.averaging);
    }

    /// Internal energy \[J\].
    pub fn energy_j(&self) -> f32 {
        self.energy_j
    }

    /// Sets the energy \[J\] without counting the change as flow.
    pub fn set(&mut self, energy_j: f32) {
        self.energy_j = energy_j;
    }

    /// Whether the last value returned by [`Self::step`] was flow.
    pub fn flowing(&self) -> bool {
        self.closed_steps < self.averaging.late_steps
    }

    /// Fraction of one measured energy's variance that remains after averaging \[-\].
    pub fn noise_left(&self) -> f32 {
        // While both valves are shut: less, the longer they are.
        const SHUT: f32 = 0.2;
        if self.closed_steps > 0 { SHUT } else { self.flow.noise_left() }
    }

    /// Energy that flow probably brings in a step without a usable pressure \[J\]: the mean of the steps before, if it
    /// has the valves' direction.
    fn predicted_j(&self, openings: Openings) -> f32 {
        let least_j = if openings.discharging { f32::MIN } else { 0.0 };
        let most_j = if openings.charging { f32::MAX } else { 0.0 };
        if openings.driven { limit(self.mean_flow_j, least_j, most_j) } else { 0.0 }
    }

    /// Runs one step, for which the balance without flow predicts `closed_j`, and P V/(k-1), eq. (4), is `measured_j`.
    /// Returns by how much the energy exceeds the prediction \[J\]: the enthalpy that came in or, once both valves have
    /// been shut for long enough, a correction.
    pub fn step(
        &mut self,
        closed_j: f32,
        measured_j: f32,
        uncertainty: Uncertainty,
        openings: Openings,
    ) -> f32 {
        let error_j = measured_j - closed_j;
        if openings.is_open() {
            self.closed_steps = 0;
            let more_j = match uncertainty {
                Uncertainty::WideCode(half_j) => {
                    on_within(self.predicted_j(openings), error_j, half_j)
                }
                Uncertainty::Noise(_) => {
                    self.flow.step(error_j, uncertainty, openings.flow_state(true))
                }
            };
            if openings.driven {
                self.mean_flow_j += self.averaging.flow_share * (more_j - self.mean_flow_j);
            }
            self.energy_j = closed_j + more_j;
            return more_j;
        }
        self.flow = Trend::REST;
        self.closed_steps = (self.closed_steps + 1).min(self.averaging.late_steps);
        let share = if self.flowing() {
            1.0 / f32::from(self.closed_steps + 1)
        } else {
            self.averaging.shut_share
        };
        let more_j = match uncertainty {
            Uncertainty::Noise(_) => share * error_j,
            Uncertainty::WideCode(half_j) => share * (error_j - limit(error_j, -half_j, half_j)),
        };
        // The average never gets far from the measured value.
        self.energy_j = limit(closed_j + more_j, 0.5 * measured_j, 2.0 * measured_j);
        more_j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_rest(energy_j: f32) -> Energy {
        Energy::new(energy_j, Averaging::new(&StepCounts::new(0.001), 10))
    }

    const EXACT: Uncertainty = Uncertainty::Noise(0.0);
    const SHUT: Openings =
        Openings { turned: false, driven: false, charging: false, discharging: false };
    const FILLING: Openings = Openings { driven: true, charging: true, ..SHUT };

    /// Energy in steps of `rate_j` whose readings stay the same between 10 and 30 J: largest error within that range,
    /// and elsewhere.
    fn through_a_wide_code(rate_j: f32) -> (f32, f32) {
        let mut energy = at_rest(0.0);
        let (mut within_j, mut elsewhere_j) = (0.0_f32, 0.0_f32);
        for step in 1..200 {
            let true_j = rate_j * step as f32;
            let wide = (10.0..30.0).contains(&true_j);
            let (measured_j, uncertainty) =
                if wide { (20.0, Uncertainty::WideCode(10.0)) } else { (true_j, EXACT) };
            energy.step(energy.energy_j(), measured_j, uncertainty, FILLING);
            let worst = if wide { &mut within_j } else { &mut elsewhere_j };
            *worst = worst.max((energy.energy_j() - true_j).abs());
        }
        (within_j, elsewhere_j)
    }

    #[test]
    fn a_flow_goes_on_through_a_wide_code() {
        let (within_j, elsewhere_j) = through_a_wide_code(0.25);
        assert!(within_j < 0.5 && elsewhere_j < 1e-3, "{within_j} {elsewhere_j}");
        // Faster than the mean follows: never outside the code.
        let (within_j, elsewhere_j) = through_a_wide_code(2.0);
        assert!((1.0..20.0).contains(&within_j) && elsewhere_j < 1e-3, "{within_j} {elsewhere_j}");
    }

    #[test]
    fn within_a_wide_code_the_duties_tell() {
        let mut energy = at_rest(0.0);
        for step in 1..100_u8 {
            energy.step(energy.energy_j(), f32::from(step), EXACT, FILLING);
        }
        let mut on = |openings| {
            let before_j = energy.energy_j();
            energy.step(before_j, 100.0, Uncertainty::WideCode(20.0), openings);
            energy.energy_j() - before_j
        };
        assert!((on(FILLING) - 1.0).abs() < 1e-3, "the mean of the steps before");
        assert_eq!(on(Openings { driven: false, ..FILLING }), 0.0, "between two pulses");
        assert!((on(FILLING) - 1.0).abs() < 1e-3);
        let venting = Openings { charging: false, discharging: true, ..FILLING };
        assert_eq!(on(venting), 0.0, "the mean has the other direction");
    }

    #[test]
    fn what_comes_late_counts_as_flow_and_later_on_does_not() {
        let mut energy = at_rest(10.0);
        assert!(!energy.flowing());
        assert_eq!(energy.step(10.0, 12.0, EXACT, FILLING), 2.0);
        assert_eq!(energy.step(12.0, 13.0, EXACT, SHUT), 0.5, "the mean of 12 and 13");
        assert!(energy.flowing());
        for _ in 0..25 {
            energy.step(energy.energy_j(), 13.0, EXACT, SHUT);
        }
        assert!(!energy.flowing());
        assert!((12.9..13.0).contains(&energy.energy_j()), "{}", energy.energy_j());
        // Within a wide code a shut muscle's reading carries no information.
        assert_eq!(energy.step(13.0, 20.0, Uncertainty::WideCode(8.0), SHUT), 0.0);
    }
}
