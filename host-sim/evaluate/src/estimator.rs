//! Accuracy of the estimated gas temperature: configured correctly, wrongly, with a wrong start,
//! and in motions other than those of the tuning; also relative to the best estimate from the same
//! samples.

use super::control::isometric;
use super::faults::muscle::{self, Draw, Spread, Task};
use super::{CaseFigures, Figure};
use crate::smoother;
use model_core::Telemetry;
use thermyo_compute::parallel;
use thermyo_compute::parallel::Watch;
use thermyo_record::trace::Row;
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{ChannelFault, DriveKind, FaultWindow, HeatModel, PlantModel, ValveFault};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Start of the errors' evaluation: the estimator needs time to learn \[s\].
const SETTLED_S: f64 = 10.0;
/// Start of the evaluation after an initial temperature that is wrong by 10 K \[s\].
const RECOVERED_S: f64 = 15.0;

/// A case: name, change, and bounds on the RMS error for `lumped` and `full` \[K\].
#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub name: &'static str,
    /// Change of the nominal scenario.
    pub change: fn(&mut Loaded),
    /// Bounds; none on a plant that lacks the effect that the case changes: it would repeat the nominal case, and could
    /// not fail.
    bounds_k: [Option<f64>; 2],
    /// Bounds on the fraction of time within two stated standard deviations.
    within: (f64, f64),
    /// Start of the errors' evaluation \[s\].
    pub from_s: f64,
}

/// Largest error of the estimate, as a multiple of the smoother's error.
const TIMES_SMOOTHER: f64 = 1.5;

/// Range of the fraction of time within two stated deviations, in one run. Strokes repeat their errors, so only the
/// pooled fraction can be compared with a normal distribution.
const IN_ONE_RUN: (f64, f64) = (0.75, 1.0);

