//! The image drives one muscle, or a joint of two with the feature `joint`. All other code of
//! the firmware is the same for both.

#[cfg(feature = "joint")]
mod joint;
#[cfg(not(feature = "joint"))]
mod muscle;

#[cfg(feature = "joint")]
pub use joint::*;
#[cfg(not(feature = "joint"))]
pub use muscle::*;
