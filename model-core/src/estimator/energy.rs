//! The gas's internal energy, between what the balance foretells and what pressure and length say.
//!
//! While a valve is open the energy is the measured one, and what it is more than foretold came in
//! by flow. Once both are shut, it is the running mean of what is measured about what is foretold, and for
//! the first [`LATE_STEPS`] its corrections still count as flow: they tell better than the last
//! open step did how much came in. Without that, the noise of the pressure would leave a step in
//! the mass with every pulse.
//!
//! A code that the converter makes too wide (erratum RP2040-E11, a kilopascal to either side) says
//! only that the pressure lies within it. As long as it does, the flow goes on as it was.

use crate::math::limit;

/// Steps after the valves have shut in which corrections of the energy still count as flow.
const LATE_STEPS: u16 = 25;
/// Share of each measured energy in the averaged one after that: over a hundred steps. Longer, and the
/// errors of the heat would show.
const LATEST_SHARE: f32 = 0.01;
/// Share of a step's flow in the flow that is expected: over one PWM period.
const FLOW_FOLLOWED: f32 = 0.1;

/// What one reading of pressure and length says of the energy \[J\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// P V/(k-1), eq. (4).
    pub measured_j: f32,
    /// How far from it the energy may lie: half of a code that the converter makes too wide, or 0.
    pub doubt_j: f32,
}

/// Internal energy of the gas, and the flow that changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    energy_j: f32,
    /// Enthalpy that flow is expected to bring with the next step \[J\].
    flow_j: f32,
    closed_steps: u16,
}

impl Energy {
    /// So much energy \[J\], and no flow.
    pub fn new(energy_j: f32) -> Self {
        Self { energy_j, flow_j: 0.0, closed_steps: LATE_STEPS }
    }

    /// Internal energy \[J\].
    pub fn energy_j(&self) -> f32 {
        self.energy_j
    }

    /// Whether what [`Self::step`] returned was flow.
    pub fn flowing(&self) -> bool {
        self.closed_steps < LATE_STEPS
    }

    /// One step, for which the balance without flow foretells `closed_j`. Returns what the energy is
    /// more than that \[J\]: the enthalpy that came in, or once both valves have been shut for
    /// [`LATE_STEPS`] a correction.
    pub fn step(&mut self, closed_j: f32, reading: &Reading, open: bool) -> f32 {
        let flow_j = if open { self.flow_j } else { 0.0 };
        let mut error_j = reading.measured_j - closed_j - flow_j;
        if reading.doubt_j > 0.0 {
            error_j -= limit(error_j, -reading.doubt_j, reading.doubt_j);
        }
        if open {
            self.closed_steps = 0;
            self.flow_j = flow_j + FLOW_FOLLOWED * error_j;
            let more_j = flow_j + error_j;
            self.energy_j = closed_j + more_j;
            more_j
        } else {
            self.closed_steps = (self.closed_steps + 1).min(LATE_STEPS);
            self.flow_j = 0.0;
            let share =
                if self.flowing() { 1.0 / f32::from(self.closed_steps + 1) } else { LATEST_SHARE };
            let more_j = share * error_j;
            // The average never is far from what is measured.
            self.energy_j =
                limit(closed_j + more_j, 0.5 * reading.measured_j, 2.0 * reading.measured_j);
            more_j
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp whose readings stand still between 10 and 30 J: largest error within, and after it.
    fn through_a_wide_code(rate_j: f32) -> (f32, f32) {
        let mut energy = Energy::new(0.0);
        let (mut within_j, mut after_j) = (0.0_f32, 0.0_f32);
        for step in 1..200 {
            let true_j = rate_j * step as f32;
            let wide = (10.0..30.0).contains(&true_j);
            let reading = if wide {
                Reading { measured_j: 20.0, doubt_j: 10.0 }
            } else {
                Reading { measured_j: true_j, doubt_j: 0.0 }
            };
            energy.step(energy.energy_j(), &reading, true);
            let worst = if wide { &mut within_j } else { &mut after_j };
            *worst = worst.max((energy.energy_j() - true_j).abs());
        }
        (within_j, after_j)
    }

    #[test]
    fn a_flow_goes_on_through_a_wide_code() {
        let (within_j, after_j) = through_a_wide_code(0.25);
        assert!(within_j < 0.5 && after_j < 1e-4, "{within_j} {after_j}");
        // Faster than the expectation follows it: never outside of the code.
        let (within_j, after_j) = through_a_wide_code(2.0);
        assert!((1.0..20.0).contains(&within_j) && after_j < 1e-4, "{within_j} {after_j}");
    }

    #[test]
    fn what_comes_late_counts_as_flow_and_later_on_does_not() {
        let mut energy = Energy::new(10.0);
        let reading = Reading { measured_j: 12.0, doubt_j: 0.0 };
        assert!(!energy.flowing());
        assert_eq!(energy.step(10.0, &reading, true), 2.0);
        let late = Reading { measured_j: 13.0, ..reading };
        assert_eq!(energy.step(12.0, &late, false), 0.5, "the mean of 12 and 13");
        assert!(energy.flowing());
        for _ in 0..LATE_STEPS {
            energy.step(energy.energy_j(), &late, false);
        }
        assert!(!energy.flowing());
        assert!((12.9..13.0).contains(&energy.energy_j()), "{}", energy.energy_j());
    }
}
