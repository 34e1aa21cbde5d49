//! Friction, force area and bladder from even motion, up and down.
//!
//! Without acceleration, along L with x = L_0 - L and v the speed of contraction (Chou and Hannaford
//! with friction; A = -dV/dL as configured, the true one s times that):
//!
//! ```text
//! P_g A(L) = (1/s) (load + K(x)) + (k_b/s) x + (F/s) f(T_w) sgn v + (c/s) f(T_w) v
//! ```
//!
//! linear in the coefficients of load, contraction, direction and speed. The load has been weighed and is taken as
//! configured, and so is K, the elastic force in addition to k_b: a spring's preload, the saturating part of a bladder.
//! f is the configured softening at the estimated wall temperature.

use super::Refusal;
use super::experiment::{Plan, Record, configured};
use super::regression::{Fit, Measure, least_squares};
use model_core::config::Config;
use model_core::physics::chamber::{AnyChamber, Chamber, ChamberConfig};
use model_core::physics::hysteresis::{Held, Law};
use thermyo_compute::math::ends;
use thermyo_fit::assumed::{HYSTERESIS_OFF, LOAD_OFF, PRESSURE_OFF_PA};

/// Intervals over which records are averaged \[s\]: 0.2 periods of the load on its gas spring, ten LSBs of the ADC on
/// the slow ramp.
const BIN_S: f64 = 0.05;
/// Least speed of sliding \[m/s\]: above the Stribeck speeds of braided sleeves.
pub(crate) const SLIDING_M_S: f64 = 0.006;
/// Largest deviation of the motion in two neighbouring intervals from their mean, relative \[-\].
const EVEN: f64 = 0.25;
/// Motion after a reversal within which friction still builds up \[m\].
const TURN_M: f64 = 0.004;
/// Distance from the rest length within which the load may lie on its stop \[m\].
const STOP_M: f64 = 0.003;
/// Least span of wall temperature at which softening can be distinguished from scatter \[K\]: at 1 %/K a tenth of the
/// friction.
const SOFTENING_SPAN_K: f64 = 10.0;
/// Largest relative standard error of an adopted value \[-\].
const LARGEST_ERROR: f64 = 0.5;
/// Standard errors within which a value may be negative.
const ERRORS: f64 = 3.0;
/// Least ratio of friction to the standard error of the scatter: an error of a fifth.
pub const LEAST_SIGNAL: f64 = 5.0;

/// Errors of the quantities that the balance takes as configured.
#[derive(Debug, Clone, Copy)]
struct Altered {
    /// Load, and slip and creep, over the configured ones \[-\].
    load: f64,
    hysteresis: f64,
    /// Added to the measured pressure \[Pa\].
    offset_pa: f64,
}

impl Altered {
    const NOT: Self = Self { load: 1.0, hysteresis: 1.0, offset_pa: 0.0 };
}

/// Errors for which the stated ones allow: of a weighed load, of slip and creep as configured, and of the pressure
/// sensor.
const LAWS: [Altered; 3] = [
    Altered { load: LOAD_OFF, ..Altered::NOT },
    Altered { hysteresis: HYSTERESIS_OFF, ..Altered::NOT },
    Altered { offset_pa: PRESSURE_OFF_PA, ..Altered::NOT },
];

/// Results of even motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Force {
    /// Force area and volume of the braid, over the configured ones \[-\].
    pub area_scale: Measure,
    /// Stiffness of bladder or spring \[N/m\].
    pub stiffness_n_m: Measure,
    /// Coulomb friction at the reference temperature \[N\].
    pub coulomb_n: Measure,
    /// Coulomb friction, or slip and creep of a muscle without it, over its standard error.
    pub signal: f64,
    /// Viscous friction at the reference temperature \[N s/m\], if it exceeds the scatter.
    pub viscous_n_s_m: Option<Measure>,
    /// Softening \[1/K\], if the wall's temperature changed enough.
    pub softening_per_k: Option<Measure>,
    /// Estimated wall temperatures, lowest and highest \[K\].
    pub wall_k: [f64; 2],
    /// Root mean square of the residuals \[N\].
    pub rms_n: f64,
    pub points: Vec<Point>,
}

