//! Fitting: least squares, the correlation of residuals, values with their standard errors, and the fit that needs no
//! simulation: the gas temperature from [`stops`].

pub mod assumed;
mod correlation;
mod fitted;
pub mod search;
pub mod stops;

pub use correlation::correlation_rows;
pub use fitted::Fitted;
