//! Gas temperature and heat transfer from stops: intervals in which both valves are shut.
//!
//! ```text
//! record --find--> stops --thermometer--> T(t) of the gas, lags and place of the sensor
//!                        --relaxation---> heat transfer gas to wall, still and stirred
//! ```
//!
//! While both valves are shut the mass is constant, so that by eq. (1) at every time
//!
//! ```text
//! T(t) = T_end (P V)(t)/(P V)_end
//! ```
//!
//! T is the mass-weighted mean of the gas, whatever its distribution: the sum of P V_i = m_i R T_i
//! over its parts. At the end of a long enough wait gas, wall and sensor have one temperature,
//! T_end, which the sensor reads. Neither valve, flow nor heat transfer has to be known.
//!
//! Gas in fittings and tube, V_c, which are part of V, and in a hose beside them, V_h, keeps their temperature, near
//! T_end. With the gas there, m R = P (V - V_c)/T + P (V_c + V_h)/T_end, so that
//!
//! ```text
//! T(t) = T_end P (V - V_c)/((P (V + V_h))_end - P (V_c + V_h))
//! ```

mod find;
mod identified;
mod leak;
pub mod page;
mod relaxation;
#[cfg(test)]
mod tests;
mod thermometer;

pub use find::{LENGTHS, PRESSURES, Row, Rows, SHORTEST_S};
pub use identified::{
    Findings, Identified, analyse_with, are_asked_for, identify, refusals, would_do,
};
pub use relaxation::Relaxation;
pub use thermometer::Sensor;

use find::Hold;
use leak::Leak;
use model_core::config::Load;
use model_core::physics::chamber::{AnyChamber, Chamber, ChamberConfig};
use model_core::physics::hysteresis::{Held, Law};
use model_core::{Config, Faults};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use thermometer::Read;

pub const FEWEST: usize = 3;
/// Fit of the product P V at the stop: quadratic over this time \[s\], or half of it, a quarter and
/// so on, until the variance of its residual is below this multiple of the noise's \[-\].
const FITTED_S: f64 = 0.2;
const MISSED: f64 = 4.0;
/// Error of the pressure that its sensor's noise does not show, as a fraction of its range: the
/// total error band of a calibrated industrial transmitter (0.25 % of full scale).
const PRESSURE_OFF: f64 = 0.0025;
/// Error of the length at rest \[m\], and of the dead volume as a fraction of the volume: the errors of a calliper on a
/// soft muscle. Assumptions.
const LENGTH_OFF_M: f64 = 0.5e-3;
const DEAD_OFF: f64 = 0.02;
/// Shares of the fittings' and of the tube's volume whose gas keeps their temperature: between none
/// and half, and between half and all. Assumptions.
const COOL: f64 = 0.25;
const TUBE_COOL: f64 = 0.75;
/// Their standard deviation (uniform).
const COOL_SD: f64 = 0.144;
/// Error of a calibrated element \[K\]: a tenth of a kelvin of the reference instrument.
const SENSOR_OFF_K: f64 = 0.1;
/// Difference of the wall at the element from its mean, since a wall does not warm evenly, as a share of the distance
/// of element or mean to ambient. In the paper's Fig. 2 it spans as much as it warms (uniform).
const UNEVEN: f64 = 0.29;
/// Error of the configured lag if the stops do not show it: 20 %.
const LAG_OFF: f64 = 0.2;
/// Change in the last quarter of a wait above which the wait is too short, of the gas or of the sensor's remaining lag
/// \[K\].
const UNSETTLED_K: f64 = 0.5;
/// Time for which a length that moves is not the same, unless the converter freezes it \[s\]. Assumption.
const FROZEN_S: f64 = 0.2;
/// Share of itself by which a length jumps at the least where it leaves a wide code. Assumption.
const UNSEEN: f64 = 2e-4;
/// Time at the end of a stop for which a length may be frozen \[s\]. Assumption.
const ENDS_FROZEN_S: f64 = 1.0;
/// Change of the temperature at the stop up to which a leak is corrected \[K\].
const MOST_LEAK_K: f64 = 1.5;
/// Share of the gas above which a leak is reported rather than a load that moves with it \[-\]. Assumption.
const PLAIN_LEAK: f64 = 0.05;
/// Changes of force that a constant load allows in addition to twice the friction: model errors within this fraction of
/// the load and this force \[N\].
const LOAD_SHARE: f64 = 0.15;
const LOAD_N: f64 = 5.0;
/// Motion, as a fraction of the rest length, below which an end counts as held.
const HELD: f64 = 0.005;
/// Time after the valves shut during which gas and end still oscillate \[s\].
const SHAKING_S: f64 = 0.3;
/// Faults of the sensors whose readings a stop consists of; see [`broken`] for the one of the gas sensor.
const OF_SENSORS: Faults =
    Faults::PRESSURE_SENSOR.with(Faults::LENGTH_SENSOR).with(Faults::GAS_LOST);