/// One interval of even motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub time_s: f64,
    pub contraction: f64,
    pub speed_m_s: f64,
    /// Pull of the gas, P_g A with the tuned area \[N\].
    pub pull_n: f64,
    /// Measured minus fitted \[N\].
    pub residual_n: f64,
}

/// Means over one interval.
#[derive(Debug, Clone, Copy)]
struct Bin {
    time_s: f64,
    pressure_pa: f64,
    length_m: f64,
    wall_k: f64,
    /// Force of slip and creep as configured \[N\].
    hysteresis_n: f64,
}

fn bins(records: &[Record], step_s: f64) -> Vec<Bin> {
    let count = (BIN_S / step_s).round().max(1.0) as usize;
    let mean =
        |bin: &[Record], of: fn(&Record) -> f64| bin.iter().map(of).sum::<f64>() / bin.len() as f64;
    records
        .chunks_exact(count)
        .map(|bin| Bin {
            time_s: mean(bin, |r| r.time_s),
            pressure_pa: mean(bin, |r| r.pressure_pa),
            length_m: mean(bin, |r| r.length_m),
            wall_k: mean(bin, |r| r.wall_k),
            hysteresis_n: 0.0,
        })
        .collect()
}

/// Follows slip and creep along the bins, from rest.
fn held_back(mut bins: Vec<Bin>, config: &Config) -> Vec<Bin> {
    let law = Law::new(&config.hysteresis, BIN_S as f32);
    let mut held = Held::default();
    let mut before_m = bins.first().map_or(0.0, |bin| bin.length_m);
    for bin in &mut bins {
        let way_m = std::mem::replace(&mut before_m, bin.length_m) - bin.length_m;
        let gauge_pa = bin.pressure_pa as f32 - config.ambient.pressure_pa;
        let softening = config.friction.softening(bin.wall_k as f32);
        held = law.after(&held, way_m as f32, gauge_pa, softening);
        bin.hysteresis_n = f64::from(held.force_n());
    }
    bins
}

/// The bins of even sliding, with the speed of contraction \[m/s\].
fn sliding(bins: &[Bin], rest_m: f64) -> Vec<(Bin, f64)> {
    let mut turned_m = f64::NAN;
    let mut before: f64 = 0.0;
    let mut found = Vec::new();
    for three in bins.windows(3) {
        let [earlier, bin, later] = three else { continue };
        let speed_m_s = (earlier.length_m - later.length_m) / (2.0 * BIN_S);
        if speed_m_s.abs() < SLIDING_M_S {
            before = 0.0;
            continue;
        }
        if speed_m_s.signum() != before.signum() || before == 0.0 {
            turned_m = bin.length_m;
        }
        before = speed_m_s;
        // Similar motion in neighbouring intervals: no acceleration, no reversal.
        let ways_m = [earlier.length_m - bin.length_m, bin.length_m - later.length_m];
        let mean_m = speed_m_s * BIN_S;
        let steady = ways_m.iter().all(|way_m| (way_m / mean_m - 1.0).abs() < EVEN);
        let lifted = (bin.length_m - rest_m).abs() > STOP_M;
        if steady && lifted && (bin.length_m - turned_m).abs() > TURN_M {
            found.push((*bin, speed_m_s));
        }
    }
    found
}

/// The balance of forces as configured.
struct Balance<'a> {
    config: &'a Config,
    chamber: &'a AnyChamber,
    load_n: f64,
    stiffness_n_m: f64,
}

