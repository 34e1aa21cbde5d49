//! Files inside a release build that a checkout builds or fetches: the emulator's scripts and the
//! firmware's images (`emulator/`), the browser's module, the shared library of a unit.
//!
//! Feature `release` embeds the archive that `THERMYO_INSIDE` names at compile time; `.ci/dist.py`
//! creates it. Without the feature there is no archive, and the checkout is used.

#[cfg(any(test, feature = "release"))]
mod archive;
#[cfg(feature = "release")]
mod embedded;

#[cfg(feature = "release")]
pub use embedded::{emulator, file};
#[cfg(not(feature = "release"))]
pub use none::{emulator, file};

#[cfg(not(feature = "release"))]
mod none {
    use std::path::PathBuf;
    use thermyo_simulation::board::BoardError;

    pub fn file(_name: &str) -> Option<Vec<u8>> {
        None
    }

    pub fn emulator() -> Result<Option<PathBuf>, BoardError> {
        Ok(None)
    }
}
