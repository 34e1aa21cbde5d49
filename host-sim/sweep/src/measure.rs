//! One point of a sweep: a run, the error of each method for the gas temperature, and the error of the set point.

use std::io;
use thermyo_joint::{JointLoaded, Row as JointRow, RunError as JointRunError};
use thermyo_record::following::Followed;
use thermyo_record::limit_cycle::LimitCycle;
use thermyo_record::summary::Errors;
use thermyo_record::trace::Row;
use thermyo_scenario::Run;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Start of the errors' evaluation: the estimator needs time to learn, as in `thermyo evaluate`
/// \[s\].
const SETTLED_S: f64 = 10.0;

/// Start of the errors' evaluation \[s\]: 10 s, or half of a run shorter than 20 s.
pub fn settled_s(run: &Run) -> f64 {
    SETTLED_S.min(0.5 * run.duration_s)
}

#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Root-mean-square errors against the plant's gas temperature \[K\].
    pub rmse_k: Errors,
    /// Fraction of the steps in which the true value lies within two stated standard deviations
    /// \[-\].
    pub within_2sd: f64,
    /// Root-mean-square error of the set point over the whole run, in its unit; none without a
    /// controlled quantity.
    pub control_rms_error: Option<f64>,
    /// Figures of the loop, and of a joint's summary, in the order of their columns in `sweep.csv`; NaN where there is
    /// none.
    pub more: Vec<f64>,
}

impl Figures {
    pub(super) fn has_limit_cycle(&self) -> bool {
        let of_cycle = LOOP_COLUMNS.iter().position(|column| *column == "limit_cycle_hz");
        of_cycle.and_then(|place| self.more.get(place)).is_some_and(|hz| !hz.is_nan())
    }

    /// Whether every figure equals the other's; a figure that both lack counts as equal.
    pub(super) fn is(&self, other: &Self) -> bool {
        let all = |figures: &Self| {
            let Errors { sensor_gas, sensor_wall, model, estimate } = figures.rmse_k;
            let control = figures.control_rms_error.unwrap_or(f64::NAN);
            let mut all =
                vec![sensor_gas, sensor_wall, model, estimate, figures.within_2sd, control];
            all.extend(&figures.more);
            all
        };
        let same = |(a, b): (&f64, &f64)| a == b || (a.is_nan() && b.is_nan());
        let (own, others) = (all(self), all(other));
        own.len() == others.len() && own.iter().zip(&others).all(same)
    }
}

/// Columns of `sweep.csv` about the loop.
pub(super) const LOOP_COLUMNS: [&str; 7] = [
    "overshoot",
    "settling_s",
    "unsettled",
    "bandwidth_hz",
    "limit_cycle_hz",
    "limit_cycle_amplitude",
    "pulses_per_s",
];

fn of_loop(
    followed: Option<&Followed>,
    limit_cycle: Option<LimitCycle>,
    pulses_per_s: Option<f64>,
) -> [f64; LOOP_COLUMNS.len()] {
    [
        followed.and_then(|figures| figures.overshoot),
        followed.and_then(|figures| figures.settled_s),
        followed.map(|figures| figures.unsettled as f64),
        followed.and_then(|figures| figures.bandwidth_hz),
        limit_cycle.map(|cycle| cycle.frequency_hz),
        limit_cycle.map(|cycle| cycle.amplitude),
        pulses_per_s,
    ]
    .map(|figure| figure.unwrap_or(f64::NAN))
}

/// Columns of `sweep.csv` that only a joint has.
pub(super) const JOINT_COLUMNS: [&str; 6] = [
    "end_error_rad",
    "rms_stiffness_error",
    "limited",
    "highest_pressure_a_pa",
    "highest_pressure_b_pa",
    "vented_s",
];

