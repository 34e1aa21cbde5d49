//! tmp
mod model;
use crate::input::InputError;
use crate::profile::Profile;
pub use model::*;
use std::path::Path;
/// tmp
#[derive(Debug, Clone)]
pub struct Loaded {
    /// t
    pub plant: Scenario,
    /// t
    pub believed: Scenario,
    /// t
    pub volume_profile: Option<Profile>,
    /// t
    pub drive_profile: Option<Profile>,
}
/// tmp
pub fn load(path: &Path) -> Result<Loaded, InputError> {
    parse(&std::fs::read_to_string(path).map_err(|e| InputError(e.to_string()))?, path)
}
/// tmp
pub fn parse(text: &str, _origin: &Path) -> Result<Loaded, InputError> {
    let mut s: Scenario = toml::from_str(text).map_err(|e| InputError(e.to_string()))?;
    let l = s.muscle.rest_length_m.unwrap_or(0.3);
    let d = s.muscle.diameter_m.unwrap_or(0.02);
    let a = s.muscle.braid_angle_deg.unwrap_or(23.0);
    s.muscle.rest_length_m = Some(l);
    s.muscle.thread_length_m = Some(l / a.to_radians().cos());
    s.muscle.turns = Some(l * a.to_radians().tan() / (std::f64::consts::PI * d));
    Ok(Loaded { believed: s.clone(), plant: s, volume_profile: None, drive_profile: None })
}
/// tmp
pub fn render(l: &Loaded) -> String {
    toml::to_string(&l.plant).unwrap()
}
