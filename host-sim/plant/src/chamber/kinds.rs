//! The chamber of a scenario.

use super::Chamber;
use thermyo_scenario::Scenario;

/// The kinds of chamber: `$then` with the scenario's, `$vessel` for a vessel.
macro_rules! with_chamber {
    ($scenario:expr, $chamber:ident => $then:expr, vessel => $vessel:expr) => {
        match $scenario.plant.kind {
            thermyo_scenario::PlantKind::Vessel => $vessel,
            thermyo_scenario::PlantKind::Muscle => {
                let $chamber = $crate::chamber::braid::Muscle::of(&$scenario.muscle);
                $then
            }
            thermyo_scenario::PlantKind::Cylinder => {
                let $chamber = $crate::chamber::cylinder::Piston::of(&$scenario.cylinder);
                $then
            }
            thermyo_scenario::PlantKind::Table => {
                let rows = &$scenario.table_rows;
                let $chamber = $crate::chamber::table::Measured::of(&$scenario.table, rows);
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
