//! Control with proportional valves: the cases of the switching ones, and a dead band that is not as configured.

use super::Figure;
use super::control::{Job, held_within, job, pressure_step_between, rest, sine, step_figures};
use thermyo_scenario::ValveKind;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;

/// 10 and 90 % of the nominal supply's gauge pressure, absolute \[Pa\].
pub const FROM_10_TO_90_PA: [f64; 2] = [1.612e5, 6.401e5];
/// Configured dead band as a multiple of the true one.
const BELIEVED: [f64; 3] = [0.7, 1.0, 1.3];

/// Fraction of the rest in which a command may be given, as with switching valves.
const DRIVEN: f64 = 0.12;

/// The same muscle with proportional valves, whose configured dead band is a multiple of the true one.
pub fn proportional(loaded: &Loaded, believed: f64) -> Loaded {
    let dead_band = believed * loaded.plant.valve.dead_band;
    let proportional = loaded.with(|s| s.valve.kind = ValveKind::Proportional);
    proportional.believing(|s| s.valve.dead_band = dead_band)
}

pub(super) fn jobs(full: &Loaded) -> Vec<Job<'_>> {
    let mut jobs: Vec<Job> = Vec::new();
    for believed in BELIEVED {
        let case = move |what: &str| match believed {
            1.0 => format!("proportional valves, {what}"),
            _ => format!("proportional valves, dead band believed {believed} times, {what}"),
        };
        jobs.push(job(case("pressure 10 to 90 %"), move || {
            let loaded = proportional(full, believed);
            let step = pressure_step_between(&loaded, FROM_10_TO_90_PA, &mut CoreBoard::default())?;
            Ok(step_figures(&step))
        }));
        jobs.push(job(case("hold"), move || {
            let loaded = proportional(full, believed);
            let held = rest::hold(&loaded, 0, &mut CoreBoard::default())?;
            Ok(held_within(&held, [1.0, 0.5, DRIVEN]))
        }));
        jobs.push(job(case("0.5 Hz over 30 % of stroke"), move || {
            let loaded = proportional(full, believed);
            let slow = sine(&loaded, 0.5, 0.15, &mut CoreBoard::default())?;
            Ok(vec![Figure::at_most("rms_percent", slow.rms_percent, 2.0)])
        }));
    }
    jobs
}
