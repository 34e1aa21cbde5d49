//! One point of a sweep: a run, the error of each method for the gas temperature, and that of the
//! set point.

use std::io;
use thermyo_record::summary::Errors;
use thermyo_record::trace::Row;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Start of the errors' evaluation: the estimator needs time to learn, as in `thermyo evaluate`
/// \[s\].
const SETTLED_S: f64 = 10.0;

/// Start of the errors' evaluation \[s\]: 10 s, or half of a run shorter than 20 s.
pub fn settled_s(loaded: &Loaded) -> f64 {
    SETTLED_S.min(0.5 * loaded.plant.run.duration_s)
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Root-mean-square errors against the plant's gas temperature \[K\].
    pub rmse_k: Errors,
    /// Fraction of the steps in which the true value lies within two stated standard deviations
    /// \[-\].
    pub within_2sd: f64,
    /// Root-mean-square error of the set point over the whole run, in its unit; none without a
    /// controlled quantity.
    pub control_rms_error: Option<f64>,
}

/// Runs a scenario with the core in this process; the errors count from `from_s` on \[s\]. `go_on`
/// is called in each step, and its error ends the run.
pub fn measure(
    mut loaded: Loaded,
    from_s: f64,
    go_on: &mut dyn FnMut() -> io::Result<()>,
) -> Result<Figures, RunError> {
    // The observer needs every step.
    loaded.plant.run.log_every = 1;
    let mut squares = [0.0; 4];
    let (mut steps, mut within) = (0_u64, 0_u64);
    let mut observer = |row: &Row| {
        go_on()?;
        let Row { truth, telemetry, .. } = row;
        if truth.time_s >= from_s {
            let estimate = &telemetry.estimate;
            let errors =
                [row.sensor_gas_k, row.sensor_wall_k, row.model_k, f64::from(estimate.gas_k)]
                    .map(|temperature_k| temperature_k - truth.gas_temperature_k);
            for (sum, error) in squares.iter_mut().zip(errors) {
                *sum += error * error;
            }
            steps += 1;
            within += u64::from(errors[3].abs() <= 2.0 * f64::from(estimate.gas_sd_k));
        }
        Ok(())
    };
    let summary = run::run(&loaded, &mut CoreBoard::default(), None, &mut observer)?;
    let [sensor_gas, sensor_wall, model, estimate] =
        squares.map(|sum: f64| (sum / steps as f64).sqrt());
    Ok(Figures {
        rmse_k: Errors { sensor_gas, sensor_wall, model, estimate },
        within_2sd: within as f64 / steps as f64,
        control_rms_error: summary.control.map(|control| control.rms_error),
    })
}
