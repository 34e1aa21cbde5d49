//! The radial profile of still gas in a cylinder.
//!
//! Where conduction carries the heat, the gas near the wall follows the wall and the gas on the axis follows the
//! adiabat: on the axis the temperature swings up to twice as much as in the mean, and later. With x = T - T_w, the
//! diffusivity a, the radius R, and the rate s that compression or expansion adds, uniform over the section because
//! pressure is:
//!
//! ```text
//! dx/dt = a (1/r) d/dr (r dx/dr) + s,  x = 0 at r = R
//! x(r)  = sum over n of g_n(r/R) x_n,  dx_n/dt = - p_n a/R^2 x_n + s     exact: p_n = j0n^2, infinitely many
//! ```
//!
//! Here three modes stand for all. Their [`RATES`] and weights are fitted to the exact solution for a periodic s of
//! angular frequency w,
//!
//! ```text
//! x/x_adiabatic = 1 - I0(z r/R)/I0(z),  mean: 1 - 2 I1(z)/(z I0(z)),  z^2 = i w R^2/a
//! ```
//!
//! (Carslaw and Jaeger, Conduction of Heat in Solids, 1959, chapter 7), over w R^2/a from 0.5 to 1000, the range of
//! strokes of 1 to 20 s in bores of 10 to 40 mm at 1.2 to 7 bar: within 5 % in the mean and up to 0.7 R from the axis.
//!
//! The plant computes the mean of x from pressure and mass. The profile adds the differences y_n = x_n - mean, in which
//! s cancels: their weighted sum stays 0, so that they move heat within the gas and affect no balance.
//!
//! Buoyancy is treated as a conductivity that is larger by the ratio of the Nusselt numbers. Stirring passes heat in
//! parallel with conduction; the profile is then flat in the share that it passes. That neither changes the modes is an
//! assumption.

/// p_n: the first is exact, j01^2.
const RATES: [f64; 3] = [5.783_186, 24.531_276, 195.976_772];
/// Weights of the modes in the mean; their sum is 1.
const MEAN: [f64; 3] = [0.683_479, 0.141_885, 0.174_636];
/// Weights of the modes at a radius over R; in between they are linear in its square. Their sum is 1, except on the
/// wall.
const AT_RADIUS: [(f64, [f64; 3]); 9] = [
    (0.0, [1.5469, -0.6132, 0.0663]),
    (0.25, [1.4775, -0.5125, 0.0350]),
    (0.4, [1.3182, -0.3003, -0.0179]),
    (0.5, [1.1483, -0.0903, -0.0580]),
    (0.6, [0.9172, 0.1765, -0.0937]),
    (0.7, [0.6033, 0.4976, -0.1009]),
    (0.8, [0.3213, 0.6418, 0.0369]),
    (0.9, [0.1542, 0.3545, 0.4913]),
    (1.0, [0.0, 0.0, 0.0]),
];

/// The profile in one zone: y_n \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Profile([f64; 3]);

/// Conduction over a time step, by mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conduction {
    /// Remaining share of x_n.
    left: [f64; 3],
}

fn sum(weights: &[f64; 3], values: &[f64; 3]) -> f64 {
    weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2]
}

impl Conduction {
    /// Conduction over a step of this Fourier number a dt/R^2.
    pub fn new(fourier: f64) -> Self {
        // e^-x to its second order, and still below 1 for long steps.
        let [a, b, c] = RATES.map(|rate| {
            let steps = rate * fourier;
            1.0 + steps * (1.0 + 0.5 * steps)
        });
        // One division for all three.
        let inverse = 1.0 / (a * b * c);
        Self { left: [b * c * inverse, a * c * inverse, a * b * inverse] }
    }

    /// Heat that the gas loses in the step, per its heat capacity \[K\]: a share of its mean, and a remainder of its
    /// profile.
    pub fn lost(&self, profile: &Profile) -> (f64, f64) {
        let lost = self.left.map(|left| 1.0 - left);
        let Profile(y) = profile;
        (sum(&MEAN, &lost), sum(&MEAN, &[lost[0] * y[0], lost[1] * y[1], lost[2] * y[2]]))
    }

