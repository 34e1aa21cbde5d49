//! Heat transfer from gas to wall, from the relaxation after a stop.
//!
//! For closed gas of mass m, without any valve, the balance (3), (4) is
//!
//! ```text
//! m cv dT/dt + P dV/dt = -h A (T - T_w),   h = s h_still(P, T, T_w) + h_stirred exp(-t/tau_s)
//! T_w = T_end - (Q_end - Q)/C_w,           Q = -(m cv (T - T_0) + integral P dV)
//! ```
//!
//! T is known at every time ([`super`]), V from the length. The balance is integrated once, so that the noise of T is
//! not differentiated; s and each stop's h_stirred enter linearly:
//!
//! ```text
//! Q(t) = s I[h_still A (T - T_w)] + h_stirred I[exp(-t/tau_s) A (T - T_w)] + Q_0
//! ```
//!
//! tau_s is common to all stops. Standard errors come from the jackknife over the stops.

use super::thermometer::jackknife_sd;
use super::{Closed, FEWEST, Known, Stop};
use model_core::physics::chamber::{AnyChamber, Chamber};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Smallest difference to the wall at which a stop begins to count \[K\].
const LEAST_START_K: f64 = 2.0;
/// Share, and difference \[K\], down to which a stop counts.
const LEFT: f64 = 0.08;
const LEFT_K: f64 = 0.5;
/// Distance up to which rows are averaged around each row, at most two rows: more would remove heat from the start of a
/// stop \[s\].
const ABOUT_S: f64 = 0.025;
/// Decay times to try \[s\], spaced logarithmically. Stirring that lasts longer than a second looks like still gas
/// whose coefficient falls with the difference of temperatures.
const DECAYS: [f64; 2] = [0.05, 1.0];
const TRIED: usize = 25;
/// Number of standard errors above zero from which stirring counts.
const SEEN: f64 = 2.5;
/// Least inflow that counts as charging, as a share of the gas per second \[1/s\].
const CHARGING_1_S: f64 = 0.02;

/// Largest shift of still gas's coefficient by an unseen jet at which still gas alone explains the stops. On the
/// simulated nominal muscle, 3 to 8 stops, a real jet shifts it by 0.4 and more, an absent one by 0.06 at most \[-\].
const MOST_MOVED: f64 = 0.1;
/// Relative error of a law of free convection over pressures and differences, and one factor on it for walls that are
/// not evenly warm \[-\]. Assumption: such correlations are trusted to 10 to 25 %.
const LAW: f64 = 0.1;
/// Stops after an inflow that show a jet: with one of them left out, two remain for a mean.
pub(super) const CHARGED: usize = 3;

/// A value and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct With {
    pub value: f64,
    pub standard_error: f64,
}

impl With {
    fn of(value: f64, others: &[f64]) -> Self {
        Self { value, standard_error: jackknife_sd(others) }
    }

    /// Standard error over the value.
    pub fn relative(&self) -> f64 {
        (self.standard_error / self.value).abs()
    }
}

/// Heat transfer from gas to wall.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Relaxation {
    /// Still gas, one constant coefficient \[W/(m2 K)\].
    pub still_w_m2_k: With,
    /// Factor on the configured law of still gas \[-\].
    pub scale: With,
    /// Added by the jet where the stop follows an inflow, at the stop \[W/(m2 K)\].
    pub stirred_w_m2_k: Option<With>,
    /// The same, per inflow \[W/(m2 K) per kg/s\].
    pub stirred_per_flow: Option<With>,
    /// Time constant with which the jet's part decays \[s\].
    pub decay_s: Option<With>,
    /// Whether still gas and jet are distinguished. Otherwise the errors of still gas include the effect of a jet.
    pub parted: bool,
    /// Number of stops that count.
    pub stops: usize,
    /// Number of those that follow an inflow, or may.
    pub charged: usize,
}

struct Heat {
    time_s: Vec<f64>,
    /// Heat given to the wall \[J\].
    given_j: Vec<f64>,
    /// A (T - T_w) \[m2 K\].
    driving: Vec<f64>,
    /// The law's coefficient \[W/(m2 K)\].
    law: Vec<f64>,
    /// Inflow before the stop \[kg/s\], if known.
    inflow_kg_s: Option<f64>,
    /// Whether the gas was charged before the stop, or may have been.
    charged: bool,
}

