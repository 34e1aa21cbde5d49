//! Inertia, gravity, friction and lengths from the balance of torques, without differentiating measurements.
//!
//! With the core's own law of both muscles (Chou and Hannaford 1994 with slip and creep, as configured) the torque
//! is known from pressures and angle, and
//!
//! ```text
//! r (F_a - F_b) = J q'' + c q' + g1 sin q + g2 cos q + D sgn q'        g1 = G cos q_h, g2 = -G sin q_h
//! ```
//!
//! is linear in J, c, g1, g2 and D. Both sides are multiplied by a function phi that vanishes with its slope at
//! the ends of a short window, and integrated; by parts the derivatives go to phi (modulating functions: Shinbrot,
//! Trans. ASME 79, 1957; Preisig and Rippin, Comput. Chem. Eng. 17, 1993):
//!
//! ```text
//! <r (F_a - F_b), phi> = J <q, phi''> - c <q, phi'> + g1 <sin q, phi> + g2 <cos q, phi> + D <sgn q', phi>
//! phi = 693/(512 h) (1 - (t/h)^2)^5     phi'' ends smoothly: sums over steps stand for integrals
//! ```
//!
//! which smooths every term alike. For a varying radius, r is `radius_m`, and forces count by their share of it, as
//! configured. Radius and lengths at angle 0 are in F; their derivatives are columns, and the fit is repeated with the
//! new ones until they stay (Gauss-Newton).
//!
//! Only windows count in which both tendons are taut and the joint slides one way throughout: the way after a turn in
//! which friction builds up, and the surplus of friction near standstill, are left out.
//!
//! Errors of the configured law: a force area that is s times the configured one in both muscles makes every torque 1/s
//! times the true one, and so all of J, c, G and D; those are then the values that the core needs. One muscle's area or
//! pressure appears as another mid-length, dL = ds A/A'. A bladder stiffer by dk appears as dG = 2 r^2 dk, and the
//! muscles' viscous friction as r^2 times it in c. With r, the torques, the lengths and G grow alike up to terms of (r
//! q/L)^2: torques alone cannot determine radius and both lengths.

use super::experiment::{Record, least_radius_m};
use crate::tune::regression::{Measure, Solution, solve};
use model_core::joint::JointConfig;
use model_core::joint::pulley::Shape;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::physics::hysteresis::{Held, Law};
use nalgebra::{DMatrix, DVector};

/// Half of a window \[s\]: five PWM periods on either side.
const HALF_S: f64 = 0.05;
/// Distance of two windows \[s\].
const HOP_S: f64 = 0.02;
/// Number of windows on either side in which the joint has to slide the same way.
const AROUND: usize = 3;
/// Way after a turn within which friction still builds up, over the way of a straight rise \[-\]: 2 % of an exponential
/// rise remain.
const BUILT_UP: f64 = 4.0;
/// Least such way: for braids, if no friction is configured \[m\].
const LEAST_TURN_M: f64 = 1.0e-3;
/// Largest number of repetitions of the fit; it has converged once lengths change by less than a millionth.
const REPEATS: usize = 12;
const STAYS: f64 = 1.0e-6;
/// Change of the radius for its derivative: torques are in f32 \[-\].
const RADIUS_CHANGE: f64 = 2.0e-3;
/// Largest number of steps of lost telemetry over which slip and creep are followed.
const MOST_LOST: u32 = 1000;
pub const COUNT: usize = 8;

/// A coefficient; its index is the index of its column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Term {
    Inertia,
    Viscous,
    Dry,
    GravitySine,
    GravityCosine,
    MidA,
    MidB,
    Radius,
}

impl Term {
    pub const ALL: [Self; COUNT] = [
        Self::Inertia,
        Self::Viscous,
        Self::Dry,
        Self::GravitySine,
        Self::GravityCosine,
        Self::MidA,
        Self::MidB,
        Self::Radius,
    ];
}

/// Lengths of the mechanism \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lengths {
    radius: f64,
    mid: [f64; 2],
}

