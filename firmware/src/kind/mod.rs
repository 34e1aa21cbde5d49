//! Parts of the firmware that differ between the image for one muscle and, with the feature
//! `joint`, the image for a joint of two. All other code is the same for both.

#[cfg(feature = "joint")]
mod joint;
#[cfg(not(feature = "joint"))]
mod muscle;

#[cfg(feature = "joint")]
pub use joint::*;
#[cfg(not(feature = "joint"))]
pub use muscle::*;
