//! The message about a plant that cannot be simulated, or only slowly, at the responsible key of its file.

use super::{Console, Failure};
use std::path::Path;
use thermyo_files::input::{InputError, Problem, read_text};
use thermyo_joint::{Inputs, JointLoaded, Rig};
use thermyo_scenario::document::{Document, Entry, Given};
use thermyo_scenario::joint::JointDocument;
use thermyo_setup::{Loaded, paths_in};

/// Keys of a chamber's size, for messages about its volume.
const SIZES: [&str; 7] = [
    "muscle.dead_volume_m3",
    "muscle.diameter_m",
    "muscle.rest_length_m",
    "cylinder.dead_volume_m3",
    "cylinder.area_m2",
    "table.dead_volume_m3",
    "table.csv",
];

/// Integration step below which a simulation takes longer than the simulated time, or nearly so; a hundredth of the
/// usual step \[s\].
const SLOW_STEP_S: f64 = 1.0e-6;

/// Refuses a plant whose steps would be too short, which shows only when the plant is built. Warns of short steps.
pub(super) fn refuse(loaded: &Loaded, path: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    let plant = thermyo_plant::build(&loaded.plant, loaded.volume_profile.clone())
        .map_err(|error| of_one_chamber(path, error.to_string()))?;
    if let Some((step_s, because)) = plant.shortest_step().filter(|step| step.0 < SLOW_STEP_S) {
        let why = format!(
            "{because}: its integration steps of {step_s:.1e} s make the simulation slow; it is fast with \
             {SLOW_STEP_S:.0e} s or more"
        );
        to.warn(&[of_one_chamber(path, why)]);
    }
    Ok(())
}

fn of_one_chamber(path: &Path, reason: String) -> InputError {
    let document = read_text(path).and_then(|text| Document::parse(&text, path)).ok();
    let entry = keys(&reason).find_map(|key| document.as_ref()?.plant.get(key)).or_else(|| {
        let mut entries = document.as_ref()?.plant.iter();
        entries.find(|entry| reason.starts_with(entry.key.name))
    });
    located(path, entry.map(Entry::given), reason)
}

/// As [`refuse`], for a joint.
pub(super) fn refuse_joint(loaded: &JointLoaded, path: &Path) -> Result<(), Failure> {
    Rig::new(loaded, Inputs::of(loaded.motion(0.0))).map(drop).map_err(|error| {
        let reason = error.to_string();
        let document = read_text(path).and_then(|text| JointDocument::parse(&text, path)).ok();
        let given = keys(&reason).find_map(|key| document.as_ref()?.given(key)).or_else(|| {
            let mut entries = document.as_ref()?.muscles.iter().flat_map(|one| one.plant.iter());
            entries.find(|entry| reason.starts_with(entry.key.name)).map(Entry::given)
        });
        // Puts an allowed range behind its key, and a reason otherwise.
        let of_inertia = |(_, key, _): &Given| key == "joint.inertia_kg_m2";
        let why = match reason.strip_prefix("joint.inertia_kg_m2: ") {
            Some(allowed) if given.as_ref().is_some_and(of_inertia) => allowed.to_owned(),
            _ => reason,
        };
        located(path, given, why).into()
    })
}

/// Keys that a reason names, in order of appearance.
fn keys(reason: &str) -> impl Iterator<Item = &str> {
    let sizes = SIZES.into_iter().filter(|_| reason.contains("smallest volume"));
    sizes.chain(paths_in(reason))
}

pub(super) fn located(path: &Path, given: Option<Given>, why: String) -> InputError {
    match given {
        Some((line, key, value)) => InputError {
            file: path.to_path_buf(),
            line,
            problem: Box::new(Problem::NoSense { key, value, why }),
        },
        None => InputError::file(path, Problem::Unusable(why)),
    }
}
