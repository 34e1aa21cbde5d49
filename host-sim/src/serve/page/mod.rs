//! What the pages of `thermyo serve` and `thermyo playground` share.

/// Their style, beside that of drawings.
pub(crate) const STYLE: &str = include_str!("page.css");
/// Plots over the last seconds.
pub(crate) const PLOT: &str = include_str!("plot.js");
/// The muscle's picture; its colours are those of `palette.js`.
pub(crate) const MUSCLE: &str = include_str!("muscle.js");
/// So many of them.
pub(crate) const PALETTE: usize = 64;