    /// Advances the profile by the step, in gas whose mean is `mean_k` above the wall \[K\].
    pub fn advance(&self, profile: &mut Profile, mean_k: f64) {
        let Profile(y) = profile;
        for (y, left) in y.iter_mut().zip(self.left) {
            *y = left * (mean_k + *y);
        }
        let mean = sum(&MEAN, y);
        for y in y {
            *y -= mean;
        }
    }
}

/// Weights of the modes where a sensor sits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place([f64; 3]);

impl Place {
    /// Place at a radius over R, from 0 on the axis to 1 on the wall.
    pub fn at(radius: f64) -> Self {
        let square = radius * radius;
        let after = AT_RADIUS.iter().position(|(radius, _)| radius * radius >= square);
        let after = after.unwrap_or(AT_RADIUS.len() - 1).max(1);
        let [(from, before), (to, beyond)] = [AT_RADIUS[after - 1], AT_RADIUS[after]];
        let share = (square - from * from) / (to * to - from * from);
        Self([0, 1, 2].map(|n| before[n] + share * (beyond[n] - before[n])))
    }

    /// How much warmer than the mean the gas is there \[K\], where the mean is `mean_k` above the wall \[K\].
    pub fn above_mean(&self, profile: &Profile, mean_k: f64) -> f64 {
        let Profile(y) = profile;
        sum(&self.0, &y.map(|y| mean_k + y)) - mean_k
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;
    use thermyo_compute::math;

    type Complex = [f64; 2];

    fn times(a: Complex, b: Complex) -> Complex {
        [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
    }

    fn over(a: Complex, b: Complex) -> Complex {
        let norm = b[0] * b[0] + b[1] * b[1];
        let product = times(a, [b[0], -b[1]]);
        [product[0] / norm, product[1] / norm]
    }

    /// I0(z) and 2 I1(z)/z of z^2 = i q, from their series in z^2/4: every term is a power of i times a number.
    fn bessel(q: f64) -> [Complex; 2] {
        let mut sums = [[0.0; 2]; 2];
        let mut term: Complex = [1.0, 0.0];
        for k in 0..200 {
            let k = f64::from(k);
            for (sum, divisor) in sums.iter_mut().zip([1.0, k + 1.0]) {
                *sum = [sum[0] + term[0] / divisor, sum[1] + term[1] / divisor];
            }
            term = times(term, [0.0, 0.25 * q / ((k + 1.0) * (k + 1.0))]);
        }
        sums
    }

    fn one_less(a: Complex) -> Complex {
        [1.0 - a[0], -a[1]]
    }

    /// Swing over the adiabatic swing, at q = w R^2/a: of the mean, and at a radius.
    fn exact(q: f64, radius: f64) -> [Complex; 2] {
        let [axis, mean] = bessel(q);
        [over(mean, axis), over(bessel(q * radius * radius)[0], axis)].map(one_less)
    }

    /// The same of the modes, in steps of 1 ms as in the plant.
    fn simulated(diffusivity: f64, bore_m: f64, period_s: f64, radius: f64) -> [Complex; 2] {
        const STEP_S: f64 = 1e-3;
        let fourier = 4.0 * diffusivity * STEP_S / (bore_m * bore_m);
        let (conduction, place) = (Conduction::new(fourier), Place::at(radius));
        let (mut profile, mut mean_k) = (Profile::default(), 0.0);
        let steps = (period_s / STEP_S).round() as usize;
        // From rest, until the slowest mode has decayed.
        let cycles = 3 + (8.0 / (5.78 * fourier * steps as f64)) as usize;
        let mut swings = [[0.0; 2]; 2];
        for i in 0..cycles * steps {
            let phase = 2.0 * PI * (i % steps) as f64 / steps as f64;
            let source = (math::sin(phase + 2.0 * PI / steps as f64) - math::sin(phase)) / 1.0;
            let (share, rest) = conduction.lost(&profile);
            // The plant's steps within 1 ms, over which the film is constant.
            for _ in 0..4 {
                mean_k += 0.25 * (source - share * mean_k - rest);
            }
            conduction.advance(&mut profile, mean_k);
            if i >= (cycles - 1) * steps {
                let here = phase + 2.0 * PI / steps as f64;
                let at = mean_k + place.above_mean(&profile, mean_k);
                for (swing, value) in swings.iter_mut().zip([mean_k, at]) {
                    // Projected on the sine: the part in phase, and the part that leads.
                    swing[0] += 2.0 / steps as f64 * value * math::sin(here);
                    swing[1] += 2.0 / steps as f64 * value * math::cos(here);
                }
            }
        }
        swings
    }

    /// Amplitude within 5 %, and phase within 5 % of a radian, of the exact periodic solution.
    #[test]
    fn strokes_meet_the_exact_solution() {
        let (mut worst, mut cases) = ([0.0_f64; 2], 0);
        for (bar, period_s) in
            [(1.2, 1.0), (3.0, 1.0), (3.0, 5.0), (3.0, 20.0), (7.0, 5.0), (7.0, 20.0)]
        {
            let diffusivity = 2.2e-5 / bar;
            for bore_m in [0.01, 0.02, 0.04] {
                for radius in [0.0, 0.5] {
                    let q = 2.0 * PI / period_s * 0.25 * bore_m * bore_m / diffusivity;
                    if !(0.5..1000.0).contains(&q) {
                        continue;
                    }
                    let ours = simulated(diffusivity, bore_m, period_s, radius);
                    for (i, (ours, exact)) in ours.into_iter().zip(exact(q, radius)).enumerate() {
                        let [real, imaginary] = over(ours, exact);
                        let amplitude = math::hypot(real, imaginary) - 1.0;
                        let phase = math::atan2(imaginary, real);
                        let off = amplitude.abs().max(phase.abs());
                        worst[i] = worst[i].max(off);
                        let case = format!("{bar} bar, {period_s} s, {bore_m} m, {radius}");
                        assert!(off < 0.05, "{case}: amplitude {amplitude}, phase {phase}");
                        cases += 1;
                    }
                }
            }
        }
        println!("worst {worst:?} of {cases}");
        assert!(cases > 50 && worst.iter().all(|off| *off > 0.005));
    }

    /// A case to check by hand: bore 20 mm, 3 bar, strokes of 5 s.
    #[test]
    fn the_axis_swings_more_than_the_mean_and_later() {
        let [mean, axis] = exact(2.0 * PI / 5.0 * 1e-4 / 7.3e-6, 0.0);
        let [ratio, ahead] = over(axis, mean);
        assert!((1.4..1.9).contains(&math::hypot(ratio, ahead)), "{ratio} {ahead}");
        assert!((-0.5..-0.2).contains(&math::atan2(ahead, ratio)), "{ratio} {ahead}");
    }

    #[test]
    fn weights_add_up_and_the_wall_is_the_wall() {
        assert!((MEAN.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let profile = Profile([1.0, -2.0, 3.0]);
        for i in 0..=100 {
            let radius = 0.01 * f64::from(i);
            let Place(weights) = Place::at(radius);
            let added = weights.iter().sum::<f64>();
            assert!((added - 1.0).abs() < 1e-12 || radius > 0.9, "{radius}: {added}");
        }
        assert!((Place::at(1.0).above_mean(&profile, 7.0) + 7.0).abs() < 1e-12);
    }

    /// Long steps neither overshoot nor create heat: the gas ends at the wall's temperature.
    #[test]
    fn any_step_is_stable() {
        for fourier in [1e-6, 1e-3, 0.1, 10.0, 1e6] {
            let conduction = Conduction::new(fourier);
            let (mut profile, mut mean_k) = (Profile::default(), 20.0);
            for _ in 0..100 {
                let before = mean_k;
                let (share, rest) = conduction.lost(&profile);
                mean_k -= share * mean_k + rest;
                assert!(mean_k <= before && mean_k > -1e-9, "{fourier}: {mean_k} after {before}");
                conduction.advance(&mut profile, mean_k);
            }
        }
    }
}
