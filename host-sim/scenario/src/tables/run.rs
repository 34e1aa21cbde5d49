//! The run: duration, drive, link, and fit.

use crate::declare::{choice, table};
use model_core::config::{self, LinkConfig};
use std::f64::consts::{LN_2, TAU};
use thermyo_compute::math;

table! {
    "run", "length, step, seed";
    Run {
        duration_s: real 100.0, "s", 0.001 to 1.0e6, "simulated time";
        step_s: from config::STEP_S;
        seed: whole u64, 1, 0 to 9_223_372_036_854_775_807, "seed of every random number";
        log_every: whole u64, 10, 1 to 1_000_000_000, "one row of the trace per that many steps";
    }
}

impl Run {
    /// Number of steps of the run: its duration, rounded to whole steps.
    pub fn steps(&self) -> u64 {
        (self.duration_s / self.step_s).round() as u64
    }

    /// End of the last step \[s\].
    pub fn end_s(&self) -> f64 {
        let end_s = self.steps() as f64 * self.step_s;
        // The duration as written in the file where only the last digits differ.
        let is_duration = (end_s - self.duration_s).abs() < 1e-6 * self.step_s;
        if is_duration { self.duration_s } else { end_s }
    }
}

choice! {
    DriveKind {
        /// Constant inflow for half of the period, the same outflow for the other half.
        MassFlow = "mass-flow",
        /// Inlet duty (positive) or outlet duty (negative) from the profile.
        Duty = "duty",
        Pressure = "pressure",
        Contraction = "contraction",
        /// Vessel: nozzle open to ambient. Muscle: outlet open.
        Discharge = "discharge",
        /// Vessel: nozzle open to the supply. Muscle: inlet open.
        Fill = "fill",
        Closed = "closed",
    }
}

choice! {
    /// Set point over time, around an offset.
    Shape {
        Constant = "constant",
        Sine = "sine",
        /// Offset for half of the period, then offset + amplitude.
        Step = "step",
        /// A sine whose frequency rises from 1/period_s over [`CHIRP_OCTAVES`] octaves during the run.
        Chirp = "chirp",
        /// Eight holds per period: offset, up to + amplitude, down to - amplitude, back.
        Staircase = "staircase",
    }
}

/// A shape at one time, in its amplitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShapePoint {
    pub share: f64,
    /// Rate of the share \[1/s\]; 0 where it jumps.
    pub speed_1_s: f64,
    pub acceleration_1_s2: f64,
}

impl ShapePoint {
    const fn hold(share: f64) -> Self {
        Self { share, speed_1_s: 0.0, acceleration_1_s2: 0.0 }
    }

    /// A sine at this angle \[rad\], whose rate grows by this factor per second.
    fn sine(angle: f64, rad_s: f64, growth_1_s: f64) -> Self {
        let (sin, cos) = (math::sin(angle), math::cos(angle));
        Self {
            share: sin,
            speed_1_s: rad_s * cos,
            acceleration_1_s2: growth_1_s * rad_s * cos - rad_s * rad_s * sin,
        }
    }
}

impl Shape {
    /// The shares between which it stays, in the order in which it reaches them.
    pub const fn ends(self) -> [f64; 2] {
        match self {
            Self::Constant => [0.0, 0.0],
            Self::Step => [0.0, 1.0],
            Self::Sine | Self::Chirp | Self::Staircase => [1.0, -1.0],
        }
    }

    /// Number of steps in which its fastest cycle makes all its turns, and what that allows for a period.
    pub const fn least_steps(self) -> (f64, &'static str) {
        match self {
            Self::Constant => (0.0, ""),
            Self::Sine | Self::Step => (4.0, "at least four times run.step_s"),
            Self::Staircase => (8.0, "at least eight times run.step_s, one a hold"),
            Self::Chirp => (64.0, "at least 64 times run.step_s, of which the end takes four"),
        }
    }

