//! The sensor in the gas, from its response to gas of a known course.
//!
//! During a stop the gas temperature is known up to one factor, T_end: T = T_end y with y = T/T_end of closed gas
//! ([`super`]). At the sensor, the difference of gas and wall is g times that of the mean. Housing and element are lags
//! in series, so that
//!
//! ```text
//! T_s(t) = T_end (1 + g L[y - 1 + y leak (t - t_end)]) + a exp(-t/tau) + b (housing)
//! ```
//!
//! L is the response of both lags, and the leak is known ([`super::leak`]). T_end, a and b belong to each stop and
//! enter linearly; tau, tau_h and g are the sensor's, found by Levenberg and Marquardt's method over their logarithms,
//! with the linear ones solved for at each point (variable projection, Golub and Pereyra 1973). Standard errors come
//! from the jackknife over the stops, and are at least those of the noise.

use super::leak::{self, Leak};
use super::{Closed, LAG_OFF};
use crate::correlation_rows;
use crate::search::{LeastSquares, central_slopes, minimize};
use model_core::Config;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// ln tau, ln tau_h, ln g.
const COMMON: usize = 3;
/// Weak priors of these logarithms, which act only where the data show nothing: a factor of ten each way for the lags,
/// of 1.5 for the location factor.
const PRIOR_SD: [f64; COMMON] = [2.3, 2.3, 0.4];
/// Largest factor from the configured lag that is searched.
const WIDEST: f64 = 50.0;
/// Start of the search for a housing without configured lag \[s\].
const LEAST_HOUSING_S: f64 = 0.02;
const DIFFERENCE: f64 = 1e-4;

/// Lags and location factor of the sensor. Standard errors are of the logarithms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sensor {
    pub lag_s: f64,
    pub lag_sd: f64,
    pub housing_s: f64,
    pub housing_sd: f64,
    /// Difference of the gas at the sensor to the wall, over the mean's difference \[-\].
    pub location_factor: f64,
    pub location_sd: f64,
    pub rms_k: f64,
}

/// Temperature at the end of a stop, from the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Read {
    pub end_k: f64,
    /// Deviation from noise \[K\].
    pub end_sd_k: f64,
    pub leak: Leak,
    /// Deviation from the uncertain lag, which the reading at the end still follows \[K\].
    pub wait_sd_k: f64,
    /// Remaining lag of the sensor behind the gas at the end \[K\].
    pub behind_k: f64,
}

pub fn configured(config: &Config) -> Sensor {
    let gas = &config.sensors.gas;
    Sensor {
        lag_s: gas.time_constant_s.into(),
        lag_sd: LAG_OFF,
        housing_s: f64::from(gas.housing_time_constant_s).max(LEAST_HOUSING_S),
        housing_sd: 1.0,
        location_factor: 1.0,
        location_sd: PRIOR_SD[2],
        rms_k: f64::NAN,
    }
}

impl Sensor {
    fn place(&self) -> DVector<f64> {
        DVector::from_vec(vec![self.lag_s.ln(), self.housing_s.ln(), self.location_factor.ln()])
    }
}

/// Response of a first-order lag to values that are linear between rows, from `reading` on.
fn lagged(
    times_s: impl Fn(usize) -> f64,
    values: &[f64],
    lag_s: f64,
    mut reading: f64,
) -> Vec<f64> {
    let mut readings = vec![reading];
    for row in 1..values.len() {
        let step_s = times_s(row) - times_s(row - 1);
        let behind = lag_s * (values[row] - values[row - 1]) / step_s;
        let left = (-step_s / lag_s).exp();
        reading = values[row] - behind + left * (reading - values[row - 1] + behind);
        readings.push(reading);
    }
    readings
}

/// Linear parameters of one stop at given lags and location factor: solution, its covariance per unit variance, and
/// residuals.
struct Solved {
    values: DVector<f64>,
    inverse: DMatrix<f64>,
    residuals: DVector<f64>,
}

fn solve(closed: &Closed, common: &DVector<f64>, leak: Leak) -> Option<Solved> {
    let [lag_s, housing_s, gain] = [0, 1, 2].map(|i| common[i].exp());
    let times = |row: usize| closed.since_s(row);
    let (count, wait_s) = (closed.rows.len(), closed.wait_s());
    let both = |values: &[f64]| {
        lagged(times, &lagged(times, values, housing_s, values[0]), lag_s, values[0])
    };
    let kept = |row: usize| 1.0 - leak.lost(wait_s - times(row));
    let above: Vec<f64> = (0..count).map(|row| closed.ratio[row] * kept(row) - 1.0).collect();
    let housing: Vec<f64> = (0..count).map(|row| (-times(row) / housing_s).exp()).collect();
    let (gas, housing) = (both(&above), lagged(times, &housing, lag_s, 0.0));
    let design = DMatrix::from_fn(count, 3, |row, column| match column {
        0 => 1.0 + gain * gas[row],
        1 => (-times(row) / lag_s).exp(),
        _ => housing[row],
    });
    let reading = DVector::from_iterator(count, closed.rows.iter().map(|row| row.sensor_k));
    let inverse = design.tr_mul(&design).cholesky()?.inverse();
    let values = &inverse * design.tr_mul(&reading);
    let residuals = &reading - &design * &values;
    Some(Solved { values, inverse, residuals })
}

struct Projection<'a> {
    stops: Vec<&'a Closed<'a>>,
    prior: DVector<f64>,
    noise_k: f64,
}

