//! `thermyo reproduce`: the paper's isotonic working cycle, and conclusions from it.
//!
//! The main run is the plant `full` with the core in the loop. In addition, the same muscle runs without friction heat
//! (how much of a sensor's reading is friction), with an element that averages over its length, as the paper's model
//! (one gas volume, no air moving under the insulation), between adiabatic and isothermal walls (the bounds), and with
//! the paper's reduced equations (6), (8), (9).

mod alphas;
mod page;

pub use alphas::Coefficient;
pub use page::page;

use crate::signals::{harmonic, harmonic_delay_s, mean, rms_difference, time_shift};
use std::thread;
use thermyo_files::input::InputError;
use thermyo_files::shipped;
use thermyo_plant::Ledger;
use thermyo_record::summary::Summary;
use thermyo_record::trace::Row;
use thermyo_scenario::{HeatModel, Paper, PlantModel};
use thermyo_setup::Loaded;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

const MOST_SHIFT_S: f64 = 2.5;

/// The scenario of the paper's experiment.
pub fn scenario() -> Result<Loaded, InputError> {
    thermyo_setup::parse(shipped::text("reproduce.toml"), "scenarios/reproduce.toml".as_ref())
}

#[derive(Debug, Clone, Default)]
pub struct Signals {
    pub time_s: Vec<f64>,
    pub pressure_pa: Vec<f64>,
    pub volume_m3: Vec<f64>,
    pub length_m: Vec<f64>,
    pub gas_k: Vec<f64>,
    pub sensor_gas_k: Vec<f64>,
    pub sensor_wall_k: Vec<f64>,
    /// The core's estimate \[K\].
    pub estimate_k: Vec<f64>,
    pub estimate_sd_k: Vec<f64>,
    pub wall_k: Vec<f64>,
    /// Mean flows since the row before \[kg/s\].
    pub flow_in_kg_s: Vec<f64>,
    pub flow_out_kg_s: Vec<f64>,
}

impl Signals {
    fn add(&mut self, row: &Row) {
        let truth = &row.truth;
        self.time_s.push(truth.time_s);
        self.pressure_pa.push(truth.pressure_pa);
        self.volume_m3.push(truth.volume_m3);
        self.length_m.push(truth.length_m);
        self.gas_k.push(truth.gas_temperature_k);
        self.sensor_gas_k.push(row.sensor_gas_k);
        self.sensor_wall_k.push(row.sensor_wall_k);
        self.estimate_k.push(f64::from(row.telemetry.estimate.gas_k));
        self.estimate_sd_k.push(f64::from(row.telemetry.estimate.gas_sd_k));
        self.wall_k.push(truth.wall_temperature_k);
        self.flow_in_kg_s.push(truth.flow_in_kg_s);
        self.flow_out_kg_s.push(truth.flow_out_kg_s);
    }

    /// Largest minus smallest value of a signal in the last whole stroke.
    pub fn stroke_swing(&self, values: &[f64], period_s: f64) -> f64 {
        let stroke = &values[self.last_stroke(period_s)];
        let low = stroke.iter().copied().fold(f64::INFINITY, f64::min);
        stroke.iter().copied().fold(f64::NEG_INFINITY, f64::max) - low
    }

    /// Indices of the rows of the last whole stroke.
    pub fn last_stroke(&self, period_s: f64) -> std::ops::Range<usize> {
        let end_s = self.time_s.last().copied().unwrap_or(0.0);
        let from = self.time_s.partition_point(|time| *time < end_s - period_s - 1e-9);
        from..self.time_s.len()
    }
}

/// Collects the main run.
#[derive(Debug)]
pub struct Study {
    loaded: Loaded,
    signals: Signals,
}

/// A simulation to compare with the main run.
#[derive(Debug, Clone)]
pub struct Variant {
    /// Name for legends.
    pub name: &'static str,
    pub signals: Signals,
    pub summary: Summary,
}

/// Response of a sensor to the gas temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorVerdict {
    /// Amplitude at the stroke's frequency, relative to the gas \[-\].
    pub gain: f64,
    /// Delay at the stroke's frequency \[s\].
    pub delay_s: f64,
    /// Highest correlation with the gas temperature, with the reading shifted back by up to half a period \[-\].
    pub correlation: f64,
    /// RMS over the run of the reading due to friction heat, over the amplitude due to the gas at the stroke's
    /// frequency \[-\].
    pub friction_to_gas: f64,
    /// Rise over the run, mean of the last stroke \[K\].
    pub rise_k: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    pub what: &'static str,
    /// Figure with its unit.
    pub figure: String,
    pub target: &'static str,
    pub holds: bool,
}

