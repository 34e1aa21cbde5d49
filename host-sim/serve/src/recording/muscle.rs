//! The record of one muscle.

use super::record::{Finished, Record};
use model_core::{Config, Telemetry};
use std::io;
use thermyo_boards::live::LiveBoard;
use thermyo_files::input::InputError;
use thermyo_logs::topics::{self, Layout};
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_scenario::DriveKind;
use thermyo_setup::{Loaded, from_config};
use thermyo_studies::drive::{self, Drawn, Gathered};

pub struct MuscleRecord {
    config: Config,
    configured: Loaded,
    gathered: Gathered,
    drawn: Drawn,
}

impl Record for MuscleRecord {
    type Board = LiveBoard;

    const TRACE: &'static str = "trace.csv";
    const LAYOUT: Layout = topics::MUSCLE;
    const STUDIED: bool = true;

    fn new(config: &Config) -> Result<Self, InputError> {
        let mut configured = from_config::to_scenario(config)?.scenario;
        // The user drives the muscle.
        (configured.plant.drive.kind, configured.believed.drive.kind) =
            (DriveKind::Closed, DriveKind::Closed);
        let gathered = Gathered::of_record(&configured);
        Ok(Self { config: *config, configured, gathered, drawn: Drawn::default() })
    }

    fn scenario(&self) -> String {
        thermyo_setup::render(&self.configured)
    }

    fn write(
        &mut self,
        recorder: &mut Recorder,
        status: Option<&Status>,
        telemetry: &Telemetry,
    ) -> io::Result<()> {
        let row = recorder.write(&self.config, status, telemetry)?;
        self.gathered.add(&row);
        self.drawn.add(&row);
        Ok(())
    }

    fn finish(self, (name, port): (&str, &str), status: &Status, timing: &Timing) -> Finished {
        let Self { mut configured, gathered, drawn, .. } = self;
        let summary = gathered.finish(port, status, timing);
        configured.plant.run.duration_s = summary.duration_s.max(configured.plant.run.step_s);
        configured.believed.run = configured.plant.run.clone();
        Finished {
            duration_s: summary.duration_s,
            lost_steps: summary.lost_steps,
            scenario: thermyo_setup::render(&configured),
            summary: serde_json::to_string_pretty(&summary).expect("plain data") + "\n",
            report: drive::page(name, &configured, &drawn, &summary),
        }
    }
}
