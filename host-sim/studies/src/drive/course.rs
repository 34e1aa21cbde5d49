//! Set points over the steps of a drive.

/// Set points over the steps of a drive.
pub trait Course<P> {
    fn steps(&self) -> u64;

    /// Ambient pressure that the board is configured with \[Pa\].
    fn ambient_pa(&self) -> f32;

    /// The set point of step 0.
    fn first(&self) -> P;

    /// A set point that begins at a step.
    fn acting_from(&self, step: u64) -> Option<P>;
}
