//! Explicit Runge-Kutta steps for systems whose size is known at compile time.

use std::array::from_fn;
use thermyo_compute::math;

/// One classical fourth-order Runge-Kutta step of an autonomous system.
pub fn rk4<const N: usize>(
    state: &[f64; N],
    step: f64,
    mut rates: impl FnMut(&[f64; N]) -> [f64; N],
) -> [f64; N] {
    let half = 0.5 * step;
    let k1 = rates(state);
    let k2 = rates(&from_fn(|i| state[i] + half * k1[i]));
    let k3 = rates(&from_fn(|i| state[i] + half * k2[i]));
    let k4 = rates(&from_fn(|i| state[i] + step * k3[i]));
    from_fn(|i| state[i] + step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]))
}

/// The classical fourth-order step for a system whose size is known only at run time.
#[derive(Debug, Clone)]
pub struct Rk4 {
    rates: [Vec<f64>; 4],
    trial: Vec<f64>,
}

impl Rk4 {
    pub fn new(states: usize) -> Self {
        let zeros = vec![0.0; states];
        Self { rates: from_fn(|_| zeros.clone()), trial: zeros }
    }

    /// The derivatives at the end of the last step.
    pub fn last_rates(&self) -> &[f64] {
        &self.rates[3]
    }

    /// Makes one step. `rates` gets the fraction of the step that has passed and the state there,
    /// and writes the derivatives into its last argument.
    pub fn step(
        &mut self,
        state: &mut [f64],
        step: f64,
        mut rates: impl FnMut(f64, &[f64], &mut [f64]),
    ) {
        let Self { rates: [k1, k2, k3, k4], trial } = self;
        rates(0.0, state, k1);
        ahead(trial, state, 0.5 * step, k1);
        rates(0.5, trial, k2);
        ahead(trial, state, 0.5 * step, k2);
        rates(0.5, trial, k3);
        ahead(trial, state, step, k3);
        rates(1.0, trial, k4);
        let sixth = step / 6.0;
        let stages = k1.iter().zip(k2.iter()).zip(k3.iter()).zip(k4.iter());
        for (y, (((k1, k2), k3), k4)) in state.iter_mut().zip(stages) {
            *y += sixth * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
    }
}

/// State after this time at these rates.
fn ahead(trial: &mut [f64], state: &[f64], step: f64, rates: &[f64]) {
    for ((trial, y), rate) in trial.iter_mut().zip(state).zip(rates) {
        *trial = y + step * rate;
    }
}

/// Dormand and Prince's pair of order 5(4) (J. Comp. Appl. Math. 6, 1980) with step control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DormandPrince {
    tolerance: f64,
    /// The step to try next.
    step: f64,
}

/// The step control found no step that meets its tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepTooSmall;

impl DormandPrince {
    /// Solver with this relative tolerance and first step.
    pub fn new(tolerance: f64, first_step: f64) -> Self {
        Self { tolerance, step: first_step }
    }

    /// Advances `state` from `start` to `end`; the first `CONTROLLED` components are held to the
    /// tolerance, relative to `scales`.
    ///
    /// # Errors
    /// [`StepTooSmall`] when rounding is coarser than the required step, or the state is not
    /// finite.
    pub fn advance<const CONTROLLED: usize, const N: usize>(
        &mut self,
        start: f64,
        end: f64,
        state: &mut [f64; N],
        scales: [f64; CONTROLLED],
        mut rates: impl FnMut(f64, &[f64; N]) -> [f64; N],
    ) -> Result<(), StepTooSmall> {
        let mut time = start;
        let mut first = rates(time, state);
        while time < end {
            let remaining = end - time;
            let last = self.step >= remaining;
            let h = self.step.min(remaining);
            let Trial { next, rates: at_end, error } =
                Trial::new(time, h, state, &first, &mut rates);
            let error = (0..CONTROLLED)
                .map(|i| (error[i] / scales[i]).abs())
                // `f64::max` would drop a NaN.
                .fold(0.0, |worst, e| if e <= worst { worst } else { e })
                / self.tolerance;
            let accepted = error <= 1.0;
            let factor = if error.is_finite() {
                (0.9 * math::pow(error.max(1e-10), -0.2)).clamp(0.2, 5.0)
            } else {
                0.2
            };
            if accepted {
                time = if last { end } else { time + h };
                *state = next;
                first = at_end;
                // A step cut short by `end` is no reason to reject the longer one.
                self.step = if last { self.step.max(h * factor) } else { h * factor };
            } else {
                self.step = h * factor;
                if self.step < 1e-14 * end.abs().max(1e-6) {
                    return Err(StepTooSmall);
                }
            }
        }
        Ok(())
    }
}

