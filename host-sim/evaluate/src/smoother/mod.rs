//! Best estimate of the core's model from a whole recorded run: the yardstick of the estimator on
//! the board.
//!
//! An extended Kalman filter with the estimator's model and tuning, written separately in f64, runs forward in
//! intervals of 20 steps; a Rauch-Tung-Striebel pass (AIAA J. 3, 1965) then carries later information back to every
//! interval. In each, the steps are computed again from the smoothed state. This is preferred to a least-squares batch
//! over the whole run because its noise is the core's, term by term, and it costs only one more run of the filter.
//!
//! Unlike the core, it has the future; pressure and length smoothed in both directions (`trend.rs`), pulse by pulse; an
//! error of the housing; derivatives by differences instead of formulae. It has neither the plant's true values nor
//! anything else that the core lacks. Where the plant does not follow the model, the smoother is wrong too, possibly
//! more than the core, because it assumes the model over the whole run. Its model has one zone and a constant
//! coefficient of still gas: in air by the laws it errs by kelvins, so it is a yardstick only with `heat.model =
//! "constant"`.

mod trend;

use self::trend::Reading;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::sample::OVERSAMPLING;
use model_core::sensing::adc::Adc;
use model_core::{AdcCode, Config, Duty, Faults, Telemetry};
use thermyo_identify::core_model::{
    HOUSING, Known, LAG, MASS, Matrix, Model, SCALE, SENSOR, State, WALL, hold_back,
};

const INTERVAL_STEPS: usize = 20;
/// Steps after a valve has shut in which a change of pressure still counts as flow. A mass held
/// constant between two pulses would keep the noise of each pulse, and drift.
const LATE_STEPS: u16 = 60;
/// The 12 bit codes that erratum RP2040-E11 widens.
const WIDE_CODES: [f64; 4] = [512.0, 1536.0, 2560.0, 3584.0];

/// One interval of the forward pass.
#[derive(Debug, Clone)]
struct Passed {
    /// State at the start, from the earlier readings.
    state: State,
    covariance: Matrix,
    inflow_kg_s: f64,
    transition: Matrix,
    predicted: State,
    predicted_covariance: Matrix,
}

/// Gas temperature \[K\] at every step of a recorded run, from its first step on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Best {
    /// Result of the forward pass alone, which uses earlier readings of the gas sensor.
    pub forward_k: Vec<f64>,
    /// Result of the whole run.
    pub smoothed_k: Vec<f64>,
}

/// Smooths a recorded run, using only the samples and the duties of the telemetry.
pub fn smooth(config: &Config, run: &[Telemetry]) -> Best {
    let Some(first) = run.first() else { return Best::default() };
    let model = Model::new(config);
    let mut sensing = config.sensing();
    let known = known(config, run);
    let reading_k = f64::from(sensing.gas_k(first.sample.gas));
    let initial =
        State::from([model.mass(&known[0], reading_k), reading_k, reading_k, reading_k, 0.0, 0.0]);
    let mut state = initial;
    let mut covariance = initial_covariance(config);
    let mut inflow_kg_s = 0.0;
    let mut passed = Vec::new();
    let mut forward_k = vec![model.gas_k(&known[0], &state); known.len()];
    for start in starts(&known) {
        let steps = interval(&known, start);
        let count = steps.len() - 1;
        let duration_s = count as f64 * f64::from(config.step_s);
        let transition = model.transition(&state, inflow_kg_s, steps);
        let mut inflow_after_kg_s = inflow_kg_s;
        let mut gas_k = forward_k[start + 1..].iter_mut();
        let predicted = model.advance(state, &mut inflow_after_kg_s, steps, |k| {
            if let Some(gas_k) = gas_k.next() {
                *gas_k = k;
            }
        });
        let gas_k = forward_k[start + 1..=start + count].iter().sum::<f64>() / count as f64;
        let predicted_covariance = transition * covariance * transition.transpose()
            + Matrix::from_diagonal(&model.drift(gas_k, duration_s));
        passed.push(Passed {
            state,
            covariance,
            inflow_kg_s,
            transition,
            predicted,
            predicted_covariance,
        });
        (state, covariance, inflow_kg_s) = (predicted, predicted_covariance, inflow_after_kg_s);
        for telemetry in &run[start + 1..=start + count] {
            if !telemetry.faults.intersects(Faults::GAS_SENSOR) {
                sensing.add_gas(telemetry.sample.gas);
            }
        }
        if let Some(reading) = sensing.take_gas() {
            let (expected_k, row) = model.reading(&state, count);
            let carried = covariance * row;
            let variance = row.dot(&carried) + reading_variance(config, count);
            state += carried * ((f64::from(reading.value_k) - expected_k) / variance);
            covariance -= carried * carried.transpose() / variance;
        }
    }
    let smoothed_k = backwards(&model, &known, state, &passed);
    Best { forward_k, smoothed_k }
}

/// First steps of the intervals.
fn starts(known: &[Known]) -> impl DoubleEndedIterator<Item = usize> + ExactSizeIterator + use<> {
    (0..known.len() - 1).step_by(INTERVAL_STEPS)
}

/// An interval's steps, the first of the next one included.
fn interval(known: &[Known], start: usize) -> &[Known] {
    &known[start..(start + INTERVAL_STEPS + 1).min(known.len())]
}

