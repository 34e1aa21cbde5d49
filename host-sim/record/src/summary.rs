//! `summary.json`: the figures of a run, gathered during the run.

use crate::limit_cycle::LimitCycle;
use crate::measured::Measured;
use crate::trace::{COLUMNS, Row};
use crate::tracking::{Control, Controlled, Tracked, Tracking};
use model_core::Faults;
use model_core::safety::supervisor::VENTING;
use model_core::sensing::adc::at_rail;
use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_files::number::fixed;
use thermyo_plant::Ledger;
use thermyo_protocol::Timing;

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    pub duration_s: f64,
    /// Working strokes; 0 if the drive has no period.
    pub strokes: u64,
    /// Simulated time per wall-clock time \[-\].
    pub real_time_factor: f64,
    pub board: String,
    pub pressure_pa: Range,
    /// Contraction of a muscle, as a fraction of the rest length \[-\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contraction: Option<Range>,
    pub gas_temperature_k: Range,
    pub sensor_gas_k: Readings,
    pub sensor_wall_k: Readings,
    /// Root-mean-square errors against the plant's gas temperature \[K\].
    pub rmse_k: Errors,
    /// Fraction of the rows in which the true value lies within two stated deviations \[-\].
    pub estimate_within_2sd: f64,
    /// Root mean square of the stated deviation \[K\].
    pub estimate_stated_k: f64,
    pub mass_balance_error: f64,
    pub energy_balance_error: f64,
    pub ledger: Ledger,
    /// Surface temperature along the muscle at the end, port first \[K\].
    pub axial_temperature_k: Vec<f64>,
    /// Gas temperature along the muscle at the end, port first \[K\].
    pub axial_gas_temperature_k: Vec<f64>,
    /// The core's own reports.
    pub core: CoreFigures,
    /// Control errors, if there is a controlled quantity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// The largest limit cycle around a constant set point, if there was one. Its amplitude is in
    /// Pa or a fraction of the rest length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit_cycle: Option<LimitCycle>,
    /// Timing of the steps, if the board is not this process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingFigures>,
    /// Root-mean-square and largest difference to the measured columns, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<BTreeMap<String, Difference>>,
}

/// Range and mean of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Range {
    pub min: f64,
    pub max: f64,
    /// Mean over the steps.
    pub mean: f64,
}

/// Range and ends of a sensor's readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Readings {
    pub min: f64,
    pub max: f64,
    pub first: f64,
    pub last: f64,
}

/// Root-mean-square errors \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    pub sensor_gas: f64,
    pub sensor_wall: f64,
    /// The forward model, which uses the mass flows only.
    pub model: f64,
    /// The core's estimate.
    pub estimate: f64,
}

/// The core's own reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoreFigures {
    pub steps: u64,
    /// Steps in which a sensor's code was at a rail.
    pub saturations: u64,
    /// Steps in which the set point required more than the allowed pressure.
    pub limited: u64,
    /// Every fault bit that was ever set.
    pub faults: u32,
    pub fault_names: Vec<&'static str>,
    /// Time of the first venting fault \[s\].
    pub vented_s: Option<f64>,
    /// Time of the first fault that is only shown \[s\].
    pub shown_s: Option<f64>,
}

const SHOWN: Faults = Faults(!VENTING.0);

/// Faults of one kind in a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// "vented", or "reported" for faults that do not vent.
    pub what: &'static str,
    /// Time of the first fault of this kind \[s\].
    pub from_s: f64,
    pub faults: Faults,
}

impl CoreFigures {
    /// Venting faults and faults that were only shown, if there were any.
    pub fn found(&self) -> impl Iterator<Item = Found> {
        let all = Faults(self.faults);
        [("vented", self.vented_s, all.of(VENTING)), ("reported", self.shown_s, all.of(SHOWN))]
            .into_iter()
            .filter_map(|(what, from_s, faults)| Some(Found { what, from_s: from_s?, faults }))
    }

