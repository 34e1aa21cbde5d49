//! Why parameters lead to no prediction.

use thermyo_plant::{BuildError, Diverged};

/// Why a set of values has no prediction.
#[derive(Debug)]
pub enum Failed {
    /// The plant cannot be built with it.
    Build(BuildError),
    /// The plant diverges with it.
    Diverged(Diverged),
    /// It was to end, [`stop`].
    Stopped,
}