/// One window of even sliding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub time_s: f64,
    pub angle_rad: f64,
    pub speed_rad_s: f64,
    /// Torque of the muscles with the fitted lengths \[N m\].
    pub torque_n_m: f64,
    /// Measured minus fitted \[N m\].
    pub residual_n_m: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Value and error by [`Term`]; an error of 0 means that the value was held.
    pub values: [Measure; COUNT],
    /// RMS of the columns: torque per unit of each coefficient.
    pub columns: [f64; COUNT],
    /// RMS torque of the muscles, and of the residuals \[N m\].
    pub torque_n_m: f64,
    pub rms_n_m: f64,
    pub points: Vec<Point>,
}

/// The configured law with errors, to see their effect on the values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Altered {
    /// Force area of muscle a, and elastic forces of bladder and creep of both, over the configured ones \[-\].
    pub area: f64,
    pub elastic: f64,
    /// Pressure of muscle a above the reading \[Pa\].
    pub offset_pa: f64,
}

impl Altered {
    pub const NOT: Self = Self { area: 1.0, elastic: 1.0, offset_pa: 0.0 };
}

/// Torque of the muscles in a step, and its derivatives \[N m, N m/m\].
#[derive(Debug, Clone, Copy)]
struct Torque {
    n_m: f64,
    by_mid: [f64; 2],
    /// Dry friction over its value at the reference, by wall and pressure \[-\].
    dry: f64,
    taut: bool,
}

struct Muscles<'a> {
    config: &'a JointConfig,
    chambers: [AnyChamber; 2],
    shapes: [Shape; 2],
}

impl<'a> Muscles<'a> {
    fn new(config: &'a JointConfig) -> Self {
        let [a, b] = &config.muscles;
        let chambers = [AnyChamber::new(&a.chamber), AnyChamber::new(&b.chamber)];
        Self { config, chambers, shapes: config.mechanism.shapes() }
    }

    /// Angles on `radius_m` that wind up as much as this one \[rad\], and radii over `radius_m`, of muscles a and b.
    fn pulley(&self, angle_rad: f64) -> ([f64; 2], [f64; 2]) {
        let at = |shape: &Shape| {
            let angle = angle_rad as f32;
            let share = shape.lever(angle, self.config.mechanism.radius_m).share;
            let mean = if angle == 0.0 { share } else { shape.wound_rad(angle) / angle };
            (angle_rad * f64::from(mean), f64::from(share))
        };
        let [(wound_a, of_a), (wound_b, of_b)] = self.shapes.each_ref().map(at);
        ([wound_a, wound_b], [of_a, of_b])
    }

    /// Torques along the records, with slip and creep starting from rest.
    fn torques(&self, records: &[Record], lengths: Lengths, altered: Altered) -> Vec<Torque> {
        let step_s = self.config.muscles[0].step_s;
        let laws = self.config.muscles.map(|muscle| Law::new(&muscle.hysteresis, step_s));
        let mut held = [Held::default(); 2];
        let mut before = records.first().map(|record| (record.step, record.angle_rad));
        let along = |record: &Record| {
            let (step, angle_rad) = before.unwrap_or_default();
            before = Some((record.step, record.angle_rad));
            // Number of steps whose telemetry was lost.
            let steps = record.step.saturating_sub(step).clamp(1, MOST_LOST);
            let way_m = lengths.radius * (record.angle_rad - angle_rad) / f64::from(steps);
            let (_, shares) = self.pulley(record.angle_rad);
            for (i, sign) in [(0, shares[0]), (1, -shares[1])] {
                let muscle = &self.config.muscles[i];
                let gauge_pa = record.pressure_pa[i] as f32 - muscle.ambient.pressure_pa;
                let softening = muscle.friction.softening(record.wall_k[i] as f32);
                for _ in 0..steps {
                    held[i] = laws[i].after(&held[i], (sign * way_m) as f32, gauge_pa, softening);
                }
            }
            let held_n = held.map(|held| {
                f64::from(held.slip_n) + altered.elastic * f64::from(held.fast_n + held.slow_n)
            });
            self.torque(record, lengths, held_n, altered)
        };
        records.iter().map(along).collect()
    }

