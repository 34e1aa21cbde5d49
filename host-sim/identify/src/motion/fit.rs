//! The search for the law behind a record of motion.
//!
//! ```text
//! sum of w_i ((predicted - measured)/s)^2 + sum of ((x - x_0)/spread)^2
//! ```
//!
//! The force is predicted where it was measured, the length otherwise, and w_i is the number of rows that a row stands
//! for. The second sum only keeps the search from running away where the record shows nothing of a parameter: it counts
//! as much as a few rows. The forces of slip and slow creep at the start are searched too, since no record contains
//! them.

use super::law::{Law, Start};
use super::record::{Record, Row};
use nalgebra::{DMatrix, DVector};
use thermyo_compute::parallel::{Watch, map_watched};
use thermyo_fit::assumed::{LOAD_OFF, PRESSURE_OFF_PA};
use thermyo_fit::correlation_rows;
use thermyo_fit::search::{self, Found, LeastSquares, central_slopes};
use thermyo_scenario::preset::MusclePreset;
use thermyo_scenario::{Scenario, at_rest, number, with_numbers};

/// Usual residual of the law: of a length over the stroke, of a force over the largest \[-\].
const LEFT: f64 = 0.01;
/// Step of the differences; the search variables are of the order of one.
const DIFFERENCE: f64 = 1.0e-4;
/// Relative change of sum and point at which a search has converged.
const TOLERANCE: f64 = 1.0e-8;
/// Evaluations per parameter before a search is given up.
const PATIENCE: usize = 40;
/// Starts: factors on slip force, slip stiffness, and stiffness and time of both creeps. Without the starts with other
/// times, searches from a slow creep twice too slow missed the best values.
const STARTS: [[f64; 4]; 5] = [
    [1.0, 1.0, 1.0, 1.0],
    [3.0, 3.0, 0.4, 1.0],
    [0.4, 1.0, 2.0, 1.0],
    [0.4, 2.0, 2.0, 0.4],
    [1.0, 2.0, 1.0, 2.5],
];
/// Spread of the logarithm of a positive parameter.
const LOG_SPREAD: f64 = 1.5;
/// Limits of the logarithm, from the scenario's value.
const LOG_LIMIT: f64 = 4.0;
const START_N: [f64; 2] = [5.0, 15.0];
/// Deviation, as a share of the spread, above which the record leaves a parameter open ...
const OPEN: f64 = 0.7;
/// ... and of a logarithm.
const OPEN_LOG: f64 = 0.4;

/// Deviations above which a record shows a delay, and above which a value is wrong by it \[-\].
const SHOWN: f64 = 4.0;
const WRONG: f64 = 2.0;
/// Delay below which nothing is made of it: samples of one loop at 1 kHz differ by less \[s\].
const LEAST_DELAY_S: f64 = 2.0e-3;

/// Scale on which a parameter is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// By its logarithm.
    Log,
    /// By its value, in this unit; it may not be below the limit.
    Linear { unit: f64, least: f64 },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    pub key: &'static str,
    pub unit: &'static str,
    given: f64,
    scale: Scale,
}

const LOAD_FORCE: &str = "load.force_n";
/// The part of the slip that follows pressure.
pub const FACTOR: &str = "muscle.slip_pressure_factor";
/// Keys of slip and creep.
pub const MOTION: [&str; 7] = [
    "muscle.slip_force_n",
    "muscle.slip_stiffness_n_m",
    FACTOR,
    "muscle.creep_fast_n_m",
    "muscle.creep_fast_s",
    "muscle.creep_slow_n_m",
    "muscle.creep_slow_s",
];

/// Keys that a record of motion can determine.
pub const KEYS: [(&str, &str); 14] = [
    ("muscle.slip_force_n", "N"),
    ("muscle.slip_stiffness_n_m", "N/m"),
    (FACTOR, ""),
    ("muscle.creep_fast_n_m", "N/m"),
    ("muscle.creep_fast_s", "s"),
    ("muscle.creep_slow_n_m", "N/m"),
    ("muscle.creep_slow_s", "s"),
    ("muscle.bladder_saturation_n", "N"),
    ("muscle.bladder_strain", ""),
    ("muscle.bladder_stiffness_n_m", "N/m"),
    ("muscle.slack_m", "m"),
    ("muscle.diameter_m", "m"),
    ("muscle.braid_angle_deg", "deg"),
    (LOAD_FORCE, "N"),
];

