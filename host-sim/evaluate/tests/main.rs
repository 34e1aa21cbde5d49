//! The smoother.

mod smoother;