    fn torque(
        &self,
        record: &Record,
        lengths: Lengths,
        held_n: [f64; 2],
        altered: Altered,
    ) -> Torque {
        let Lengths { radius, mid } = lengths;
        let (wound_rad, shares) = self.pulley(record.angle_rad);
        let length_m = [mid[0] - radius * wound_rad[0], mid[1] + radius * wound_rad[1]];
        let mut force_n = [0.0; 2];
        let mut spring_n_m = [0.0; 2];
        let (mut dry, mut most) = (0.0, 0.0);
        for i in 0..2 {
            let (muscle, chamber) = (&self.config.muscles[i], &self.chambers[i]);
            let (area, offset_pa) =
                if i == 0 { (altered.area, altered.offset_pa) } else { (1.0, 0.0) };
            let pressure_pa = (record.pressure_pa[i] + offset_pa) as f32;
            let gauge_pa = pressure_pa - muscle.ambient.pressure_pa;
            let by_gas = |all: f32, elastic: f32| {
                area * f64::from(all - elastic) + altered.elastic * f64::from(elastic)
            };
            let length_m = length_m[i] as f32;
            let (force, elastic) =
                (chamber.force_n(gauge_pa, length_m), chamber.force_n(0.0, length_m));
            force_n[i] = by_gas(force, elastic) - held_n[i];
            let (spring, elastic) =
                (chamber.stiffness_n_m(gauge_pa, length_m), chamber.stiffness_n_m(0.0, length_m));
            spring_n_m[i] = by_gas(spring, elastic);
            let factor = muscle.friction.softening(record.wall_k[i] as f32)
                * muscle.friction.at_pressure(gauge_pa);
            dry += shares[i] * f64::from(muscle.friction.force_n * factor);
            most += f64::from(muscle.friction.force_n);
        }
        let [a, b] = force_n;
        Torque {
            n_m: radius * (shares[0] * a - shares[1] * b),
            by_mid: [radius * shares[0] * spring_n_m[0], -radius * shares[1] * spring_n_m[1]],
            dry: if most > 0.0 { dry / most } else { 1.0 },
            taut: a > 0.0 && b > 0.0,
        }
    }
}

/// The function phi and its derivatives over a window, times the step.
struct Kernel {
    half: usize,
    smooth: Vec<f64>,
    slope: Vec<f64>,
    bend: Vec<f64>,
}

impl Kernel {
    fn new(step_s: f64) -> Self {
        let half = (HALF_S / step_s).round().max(4.0) as usize;
        let h = half as f64 * step_s;
        let scale = 693.0 / (512.0 * h) * step_s;
        let x = || (0..=2 * half).map(move |i| i as f64 / half as f64 - 1.0);
        let left = |x: f64| 1.0 - x * x;
        Self {
            half,
            smooth: x().map(|x| scale * left(x).powi(5)).collect(),
            slope: x().map(|x| scale / h * -10.0 * x * left(x).powi(4)).collect(),
            bend: x()
                .map(|x| scale / (h * h) * left(x).powi(3) * (80.0 * x * x - 10.0 * left(x)))
                .collect(),
        }
    }
}

fn product(kernel: &[f64], of: impl Iterator<Item = f64>) -> f64 {
    kernel.iter().zip(of).map(|(weight, value)| weight * value).sum()
}