/// Longest gap of a record within a stop \[s\].
const LONGEST_GAP_S: f64 = 0.25;

/// Standard deviation of a temperature at a stop, by cause \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Causes {
    pub pressure_k: f64,
    pub volume_k: f64,
    pub sensor_k: f64,
    pub leak_k: f64,
    pub wait_k: f64,
}

impl Causes {
    fn sum_k(&self) -> f64 {
        let Self { pressure_k, volume_k, sensor_k, leak_k, wait_k } = *self;
        [pressure_k, volume_k, sensor_k, leak_k, wait_k].into_iter().fold(0.0, f64::hypot)
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stop {
    /// Time at which both valves are shut \[s\].
    pub time_s: f64,
    /// Time until a valve opens again \[s\].
    pub wait_s: f64,
    /// Mean temperature of the gas at the stop \[K\].
    pub gas_k: f64,
    /// Its standard deviation \[K\].
    pub gas_sd_k: f64,
    pub causes: Causes,
    /// The board's estimate at the stop \[K\].
    pub estimate_k: Option<f64>,
    pub estimate_sd_k: Option<f64>,
    /// The sensor's reading at the stop \[K\].
    pub sensor_k: f64,
    /// The plant's own temperature, if it was simulated \[K\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_k: Option<f64>,
    /// Temperature at the end of the wait \[K\].
    pub end_k: f64,
    /// Absolute pressure at the stop \[Pa\].
    pub pressure_pa: f64,
    pub mass_kg: f64,
    /// Share of the gas that the muscle loses in a second \[1/s\]; 0 where none is seen.
    pub leak_1_s: f64,
    /// Reason why the stop does not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Index of the first and after the last row in the record.
    #[serde(skip)]
    pub rows: std::ops::Range<usize>,
    /// Mean temperature of the gas at each row of the stop \[K\].
    #[serde(skip)]
    pub curve_k: Vec<f64>,
}

impl Stop {
    pub fn usable(&self) -> bool {
        self.refused.is_none()
    }

    /// Estimate minus measurement \[K\].
    pub fn estimate_error_k(&self) -> Option<f64> {
        self.estimate_k.map(|estimate_k| estimate_k - self.gas_k)
    }
}

/// Results of all stops.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    pub stops: Vec<Stop>,
    /// The sensor in the gas; none with too few usable stops.
    pub sensor: Option<Sensor>,
    /// Heat transfer from gas to wall; none with too few usable stops, or if the gas cools too little.
    pub heat: Option<Relaxation>,
}

impl Analysis {
    pub fn usable(&self) -> impl Iterator<Item = &Stop> {
        self.stops.iter().filter(|stop| stop.usable())
    }

    /// Root mean square of a difference over the usable stops.
    pub fn rms_k(&self, of: impl Fn(&Stop) -> Option<f64>) -> Option<f64> {
        let values: Vec<f64> = self.usable().filter_map(of).collect();
        let square: f64 = values.iter().map(|k| k * k).sum();
        (!values.is_empty()).then(|| (square / values.len() as f64).sqrt())
    }
}

/// The muscle, as far as the analysis needs it, and the law of its heat transfer.
pub struct Known<'a> {
    pub config: &'a Config,
    /// Coefficient of still gas by the scenario's law \[W/(m2 K)\], at pressure \[Pa\], gas and wall
    /// temperature \[K\].
    pub law: &'a dyn Fn(f64, f64, f64) -> f64,
    /// Volume of the tube, which is in the configured dead volume \[m3\].
    pub tube_m3: f64,
    /// Volume of a hose between valves and chamber, which the configuration leaves out \[m3\].
    pub hose_m3: f64,
}