fn heat(closed: &Closed, stop: &Stop, known: &Known, chamber: &AnyChamber) -> Option<Heat> {
    let config = known.config;
    let capacity_j_k = stop.mass_kg * f64::from(config.gas.cv_j_kg_k());
    let wall_j_k = f64::from(config.wall.heat_capacity_j_k);
    let (rows, volume_m3) = (closed.rows, &closed.volume_m3);
    let half = (ABOUT_S * rows.len() as f64 / closed.wait_s()).min(2.0) as usize;
    let gas_k = smooth(&stop.curve_k, half);
    let mut work_j = 0.0;
    let mut given_j = vec![0.0];
    for row in 1..rows.len() {
        let pressure_pa = 0.5 * (rows[row].pressure_pa + rows[row - 1].pressure_pa);
        work_j += pressure_pa * (volume_m3[row] - volume_m3[row - 1]);
        given_j.push(-(capacity_j_k * (gas_k[row] - gas_k[0]) + work_j));
    }
    let all_j = *given_j.last()?;
    let wall_k: Vec<f64> =
        given_j.iter().map(|given_j| stop.end_k - (all_j - given_j) / wall_j_k).collect();
    let start_k = gas_k[0] - wall_k[0];
    if start_k.abs() < LEAST_START_K {
        return None;
    }
    let least_k = (LEFT * start_k.abs()).max(LEFT_K);
    let counted = (0..rows.len())
        .find(|row| (gas_k[*row] - wall_k[*row]).abs() < least_k)
        .unwrap_or(rows.len());
    let surface = |row: usize| f64::from(chamber.surface_m2(rows[row].length_m as f32));
    Some(Heat {
        time_s: (0..counted).map(|row| closed.since_s(row)).collect(),
        driving: (0..counted).map(|row| surface(row) * (gas_k[row] - wall_k[row])).collect(),
        law: (0..counted)
            .map(|row| (known.law)(rows[row].pressure_pa, gas_k[row], wall_k[row]))
            .collect(),
        given_j: given_j[..counted].to_vec(),
        inflow_kg_s: closed.hold.inflow_kg_s,
        charged: closed
            .hold
            .inflow_kg_s
            .is_none_or(|inflow_kg_s| inflow_kg_s > CHARGING_1_S * stop.mass_kg),
    })
    .filter(|heat| heat.time_s.len() > 10)
}

/// Means of the rows around each row, `half` of them on either side.
fn smooth(values: &[f64], half: usize) -> Vec<f64> {
    let about = |row: usize| &values[row.saturating_sub(half)..(row + half + 1).min(values.len())];
    (0..values.len()).map(|row| about(row).iter().sum::<f64>() / about(row).len() as f64).collect()
}

fn integral(time_s: &[f64], of: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    for row in 1..time_s.len() {
        sum += 0.5 * (of(row) + of(row - 1)) * (time_s[row] - time_s[row - 1]);
        sums.push(sum);
    }
    sums
}

/// Factor on the still coefficient, each stop's stirred one, and the sum of squares.
struct Balanced {
    still: f64,
    stirred: Vec<f64>,
    square: f64,
}

/// Solves for the linear coefficients at one decay time, or without stirring.
fn balanced(heats: &[&Heat], decay_s: Option<f64>, law: bool) -> Option<Balanced> {
    // Unknowns: the still coefficient, then Q_0 and stirred of each stop.
    let own = 1 + usize::from(decay_s.is_some());
    let unknowns = 1 + own * heats.len();
    let (mut squares, mut right) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
    let mut total = 0.0;
    for (i, heat) in heats.iter().enumerate() {
        let still = |row: usize| heat.driving[row] * if law { heat.law[row] } else { 1.0 };
        let still = integral(&heat.time_s, still);
        let stirred = decay_s.map(|decay_s| {
            let left = |row: usize| heat.driving[row] * (-heat.time_s[row] / decay_s).exp();
            integral(&heat.time_s, left)
        });
        // Each stop counts the same, however long it lasts and however much heat it gives.
        let most_j = heat.given_j.iter().fold(0.0_f64, |most, j| most.max(j.abs()));
        let weight = 1.0 / (most_j * most_j * heat.time_s.len() as f64);
        for row in 0..heat.time_s.len() {
            let columns = [(0, still[row]), (1 + own * i, 1.0)];
            let jet = stirred.as_ref().map(|stirred| (2 + own * i, stirred[row]));
            let columns: Vec<(usize, f64)> = columns.into_iter().chain(jet).collect();
            for (a, x) in &columns {
                right[*a] += weight * x * heat.given_j[row];
                for (b, y) in &columns {
                    squares[(*a, *b)] += weight * x * y;
                }
            }
            total += weight * heat.given_j[row].powi(2);
        }
    }
    let values = squares.cholesky()?.solve(&right);
    let square = total - values.dot(&right);
    let stirred = (0..heats.len()).filter(|_| own == 2).map(|i| values[2 + own * i]).collect();
    Some(Balanced { still: values[0], stirred, square })
}

/// The best decay time, and its solution.
fn best(heats: &[&Heat], law: bool) -> Option<(f64, Balanced)> {
    let [low, high] = DECAYS;
    let tried = (0..TRIED).filter_map(|i| {
        let decay_s = low * (high / low).powf(i as f64 / (TRIED - 1) as f64);
        balanced(heats, Some(decay_s), law).map(|balanced| (decay_s, balanced))
    });
    tried.min_by(|(_, a), (_, b)| a.square.total_cmp(&b.square))
}

