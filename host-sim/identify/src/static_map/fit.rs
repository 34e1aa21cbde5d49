//! The search for the muscle behind a static map.
//!
//! ```text
//! sum of ((F(p, L) - direction friction - measured)/s)^2 + sum of ((x - x_0)/spread)^2
//! ```
//!
//! s is a hundredth of the largest force, the usual residual of the law. The second sum keeps
//! parameters that the readings leave open near the scenario's values: five readings are as many as
//! the unknowns, and without that sum their noise would go into the least determined unknown. With
//! forty readings its influence is negligible. The search varies the logarithms of the diameter, of
//! K1 and of e1, the braid angle, d0 over the rest length, and friction over the largest force; K1
//! is expected to grow with the diameter, as the bladder does.

use super::readings::{Reading, Readings};
use nalgebra::{DMatrix, DVector};
use thermyo_fit::search::{self, Found, LeastSquares, central_slopes};
use thermyo_plant::chamber::Chamber;
use thermyo_plant::chamber::braid;
use thermyo_scenario::{Muscle, at_rest};

/// Residual of the law, as a fraction of a muscle's largest force \[-\].
const LEFT: f64 = 0.01;
/// Prior spreads: logarithm of the diameter, angle \[rad\], logarithms of K1 per diameter and of
/// e1, d0, friction.
const SPREADS: [f64; 6] = [1.0, 0.1, 0.5, 0.5, 0.006, 0.1];
/// Offsets of the starting angles from the scenario's \[rad\].
const STARTS: [f64; 3] = [0.0, -0.08, 0.08];
/// Step of the differences; the search variables are of the order of one.
pub const DIFFERENCE: f64 = 1e-6;
/// Relative change of sum and point at which a search has converged: near f64's rounding.
const TOLERANCE: f64 = 30.0 * f64::EPSILON;
/// Evaluations per parameter before a search is given up.
const PATIENCE: usize = 100;
const DIAMETERS_M: [f64; 2] = [1.0e-3, 0.2];
/// Limits of the braid angle in the search \[deg\]: at 54.7 the force vanishes.
const ANGLES_DEG: [f64; 2] = [5.0, 53.0];
/// Limits of the strain over which a bladder fills \[-\].
const STRAINS: [f64; 2] = [1.0e-3, 1.0];
/// Relative difference up to which a value counts as at its limit.
const AT_LIMIT: f64 = 1.0e-3;

#[derive(Debug)]
pub struct Problem<'a> {
    readings: &'a Readings,
    given: &'a Muscle,
    usual: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// Problem of these readings. The scenario's K1 must be above 0.
    pub fn new(readings: &'a Readings, given: &'a Muscle) -> Self {
        let mut usual = vec![
            given.diameter_m.ln(),
            given.braid_angle_deg.to_radians(),
            given.bladder_saturation_n.ln(),
            given.bladder_strain.ln(),
            given.slack_m / given.rest_length_m,
        ];
        if readings.go_both_ways() {
            usual.push(0.0);
        }
        Self { readings, given, usual }
    }

    pub fn muscle(&self, place: &DVector<f64>) -> Muscle {
        let rest_length_m = self.readings.rest_length_m;
        let angle_deg = place[1].to_degrees().clamp(ANGLES_DEG[0], ANGLES_DEG[1]);
        let muscle = Muscle {
            bladder_saturation_n: place[2].exp(),
            bladder_strain: place[3].exp().clamp(STRAINS[0], STRAINS[1]),
            slack_m: place[4] * rest_length_m,
            ..self.given.clone()
        };
        let diameter_m = place[0].exp().clamp(DIAMETERS_M[0], DIAMETERS_M[1]);
        at_rest(&muscle, rest_length_m, diameter_m, angle_deg)
    }

    /// The scenario's muscle, scaled to the rest length of the readings.
    pub fn usual(&self) -> Muscle {
        self.muscle(&DVector::from_vec(self.usual.clone()))
    }

    /// Whether the search ended at a limit of this parameter, or tried to pass it.
    pub fn at_limit(place: &DVector<f64>, i: usize) -> bool {
        let (value, [low, high]) = match i {
            0 => (place[0].exp(), DIAMETERS_M),
            1 => (place[1].to_degrees(), ANGLES_DEG),
            3 => (place[3].exp(), STRAINS),
            _ => return false,
        };
        !(low * (1.0 + AT_LIMIT)..=high * (1.0 - AT_LIMIT)).contains(&value)
    }

    /// Friction at a point of the search \[N\]; none where the readings do not determine it.
    pub fn friction_n(&self, place: &DVector<f64>) -> Option<f64> {
        place.get(5).map(|share| share * self.readings.largest_n())
    }

    pub fn force_n(&self, place: &DVector<f64>, readings: &[Reading]) -> Vec<f64> {
        let muscle = braid::Muscle::of(&self.muscle(place));
        let friction_n = self.friction_n(place).unwrap_or_default();
        let force = |reading: &Reading| {
            reading.gauge_pressure_pa * muscle.force_area(reading.length_m)
                + muscle.elastic(reading.length_m)
                - reading.direction * friction_n
        };
        readings.iter().map(force).collect()
    }

    /// The best of several searches.
    pub fn search(&self) -> Found {
        let ends = STARTS.map(|turned_rad| {
            let mut start = DVector::from_vec(self.usual.clone());
            start[1] += turned_rad;
            search::minimize(self, start, TOLERANCE, PATIENCE)
        });
        let best = ends.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        best.expect("there are three starts")
    }

    /// Covariance of the search variables, from the prior and the readings' scatter where it
    /// exceeds the expected one.
    pub fn covariance(&self, place: &DVector<f64>) -> DMatrix<f64> {
        let slopes =
            central_slopes(place, DIFFERENCE, |_| DIFFERENCE, |place| self.weighted(place));
        let information = slopes.tr_mul(&slopes);
        let count = self.readings.loaded.len();
        let freedom = count.saturating_sub(place.len()).max(1) as f64;
        let scatter = self.weighted(place).rows(0, count).norm_squared() / freedom;
        let inverse = information.cholesky().expect("what is usual determines each").inverse();
        inverse * scatter.max(1.0)
    }

    /// Standard deviation of a variable by the prior alone.
    pub fn spread(i: usize) -> f64 {
        SPREADS[i]
    }
}

impl LeastSquares for Problem<'_> {
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
        let deviation_n = LEFT * self.readings.largest_n();
        let forces = self.force_n(place, &self.readings.loaded);
        let of_readings = forces
            .iter()
            .zip(&self.readings.loaded)
            .map(|(force_n, reading)| (force_n - reading.force_n) / deviation_n);
        let of_usual = (0..place.len()).map(|i| {
            let diameter = if i == 2 { place[0] - self.usual[0] } else { 0.0 };
            (place[i] - self.usual[i] - diameter) / SPREADS[i]
        });
        DVector::from_vec(of_readings.chain(of_usual).collect())
    }

    fn slopes(&self, place: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
        central_slopes(place, DIFFERENCE, |_| DIFFERENCE, |place| self.weighted(place))
    }
}
