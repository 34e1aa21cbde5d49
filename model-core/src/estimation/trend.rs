//! A measured quantity that changes steadily until it turns: its noise is averaged, its turns are not.
//!
//! An alpha-beta filter with expanding memory: from a turn on, value and rate are those of the straight line of least
//! squares through the steps since then; later on through about the last sixteen while gas may flow, and through ever
//! more while none does. A turn is a change of the valves' openings, or an error beyond the noise.

use crate::math::{absolute, is_above, limit};

/// Shares of an error by which value and rate follow it, by the number of steps since a turn: 2(2n + 1)/((n + 1)(n +
/// 2)) and 6/((n + 1)(n + 2)).
const FOLLOWED: [(f32, f32); 16] = [
    (1.0, 1.0),
    (1.0, 1.0),
    (5.0 / 6.0, 1.0 / 2.0),
    (7.0 / 10.0, 3.0 / 10.0),
    (3.0 / 5.0, 1.0 / 5.0),
    (11.0 / 21.0, 1.0 / 7.0),
    (13.0 / 28.0, 3.0 / 28.0),
    (5.0 / 12.0, 1.0 / 12.0),
    (17.0 / 45.0, 1.0 / 15.0),
    (19.0 / 55.0, 3.0 / 55.0),
    (7.0 / 22.0, 1.0 / 22.0),
    (23.0 / 78.0, 1.0 / 26.0),
    (25.0 / 91.0, 3.0 / 91.0),
    (9.0 / 35.0, 1.0 / 35.0),
    (29.0 / 120.0, 1.0 / 40.0),
    (31.0 / 136.0, 3.0 / 136.0),
];
/// Share of its rate that a value loses in each step without flow and without a reading: half a swing of a load on its
/// gas spring, at 10 to 30 Hz.
const STOPS: f32 = 1.0 / 32.0;
/// Steps since a turn that count at the first reading beyond a wide code (assumption). The noise of a reading at the
/// code's edge is no rate: back within the code, the value would coast with it for 1/[`STOPS`] steps.
const LEFT_STEPS: usize = 8;
/// Longest line along which gas may flow, in steps.
const OPEN_STEPS: usize = FOLLOWED.len() - 1;

/// Largest error of a reading, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Uncertainty {
    /// By noise, of at most this size.
    Noise(f32),
    /// Half the width of a code that the converter makes too wide: within it the true value is unknown.
    WideCode(f32),
}

impl Uncertainty {
    /// Converts to another unit, of which this one is `factor`, not negative.
    pub fn times(self, factor: f32) -> Self {
        match self {
            Self::Noise(most) => Self::Noise(most * factor),
            Self::WideCode(half) => Self::WideCode(half * factor),
        }
    }
}

/// Flow to expect in a step from the state of the valves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FlowState {
    /// The openings have changed: another line begins here.
    Turned,
    /// Gas may flow.
    Open,
    /// No gas flows.
    Shut,
}

/// Shares of an error by which value and rate follow it. Beyond sixteen steps, while nothing flows and changes become
/// smaller: those of about the last 24, 64, 256 steps.
fn shares(steady_steps: usize) -> (f32, f32) {
    match FOLLOWED.get(steady_steps) {
        Some(shares) => *shares,
        None if steady_steps < 64 => (49.0 / 325.0, 3.0 / 325.0),
        None if steady_steps < 256 => (43.0 / 715.0, 1.0 / 715.0),
        None => (171.0 / 11_051.0, 1.0 / 11_051.0),
    }
}

/// The rate of a quantity, per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trend {
    rate: f32,
    steady_steps: usize,
    /// Whether the last reading was anywhere within a wide code.
    within: bool,
}

impl Trend {
    /// At rest.
    pub const REST: Self = Self { rate: 0.0, steady_steps: 0, within: false };

    /// Fraction of one reading's variance that remains after averaging \[-\].
    pub fn noise_left(&self) -> f32 {
        shares(self.steady_steps.min(OPEN_STEPS)).0
    }

    /// Takes a reading that differs by `change` from the last value; returns by how much the value changes.
    pub fn step(&mut self, change: f32, uncertainty: Uncertainty, flow_state: FlowState) -> f32 {
        let noise = match uncertainty {
            Uncertainty::WideCode(half) => {
                self.steady_steps = 0;
                self.within = true;
                if flow_state == FlowState::Shut {
                    self.rate -= STOPS * self.rate;
                }
                return on_within(self.rate, change, half);
            }
            Uncertainty::Noise(noise) => noise,
        };
        if self.within {
            self.within = false;
            self.steady_steps = LEFT_STEPS;
            if flow_state == FlowState::Shut {
                self.rate = 0.0;
            }
            return change;
        }
        let error = change - self.rate;
        if flow_state == FlowState::Turned || is_above(absolute(error), noise) {
            self.steady_steps = 0;
        }
        let most = if flow_state == FlowState::Shut { usize::MAX } else { OPEN_STEPS };
        let steps = self.steady_steps.min(most);
        let (value, rate) = shares(steps);
        let followed = self.rate + value * error;
        self.rate += rate * error;
        self.steady_steps = steps.saturating_add(1);
        followed
    }
}

