//! A board with a joint of its own.

use super::experiment::{Bench, BenchError, Course, INTERVAL_S};
use crate::drive::{LEAD_STEPS, Venting};
use model_core::joint::{JointConfig, JointMode, JointSetPoint, JointTelemetry};
use thermyo_boards::live::VIEW_DIVIDER;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_joint::JointLoaded;
use thermyo_protocol::joint_checksum;
use thermyo_simulation::board::BoardError;

/// The board, armed for each run up to a pressure, a little above which it vents.
pub struct LiveBench<'a> {
    board: &'a mut LiveJoint,
    name: &'a str,
    highest_pa: f64,
    /// Returns whether the user wants to stop.
    stopped: &'a dyn Fn() -> bool,
}

impl<'a> LiveBench<'a> {
    /// `name` is the name of the configurations that the board gets.
    pub fn new(
        board: &'a mut LiveJoint,
        name: &'a str,
        highest_pa: f64,
        stopped: &'a dyn Fn() -> bool,
    ) -> Self {
        Self { board, name, highest_pa, stopped }
    }

    /// The next telemetry, without a fault that vents.
    fn next(&mut self) -> Result<Option<JointTelemetry>, BenchError> {
        if (self.stopped)() {
            return Err(BenchError::Stopped);
        }
        let Some(telemetry) = self.board.poll()? else { return Ok(None) };
        match thermyo_joint::venting(&telemetry) {
            Some(faults) => Err(BenchError::Vented(faults)),
            None => Ok(Some(telemetry)),
        }
    }

    /// Waits until its startup check is over and both muscles have vented.
    fn vented(&mut self, config: &JointConfig) -> Result<(), BenchError> {
        let mut venting = config.muscles.map(|muscle| Venting::new(muscle.ambient.pressure_pa));
        loop {
            let Some(telemetry) = self.next()? else { continue };
            let ([a, b], [of_a, of_b]) = (&telemetry.muscles, &mut venting);
            let over = of_a.is_over(a.pressure_pa, a.step) & of_b.is_over(b.pressure_pa, b.step);
            if over && telemetry.mode != JointMode::StartupCheck {
                return Ok(());
            }
        }
    }

    fn along(
        &mut self,
        step_s: f64,
        (course, duration_s): (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError> {
        let steps = (duration_s / step_s).round() as u32;
        let every = (INTERVAL_S / step_s).round().max(1.0) as u32;
        let lead = LEAD_STEPS as u32;
        let set_point = |step: u32| JointSetPoint::Angle(course(f64::from(step) * step_s));
        let first = self.board.set(set_point(0))?;
        let (mut next, mut asked) = (every, None);
        loop {
            let Some(telemetry) = self.next()? else { continue };
            // Telemetry from before the first set point is skipped.
            let Some(step) = telemetry.muscles[0].step.checked_sub(first) else { continue };
            each(step, &telemetry);
            if step >= steps {
                return Ok(());
            }
            if let Some(sequence) = asked.take() {
                self.board.check(sequence)?;
            }
            // After a delay only the present set point is sent: all that were missed would flood the board.
            let ahead = step + lead;
            if ahead >= next && !self.board.is_behind() {
                let now = ahead - ahead % every;
                asked = Some(self.board.send(set_point(now))?);
                next = now + every;
            }
        }
    }
}

impl Bench for LiveBench<'_> {
    fn drive(
        &mut self,
        loaded: &JointLoaded,
        course: (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError> {
        let config = loaded.config();
        self.board.stop()?;
        self.board.configure(&config, self.name)?;
        self.vented(&config)?;
        let most_pa = config.muscles.map(|muscle| muscle.working_limit_pa());
        let most_pa = most_pa.into_iter().fold(self.highest_pa as f32, f32::min);
        self.board.arm(Some(most_pa))?;
        self.board.telemetry_every(1)?;
        let outcome = self.along(f64::from(config.muscles[0].step_s), course, each);
        // A lost link is reported only once.
        let stopped = self.board.stop().and_then(|()| self.board.telemetry_every(VIEW_DIVIDER));
        outcome.and_then(|()| Ok(stopped?))
    }

    fn leave(&mut self, config: &JointConfig) -> Result<(), BoardError> {
        self.board.stop()?;
        if self.board.status()?.config_checksum != joint_checksum(config) {
            self.board.configure(config, self.name)?;
        }
        Ok(())
    }
}