impl Parameter {
    pub fn of(key: &str, scenario: &Scenario) -> Option<Self> {
        let (key, unit) = KEYS.into_iter().find(|(known, _)| *known == key)?;
        let given = number(scenario, key)?;
        let linear = |unit: f64, least: f64| Scale::Linear { unit, least };
        let scale = match key {
            FACTOR => linear(0.5, 0.0),
            "muscle.bladder_stiffness_n_m" => linear(500.0, 0.0),
            "muscle.slack_m" => linear(0.01 * scenario.muscle.rest_length_m, f64::NEG_INFINITY),
            "muscle.braid_angle_deg" => linear(3.0, 5.0),
            LOAD_FORCE => linear(20.0, 0.0),
            _ => Scale::Log,
        };
        Some(Self { key, unit, given, scale })
    }

    fn value(&self, place: f64) -> f64 {
        match self.scale {
            Scale::Log => self.given * place.clamp(-LOG_LIMIT, LOG_LIMIT).exp(),
            Scale::Linear { unit, least } => (self.given + unit * place).max(least),
        }
    }

    /// The point, or the nearest one where differences to both sides are within the limit.
    fn inside(&self, place: f64) -> f64 {
        match self.scale {
            Scale::Log => place,
            Scale::Linear { unit, least } => place.max((least - self.given) / unit + DIFFERENCE),
        }
    }

    fn deviation(&self, place: f64, deviation: f64) -> f64 {
        match self.scale {
            Scale::Log => self.value(place) * deviation,
            Scale::Linear { unit, .. } => unit * deviation,
        }
    }

    fn spread(&self) -> f64 {
        if self.scale == Scale::Log { LOG_SPREAD } else { 1.0 }
    }

    fn is_open(&self, place: f64, deviation: f64) -> bool {
        match self.scale {
            Scale::Log => deviation > OPEN_LOG || place.abs() > 0.99 * LOG_LIMIT,
            Scale::Linear { .. } => deviation > OPEN,
        }
    }

    /// Whether the value is zero, so that there is nothing to scale.
    pub fn is_missing(&self) -> bool {
        self.scale == Scale::Log && self.given <= 0.0
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    pub value: f64,
    pub deviation: f64,
    /// Whether the record leaves it open.
    pub open: bool,
}

/// A delay of the length behind the pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delay {
    pub delay_s: f64,
    pub deviation_s: f64,
    /// Largest change of a value that goes with it, in its stated deviations, and that value's key.
    pub times: f64,
    pub key: &'static str,
}

impl Delay {
    /// Whether the record shows it, and a value is wrong by it.
    pub fn counts(&self) -> bool {
        let Self { delay_s, deviation_s, times, .. } = *self;
        delay_s.abs() > SHOWN * deviation_s && delay_s.abs() > LEAST_DELAY_S && times > WRONG
    }
}

/// The end of a search.
pub struct End {
    place: DVector<f64>,
    /// The place, or the nearest one with differences to both sides.
    inside: DVector<f64>,
    /// Slopes and values of the weighted residuals.
    slopes: DMatrix<f64>,
    left: DVector<f64>,
    scatter: f64,
    covariance: Option<DMatrix<f64>>,
}

impl End {
    /// Change of the place for these weighted residuals.
    fn change(&self, residuals: &DVector<f64>) -> Option<DVector<f64>> {
        let covariance = self.covariance.as_ref()?;
        Some(covariance * self.slopes.tr_mul(residuals) / self.scatter)
    }
}

pub struct Problem<'a> {
    scenario: &'a Scenario,
    parameters: &'a [Parameter],
    record: &'a Record,
    deviation: f64,
    watch: &'a dyn Watch,
}

