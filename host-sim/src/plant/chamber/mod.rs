//! What moves with the gas: volume, force, surface over length, one file per kind. A vessel, whose
//! volume nothing but a profile changes, is a plant of its own.
//!
//! The signs are the core's: a force is positive where it pulls the ends together, a load where it pulls
//! them apart.

pub mod braid;

use std::fmt;

/// A gas volume between two ends that move.
pub trait Chamber: fmt::Debug + Copy + Send {
    /// Length that contraction counts from \[m\].
    fn rest_length(&self) -> f64;

    /// Lengths between which the equations hold, ends included where there is a stop \[m\].
    fn range(&self) -> [f64; 2];

    /// Lengths at which stops carry the load \[m\]; infinite where there is none.
    fn stops(&self) -> [f64; 2];

    /// Gas volume \[m3\].
    fn volume(&self, length: f64) -> f64;

    /// Force per gauge pressure, -dV/dL \[m2\]; positive: pressure pulls the ends together.
    fn force_area(&self, length: f64) -> f64;

    /// Slope of [`Self::force_area`] over length \[m\].
    fn force_area_slope(&self, length: f64) -> f64;

    /// Force without gauge pressure \[N\].
    fn elastic(&self, length: f64) -> f64;

    /// Slope of [`Self::elastic`] over length \[N/m\].
    fn elastic_slope(&self, length: f64) -> f64;

    /// Surface that the gas exchanges heat with \[m2\].
    fn surface(&self, length: f64) -> f64;

    /// Diameter of the gas \[m\].
    fn diameter(&self, length: f64) -> f64;

    /// Length of the gas from port to closed end \[m\].
    fn gas_length(&self, length: f64) -> f64 {
        length
    }
}