/// A stop with the volume at each of its rows.
struct Closed<'a> {
    hold: Hold,
    rows: &'a [Row],
    /// T/T_end at each row, of closed gas.
    ratio: Vec<f64>,
    /// Difference of the ratio at the stop for one standard deviation more of cool gas.
    cool_sd: f64,
    /// P V at the end \[J\].
    end_j: f64,
    /// Volume of the gas whose temperature changes \[m3\].
    volume_m3: Vec<f64>,
    /// Rows whose length is interpolated.
    frozen: Vec<bool>,
    /// Leak as seen with a sensor of the configured lag.
    leak: Leak,
}

impl Closed<'_> {
    fn since_s(&self, row: usize) -> f64 {
        self.rows[row].time_s - self.hold.shut_s
    }

    fn wait_s(&self) -> f64 {
        self.since_s(self.rows.len() - 1)
    }

    /// Last reading of the sensor \[K\].
    fn last_k(&self) -> f64 {
        self.rows[self.rows.len() - 1].sensor_k
    }
}

pub fn analyse(rows: &Rows, known: &Known) -> Analysis {
    let config = known.config;
    let chamber = AnyChamber::new(&config.chamber);
    let holds = find::holds(&rows.rows, config);
    let cool = Cool::of(known);
    let prior = thermometer::configured(config);
    let close = |hold| {
        let closed = close(hold, rows, &chamber, &cool);
        Closed { leak: leak::seen(&closed, prior.lag_s), ..closed }
    };
    let closed: Vec<Closed> = holds.into_iter().map(close).collect();
    let held_n = held_n(&rows.rows, config);
    let moved =
        |closed: &Closed| moved(closed, &held_n[closed.hold.rows.clone()], config, &chamber);
    let refused: Vec<Option<String>> = closed.iter().map(moved).collect();
    let steady: Vec<&Closed> = of_usable(&closed, &refused);
    let mut sensor = thermometer::fit(&steady, &prior);
    let mut stops = judged(&closed, &refused, sensor.as_ref().unwrap_or(&prior), config, &chamber);
    // Stops that a leak or a short wait spoils do not fit the sensor either.
    let refused: Vec<Option<String>> = stops.iter().map(|stop| stop.refused.clone()).collect();
    let left = of_usable(&closed, &refused);
    if left.len() != steady.len() {
        sensor = thermometer::fit(&left, &prior);
        stops = judged(&closed, &refused, sensor.as_ref().unwrap_or(&prior), config, &chamber);
    }
    let cooling: Vec<(&Closed, &Stop)> =
        closed.iter().zip(&stops).filter(|(_, stop)| stop.usable()).collect();
    let heat = relaxation::fit(&cooling, known, &chamber);
    Analysis { stops, sensor, heat }
}

fn of_usable<'a, 'b>(closed: &'a [Closed<'b>], refused: &[Option<String>]) -> Vec<&'a Closed<'b>> {
    closed.iter().zip(refused).filter(|(_, why)| why.is_none()).map(|(closed, _)| closed).collect()
}

/// Volume of gas that keeps its temperature.
struct Cool {
    /// Part of the configured volume, and its standard deviation \[m3\].
    inside_m3: f64,
    sd_m3: f64,
    /// On top of it \[m3\].
    hose_m3: f64,
}

impl Cool {
    fn of(known: &Known) -> Self {
        let dead_m3 = match &known.config.chamber {
            ChamberConfig::Muscle(muscle) => f64::from(muscle.dead_volume_m3),
            ChamberConfig::Cylinder(cylinder) => f64::from(cylinder.dead_volume_m3),
            _ => 0.0,
        };
        let tube_m3 = known.tube_m3.min(dead_m3);
        let fittings_m3 = dead_m3 - tube_m3;
        Self {
            inside_m3: COOL * fittings_m3 + TUBE_COOL * tube_m3,
            sd_m3: COOL_SD * fittings_m3.hypot(tube_m3),
            hose_m3: known.hose_m3,
        }
    }
}

