//! The page of one muscle: calibration, tuning, stops, identification and comparison, in addition
//! to the common parts.

use super::served::{Held, Served, Tasks};
use super::tuning;
use super::{NO_LINK, NotDone, Operator, RECORDS};
use crate::frames::{Shown, rounded};
use crate::guide::{Calibration, Guided, Step};
use crate::page::Kind;
use crate::results::{Outcome, next_folder};
use crate::shared::Shared;
use crate::sought::{self, Sought};
use crate::state::{self, Braid, Guide, Part, Weight};
use crate::study::{Content, Fit, Study};
use crate::target::Target;
use crate::word::{Order, ScenarioText, Source};
use model_core::control::contractions;
use model_core::physics::chamber::{AnyChamber, ChamberConfig};
use model_core::{Config, Faults, SetPoint, Telemetry};
use serde::Serialize;
use std::path::Path;
use std::slice;
use std::sync::Arc;
use std::time::Instant;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_plant::chamber;
use thermyo_protocol::{ConfigSource, Refusal};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::calibrate;
use thermyo_studies::drive::{Gathered, LiveBench};
use thermyo_studies::stops;
use thermyo_studies::stops::{Asked, LiveRows, Plan, Record, RowBench};
use thermyo_studies::tune;
use thermyo_studies::tune::{TuneError, Tuned};

/// Steps between two samples that a calibration averages: 100 per second.
const CALIBRATION_STEPS: u32 = 10;

const ONE_STUDY: NotDone =
    NotDone::NotNow("an identification or a comparison goes on: wait for it, or cancel it");
const NO_SOURCE: NotDone =
    NotDone::NotNow("that record is no longer here: the last four files are kept; choose it again");
const NO_FIT: NotDone = NotDone::NotNow("there are no identified values to apply");
const OTHER_CONFIG: NotDone = NotDone::NotNow(
    "the board has another configuration than the identification began with: identify again",
);
const DRIVEN: NotDone =
    NotDone::NotNow("the muscle is driven, and new values would vent it: vent first");

/// A guided task, a tuning's progress, and an identification or comparison.
#[derive(Default)]
pub struct MuscleTasks {
    guided: Option<Guided>,
    tuning: Option<Guide>,
    study: Study,
}

impl Tasks for MuscleTasks {
    fn vented(&mut self) {
        self.guided = self.guided.take().filter(|guided| matches!(guided, Guided::Over(_)));
    }

    fn went_back(&mut self) {
        self.guided = None;
        if !self.study.works() {
            self.study.close();
        }
    }

    fn end(&mut self) {
        self.study.close();
    }

    fn shown(&mut self, shared: &Shared) -> (Option<Guide>, Option<state::Study>) {
        self.study.poll(shared);
        let guide = self.guided.as_ref().map(Guided::state);
        (self.tuning.clone().or(guide), self.study.state())
    }
}

/// One step. The page gets an array in this order: `of_muscle.js` has the names.
#[derive(Debug, Serialize)]
pub struct Row(f64, f32, f32, f32, f32, f32, f32, f32, f32, Option<f32>, Option<f32>);

impl Shown for LiveBoard {
    type Row = Row;
    type Valid = bool;

    fn muscles(config: &Config) -> &[Config] {
        slice::from_ref(config)
    }

    fn mode(telemetry: &Telemetry) -> &'static str {
        telemetry.mode.name()
    }

    fn is_limited(telemetry: &Telemetry) -> bool {
        telemetry.limited
    }

    fn valid(telemetry: &Telemetry) -> bool {
        telemetry.estimate.valid
    }

    fn row(time_s: f64, config: &Config, telemetry: &Telemetry) -> Row {
        let Telemetry { pressure_pa, length_m, estimate, command, set_point, sample, .. } =
            telemetry;
        let [mut pressure_set_pa, mut contraction_set] = [None; 2];
        match set_point {
            SetPoint::Pressure { pressure_pa } => pressure_set_pa = Some(*pressure_pa),
            SetPoint::Contraction { contraction } => contraction_set = Some(*contraction),
            _ => (),
        }
        Row(
            rounded(time_s),
            *pressure_pa,
            *length_m,
            config.sensing().gas_k(sample.gas),
            estimate.gas_k,
            estimate.gas_sd_k,
            estimate.wall_k,
            command.inlet.share(),
            command.outlet.share(),
            pressure_set_pa,
            contraction_set,
        )
    }
}

