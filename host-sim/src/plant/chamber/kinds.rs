//! The chamber that a scenario has.

use super::Chamber;
use crate::scenario::Scenario;

/// The chambers that there are: `$then` with the one of the scenario, `$vessel` for a vessel.
macro_rules! with_chamber {
    ($scenario:expr, $chamber:ident => $then:expr, vessel => $vessel:expr) => {
        match $scenario.plant.kind {
            $crate::scenario::PlantKind::Vessel => $vessel,
            $crate::scenario::PlantKind::Muscle => {
                let $chamber = $crate::plant::chamber::braid::Muscle::of(&$scenario.muscle);
                $then
            }
            $crate::scenario::PlantKind::Cylinder => {
                let $chamber = $crate::plant::chamber::cylinder::Piston::of(&$scenario.cylinder);
                $then
            }
            $crate::scenario::PlantKind::Table => {
                let rows = &$scenario.table_rows;
                let $chamber = $crate::plant::chamber::table::Measured::of(&$scenario.table, rows);
                $then
            }
        }
    };
}

pub(in super::super) use with_chamber;

/// The chamber of a loaded scenario; none for a vessel.
pub fn of(scenario: &Scenario) -> Option<Box<dyn Chamber>> {
    with_chamber!(scenario, chamber => Some(Box::new(chamber)), vessel => None)
}
