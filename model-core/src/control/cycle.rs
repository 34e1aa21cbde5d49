//! The paper's working cycle: gas flows in for half of the period and out for the other half.
//!
//! ```text
//! m_ref(t) = m_0 + flow t             0 <= t < period/2
//! m_ref(t) = m_0 + flow (period - t)  period/2 <= t < period
//! ```
//!
//! Valves alone do not close that circle: with a flow that is off by 5 %, or a pulse by a millisecond, the pressure
//! climbs from stroke to stroke. So the flow is corrected by the error of the estimated gas mass P V/(R T) against the
//! reference, and every stroke begins where the first one did. Time decides when a stroke turns, not the PWM's periods:
//! a turn may lie within one.

use super::chamber_port::ChamberPort;
use crate::math::limit;

/// Share of an error of the mass that one PWM period closes. A larger one would follow the noise of the mass, and
/// changing pulses make the estimator begin another line; a smaller one would let a pulse that moves too much carry a
/// stroke further.
const CLOSES: f32 = 0.2;
/// Parts of a step in which time is counted, so that no rounding adds up.
const PARTS: f32 = 65_536.0;
const PART_BITS: u32 = 16;

/// Parameters of a working cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strokes {
    /// Flow in either direction \[kg/s\].
    pub flow_kg_s: f32,
    /// Period \[s\].
    pub period_s: f32,
    /// Step of the core \[s\].
    pub step_s: f32,
}

/// State of the working cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// Gas mass at the start of a stroke \[kg\].
    start_kg: f32,
    /// Time since the start of a stroke, in parts of a step.
    phase: u64,
}

impl Cycle {
    /// Creates a cycle that starts with this mass \[kg\].
    pub fn new(mass_kg: f32) -> Self {
        Self { start_kg: mass_kg, phase: 0 }
    }

    /// Mass to move in the coming PWM period \[kg\], positive into the muscle. `elapsed_steps` have passed since the
    /// last period; `coming_steps` is the length of the coming one.
    pub fn period(
        &mut self,
        strokes: &Strokes,
        port: &ChamberPort,
        elapsed_steps: u32,
        coming_steps: u16,
    ) -> f32 {
        let Strokes { flow_kg_s, period_s, step_s } = *strokes;
        let length = (limit(period_s / step_s, 1.0, 1.0e9) * PARTS) as u64;
        let parts = |steps: u32| u64::from(steps) << PART_BITS;
        self.phase = wrapped(self.phase + parts(elapsed_steps), length);
        let per_part_kg = flow_kg_s * step_s / PARTS;
        let reference_kg = |phase: u64| {
            self.start_kg + per_part_kg * phase.min(length.saturating_sub(phase)) as f32
        };
        let now_kg = reference_kg(self.phase);
        let end = wrapped(self.phase + parts(coming_steps.into()), length);
        let change_kg = reference_kg(end) - now_kg;
        let error_kg = now_kg - port.gas_mass_kg() - port.in_flight_kg;
        let wanted_kg = change_kg + CLOSES * error_kg + port.leaked_kg;
        // A stroke goes one way: excess gas is waited for, not let out.
        if change_kg > 0.0 { limit(wanted_kg, 0.0, 1.0) } else { limit(wanted_kg, -1.0, 0.0) }
    }
}

/// Returns `phase` within a cycle of this length: mostly it already is.
fn wrapped(phase: u64, length: u64) -> u64 {
    if phase < length { phase } else { remainder(phase, length) }
}

/// Remainder by subtraction: a division of 64 bits takes a kilobyte of flash. Not inlined: two calls.
#[inline(never)]
fn remainder(mut phase: u64, length: u64) -> u64 {
    if length == 0 {
        return 0;
    }
    let longest = length.leading_zeros() - phase.leading_zeros();
    for doublings in (0..=longest).rev() {
        let cycles = length << doublings;
        if phase >= cycles {
            phase -= cycles;
        }
    }
    phase
}

#[cfg(test)]
mod tests {
    use super::*;

    const VOLUME_M3: f32 = 1.5e-4;

    /// Gas masses at the start of each stroke and largest gas mass, of a cycle whose periods move `moved_kg` of the
    /// requested mass.
    fn masses_kg(strokes: &Strokes, cycles: f32, moved_kg: impl Fn(f32) -> f32) -> (Vec<f32>, f32) {
        let mut mass_kg = 2.0e-4;
        let mut cycle = Cycle::new(mass_kg);
        let (mut starts_kg, mut most_kg) = (Vec::new(), mass_kg);
        let (mut elapsed_s, mut strokes_begun) = (0.0_f64, 0);
        for period in 0..(cycles * strokes.period_s / 0.01) as u32 {
            if elapsed_s >= f64::from(strokes_begun) * f64::from(strokes.period_s) - 1e-9 {
                starts_kg.push(mass_kg);
                strokes_begun += 1;
            }
            let port = port(mass_kg, 0.0);
            let steps = if period == 0 { 0 } else { 10 };
            mass_kg += moved_kg(cycle.period(strokes, &port, steps, 10));
            most_kg = most_kg.max(mass_kg);
            elapsed_s += 0.01;
        }
        (starts_kg, most_kg)
    }

