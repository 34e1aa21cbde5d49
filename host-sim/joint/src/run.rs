//! One run of a scenario.

use crate::load::JointLoaded;
use crate::rig::{Inputs, Rig, Row, RunError};
use crate::summary::{Accumulator, Summary};
use std::io;
use std::time::Instant;

/// Interval at which a set point that moves is updated \[s\].
pub const SET_POINT_INTERVAL_S: f64 = 0.01;

/// Runs a scenario; `observer` gets one row per `[run] log_every` steps, the last step included.
///
/// # Errors
/// [`RunError`]; that of the observer as [`RunError::Output`].
pub fn run(
    loaded: &JointLoaded,
    observer: &mut dyn FnMut(&Row) -> io::Result<()>,
) -> Result<Summary, RunError> {
    let started = Instant::now();
    let run = &loaded.muscles[0].plant.run;
    let (steps, step_s) = (run.steps(), run.step_s);
    let every = (SET_POINT_INTERVAL_S / step_s).round().max(1.0) as u64;
    let mut inputs = Inputs::of(loaded.motion(0.0));
    inputs.load_n_m = loaded.load_n_m(0.0);
    let mut rig = Rig::new(loaded, inputs)?;
    let mut accumulator = Accumulator::new(step_s);
    for step in 0..=steps {
        let next_s = (step + 1) as f64 * step_s;
        inputs.load_n_m = loaded.load_n_m(next_s);
        if (step + 1).is_multiple_of(every) {
            inputs.set_point = Inputs::of(loaded.motion(next_s)).set_point;
        }
        let row = rig.step(inputs)?;
        accumulator.add(&row);
        if step.is_multiple_of(run.log_every) || step == steps {
            observer(&row).map_err(RunError::Output)?;
        }
    }
    Ok(accumulator.finish(started.elapsed().as_secs_f64(), rig.ledgers()))
}