/// Mean of the stirred coefficients after an inflow, and per inflow if the inflow is known.
fn stirred(heats: &[&Heat], balanced: &Balanced) -> Option<(f64, Option<f64>)> {
    let charged: Vec<(f64, Option<f64>)> = heats
        .iter()
        .zip(&balanced.stirred)
        .filter(|(heat, _)| heat.charged)
        .map(|(heat, stirred)| (*stirred, heat.inflow_kg_s))
        .collect();
    if charged.len() < CHARGED - 1 {
        return None;
    }
    let sum: f64 = charged.iter().map(|(stirred, _)| stirred).sum();
    let inflow_kg_s: Option<f64> = charged.iter().map(|(_, inflow_kg_s)| *inflow_kg_s).sum();
    Some((sum / charged.len() as f64, inflow_kg_s.map(|inflow_kg_s| sum / inflow_kg_s)))
}

/// Fits the heat transfer to all usable stops; none with too few that cool enough.
pub(super) fn fit(
    stops: &[(&Closed, &Stop)],
    known: &Known,
    chamber: &AnyChamber,
) -> Option<Relaxation> {
    let heats: Vec<Heat> =
        stops.iter().filter_map(|(closed, stop)| heat(closed, stop, known, chamber)).collect();
    let heats: Vec<&Heat> = heats.iter().collect();
    if heats.len() < FEWEST {
        return None;
    }
    let jet = jet(&heats);
    let seen = jet.is_some();
    let law = still(&heats, true, seen)?;
    let constant = still(&heats, false, seen)?;
    // An unseen jet may exist: how far would it shift the coefficient of still gas?
    let moved = |law: bool, found: &With| {
        let with_jet = if seen { Some(*found) } else { still(&heats, law, true) };
        with_jet.map_or(f64::INFINITY, |with_jet| (with_jet.value - found.value).abs())
    };
    let parted = moved(true, &law) <= MOST_MOVED * law.value;
    let widened = |law: bool, found: With| match parted {
        true => found,
        false => With { standard_error: found.standard_error.hypot(moved(law, &found)), ..found },
    };
    let scale = widened(true, law);
    Some(Relaxation {
        still_w_m2_k: widened(false, constant),
        scale: With { standard_error: scale.standard_error.hypot(LAW * scale.value), ..scale },
        parted,
        charged: heats.iter().filter(|heat| heat.charged).count(),
        stirred_w_m2_k: jet.as_ref().map(|jet| jet.added_w_m2_k),
        stirred_per_flow: jet.as_ref().and_then(|jet| jet.per_flow),
        decay_s: jet.as_ref().map(|jet| jet.decay_s),
        stops: heats.len(),
    })
}

/// All stops but one.
fn without<'a>(heats: &[&'a Heat], out: usize) -> Vec<&'a Heat> {
    heats.iter().enumerate().filter(|(i, _)| *i != out).map(|(_, heat)| *heat).collect()
}

/// The coefficient of still gas, or the factor on its law.
fn still(heats: &[&Heat], law: bool, stirred: bool) -> Option<With> {
    let of = |heats: &[&Heat]| {
        let balanced = if stirred {
            best(heats, law).map(|(_, found)| found)
        } else {
            balanced(heats, None, law)
        };
        balanced.map(|found| found.still)
    };
    let others: Vec<f64> =
        (0..heats.len()).map(|out| of(&without(heats, out))).collect::<Option<_>>()?;
    Some(With::of(of(heats)?, &others))
}

/// The effect of a jet when it ends.
struct Jet {
    added_w_m2_k: With,
    per_flow: Option<With>,
    decay_s: With,
}

/// The coefficient that a jet adds, and its decay; none if no jet is seen.
fn jet(heats: &[&Heat]) -> Option<Jet> {
    let of = |heats: &[&Heat]| -> Option<(f64, Option<f64>, f64)> {
        let (decay_s, found) = best(heats, true)?;
        let (added, per_flow) = stirred(heats, &found)?;
        Some((added, per_flow, decay_s))
    };
    let (added, per_flow, decay_s) = of(heats)?;
    let others: Vec<(f64, Option<f64>, f64)> =
        (0..heats.len()).map(|out| of(&without(heats, out))).collect::<Option<_>>()?;
    let added_w_m2_k = With::of(added, &others.iter().map(|other| other.0).collect::<Vec<_>>());
    let other_flows: Option<Vec<f64>> = others.iter().map(|other| other.1).collect();
    let per_flow = per_flow.zip(other_flows).map(|(per_flow, others)| With::of(per_flow, &others));
    let decay_s = With::of(decay_s, &others.iter().map(|other| other.2).collect::<Vec<_>>());
    let seen = added_w_m2_k.value > SEEN * added_w_m2_k.standard_error;
    seen.then_some(Jet { added_w_m2_k, per_flow, decay_s })
}
