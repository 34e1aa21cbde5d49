//! The radial profile of still gas: pressure and mass give its mean, the wall takes its heat, and a foil may see its
//! axis.
//!
//! Gas in a long cylinder whose wall keeps T_w, with a source that is even over the section (compression), is a sum of
//! modes J0(j_n r/R) that decay with j_n^2 a/R^2 (Carslaw and Jaeger, Conduction of Heat in Solids, 1959, chapter 7):
//!
//! ```text
//! dx_n/dt = s - p_n a/R^2 x_n,      T - T_w = sum of w_n x_n in the mean, of g_n x_n at radius r
//! p_n = j_n^2,  w_n = 4/j_n^2,  g_n = 2 J0(j_n r/R)/(j_n J1(j_n))
//! ```
//!
//! Two modes are exact. In the mean, one more stands for all others: its weight is what remains of 1, and its rate the
//! one at which a steady source meets Nu = 8, sum of w_n/p_n = 1/8. At the foil, another one does: there the weights
//! alternate, and a steady source meets (1 - r^2/R^2)/4 on the axis. For strokes of 2 to 20 s in bores of 10 to 30 mm
//! the mean swings within 2 % of the exact solution, and the axis within 4 %.
//!
//! The state is y_n = x_n less the mean, in which the source cancels; in the zones two numbers are enough, because the
//! weighted sum of all is 0.

use super::per_zone::{PerZone, ZONES};
use crate::math::limit;
use crate::physics::gas::Gas;

/// p_n of the first two modes, and of the modes that stand for the others: in the mean, and at the foil.
const RATES: [f32; 4] = [5.783_186, 30.471_26, 162.84, 58.6];
/// w_n of the first two modes, and of all others.
const MEAN: [f32; 3] = [0.691_660, 0.131_271, 0.177_069];
/// 2/(j_n J1(j_n)): g_n on the axis.
const AXIS: [f32; 2] = [1.601_975, -1.064_799];
/// Nusselt number of a steady source.
const STEADY: f32 = 8.0;
/// Conduction with the profile formed by a persistent error, over conduction with the profile of a decaying error.
pub const SETTLED_CONDUCTION: f32 = STEADY / RATES[0];
/// Profile under a persistent error of the mean: all p_n x_n are then equal.
const SETTLED: [f32; 4] = [
    STEADY / RATES[0] - 1.0,
    STEADY / RATES[1] - 1.0,
    STEADY / RATES[2] - 1.0,
    STEADY / RATES[3] - 1.0,
];

/// Constants of a configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficient {
    /// Whether there is a profile.
    pub exists: bool,
    /// cp D/4 \[J m/(kg K)\].
    capacity: f32,
    /// g_n of the foil.
    foil: [f32; 3],
}

impl Coefficient {
    #[cold]
    pub fn new(bore_m: f32, radius: f32, gas: &Gas) -> Self {
        let [first, second, ..] = RATES.map(|rate| bessel_j0(rate * radius * radius));
        let [a, b] = AXIS;
        let (first, second) = (a * first, b * second);
        Self {
            exists: bore_m > 0.0,
            capacity: 0.25 * bore_m * gas.cp_j_kg_k(),
            foil: [first, second, 1.0 - first - second],
        }
    }

    /// Difference of the gas at the foil from the mean, per persistent error of the mean \[-\].
    pub fn foil_settled(&self) -> f32 {
        if self.exists { at_foil(&self.foil, &SETTLED) } else { 0.0 }
    }
}

/// J0 of the square root of `square`, from its series.
fn bessel_j0(square: f32) -> f32 {
    let (mut term, mut total) = (1.0, 1.0);
    for k in 1..16_u8 {
        let k = f32::from(k);
        term *= -0.25 * square / (k * k);
        total += term;
    }
    total
}

fn sum(weights: &[f32; 3], values: &[f32; 3]) -> f32 {
    let ([a, b, c], [x, y, z]) = (weights, values);
    a * x + b * y + c * z
}

/// Mean of the modes.
fn mean(values: &[f32; 4]) -> f32 {
    let [x, y, z, _] = *values;
    sum(&MEAN, &[x, y, z])
}

/// Sum of the modes at the foil, for its weights.
fn at_foil(weights: &[f32; 3], values: &[f32; 4]) -> f32 {
    let [x, y, _, z] = *values;
    sum(weights, &[x, y, z])
}

/// First two modes of a zone's profile, less the mean \[K\].
pub type Modes = [f32; 2];

/// Conduction in one zone over one movement of the zones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conduction {
    /// Shares of the modes that remain \[-\].
    left: [f32; 4],
    /// Heat that leaves the zone per kelvin of its mean, and per kelvin of each mode \[J/K\].
    pub per_k: f32,
    per_mode_k: Modes,
}

