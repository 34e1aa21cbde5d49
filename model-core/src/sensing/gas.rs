//! Gas temperature: the sensor's own parameters, and the elements that it may have.
//!
//! # How to add an element
//!
//! A file beside this one, with the element's parameters, its [`Element`] and its [`Curve`], and its line in
//! `elements!` below. In `host-sim` the plant's side of it: a file in `simulation/elements/` with its line
//! there, and in `scenario/tables/sensors.rs` its word and its table. `docs/board.md` has a row for each.
//! A new element comes last, and raises `PROTOCOL` in `link`: boards of the one before do not know it.

pub use super::ntc::Ntc;
pub use super::pt1000::Pt1000;
use crate::config::ConfigError;
use crate::parameter::parameters;

parameters! {
    /// The gas sensor, whatever its element is.
    "sensor.gas": GasSensor {
        time_constant_s: 3.0, "s", 0.001 to 1000.0, "lag of the element";
        housing_time_constant_s: 0.2, "s", 0.0 to 1000.0, "lag of its housing, in series";
        noise_k: 0.05, "K", 0.0 to 100.0, "noise of one conversion, standard deviation";
        gain: 1.0, "", 0.5 to 2.0, "calibration: temperature = gain reading + offset_k";
        offset_k: 0.0, "K", -500.0 to 500.0, "calibration: temperature = gain reading + offset_k";
    }
}

/// What senses the gas temperature.
pub trait Element {
    /// Its constants, worked out.
    type Curve: Curve;

    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    fn check_ranges(&self) -> Result<(), ConfigError>;

    /// What it makes of codes.
    fn curve(&self) -> Self::Curve;

    /// What one code of 12 bit is worth, mean over its range \[K\].
    fn resolution_k(&self) -> f32;
}

/// Temperature over codes.
pub trait Curve {
    /// Temperature \[K\] at an ideal code; finite at any.
    fn at_k(&self, ideal_code: f32) -> f32;
}

/// Lists the elements.
macro_rules! elements {
    ($($(#[$attribute:meta])* $element:ident,)*) => {
        /// What senses the gas temperature.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
        #[non_exhaustive]
        pub enum GasElement {
            $($(#[$attribute])* $element($element),)*
        }

        #[derive(Debug, Clone, Copy, PartialEq)]
        enum ElementCurve {
            $($element(<$element as Element>::Curve),)*
        }

        impl GasElement {
            /// One of each, with its defaults.
            pub fn all() -> impl Iterator<Item = Self> {
                [$(Self::$element($element::default())),*].into_iter()
            }

            /// Checks every value.
            ///
            /// # Errors
            /// The first value that is not a number or lies outside of its range.
            pub fn check(&self) -> Result<(), ConfigError> {
                match self {
                    $(Self::$element(element) => element.check_ranges(),)*
                }
            }

            /// What one code of 12 bit is worth, mean over its range \[K\].
            pub fn resolution_k(&self) -> f32 {
                match self {
                    $(Self::$element(element) => element.resolution_k(),)*
                }
            }

            fn curve(&self) -> ElementCurve {
                match self {
                    $(Self::$element(element) => ElementCurve::$element(element.curve()),)*
                }
            }
        }

        impl ElementCurve {
            fn at_k(&self, ideal_code: f32) -> f32 {
                match self {
                    $(Self::$element(curve) => curve.at_k(ideal_code),)*
                }
            }
        }
    };
}

elements! {
    /// Pt1000 in a half bridge.
    Pt1000,
    /// NTC thermistor in a divider.
    Ntc,
}

impl Default for GasElement {
    fn default() -> Self {
        Self::Pt1000(Pt1000::default())
    }
}

/// A gas sensor with its constants worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasLine {
    gain: f32,
    offset_k: f32,
    curve: ElementCurve,
}

impl GasLine {
    /// Works the constants out.
    pub fn new(sensor: &GasSensor, element: &GasElement) -> Self {
        Self { gain: sensor.gain, offset_k: sensor.offset_k, curve: element.curve() }
    }

    /// Temperature \[K\] at an ideal code.
    pub fn at(&self, ideal_code: f32) -> f32 {
        self.gain * self.curve.at_k(ideal_code) + self.offset_k
    }
}
