//! Fitting: least squares, the correlation of residuals, and values with their standard errors.

mod correlation;
mod fitted;
pub mod search;

pub use correlation::correlation_rows;
pub use fitted::Fitted;