/// Whether each row has a length that stays the same for a while and then jumps: it is in one of the converter's wide
/// codes (erratum RP2040-E11).
fn frozen(rows: &[Row]) -> Vec<bool> {
    let mut frozen_m = Vec::new();
    let mut first = 0;
    for same in rows.chunk_by(|a, b| a.length_m == b.length_m) {
        let after = first + same.len();
        let length_m = same[0].length_m;
        let lasts = same[same.len() - 1].time_s - same[0].time_s > FROZEN_S;
        let mut beside = first.checked_sub(1).into_iter().chain([after]);
        let jumps = |row: usize| {
            let other = rows.get(row);
            other.is_some_and(|row| (row.length_m - length_m).abs() > UNSEEN * length_m)
        };
        if lasts && beside.any(jumps) {
            frozen_m.push(length_m);
        }
        first = after;
    }
    rows.iter().map(|row| frozen_m.contains(&row.length_m)).collect()
}

/// Lengths of rows \[m\]: frozen ones lie on a line between the rows before and after them that are not.
fn bridged_m(rows: &[Row], frozen: &[bool]) -> Vec<f64> {
    let mut lengths_m: Vec<f64> = rows.iter().map(|row| row.length_m).collect();
    let mut first = 0;
    for same in frozen.chunk_by(|a, b| a == b) {
        let after = first + same.len();
        let before = first.checked_sub(1).map(|row| &rows[row]);
        let (from, to) = match (before, rows.get(after)) {
            (Some(from), Some(to)) => (from, to),
            (Some(edge), None) | (None, Some(edge)) => (edge, edge),
            (None, None) => return lengths_m,
        };
        if same[0] {
            let span_s = (to.time_s - from.time_s).max(f64::MIN_POSITIVE);
            for (length_m, row) in lengths_m[first..after].iter_mut().zip(&rows[first..]) {
                let share = ((row.time_s - from.time_s) / span_s).clamp(0.0, 1.0);
                *length_m = from.length_m + share * (to.length_m - from.length_m);
            }
        }
        first = after;
    }
    lengths_m
}

/// Reason why a stop that ends in a wide code cannot be used.
fn ends_frozen(Closed { rows, frozen, .. }: &Closed) -> Option<String> {
    let last = frozen.iter().rposition(|frozen| !frozen)?;
    let (before, first, end) = (&rows[last], rows.get(last + 1)?, rows.last()?);
    let off_m = (first.length_m - before.length_m).abs();
    (end.time_s - first.time_s > ENDS_FROZEN_S).then(|| {
        format!(
            "from {:.1} s on the length is within {:.1} mm, in a code that the converter makes too wide (erratum \
             RP2040-E11): another load or pressure moves it out",
            first.time_s,
            2.0e3 * off_m
        )
    })
}

fn close<'a>(hold: Hold, rows: &'a Rows, chamber: &AnyChamber, cool: &Cool) -> Closed<'a> {
    let rows = &rows.rows[hold.rows.clone()];
    let volume_m3 = |length_m: f64| f64::from(chamber.volume_m3(length_m as f32));
    let frozen = frozen(rows);
    let whole_m3: Vec<f64> = bridged_m(rows, &frozen).into_iter().map(volume_m3).collect();
    // Gas of the last twentieth of the wait.
    let first = rows.len() - (rows.len() / 20).max(1);
    let mean = |of: &dyn Fn(usize) -> f64| {
        (first..rows.len()).map(of).sum::<f64>() / (rows.len() - first) as f64
    };
    let end_j = mean(&|row| rows[row].pressure_pa * whole_m3[row]);
    let end_pa = mean(&|row| rows[row].pressure_pa);
    let ratio = |row: usize, inside_m3: f64| {
        let pressure_pa = rows[row].pressure_pa;
        let cool_j = cool.hose_m3 * (end_pa - pressure_pa) - inside_m3 * pressure_pa;
        pressure_pa * (whole_m3[row] - inside_m3) / (end_j + cool_j)
    };
    let own = |row: usize| ratio(row, cool.inside_m3);
    Closed {
        ratio: (0..rows.len()).map(own).collect(),
        cool_sd: ratio(0, cool.inside_m3 + cool.sd_m3) - own(0),
        end_j: end_j - cool.inside_m3 * end_pa,
        volume_m3: whole_m3.iter().map(|volume_m3| volume_m3 - cool.inside_m3).collect(),
        leak: Leak::NONE,
        frozen,
        hold,
        rows,
    }
}