impl Balance<'_> {
    /// Load and configured elastic force without the fitted stiffness, and slip and creep \[N\].
    fn held_n(&self, bin: &Bin, altered: Altered) -> f64 {
        let elastic_n = f64::from(self.chamber.force_n(0.0, bin.length_m as f32));
        let held_n = self.load_n * altered.load - elastic_n - self.stiffness_n_m * self.way_m(bin)
            + bin.hysteresis_n * altered.hysteresis;
        // The core's force is rounded: without load and preload there is nothing to fit.
        if held_n.abs() < 1.0e-3 { 0.0 } else { held_n }
    }

    fn way_m(&self, bin: &Bin) -> f64 {
        f64::from(self.chamber.rest_length_m()) - bin.length_m
    }

    fn gauge_pa(&self, bin: &Bin) -> f64 {
        bin.pressure_pa - f64::from(self.config.ambient.pressure_pa)
    }

    /// Pull of gas at this gauge pressure, with the configured area \[N\].
    fn pull_n(&self, bin: &Bin, gauge_pa: f64) -> f64 {
        -gauge_pa * f64::from(self.chamber.volume_slope_m2(bin.length_m as f32))
    }

    /// Columns of load, way, direction and speed, and the pull.
    fn rows(
        &self,
        sliding: &[(Bin, f64)],
        softening_per_k: f64,
        altered: Altered,
    ) -> Vec<([f64; 4], f64)> {
        let friction = &self.config.friction;
        let reference_k = f64::from(friction.reference_temperature_k);
        let row = |(bin, v): &(Bin, f64)| {
            let soft = (-softening_per_k * (bin.wall_k - reference_k)).exp();
            let gauge_pa = self.gauge_pa(bin) + altered.offset_pa;
            let coulomb = soft * f64::from(friction.at_pressure(gauge_pa as f32)) * v.signum();
            let columns = [self.held_n(bin, altered), self.way_m(bin), coulomb, soft * v];
            (columns, self.pull_n(bin, gauge_pa))
        };
        sliding.iter().map(row).collect()
    }
}

/// The fit as configured, and one for each of [`LAWS`].
struct Fits {
    configured: Fit<4>,
    laws: Vec<Fit<4>>,
}

impl Fits {
    fn new(rows: impl Fn(Altered) -> Vec<([f64; 4], f64)>) -> Option<Self> {
        let fit = |altered| least_squares(&rows(altered));
        let laws = LAWS.into_iter().map(fit).collect::<Option<_>>()?;
        Some(Self { configured: fit(Altered::NOT)?, laws })
    }

    /// A measure with the errors of the scatter and of the configured quantities.
    fn measure(&self, of: impl Fn(&[f64; 4]) -> f64) -> Measure {
        let Measure { value, error } = self.configured.measure(&of);
        let off = |law: &Fit<4>| law.measure(&of).value - value;
        let error = self.laws.iter().map(off).fold(error, f64::hypot);
        Measure { value, error }
    }
}

