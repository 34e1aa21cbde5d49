//! The covariance of the estimator's five errors in the forms that a Kalman filter may have.
//!
//! All but the shipped one are written for a full transition, generic over the scalar: f32 as on the
//! board, f64 as the reference, [`Counted`] to count operations.

use crate::covariance::{Covariance, Transition};
use nalgebra::Matrix5;
use std::cell::Cell;
use std::ops::{Add, Div, Mul, Sub};

/// Number of errors: u = dT/T, wall, sensor, ln s, ln tau.
pub const N: usize = 5;
/// Index of the measured error.
pub const SENSOR: usize = 2;

/// One interval of the estimator.
#[derive(Debug, Clone, Copy)]
pub struct Interval {
    /// Input of the shipped form.
    pub transition: Transition,
    /// The same as a matrix, with the forgetting of scale and lag.
    pub matrix: [[f32; N]; N],
    /// Variance that each error gains.
    pub drift: [f32; N],
    /// Fraction of the errors of scale and lag that is kept.
    pub keep: f32,
    /// Variance of the reading \[K2\].
    pub reading_k2: f32,
    /// Reading less its prediction \[K\].
    pub innovation_k: Option<f32>,
    /// The inlet was driven.
    pub charging: bool,
}

/// A form of the filter's covariance.
pub trait Form {
    /// Predicts to the end of an interval.
    fn predict(&mut self, interval: &Interval);
    /// Updates with the reading; returns the gain.
    fn update(&mut self, interval: &Interval) -> [f64; N];
    /// The covariance that the form represents.
    fn covariance(&self) -> Matrix5<f64>;
}

/// Arithmetic that the forms need.
pub trait Scalar:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + From<f32>
    + Into<f64>
{
}

impl Scalar for f32 {}
impl Scalar for f64 {}
impl Scalar for Counted {}

thread_local! {
    static OPERATIONS: Cell<u32> = const { Cell::new(0) };
}

/// An f32 that counts its operations.
#[derive(Debug, Clone, Copy)]
pub struct Counted(f32);

impl Counted {
    /// Additions, subtractions, multiplications and divisions in `work`.
    pub fn operations(work: impl FnOnce()) -> u32 {
        OPERATIONS.set(0);
        work();
        OPERATIONS.get()
    }

    fn of(value: f32) -> Self {
        OPERATIONS.set(OPERATIONS.get() + 1);
        Self(value)
    }
}

impl From<f32> for Counted {
    fn from(value: f32) -> Self {
        Self(value)
    }
}

impl From<Counted> for f64 {
    fn from(value: Counted) -> Self {
        Self::from(value.0)
    }
}

impl Add for Counted {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::of(self.0 + other.0)
    }
}

impl Sub for Counted {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::of(self.0 - other.0)
    }
}

impl Mul for Counted {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::of(self.0 * other.0)
    }
}

impl Div for Counted {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        Self::of(self.0 / other.0)
    }
}

type Square<T> = [[T; N]; N];

/// Sum without an initial zero, which would cost an operation.
fn sum<T: Scalar>(terms: impl Iterator<Item = T>) -> T {
    terms.reduce(|a, b| a + b).unwrap_or(T::from(0.0))
}

fn product<T: Scalar>(a: &Square<T>, b: impl Fn(usize, usize) -> T) -> Square<T> {
    std::array::from_fn(|i| std::array::from_fn(|j| sum((0..N).map(|k| a[i][k] * b(k, j)))))
}

fn scalars<T: Scalar>(matrix: &[[f32; N]; N]) -> Square<T> {
    matrix.map(|row| row.map(T::from))
}

fn matrix<T: Scalar>(square: &Square<T>) -> Matrix5<f64> {
    Matrix5::from_fn(|i, j| square[i][j].into())
}

fn gains<T: Scalar>(gain: [T; N]) -> [f64; N] {
    gain.map(Into::into)
}

/// The shipped form: `model-core/src/estimation/covariance.rs` itself.
#[derive(Debug, Clone, Copy)]
pub struct Named(pub Covariance);

impl Named {
    /// Operations per interval, counted in the source: 84 in `rows`, 36 in `columns`, 10 in
    /// forgetting, 5 of drift, 20 in checking the correlations, 33 in the update.
    pub const OPERATIONS: u32 = 188;
}