/// Force of slip and creep at each row, as configured, since a rest before the record \[N\].
fn held_n(rows: &[Row], config: &Config) -> Vec<f64> {
    let mut held = Held::default();
    let mut before: Option<&Row> = None;
    let next = |row| {
        if let Some(before) = before.replace(row) {
            let law = Law::new(&config.hysteresis, (row.time_s - before.time_s) as f32);
            let way_m = (before.length_m - row.length_m) as f32;
            let gauge_pa = row.pressure_pa as f32 - config.ambient.pressure_pa;
            held = law.after(&held, way_m, gauge_pa, 1.0);
        }
        f64::from(held.force_n())
    };
    rows.iter().map(next).collect()
}

/// First fault of a sensor during a stop, and its time \[s\].
///
/// A gas sensor's fault counts where its code does not change: the core also reports it where heat transfer is not as
/// configured, which is found from stops.
fn broken(rows: &[Row]) -> Option<(f64, Faults)> {
    let same = |pair: &[Row]| pair[0].gas_code.is_some() && pair[0].gas_code == pair[1].gas_code;
    let count = OF_SENSORS.with(Faults::GAS_SENSOR.when(rows.windows(2).all(same)));
    let row = rows.iter().find(|row| row.faults.intersects(count))?;
    Some((row.time_s, row.faults.of(count)))
}

/// Reason why a stop cannot be used by its record alone: a gap, a sensor's fault, a plain leak, or a load that moved.
/// `held_n` is the force of slip and creep at its rows \[N\].
fn moved(closed: &Closed, held_n: &[f64], config: &Config, chamber: &AnyChamber) -> Option<String> {
    let gap = closed.rows.windows(2).find(|pair| pair[1].time_s - pair[0].time_s > LONGEST_GAP_S);
    if let Some([before, after]) = gap {
        return Some(format!(
            "the record has a gap from {:.2} to {:.2} s",
            before.time_s, after.time_s
        ));
    }
    if let Some((time_s, faults)) = broken(closed.rows) {
        return Some(format!("at {time_s:.2} s the core has the fault: {faults}"));
    }
    if let Some(frozen) = ends_frozen(closed) {
        return Some(frozen);
    }
    let lost = closed.leak.lost(closed.wait_s());
    if lost.abs() > PLAIN_LEAK {
        return Some(leaks(lost, closed.wait_s()));
    }
    let rows = closed.rows.iter().zip(held_n);
    let still: Vec<(&Row, &f64)> =
        rows.filter(|(row, _)| row.time_s > closed.hold.shut_s + SHAKING_S).collect();
    // Means of ten rows, so that noise does not count.
    let mean = |of: &dyn Fn(&Row, f64) -> f64| -> Vec<(f64, f64)> {
        let parts = still.chunks_exact(10);
        let sum = |part: &[(&Row, &f64)]| part.iter().map(|(row, n)| of(row, **n)).sum::<f64>();
        parts.map(|part| (part[0].0.time_s, sum(part) / 10.0)).collect()
    };
    match config.load {
        Load::Isometric { .. } => {
            let lengths_m = mean(&|row, _| row.length_m);
            let most_m = HELD * f64::from(chamber.rest_length_m());
            let (at_s, moved_m) = farthest(&lengths_m);
            (moved_m > most_m).then(|| {
                format!(
                    "the end moved by {:.1} mm by {at_s:.2} s, where the load is configured as held",
                    moved_m * 1e3
                )
            })
        }
        Load::Isotonic { force_n } => {
            let ambient_pa = f64::from(config.ambient.pressure_pa);
            let forces_n = mean(&|row, held_n| {
                let gauge_pa = (row.pressure_pa - ambient_pa) as f32;
                f64::from(chamber.force_n(gauge_pa, row.length_m as f32)) - held_n
            });
            let friction_n = f64::from(config.friction.force_n);
            let most_n = 2.0 * friction_n + LOAD_SHARE * f64::from(force_n.abs()) + LOAD_N;
            let (at_s, changed_n) = farthest(&forces_n);
            (changed_n > most_n).then(|| {
                format!(
                    "the load moved: by {at_s:.2} s its force had changed by {changed_n:.0} N, friction explains \
                     {most_n:.0} N"
                )
            })
        }
    }
}

