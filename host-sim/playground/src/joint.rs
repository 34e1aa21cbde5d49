//! The scenario of a joint.

use crate::kind::{ENDLESS_S, Kind, no_file};
use model_core::Faults;
use model_core::joint::{JointFaults, JointMode};
use serde_json::{Value, json};
use thermyo_joint::{COLUMNS, JointLoaded, Row, Run};
use thermyo_scenario::joint::{JointDocument, Setting};

pub struct Joint {
    document: JointDocument,
    loaded: JointLoaded,
}

pub struct JointRun {
    run: Run,
    latest: Option<(JointMode, [Faults; 2], JointFaults)>,
}

impl Joint {
    fn of(document: JointDocument) -> Result<Self, String> {
        let loaded = thermyo_joint::joint(&document).map_err(|error| error.to_string())?;
        Ok(Self { document, loaded })
    }

    /// Values of a key in the core's configuration, by the paths that set them.
    fn believed(&self, key: &str) -> Vec<(String, f64)> {
        if let Some(name) = key.strip_prefix("joint.") {
            let value = json!(self.loaded.believed)[name].as_f64();
            return value.map(|value| (format!("believed.{key}"), value)).into_iter().collect();
        }
        let muscles = ["a", "b"].into_iter().zip(&self.loaded.muscles);
        let values = muscles.filter_map(|(side, muscle)| {
            let value = thermyo_scenario::number(&muscle.believed, key)?;
            Some((format!("joint.{side}.believed.{key}"), value))
        });
        values.collect()
    }
}

impl Kind for Joint {
    const COLUMNS: &'static [&'static str] = &COLUMNS;
    type Run = JointRun;

    fn parse(text: &str, origin: &str) -> Result<(Self, String), String> {
        let document =
            JointDocument::parse(text, origin.as_ref()).map_err(|error| error.to_string())?;
        if let Some((key, line)) = document.file() {
            return Err(no_file(origin, &key, line));
        }
        // A joint has no warnings.
        Ok((Self::of(document)?, String::new()))
    }

    fn render(&self) -> String {
        thermyo_joint::render(&self.loaded)
    }

    /// Parameters of muscle a with the joint's own; those of muscle b are below `b`.
    fn settings(&self) -> Value {
        let JointLoaded { muscles: [a, b], joint, drive, .. } = &self.loaded;
        let mut settings = json!(a.plant);
        settings["b"] = json!(b.plant);
        settings["joint"] = json!(joint);
        settings["drive"] = json!(drive);
        settings
    }

    fn turned(&self, values: &[(String, f64)], configured: bool) -> Result<Self, String> {
        let mut document = self.document.clone();
        let mut set = |path: &str, number: f64| {
            document.set(path, Setting::Number(number)).map_err(|problem| problem.to_string())
        };
        for (key, value) in values {
            let of_core = !configured && !key.starts_with("drive.");
            for (path, believed) in of_core.then(|| self.believed(key)).into_iter().flatten() {
                set(&path, believed)?;
            }
            set(key, *value)?;
        }
        Self::of(document)
    }

    fn endless(&self) -> Self {
        let Self { document, loaded } = self;
        let mut endless = Self { document: document.clone(), loaded: loaded.clone() };
        for muscle in &mut endless.loaded.muscles {
            muscle.plant.run.duration_s = ENDLESS_S;
            muscle.plant.run.log_every = 1;
        }
        endless
    }

    fn start(&self) -> Result<JointRun, String> {
        let run = Run::start(&self.loaded).map_err(|error| error.to_string())?;
        Ok(JointRun { run, latest: None })
    }

    fn retune(&self, run: &mut JointRun) -> Result<(), String> {
        run.run.retune(&self.loaded).map_err(|error| error.to_string())
    }

    fn step(run: &mut JointRun, mut rows: Option<&mut Vec<f64>>) -> Result<bool, String> {
        let JointRun { run, latest } = run;
        let mut observer = |row: &Row| {
            let telemetry = &row.telemetry;
            let muscles = telemetry.muscles.map(|muscle| muscle.faults);
            *latest = Some((telemetry.mode, muscles, telemetry.faults));
            if let Some(rows) = &mut rows {
                rows.extend(row.cells());
            }
            Ok(())
        };
        run.step(&mut observer).map_err(|error| error.to_string())
    }

    fn state(run: &JointRun) -> String {
        run.latest.map_or(String::new(), |(mode, muscles, joint)| {
            let faults = thermyo_joint::named(muscles, joint).unwrap_or_default();
            format!("{}\n{faults}", mode.name())
        })
    }
}