pub fn cases() -> Vec<Case> {
    let of = |name, bounds_k, change| Case {
        name,
        change,
        bounds_k,
        within: IN_ONE_RUN,
        from_s: SETTLED_S,
    };
    let case = |name, bounds_k: [f64; 2], change| of(name, bounds_k.map(Some), change);
    let on_full = |name, bound_k, change| of(name, [None, Some(bound_k)], change);
    vec![
        case("nominal", [0.15, 0.4], |_| {}),
        case("heat transfer believed 30 % low", [0.3, 0.6], |l| scale_heat(l, 0.7)),
        case("heat transfer believed 30 % high", [0.3, 0.6], |l| scale_heat(l, 1.3)),
        case("sensor lag believed 20 % low", [0.5, 0.8], |l| scale_lag(l, 0.8)),
        case("sensor lag believed 20 % high", [0.5, 0.8], |l| scale_lag(l, 1.2)),
        case("supply believed 3 K cold", [0.3, 0.6], |l| warm_supply(l, -3.0)),
        case("supply believed 3 K warm", [0.3, 0.6], |l| warm_supply(l, 3.0)),
        case("all low at once", [0.8, 1.0], |l| {
            scale_heat(l, 0.7);
            scale_lag(l, 0.8);
            warm_supply(l, -3.0);
        }),
        case("all high at once", [0.8, 1.0], |l| {
            scale_heat(l, 1.3);
            scale_lag(l, 1.2);
            warm_supply(l, 3.0);
        }),
        Case {
            from_s: RECOVERED_S,
            // The sensor starts at the gas temperature: warm gas in a muscle that has just been
            // flushed, 10 K from the temperature of the sensor's mount.
            ..case("started 10 K wrong", [0.3, 0.6], |l| {
                l.plant.plant.initial_temperature_k += 10.0
            })
        },
        case("strokes of 1 s", [0.3, 0.6], |l| period(l, 1.0)),
        case("strokes of 2 s", [0.3, 0.6], |l| period(l, 2.0)),
        case("strokes of 10 s", [0.3, 0.6], |l| period(l, 10.0)),
        case("strokes of 30 s", [0.3, 0.6], |l| period(l, 30.0)),
        case("random pressure steps", [0.3, 0.6], random_pressure),
        case("isometric hold", [0.3, 0.6], |l| {
            *l = isometric(l, 0.27);
            random_pressure(l);
        }),
        case("held at 1.5 bar", [0.1, 0.15], |l| {
            l.plant.drive.kind = DriveKind::Pressure;
            l.drive_profile = profile(&[(0.0, 1.5e5)]);
        }),
        case("dump from 5 bar", [0.3, 0.6], |l| {
            l.plant.drive.kind = DriveKind::Pressure;
            l.drive_profile =
                profile(&[(0.0, 5.0e5), (20.0, 5.0e5), (20.01, 1.1e5), (50.0, 1.1e5)]);
        }),
        case("still gas of 8 W/(m2 K)", [0.6, 0.6], |l| still(l, 8.0)),
        case("still gas of 15 W/(m2 K)", [0.4, 0.4], |l| still(l, 15.0)),
        case("still gas of 30 W/(m2 K)", [0.3, 0.3], |l| still(l, 30.0)),
        case("still gas of 90 W/(m2 K)", [0.25, 0.25], |l| still(l, 90.0)),
        case("still gas of 150 W/(m2 K)", [0.25, 0.25], |l| still(l, 150.0)),
        case("heat transfer believed half", [1.0, 1.0], |l| scale_heat(l, 0.5)),
        case("heat transfer believed twice", [1.0, 1.0], |l| scale_heat(l, 2.0)),
        on_full("housing of 0.6 s believed 0.2 s", 0.5, |l| {
            l.plant.sensor.gas.housing_time_constant_s = 0.6;
        }),
        case("sensor lag of 9 s believed 3 s", [0.5, 0.5], |l| {
            l.plant.sensor.gas.time_constant_s = 9.0;
        }),
        case("sensor lag of 1 s believed 3 s", [0.5, 0.5], |l| {
            l.plant.sensor.gas.time_constant_s = 1.0;
        }),
        on_full("hose of 0.25 m", 0.4, |l| hose(l, 0.25)),
        on_full("hose of 0.5 m", 0.4, |l| hose(l, 0.5)),
        on_full("hose of 1 m", 0.4, |l| hose(l, 1.0)),
        on_full("hose of 2 m", 0.4, |l| hose(l, 2.0)),
        // 0.02 % of the gas per second, the loss of a tight muscle.
        on_full("held at 3 bar, a leak not believed", 1.0, |l| {
            l.plant.drive.kind = DriveKind::Pressure;
            l.drive_profile = profile(&[(0.0, 3.0e5)]);
            l.plant.leak.conductance_m3_s_pa = 5.0e-13;
        }),
        // Some 0.4 % of the gas per second in either direction.
        on_full("contraction held, a leak not believed", 0.3, |l| {
            hold_contraction(l);
            l.plant.leak.conductance_m3_s_pa = 1.0e-11;
        }),
        on_full("contraction held, inlet not tight", 0.3, |l| {
            hold_contraction(l);
            l.plant.faults.own = FaultWindow {
                inlet: ValveFault::Leaking,
                inlet_leak: Some(5.0e-4),
                ..FaultWindow::default()
            };
        }),
        on_full("strokes of 30 s, sensor frozen for 5 s", 0.6, |l| {
            period(l, 30.0);
            let frozen = FaultWindow {
                gas: ChannelFault::Frozen,
                from_s: 40.0,
                until_s: 45.0,
                ..FaultWindow::default()
            };
            l.plant.faults.own = frozen;
        }),
    ]
}

/// A constant coefficient for still gas \[W/(m2 K)\], configured correctly.
fn still(loaded: &mut Loaded, inner_w_m2_k: f64) {
    *loaded =
        loaded.with(|s| (s.heat.model, s.heat.inner_w_m2_k) = (HeatModel::Constant, inner_w_m2_k));
}

fn hold_contraction(loaded: &mut Loaded) {
    loaded.plant.drive.kind = DriveKind::Contraction;
    loaded.drive_profile = profile(&[(0.0, 0.1)]);
}

/// A hose of 4 mm between valves and muscle, configured correctly.
fn hose(loaded: &mut Loaded, length_m: f64) {
    *loaded = loaded.with(|s| (s.tube.length_m, s.tube.diameter_m) = (Some(length_m), Some(0.004)));
}

fn scale_heat(loaded: &mut Loaded, factor: f64) {
    loaded.believed.heat.scale *= factor;
}