/// Fits the balance of forces to the ramps.
///
/// # Errors
/// If there is too little even sliding, or friction does not exceed the scatter.
pub fn fit(records: &[Record], plan: &Plan, config: &Config) -> Result<Force, Refusal> {
    let (chamber, load_n) = configured(config)?;
    let stiffness_n_m = f64::from(match config.chamber {
        ChamberConfig::Muscle(muscle) => muscle.bladder_stiffness_n_m,
        ChamberConfig::Cylinder(cylinder) => cylinder.spring_stiffness_n_m,
        ChamberConfig::Vessel(_) | ChamberConfig::Table(_) => 0.0,
    });
    let balance = Balance { config, chamber: &chamber, load_n, stiffness_n_m };
    // Slip and creep remember everything before the ramps.
    let mut bins = held_back(bins(records, f64::from(config.step_s)), config);
    bins.retain(|bin| plan.ramps_s.contains(&bin.time_s));
    let sliding = sliding(&bins, f64::from(chamber.rest_length_m()));
    let configured_per_k = f64::from(config.friction.softening_per_k);
    let wall_k = ends(sliding.iter().map(|(bin, _)| bin.wall_k));
    let rows = balance.rows(&sliding, configured_per_k, Altered::NOT);
    let softening_per_k = softening_per_k(&rows, &sliding, configured_per_k, wall_k);
    let soft_per_k = softening_per_k.map_or(configured_per_k, |found| found.value);
    let fits = Fits::new(|altered| balance.rows(&sliding, soft_per_k, altered))
        .ok_or(Refusal::TooFew { points: sliding.len() })?;
    let scattered = &fits.configured;
    let area_scale = fits.measure(|c| 1.0 / c[0]);
    let alone_n = if config.friction.force_n > 0.0 { 0.0 } else { mean_held_n(&sliding) };
    let coulomb_n = scattered.measure(|c| c[2] / c[0]);
    let signal = (coulomb_n.value + alone_n) / coulomb_n.error;
    if !(signal >= LEAST_SIGNAL && area_scale.value > 0.0) {
        return Err(Refusal::Noisy { signal, rms_n: scattered.rms() * area_scale.value });
    }
    let point = |((bin, speed_m_s), residual_n): (&(Bin, f64), &f64)| Point {
        time_s: bin.time_s,
        contraction: balance.way_m(bin) / f64::from(chamber.rest_length_m()),
        speed_m_s: *speed_m_s,
        pull_n: balance.pull_n(bin, balance.gauge_pa(bin)) * area_scale.value,
        residual_n: residual_n * area_scale.value,
    };
    Ok(Force {
        area_scale,
        stiffness_n_m: not_below_zero(fits.measure(|c| c[1] / c[0])),
        coulomb_n: not_below_zero(fits.measure(|c| c[2] / c[0])),
        signal,
        viscous_n_s_m: certain(fits.measure(|c| c[3] / c[0])),
        softening_per_k,
        wall_k,
        rms_n: scattered.rms() * area_scale.value,
        points: sliding.iter().zip(&scattered.residuals).map(point).collect(),
    })
}

/// Mean size of slip and creep, which alone hold back a muscle configured without friction \[N\].
fn mean_held_n(sliding: &[(Bin, f64)]) -> f64 {
    sliding.iter().map(|(bin, _)| bin.hysteresis_n.abs()).sum::<f64>() / sliding.len() as f64
}

/// Sets a value to 0 that is negative within its errors.
fn not_below_zero(found: Measure) -> Measure {
    let is_none = (-ERRORS * found.error..0.0).contains(&found.value);
    if is_none { Measure { value: 0.0, ..found } } else { found }
}

/// With exp(-(b + db)(T - T_ref)) = exp(-b (T - T_ref)) (1 - db (T - T_m)) exp(...) about the mean
/// T_m, one more column gives the change db of the softening.
fn softening_per_k(
    rows: &[([f64; 4], f64)],
    sliding: &[(Bin, f64)],
    configured_per_k: f64,
    [coldest_k, hottest_k]: [f64; 2],
) -> Option<Measure> {
    if hottest_k - coldest_k < SOFTENING_SPAN_K {
        return None;
    }
    let middle_k = f64::midpoint(coldest_k, hottest_k);
    let rows: Vec<([f64; 5], f64)> = rows
        .iter()
        .zip(sliding)
        .map(|(([load, way, direction, speed], y), (bin, _))| {
            ([*load, *way, *direction, *speed, direction * (bin.wall_k - middle_k)], *y)
        })
        .collect();
    certain(least_squares(&rows)?.measure(|c| configured_per_k - c[4] / c[2]))
}

