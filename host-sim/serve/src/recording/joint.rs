//! The record of a joint.

use super::record::{Finished, Record};
use model_core::joint::{JointConfig, JointTelemetry};
use std::io;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_files::input::InputError;
use thermyo_joint::{JointLoaded, to_scenario, trace};
use thermyo_logs::topics::{self, Layout};
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_studies::drive::joint::Gathered;

pub struct JointRecord {
    config: JointConfig,
    configured: JointLoaded,
    gathered: Gathered,
}

impl Record for JointRecord {
    type Board = LiveJoint;

    const TRACE: &'static str = trace::FILE;
    const LAYOUT: Layout = topics::JOINT;
    const STUDIED: bool = false;

    fn new(config: &JointConfig) -> Result<Self, InputError> {
        let configured = to_scenario(config)?;
        let gathered = Gathered::of_record(&configured);
        Ok(Self { config: *config, configured, gathered })
    }

    fn scenario(&self) -> String {
        thermyo_joint::render(&self.configured)
    }

    fn write(
        &mut self,
        recorder: &mut Recorder,
        status: Option<&Status>,
        telemetry: &JointTelemetry,
    ) -> io::Result<()> {
        let row = trace::record(recorder, &self.config, status, telemetry)?;
        self.gathered.add(&row);
        Ok(())
    }

    fn finish(self, (name, port): (&str, &str), status: &Status, timing: &Timing) -> Finished {
        let Self { mut configured, gathered, .. } = self;
        let duration_s = gathered.duration_s();
        for muscle in &mut configured.muscles {
            muscle.plant.run.duration_s = duration_s.max(muscle.plant.run.step_s);
            muscle.believed.run = muscle.plant.run.clone();
        }
        let (summary, report) = gathered.finish((name, &configured), (port, status, timing), None);
        Finished {
            duration_s: summary.duration_s,
            lost_steps: summary.lost_steps,
            scenario: thermyo_joint::render(&configured),
            summary: serde_json::to_string_pretty(&summary).expect("plain data") + "\n",
            report,
        }
    }
}