    /// The faults as text: "vented from 2.06 s: pressure sensor, overpressure".
    pub fn fault_text(&self) -> Option<String> {
        let each = self.found().map(|Found { what, from_s, faults }| {
            format!("{what} from {} s: {faults}", fixed(from_s, 2))
        });
        each.reduce(|all, next| format!("{all}; {next}"))
    }

    /// One line of text; none without a fault.
    pub fn fault_line(&self) -> String {
        self.fault_text().map_or_else(String::new, |text| format!("warning: the core {text}\n"))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Difference {
    pub rmse: f64,
    pub max: f64,
}

/// Number of complete strokes of this period.
pub fn whole_strokes(duration_s: f64, period_s: f64) -> u64 {
    (duration_s / period_s + 1e-9).floor() as u64
}

/// Timing of a board's steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimingFigures {
    /// Mean time of the core's step \[us\].
    pub step_mean_us: f64,
    /// Worst time of the core's step \[us\].
    pub step_worst_us: f64,
    /// Worst delay of a start, relative to the mean delay \[us\].
    pub jitter_worst_us: f64,
    pub missed_steps: u32,
}

impl TimingFigures {
    pub fn text(&self) -> String {
        let Self { step_mean_us, step_worst_us, missed_steps, .. } = self;
        format!(
            "core step {step_mean_us:.0} us mean, {step_worst_us:.0} us worst; {missed_steps} missed"
        )
    }
}

impl From<&Timing> for TimingFigures {
    fn from(timing: &Timing) -> Self {
        let mean_us = f64::from(timing.jitter_mean_ns) / 1e3;
        Self {
            step_mean_us: f64::from(timing.step_mean_ns) / 1e3,
            step_worst_us: f64::from(timing.step_worst_us),
            jitter_worst_us: f64::from(timing.jitter_worst_us) - mean_us,
            missed_steps: timing.missed_steps,
        }
    }
}

/// Inputs of the summary that the accumulator does not gather.
#[derive(Debug, Clone, PartialEq)]
pub struct Ending {
    pub wall_clock_s: f64,
    pub board: &'static str,
    /// Period of the working cycle, if it has one \[s\].
    pub period_s: Option<f64>,
    pub controlled: Option<Controlled>,
    pub limit_cycle: Option<LimitCycle>,
    pub rest_length_m: Option<f64>,
    pub ledger: Ledger,
    pub axial_wall_k: Vec<f64>,
    pub axial_gas_k: Vec<f64>,
    /// Timing of the board's steps.
    pub timing: Option<Timing>,
}

/// Gathers the figures of a run, step by step, in constant memory.
#[derive(Debug, Clone)]
pub struct Accumulator {
    duration_s: f64,
    steps: u64,
    pressure: Extent,
    length: Extent,
    gas: Extent,
    sensor_gas: Extent,
    sensor_wall: Extent,
    squares: Errors,
    within_2sd: u64,
    /// Sum of the squares of the stated deviation \[K2\].
    stated_k2: f64,
    saturations: u64,
    limited: u64,
    faults: Faults,
    vented_s: Option<f64>,
    shown_s: Option<f64>,
    tracking: Tracking,
    comparisons: Vec<Comparison>,
}

#[derive(Debug, Clone, Copy)]
struct Extent {
    min: f64,
    max: f64,
    sum: f64,
    first: f64,
    last: f64,
}

impl Extent {
    const EMPTY: Self = Self {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        sum: 0.0,
        first: f64::NAN,
        last: f64::NAN,
    };

    fn add(&mut self, value: f64) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.sum += value;
        if self.first.is_nan() {
            self.first = value;
        }
        self.last = value;
    }

    fn range(&self, count: f64) -> Range {
        Range { min: self.min, max: self.max, mean: self.sum / count }
    }

    fn readings(&self) -> Readings {
        Readings { min: self.min, max: self.max, first: self.first, last: self.last }
    }
}

/// One measured column, compared with the run while it goes on.
#[derive(Debug, Clone)]
struct Comparison {
    name: String,
    column: usize,
    points: Vec<(f64, f64)>,
    next: usize,
    before: Option<(f64, f64)>,
    squares: f64,
    max: f64,
    count: u64,
}

