//! The stated deviation of the gas temperature.
//!
//! It is the covariance, as far as readings and model disagree, the noise of one pressure, and what cannot be seen.
//!
//! A foil slower than a stroke sees the product of lag and scale, not each of them. Where one alone was configured
//! wrong, one alone is learnt; a change of both shows that neither is sure, and readings that agree prove nothing.
//!
//! The swing is the mean one and not that of this instant: errors return with the stroke, but not in its phase.

use super::Coefficients;
use crate::math::{absolute, limit, sqrt};

/// Variance of the gas temperature for a lag and a heat transfer that both are not the configured ones, in the
/// product of the relative changes of their time constants and squares of the swing \[-\].
const LEARNT: f32 = 1.3;
/// Such a product that is learnt where all is configured right \[-\].
const LEARNT_FLOOR: f32 = 5.0e-6;
/// Change of the lag that zones alone make, with all of their gas at the port \[-\].
const ZONES_LAG: f32 = 0.025;
/// Variance for readings that disagree as far as can be, in squares of the swing \[-\].
const DISAGREED: f32 = 2.2e-3;
/// Variance that zones leave, with all of their gas at the port: in squares of the swing \[-\] ...
const ZONES: f32 = 4.3e-4;
/// ... and where nothing swings \[K2\].
const ZONES_K2: f32 = 7.0e-3;
/// Share of the variance of one pressure that averaging does not reduce: the lag of its sensor \[-\].
const NOT_AVERAGED: f32 = 0.1;

/// Inputs of the stated deviation.
#[derive(Debug, Clone, Copy)]
pub struct Inputs {
    pub gas_k: f32,
    pub wall_k: f32,
    pub pressure_pa: f32,
    /// Share of the variance of one measured energy that averaging leaves \[-\].
    pub noise_left: f32,
    /// How far readings and model disagree, from 0 to 1.
    pub disagreement: f32,
    /// Estimated lag of the element \[s\].
    pub lag_s: f32,
    /// Estimated scale of the heat transfer \[-\].
    pub scale: f32,
    /// Variance of the relative error of the gas temperature \[-\].
    pub gas_gas: f32,
}

/// The stated deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Mean square of the gas temperature about the wall's, over some seconds \[K2\].
    pub swing_k2: f32,
    pub gas_sd_k: f32,
}

impl Deviation {
    /// Updates the stated deviation after an interval's correction.
    pub fn update(&mut self, coefficients: &Coefficients, now: &Inputs) {
        let noise = coefficients.pressure_sd_pa / now.pressure_pa;
        let left = now.noise_left + NOT_AVERAGED;
        let share = limit(coefficients.place * now.disagreement, 0.0, 1.0);
        let swing_k = now.gas_k - now.wall_k;
        self.swing_k2 += coefficients.swing_window * (swing_k * swing_k - self.swing_k2);
        let port = coefficients.tuning.port_cooling;
        let lag = absolute(now.lag_s * coefficients.per_lag_s - 1.0) - ZONES_LAG * port;
        let wall = absolute(1.0 / now.scale - 1.0);
        let both = limit(lag, 0.0, 1.0) * limit(wall, 0.0, 1.0);
        let learnt = LEARNT * limit(both - LEARNT_FLOOR, 0.0, 1.0);
        let swings = learnt + ZONES * port + DISAGREED * share;
        let unseen_k2 = swings * self.swing_k2 + ZONES_K2 * port;
        let per_gas = 1.0 / now.gas_k;
        let variance =
            share * share * now.gas_gas + left * noise * noise + unseen_k2 * per_gas * per_gas;
        self.gas_sd_k = now.gas_k * limit(sqrt(variance), 1.0e-6, 1.0);
    }
}
