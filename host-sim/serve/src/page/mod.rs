//! What the pages of `thermyo serve` and `thermyo playground` share.

/// Their style, beside that of drawings.
pub const STYLE: &str = include_str!("page.css");
/// Plots over the last seconds.
pub const PLOT: &str = include_str!("plot.js");
/// The muscle's picture; its colours are those of `palette.js`.
pub const MUSCLE: &str = include_str!("muscle.js");
/// So many of them.
pub const PALETTE: usize = 64;