fn scale_lag(loaded: &mut Loaded, factor: f64) {
    loaded.believed.sensor.gas.time_constant_s *= factor;
}

fn warm_supply(loaded: &mut Loaded, by_k: f64) {
    loaded.believed.supply.temperature_k += by_k;
}

/// Another stroke, with the same mass if the valves can move it.
fn period(loaded: &mut Loaded, period_s: f64) {
    let drive = &mut loaded.plant.drive;
    // Slower strokes move the same mass; faster ones are limited by the flow of the outlet valve.
    drive.flow_kg_s *= (drive.period_s / period_s).min(1.0);
    drive.period_s = period_s;
}

/// Pseudo-random pressure steps from 1.3 to 4.5 bar, the same in every run: a linear congruential
/// generator (Numerical Recipes).
fn random_pressure(loaded: &mut Loaded) {
    let mut state = 2013_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24)
    };
    let mut points = vec![(0.0, 2.0e5)];
    let mut time_s = 0.0;
    while time_s < loaded.plant.run.duration_s {
        time_s += 0.5 + 4.0 * random();
        let pressure_pa = 1.3e5 + 3.2e5 * random();
        let before = points.last().map_or(2.0e5, |point: &(f64, f64)| point.1);
        points.push((time_s, before));
        points.push((time_s + 0.01, pressure_pa));
    }
    loaded.plant.drive.kind = DriveKind::Pressure;
    loaded.drive_profile = profile(&points);
}

fn profile(points: &[(f64, f64)]) -> Option<Profile> {
    Some(Profile::new(points.to_vec()).expect("times increase"))
}

#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    steps: u64,
    squares_k2: f64,
    bare_squares_k2: f64,
    forward_squares_k2: f64,
    smoother_squares_k2: f64,
    stated_squares_k2: f64,
    within: u64,
}

impl Errors {
    /// Root of the mean of one of the sums \[K\].
    fn rms_k(&self, squares_k2: f64) -> f64 {
        (squares_k2 / self.steps as f64).sqrt()
    }

    /// Error of the estimate, RMS \[K\].
    fn error_k(&self) -> f64 {
        self.rms_k(self.squares_k2)
    }

    fn share_within(&self) -> f64 {
        self.within as f64 / self.steps as f64
    }
}

/// Errors of one run from `from_s` on; calls `seen` with every row.
fn run(loaded: &Loaded, from_s: f64, mut seen: impl FnMut(&Row)) -> Result<Errors, RunError> {
    let mut errors = Errors::default();
    run::on_core(loaded, |row| {
        let truth_k = row.truth.gas_temperature_k;
        seen(row);
        if row.truth.time_s >= from_s {
            let estimate = &row.telemetry.estimate;
            let error = f64::from(estimate.gas_k) - truth_k;
            let stated_k = f64::from(estimate.gas_sd_k);
            errors.steps += 1;
            errors.squares_k2 += error * error;
            errors.bare_squares_k2 += (row.sensor_gas_k - truth_k).powi(2);
            errors.stated_squares_k2 += stated_k * stated_k;
            errors.within += u64::from(error.abs() <= 2.0 * stated_k);
        }
    })?;
    Ok(errors)
}

fn measure(loaded: &Loaded, from_s: f64) -> Result<Errors, RunError> {
    let mut telemetry: Vec<Telemetry> = Vec::new();
    let mut truth: Vec<f64> = Vec::new();
    let mut errors = run(loaded, from_s, |row| {
        telemetry.push(row.telemetry);
        truth.push(row.truth.gas_temperature_k);
    })?;
    let best = smoother::smooth(&core_config(&loaded.believed), &telemetry);
    let counted = truth.len() - errors.steps as usize;
    let squares_k2 = |best_k: &[f64]| {
        let errors = best_k[counted..].iter().zip(&truth[counted..]);
        errors.map(|(best_k, truth_k)| (best_k - truth_k).powi(2)).sum()
    };
    errors.forward_squares_k2 = squares_k2(&best.forward_k);
    errors.smoother_squares_k2 = squares_k2(&best.smoothed_k);
    Ok(errors)
}