impl Served for LiveBoard {
    type Tasks = MuscleTasks;
    type Record = Gathered;

    const KIND: Kind = Kind::Muscle;
    const VENTS: &'static str = "the muscle vents";

    fn part(config: &Config) -> Part {
        let scenario = from_config::to_scenario(config).ok();
        let chamber = scenario.and_then(|scenario| chamber::of(&scenario.scenario.believed));
        let braid = match &config.chamber {
            ChamberConfig::Muscle(muscle) => Some(Braid {
                thread_length_m: muscle.braid.thread_length_m,
                turns: muscle.braid.turns,
            }),
            _ => None,
        };
        Part::Muscle {
            contractions: contractions(config, &AnyChamber::new(&config.chamber)),
            rest_length_m: chamber.map(|chamber| chamber.rest_length()),
            braid,
            offers: sought::offers(config),
        }
    }

    fn configuration(
        target: &Target,
        text: Option<ScenarioText>,
    ) -> Result<(Config, String), NotDone> {
        let (loaded, name) = match text {
            Some(text) => {
                let loaded = thermyo_setup::parse_alone(&text.text, Path::new(&text.name))?;
                (loaded, text.stem())
            }
            None => {
                let unknown = NotDone::NotNow("no scenario is selected for this port: choose one");
                (target.muscle()?.ok_or(unknown)?, target.muscle_name())
            }
        };
        Ok((core_config(&loaded.believed), name))
    }

    fn own(target: &Target) -> Option<String> {
        (!matches!(target, Target::Port(_))).then(|| target.muscle_name())
    }

    fn asked(order: &Order) -> Option<SetPoint> {
        match order {
            Order::Set(set_point) => Some(*set_point),
            _ => None,
        }
    }

    fn words(set_point: SetPoint) -> String {
        asked_for(set_point)
    }

    fn faults(telemetry: &Telemetry) -> Held {
        [telemetry.faults, Faults::NONE, Faults::NONE]
    }

    fn names([faults, ..]: Held) -> Vec<String> {
        faults.names().map(str::to_owned).collect()
    }

    fn attempt(
        operator: &mut Operator<Self>,
        order: Order,
        wanted: &dyn Fn() -> bool,
    ) -> Result<(), NotDone> {
        operator.attempt_task(order, wanted)
    }

    fn see(operator: &mut Operator<Self>, telemetry: &Telemetry) {
        if telemetry.step.is_multiple_of(CALIBRATION_STEPS) {
            operator.calibrate(telemetry);
        }
    }
}

impl Operator<LiveBoard> {
    fn calibrate(&mut self, telemetry: &Telemetry) {
        let Some(Guided::Calibration(calibration)) = &mut self.tasks.guided else { return };
        let vents = calibrate::vents(telemetry.mode);
        let Step::Calibrated(config, [first, second]) = calibration.see(&telemetry.sample, vents)
        else {
            return;
        };
        let name = self.known.status.config_name;
        let configured = match self.board.as_mut() {
            Some(board) => board.configure(&config, name.as_str()).map_err(NotDone::from),
            None => Err(NO_LINK),
        };
        let calibrated = configured.is_ok();
        let text = match configured {
            Ok(_) => format!(
                "Put right by {first} and {second}. The board has it, and vents; it is not saved."
            ),
            Err(error) => format!("Not calibrated: {error}."),
        };
        if let Some(Guided::Calibration(calibration)) = &self.tasks.guided {
            self.tasks.guided = Some(calibration.outcome(&text, calibrated));
        }
        if calibrated {
            self.remember();
        }
        self.shown = None;
    }

