//! Functions of f64 for whatever a run's trace depends on: plant, front end, scenario.
//!
//! The platform's own differ in the last bit from one libc, or browser, to the next, and so would traces. These are
//! pure Rust, the same everywhere. What IEEE 754 rounds correctly, such as `sqrt` and `round`, is std's; the
//! rest is refused by `clippy.toml`.

pub use libm::{acos, atan2, cbrt, cos, exp, expm1, hypot, log, pow, sin};
