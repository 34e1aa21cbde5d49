//! tmp
use crate::measured::Measured;
use crate::scenario::Loaded;
use crate::summary::Summary;
/// t
pub struct Recorder;
impl Recorder {
    /// t
    pub fn new(_: &[&str]) -> Self {
        Self
    }
    /// t
    pub fn push(&mut self, _: &[f64]) {}
}
/// t
pub fn run_page(_: &str, _: &Loaded, _: &Recorder, _: Option<&Measured>, _: &Summary) -> String {
    String::new()
}
