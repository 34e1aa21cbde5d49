//! Plan of the readings: where the muscle pulls, even if it pulls less than its law predicts.

use super::readings::{FEWEST, Reading};
use model_core::physics::chamber::{AnyChamber, Chamber as _};
use thermyo_plant::chamber::{Chamber, braid};
use thermyo_scenario::Muscle;

/// Fraction of the largest contraction, and of the range of gauge pressure from the start of
/// pulling at rest to the highest. Two readings at rest determine the area and the bladder's
/// largest force; two further in, where it saturates; one far in, the angle.
const PLAN: [(f64, f64); FEWEST] = [(0.0, 1.0), (0.0, 0.35), (0.3, 1.0), (0.3, 0.6), (FAR, 1.0)];
const FAR: f64 = 0.85;
/// Factor on the pressure that the law predicts, as a margin.
const MARGIN: f64 = 1.4;
/// Contraction over which a muscle has to pull so that its law can be determined \[-\].
pub const LEAST_STROKE: f64 = 0.01;
/// Contraction below which a reading at rest with more pressure is better \[-\].
const NEAR_REST: f64 = 0.002;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    pub contraction: f64,
    pub gauge_pressure_pa: f64,
}

/// The five most informative readings of a muscle, up to a gauge pressure \[Pa\].
pub fn places(muscle: &Muscle, highest_pa: f64) -> [Place; FEWEST] {
    let from_pa = begins_pa(muscle);
    PLAN.map(|(of_contraction, of_pressure)| {
        let gauge_pressure_pa = from_pa + of_pressure * (highest_pa - from_pa);
        let contraction = of_contraction * surely_pulls(muscle, gauge_pressure_pa);
        Place { contraction, gauge_pressure_pa }
    })
}

/// Gauge pressure at which the muscle certainly pulls at rest \[Pa\].
fn begins_pa(muscle: &Muscle) -> f64 {
    let (law, rest_m) = (braid::Muscle::of(muscle), muscle.rest_length_m);
    (-MARGIN * law.elastic(rest_m) / law.force_area(rest_m)).max(0.0)
}

/// Contraction up to which the muscle certainly pulls at a gauge pressure \[-\].
pub fn surely_pulls(muscle: &Muscle, gauge_pressure_pa: f64) -> f64 {
    let chamber = AnyChamber::new(&braid::Muscle::of(muscle).configured(0.0));
    let length_m = chamber.length_for_force_m((gauge_pressure_pa / MARGIN) as f32, 0.0);
    1.0 - f64::from(length_m) / muscle.rest_length_m
}

/// Describes where to repeat a reading that found the muscle slack.
pub fn instead(muscle: &Muscle, reading: &Reading) -> String {
    let Reading { line, length_m, gauge_pressure_pa, .. } = *reading;
    let rest_m = muscle.rest_length_m;
    // The law of few readings may be wrong, so halve the contraction.
    let nearer = 0.5 * (1.0 - length_m / rest_m);
    let contraction = nearer.min(FAR * surely_pulls(muscle, gauge_pressure_pa));
    if contraction > NEAR_REST {
        let there_m = rest_m * (1.0 - contraction);
        return format!(
            "line {line} is slack: take it at length_m = {there_m:.4} instead of {length_m:?}"
        );
    }
    let enough_pa = (MARGIN * gauge_pressure_pa.max(begins_pa(muscle)) / 1000.0).round() * 1000.0;
    format!(
        "line {line} is slack: take it at length_m = {rest_m:?} and gauge_pressure_pa = {enough_pa:?} or more"
    )
}
