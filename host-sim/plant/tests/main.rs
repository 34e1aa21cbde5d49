//! Tests of the plant.

mod plant_air;
mod plant_faults;
mod plant_full;
mod plant_lumped;
mod plant_support;
mod plant_vessel;

use thermyo_scenario::Scenario;

/// Takes slip and creep away, for what is about something else.
fn elastic(mut scenario: Scenario) -> Scenario {
    let muscle = &mut scenario.muscle;
    (muscle.slip_force_n, muscle.creep_fast_n_m, muscle.creep_slow_n_m) = (0.0, 0.0, 0.0);
    scenario
}