fn certain(found: Measure) -> Option<Measure> {
    (found.value > 0.0 && found.error < LARGEST_ERROR * found.value).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::Faults;
    use model_core::config::Load;
    use model_core::physics::hysteresis::Hysteresis;

    /// Records of a muscle that slides evenly up and down, faster every second time, while its wall warms to
    /// `hottest_k`; friction is 12 N, softening 1.5 %/K where the core is configured with 1 %/K.
    fn records(plan: &Plan, config: &Config, hottest_k: f64) -> Vec<Record> {
        let (chamber, load_n) = configured(config).unwrap();
        let rest_m = f64::from(chamber.rest_length_m());
        let duration_s = plan.ramps_s.end - plan.ramps_s.start;
        let (mut length_m, mut speed_m_s) = (0.98 * rest_m, 0.02);
        (0..(duration_s / 0.001) as u32)
            .map(|step| {
                let since_s = f64::from(step) * 0.001;
                length_m -= speed_m_s * 0.001;
                if length_m < 0.75 * rest_m {
                    speed_m_s = -speed_m_s;
                } else if length_m > 0.98 * rest_m {
                    speed_m_s = if speed_m_s == -0.02 { 0.06 } else { 0.02 };
                }
                let wall_k = 290.0 + (hottest_k - 290.0) * since_s / duration_s;
                let soft = (-0.015 * (wall_k - 298.0)).exp();
                let friction_n = soft * (12.0 * f64::signum(speed_m_s) + 40.0 * speed_m_s);
                let pull_n = load_n + 600.0 * (rest_m - length_m) + friction_n;
                let area_m2 = -f64::from(chamber.volume_slope_m2(length_m as f32));
                let ambient_pa = f64::from(config.ambient.pressure_pa);
                Record {
                    step,
                    time_s: plan.ramps_s.start + since_s,
                    set_point: 0.0,
                    // A force area of 90 % of the configured one needs more pressure.
                    pressure_pa: ambient_pa + pull_n / (0.9 * area_m2),
                    length_m,
                    gas_k: 298.0,
                    wall_k,
                    inlet: 0.0,
                    outlet: 0.0,
                    faults: Faults::NONE,
                }
            })
            .collect()
    }

    #[test]
    fn softening_is_found_where_the_wall_warms_and_else_kept() {
        let config = Config { hysteresis: Hysteresis::NONE, ..Config::default() };
        let plan = Plan::new(&config, 4.0e5).unwrap();
        let warm = fit(&records(&plan, &config, 315.0), &plan, &config).unwrap();
        let softening = warm.softening_per_k.unwrap();
        assert!((softening.value - 0.015).abs() < 5e-4, "{softening:?}");
        assert!((warm.coulomb_n.value - 12.0).abs() < 0.1, "{:?}", warm.coulomb_n);
        assert!((warm.area_scale.value - 0.9).abs() < 1e-3, "{:?}", warm.area_scale);
        assert!((warm.stiffness_n_m.value - 600.0).abs() < 5.0, "{:?}", warm.stiffness_n_m);
        assert!((warm.viscous_n_s_m.unwrap().value - 40.0).abs() < 2.0);
        let cold = fit(&records(&plan, &config, 295.0), &plan, &config).unwrap();
        assert_eq!(cold.softening_per_k, None);
        assert!((cold.coulomb_n.value - 12.0).abs() < 1.0, "{:?}", cold.coulomb_n);
    }

    #[test]
    fn the_stated_errors_allow_for_what_is_configured_wrong() {
        let right = Config { hysteresis: Hysteresis::NONE, ..Config::default() };
        let plan = Plan::new(&right, 4.0e5).unwrap();
        let records = records(&plan, &right, 295.0);
        let Load::Isotonic { force_n } = right.load else { panic!("{:?}", right.load) };
        let load =
            |factor: f32| Config { load: Load::Isotonic { force_n: factor * force_n }, ..right };
        let mut low = right;
        low.ambient.pressure_pa -= 2.0e3;
        for (name, config) in [("load", load(0.99)), ("load", load(1.01)), ("pressure", low)] {
            let found = fit(&records, &plan, &config).unwrap();
            for (measure, truth) in
                [(found.area_scale, 0.9), (found.stiffness_n_m, 600.0), (found.coulomb_n, 12.0)]
            {
                let off = (measure.value - truth).abs() / measure.error;
                assert!(off < 1.5 && measure.error < 0.25 * truth, "{name}: {measure:?}, {truth}");
            }
            let scale = found.area_scale;
            assert!(scale.error > 0.005, "{name}: {scale:?}");
        }
    }
}