impl Projection<'_> {
    /// Residuals in kelvin, without the prior.
    fn residuals(&self, place: &DVector<f64>) -> DVector<f64> {
        let parts = self.stops.iter().map(|closed| {
            solve(closed, place, closed.leak).map_or_else(
                || DVector::from_element(closed.rows.len(), 1e3),
                |solved| solved.residuals,
            )
        });
        let all: Vec<f64> =
            parts.flat_map(|part| part.iter().copied().collect::<Vec<_>>()).collect();
        DVector::from_vec(all)
    }

    fn jacobian(&self, place: &DVector<f64>) -> DMatrix<f64> {
        central_slopes(place, DIFFERENCE, |_| DIFFERENCE, |place| self.residuals(place))
    }
}

impl LeastSquares for Projection<'_> {
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
        let bound = WIDEST.ln();
        let inside = place.zip_map(&self.prior, |at, prior| at.clamp(prior - bound, prior + bound));
        let residuals = self.residuals(&inside) / self.noise_k;
        let priors = (0..COMMON).map(|i| (place[i] - self.prior[i]) / PRIOR_SD[i]);
        DVector::from_iterator(residuals.len() + COMMON, residuals.iter().copied().chain(priors))
    }

    fn slopes(&self, place: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
        let own = self.jacobian(place) / self.noise_k;
        let mut slopes = DMatrix::zeros(own.nrows() + COMMON, COMMON);
        slopes.rows_mut(0, own.nrows()).copy_from(&own);
        for i in 0..COMMON {
            slopes[(own.nrows() + i, i)] = 1.0 / PRIOR_SD[i];
        }
        slopes
    }
}

/// Standard deviation of one reading, from the differences of neighbouring rows.
fn noise_k(stops: &[&Closed]) -> f64 {
    let pairs = stops.iter().flat_map(|closed| closed.rows.windows(2));
    let (sum, count) = pairs.fold((0.0, 0.0), |(sum, count), pair| {
        (sum + (pair[1].sensor_k - pair[0].sensor_k).powi(2), count + 1.0)
    });
    (0.5 * sum / f64::max(count, 1.0)).sqrt().max(1e-3)
}

/// Fits lags and location factor to all stops; none with fewer than [`super::FEWEST`].
pub fn fit(stops: &[&Closed], prior: &Sensor) -> Option<Sensor> {
    if stops.len() < super::FEWEST {
        return None;
    }
    let all = |noise_k: f64| Projection { stops: stops.to_vec(), prior: prior.place(), noise_k };
    let search = |problem: &Projection, start| minimize(problem, start, 1e-8, 60).place;
    // Residuals that persist from row to row are an error of the model: the rows count less accordingly.
    let rough = search(&all(noise_k(stops)), prior.place());
    let residuals = all(1.0).residuals(&rough);
    let rms_k = (residuals.norm_squared() / residuals.len() as f64).sqrt();
    let noise_k = noise_k(stops).max(rms_k * correlation_rows(residuals.as_slice()).sqrt());
    let problem = all(noise_k);
    let place = search(&problem, rough);
    let others: Vec<DVector<f64>> = (0..stops.len())
        .map(|out| {
            let mut left = all(noise_k);
            left.stops.remove(out);
            search(&left, place.clone())
        })
        .collect();
    let jacobian = problem.jacobian(&place) / noise_k;
    let by_data = jacobian.tr_mul(&jacobian).cholesky().map(|squares| squares.inverse());
    let sd = |i: usize| {
        let own = by_data.as_ref().map_or(f64::INFINITY, |inverse| inverse[(i, i)].max(0.0).sqrt());
        jackknife_sd(&others.iter().map(|place| place[i]).collect::<Vec<_>>()).max(own)
    };
    // A reading that does not follow within a stop shows no lag.
    let longest_s = stops.iter().map(|closed| closed.wait_s()).fold(0.0, f64::max);
    let shown = |i: usize| if place[i].exp() < longest_s { sd(i) } else { f64::INFINITY };
    Some(Sensor {
        lag_s: place[0].exp(),
        lag_sd: shown(0),
        housing_s: place[1].exp(),
        housing_sd: shown(1),
        location_factor: place[2].exp(),
        location_sd: sd(2),
        rms_k,
    })
}

/// Standard error from fits that each leave one stop out.
pub(super) fn jackknife_sd(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    ((count - 1.0) / count * squares).sqrt()
}

/// Reads the end of a stop with a known sensor.
pub(super) fn read(closed: &Closed, sensor: &Sensor) -> Read {
    let place = sensor.place();
    let unknown = Read {
        end_k: closed.last_k(),
        end_sd_k: 0.0,
        leak: Leak::NONE,
        wait_sd_k: 0.0,
        behind_k: 0.0,
    };
    let leak = leak::seen(closed, sensor.lag_s);
    let Some(solved) = solve(closed, &place, leak) else { return unknown };
    let rows = closed.rows.len() as f64;
    let variance = solved.residuals.norm_squared() / rows;
    // Residuals persist over the sensor's lag, which limits the number of independent rows.
    let independent = (closed.wait_s() / sensor.lag_s.max(closed.wait_s() / rows)).min(rows);
    let inflated = variance * rows / independent;
    let end_k = solved.values[0];
    let otherwise = |by: f64| {
        let mut moved = place.clone();
        moved[0] += by;
        solve(closed, &moved, leak).map_or(0.0, |other| other.values[0] - end_k)
    };
    let tail = closed.rows.len() - (closed.rows.len() / 20).max(1);
    let tail = &closed.rows[tail..];
    let reading_k = tail.iter().map(|row| row.sensor_k).sum::<f64>() / tail.len() as f64;
    Read {
        end_k,
        end_sd_k: (solved.inverse[(0, 0)] * inflated).sqrt(),
        leak,
        wait_sd_k: otherwise(sensor.lag_sd.min(1.0)).abs(),
        behind_k: end_k - reading_k,
    }
}