    /// A period that is no multiple of the PWM's, one with two PWM periods per stroke, a long one; flows 5 % too large,
    /// pulses that move twice their mass, or always some more.
    #[test]
    fn every_stroke_begins_where_the_first_one_did() {
        for period_s in [0.04, 1.25, 0.777, 5.0] {
            let strokes = Strokes { flow_kg_s: 3.6e-4, period_s, step_s: 0.001 };
            let amplitude_kg = 0.5 * strokes.flow_kg_s * period_s;
            let step_kg = strokes.flow_kg_s * 0.01;
            type Moves = fn(f32) -> f32;
            let moves: [(&str, Moves); 4] = [
                ("exact", |kg| kg),
                ("5 % more", |kg| 1.05 * kg),
                ("more in, less out", |kg| if kg > 0.0 { 1.5 * kg } else { 0.7 * kg }),
                (
                    "6.6 mg more a pulse",
                    |kg| if kg == 0.0 { 0.0 } else { kg + 6.6e-6 * kg.signum() },
                ),
            ];
            for (name, moved_kg) in moves {
                let (starts_kg, most_kg) = masses_kg(&strokes, 100.0, moved_kg);
                let (first, rest) = (starts_kg[1], &starts_kg[2..]);
                let off_kg = rest.iter().map(|kg| (kg - first).abs()).fold(0.0, f32::max);
                assert!(rest.len() >= 97, "{}", rest.len());
                assert!(off_kg < 3.0 * step_kg + 6.6e-6, "{period_s} s, {name}: {off_kg} kg");
                let swing_kg = most_kg - 2.0e-4;
                let expected_kg = (amplitude_kg - 2.0 * step_kg)..(amplitude_kg + 2.0e-5);
                assert!(expected_kg.contains(&swing_kg), "{period_s} s, {name}: {swing_kg} kg");
            }
        }
    }

    /// 49.7 days of steps would overflow 32 bits; a changed period does not lose its place either.
    #[test]
    fn the_phase_stays_within_the_period() {
        assert_eq!([3, 10, 19, 20, 1_234_567].map(|phase| wrapped(phase, 10)), [3, 0, 9, 0, 7]);
        assert_eq!(wrapped(5, 0), 0);
    }

    /// 1 mg a period in and out, a stroke of ten periods each way, 0.2 g at its start.
    const STROKES: Strokes = Strokes { flow_kg_s: 1.0e-4, period_s: 0.2, step_s: 0.001 };

    /// A port in front of this much gas.
    fn port(mass_kg: f32, in_flight_kg: f32) -> ChamberPort {
        let pressure_pa = mass_kg * 287.05 * 298.0 / VOLUME_M3;
        ChamberPort { in_flight_kg, ..ChamberPort::of_air(pressure_pa, VOLUME_M3) }
    }

    /// First period after this many steps, with this much more gas than at the start \[mg\].
    fn first_mg(steps: u32, more_mg: f32, in_flight_mg: f32) -> f32 {
        let port = port(2.0e-4 + more_mg * 1.0e-6, in_flight_mg * 1.0e-6);
        1.0e6 * Cycle::new(2.0e-4).period(&STROKES, &port, steps, 10)
    }

    /// 20 % of the error is closed; gas in flight counts as arrived.
    #[test]
    fn a_period_moves_its_flow_and_a_fifth_of_what_is_missing() {
        for (steps, more_mg, in_flight_mg, expected_mg) in [
            (0, 0.0, 0.0, 1.0),
            (0, -1.0, 0.0, 1.2),
            (0, 1.0, 0.0, 0.8),
            (0, -1.0, 0.4, 1.12),
            (50, 5.0, 0.0, 1.0),
            (100, 10.0, 0.0, -1.0),
            (150, 4.0, 0.0, -0.8),
            (150, 5.0, -0.4, -0.92),
            (190, 1.0, 0.0, -1.0),
            (200, 0.0, 0.0, 1.0),
            (450, 5.0, 0.0, 1.0),
            // The turn in the middle of the period: in, and out again.
            (95, 9.5, 0.0, 0.0),
        ] {
            let mg = first_mg(steps, more_mg, in_flight_mg);
            assert!((mg - expected_mg).abs() < 1e-2, "step {steps}, {more_mg} mg: {mg} mg");
        }
    }

    #[test]
    fn a_stroke_never_goes_the_other_way() {
        assert_eq!([first_mg(0, 50.0, 0.0), first_mg(150, -50.0, 0.0)], [0.0; 2]);
    }
}