/// Rauch, Tung and Striebel's pass from the end, after a forward pass that ended in `state`.
fn backwards(model: &Model, known: &[Known], mut state: State, passed: &[Passed]) -> Vec<f64> {
    let mut smoothed_k = vec![model.gas_k(&known[0], &state); known.len()];
    for (start, passed) in starts(known).zip(passed).rev() {
        let carried = passed.covariance * passed.transition.transpose();
        let later = state - passed.predicted;
        // The drift makes the covariance positive definite.
        let smoothed = passed.predicted_covariance.cholesky().map(|c| carried * c.solve(&later));
        state = passed.state + smoothed.unwrap_or_default();
        let mut step = start;
        if start == 0 {
            smoothed_k[0] = model.gas_k(&known[0], &state);
        }
        model.advance(state, &mut passed.inflow_kg_s.clone(), interval(known, start), |k| {
            step += 1;
            smoothed_k[step] = k;
        });
    }
    smoothed_k
}

fn initial_covariance(config: &Config) -> Matrix {
    let tuning = &config.estimator;
    let initial_k = f64::from(tuning.initial_sd_k);
    let mut deviation = State::zeros();
    deviation[MASS] = initial_k / f64::from(config.ambient.temperature_k);
    deviation[WALL] = initial_k;
    deviation[HOUSING] = initial_k;
    deviation[SENSOR] = initial_k;
    deviation[SCALE] = f64::from(tuning.heat_scale_sd);
    deviation[LAG] = f64::from(tuning.lag_sd);
    Matrix::from_diagonal(&deviation.component_mul(&deviation))
}

/// Error of the gas temperature at the element that lasts for a second, as allowed for by the smoother, which has one
/// zone \[K\].
const FOIL_SD_K: f64 = 0.87;

/// Variance of the mean reading of the gas sensor over `steps` steps: noise, and a bias that counts as equal in all
/// readings of a second \[K2\].
fn reading_variance(config: &Config, steps: usize) -> f64 {
    let noise_k2 = f64::from(config.sensors.gas.noise_k).powi(2);
    // Share of the bias that the lag leaves.
    let left = 1.0 / (1.0 + f64::from(config.sensors.gas.time_constant_s));
    let bias_k2 = (FOIL_SD_K * left).powi(2);
    noise_k2 / (f64::from(OVERSAMPLING) * steps as f64)
        + bias_k2 / (steps as f64 * f64::from(config.step_s))
}

/// Smoothed pressure and length, and the valves that may have passed gas, step by step.
fn known(config: &Config, run: &[Telemetry]) -> Vec<Known> {
    let chamber = AnyChamber::new(&config.chamber);
    let sensors = &config.sensors;
    let flowing = flowing(config, run);
    let smoothed =
        |value: fn(&Telemetry) -> f32, code: fn(&Telemetry) -> AdcCode, line: Converter| {
            let reading = |i: usize| Reading {
                value: f64::from(value(&run[i])),
                variance: line.variance(code(&run[i]), &sensors.adc),
                turns: i >= 2 && run[i - 1].command.turns(run[i - 2].command),
                flowing: flowing[i] != (false, false),
            };
            trend::smooth(&(0..run.len()).map(reading).collect::<Vec<_>>())
        };
    let noise_pa = f64::from(sensors.pressure.noise_pa);
    let pressure_code_pa = f64::from(sensors.pressure.resolution_pa());
    let pressure = Converter { code: pressure_code_pa, noise: noise_pa };
    // The core's configuration has no noise of the length; the width of a code exceeds it.
    let length_code_m = f64::from(sensors.length.resolution_m());
    let length = Converter { code: length_code_m, noise: 0.0 };
    let pressure_pa = smoothed(|t| t.pressure_pa, |t| t.sample.pressure.adc(), pressure);
    let length_m = smoothed(|t| t.length_m, |t| t.sample.length, length);
    let steps = flowing.iter().zip(pressure_pa.into_iter().zip(length_m));
    let mut known: Vec<Known> = steps
        .map(|(&(charging, discharging), (pressure_pa, length_m))| Known {
            pressure_pa,
            length_m,
            volume_m3: f64::from(chamber.volume_m3(length_m as f32)),
            charging,
            discharging,
            hysteresis_j: 0.0,
        })
        .collect();
    hold_back(config, &mut known);
    known
}

/// Whether gas may have passed the inlet, and the outlet, since the step before.
fn flowing(config: &Config, run: &[Telemetry]) -> Vec<(bool, bool)> {
    let (mut inlet_steps, mut outlet_steps) = (0, 0);
    // A pulse ends late, at most one PWM period after its duty.
    let after = config.pwm_period_steps + 1 + LATE_STEPS;
    let passing = |duty: Duty, steps: u16| {
        if duty > Duty::ZERO { after } else { steps.saturating_sub(1) }
    };
    run.iter()
        .map(|telemetry| {
            let now = (inlet_steps > 0, outlet_steps > 0);
            inlet_steps = passing(telemetry.command.inlet, inlet_steps);
            outlet_steps = passing(telemetry.command.outlet, outlet_steps);
            now
        })
        .collect()
}

/// Analog channel, in its own unit.
#[derive(Debug, Clone, Copy)]
struct Converter {
    /// Width of a code of 12 bit.
    code: f64,
    noise: f64,
}

impl Converter {
    /// Variance of a sum of conversions: noise, and the width of the code with a uniform
    /// distribution.
    fn variance(&self, code: AdcCode, adc: &Adc) -> f64 {
        let conversions = f64::from(OVERSAMPLING);
        let rounding2 = self.code.powi(2) / 12.0;
        let read = f64::from(code.0) / conversions;
        let wide = WIDE_CODES.iter().any(|wide| (read - wide).abs() < 1.0);
        let hidden2 = if wide { f64::from(adc.wide_code_lsb).powi(2) * rounding2 } else { 0.0 };
        (self.noise.powi(2) + rounding2) / conversions + hidden2
    }
}