impl Conduction {
    /// Conduction without a profile.
    pub fn even(per_k: f32) -> Self {
        Self { per_k, ..Self::default() }
    }

    /// Conduction that gives off `formed_j_k` \[J/K\] once the profile has formed, from gas of this density \[kg/m3\]
    /// and surface \[m2\].
    pub fn new(c: &Coefficient, formed_j_k: f32, density_kg_m3: f32, surface_m2: f32) -> Self {
        const PER_FIRST: f32 = 1.0 / RATES[0];
        const SECOND: f32 = RATES[1] * PER_FIRST;
        const OTHERS: f32 = RATES[2] * PER_FIRST;
        const AT_FOIL: f32 = RATES[3] * PER_FIRST;
        const MOST: f32 = 20.0;
        let capacity_j_k = c.capacity * density_kg_m3 * surface_m2;
        let first = limit(formed_j_k / capacity_j_k, 0.0, MOST);
        // 1/e^x to second order, with one division for all.
        let grow = |rate: f32| {
            let x = rate * first;
            1.0 + x * (1.0 + 0.5 * x)
        };
        let (a, b, c, d) = (grow(1.0), grow(SECOND), grow(OTHERS), grow(AT_FOIL));
        let (ab, cd) = (a * b, c * d);
        let inverse = 1.0 / (ab * cd);
        let (of_first, of_last) = (cd * inverse, ab * inverse);
        let left = [b * of_first, a * of_first, d * of_last, c * of_last];
        let ([slow, second, fast, _], [first, other, _]) = (left, MEAN);
        Self {
            left,
            per_k: capacity_j_k * (1.0 - mean(&left)),
            per_mode_k: [
                capacity_j_k * first * (fast - slow),
                capacity_j_k * other * (fast - second),
            ],
        }
    }

    /// Returns the conduction at a foil that averages over the zones with these weights.
    pub fn seen(zones: &[Self; ZONES], weights: &PerZone) -> Self {
        let mut seen = Self::default();
        for (zone, weight) in zones.iter().zip(weights) {
            for (sum, left) in seen.left.iter_mut().zip(zone.left) {
                *sum += weight * left;
            }
        }
        seen
    }

    /// Heat that the profile adds to that of an even zone \[J\].
    pub fn profile_j(&self, modes_k: &Modes) -> f32 {
        let ([x, y], [per_x, per_y]) = (modes_k, self.per_mode_k);
        per_x * x + per_y * y
    }

    /// Returns a zone's profile after this movement in gas whose mean is `mean_k` above the wall \[K\].
    pub fn advance(&self, modes_k: &Modes, mean_k: f32) -> Modes {
        let ([x, y], [slow, second, fast, _], [first, other, _]) = (*modes_k, self.left, MEAN);
        let less_k =
            mean(&self.left) * mean_k + first * (slow - fast) * x + other * (second - fast) * y;
        [slow * (mean_k + x) - less_k, second * (mean_k + y) - less_k].map(sound)
    }
}

/// Profile of a zone after a correction of its mean by `excess_k` \[K\].
pub fn corrected(modes_k: &Modes, excess_k: f32) -> Modes {
    let ([x, y], [first, second, ..]) = (modes_k, SETTLED);
    [x + first * excess_k, y + second * excess_k]
}

fn sound(k: f32) -> f32 {
    limit(k, -1.0e3, 1.0e3)
}

/// y_n around the foil \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Profile([f32; 4]);

impl Profile {
    /// Advances the profile by one movement in gas whose mean is `mean_k` above the wall \[K\].
    pub fn advance(&mut self, conduction: &Conduction, mean_k: f32) {
        let mut modes_k = self.0;
        for (mode_k, left) in modes_k.iter_mut().zip(conduction.left) {
            *mode_k = left * (mean_k + *mode_k);
        }
        let mean_k = mean(&modes_k);
        self.0 = modes_k.map(|mode_k| sound(mode_k - mean_k));
    }

    /// Corrects the profile for a mean that was wrong by `mean_k` \[K\].
    pub fn correct(&mut self, mean_k: f32) {
        for (y, share) in self.0.iter_mut().zip(SETTLED) {
            *y += share * mean_k;
        }
    }