impl Form for Named {
    fn predict(&mut self, interval: &Interval) {
        let p = &mut self.0;
        let rows = p.rows(&interval.transition);
        p.columns(&rows, &interval.transition);
        let [gas, wall, sensor, scale, lag] = interval.drift;
        p.gas_gas += gas;
        p.wall_wall += wall;
        p.sensor_sensor += sensor;
        p.forget(interval.keep);
        p.scale_scale += scale;
        p.lag_lag += lag;
        p.limit();
    }

    fn update(&mut self, interval: &Interval) -> [f64; N] {
        let p = self.0;
        let per_s = 1.0 / (p.sensor_sensor + interval.reading_k2);
        let gain = [
            p.gas_sensor * per_s,
            p.wall_sensor * per_s,
            p.sensor_sensor * per_s,
            p.sensor_scale * per_s,
            p.sensor_lag * per_s,
        ];
        self.0.reduce(gain[0], gain[1], gain[3], gain[4], interval.reading_k2 * per_s);
        gains(gain)
    }

    fn covariance(&self) -> Matrix5<f64> {
        let p = &self.0;
        Matrix5::from_row_slice(
            &[
                [p.gas_gas, p.gas_wall, p.gas_sensor, p.gas_scale, p.gas_lag],
                [p.gas_wall, p.wall_wall, p.wall_sensor, p.wall_scale, p.wall_lag],
                [p.gas_sensor, p.wall_sensor, p.sensor_sensor, p.sensor_scale, p.sensor_lag],
                [p.gas_scale, p.wall_scale, p.sensor_scale, p.scale_scale, p.scale_lag],
                [p.gas_lag, p.wall_lag, p.sensor_lag, p.scale_lag, p.lag_lag],
            ]
            .concat()
            .iter()
            .map(|entry| f64::from(*entry))
            .collect::<Vec<_>>(),
        )
    }
}

/// Textbook form: P' = F P F' + Q, P = (I - K H) P', all 25 entries.
#[derive(Debug, Clone, Copy)]
pub struct Dense<T>(Square<T>);

impl<T: Scalar> Dense<T> {
    pub fn new(p: &Matrix5<f64>) -> Self {
        Self(std::array::from_fn(|i| std::array::from_fn(|j| T::from(p[(i, j)] as f32))))
    }
}

fn predicted<T: Scalar>(p: &Square<T>, interval: &Interval) -> Square<T> {
    let f = scalars::<T>(&interval.matrix);
    let mut next = product(&product(&f, |k, j| p[k][j]), |k, j| f[j][k]);
    for (i, drift) in interval.drift.into_iter().enumerate() {
        next[i][i] = next[i][i] + T::from(drift);
    }
    next
}

fn gain<T: Scalar>(p: &Square<T>, interval: &Interval) -> [T; N] {
    let variance = p[SENSOR][SENSOR] + T::from(interval.reading_k2);
    std::array::from_fn(|i| p[i][SENSOR] / variance)
}

impl<T: Scalar> Form for Dense<T> {
    fn predict(&mut self, interval: &Interval) {
        self.0 = predicted(&self.0, interval);
    }

    fn update(&mut self, interval: &Interval) -> [f64; N] {
        let p = &self.0;
        let gain = gain(p, interval);
        self.0 = std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - gain[i] * p[SENSOR][j]));
        gains(gain)
    }

    fn covariance(&self) -> Matrix5<f64> {
        matrix(&self.0)
    }
}

/// Joseph form: P = (I - K H) P' (I - K H)' + K R K'.
#[derive(Debug, Clone, Copy)]
pub struct Joseph<T>(pub Dense<T>);

impl<T: Scalar> Form for Joseph<T> {
    fn predict(&mut self, interval: &Interval) {
        self.0.predict(interval);
    }

    fn update(&mut self, interval: &Interval) -> [f64; N] {
        let p = self.0.0;
        let gain = gain(&p, interval);
        let reading_k2 = T::from(interval.reading_k2);
        // I - K H differs from I in one column.
        let left: Square<T> =
            std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - gain[i] * p[SENSOR][j]));
        self.0.0 = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                left[i][j] - left[i][SENSOR] * gain[j] + gain[i] * reading_k2 * gain[j]
            })
        });
        gains(gain)
    }

    fn covariance(&self) -> Matrix5<f64> {
        self.0.covariance()
    }
}

