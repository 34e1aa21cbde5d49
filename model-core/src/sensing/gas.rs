//! Gas temperature: the sensor's own parameters, and the elements that it may have.
//!
//! # How to add an element
//!
//! Add a file beside this one with the element's parameters, its [`Element`] and its [`Curve`], and list it in
//! `elements!` below. For the plant in `host-sim`, add a file in `simulation/elements/` and its line there, and its
//! word and its table in `scenario/tables/sensors.rs`. `docs/reference/board.md` has a row for each element. An element
//! that is read over a bus sets `DIGITAL` and its [`Element::part`]; the firmware's part is `firmware/src/parts.rs`. A
//! new element comes last and raises `PROTOCOL` in `link`: boards with the previous protocol do not support it.

pub use super::element::{Curve, Element};
pub use super::max31865::Max31865;
pub use super::ntc::Ntc;
use super::part::Limits;
pub use super::pt1000::Pt1000;
use crate::parameter::{ConfigError, parameters};

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

/// Lists the elements.
macro_rules! elements {
    ($($(#[$attribute:meta])* $element:ident,)*) => {
        /// The element that senses the gas temperature.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[non_exhaustive]
        pub enum GasElement {
            $($(#[$attribute])* $element($element),)*
        }

        #[derive(Debug, Clone, Copy, PartialEq)]
        enum ElementCurve {
            $($element(<$element as Element>::Curve),)*
        }

        impl GasElement {
            /// All elements with their defaults.
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

            /// Mean width of a 12-bit code over the range, or of a digital converter's own code \[K\].
            pub fn resolution_k(&self) -> f32 {
                match self {
                    $(Self::$element(element) => element.resolution_k(),)*
                }
            }

            /// Limits of the digital converter; `None` if the element is on the board's converter.
            pub(super) fn part(&self) -> Option<Limits> {
                match self {
                    $(Self::$element(element) => element.part(),)*
                }
            }

            /// Whether it is read over a bus, at the converter's own rate.
            pub fn is_digital(&self) -> bool {
                match self {
                    $(Self::$element(_) => <$element as Element>::DIGITAL,)*
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
    /// Pt100 or Pt1000 on a MAX31865.
    Max31865,
}

impl Default for GasElement {
    fn default() -> Self {
        Self::Pt1000(Pt1000::default())
    }
}

/// A gas sensor with its computed constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasLine {
    gain: f32,
    offset_k: f32,
    curve: ElementCurve,
}

impl GasLine {
    /// Computes the constants.
    pub fn new(sensor: &GasSensor, element: &GasElement) -> Self {
        Self { gain: sensor.gain, offset_k: sensor.offset_k, curve: element.curve() }
    }

    /// Temperature \[K\] at an ideal code.
    pub fn at(&self, ideal_code: f32) -> f32 {
        self.gain * self.curve.at_k(ideal_code) + self.offset_k
    }
}