    /// The shape in a run of this duration.
    pub fn at(self, time_s: f64, period_s: f64, duration_s: f64) -> ShapePoint {
        let cycles = time_s / period_s;
        // Multiples of the period belong to the next cycle, whatever the rounding.
        let part = (cycles + 1e-9).fract();
        match self {
            Self::Constant => ShapePoint::hold(0.0),
            Self::Sine => ShapePoint::sine(TAU * cycles, TAU / period_s, 0.0),
            Self::Step => ShapePoint::hold(f64::from(u8::from(part >= 0.5))),
            Self::Chirp => {
                let chirp = Chirp::new(period_s, duration_s);
                ShapePoint::sine(chirp.angle(time_s), chirp.rad_s(time_s), chirp.growth_1_s())
            }
            Self::Staircase => {
                const HOLDS: [f64; 8] = [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5];
                ShapePoint::hold(HOLDS.get((part * 8.0) as usize).copied().unwrap_or_default())
            }
        }
    }
}

/// Octaves of a chirp: assumed, from a slow motion to one too fast for a muscle.
pub const CHIRP_OCTAVES: f64 = 4.0;

table! {
    "drive", "set point over the run";
    Drive {
        kind: choice DriveKind::MassFlow, "controlled quantity, or fixed openings";
        period_s: real 5.0, "s", 1.0e-3 to 86_400.0, "period of the cycle (mass-flow), or of the shape";
        flow_kg_s: real 3.6e-4, "kg/s", 0.0 to 1.0, "flow, in for half of the period, then out (mass-flow)";
        pressure_pa: real 300_000.0, "Pa", 1.0 to 1.0e8, "set point, absolute (pressure)";
        contraction: real 0.1, "", -10.0 to 0.95, "set point, fraction of the rest length; negative where it lengthens (contraction)";
        shape: choice Shape::Constant, "set point over time (pressure, contraction)";
        amplitude: real 0.0, "Pa or 1", -1.0e8 to 1.0e8, "amplitude of the shape, in the set point's unit";
        offset: optional "Pa or 1", -1.0e8 to 1.0e8, "middle of the shape, start of a step, in the set point's unit; else pressure_pa or contraction";
        profile_csv: csv "value", "flow (negative: out), duty (negative: outlet), pressure or contraction over time";
    }
}

impl Drive {
    /// Whether the set point is one number for the whole run.
    pub fn is_constant(&self) -> bool {
        self.profile_csv.is_none() && self.shape == Shape::Constant
    }

    /// Middle of the shape, in the unit of the set point.
    pub fn middle(&self) -> f64 {
        let own =
            if self.kind == DriveKind::Contraction { self.contraction } else { self.pressure_pa };
        self.offset.unwrap_or(own)
    }

    /// Smallest and largest set point of the shape, in its unit.
    pub fn extremes(&self) -> [f64; 2] {
        let [one, other] = self.shape.ends().map(|share| self.middle() + self.amplitude * share);
        [one.min(other), one.max(other)]
    }

    /// Set point of the shape in a run of this duration, in its unit.
    pub fn shaped(&self, time_s: f64, duration_s: f64) -> f64 {
        self.middle() + self.amplitude * self.shape.at(time_s, self.period_s, duration_s).share
    }
}

/// Sine whose frequency doubles in equal times, over a whole run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chirp {
    /// Period at the start.
    period_s: f64,
    duration_s: f64,
}

impl Chirp {
    /// A chirp in a run of this duration.
    pub fn new(period_s: f64, duration_s: f64) -> Self {
        Self { period_s, duration_s }
    }

    /// Rate at which the logarithm of the frequency rises \[1/s\].
    fn growth_1_s(&self) -> f64 {
        CHIRP_OCTAVES * LN_2 / self.duration_s
    }

