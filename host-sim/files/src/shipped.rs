//! The repository's scenarios, built into the program.

use std::ffi::OsStr;
use std::path::{Component, Path};

const FILES: [(&str, &str); 15] = [
    ("air_discharge.toml", include_str!("../../../scenarios/air_discharge.toml")),
    ("bellows.csv", include_str!("../../../scenarios/bellows.csv")),
    ("bellows.toml", include_str!("../../../scenarios/bellows.toml")),
    ("contraction.toml", include_str!("../../../scenarios/contraction.toml")),
    ("gas_spring.toml", include_str!("../../../scenarios/gas_spring.toml")),
    ("joint.toml", include_str!("../../../scenarios/joint.toml")),
    ("joint_board.toml", include_str!("../../../scenarios/joint_board.toml")),
    ("joint_pulley.csv", include_str!("../../../scenarios/joint_pulley.csv")),
    ("joint_pulley.toml", include_str!("../../../scenarios/joint_pulley.toml")),
    ("motion.toml", include_str!("../../../scenarios/motion.toml")),
    ("nominal.toml", include_str!("../../../scenarios/nominal.toml")),
    ("proportional.toml", include_str!("../../../scenarios/proportional.toml")),
    ("reproduce.toml", include_str!("../../../scenarios/reproduce.toml")),
    ("sensor.toml", include_str!("../../../scenarios/sensor.toml")),
    ("static_map.toml", include_str!("../../../scenarios/static_map.toml")),
];

/// # Panics
/// If the repository has no file of this name.
pub fn text(name: &str) -> &'static str {
    of_name(name.as_ref()).expect("the repository has that scenario")
}

pub fn names() -> impl Iterator<Item = &'static str> {
    FILES.iter().map(|(name, _)| *name)
}

fn of_name(name: &OsStr) -> Option<&'static str> {
    FILES.iter().find(|(file, _)| name == *file).map(|(_, text)| *text)
}

/// The shipped file for `scenarios/NAME`, relative to the working folder, if the repository has
/// this name.
pub fn instead_of(path: &Path) -> Option<&'static str> {
    let folder = std::env::current_dir().ok();
    let path = folder.and_then(|folder| path.strip_prefix(folder).ok()).unwrap_or(path);
    let mut parts = path.components().filter(|part| *part != Component::CurDir);
    let mut next = || parts.next().map(Component::as_os_str);
    let (Some(folder), Some(file), None) = (next(), next(), next()) else { return None };
    of_name(file).filter(|_| folder == "scenarios" && !path.exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_and_the_list_are_the_same() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let mut there: Vec<_> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        there.sort();
        assert_eq!(there, FILES.map(|(name, _)| name));
    }

    #[test]
    fn only_a_file_of_the_folder_scenarios_is_stood_for() {
        let here = std::env::current_dir().unwrap().join("scenarios/bellows.csv");
        for (path, found) in [
            ("scenarios/nominal.toml", true),
            ("./scenarios/nominal.toml", true),
            (here.to_str().unwrap(), true),
            ("scenarios/nominall.toml", false),
            ("nominal.toml", false),
            ("other/nominal.toml", false),
            ("other/scenarios/nominal.toml", false),
            ("/scenarios/nominal.toml", false),
            ("../scenarios/nominal.toml", false),
            ("", false),
        ] {
            assert_eq!(instead_of(Path::new(path)).is_some(), found, "{path}");
        }
    }
}
