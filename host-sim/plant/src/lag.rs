//! First-order lag of a sensor.

use thermyo_compute::math;

/// A first-order lag, integrated exactly for an input that is linear over the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    output: f64,
    input: f64,
    /// exp(-step/tau).
    decay: f64,
    /// tau/step (1 - exp(-step/tau)).
    ramp: f64,
}

impl Lag {
    /// A lag at rest at `initial`, for steps of `step_s`; a time constant of zero passes its input.
    pub fn new(time_constant_s: f64, step_s: f64, initial: f64) -> Self {
        let (decay, ramp) = if time_constant_s > 0.0 {
            let ratio = step_s / time_constant_s;
            (math::exp(-ratio), -math::expm1(-ratio) / ratio)
        } else {
            (0.0, 0.0)
        };
        Self { output: initial, input: initial, decay, ramp }
    }

    /// Changes the time constant, for steps of `step_s` from now on.
    pub fn set_time_constant(&mut self, time_constant_s: f64, step_s: f64) {
        self.retune(&Self::new(time_constant_s, step_s, self.output));
    }

    /// Takes over the time constant of another lag.
    pub fn retune(&mut self, other: &Self) {
        let Self { output, input, .. } = *self;
        *self = Self { output, input, ..*other };
    }

    /// Advances by one step, at the end of which the input is `input`; returns the output.
    pub fn advance(&mut self, input: f64) -> f64 {
        self.output = self.decay * self.output
            + (self.ramp - self.decay) * self.input
            + (1.0 - self.ramp) * input;
        self.input = input;
        self.output
    }

    pub fn output(&self) -> f64 {
        self.output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_a_ramp_exactly() {
        let (tau, step, slope) = (3.0, 0.5, 2.0);
        let mut lag = Lag::new(tau, step, 10.0);
        for i in 1..=20 {
            let t = step * f64::from(i);
            let output = lag.advance(10.0 + slope * t);
            let exact = 10.0 + slope * (t - tau * (1.0 - math::exp(-t / tau)));
            assert!((output - exact).abs() < 1e-12, "at {t} s: {output} for {exact}");
        }
    }

    #[test]
    fn without_a_time_constant_it_passes() {
        let mut lag = Lag::new(0.0, 0.1, 1.0);
        assert_eq!(lag.advance(7.0), 7.0);
    }
}