/// Middles of the windows in which the joint slides one way, at `least_rad_s` or faster, with the speed there
/// \[rad/s\].
fn sliding(
    records: &[Record],
    kernel: &Kernel,
    least_rad_s: f64,
    turn_rad: f64,
) -> Vec<(usize, f64)> {
    let half = kernel.half;
    let hop = (half as f64 * HOP_S / HALF_S).round().max(1.0) as usize;
    let middles: Vec<usize> = (half..records.len().saturating_sub(half)).step_by(hop).collect();
    let speed = |middle: &usize| {
        let window = &records[middle - half..=middle + half];
        let whole = window[2 * half].step - window[0].step == 2 * half as u32;
        let speed = -product(&kernel.slope, window.iter().map(|record| record.angle_rad));
        if whole { speed } else { 0.0 }
    };
    let speeds: Vec<f64> = middles.iter().map(speed).collect();
    let mut found = Vec::new();
    let (mut turned_rad, mut sign) = (f64::NAN, 0.0);
    for (k, middle) in middles.iter().enumerate() {
        let now = if speeds[k].abs() < least_rad_s { 0.0 } else { speeds[k].signum() };
        if now != sign {
            turned_rad = records[*middle].angle_rad;
            sign = now;
        }
        let around = &speeds[k.saturating_sub(AROUND)..(k + AROUND + 1).min(speeds.len())];
        let even = around.iter().all(|speed| speed * now >= least_rad_s);
        let clear = (records[*middle].angle_rad - turned_rad).abs() > turn_rad;
        if now != 0.0 && even && clear {
            found.push((*middle, speeds[k]));
        }
    }
    found
}

/// Records, the windows in which they slide, and the muscles.
pub struct Balance<'a> {
    records: &'a [Record],
    muscles: Muscles<'a>,
    kernel: Kernel,
    windows: Vec<(usize, f64)>,
}

impl<'a> Balance<'a> {
    /// Balance for records of a joint whose muscles slide at `sliding_rad_s` and faster.
    pub fn new(records: &'a [Record], sliding_rad_s: f64, config: &'a JointConfig) -> Self {
        let kernel = Kernel::new(f64::from(config.muscles[0].step_s));
        let turn_m = config.muscles.iter().map(|muscle| {
            let (friction, slip) = (&muscle.friction, &muscle.hysteresis);
            let rises = friction.force_n / friction.presliding_stiffness_n_m.max(1.0);
            let slips = slip.slip_force_n / slip.slip_stiffness_n_m.max(1.0);
            BUILT_UP * f64::from(rises) + 2.0 * f64::from(slips)
        });
        let turn_m = turn_m.fold(LEAST_TURN_M, f64::max);
        let turn_rad = turn_m / least_radius_m(&config.mechanism);
        let windows = sliding(records, &kernel, sliding_rad_s, turn_rad);
        Self { records, muscles: Muscles::new(config), kernel, windows }
    }

    pub fn windows(&self) -> usize {
        self.windows.len()
    }

    /// Fits every coefficient except those `held` at a value, starting from these mid-lengths. `None` if the windows do
    /// not determine them.
    pub fn fit(
        &self,
        held: &[Option<f64>; COUNT],
        altered: Altered,
        start_m: [f64; 2],
    ) -> Option<Fitted> {
        let mechanism = &self.muscles.config.mechanism;
        let at = |term: Term, start: f64| held[term as usize].unwrap_or(start);
        let mut lengths = Lengths {
            radius: at(Term::Radius, f64::from(mechanism.radius_m)),
            mid: [at(Term::MidA, start_m[0]), at(Term::MidB, start_m[1])],
        };
        let free: Vec<usize> = (0..COUNT).filter(|i| held[*i].is_none()).collect();
        for _ in 0..REPEATS {
            let rows = self.rows(lengths, altered);
            let solution = solved(&rows, held, &free)?;
            let moved = |term: Term| {
                let column = free.iter().position(|i| *i == term as usize);
                column.map_or(0.0, |column| solution.coefficients[column])
            };
            let [a, b, radius] = [Term::MidA, Term::MidB, Term::Radius].map(moved);
            lengths.mid[0] += a;
            lengths.mid[1] += b;
            lengths.radius += radius;
            let sane = lengths.radius > 0.0 && lengths.mid.iter().all(|mid| *mid > 0.0);
            if !(sane && lengths.radius.is_finite()) {
                return None;
            }
            let stays = (a / lengths.mid[0]).abs().max((b / lengths.mid[1]).abs());
            if stays.max((radius / lengths.radius).abs()) < STAYS {
                return Some(self.fitted(&rows, lengths, held, (&free, &solution)));
            }
        }
        None
    }

