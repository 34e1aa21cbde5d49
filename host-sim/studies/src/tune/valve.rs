//! Conductance and delay of the valves, from steps of the pressure that open them fully, and the switching time, from
//! the short pulses of the ramps.
//!
//! The gas mass by eq. (1), m = P V/(R T) with T estimated, has to match the flow by ISO 6358:
//!
//! ```text
//! m(t) - m(0) = C W(t) - C d w(t)        w: flow per conductance, W: its integral since the pin rose
//! m(end) - m(start) = C sum w o(pulse)   o: open time of a pulse, pulse^2/t_s below t_s
//! ```
//!
//! The first gives C and the delay d: dead time, half of the switching time, and the lag of the pressure sensor. The
//! second gives the switching time t_s, from whole ramps of short pulses.

use super::experiment::{Plan, Record, during};
use super::regression::{Measure, least_squares};
use model_core::config::Config;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::physics::gas::Reservoir;
use model_core::physics::valve::Valve;

/// Time after the edge of the pin after which the poppet is certainly open \[s\].
const OPEN_S: f64 = 0.008;
/// Longest delay of the search \[s\]: a longer one would be confused with a falling supply.
const DELAY_UNTIL_S: f64 = 0.025;
/// Least time for which a step has to keep its valve open \[s\].
const LEAST_OPEN_S: f64 = 0.03;
/// Least fraction of the pulses' length lost in switching at which a ramp determines the switching time \[-\].
const LEAST_LOSS: f64 = 0.05;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    In,
    Out,
}

impl Direction {
    fn share(self, record: &Record) -> f64 {
        match self {
            Self::In => record.inlet,
            Self::Out => record.outlet,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Sonic conductance, with tube and regulator \[m3/(s Pa)\].
    pub conductance: Measure,
    /// Delay from the pin to half of the opening, as the pressure sensor senses it \[s\].
    pub delay_s: Measure,
}

/// Gas in the muscle and flow through the valves, step by step.
#[derive(Debug, Clone, Copy)]
pub struct Gas<'a> {
    config: &'a Config,
    chamber: &'a AnyChamber,
}

impl<'a> Gas<'a> {
    /// Gas of a chamber; `chamber` has the tuned values.
    pub fn new(config: &'a Config, chamber: &'a AnyChamber) -> Self {
        Self { config, chamber }
    }

    fn mass_kg(&self, record: &Record) -> f64 {
        let volume_m3 = f64::from(self.chamber.volume_m3(record.length_m as f32));
        let gas_constant = f64::from(self.config.gas.gas_constant_j_kg_k);
        record.pressure_pa * volume_m3 / (gas_constant * record.gas_k)
    }

    /// Flow of the open valve per conductance, positive into the muscle.
    fn unit_flow(&self, record: &Record, direction: Direction) -> f64 {
        let Config { gas, supply, ambient, valve, .. } = self.config;
        let muscle = Reservoir {
            pressure_pa: record.pressure_pa as f32,
            temperature_k: record.gas_k as f32,
        };
        let (up, down, sign) = match direction {
            Direction::In => (Reservoir::from(*supply), muscle, 1.0),
            Direction::Out => (muscle, (*ambient).into(), -1.0),
        };
        let unit = Valve { conductance_m3_s_pa: 1.0, ..*valve };
        let flow = unit.mass_flow_kg_s(gas, up, down.pressure_pa);
        sign * f64::from(flow)
    }

    /// Conductance and delay of the valve of this direction; none if no step kept it open.
    pub fn steps(&self, records: &[Record], plan: &Plan, direction: Direction) -> Option<Steps> {
        let records = during(records, &plan.steps_s);
        let step_s = f64::from(self.config.step_s);
        let open = |record: &Record| direction.share(record) >= 1.0;
        let mut rows = Vec::new();
        for stretch in records.chunk_by(|a, b| open(a) == open(b)) {
            if !open(&stretch[0]) || stretch.len() as f64 * step_s < LEAST_OPEN_S {
                continue;
            }
            let start_kg = self.mass_kg(&stretch[0]);
            let mut through = 0.0;
            let mut before = self.unit_flow(&stretch[0], direction);
            for record in &stretch[1..] {
                let flow = self.unit_flow(record, direction);
                through += 0.5 * (before + flow) * step_s;
                before = flow;
                let since_s = record.time_s - stretch[0].time_s;
                if since_s >= OPEN_S {
                    rows.push((since_s, ([through, -flow], self.mass_kg(record) - start_kg)));
                }
            }
        }
        let all: Vec<_> = rows.iter().map(|row| row.1).collect();
        let early: Vec<_> =
            rows.iter().filter(|row| row.0 <= DELAY_UNTIL_S).map(|row| row.1).collect();
        Some(Steps {
            conductance: least_squares(&all)?.measure(|c| c[0]),
            delay_s: least_squares(&early)?.measure(|c| c[1] / c[0]),
        })
    }

    /// Switching time, from the ramps with short enough pulses; none if there are too few. `conductances` are those of
    /// inlet and outlet.
    pub fn switch_time_s(
        &self,
        records: &[Record],
        plan: &Plan,
        conductances: [f64; 2],
    ) -> Option<Measure> {
        let period_steps = usize::from(self.config.pwm_period_steps);
        let period_s = f64::from(self.config.pwm_period_steps) * f64::from(self.config.step_s);
        let found: Vec<f64> = plan
            .ramps
            .iter()
            .filter_map(|ramp| {
                let records = during(records, &ramp.time_s);
                let (direction, conductance) = if ramp.rises {
                    (Direction::In, conductances[0])
                } else {
                    (Direction::Out, conductances[1])
                };
                // Openings are set at the start of a period, which the core counts from its first
                // step.
                let pulses: Vec<(f64, f64)> = records
                    .iter()
                    .filter(|record| (record.step as usize).is_multiple_of(period_steps))
                    .map(|record| {
                        let share = direction.share(record);
                        (share * period_s, self.unit_flow(record, direction) * conductance)
                    })
                    .collect();
                let (first, last) = (records.first()?, records.last()?);
                switching_s(&pulses, self.mass_kg(last) - self.mass_kg(first), period_s)
            })
            .collect();
        scatter(&found)
    }
}

/// Switching time \[s\] with which the pulses (length, flow) move this mass.
fn switching_s(pulses: &[(f64, f64)], change_kg: f64, period_s: f64) -> Option<f64> {
    let moved_kg = |switch_s: f64| -> f64 {
        let opening = |pulse_s: f64| {
            if pulse_s < switch_s { pulse_s * pulse_s / switch_s } else { pulse_s }
        };
        pulses.iter().map(|(pulse_s, flow)| flow * opening(*pulse_s)).sum::<f64>().abs()
    };
    // Long pulses lose nothing, at any switching time.
    if change_kg.abs() > (1.0 - LEAST_LOSS) * moved_kg(0.0) {
        return None;
    }
    let (mut low_s, mut high_s) = (0.0, 0.5 * period_s);
    if moved_kg(high_s) > change_kg.abs() {
        return None;
    }
    for _ in 0..40 {
        let middle_s = 0.5 * (low_s + high_s);
        if moved_kg(middle_s) > change_kg.abs() {
            low_s = middle_s;
        } else {
            high_s = middle_s;
        }
    }
    Some(low_s)
}

/// Mean of repeated values, and its standard error from their scatter; at least three are needed.
fn scatter(values: &[f64]) -> Option<Measure> {
    let count = values.len() as f64;
    if values.len() < 3 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / count;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Some(Measure { value: mean, error: (square / (count - 1.0) / count).sqrt() })
}
