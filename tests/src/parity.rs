//! A muscle in closed loop with a board for ten thousand steps, and the same samples once more
//! through the core in this process: equal to the bit.

use crate::rig::Muscle;
use model_core::{AdcCode, Config, Faults, Sample, SetPoint};
use std::collections::BTreeSet;
use thermyo_runs::replay::{Row, replay};
use thermyo_simulation::board::{Board, BoardStep, CoreBoard};

pub const STEPS: u32 = 10_000;

/// Step from which the second set point holds.
const SECOND: u32 = 5000;
const CYCLE: SetPoint = SetPoint::MassFlowCycle { flow_kg_s: 3.6e-4, period_s: 2.0 };
const PRESSURE: SetPoint = SetPoint::Pressure { pressure_pa: 3.0e5 };

/// Makes two sensors fail for a while, and opens the emergency stop once.
fn with_faults(step: u32, sample: Sample) -> Sample {
    let gas = if (3000..3200).contains(&step) { AdcCode(0).into() } else { sample.gas };
    let length = if (4000..4200).contains(&step) { AdcCode(32_760) } else { sample.length };
    Sample { gas, length, emergency_stop: step == 8000, ..sample }
}

/// Steps that a board has computed.
#[derive(Debug)]
pub struct Record {
    pub config: Config,
    pub rows: Vec<Row>,
}

/// Runs the muscle at a board; `look` is called after every step.
pub fn run<B: Board>(board: &mut B, mut look: impl FnMut(&B, &BoardStep)) -> Record {
    let mut muscle = Muscle::new("[plant]\nmodel = \"lumped\"\n[load]\nforce_n = 120.0\n");
    let config = *muscle.config();
    board.start(&config, CYCLE).expect("the board starts");
    let (mut rows, mut fed) = (Vec::new(), Vec::new());
    // The last sample's telemetry may come two steps later: it waits for a status, and each frame
    // takes most of a step.
    for step in 0..=STEPS + 1 {
        if step == SECOND {
            board.set(PRESSURE).expect("the set point is taken");
        }
        fed.push(with_faults(step, muscle.sample()));
        let outcome = board.step(&fed[step as usize]).expect("the board goes on");
        muscle.advance(outcome.actuation);
        look(board, &outcome);
        let Some(telemetry) = outcome.telemetry else { continue };
        // The board's conversions add up to the input code.
        let sample = Sample { heard: telemetry.sample.heard, ..fed[telemetry.step as usize] };
        assert_eq!(telemetry.sample, sample, "step {}", telemetry.step);
        // The set point arrives with the step: it holds from the next one on.
        let set_point = match telemetry.step {
            0 => Some(CYCLE),
            _ if telemetry.step == SECOND + 1 => Some(PRESSURE),
            _ => None,
        };
        rows.push(Row { set_point, telemetry });
    }
    rows.truncate(STEPS as usize);
    assert_eq!(rows.len(), STEPS as usize);
    assert!(rows.iter().zip(0..).all(|(row, step)| row.telemetry.step == step));
    Record { config, rows }
}

impl Record {
    /// Replays the samples on the core in this process.
    pub fn assert_same_on_the_host(&self) {
        let outcome = replay(&mut CoreBoard::default(), &self.config, &self.rows, &mut |_, _| true)
            .expect("the core takes what the board took");
        assert_eq!((outcome.steps, outcome.mismatches), (u64::from(STEPS), 0), "{outcome:?}");
        // Both valves moved, and the emergency stop vented.
        let commands: BTreeSet<_> = self
            .rows
            .iter()
            .map(|row| (row.telemetry.command.inlet, row.telemetry.command.outlet))
            .collect();
        assert!(commands.len() > 50, "{} commands", commands.len());
        assert!(self.rows[9000].telemetry.faults.intersects(Faults::EMERGENCY_STOP));
    }
}