/// P = U D U', U unit upper triangular: Thornton's prediction by modified weighted Gram-Schmidt
/// and Bierman's update ("Factorization Methods for Discrete Sequential Estimation", 1977).
#[derive(Debug, Clone, Copy)]
pub struct Ud<T> {
    u: Square<T>,
    d: [T; N],
}

impl<T: Scalar> Ud<T> {
    pub fn new(p: &Matrix5<f64>) -> Self {
        let (mut rest, mut u, mut d) = (*p, Matrix5::identity(), [0.0; N]);
        for j in (0..N).rev() {
            d[j] = rest[(j, j)];
            for i in 0..j {
                u[(i, j)] = rest[(i, j)] / d[j];
            }
            for i in 0..j {
                for k in 0..j {
                    rest[(i, k)] -= u[(i, j)] * d[j] * u[(k, j)];
                }
            }
        }
        Self {
            u: std::array::from_fn(|i| std::array::from_fn(|j| T::from(u[(i, j)] as f32))),
            d: d.map(|d| T::from(d as f32)),
        }
    }
}

impl<T: Scalar> Form for Ud<T> {
    fn predict(&mut self, interval: &Interval) {
        let f = scalars::<T>(&interval.matrix);
        // W = [F U, I], weights [D, Q]. The last row of a column of U is 1, and below it 0.
        let (u, zero, one) = (self.u, T::from(0.0), T::from(1.0));
        let mut rows: [[T; 2 * N]; N] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                if j < N {
                    (0..j).map(|k| f[i][k] * u[k][j]).fold(f[i][j], |a, b| a + b)
                } else if j - N == i {
                    one
                } else {
                    zero
                }
            })
        });
        let weight = |k: usize| {
            if k < N { self.d[k] } else { T::from(interval.drift[k - N]) }
        };
        let weights: [T; 2 * N] = std::array::from_fn(weight);
        for j in (0..N).rev() {
            let weighted: [T; 2 * N] = std::array::from_fn(|k| weights[k] * rows[j][k]);
            self.d[j] = sum((0..2 * N).map(|k| weighted[k] * rows[j][k]));
            for i in 0..j {
                let share = sum((0..2 * N).map(|k| rows[i][k] * weighted[k])) / self.d[j];
                self.u[i][j] = share;
                let base = rows[j];
                for (entry, base) in rows[i].iter_mut().zip(base) {
                    *entry = *entry - share * base;
                }
            }
        }
    }

    fn update(&mut self, interval: &Interval) -> [f64; N] {
        // f = U' h, v = D f: the sensor's row of U.
        let zero = T::from(0.0);
        let f: [T; N] = self.u[SENSOR];
        let mut gain = [zero; N];
        let mut before = T::from(interval.reading_k2);
        for j in SENSOR..N {
            let v = self.d[j] * f[j];
            let after = before + f[j] * v;
            self.d[j] = self.d[j] * (before / after);
            let lambda = f[j] / before;
            for (i, gain) in gain.iter_mut().enumerate().take(j) {
                let u = self.u[i][j];
                self.u[i][j] = u - lambda * *gain;
                *gain = *gain + u * v;
            }
            gain[j] = v;
            before = after;
        }
        gains(gain.map(|unscaled| unscaled / before))
    }

    fn covariance(&self) -> Matrix5<f64> {
        let (u, d) = (matrix(&self.u), self.d.map(Into::<f64>::into));
        let u = Matrix5::from_fn(|i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => u[(i, j)],
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 0.0,
        });
        u * Matrix5::from_diagonal(&d.into()) * u.transpose()
    }
}

/// Steady gains without a covariance: averages of another form's gains over a cycle after
/// convergence, while the muscle is filled and while it is not.
#[derive(Debug, Clone, Copy)]
pub struct Steady(pub [[f64; N]; 2]);

impl Form for Steady {
    fn predict(&mut self, _: &Interval) {}

    fn update(&mut self, interval: &Interval) -> [f64; N] {
        self.0[usize::from(interval.charging)]
    }

    fn covariance(&self) -> Matrix5<f64> {
        Matrix5::identity()
    }
}