/// Runs a scenario with the core in this process; the errors count from `from_s` on \[s\]. `go_on`
/// is called in each step, and its error ends the run.
pub fn measure(
    mut loaded: Loaded,
    from_s: f64,
    go_on: &mut dyn FnMut() -> io::Result<()>,
) -> Result<Figures, RunError> {
    // The observer needs every step.
    loaded.plant.run.log_every = 1;
    let mut errors = TemperatureErrors::default();
    let mut observer = |row: &Row| {
        go_on()?;
        let Row { truth, telemetry, .. } = row;
        if truth.time_s >= from_s {
            let estimate = &telemetry.estimate;
            errors.add(
                [row.sensor_gas_k, row.sensor_wall_k, row.model_k, f64::from(estimate.gas_k)],
                (truth.gas_temperature_k, f64::from(estimate.gas_sd_k)),
            );
        }
        Ok(())
    };
    let summary = run::run(&loaded, &mut CoreBoard::default(), None, &mut observer)?;
    let (rmse_k, within_2sd) = errors.figures();
    let control = summary.control.as_ref();
    let more = of_loop(
        control.map(|control| &control.followed),
        summary.limit_cycle,
        control.and_then(|control| control.pulses_per_s),
    );
    Ok(Figures {
        rmse_k,
        within_2sd,
        control_rms_error: control.map(|control| control.followed.rms_error),
        more: more.to_vec(),
    })
}

/// Runs the scenario of a joint. Temperature errors are those of the muscle with the larger error; a joint has neither
/// wall sensors nor forward models. The error of the set point is the angle's \[rad\].
pub fn measure_joint(
    mut loaded: JointLoaded,
    from_s: f64,
    go_on: &mut dyn FnMut() -> io::Result<()>,
) -> Result<Figures, JointRunError> {
    for muscle in &mut loaded.muscles {
        muscle.plant.run.log_every = 1;
    }
    let mut errors = [TemperatureErrors::default(); 2];
    let summary = thermyo_joint::run(&loaded, &mut |row: &JointRow| {
        go_on()?;
        let muscles = row.telemetry.muscles.iter().zip(&row.truth.muscles).zip(row.sensor_gas_k);
        for (errors, ((muscle, truth), sensor_gas_k)) in errors.iter_mut().zip(muscles) {
            if row.time_s >= from_s {
                let estimate = &muscle.estimate;
                errors.add(
                    [sensor_gas_k, f64::NAN, f64::NAN, f64::from(estimate.gas_k)],
                    (truth.gas_temperature_k, f64::from(estimate.gas_sd_k)),
                );
            }
        }
        Ok(())
    })?;
    let [(a, within_a), (b, within_b)] = errors.map(|errors| errors.figures());
    let of = &summary.figures;
    let [highest_a_pa, highest_b_pa] = of.highest_pressure_pa;
    Ok(Figures {
        rmse_k: Errors {
            sensor_gas: a.sensor_gas.max(b.sensor_gas),
            estimate: a.estimate.max(b.estimate),
            ..a
        },
        within_2sd: within_a.min(within_b),
        control_rms_error: Some(of.rms_error_rad),
        more: [
            &of_loop(of.control.as_ref(), of.limit_cycle, Some(of.pulses_per_s))[..],
            &[
                of.end_error_rad,
                of.rms_stiffness_error,
                of.limited,
                highest_a_pa,
                highest_b_pa,
                of.vented_s.unwrap_or(f64::NAN),
            ],
        ]
        .concat(),
    })
}

/// Gathers the errors of each method for the gas temperature.
#[derive(Debug, Clone, Copy, Default)]
struct TemperatureErrors {
    squares: [f64; 4],
    steps: u64,
    within: u64,
}

impl TemperatureErrors {
    /// Takes the temperatures of a step, the true one, and the stated standard deviation of the estimate \[K\].
    fn add(&mut self, temperatures_k: [f64; 4], (truth_k, sd_k): (f64, f64)) {
        let errors = temperatures_k.map(|temperature_k| temperature_k - truth_k);
        for (sum, error) in self.squares.iter_mut().zip(errors) {
            *sum += error * error;
        }
        self.steps += 1;
        self.within += u64::from(errors[3].abs() <= 2.0 * sd_k);
    }

    /// Root-mean-square errors, and the share of steps within two standard deviations.
    fn figures(&self) -> (Errors, f64) {
        let steps = self.steps as f64;
        let [sensor_gas, sensor_wall, model, estimate] =
            self.squares.map(|sum| (sum / steps).sqrt());
        (Errors { sensor_gas, sensor_wall, model, estimate }, self.within as f64 / steps)
    }
}