/// Continues at a rate, but not beyond the wide code of half-width `half` whose middle differs by `change` from the
/// last value.
pub fn on_within(rate: f32, change: f32, half: f32) -> f32 {
    limit(rate, change - half, change + half)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Value after each step, for readings with noise of 1.
    fn follow(
        readings: impl Iterator<Item = f32>,
        flow_state: impl Fn(usize) -> FlowState,
    ) -> Vec<f32> {
        let (mut value, mut trend) = (0.0, Trend::REST);
        readings
            .enumerate()
            .map(|(i, reading)| {
                value += trend.step(reading - value, Uncertainty::Noise(4.0), flow_state(i));
                value
            })
            .collect()
    }

    /// Pseudo-random numbers between -1.7 and 1.7 with deviation 1 (Numerical Recipes' generator).
    fn noise() -> impl Iterator<Item = f32> {
        let mut state = 1_u32;
        core::iter::from_fn(move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Some(((state >> 8) as f32 / 8_388_608.0 - 1.0) * 1.732)
        })
    }

    fn rms(errors: impl Iterator<Item = f32>) -> f32 {
        let (sum, count) = errors.fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
        (sum / count as f32).sqrt()
    }

    #[test]
    fn a_straight_line_is_averaged_and_longer_while_shut() {
        let line = |i: usize| 3.0 * i as f32;
        for (flow_state, from, bounds) in
            [(FlowState::Open, 20, 0.3..0.55), (FlowState::Shut, 1000, 0.05..0.15)]
        {
            let values = follow((0..5000).zip(noise()).map(|(i, n)| line(i) + n), |_| flow_state);
            let left = rms(values.iter().enumerate().skip(from).map(|(i, v)| v - line(i)));
            assert!(bounds.contains(&left), "{flow_state:?} {left}");
        }
    }

    #[test]
    fn what_comes_to_rest_while_shut_is_followed() {
        // By thirty times the noise, with a time constant of 0.2 s, as gas relaxes at the wall.
        let rest = |i: usize| 30.0 * (-(i as f32) / 200.0).exp();
        let values = follow((0..3000).map(rest), |_| FlowState::Shut);
        let worst = values.iter().enumerate().map(|(i, v)| (v - rest(i)).abs()).fold(0.0, f32::max);
        assert!((0.5..2.0).contains(&worst), "{worst}");
    }

    #[test]
    fn a_turn_is_followed_where_it_is_told_and_where_it_shows() {
        let corner = |i: usize| (i as f32 - 50.0).max(0.0);
        for (slope, known) in [(2.0, true), (8.0, false)] {
            let values = follow((0..100).map(|i| slope * corner(i)), |i| {
                if known && i == 51 { FlowState::Turned } else { FlowState::Open }
            });
            let worst = values
                .iter()
                .enumerate()
                .map(|(i, value)| (value - slope * corner(i)).abs())
                .fold(0.0, f32::max);
            assert!(worst < 1e-3, "{worst}");
        }
        // Neither announced nor beyond the noise: smeared, by less than the noise.
        let values = follow((0..100).map(corner), |_| FlowState::Open);
        let worst =
            values.iter().enumerate().map(|(i, v)| (v - corner(i)).abs()).fold(0.0, f32::max);
        assert!((1.0..4.0).contains(&worst), "{worst}");
    }

    #[test]
    fn a_reading_at_the_edge_of_a_wide_code_is_no_motion() {
        let mut trend = Trend::REST;
        for _ in 0..100 {
            assert_eq!(trend.step(0.0, Uncertainty::WideCode(40.0), FlowState::Shut), 0.0);
        }
        // A few noisy readings appear beyond the edge.
        for beyond in [&[41.0][..], &[43.0, 41.0], &[41.0, 40.2, 41.5]] {
            let (mut trend, mut value) = (trend, 0.0);
            for reading in beyond {
                value += trend.step(reading - value, Uncertainty::Noise(4.0), FlowState::Shut);
            }
            for _ in 0..200 {
                value += trend.step(-value, Uncertainty::WideCode(40.0), FlowState::Shut);
            }
            assert!((35.0..=40.0).contains(&value), "{value} after {beyond:?}");
        }
    }

    #[test]
    fn within_a_wide_code_it_goes_on() {
        let mut trend = Trend::REST;
        for _ in 0..200 {
            trend.step(2.0, Uncertainty::Noise(1.0), FlowState::Open);
        }
        assert!((trend.step(5.0, Uncertainty::WideCode(4.0), FlowState::Open) - 2.0).abs() < 1e-3);
        assert_eq!(
            trend.step(9.0, Uncertainty::WideCode(4.0), FlowState::Open),
            5.0,
            "to its edge"
        );
        assert_eq!(trend.step(-9.0, Uncertainty::WideCode(4.0), FlowState::Open), -5.0);
        // Without flow it comes to rest: its 2 per step shrink by 1/32 of themselves, 64 in all.
        let mut way = 0.0;
        for _ in 0..2000 {
            way += trend.step(-way, Uncertainty::WideCode(1000.0), FlowState::Shut);
        }
        assert!((60.0..65.0).contains(&way), "{way}");
    }
}