    /// Angle of the sine \[rad\].
    pub fn angle(&self, time_s: f64) -> f64 {
        let octaves = self.growth_1_s();
        TAU / self.period_s * (math::exp(octaves * time_s) - 1.0) / octaves
    }

    /// Rate of that angle \[rad/s\].
    pub fn rad_s(&self, time_s: f64) -> f64 {
        TAU / self.period_s * math::exp(self.growth_1_s() * time_s)
    }
}

table! {
    "link", "line between host and board";
    Link as LinkConfig {
        core timeout_s;
    }
}

table! {
    "identify", "what thermyo identify fits to measurements";
    Identify {
        parameters: list "keys whose values are fitted, such as heat.scale";
        columns: list "measured columns to compare with; empty: all that the data has";
        starts: whole u64, 6, 1 to 100, "starts of the search, the scenario's own values first";
        spread: real 2.0, "", 1.0 to 100.0, "factor that the other starts lie within";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_what_they_are_called() {
        let drive = |shape| Drive {
            kind: DriveKind::Contraction,
            contraction: 0.1,
            amplitude: 0.02,
            period_s: 4.0,
            shape,
            ..Drive::default()
        };
        for (shape, points) in [
            (Shape::Constant, [0.1; 5]),
            (Shape::Sine, [0.1, 0.12, 0.1, 0.08, 0.1]),
            (Shape::Step, [0.1, 0.1, 0.12, 0.12, 0.1]),
            (Shape::Staircase, [0.1, 0.12, 0.1, 0.08, 0.1]),
        ] {
            for (time_s, expected) in (0_u8..).map(f64::from).zip(points) {
                let value = drive(shape).shaped(time_s, 8.0);
                assert!((value - expected).abs() < 1e-12, "{shape:?} at {time_s} s: {value}");
            }
        }
        let chirp = drive(Shape::Chirp);
        // The phase's rate rises from 1/period_s to 16/period_s.
        let crossings = |from_s: f64, to_s: f64| {
            let values = (0..10_000).map(|i| from_s + f64::from(i) * 1e-4 * (to_s - from_s));
            let above: Vec<bool> = values.map(|t| chirp.shaped(t, 40.0) > 0.1).collect();
            above.windows(2).filter(|pair| pair[0] != pair[1]).count()
        };
        assert_eq!(crossings(0.1, 4.0), 2, "a little more than one cycle in the first period");
        assert!((28..=32).contains(&crossings(36.0, 40.0)), "{}", crossings(36.0, 40.0));
        assert_eq!(chirp.extremes(), [0.08, 0.12000000000000001]);
        assert_eq!(Drive { offset: Some(0.2), ..drive(Shape::Sine) }.shaped(0.0, 8.0), 0.2);
    }

    /// Rates against central differences over 0.1 ms, whose error is some 1e-7 of them.
    #[test]
    fn the_rates_of_a_shape_are_those_of_its_course() {
        const APART_S: f64 = 1e-4;
        for shape in [Shape::Sine, Shape::Chirp] {
            for i in 1..400 {
                let time_s = 0.02 * f64::from(i);
                let at = |later_s: f64| shape.at(time_s + later_s, 2.0, 8.0);
                let [before, now, after] = [-APART_S, 0.0, APART_S].map(at);
                let speed = (after.share - before.share) / (2.0 * APART_S);
                let acceleration = (after.speed_1_s - before.speed_1_s) / (2.0 * APART_S);
                assert!((now.speed_1_s - speed).abs() < 1e-3, "{shape:?} at {time_s} s: {speed}");
                assert!(
                    (now.acceleration_1_s2 - acceleration).abs() < 0.1,
                    "{shape:?} at {time_s} s: {acceleration}"
                );
            }
        }
        assert_eq!(Shape::Staircase.at(0.6, 4.0, 8.0), ShapePoint::hold(0.5));
        assert_eq!(Shape::Step.at(2.0, 4.0, 8.0), ShapePoint::hold(1.0));
    }
}