impl Comparison {
    /// Takes the run's value at a time, and compares all measured points up to it with the run,
    /// interpolated linearly between its steps.
    fn pass(&mut self, time_s: f64, value: f64) {
        while let Some(&(measured_s, measured)) = self.points.get(self.next) {
            if measured_s > time_s {
                break;
            }
            let run = match self.before {
                Some((before_s, before)) if time_s > before_s => {
                    before + (value - before) * (measured_s - before_s) / (time_s - before_s)
                }
                _ => value,
            };
            let difference = run - measured;
            self.squares += difference * difference;
            self.max = self.max.max(difference.abs());
            self.count += 1;
            self.next += 1;
        }
        self.before = Some((time_s, value));
    }
}

impl Summary {
    /// Fraction within two stated deviations below which the estimate is too confident: for normal errors 95 % lie
    /// within.
    pub const LEAST_WITHIN_2SD: f64 = 0.8;
    /// Ratio of RMS error to RMS stated deviation above which the error is too large, however rare: on a muscle of 4 mm
    /// and 50 mm, 85 % lie within two deviations, and the error is twice the deviation \[-\].
    const MOST_STATED: f64 = 1.5;

    /// Warning about a loop that does not come to rest.
    pub fn unrest(&self) -> Option<String> {
        let swing = self.limit_cycle?;
        let amplitude = match self.control.as_ref()?.quantity {
            Controlled::Pressure => format!("{:.1} kPa", swing.amplitude / 1e3),
            Controlled::Contraction => {
                format!("{:.2} % of the rest length", 100.0 * swing.amplitude)
            }
        };
        let causes = "docs/background/control.md, \"Where the loop cannot come to rest\"";
        Some(swing.warning(&amplitude, causes))
    }

    /// Warning about stated deviations that are too small.
    pub fn overconfidence(&self) -> Option<String> {
        let (error_k, stated_k) = (self.rmse_k.estimate, self.estimate_stated_k);
        let surer = "the estimate is surer of itself than it may be";
        if self.estimate_within_2sd < Self::LEAST_WITHIN_2SD {
            return Some(format!(
                "{surer}: the truth lies within two of its stated standard deviations only {:.0} % of the time, 95 % \
                 are expected",
                100.0 * self.estimate_within_2sd
            ));
        }
        (error_k > Self::MOST_STATED * stated_k).then(|| {
            format!("{surer}: its RMS error is {error_k:.2} K, and it states {stated_k:.2} K")
        })
    }
}

impl Accumulator {
    /// An empty accumulator of a run with this set point. `measured` columns must be among [`COLUMNS`].
    pub fn new(duration_s: f64, tracked: Tracked, measured: Option<&Measured>) -> Self {
        let comparisons = measured.map_or_else(Vec::new, |measured| {
            measured
                .columns
                .iter()
                .filter_map(|column| {
                    let index = COLUMNS.iter().position(|name| *name == column.name)?;
                    Some(Comparison {
                        name: column.name.clone(),
                        column: index,
                        points: column.points.clone(),
                        next: 0,
                        before: None,
                        squares: 0.0,
                        max: 0.0,
                        count: 0,
                    })
                })
                .collect()
        });
        Self {
            duration_s,
            steps: 0,
            pressure: Extent::EMPTY,
            length: Extent::EMPTY,
            gas: Extent::EMPTY,
            sensor_gas: Extent::EMPTY,
            sensor_wall: Extent::EMPTY,
            squares: Errors { sensor_gas: 0.0, sensor_wall: 0.0, model: 0.0, estimate: 0.0 },
            within_2sd: 0,
            stated_k2: 0.0,
            saturations: 0,
            limited: 0,
            faults: Faults::NONE,
            vented_s: None,
            shown_s: None,
            tracking: Tracking::new(tracked),
            comparisons,
        }
    }