fn leaks(lost: f64, wait_s: f64) -> String {
    let (verb, percent) = (if lost > 0.0 { "lost" } else { "gained" }, 100.0 * lost.abs());
    format!(
        "a leak: the muscle {verb} {percent:.1} % of its gas in {wait_s:.0} s. Seal it, or its valves"
    )
}

/// Largest change since the first value, and its time; the whole span if there are values.
fn farthest(values: &[(f64, f64)]) -> (f64, f64) {
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    let mut found = (0.0, 0.0);
    for (time_s, value) in values {
        (low, high) = (low.min(*value), high.max(*value));
        if high - low > found.1 {
            found = (*time_s, high - low);
        }
    }
    found
}

fn judged(
    closed: &[Closed],
    refused: &[Option<String>],
    sensor: &Sensor,
    config: &Config,
    chamber: &AnyChamber,
) -> Vec<Stop> {
    let judge = |(closed, refused): (&Closed, &Option<String>)| {
        stop(closed, refused.clone(), sensor, config, chamber)
    };
    closed.iter().zip(refused).map(judge).collect()
}

fn stop(
    closed: &Closed,
    refused: Option<String>,
    sensor: &Sensor,
    config: &Config,
    chamber: &AnyChamber,
) -> Stop {
    let read = thermometer::read(closed, sensor);
    let wait_s = closed.wait_s();
    let at_stop = at_stop(closed);
    // The mass at the stop exceeds that at the end by the leakage.
    let kept = 1.0 - read.leak.lost(wait_s);
    let gas_k = read.end_k * at_stop.ratio * kept;
    let first = &closed.rows[0];
    let causes = causes(closed, &read, (gas_k, at_stop.noise), config, chamber);
    let curve_k: Vec<f64> = (0..closed.rows.len())
        .map(|row| {
            read.end_k * closed.ratio[row] * (1.0 - read.leak.lost(wait_s - closed.since_s(row)))
        })
        .collect();
    let gas_constant = f64::from(config.gas.gas_constant_j_kg_k);
    let refused = refused.or_else(|| spoilt(closed, &read, &curve_k));
    Stop {
        time_s: closed.hold.shut_s,
        wait_s,
        gas_k,
        gas_sd_k: causes.sum_k(),
        causes,
        estimate_k: first.estimate_k,
        estimate_sd_k: first.estimate_sd_k,
        sensor_k: first.sensor_k,
        truth_k: first.truth_k,
        end_k: read.end_k,
        pressure_pa: first.pressure_pa,
        mass_kg: closed.end_j / (gas_constant * read.end_k),
        leak_1_s: read.leak.rate_1_s,
        refused,
        rows: closed.hold.rows.clone(),
        curve_k,
    }
}