#[derive(Debug, Clone)]
pub struct Findings {
    pub signals: Signals,
    pub period_s: f64,
    /// The paper's model: one gas volume with the same friction, without air moving under the
    /// insulation.
    pub model: Signals,
    /// Rise of the model's sensor, mean of the last stroke \[K\].
    pub model_rise_k: f64,
    /// Time by which the plant's sensor lags behind the model's \[s\].
    pub model_shift_s: f64,
    /// Correlation of the two after that shift \[-\].
    pub model_correlation: f64,
    /// The element in the gas.
    pub gas_sensor: SensorVerdict,
    /// The same element, averaging over the length of the muscle.
    pub averaging_sensor: SensorVerdict,
    /// RMS error of the averaging element as a gas temperature, and of the estimate from it \[K\].
    pub averaging_rmse_k: [f64; 2],
    pub wall_sensor: SensorVerdict,
    /// The muscle without air moving under its insulation.
    pub still_air: Signals,
    /// Rise of the muscle's sensor in still air, mean of the last stroke \[K\].
    pub still_air_rise_k: f64,
    /// Coefficients of eq. (9), fitted to the plant: charging, discharging, change of volume.
    pub alphas: Option<[Coefficient; 3]>,
    /// Temperature bounds: adiabatic, constant coefficient, isothermal (one zone, full balance).
    pub bounds: Vec<Variant>,
    /// The paper's reduced equations: (6), (8), (9).
    pub reduced: Vec<Variant>,
    pub stroke: Ledger,
    pub checks: Vec<Check>,
}

impl Study {
    pub fn new(loaded: &Loaded) -> Self {
        Self { loaded: loaded.clone(), signals: Signals::default() }
    }

    pub fn add(&mut self, row: &Row) {
        self.signals.add(row);
    }

    /// Runs the variants that are compared with the main run, and evaluates the checks.
    pub fn finish(self, summary: &Summary) -> Result<Findings, RunError> {
        let period_s = self.loaded.plant.drive.period_s;
        let ratio = self.loaded.plant.gas.heat_capacity_ratio;
        let lumped = |heat: HeatModel| {
            self.loaded.with_model(PlantModel::Lumped).unexpected(|s| s.heat.model = heat)
        };
        let paper = |alpha_in: f64, alpha_out: f64, alpha: f64| {
            let mut variant = self.loaded.with_model(PlantModel::Paper);
            variant.plant.paper = Paper { alpha_in, alpha_out, alpha };
            // Eq. (6) compresses the inflow at the inside temperature, which exceeds the range of this muscle's sensor
            // by far.
            variant.with(|scenario| scenario.sensor.pressure.range_pa *= 3.0)
        };
        let frictionless = self.loaded.unexpected(|s| s.friction.heat_fraction = 0.0);
        let still_air = self.loaded.unexpected(|s| s.heat.outer_per_speed = 0.0);
        let averaging = self.loaded.with(|s| s.sensor.gas.span = 1.0);
        // The paper's model has friction heat, and no air that moves under the insulation.
        let model = still_air.with_model(PlantModel::Lumped);
        let one_stroke_less = self.loaded.unexpected(|s| s.run.duration_s -= period_s);
        let blend = &self.loaded.plant.paper;
        let variants = [
            ("without friction heat", frictionless),
            ("still air", still_air),
            ("averaging foil", averaging),
            ("the paper's model", model),
            ("one stroke less", one_stroke_less),
            ("adiabatic wall", lumped(HeatModel::Adiabatic)),
            ("constant coefficient", lumped(HeatModel::Constant)),
            ("isothermal gas", lumped(HeatModel::Isothermal)),
            ("eq. (6), adiabatic", paper(ratio, ratio, ratio)),
            ("eq. (8), isothermal", paper(1.0, 1.0, 1.0)),
            ("eq. (9), blended", paper(blend.alpha_in, blend.alpha_out, blend.alpha)),
        ];
        // Independent runs, in parallel.
        let results: Vec<Result<Variant, RunError>> = thread::scope(|scope| {
            let handles: Vec<_> = variants
                .into_iter()
                .map(|(name, loaded)| scope.spawn(move || simulate(name, &loaded)))
                .collect();
            handles
                .into_iter()
                .map(|handle| {
                    handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                })
                .collect()
        });
        let mut results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
        let reduced = results.split_off(8);
        let bounds = results.split_off(5);
        Ok(self.conclude(summary, &results, bounds, reduced))
    }

