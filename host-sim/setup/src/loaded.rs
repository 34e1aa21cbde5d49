//! A scenario that has been read and checked.

use thermyo_scenario::profile::Profile;
use thermyo_scenario::{DriveKind, PlantModel, Scenario};

/// A scenario, checked, with every default filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// What the plant is. Its CSV paths are absolute.
    pub plant: Scenario,
    /// What the core believes: the plant's scenario, overlaid by `[believed]`.
    pub believed: Scenario,
    /// The vessel's volume \[m3\] over time, where `vessel.volume_csv` gives it.
    pub volume_profile: Option<Profile>,
    /// The set point over time in the drive's unit, where `drive.profile_csv` gives it.
    pub drive_profile: Option<Profile>,
}

impl Loaded {
    /// The same scenario on another plant. The core knows it: it drives ideal valves differently.
    pub fn with_model(&self, model: PlantModel) -> Self {
        let mut other = self.clone();
        other.plant.plant.model = model;
        other.believed.plant.model = model;
        other
    }

    /// The same scenario driven along set points \[s, the kind's own unit\] to the last of them, with
    /// every step logged.
    ///
    /// # Panics
    /// When there is none, or times do not increase.
    pub fn driven(&self, kind: DriveKind, set_points: Vec<(f64, f64)>) -> Self {
        let mut other = self.clone();
        other.plant.run.log_every = 1;
        other.plant.run.duration_s = set_points.last().map_or(0.0, |point| point.0);
        other.plant.drive.kind = kind;
        other.drive_profile = Some(Profile::new(set_points).expect("times increase"));
        other
    }
}