/// Runs every case on `lumped` and on `full`, on all cores. When stopped, returns the lines of the
/// finished cases.
pub fn evaluate(nominal: &Loaded, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
    let [lumped, full] =
        [PlantModel::Lumped, PlantModel::Full].map(|model| nominal.with_model(model));
    let cases = cases();
    let jobs: Vec<(&Case, usize, f64)> = cases
        .iter()
        .flat_map(|case| {
            (0..2)
                .filter_map(move |plant| case.bounds_k[plant].map(|bound_k| (case, plant, bound_k)))
        })
        .collect();
    let results: Vec<Result<_, RunError>> =
        parallel::map_watched(&jobs, watch, |&(case, plant, bound_k)| {
            let mut loaded = [&lumped, &full][plant].clone();
            loaded.plant.run.log_every = 1;
            (case.change)(&mut loaded);
            measure(&loaded, case.from_s).map(|errors| (case, plant, bound_k, errors))
        });
    let mut lines = Vec::new();
    for (case, plant, bound_k, errors) in results.into_iter().collect::<Result<Vec<_>, _>>()? {
        let times_smoother = errors.error_k() / errors.rms_k(errors.smoother_squares_k2);
        let mut figures = vec![
            Figure::at_most("error_k", errors.error_k(), bound_k),
            Figure::shown("stated_k", errors.rms_k(errors.stated_squares_k2)),
            Figure::shown("forward_k", errors.rms_k(errors.forward_squares_k2)),
            Figure::shown("smoother_k", errors.rms_k(errors.smoother_squares_k2)),
            Figure::at_most("times_smoother", times_smoother, TIMES_SMOOTHER),
            Figure::within("within_2sd", errors.share_within(), case.within),
        ];
        if case.name == "nominal" {
            let times = errors.rms_k(errors.bare_squares_k2) / errors.error_k();
            figures.push(Figure::at_least("times_better", times, [40.0, 15.0][plant]));
        }
        lines.push(CaseFigures {
            case: format!("{} {}", ["lumped", "full  "][plant], case.name),
            figures,
        });
    }
    lines.sort_by_key(|line| line.case.starts_with("full"));
    Ok(lines)
}

/// Duration of a run of a random muscle \[s\].
const MUSCLE_S: f64 = 60.0;
/// Ranges of the random muscles.
const SPREAD: Spread = Spread { loads_n: [20.0, 800.0], lags_s: [0.3, 8.0] };
/// Largest RMS error on a random muscle, and the mean over all, configured correctly and wrongly \[K\].
const RANDOM_K: [f64; 2] = [1.0, 2.0];
const RANDOM_MEAN_K: [f64; 2] = [0.4, 0.8];
/// Range of the fraction of time within two stated deviations, over all muscles.
const POOLED: (f64, f64) = (0.93, 0.98);
/// Ranges of a muscle's air and sensor: still gas \[W/(m2 K)\], factors on stirring and on the laws of air, the housing
/// \[s\], the position of the element along and across.
const STILL_W_M2_K: [f64; 2] = [5.0, 150.0];
const STIRRED: [f64; 2] = [0.3, 3.0];
const HOUSINGS_S: [f64; 2] = [0.05, 0.6];
const POSITIONS: [f64; 2] = [0.3, 0.7];
const RADII: [f64; 2] = [0.0, 1.0];
/// Errors of a user's configuration: heat and stirring (a logarithm), lag (a share), position; and the configured
/// housing \[s\].
const HEAT_OFF: f64 = 0.3;
const LAG_OFF: f64 = 0.2;
const POSITION_OFF: f64 = 0.1;
const HOUSING_BELIEVED_S: f64 = 0.2;

