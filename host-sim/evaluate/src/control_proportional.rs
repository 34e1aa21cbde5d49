//! Control with proportional valves: the cases of switching ones, and a dead band that is not as believed.

use super::control::{Job, pressure_step_between, rest, sine};
use super::{CaseFigures, Figure};
use thermyo_scenario::{Scenario, ValveKind};
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;

/// 10 and 90 % of the nominal supply's gauge pressure, absolute \[Pa\].
pub const FROM_10_TO_90_PA: [f64; 2] = [1.612e5, 6.401e5];
/// Dead band that the core believes, as a multiple of the true one.
const BELIEVED: [f64; 3] = [0.7, 1.0, 1.3];

/// Fraction of the rest in which a command may be given, as with switching valves.
const DRIVEN: f64 = 0.12;

/// The same muscle with proportional valves, whose dead band is believed to be that multiple of itself.
pub fn proportional(mut loaded: Loaded, believed: f64) -> Loaded {
    let change = |s: &mut Scenario| s.valve.kind = ValveKind::Proportional;
    change(&mut loaded.plant);
    change(&mut loaded.believed);
    loaded.believed.valve.dead_band = believed * loaded.plant.valve.dead_band;
    loaded
}

/// The cases of this module.
pub(super) fn jobs(full: &Loaded) -> Vec<Job<'_>> {
    let mut jobs: Vec<Job> = Vec::new();
    for believed in BELIEVED {
        let case = move |what: &str| match believed {
            1.0 => format!("proportional valves, {what}"),
            _ => format!("proportional valves, dead band believed {believed} times, {what}"),
        };
        jobs.push(Box::new(move || {
            let loaded = proportional(full.clone(), believed);
            let step = pressure_step_between(&loaded, FROM_10_TO_90_PA, &mut CoreBoard::default())?;
            Ok(CaseFigures {
                case: case("pressure 10 to 90 %"),
                figures: vec![
                    Figure::at_most("times_open_valve", step.times_open_valve, 1.3),
                    Figure::at_most("overshoot_percent", step.overshoot_percent, 2.0),
                ],
            })
        }));
        jobs.push(Box::new(move || {
            let loaded = proportional(full.clone(), believed);
            let held = rest::hold(&loaded, 0, &mut CoreBoard::default())?;
            Ok(CaseFigures {
                case: case("hold"),
                figures: vec![
                    Figure::at_most("error_percent", held.error_percent, 1.0),
                    Figure::at_most("ripple_percent", held.ripple_percent, 0.5),
                    Figure::at_most("valves_driven", held.driven, DRIVEN),
                ],
            })
        }));
        jobs.push(Box::new(move || {
            let loaded = proportional(full.clone(), believed);
            let slow = sine(&loaded, 0.5, 0.15, &mut CoreBoard::default())?;
            Ok(CaseFigures {
                case: case("0.5 Hz over 30 % of stroke"),
                figures: vec![Figure::at_most("rms_percent", slow.rms_percent, 2.0)],
            })
        }));
    }
    jobs
}