/// Reason why a stop cannot be used because of its gas: a leak, or a wait that was too short.
fn spoilt(closed: &Closed, read: &Read, curve_k: &[f64]) -> Option<String> {
    let wait_s = closed.wait_s();
    let lost = read.leak.lost(wait_s);
    if lost.abs() * read.end_k > MOST_LEAK_K {
        return Some(leaks(lost, wait_s));
    }
    let from = curve_k.len() - curve_k.len() / 4;
    let near = |row: usize| {
        let part = &curve_k[row..(row + curve_k.len() / 40).min(curve_k.len()).max(row + 1)];
        part.iter().sum::<f64>() / part.len() as f64
    };
    let changed_k = (near(from.min(curve_k.len() - 1))
        - near(curve_k.len() - curve_k.len().div_ceil(40)))
    .abs();
    let unsettled_k = changed_k.max(read.behind_k.abs());
    (unsettled_k > UNSETTLED_K).then(|| {
        format!(
            "the wait of {wait_s:.0} s was too short: at its end gas and sensor were still {unsettled_k:.1} K from rest"
        )
    })
}

/// (P V)/(P V)_end at the stop, and its standard deviation by noise.
struct AtStop {
    ratio: f64,
    noise: f64,
}

/// The value at the stop of a parabola through the first rows. A load that still swings on the gas bends it: then it
/// goes through fewer rows, until its residual is noise alone.
fn at_stop(closed: &Closed) -> AtStop {
    // Rows of the second half differ from their neighbours only by noise.
    let tail = &closed.ratio[closed.ratio.len() / 2..];
    let squares: f64 = tail.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    let variance = 0.5 * squares / (tail.len() - 1).max(1) as f64;
    let mut fitted_s = FITTED_S;
    loop {
        let count = (0..closed.rows.len()).filter(|row| closed.since_s(*row) <= fitted_s).count();
        let powers =
            DMatrix::from_fn(count, 3, |row, power| closed.since_s(row).powi(power as i32));
        let ratios = DVector::from_column_slice(&closed.ratio[..count]);
        let fit = powers.tr_mul(&powers).cholesky().filter(|_| count > 3);
        let Some(fit) = fit.map(|squares| squares.solve(&powers.tr_mul(&ratios))) else {
            return AtStop { ratio: closed.ratio[0], noise: variance.sqrt() };
        };
        let missed = (&powers * &fit - ratios).norm_squared() / (count - 3) as f64;
        if missed <= MISSED * variance {
            // At its edge a parabola through n rows has 9/n of their variance.
            return AtStop {
                ratio: fit[0],
                noise: (variance * (9.0 / count as f64).min(1.0)).sqrt(),
            };
        }
        fitted_s *= 0.5;
    }
}

/// Propagates the uncertainties of pressure, volume, sensor, leak and wait to the temperature.
fn causes(
    closed: &Closed,
    read: &Read,
    (gas_k, by_noise): (f64, f64),
    config: &Config,
    chamber: &AnyChamber,
) -> Causes {
    let [first, last] = [&closed.rows[0], &closed.rows[closed.rows.len() - 1]];
    let volume_m3 = |length_m: f64| f64::from(chamber.volume_m3(length_m as f32));
    let log_ratio = |offset_m: f64, dead_m3: f64| {
        let [at_stop, at_end] =
            [first, last].map(|row| volume_m3(row.length_m + offset_m) + dead_m3);
        (at_stop / at_end).ln()
    };
    let own = log_ratio(0.0, 0.0);
    let by_length = log_ratio(LENGTH_OFF_M, 0.0) - own;
    let by_dead = log_ratio(0.0, DEAD_OFF * volume_m3(first.length_m)) - own;
    let sensor = &config.sensors.pressure;
    let offset_pa = PRESSURE_OFF * f64::from(sensor.range_pa);
    let by_offset = offset_pa * (1.0 / first.pressure_pa - 1.0 / last.pressure_pa);
    // An element where the wall is coolest shows little of the mean's warming.
    let warmer_k = |k: f64| (k - f64::from(config.ambient.temperature_k)).abs();
    let warmer_k = last.wall_k.map_or(0.0, warmer_k).max(warmer_k(read.end_k));
    Causes {
        pressure_k: gas_k * by_offset.hypot(by_noise),
        volume_k: gas_k * by_length.hypot(by_dead).hypot(closed.cool_sd),
        sensor_k: SENSOR_OFF_K.hypot(UNEVEN * warmer_k).hypot(read.end_sd_k),
        leak_k: gas_k * read.leak.sd_1_s * closed.wait_s(),
        wait_k: read.wait_sd_k,
    }
}