impl<'a> Problem<'a> {
    pub fn new(
        scenario: &'a Scenario,
        parameters: &'a [Parameter],
        record: &'a Record,
        watch: &'a dyn Watch,
    ) -> Self {
        let largest = if record.has_force { record.largest_n() } else { record.stroke_m() };
        Self { scenario, parameters, record, deviation: LEFT * largest, watch }
    }

    fn start(&self, place: &DVector<f64>) -> Start {
        let count = self.parameters.len();
        Start { slip_n: START_N[0] * place[count], slow_n: START_N[1] * place[count + 1] }
    }

    pub fn at(&self, place: &DVector<f64>) -> Scenario {
        let values =
            self.parameters.iter().zip(place.iter()).map(|(p, place)| (p.key, p.value(*place)));
        adopt(self.scenario, values)
    }

    /// Predictions minus measurements.
    fn residuals(&self, place: &DVector<f64>) -> Vec<f64> {
        residuals(&self.at(place), self.record, &self.start(place))
    }

    fn by_weight(&self, residuals: &[f64]) -> DVector<f64> {
        let rows = residuals.iter().zip(&self.record.rows);
        let weighted = rows.map(|(left, row)| row.weight.sqrt() * left / self.deviation);
        DVector::from_iterator(residuals.len(), weighted)
    }

    /// The best of several searches; a meaningless point if they were stopped.
    pub fn search(&self) -> Found {
        let ends = map_watched(&STARTS, self.watch, |factors| {
            let [force, stiffness, creep, times] = factors.map(f64::ln);
            let start = self.parameters.iter().map(|parameter| match parameter.key {
                "muscle.slip_force_n" => force,
                "muscle.slip_stiffness_n_m" => stiffness,
                "muscle.creep_fast_n_m" | "muscle.creep_slow_n_m" => creep,
                "muscle.creep_fast_s" | "muscle.creep_slow_s" => times,
                _ => 0.0,
            });
            let start = start.chain([0.0, 0.0]).collect::<Vec<f64>>();
            search::minimize(self, DVector::from_vec(start), TOLERANCE, PATIENCE)
        });
        let best = ends.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let place = DVector::zeros(self.parameters.len() + START_N.len());
        best.unwrap_or(Found { place, cost: f64::INFINITY, converged: false, stopped: true })
    }

    /// The problem at the end of a search, to first order.
    pub fn end(&self, place: DVector<f64>) -> End {
        // Beyond a limit nothing changes: the record shows a value only by its changes inside.
        let mut inside = place.clone();
        for (i, parameter) in self.parameters.iter().enumerate() {
            inside[i] = parameter.inside(place[i]);
        }
        let slopes = self.slopes(&inside, &self.weighted(&inside));
        let rows = self.record.rows.len();
        let residuals = self.residuals(&place);
        let left = self.by_weight(&residuals);
        let lasting = correlation_rows(&residuals);
        // Each row stands for several, which count as that many readings only if their errors are independent.
        let scatter = (left.norm_squared() * lasting / rows as f64).max(1.0e-12);
        let (measured, prior) = (slopes.rows(0, rows), slopes.rows(rows, place.len()));
        let information = measured.tr_mul(&measured) / scatter + prior.tr_mul(&prior);
        let covariance = information.cholesky().map(|cholesky| cholesky.inverse());
        End { place, inside, slopes: measured.into_owned(), left, scatter, covariance }
    }

    /// Values at the end of a search. Their deviations allow for the scatter, for how long it lasts, and for errors of
    /// load and pressure that no residual shows (consider covariance, Schmidt 1966).
    pub fn values(&self, end: &End) -> Vec<Value> {
        let End { place, inside, covariance, .. } = end;
        let shifts: Vec<_> =
            self.considered(inside).iter().filter_map(|off| end.change(off)).collect();
        let value = |(i, parameter): (usize, &Parameter)| {
            let deviation = covariance.as_ref().map_or(f64::INFINITY, |c| c[(i, i)].sqrt());
            let with_shifts = shifts.iter().fold(deviation, |sum, shift| sum.hypot(shift[i]));
            Value {
                value: parameter.value(place[i]),
                deviation: parameter.deviation(place[i], with_shifts),
                open: parameter.is_open(place[i], deviation),
            }
        };
        self.parameters.iter().enumerate().map(value).collect()
    }

