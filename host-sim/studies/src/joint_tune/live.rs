//! A board with a real joint.

use super::experiment::{Bench, BenchError, Course};
use crate::drive::{self, DriveError, Ended, LiveBench, follow};
use crate::tune::Left;
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry};
use thermyo_boards::live_joint::LiveJoint;
use thermyo_joint::JointLoaded;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::set_point_interval_steps;

/// A course over the steps of a board.
struct Stepped<'a> {
    course: Course<'a>,
    ambient_pa: f32,
    step_s: f64,
    steps: u64,
}

impl Stepped<'_> {
    fn at(&self, step: u64) -> JointSetPoint {
        JointSetPoint::Angle((self.course)(step as f64 * self.step_s))
    }
}

impl drive::Course<JointSetPoint> for Stepped<'_> {
    fn steps(&self) -> u64 {
        self.steps
    }

    fn ambient_pa(&self) -> f32 {
        self.ambient_pa
    }

    fn first(&self) -> JointSetPoint {
        self.at(0)
    }

    fn acting_from(&self, step: u64) -> Option<JointSetPoint> {
        step.is_multiple_of(set_point_interval_steps(self.step_s)).then(|| self.at(step))
    }
}

impl Bench for LiveBench<'_, LiveJoint> {
    fn drive(
        &mut self,
        loaded: &JointLoaded,
        (course, duration_s): (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError> {
        let config = loaded.config();
        let [a_pa, b_pa] = config.muscles.map(|muscle| muscle.working_limit_pa());
        self.prepare(&config, a_pa.min(b_pa))?;
        let [a, _] = &config.muscles;
        let step_s = f64::from(a.step_s);
        let steps = (duration_s / step_s).round() as u64;
        let stepped = Stepped { course, ambient_pa: a.ambient.pressure_pa, step_s, steps };
        let mut vented = None;
        let mut passed = |telemetry: &JointTelemetry, _: Option<&_>| {
            vented = thermyo_joint::venting(telemetry);
            if vented.is_none() {
                each(telemetry.step(), telemetry);
            }
            Ok(())
        };
        let outcome = follow(self.board, &stepped, self.wanted, &mut passed);
        match (vented, outcome) {
            (Some(faults), _) => Err(BenchError::Vented(faults)),
            (None, Ok(Ended::Whole)) => Ok(()),
            (None, Ok(Ended::Stopped)) => Err(BenchError::Stopped),
            (None, Err(DriveError::Board(error))) => Err(error.into()),
            (None, Err(DriveError::Output(_))) => Err(BoardError::Interrupted.into()),
        }
    }

    fn leave(&mut self, left: Left<'_, JointConfig>) -> Result<(), BoardError> {
        self.vent_with(left)
    }
}
