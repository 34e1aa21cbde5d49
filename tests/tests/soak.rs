//! A day of board time: the core alone, repeatedly on the codes of one recorded working cycle.

use model_core::{Command, Config, Core, Estimate, Sample, SetPoint};
use std::time::Instant;
use thermyo_scenario::PlantModel;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run;

/// Steps of one working cycle of 5 s.
const CYCLE: usize = 5_000;
/// Duration of the run whose last cycle is recorded \[s\]: the wall no longer warms from stroke to stroke, since a
/// repeated record would otherwise contradict the law of the wall.
const WARM_S: f64 = 600.0;
/// Cycle by which the estimator has forgotten how it started: 1500 s, four time constants of the wall and five of its
/// memory.
const SETTLED_CYCLE: u32 = 300;

struct Step {
    sample: Sample,
    /// Command that the valves then received.
    command: Command,
    gas_k: f64,
}

/// Configuration, and the last cycle of the nominal run.
fn recorded(model: PlantModel) -> (Config, Vec<Step>) {
    let mut loaded = thermyo_evaluate::nominal().unwrap().with_model(model);
    loaded.plant.run.log_every = 1;
    loaded.plant.run.duration_s = WARM_S;
    let mut steps = Vec::new();
    run::on_core(&loaded, |row| {
        let model_core::Telemetry { sample, command, .. } = row.telemetry;
        steps.push(Step { sample, command, gas_k: row.truth.gas_temperature_k });
    })
    .unwrap();
    (core_config(&loaded.believed), steps.split_off(steps.len() - CYCLE))
}

/// The recorded duties as a set point. A controller in a loop that nothing closes would open valves other than those
/// through which the recorded gas flowed.
fn duties(command: Command) -> SetPoint {
    SetPoint::Duty { inlet: command.inlet.share(), outlet: command.outlet.share() }
}

/// Differences of the estimate between cycle [`SETTLED_CYCLE`] and the last one \[K\].
struct Drift {
    /// Root mean square over the whole cycle.
    rms_k: f64,
    /// Largest difference in one step. The last bit of a state may decide whether a reading is within a code that the
    /// converter makes too wide; for a few milliseconds, the estimates then differ as the readings at that edge do.
    worst_k: f64,
}

impl Drift {
    fn check(&self, model: PlantModel) {
        let Drift { rms_k, worst_k } = *self;
        assert!(rms_k < 0.01 && worst_k < 0.1, "{model:?}: {rms_k} K RMS, {worst_k} K at one step");
    }
}

fn drift(model: PlantModel, cycles: u32) -> Drift {
    let (config, record) = recorded(model);
    let mut core = Core::new(&config).unwrap();
    let started = Instant::now();
    let mut settled = Vec::with_capacity(CYCLE);
    let (mut squares, mut worst_k) = (0.0, 0.0_f64);
    for cycle in 1..=cycles {
        for (step, Step { sample, command, gas_k: true_k }) in record.iter().enumerate() {
            core.set(duties(*command)).unwrap();
            let telemetry = core.step(sample);
            let Estimate { gas_k, gas_sd_k, .. } = telemetry.estimate;
            // Comparisons with NaN are false.
            assert!((200.0..400.0).contains(&gas_k), "{gas_k} K in cycle {cycle}, step {step}");
            assert!((1e-3..50.0).contains(&gas_sd_k), "{gas_sd_k} K in cycle {cycle}, step {step}");
            if cycle > 1 {
                assert_eq!(telemetry.command, *command, "cycle {cycle}, step {step}");
            }
            if cycle == SETTLED_CYCLE {
                let error_k = (f64::from(gas_k) - true_k).abs();
                assert!(error_k < 1.0, "{error_k} K in step {step}");
                settled.push(gas_k);
            } else if cycle == cycles {
                let difference_k = f64::from(gas_k - settled[step]).abs();
                squares += difference_k.powi(2);
                worst_k = worst_k.max(difference_k);
            }
        }
    }
    let steps = f64::from(cycles) * CYCLE as f64;
    let per_s = steps / started.elapsed().as_secs_f64();
    let rms_k = (squares / CYCLE as f64).sqrt();
    println!(
        "{model:?}: {steps:.0} steps, {per_s:.2e} per second, drift {rms_k:.5} K RMS, {worst_k:.5} K at one step"
    );
    Drift { rms_k, worst_k }
}

#[test]
fn the_estimate_does_not_drift_in_half_an_hour() {
    drift(PlantModel::Full, 360).check(PlantModel::Full);
}

#[test]
#[ignore = "10^8 steps per plant; fast only in release: cargo test --release -p system-tests soak -- --ignored"]
fn the_estimate_does_not_drift_in_a_day() {
    for model in [PlantModel::Lumped, PlantModel::Full] {
        drift(model, 20_000).check(model);
    }
}

/// RMS error of the estimate and mean stated deviation of each hour of the nominal cycle \[K\].
fn hours_k(hours: usize) -> Vec<(f64, f64)> {
    const HOUR_S: f64 = 3600.0;
    let mut loaded = thermyo_evaluate::nominal().unwrap().with_model(PlantModel::Lumped);
    loaded.plant.run.duration_s = hours as f64 * HOUR_S;
    let mut sums = vec![(0.0, 0.0, 0.0); hours];
    run::on_core(&loaded, |row| {
        let hour = (row.truth.time_s / HOUR_S) as usize;
        // The estimator learns during the first 500 s.
        if let Some(sum) = sums.get_mut(hour)
            && row.truth.time_s > 500.0
        {
            let estimate = &row.telemetry.estimate;
            sum.0 += (f64::from(estimate.gas_k) - row.truth.gas_temperature_k).powi(2);
            sum.1 += f64::from(estimate.gas_sd_k);
            sum.2 += 1.0;
        }
        assert_eq!(row.telemetry.faults, model_core::Faults::NONE, "{} s", row.truth.time_s);
    })
    .unwrap();
    sums.iter().map(|(squares, sd, count)| ((squares / count).sqrt(), sd / count)).collect()
}

#[test]
#[ignore = "ten simulated hours in closed loop; fast only in release, as the day"]
fn the_last_of_ten_hours_is_like_the_first() {
    let hours = hours_k(10);
    println!("error and stated deviation per hour, K: {hours:.4?}");
    let (first, last) = (hours[0], hours[9]);
    assert!((0.8..1.25).contains(&(last.0 / first.0)), "error: {hours:?}");
    assert!((0.9..1.1).contains(&(last.1 / first.1)), "deviation: {hours:?}");
}