    /// The delay of the length behind the pressure that explains most of the residuals, at the end of a search whose
    /// values these are: to first order, together with the change of the values that goes with it.
    pub fn delay(&self, end: &End, values: &[Value]) -> Option<Delay> {
        if self.record.has_force {
            return None;
        }
        let End { place, slopes, left, scatter, .. } = end;
        let of_delay = self.by_weight(&self.record.speeds_m_s());
        let change = end.change(&of_delay)?;
        let own = &of_delay - slopes * &change;
        let shown = own.dot(&of_delay);
        let delay_s = own.dot(left) / shown;
        let deviation_s = (scatter / shown).sqrt();
        let off = |(i, (parameter, value)): (usize, (&Parameter, &Value))| {
            let by = parameter.deviation(place[i], (change[i] * delay_s).abs());
            (by / value.deviation, parameter.key)
        };
        let changes = self.parameters.iter().zip(values).enumerate().map(off);
        let (times, key) = changes.max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Delay { delay_s, deviation_s, times, key })
    }

    /// Changes of the weighted residuals by an error of the force, and of the pressure.
    fn considered(&self, place: &DVector<f64>) -> Vec<DVector<f64>> {
        let (scenario, start) = (self.at(place), self.start(place));
        let weighted = |alter: fn(&mut Row)| {
            let mut rows = self.record.loaded(&scenario);
            rows.iter_mut().for_each(alter);
            let residuals = residuals_of(&scenario, &rows, self.record.has_force, &start);
            self.by_weight(&residuals)
        };
        let own = self.by_weight(&self.residuals(place));
        let is_searched = |parameter: &Parameter| parameter.key == LOAD_FORCE;
        let by_search = !self.record.has_force && self.parameters.iter().any(is_searched);
        let force = (!by_search).then(|| weighted(|row| row.force_n *= LOAD_OFF));
        let pressure = weighted(|row| row.pressure_pa += PRESSURE_OFF_PA);
        force.into_iter().chain([pressure]).map(|off| off - &own).collect()
    }

    /// State at the start, as found by the search.
    pub fn found_start(&self, place: &DVector<f64>) -> Start {
        self.start(place)
    }
}

/// A scenario with values of the law; its dimensions are those at rest.
pub fn adopt<'a>(
    scenario: &Scenario,
    values: impl IntoIterator<Item = (&'a str, f64)>,
) -> Scenario {
    let mut adopted = with_numbers(scenario, values);
    adopted.muscle.preset = MusclePreset::None;
    let muscle = &adopted.muscle;
    adopted.muscle =
        at_rest(muscle, muscle.rest_length_m, muscle.diameter_m, muscle.braid_angle_deg);
    adopted
}

/// Predicted minus measured forces if the forces were measured, else lengths.
pub fn residuals(scenario: &Scenario, record: &Record, start: &Start) -> Vec<f64> {
    residuals_of(scenario, &record.loaded(scenario), record.has_force, start)
}

fn residuals_of(scenario: &Scenario, rows: &[Row], has_force: bool, start: &Start) -> Vec<f64> {
    let law = Law::of(scenario, has_force);
    let (found, measured): (_, fn(&Row) -> f64) = if has_force {
        (law.forces(rows, start), |row| row.force_n)
    } else {
        (law.lengths(rows, start), |row| row.length_m)
    };
    found.iter().zip(rows).map(|(found, row)| found - measured(row)).collect()
}

impl LeastSquares for Problem<'_> {
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
        let of_rows = self.by_weight(&self.residuals(place));
        let spreads = self.parameters.iter().map(Parameter::spread).chain([1.0, 1.0]);
        let of_usual = place.iter().zip(spreads).map(|(place, spread)| place / spread);
        DVector::from_vec(of_rows.iter().copied().chain(of_usual).collect())
    }

    fn slopes(&self, place: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
        central_slopes(place, DIFFERENCE, |_| DIFFERENCE, |place| self.weighted(place))
    }

    fn stopped(&self) -> bool {
        self.watch.stopped()
    }
}
