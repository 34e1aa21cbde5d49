//! The interface of the gas sensor's elements.

use super::part::Limits;
use crate::parameter::ConfigError;

/// An element that senses the gas temperature.
pub trait Element {
    /// Temperature over codes, with constants that follow from the parameters.
    type Curve: Curve;

    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    fn check_ranges(&self) -> Result<(), ConfigError>;

    /// The temperature over codes.
    fn curve(&self) -> Self::Curve;

    /// Mean width of a 12-bit code over the range, or of a digital converter's own code \[K\].
    fn resolution_k(&self) -> f32;

    /// Whether it is read over a bus, at the converter's own rate.
    const DIGITAL: bool = false;

    /// Limits of the digital converter; `None` if the element is on the board's converter.
    fn part(&self) -> Option<Limits> {
        None
    }
}

/// Temperature over codes.
pub trait Curve {
    /// Temperature \[K\] at an ideal code; finite for any code.
    fn at_k(&self, ideal_code: f32) -> f32;
}