/// One step of the pair, not yet accepted.
struct Trial<const N: usize> {
    next: [f64; N],
    /// Rates at the end of the step.
    rates: [f64; N],
    /// Difference between the two orders.
    error: [f64; N],
}

impl<const N: usize> Trial<N> {
    /// Tries a step of `h` from this state and its rates.
    fn new(
        time: f64,
        h: f64,
        y: &[f64; N],
        k1: &[f64; N],
        rates: &mut impl FnMut(f64, &[f64; N]) -> [f64; N],
    ) -> Self {
        let k2 = rates(time + h / 5.0, &from_fn(|i| y[i] + h * k1[i] / 5.0));
        let k3 = rates(time + 0.3 * h, &from_fn(|i| y[i] + h * (3.0 * k1[i] + 9.0 * k2[i]) / 40.0));
        let k4 = rates(
            time + 0.8 * h,
            &from_fn(|i| {
                y[i] + h * (44.0 / 45.0 * k1[i] - 56.0 / 15.0 * k2[i] + 32.0 / 9.0 * k3[i])
            }),
        );
        let k5 = rates(
            time + 8.0 / 9.0 * h,
            &from_fn(|i| {
                y[i] + h
                    * (19372.0 / 6561.0 * k1[i] - 25360.0 / 2187.0 * k2[i]
                        + 64448.0 / 6561.0 * k3[i]
                        - 212.0 / 729.0 * k4[i])
            }),
        );
        let k6 = rates(
            time + h,
            &from_fn(|i| {
                y[i] + h
                    * (9017.0 / 3168.0 * k1[i] - 355.0 / 33.0 * k2[i]
                        + 46732.0 / 5247.0 * k3[i]
                        + 49.0 / 176.0 * k4[i]
                        - 5103.0 / 18656.0 * k5[i])
            }),
        );
        let next: [f64; N] = from_fn(|i| {
            y[i] + h
                * (35.0 / 384.0 * k1[i] + 500.0 / 1113.0 * k3[i] + 125.0 / 192.0 * k4[i]
                    - 2187.0 / 6784.0 * k5[i]
                    + 11.0 / 84.0 * k6[i])
        });
        let k7 = rates(time + h, &next);
        let error = from_fn(|i| {
            h * (71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] + 71.0 / 1920.0 * k4[i]
                - 17253.0 / 339_200.0 * k5[i]
                + 22.0 / 525.0 * k6[i]
                - 1.0 / 40.0 * k7[i])
        });
        Self { next, rates: k7, error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::LN_2;

    #[test]
    fn rk4_is_of_fourth_order() {
        let error = |steps: u32| {
            let h = 1.0 / f64::from(steps);
            let y = (0..steps).fold([1.0], |y, _| rk4(&y, h, |y| [-y[0] * y[0]]));
            (y[0] - 0.5).abs()
        };
        let order = math::log(error(20) / error(40)) / LN_2;
        assert!((3.8..4.2).contains(&order), "{order}");
    }

    #[test]
    fn both_forms_of_rk4_agree() {
        let mut state = [1.0, 2.0];
        let fixed = rk4(&state, 0.1, |y| [-y[0] * y[1], y[0]]);
        Rk4::new(2).step(&mut state, 0.1, |_, y, rates| {
            rates[0] = -y[0] * y[1];
            rates[1] = y[0];
        });
        assert!((state[0] - fixed[0]).abs() < 1e-15 && (state[1] - fixed[1]).abs() < 1e-15);
    }

    #[test]
    fn the_pair_keeps_its_tolerance() {
        let mut state = [1.0, 1.0];
        let mut pair = DormandPrince::new(1e-11, 0.1);
        pair.advance(0.0, 3.0, &mut state, [1e-2, 1.0], |t, y| [-y[0] * t, 2.0 * y[1]]).unwrap();
        assert!((state[0] / math::exp(-4.5) - 1.0).abs() < 1e-9);
        assert!((state[1] / math::exp(6.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_state_that_is_not_finite_is_an_error() {
        let mut pair = DormandPrince::new(1e-11, 0.1);
        let blow_up = pair.advance(0.0, 2.0, &mut [1.0], [1.0], |_, y| [y[0] * y[0]]);
        assert_eq!(blow_up, Err(StepTooSmall));
    }
}