    fn attempt_task(&mut self, order: Order, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        match order {
            Order::Leave => self.tasks.guided = None,
            Order::Reference(text) => {
                if let Some(Guided::Calibration(calibration)) = &mut self.tasks.guided {
                    calibration.answer(&text);
                }
            }
            Order::Identify { data, sought, keys } => {
                let begun = self.identify(data, sought, &keys);
                self.said("Identification", begun)?;
            }
            Order::Compare(records) => {
                let begun = self.compare(records);
                self.said("Comparison", begun)?;
            }
            Order::Apply => {
                let applied = self.apply();
                self.said("Identification", applied)?;
            }
            Order::Close => self.tasks.study.close(),
            Order::Tune { most_pa } => self.tune(most_pa, wanted)?,
            Order::Stops { most_pa } => self.measure_stops(most_pa, wanted)?,
            Order::Calibrate(sensor) => {
                self.linked()?;
                self.records_nothing()?;
                self.is_configured()?;
                let calibration = Calibration::new(sensor, self.known.config);
                self.tasks.guided = Some(Guided::Calibration(Box::new(calibration)));
            }
            _ => return Err(BoardError::Refused(Refusal::OtherImage { joint: false }).into()),
        }
        Ok(())
    }

    fn records_nothing(&self) -> Result<(), NotDone> {
        if self.recording.is_some() { Err(RECORDS) } else { Ok(()) }
    }

    fn is_configured(&self) -> Result<(), NotDone> {
        match self.known.status.config_source {
            ConfigSource::Defaults => Err(BoardError::Refused(Refusal::NotConfigured).into()),
            _ => Ok(()),
        }
    }

    /// Lends the board to work that reads its telemetry itself.
    fn lend<T>(&mut self, work: impl FnOnce(&mut Self, &mut LiveBoard) -> T) -> Result<T, NotDone> {
        let mut board = self.board.take().ok_or(NO_LINK)?;
        let done = work(self, &mut board);
        self.tasks.tuning = None;
        self.board = Some(board);
        self.heard = Instant::now();
        Ok(done)
    }

    /// Shows a refusal in the place of the study.
    fn said(&mut self, title: &str, done: Result<(), NotDone>) -> Result<(), NotDone> {
        if let Err(error) = &done {
            self.tasks.study.refused(title, error.to_string());
        }
        done
    }

    fn identify(&mut self, data: Source, sought: Sought, keys: &[String]) -> Result<(), NotDone> {
        if self.tasks.study.works() {
            return Err(ONE_STUDY);
        }
        self.is_configured()?;
        self.tasks.study.close();
        let data = Content::of(data, &self.shared).ok_or(NO_SOURCE)?;
        self.tasks.study.identify(self.known.config, (sought, keys), data, &self.out)?;
        self.shared.log(Weight::Plain, "identification begins");
        Ok(())
    }

    fn compare(&mut self, records: [Source; 2]) -> Result<(), NotDone> {
        if self.tasks.study.works() {
            return Err(ONE_STUDY);
        }
        self.tasks.study.close();
        let [first, second] = records.map(|source| Content::of(source, &self.shared));
        self.tasks.study.compare([first.ok_or(NO_SOURCE)?, second.ok_or(NO_SOURCE)?], &self.out);
        Ok(())
    }

    /// Sends the identified values to the board.
    fn apply(&mut self) -> Result<(), NotDone> {
        let Fit { before, after } = self.tasks.study.fit().cloned().ok_or(NO_FIT)?;
        self.records_nothing()?;
        if self.set_point != Some(SetPoint::Vent) {
            return Err(DRIVEN);
        }
        if before != self.known.config {
            return Err(OTHER_CONFIG);
        }
        let name = self.known.status.config_name;
        self.linked()?.configure(&after, name.as_str())?;
        self.remember();
        self.tasks.study.applied();
        self.shared.log(Weight::Plain, "the board has the identified values, and vents");
        Ok(())
    }

