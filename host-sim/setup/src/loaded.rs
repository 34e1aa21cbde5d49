//! A scenario that has been read and checked.

use std::ops::Range;
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{DriveKind, PlantModel, Scenario};

/// A scenario, checked, with every default filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The plant's scenario. Its CSV paths are absolute.
    pub plant: Scenario,
    /// The core's scenario: the plant's, overlaid by `[believed]`.
    pub believed: Scenario,
    /// The vessel's volume \[m3\] over time, from `vessel.volume_csv`.
    pub volume_profile: Option<Profile>,
    /// The set point over time in the drive's unit, from `drive.profile_csv`.
    pub drive_profile: Option<Profile>,
    /// Times during which both valves are shut, whatever the drive \[s\].
    pub shut_s: Vec<Range<f64>>,
}

impl Loaded {
    /// The same scenario on another plant, and with the core configured for it, since the core
    /// drives ideal valves differently.
    pub fn with_model(&self, model: PlantModel) -> Self {
        self.with(|scenario| scenario.plant.model = model)
    }

    /// The same scenario with a change of both plant and core configuration.
    #[must_use]
    pub fn with(&self, change: impl Fn(&mut Scenario)) -> Self {
        self.unexpected(&change).believing(change)
    }

    /// The same scenario with a change of the plant alone.
    #[must_use]
    pub fn unexpected(&self, change: impl Fn(&mut Scenario)) -> Self {
        let mut other = self.clone();
        change(&mut other.plant);
        other
    }

    /// The same scenario with a change of the core's configuration alone.
    #[must_use]
    pub fn believing(&self, change: impl Fn(&mut Scenario)) -> Self {
        let mut other = self.clone();
        change(&mut other.believed);
        other
    }

    /// The same scenario with these set points \[s, the kind's own unit\] up to the last of them,
    /// with every step logged.
    ///
    /// # Panics
    /// Without set points, or if times do not increase.
    pub fn driven(&self, kind: DriveKind, set_points: Vec<(f64, f64)>) -> Self {
        let mut other = self.clone();
        other.plant.run.log_every = 1;
        other.plant.run.duration_s = set_points.last().map_or(0.0, |point| point.0);
        other.plant.drive.kind = kind;
        other.believed.drive.kind = kind;
        other.drive_profile = Some(Profile::new(set_points).expect("times increase"));
        other
    }
}