    fn conclude(
        self,
        summary: &Summary,
        full: &[Variant],
        bounds: Vec<Variant>,
        reduced: Vec<Variant>,
    ) -> Findings {
        let signals = self.signals;
        let period_s = self.loaded.plant.drive.period_s;
        let [frictionless, still_air, averaging, model, one_stroke_less] = full else {
            unreachable!("five variants of the muscle");
        };
        let row_s = self.loaded.plant.run.step_s * self.loaded.plant.run.log_every as f64;
        let most = (MOST_SHIFT_S.min(0.5 * period_s) / row_s) as usize;
        let (shift_rows, model_correlation) =
            time_shift(&model.signals.sensor_gas_k, &signals.sensor_gas_k, most);
        let verdict = |sensor: fn(&Signals) -> &Vec<f64>| {
            sensor_verdict(&signals, &frictionless.signals, sensor, period_s, row_s)
        };
        let gas_sensor = verdict(|signals| &signals.sensor_gas_k);
        let wall_sensor = verdict(|signals| &signals.sensor_wall_k);
        let rise_of = |of: &Variant| rise_k(&of.signals.sensor_gas_k, &of.signals, period_s);
        let mut findings = Findings {
            period_s,
            model_rise_k: rise_of(model),
            model: model.signals.clone(),
            averaging_sensor: sensor_verdict(
                &averaging.signals,
                &frictionless.signals,
                |signals| &signals.sensor_gas_k,
                period_s,
                row_s,
            ),
            averaging_rmse_k: [
                averaging.summary.rmse_k.sensor_gas,
                averaging.summary.rmse_k.estimate,
            ],
            alphas: alphas::fitted(&signals, &self.loaded.plant, period_s),
            model_shift_s: shift_rows * row_s,
            model_correlation,
            gas_sensor,
            wall_sensor,
            still_air_rise_k: rise_of(still_air),
            still_air: still_air.signals.clone(),
            bounds,
            reduced,
            stroke: summary.ledger.since(&one_stroke_less.summary.ledger),
            checks: Vec::new(),
            signals,
        };
        findings.checks = checks(&findings, summary);
        findings
    }
}

fn simulate(name: &'static str, loaded: &Loaded) -> Result<Variant, RunError> {
    let mut signals = Signals::default();
    let summary = run::on_core(loaded, |row| signals.add(row))?;
    Ok(Variant { name, signals, summary })
}

fn sensor_verdict(
    signals: &Signals,
    frictionless: &Signals,
    sensor: fn(&Signals) -> &Vec<f64>,
    period_s: f64,
    row_s: f64,
) -> SensorVerdict {
    let frequency_hz = 1.0 / period_s;
    // The second half of the run: whole strokes, after the first warming.
    let half = signals.time_s.len() / 2;
    let of = |values: &[f64]| harmonic(&values[half..values.len() - 1], row_s, frequency_hz);
    let (gas, reading) = (of(&signals.gas_k), of(sensor(signals)));
    let by_friction = rms_difference(sensor(signals), sensor(frictionless));
    let most = (0.5 * period_s / row_s) as usize;
    let (_, correlation) = time_shift(&signals.gas_k, sensor(signals), most);
    SensorVerdict {
        gain: reading.amplitude / gas.amplitude,
        delay_s: harmonic_delay_s(gas, reading, frequency_hz),
        correlation,
        friction_to_gas: by_friction / reading.amplitude,
        rise_k: rise_k(sensor(signals), signals, period_s),
    }
}

/// Rise of a reading over the run, mean of the last stroke against the start \[K\].
fn rise_k(reading: &[f64], signals: &Signals, period_s: f64) -> f64 {
    mean(&reading[signals.last_stroke(period_s)]) - reading[0]
}

/// Statements of the report with their figures.
fn checks(findings: &Findings, summary: &Summary) -> Vec<Check> {
    [
        figure_5_checks(findings, summary),
        figure_2_checks(summary),
        sensor_checks(findings),
        balances(summary),
    ]
    .concat()
}

fn check(what: &'static str, figure: String, target: &'static str, holds: bool) -> Check {
    Check { what, figure, target, holds }
}