    fn rows(&self, lengths: Lengths, altered: Altered) -> Vec<Row> {
        let torques = self.muscles.torques(self.records, lengths, altered);
        let change_m = RADIUS_CHANGE * lengths.radius;
        let wider = Lengths { radius: lengths.radius + change_m, ..lengths };
        let wider = self.muscles.torques(self.records, wider, altered);
        let half = self.kernel.half;
        let row = |(middle, speed): &(usize, f64)| {
            let span = middle - half..=middle + half;
            let (records, torques) = (&self.records[span.clone()], &torques[span.clone()]);
            let wider = product(&self.kernel.smooth, wider[span].iter().map(|one| one.n_m));
            let Kernel { smooth, slope, bend, .. } = &self.kernel;
            let angle = |of: fn(f64) -> f64| records.iter().map(move |one| of(one.angle_rad));
            let torque = |of: fn(&Torque) -> f64| product(smooth, torques.iter().map(of));
            torques.iter().all(|one| one.taut).then(|| Row {
                middle: *middle,
                speed_rad_s: *speed,
                torque_n_m: torque(|one| one.n_m),
                columns: [
                    product(bend, angle(|q| q)),
                    -product(slope, angle(|q| q)),
                    speed.signum() * torque(|one| one.dry),
                    product(smooth, angle(f64::sin)),
                    product(smooth, angle(f64::cos)),
                    -torque(|one| one.by_mid[0]),
                    -torque(|one| one.by_mid[1]),
                    -(wider - torque(|one| one.n_m)) / change_m,
                ],
            })
        };
        self.windows.iter().filter_map(row).collect()
    }

    fn fitted(
        &self,
        rows: &[Row],
        lengths: Lengths,
        held: &[Option<f64>; COUNT],
        (free, solution): (&[usize], &Solution),
    ) -> Fitted {
        let mut values = held.map(|value| Measure { value: value.unwrap_or(0.0), error: 0.0 });
        for (column, i) in free.iter().enumerate() {
            values[*i] = Measure {
                value: solution.coefficients[column],
                error: solution.covariance[(column, column)].sqrt(),
            };
        }
        values[Term::MidA as usize].value = lengths.mid[0];
        values[Term::MidB as usize].value = lengths.mid[1];
        values[Term::Radius as usize].value = lengths.radius;
        let rms = |of: &dyn Fn(&Row) -> f64| {
            (rows.iter().map(|row| of(row).powi(2)).sum::<f64>() / rows.len() as f64).sqrt()
        };
        let residuals = &solution.residuals;
        let square: f64 = residuals.iter().map(|residual| residual * residual).sum();
        let point = |(row, residual_n_m): (&Row, &f64)| Point {
            time_s: self.records[row.middle].time_s,
            angle_rad: self.records[row.middle].angle_rad,
            speed_rad_s: row.speed_rad_s,
            torque_n_m: row.torque_n_m,
            residual_n_m: *residual_n_m,
        };
        Fitted {
            values,
            columns: std::array::from_fn(|i| rms(&|row| row.columns[i])),
            torque_n_m: rms(&|row| row.torque_n_m),
            rms_n_m: (square / rows.len() as f64).sqrt(),
            points: rows.iter().zip(residuals).map(point).collect(),
        }
    }
}

/// Balance of torques over one window.
struct Row {
    middle: usize,
    speed_rad_s: f64,
    torque_n_m: f64,
    columns: [f64; COUNT],
}

/// Solves for the free coefficients; those of lengths are changes, and a held length has none.
fn solved(rows: &[Row], held: &[Option<f64>; COUNT], free: &[usize]) -> Option<Solution> {
    let is_length = |i: usize| i >= Term::MidA as usize;
    let columns = DMatrix::from_fn(rows.len(), free.len(), |row, i| rows[row].columns[free[i]]);
    let y = DVector::from_fn(rows.len(), |row, _| {
        let known = (0..COUNT)
            .filter(|i| !is_length(*i))
            .filter_map(|i| held[i].map(|value| value * rows[row].columns[i]));
        rows[row].torque_n_m - known.sum::<f64>()
    });
    solve(&columns, &y)
}
