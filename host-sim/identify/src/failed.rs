use thermyo_plant::{BuildError, Diverged};

/// Reason why a set of values has no prediction.
#[derive(Debug)]
pub enum Failed {
    Build(BuildError),
    Diverged(Diverged),
    Stopped,
}
