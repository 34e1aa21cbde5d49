//! The gas's internal energy, between what the balance predicts and what pressure and length say.
//!
//! While a valve is open, what is measured more than predicted came in by flow, and is followed as a
//! trend. Once both are shut, the energy is the running mean of what is measured about what is predicted,
//! and for the first [`LATE_STEPS`] its corrections still count as flow: they tell better than the
//! last open step did how much came in. Without that, the noise of the pressure would leave a step
//! in the mass with every pulse.

use super::Openings;
use super::trend::{Trend, Uncertainty, on_within};
use crate::math::limit;

/// Steps after the valves have shut in which corrections of the energy still count as flow.
const LATE_STEPS: u16 = 25;
/// Share of each measured energy in the averaged one after that: over a hundred steps. Longer, and the
/// errors of the heat would show.
const LATEST_SHARE: f32 = 0.01;
/// Share of a step in the mean flow: over ten steps.
const MEAN_SHARE: f32 = 0.1;

/// Internal energy of the gas, and the flow that changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    energy_j: f32,
    /// Enthalpy that flow brings with each step \[J\].
    flow: Trend,
    /// Its mean over a PWM period or so in which a valve was driven \[J\].
    mean_flow_j: f32,
    closed_steps: u16,
}

impl Energy {
    /// So much energy \[J\], and no flow.
    pub fn new(energy_j: f32) -> Self {
        Self { energy_j, flow: Trend::REST, mean_flow_j: 0.0, closed_steps: LATE_STEPS }
    }

    /// Internal energy \[J\].
    pub fn energy_j(&self) -> f32 {
        self.energy_j
    }

    /// Whether what [`Self::step`] returned was flow.
    pub fn flowing(&self) -> bool {
        self.closed_steps < LATE_STEPS
    }

    /// What averaging leaves of the variance of one measured energy \[-\].
    pub fn noise_left(&self) -> f32 {
        // While both are shut: less, the longer.
        const SHUT: f32 = 0.2;
        if self.closed_steps > 0 { SHUT } else { self.flow.noise_left() }
    }

    /// What flow is likely to bring in a step whose pressure says nothing \[J\]: the mean of those before,
    /// where it has the valves' direction.
    fn predicted_j(&self, openings: Openings) -> f32 {
        let least_j = if openings.discharging { f32::MIN } else { 0.0 };
        let most_j = if openings.charging { f32::MAX } else { 0.0 };
        if openings.driven { limit(self.mean_flow_j, least_j, most_j) } else { 0.0 }
    }

    /// One step, for which the balance without flow predicts `closed_j`, and P V/(k-1), eq. (4), is
    /// `measured_j`. Returns what the energy is more than predicted \[J\]: the enthalpy that came in,
    /// or once both valves have been shut for [`LATE_STEPS`] a correction.
    pub fn step(
        &mut self,
        closed_j: f32,
        measured_j: f32,
        uncertainty: Uncertainty,
        openings: Openings,
    ) -> f32 {
        let error_j = measured_j - closed_j;
        if openings.charging || openings.discharging {
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
                self.mean_flow_j += MEAN_SHARE * (more_j - self.mean_flow_j);
            }
            self.energy_j = closed_j + more_j;
            return more_j;
        }
        self.flow = Trend::REST;
        self.closed_steps = (self.closed_steps + 1).min(LATE_STEPS);
        let share =
            if self.flowing() { 1.0 / f32::from(self.closed_steps + 1) } else { LATEST_SHARE };
        let more_j = match uncertainty {
            Uncertainty::Noise(_) => share * error_j,
            Uncertainty::WideCode(half_j) => share * (error_j - limit(error_j, -half_j, half_j)),
        };
        // The average never is far from what is measured.
        self.energy_j = limit(closed_j + more_j, 0.5 * measured_j, 2.0 * measured_j);
        more_j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXACT: Uncertainty = Uncertainty::Noise(0.0);
    const SHUT: Openings =
        Openings { turned: false, driven: false, charging: false, discharging: false };
    const FILLING: Openings = Openings { driven: true, charging: true, ..SHUT };

    /// Energy in steps of `rate_j` whose readings stand still between 10 and 30 J: largest error within
    /// those, and elsewhere.
    fn through_a_wide_code(rate_j: f32) -> (f32, f32) {
        let mut energy = Energy::new(0.0);
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
        // Faster than the mean follows it: never out of the code.
        let (within_j, elsewhere_j) = through_a_wide_code(2.0);
        assert!((1.0..20.0).contains(&within_j) && elsewhere_j < 1e-3, "{within_j} {elsewhere_j}");
    }

    #[test]
    fn within_a_wide_code_the_duties_tell() {
        let mut energy = Energy::new(0.0);
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
        let mut energy = Energy::new(10.0);
        assert!(!energy.flowing());
        assert_eq!(energy.step(10.0, 12.0, EXACT, FILLING), 2.0);
        assert_eq!(energy.step(12.0, 13.0, EXACT, SHUT), 0.5, "the mean of 12 and 13");
        assert!(energy.flowing());
        for _ in 0..LATE_STEPS {
            energy.step(energy.energy_j(), 13.0, EXACT, SHUT);
        }
        assert!(!energy.flowing());
        assert!((12.9..13.0).contains(&energy.energy_j()), "{}", energy.energy_j());
        // Within a wide code a shut muscle's reading says nothing.
        assert_eq!(energy.step(13.0, 20.0, Uncertainty::WideCode(8.0), SHUT), 0.0);
    }
}