    /// Adds one step. `controlled` is the value of the controlled quantity, if there is one.
    pub fn add(&mut self, row: &Row, controlled: Option<f64>) {
        let Row { truth, telemetry, .. } = row;
        self.steps += 1;
        self.pressure.add(truth.pressure_pa);
        self.length.add(truth.length_m);
        self.gas.add(truth.gas_temperature_k);
        self.sensor_gas.add(row.sensor_gas_k);
        self.sensor_wall.add(row.sensor_wall_k);
        let error = |value: f64| value - truth.gas_temperature_k;
        let estimate_error = error(f64::from(telemetry.estimate.gas_k));
        self.squares.sensor_gas += error(row.sensor_gas_k).powi(2);
        self.squares.sensor_wall += error(row.sensor_wall_k).powi(2);
        self.squares.model += error(row.model_k).powi(2);
        self.squares.estimate += estimate_error.powi(2);
        let stated_k = f64::from(telemetry.estimate.gas_sd_k);
        self.stated_k2 += stated_k * stated_k;
        if estimate_error.abs() <= 2.0 * stated_k {
            self.within_2sd += 1;
        }
        let sample = &telemetry.sample;
        if at_rail(sample.pressure) || at_rail(sample.gas) || at_rail(sample.length) {
            self.saturations += 1;
        }
        self.limited += u64::from(telemetry.limited);
        self.faults = self.faults.with(telemetry.faults);
        for (from_s, kind) in [(&mut self.vented_s, VENTING), (&mut self.shown_s, SHOWN)] {
            if telemetry.faults.intersects(kind) {
                from_s.get_or_insert(truth.time_s);
            }
        }
        if let Some(value) = controlled {
            self.tracking.add(row, value);
        }
        if !self.comparisons.is_empty() {
            let cells = row.cells();
            for comparison in &mut self.comparisons {
                comparison.pass(truth.time_s, cells[comparison.column]);
            }
        }
    }

    pub fn finish(self, ending: Ending) -> Summary {
        let count = self.steps as f64;
        let rms = |squares: f64| (squares / count).sqrt();
        let control = ending.controlled.and_then(|quantity| self.tracking.figures(quantity));
        let compared = self.comparisons.iter().filter(|comparison| comparison.count > 0);
        let measured = (!self.comparisons.is_empty()).then(|| {
            let difference = |comparison: &Comparison| Difference {
                rmse: (comparison.squares / comparison.count as f64).sqrt(),
                max: comparison.max,
            };
            compared.map(|each| (each.name.clone(), difference(each))).collect()
        });
        Summary {
            duration_s: self.duration_s,
            strokes: ending.period_s.map_or(0, |period_s| whole_strokes(self.duration_s, period_s)),
            real_time_factor: self.duration_s / ending.wall_clock_s.max(1e-9),
            board: ending.board.to_owned(),
            pressure_pa: self.pressure.range(count),
            contraction: ending.rest_length_m.map(|rest_m| {
                let length = self.length.range(count);
                Range {
                    min: 1.0 - length.max / rest_m,
                    max: 1.0 - length.min / rest_m,
                    mean: 1.0 - length.mean / rest_m,
                }
            }),
            gas_temperature_k: self.gas.range(count),
            sensor_gas_k: self.sensor_gas.readings(),
            sensor_wall_k: self.sensor_wall.readings(),
            rmse_k: Errors {
                sensor_gas: rms(self.squares.sensor_gas),
                sensor_wall: rms(self.squares.sensor_wall),
                model: rms(self.squares.model),
                estimate: rms(self.squares.estimate),
            },
            estimate_within_2sd: self.within_2sd as f64 / count,
            estimate_stated_k: rms(self.stated_k2),
            mass_balance_error: ending.ledger.mass_balance_error(),
            energy_balance_error: ending.ledger.energy_balance_error(),
            ledger: ending.ledger,
            axial_temperature_k: ending.axial_wall_k,
            axial_gas_temperature_k: ending.axial_gas_k,
            core: CoreFigures {
                steps: self.steps,
                saturations: self.saturations,
                limited: self.limited,
                faults: self.faults.0,
                fault_names: self.faults.names().collect(),
                vented_s: self.vented_s,
                shown_s: self.shown_s,
            },
            control,
            limit_cycle: ending.limit_cycle,
            timing: ending.timing.as_ref().map(TimingFigures::from),
            measured,
        }
    }
}
