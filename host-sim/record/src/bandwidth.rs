//! Bandwidth of the loop, from a chirp of the set point.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};
use thermyo_compute::math;
use thermyo_scenario::Chirp;

/// Gain at the end of the bandwidth, -3 dB.
const LEAST_GAIN: f64 = FRAC_1_SQRT_2;

/// Gains of the whole cycles of a chirp, in constant memory.
#[derive(Debug, Clone)]
pub(crate) struct Bandwidth {
    chirp: Chirp,
    /// Set point about which the chirp swings.
    middle: f64,
    /// Number and start \[s\] of the present cycle.
    cycle: Option<(f64, f64)>,
    /// Whether the present cycle began before the first row.
    partial: bool,
    before_rad: f64,
    /// Sums of set point and value with sine and cosine.
    sums: [[f64; 2]; 2],
    ended: bool,
    hz: Option<f64>,
}

impl Bandwidth {
    pub(crate) fn new((chirp, middle): (Chirp, f64)) -> Self {
        Self {
            chirp,
            middle,
            cycle: None,
            partial: true,
            before_rad: 0.0,
            sums: [[0.0; 2]; 2],
            ended: false,
            hz: None,
        }
    }

    pub(crate) fn add(&mut self, time_s: f64, values: [f64; 2]) {
        let angle_rad = self.chirp.angle(time_s);
        let number = (angle_rad / TAU + 1e-9).floor();
        match self.cycle {
            Some((before, _)) if number == before => (),
            Some((before, start_s)) => {
                self.end_cycle((number - before) / (time_s - start_s));
                self.cycle = Some((number, time_s));
            }
            None => self.cycle = Some((number, time_s)),
        }
        // The frequency rises within a cycle: rows at its end count for more of its angle.
        let weight = angle_rad - self.before_rad;
        self.before_rad = angle_rad;
        let parts = [math::sin(angle_rad), math::cos(angle_rad)].map(|part| weight * part);
        for (sums, value) in self.sums.iter_mut().zip(values) {
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += (value - self.middle) * part;
            }
        }
    }

    fn end_cycle(&mut self, hz: f64) {
        let [set_point, value] =
            std::mem::take(&mut self.sums).map(|[sin, cos]| math::hypot(sin, cos));
        if std::mem::take(&mut self.partial) {
            return;
        }
        self.ended |= set_point == 0.0 || value < LEAST_GAIN * set_point;
        if !self.ended {
            self.hz = Some(hz);
        }
    }

    /// Frequency of the last cycle before the first one with a gain below -3 dB \[Hz\]; none if there is no cycle before
    /// it.
    pub(crate) fn hz(&self) -> Option<f64> {
        self.hz
    }
}
