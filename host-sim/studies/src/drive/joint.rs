//! A run of a joint on a board that samples its own muscles and angle.

use super::record::{Counted, Record};
use super::summary::{board_at, driven};
use super::{Course, end_s};
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry};
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use thermyo_boards::live_joint::LiveJoint;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::read_table;
use thermyo_joint::page::PageRecorder;
use thermyo_joint::trace::record;
use thermyo_joint::{Accumulator, Figures, JointLoaded, Row, angle_and_stiffness, to_scenario};
use thermyo_logs::topics::{self, Layout};
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_record::summary::TimingFigures;
use thermyo_simulation::run::set_point_interval_steps;

/// Scenario to drive: the drive of a file, on the joint in the board's configuration.
///
/// # Errors
/// [`InputError`] for a file that is neither a joint's scenario nor a table of angle and stiffness, and for an angle
/// beyond the configured stops.
pub fn plan(file: &Path, config: &JointConfig) -> Result<JointLoaded, InputError> {
    let mut driven = to_scenario(config)?;
    let duration_s;
    if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        let table = read_table(file)?;
        let [angle, stiffness] = angle_and_stiffness(&table, &driven.believed)?;
        duration_s = end_s(&table, &angle, driven.muscles[0].plant.run.step_s)?;
        driven.profile = Some([angle, stiffness]);
    } else {
        let Some(loaded) = thermyo_joint::load(file)? else {
            let why = "has no [joint], and the board drives one: give a joint's scenario, or a CSV with time_s, \
                       angle_rad and stiffness_n_m_rad";
            return Err(InputError::file(file, Problem::Unusable(why.to_owned())));
        };
        if let Some((_, problem)) = loaded.beyond(&driven.believed) {
            return Err(InputError::file(file, problem));
        }
        duration_s = loaded.muscles[0].plant.run.duration_s;
        (driven.drive, driven.profile) = (loaded.drive, loaded.profile);
        // A board's load is the real one.
        (driven.drive.load_n_m, driven.drive.load_csv) = (0.0, None);
    }
    driven.drive.profile_csv = driven.profile.as_ref().map(|_| PathBuf::from("profile.csv"));
    for muscle in &mut driven.muscles {
        for scenario in [&mut muscle.plant, &mut muscle.believed] {
            (scenario.run.duration_s, scenario.run.log_every) = (duration_s, 1);
        }
    }
    Ok(driven)
}

impl Course<JointSetPoint> for JointLoaded {
    fn steps(&self) -> u64 {
        self.muscles[0].plant.run.steps()
    }

    fn ambient_pa(&self) -> f32 {
        self.muscles[0].believed.ambient.pressure_pa as f32
    }

    fn first(&self) -> JointSetPoint {
        JointSetPoint::Angle(self.motion(0.0))
    }

    fn acting_from(&self, step: u64) -> Option<JointSetPoint> {
        let step_s = self.muscles[0].plant.run.step_s;
        let every = set_point_interval_steps(step_s);
        if step == 0 || !step.is_multiple_of(every) {
            return None;
        }
        let [before, now] = [step - every, step].map(|step| self.motion(step as f64 * step_s));
        (now != before).then_some(JointSetPoint::Angle(now))
    }
}

/// Content of `summary.json` of a joint's run on a board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Driven {
    pub duration_s: f64,
    /// Planned time, if the run was stopped early \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped_of_s: Option<f64>,
    /// The board's port.
    pub board: String,
    pub config_name: String,
    pub config_checksum: u32,
    #[serde(flatten)]
    pub figures: Figures,
    /// Steps whose telemetry did not arrive.
    pub lost_steps: u64,
    /// Timing of the steps since the board started.
    pub timing: TimingFigures,
}

impl Driven {
    /// The sentence above the page.
    fn lead(&self) -> String {
        let stopped = if self.stopped_of_s.is_some() { "Stopped by Ctrl-C: " } else { "" };
        self.figures.lead(&format!(
            "{stopped}{} on {}, configuration {} ({:08x}).",
            driven(self.duration_s, self.stopped_of_s),
            board_at(&self.board),
            self.config_name,
            self.config_checksum,
        ))
    }
}

/// Collects summary and page step by step.
pub struct Gathered {
    accumulator: Accumulator,
    drawn: PageRecorder,
    driven: JointLoaded,
    steps: Counted,
}

impl Gathered {
    /// Starts a run at step 0.
    pub fn new(driven: JointLoaded) -> Self {
        Self {
            accumulator: Accumulator::new(&driven),
            drawn: PageRecorder::default(),
            driven,
            steps: Counted::from_start(),
        }
    }
}

impl Record for Gathered {
    type Board = LiveJoint;
    type Row = Row;
    type Driven = Driven;

    const LAYOUT: Layout = topics::JOINT;
    const STUDIED: bool = false;

    fn of_board(config: &JointConfig) -> Result<Self, InputError> {
        Ok(Self { steps: Counted::default(), ..Self::new(to_scenario(config)?) })
    }

    fn write(
        recorder: &mut Recorder,
        config: &JointConfig,
        status: Option<&Status>,
        telemetry: &JointTelemetry,
    ) -> io::Result<Row> {
        record(recorder, config, status, telemetry)
    }

    fn add(&mut self, row: &Row) {
        self.steps.add(row.telemetry.step(), row.time_s);
        self.accumulator.add(row);
        self.drawn.add(row);
    }

    fn steps(&self) -> &Counted {
        &self.steps
    }

    fn scenario(&self) -> String {
        thermyo_joint::render(&self.driven)
    }

    fn cut(&mut self) {
        for muscle in &mut self.driven.muscles {
            let run = &mut muscle.plant.run;
            run.duration_s = self.steps.last_s.max(run.step_s);
            muscle.believed.run = run.clone();
        }
    }

    fn finish(
        self,
        title: &str,
        (port, status, timing): (&str, &Status, &Timing),
        stopped_of_s: Option<f64>,
    ) -> (Driven, String) {
        let summary = Driven {
            duration_s: self.steps.last_s,
            stopped_of_s,
            board: port.to_owned(),
            config_name: status.config_name.as_str().to_owned(),
            config_checksum: status.config_checksum,
            figures: self.accumulator.figures(),
            lost_steps: self.steps.lost,
            timing: TimingFigures::from(timing),
        };
        let page = self.drawn.of_board(title, &self.driven, &summary.lead(), &summary.figures);
        (summary, page)
    }
}