    /// Difference of the gas at the foil from the mean \[K\].
    pub fn foil_k(&self, c: &Coefficient) -> f32 {
        at_foil(&c.foil, &self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Step of the zones \[s\], and a gas whose cp D/4 is one.
    const STEP_S: f64 = 0.01;

    /// Swing of mean and axis in a cylinder of this a/R^2 \[1/s\] while a source of one kelvin swings with this period
    /// \[s\]: in phase with the source, and ahead of it.
    fn simulated(diffusion_per_s: f64, period_s: f64) -> [[f64; 2]; 2] {
        let gas = Gas::default();
        let c = Coefficient::new(4.0 / gas.cp_j_kg_k(), 0.0, &gas);
        let formed = f64::from(RATES[0]) * diffusion_per_s * STEP_S;
        let conduction = Conduction::new(&c, formed as f32, 1.0, 1.0);
        let (mut zone, mut foil, mut mean_k) = ([0.0; 2], Profile::default(), 0.0_f32);
        let steps = (period_s / STEP_S).round() as usize;
        let cycles = 3 + (8.0 / (formed * steps as f64)) as usize;
        let mut swings = [[0.0; 2]; 2];
        for i in 0..cycles * steps {
            let phase = |i: usize| core::f64::consts::TAU * i as f64 / steps as f64;
            let source = (phase(i + 1).sin() - phase(i).sin()) as f32;
            let during_k = mean_k + 0.5 * source;
            mean_k += source - conduction.per_k * during_k - conduction.profile_j(&zone);
            zone = conduction.advance(&zone, during_k);
            foil.advance(&conduction, during_k);
            if i >= (cycles - 1) * steps {
                let axis_k = mean_k + foil.foil_k(&c);
                for (swing, value) in swings.iter_mut().zip([mean_k, axis_k]) {
                    let value = 2.0 / steps as f64 * f64::from(value);
                    swing[0] += value * phase(i + 1).sin();
                    swing[1] += value * phase(i + 1).cos();
                }
            }
        }
        swings
    }

    /// The exact solution of Carslaw and Jaeger as a sum over 4000 modes, whose roots j_n are McMahon's.
    fn exact(diffusion_per_s: f64, period_s: f64) -> [[f64; 2]; 2] {
        let w = core::f64::consts::TAU / period_s;
        let mut sums = [[0.0; 2]; 2];
        for n in 1..=4000 {
            let beta = (f64::from(n) - 0.25) * core::f64::consts::PI;
            let e = 8.0 * beta;
            let j = beta + 1.0 / e - 124.0 / (3.0 * e.powi(3)) + 120_928.0 / (15.0 * e.powi(5));
            let rate = j * j * diffusion_per_s;
            // i w/(i w + rate).
            let [real, imaginary] = [w * w, w * rate].map(|x| x / (w * w + rate * rate));
            // |J1| at a root of J0, with alternating signs.
            let j1 = (2.0 / (core::f64::consts::PI * j)).sqrt() * (1.0 + 3.0 / (16.0 * j * j));
            let axis = 2.0 / (j * j1) * if n % 2 == 1 { 1.0 } else { -1.0 };
            // The sum over the axis' weights alternates: its last term counts half.
            let axis = if n == 4000 { 0.5 * axis } else { axis };
            for (sum, weight) in sums.iter_mut().zip([4.0 / (j * j), axis]) {
                sum[0] += weight * real;
                sum[1] += weight * imaginary;
            }
        }
        sums
    }

    /// Bore of 20 mm at 2 bar, a = 1.1e-5 m2/s, and about half and three times as much.
    #[test]
    fn strokes_meet_the_exact_solution() {
        let mut worst = [0.0_f64; 2];
        for diffusion_per_s in [0.05, 0.11, 0.3] {
            for period_s in [2.0, 5.0, 20.0] {
                let ours = simulated(diffusion_per_s, period_s);
                let exact = exact(diffusion_per_s, period_s);
                for (worst, (ours, exact)) in worst.iter_mut().zip(ours.iter().zip(exact)) {
                    let off = (ours[0] - exact[0]).hypot(ours[1] - exact[1]);
                    *worst = worst.max(off / exact[0].hypot(exact[1]));
                }
            }
        }
        assert!((0.005..0.025).contains(&worst[0]), "mean: {worst:?}");
        assert!((0.005..0.04).contains(&worst[1]), "axis: {worst:?}");
    }

    #[test]
    fn a_profile_that_stays_is_one_of_a_steady_source() {
        assert!(mean(&SETTLED).abs() < 1e-3);
        let gas = Gas::default();
        // T - T_w is 2 (1 - r^2) of its mean.
        for (radius, gain) in [(0.0, 2.0), (0.5, 1.5), (0.7, 1.02)] {
            let settled = 1.0 + Coefficient::new(0.02, radius, &gas).foil_settled();
            assert!((settled - gain).abs() < 0.05, "{radius}: {settled}");
        }
    }
}