    fn tune(&mut self, most_pa: f64, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        self.records_nothing()?;
        self.is_configured()?;
        let most_pa = tune::highest_pa(&self.known.config, Some(most_pa))?;
        let known = from_config::to_scenario(&self.known.config)?.scenario;
        let name = self.known.status.config_name;
        let shared = Arc::clone(&self.shared);
        let ends = || shared.orders.vent_wanted().is_some() || wanted();
        let tuned = self.lend(|operator, board| {
            operator.shared.log(Weight::Plain, "tuning begins");
            let bench = LiveBench::new(board, name.as_str(), most_pa, &ends)
                .map_err(|error| TuneError::Run(RunError::Board(error)))?;
            tuning::tune(&known, most_pa, bench, &mut |telemetry, part| {
                let text = format!(
                    "Run {}: {:.0} of {:.0} s. To vent ends it.",
                    part.number, part.time_s, part.duration_s
                );
                // The lent board's own status is not seen here.
                operator.see_armed(Some(most_pa as f32));
                operator.show_progress("Tuning", text, part.time_s / part.duration_s);
                operator.see(telemetry);
                operator.show();
            })
        })?;
        if tuned.as_ref().is_ok_and(|tuned| tuned.findings.adopted) {
            self.remember();
        }
        self.learn_anew();
        match tuned {
            Ok(tuned) => self.tuned(&tuned)?,
            Err(error) => self.not_tuned(error),
        }
        Ok(())
    }

    fn tuned(&mut self, tuned: &Tuned) -> Result<(), InputError> {
        let (folder, name) = next_folder(&self.out, "tune");
        tuning::write(tuned, &folder, &name)?;
        self.shared.log(Weight::Plain, format!("tuned: {}", folder.display()));
        let text = "friction, valves and gains".to_owned();
        self.shared.add_result(Outcome { name: name.clone(), folder, text, trace: false });
        let adopted = tuned.findings.adopted;
        let has = if adopted {
            "The board has the tuned values, and vents; they are not saved."
        } else {
            "The board has its former values again, and vents."
        };
        let text = format!("{}\n{has}", tuned.findings.verdict());
        self.tasks.guided = Some(Guided::Over(Guide {
            head: vec!["Value", "before", "after"],
            table: tuned.findings.rows().into_iter().map(Vec::from).collect(),
            chooses: adopted,
            result: Some(name),
            ..Guide::over("Tuning", text)
        }));
        Ok(())
    }

    fn measure_stops(&mut self, most_pa: f64, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        self.records_nothing()?;
        self.is_configured()?;
        let config = self.known.config;
        let loaded = from_config::to_scenario(&config)?.scenario;
        let most_pa = tune::highest_pa(&config, Some(most_pa))?;
        let plan = Plan::new(&loaded, &config, &Asked::usual(most_pa), None)?;
        let mut record = Record::default();
        let whole_s = plan.driven.plant.run.duration_s;
        let outcome = self.lend(|operator, board| {
            operator.shared.log(Weight::Plain, "stops are measured");
            let mut bench = LiveRows::arm(board, config, &plan, true)?;
            bench.measure(&plan, &mut record, &mut |telemetry| {
                let time_s = f64::from(telemetry.step) * plan.driven.plant.run.step_s;
                let text = format!("{time_s:.0} of {whole_s:.0} s. To vent ends it.");
                operator.see_armed(Some(plan.pressures_pa[1] as f32));
                operator.show_progress("Stops", text, time_s / whole_s);
                operator.see(telemetry);
                operator.show();
                operator.shared.orders.vent_wanted().is_some() || wanted()
            })
        })?;
        self.learn_anew();
        let why = match outcome {
            Ok(()) => None,
            Err(RunError::Stopped) => Some(format!(
                "{}; the board vents",
                self.shared.orders.vent_wanted().unwrap_or("it ended")
            )),
            Err(error) => Some(error.to_string()),
        };
        let Some(last) = record.rows.rows.last() else {
            let why = why.unwrap_or_default();
            self.failed("Stops", format!("Nothing was measured: {why}."));
            return Ok(());
        };
        let ended = why.map(|why| format!("Ended at {:.0} of {whole_s:.0} s: {why}.", last.time_s));
        let findings = stops::measured(&record, &plan, &loaded, &self.target.name());
        self.publish_stops(ended, &findings, &record, &loaded)
    }

