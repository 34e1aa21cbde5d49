//! The gas sensor's element in its housing, and whether its readings can be believed.

use super::{Coefficients, HOTTEST_K};
use crate::math::{absolute, exp, limit};
use crate::sensing::GasReading;

/// Below this difference, beside twice the stated deviation, the gas need not move its element \[K\].
const UNMOVED_K: f32 = 0.3;

/// The element: T_s' = (T_h - T_s)/tau, T_h' = (T - T_h)/tau_h.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    pub housing_k: f32,
    pub sensor_k: f32,
    /// Estimated lag tau \[s\].
    pub lag_s: f32,
    /// Last reading \[K\].
    pub reading_k: f32,
    /// Distance that the element must have moved in the intervals since the reading last changed \[K\].
    unmoved_k: f32,
    frozen: bool,
    /// Intervals for which a contradiction of readings and model is still reported.
    contradicted_intervals: u16,
    /// The sensor is the wrong one of the two: its readings correct nothing.
    distrusted: bool,
}

impl Element {
    /// An element at this temperature \[K\], of which no reading is known yet.
    pub fn new(temperature_k: f32, lag_s: f32) -> Self {
        Self {
            housing_k: temperature_k,
            sensor_k: temperature_k,
            lag_s,
            reading_k: temperature_k,
            unmoved_k: 0.0,
            frozen: false,
            contradicted_intervals: 0,
            distrusted: false,
        }
    }

    /// Sets housing and element to one temperature \[K\].
    pub fn set_temperature(&mut self, temperature_k: f32) {
        self.housing_k = temperature_k;
        self.sensor_k = temperature_k;
    }

    /// Starts to watch for a frozen reading from here.
    pub fn forget_standstill(&mut self) {
        self.unmoved_k = 0.0;
    }

    /// Moves the housing towards the gas around it \[K\].
    pub fn follow(&mut self, coefficients: &Coefficients, foil_k: f32) {
        let Coefficients { interval_s, housing_s, .. } = *coefficients;
        // Means over the interval on both sides: implicit Euler then delays by just the lag.
        self.housing_k += interval_s / (housing_s + interval_s) * (foil_k - self.housing_k);
    }

    /// Share of the difference between housing and element that an interval closes \[-\].
    pub fn lag_share(&self, interval_s: f32) -> f32 {
        interval_s / (self.lag_s + 0.5 * interval_s)
    }

    /// Moves the element towards its housing; the change \[K\].
    pub fn warm(&mut self, lag_share: f32) -> f32 {
        let change_k = lag_share * (self.housing_k - self.sensor_k);
        self.sensor_k += change_k;
        change_k
    }

    /// The interval's reading, unless it is a frozen one.
    pub fn judge(
        &mut self,
        coefficients: &Coefficients,
        gas: Option<GasReading>,
        lag_share: f32,
        gas_sd_k: f32,
    ) -> Option<GasReading> {
        let away_k = absolute(self.housing_k - self.reading_k) - UNMOVED_K - 2.0 * gas_sd_k;
        if gas.is_some_and(|gas| gas.moved) {
            self.unmoved_k = 0.0;
            self.frozen = false;
        } else {
            self.unmoved_k += lag_share * limit(away_k, 0.0, HOTTEST_K);
        }
        let reading = gas.filter(|_| !self.frozen);
        self.frozen |= self.unmoved_k > coefficients.frozen_k;
        self.contradicted_intervals = self.contradicted_intervals.saturating_sub(1);
        self.distrusted &= self.contradicted_intervals > 0;
        reading
    }

    /// Readings and model cannot both be right. Gas in a muscle returns to its surroundings within seconds, and so
    /// does the element: the one that is further from them is wrong. Whether that is the model.
    pub fn contradict(&mut self, coefficients: &Coefficients) -> bool {
        self.contradicted_intervals = coefficients.counts.ten_seconds_intervals;
        let ambient_k = coefficients.ambient.temperature_k;
        self.distrusted =
            absolute(self.reading_k - ambient_k) > absolute(self.sensor_k - ambient_k);
        !self.distrusted
    }

    pub fn distrusted(&self) -> bool {
        self.distrusted
    }

    /// Whether the reading may be a frozen one: a lag learnt from that would mean that nothing had to move.
    pub fn stands_still(&self) -> bool {
        self.unmoved_k > 0.0
    }

    pub fn implausible(&self) -> bool {
        self.frozen || self.contradicted_intervals > 0
    }

    /// Scales the lag by the exponential of a correction of its logarithm, within a factor of five of the
    /// configured one.
    pub fn correct_lag(&mut self, coefficients: &Coefficients, correction: f32) {
        self.lag_s = limit(
            self.lag_s * exp(limit(correction, -0.1, 0.1)),
            0.2 * coefficients.lag_s,
            5.0 * coefficients.lag_s,
        );
    }
}