/// Gives a random muscle its air and its sensor; if they are not `known`, the core's configuration differs.
fn vary(seed: u64, number: u64, known: bool, loaded: &mut Loaded) {
    let mut draw = Draw::new(seed.wrapping_mul(7_919).wrapping_add(number));
    let laws = draw.sign() > 0.0;
    let (still, stirred) = (draw.factor(STILL_W_M2_K), draw.factor(STIRRED));
    let (housing_s, position) = (draw.factor(HOUSINGS_S), draw.between(POSITIONS));
    let radius = draw.between(RADII);
    for s in [&mut loaded.plant, &mut loaded.believed] {
        if laws {
            s.heat.scale = stirred;
            s.heat.stirring_decay_s *= stirred;
        } else {
            s.heat.model = HeatModel::Constant;
            s.heat.inner_w_m2_k = still;
            s.heat.inner_per_flow *= stirred;
        }
        let foil = &mut s.sensor.gas;
        (foil.housing_time_constant_s, foil.position, foil.radius) = (housing_s, position, radius);
    }
    if known {
        return;
    }
    let mut off = |by: f64| draw.between([-by, by]);
    let s = &mut loaded.believed;
    s.heat.scale *= off(HEAT_OFF).exp();
    s.heat.inner_per_flow *= off(HEAT_OFF).exp();
    let foil = &mut s.sensor.gas;
    foil.time_constant_s *= 1.0 + off(LAG_OFF);
    foil.position += off(POSITION_OFF);
    foil.housing_time_constant_s = HOUSING_BELIEVED_S;
}

/// Random muscle `number` of `seed`, with a description.
pub fn random_muscle(seed: u64, number: u64) -> (String, Loaded) {
    let mut draw = Draw::new(seed.wrapping_mul(1_000_003).wrapping_add(number));
    let task = draw.of(&Task::MOVING);
    let loaded = muscle::random_within(&SPREAD, &mut draw, PlantModel::Full, task, MUSCLE_S);
    let s = &loaded.plant;
    let name = format!(
        "{number:3} {:17} {:2.0} mm {:3.0} N {:3.0} K lag {:.1} s",
        task.name(),
        1e3 * s.muscle.diameter_m,
        s.load.force_n,
        s.ambient.temperature_k,
        s.sensor.gas.time_constant_s
    );
    (name, loaded)
}

/// `count` random muscles on `full`, in motion (without motion all models agree), configured correctly, and as by a
/// user who does not know heat, lag, housing and position. When stopped, returns the finished lines.
pub fn random(seed: u64, count: u64, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
    let mut lines = Vec::new();
    let mut all = Pool::default();
    for (known, word) in [(true, "known"), (false, "unknown")] {
        let numbers: Vec<u64> = (0..count).collect();
        let results = parallel::map_watched(&numbers, watch, |&number| {
            let (case, mut loaded) = random_muscle(seed, number);
            vary(seed, number, known, &mut loaded);
            run(&loaded, SETTLED_S, |_| {}).map(|errors| (format!("{word:7} {case}"), errors))
        });
        let mut pool = Pool::default();
        for (case, errors) in results.into_iter().collect::<Result<Vec<_>, RunError>>()? {
            pool.add(&errors);
            all.add(&errors);
            lines.push(muscle_line(case, &errors, RANDOM_K[usize::from(!known)]));
        }
        if pool.runs > 0.0 {
            let most_k = RANDOM_MEAN_K[usize::from(!known)];
            lines.push(CaseFigures {
                case: format!("{} muscles of seed {seed}, {word}", pool.runs),
                figures: vec![
                    Figure::at_most("mean_k", pool.sum_k / pool.runs, most_k),
                    Figure::shown("worst_k", pool.worst_k),
                    Figure::shown("mean_within", pool.within / pool.runs),
                ],
            });
        }
    }
    if all.runs > 0.0 {
        lines.push(CaseFigures {
            case: format!("all of seed {seed}"),
            figures: vec![Figure::within("within_2sd", all.within / all.runs, POOLED)],
        });
    }
    Ok(lines)
}

/// Sums over several muscles.
#[derive(Debug, Clone, Copy, Default)]
struct Pool {
    runs: f64,
    sum_k: f64,
    worst_k: f64,
    within: f64,
}

impl Pool {
    fn add(&mut self, errors: &Errors) {
        self.runs += 1.0;
        self.sum_k += errors.error_k();
        self.worst_k = self.worst_k.max(errors.error_k());
        self.within += errors.share_within();
    }
}

fn muscle_line(case: String, errors: &Errors, most_k: f64) -> CaseFigures {
    CaseFigures {
        case,
        figures: vec![
            Figure::at_most("error_k", errors.error_k(), most_k),
            Figure::shown("bare_k", errors.rms_k(errors.bare_squares_k2)),
            Figure::shown("stated_k", errors.rms_k(errors.stated_squares_k2)),
            Figure::within("within_2sd", errors.share_within(), IN_ONE_RUN),
        ],
    }
}
