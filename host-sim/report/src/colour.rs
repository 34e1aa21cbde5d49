//! The palette of Okabe and Ito (2008), distinguishable with every common colour blindness, and
//! helpers for continuous colour scales.

/// A colour of the palette, or the quantity that has one on every page. The style sheet holds its
/// value for light and for dark mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// True values, the reference of a comparison.
    Truth,
    Estimate,
    Sensor,
    Wall,
    WallSensor,
    Measured,
    SetPoint,
    Inlet,
    Outlet,
    /// Black on white, or white on black.
    Ink,
    Blue,
    /// A red-orange.
    Vermillion,
    Green,
    Purple,
    Orange,
    Sky,
    /// For the background of a comparison.
    Grey,
}

impl Colour {
    /// Colours of several curves of one kind, in their order.
    pub const CURVES: [Self; 7] = [
        Self::Ink,
        Self::Blue,
        Self::Vermillion,
        Self::Green,
        Self::Purple,
        Self::Orange,
        Self::Sky,
    ];

    pub(super) fn class(self) -> &'static str {
        match self {
            Self::Truth => "c-truth",
            Self::Estimate => "c-estimate",
            Self::Sensor => "c-sensor",
            Self::Wall => "c-wall",
            Self::WallSensor => "c-wall-sensor",
            Self::Measured => "c-measured",
            Self::SetPoint => "c-set-point",
            Self::Inlet => "c-inlet",
            Self::Outlet => "c-outlet",
            Self::Ink => "c-ink",
            Self::Blue => "c-blue",
            Self::Vermillion => "c-vermillion",
            Self::Green => "c-green",
            Self::Purple => "c-purple",
            Self::Orange => "c-orange",
            Self::Sky => "c-sky",
            Self::Grey => "c-grey",
        }
    }
}

/// Position of `value` in `low..=high`, as a fraction clamped to 0..=1.
pub(super) fn fraction(value: f64, (low, high): (f64, f64)) -> f64 {
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

/// `fraction` of a colour map as `#rrggbb`.
pub(super) fn hex(map: colorous::Gradient, fraction: f64) -> String {
    format!("#{:x}", map.eval_continuous(fraction))
}

/// Black or white, whichever is easier to read on `fraction` of a colour map.
///
/// Uses the relative luminance with the coefficients of ITU-R BT.709, on gamma-encoded values.
pub(super) fn text_on(map: colorous::Gradient, fraction: f64) -> &'static str {
    let colorous::Color { r, g, b } = map.eval_continuous(fraction);
    let luma = 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
    if luma > 130.0 { "#000" } else { "#fff" }
}
