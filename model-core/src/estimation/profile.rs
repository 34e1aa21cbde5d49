//! The radial profile of still gas: its mean is what pressure and mass tell, its wall what it gives heat to, its axis what
//! a foil may see.
//!
//! Gas in a long cylinder whose wall keeps T_w, with a source that is even over the section (compression), is a sum of
//! modes J0(j_n r/R) that decay with j_n^2 a/R^2 (Carslaw and Jaeger, Conduction of Heat in Solids, 1959, chapter 7):
//!
//! ```text
//! dx_n/dt = s - p_n a/R^2 x_n,      T - T_w = sum of w_n x_n in the mean, of g_n x_n at radius r
//! p_n = j_n^2,  w_n = 4/j_n^2,  g_n = 2 J0(j_n r/R)/(j_n J1(j_n))
//! ```
//!
//! A mode that stands for all that are left has the weight that is left of 1, and the rate with which a steady source
//! meets Nu = 8, sum of w_n/p_n = 1/8. Around the foil two modes are exact and the third stands for the others; in the
//! zones, where only the heat to the wall matters, one and one: that meets the exact periodic solution within 1 % for
//! strokes of seconds. Heat that leaves right after a change is so some ten times that of a profile that has formed.
//!
//! The state is y_n = x_n less the mean, in which the source cancels: sum of w_n y_n = 0.

use super::zones::{PerZone, plus, scaled};
use crate::math::limit;
use crate::physics::gas::Gas;

/// p_n of the three modes around the foil, and of the one that stands for all but the first.
const RATES: [f32; 3] = [5.783_186, 30.471_26, 164.2];
const OTHERS: f32 = 57.06;
/// w_n, and what is left beside the first.
const MEAN: [f32; 3] = [0.691_660, 0.131_271, 0.177_069];
const MEAN_OTHERS: f32 = 1.0 - MEAN[0];
/// 2/(j_n J1(j_n)): g_n on the axis.
const AXIS: [f32; 2] = [1.601_975, -1.064_799];
/// Nusselt number of a steady source.
const STEADY: f32 = 8.0;
/// Conduction with a profile that an error which stays has formed, over that of one that decays.
pub const SETTLED_CONDUCTION: f32 = STEADY / RATES[0];
/// What an error of the mean that stays makes of the profile: p_n x_n are then alike.
const SETTLED: [f32; 3] =
    [STEADY / RATES[0] - 1.0, STEADY / RATES[1] - 1.0, STEADY / RATES[2] - 1.0];

/// Fixed by the configuration.
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
        let [first, second, _] = RATES.map(|rate| bessel_j0(rate * radius * radius));
        let [a, b] = AXIS;
        let (first, second) = (a * first, b * second);
        Self {
            exists: bore_m > 0.0,
            capacity: 0.25 * bore_m * gas.cp_j_kg_k(),
            foil: [first, second, 1.0 - first - second],
        }
    }

    /// Difference of the gas at the foil from the mean, for an error of the mean that stays \[-\].
    pub fn foil_settled(&self) -> f32 {
        if self.exists { sum(&self.foil, &SETTLED) } else { 0.0 }
    }
}

/// J0 of the root of that square, from its series.
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

/// Conduction over one movement of the zones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conduction {
    /// Shares of the modes that are left \[-\].
    left: [f32; 3],
    /// Of all but the first \[-\].
    others_left: f32,
    /// Heat that leaves all zones per kelvin of their mean, and per kelvin of their profile \[J/K\].
    pub per_k: f32,
    pub per_profile_k: f32,
}

impl Conduction {
    /// Conduction that gives off `formed_j_k` \[J/K\] once the profile has formed, from gas of that density \[kg/m3\]
    /// and surface \[m2\].
    pub fn new(c: &Coefficient, formed_j_k: f32, density_kg_m3: f32, surface_m2: f32) -> Self {
        const PER_FIRST: f32 = 1.0 / RATES[0];
        const SHARES: [f32; 3] = [RATES[1] * PER_FIRST, RATES[2] * PER_FIRST, OTHERS * PER_FIRST];
        const MOST: f32 = 20.0;
        let capacity_j_k = c.capacity * density_kg_m3 * surface_m2;
        let first = limit(formed_j_k / capacity_j_k, 0.0, MOST);
        let [second, third, others] = SHARES.map(|share| share * first);
        // 1/e^x to its second order, with one division for all.
        let [a, b, c, d] = [first, second, third, others].map(|x| 1.0 + x * (1.0 + 0.5 * x));
        let (ab, cd) = (a * b, c * d);
        let inverse = 1.0 / (ab * cd);
        let left = [b * cd * inverse, a * cd * inverse, ab * d * inverse];
        let [slow, ..] = left;
        let fast = ab * c * inverse;
        Self {
            left,
            others_left: fast,
            per_k: capacity_j_k * (1.0 - MEAN[0] * slow - MEAN_OTHERS * fast),
            per_profile_k: capacity_j_k * MEAN[0] * (fast - slow),
        }
    }

    /// First mode of the zones' profiles, less their mean \[K\], after that in gas that is that much above the wall \[K\].
    pub fn advance(&self, profile_k: &PerZone, excess_k: &PerZone) -> PerZone {
        let ([slow, ..], fast) = (self.left, self.others_left);
        let kept = MEAN_OTHERS * slow + MEAN[0] * fast;
        let grown = scaled(excess_k, MEAN_OTHERS * (slow - fast));
        plus(&scaled(profile_k, kept), &grown).map(sound)
    }
}

/// First mode of the zones' profiles where the mean was wrong by that \[K\].
pub fn corrected(profile_k: &PerZone, excess_k: f32) -> PerZone {
    profile_k.map(|k| k + SETTLED[0] * excess_k)
}

fn sound(k: f32) -> f32 {
    limit(k, -1.0e3, 1.0e3)
}

/// y_n around the foil \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Profile([f32; 3]);

impl Profile {
    /// After that, in gas whose mean was that much above the wall \[K\].
    pub fn advance(&mut self, conduction: &Conduction, mean_k: f32) {
        let ([x, y, z], [p, q, r]) = (self.0, conduction.left);
        let [x, y, z] = [p * (mean_k + x), q * (mean_k + y), r * (mean_k + z)];
        let mean_k = sum(&MEAN, &[x, y, z]);
        self.0 = [x - mean_k, y - mean_k, z - mean_k].map(sound);
    }

    /// The mean was wrong by that \[K\], and the profile with it.
    pub fn correct(&mut self, mean_k: f32) {
        for (y, share) in self.0.iter_mut().zip(SETTLED) {
            *y += share * mean_k;
        }
    }

    /// Difference of the gas at the foil from the mean \[K\].
    pub fn foil_k(&self, c: &Coefficient) -> f32 {
        sum(&c.foil, &self.0)
    }
}
