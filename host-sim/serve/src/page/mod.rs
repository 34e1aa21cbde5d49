//! Files that the pages of `thermyo serve` and `thermyo playground` share.

/// Style sheet, used in addition to that of drawings.
pub const STYLE: &str = include_str!("page.css");
/// Plots over the last seconds.
pub const PLOT: &str = include_str!("plot.js");
/// Picture of the muscle; its colours are in `palette.js`.
pub const MUSCLE: &str = include_str!("muscle.js");
/// Number of colours.
pub const PALETTE: usize = 64;