fn figure_5_checks(findings: &Findings, summary: &Summary) -> Vec<Check> {
    let (sensor, foil) = (&summary.sensor_gas_k, &findings.gas_sensor);
    vec![
        check(
            "Fig. 5: the in-gas sensor starts at 298 K",
            format!("{:.2} K", sensor.first),
            "298 K within 0.2 K",
            (sensor.first - 298.0).abs() < 0.2,
        ),
        check(
            "Fig. 5: and stays in the paper's band",
            format!("{:.2} to {:.2} K", sensor.min, sensor.max),
            "298 to 300.5 K (noise 0.2 K)",
            sensor.min > 297.8 && sensor.max < 300.5,
        ),
        check(
            "Fig. 5: it rises over the run",
            format!("{:.2} K", foil.rise_k),
            "0.5 to 2 K",
            (0.5..2.0).contains(&foil.rise_k),
        ),
        check(
            "Fig. 5: the muscle warms more slowly than the model",
            format!("{:.2} and {:.2} K", foil.rise_k, findings.model_rise_k),
            "the muscle less",
            foil.rise_k < findings.model_rise_k,
        ),
        check(
            "Fig. 5: moving air under the insulation is a reason",
            format!("{:.2} K with it, {:.2} K without", foil.rise_k, findings.still_air_rise_k),
            "less with it",
            foil.rise_k < findings.still_air_rise_k,
        ),
        check(
            "Fig. 5: model and sensor have the same shape",
            format!("correlation {:.3}", findings.model_correlation),
            "at least 0.8",
            findings.model_correlation >= 0.8,
        ),
    ]
}

fn figure_2_checks(summary: &Summary) -> Vec<Check> {
    let axial = &summary.axial_temperature_k;
    let (port, end) =
        (axial.first().copied().unwrap_or(f64::NAN), axial.last().copied().unwrap_or(f64::NAN));
    vec![
        check(
            "Fig. 2: the port is the cool half, the closed end the warmest place",
            format!("{:.1} to {:.1} degC", port - 273.15, end - 273.15),
            "within 20 to 40 degC, every place beyond the middle warmer than all before it",
            axial.len() > 1
                && (axial.len() / 2..axial.len())
                    .all(|place| axial[..place].iter().all(|before| *before < axial[place]))
                && axial.iter().all(|k| (293.15..313.15).contains(k)),
        ),
        check(
            "Fig. 2: by how much (the paper's image: most of 20 K)",
            format!("{:.1} K", end - port),
            "1 to 20 K",
            (1.0..20.0).contains(&(end - port)),
        ),
    ]
}

fn sensor_checks(findings: &Findings) -> Vec<Check> {
    let (foil, wall) = (&findings.gas_sensor, &findings.wall_sensor);
    vec![
        check(
            "Section IV: the foil shows the gas, the wall sensor does not",
            format!("gain {:.3} and {:.4}", foil.gain, wall.gain),
            "foil at least 5 times the wall sensor",
            foil.gain > 5.0 * wall.gain,
        ),
        check(
            "Section IV: the foil correlates with the gas",
            format!("{:.2} and {:.2}", foil.correlation, wall.correlation),
            "foil above wall sensor",
            foil.correlation > wall.correlation,
        ),
        check(
            "Section IV: the wall sensor shows friction heat",
            format!("{:.1} and {:.1} times the gas", wall.friction_to_gas, foil.friction_to_gas),
            "wall sensor at least 5 times the foil, and more than the gas",
            wall.friction_to_gas > 5.0 * foil.friction_to_gas && wall.friction_to_gas > 1.0,
        ),
    ]
}

fn balances(summary: &Summary) -> Vec<Check> {
    vec![
        check(
            "mass balance over the run",
            format!("{:.1e}", summary.mass_balance_error),
            "below 1e-9",
            summary.mass_balance_error < 1e-9,
        ),
        check(
            "energy balance over the run",
            format!("{:.1e}", summary.energy_balance_error),
            "below 1e-6",
            summary.energy_balance_error < 1e-6,
        ),
    ]
}

impl Findings {
    /// The checks as a table for a terminal.
    pub fn text(&self) -> String {
        let width = self.checks.iter().map(|check| check.what.len()).max().unwrap_or(0);
        self.checks
            .iter()
            .map(|check| {
                let mark = if check.holds { "ok  " } else { "FAIL" };
                format!("{mark} {:width$}  {} ({})\n", check.what, check.figure, check.target)
            })
            .collect()
    }

    /// The first check that does not hold.
    pub fn failed(&self) -> Option<String> {
        let check = self.checks.iter().find(|check| !check.holds)?;
        Some(format!("{}: {}, should be {}", check.what, check.figure, check.target))
    }

    /// RMS difference of a variant's temperature to the full plant's over the last stroke \[K\].
    pub fn distance_k(&self, variant: &Variant) -> f64 {
        let rows = self.signals.last_stroke(self.period_s);
        rms_difference(&self.signals.gas_k[rows.clone()], &variant.signals.gas_k[rows])
    }
}