    /// Writes the record, which an early end has shortened, and shows what it has.
    fn publish_stops(
        &mut self,
        ended: Option<String>,
        findings: &stops::Findings,
        record: &Record,
        loaded: &Loaded,
    ) -> Result<(), NotDone> {
        let (folder, name) = next_folder(&self.out, "stops");
        let mut files = OutputDir::create(&folder)?;
        stops::write(&mut files, findings, record, loaded, &name)?;
        files.publish()?;
        if let Some(line) = &ended {
            self.shared.log(Weight::Refused, line.clone());
        }
        self.shared.log(Weight::Plain, format!("record of the stops: {}", folder.display()));
        let text = "gas temperature at stops, heat transfer".to_owned();
        self.shared.add_result(Outcome { name: name.clone(), folder, text, trace: true });
        let failed = findings.failed().map(|why| format!("Not measured: {why}."));
        let lines = ended.into_iter().chain(failed).map(|line| line + "\n");
        let text = lines.collect::<String>() + &findings.figures();
        self.tasks.guided = Some(Guided::Over(Guide {
            head: stops::Findings::HEAD.to_vec(),
            table: findings.rows(),
            result: Some(name),
            ..Guide::over("Stops", text)
        }));
        Ok(())
    }

    fn show_progress(&mut self, title: &'static str, text: String, progress: f64) {
        if self.shared.orders.refuse() {
            self.shared.log(Weight::Refused, "the board is at work: to vent ends that");
        }
        self.tasks.tuning =
            Some(Guide { title, text, progress: Some(progress), ..Guide::default() });
    }

    fn not_tuned(&mut self, error: TuneError) {
        let why = match (error, self.shared.orders.vent_wanted()) {
            (TuneError::Run(RunError::Board(BoardError::Interrupted)), Some(why)) => {
                format!("{why}; the board vents")
            }
            (error, _) => error.to_string(),
        };
        self.failed("Tuning", format!("Nothing was tuned: {why}."));
    }

    fn failed(&mut self, title: &'static str, text: String) {
        self.shared.log(Weight::Refused, text.clone());
        self.tasks.guided = Some(Guided::Over(Guide::over(title, text)));
    }
}

fn asked_for(set_point: SetPoint) -> String {
    match set_point {
        SetPoint::Vent => "vent".to_owned(),
        SetPoint::Duty { inlet, outlet } => {
            format!("inlet {:.1} %, outlet {:.1} %", inlet * 100.0, outlet * 100.0)
        }
        SetPoint::MassFlow { flow_kg_s } => format!("{:.3} g/s", flow_kg_s * 1e3),
        SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
            format!("cycles of {period_s:.2} s, {:.3} g/s", flow_kg_s * 1e3)
        }
        SetPoint::Pressure { pressure_pa } => format!("{:.1} kPa", pressure_pa / 1e3),
        SetPoint::Contraction { contraction } => {
            format!("contraction {:.2} %", contraction * 100.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_names_no_file() {
        for (text, key) in [
            ("[drive]\nkind = \"pressure\"\nprofile_csv = \"/etc/passwd\"\n", "drive.profile_csv"),
            ("[vessel]\nvolume_csv = \"/etc/passwd\"\n", "vessel.volume_csv"),
            ("[table]\ncsv = \"/etc/passwd\"\n", "table.csv"),
        ] {
            let text = ScenarioText { name: "sent.toml".to_owned(), text: text.to_owned() };
            let error =
                LiveBoard::configuration(&Target::Emulated, Some(text)).unwrap_err().to_string();
            let said = format!("{key} = \"/etc/passwd\": must be left out");
            assert!(error.starts_with("sent.toml:") && error.contains(&said), "{error}");
        }
    }
}
