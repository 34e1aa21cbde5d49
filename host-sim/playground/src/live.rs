//! A scenario that runs without an end, with parameters that may change meanwhile.

use crate::joint::Joint;
use crate::kind::{Kind, WRITTEN};
use crate::muscle::Muscle;
use thermyo_record::trace::cells_text;
use thermyo_scenario::joint::is_joint;

/// A run of any kind of scenario.
pub trait Running {
    /// First line of the run's trace.
    fn header(&self) -> String;
    /// Present parameters of the plant, as JSON.
    fn settings(&self) -> Vec<u8>;
    /// Sets numbers of keys together; if `configured`, of the core too, from time zero.
    fn turn(&mut self, values: &[(String, f64)], configured: bool) -> Result<(), String>;
    /// Runs `steps` steps, and adds the cells of every `every`-th row to `rows`.
    fn advance(&mut self, steps: u32, every: u32, rows: &mut Vec<f64>) -> Result<(), String>;
    /// A line with the core's mode, a line with its faults.
    fn state(&self) -> String;
    /// Warnings of `thermyo run`, one per line.
    fn warnings(&self) -> String;
    fn scenario(&self) -> String;
}

/// A run in progress, with the present values of its scenario.
struct Live<K: Kind> {
    /// Scenario with the duration of the text.
    scenario: K,
    run: K::Run,
    warnings: String,
    steps: u64,
}

/// Starts the scenario of a text at rest at time zero.
pub fn start(text: &str, origin: &str) -> Result<Box<dyn Running>, String> {
    let start = if is_joint(text) { Live::<Joint>::start } else { Live::<Muscle>::start };
    start(text, origin)
}

/// Runs the scenario of a text to its end and returns its trace.
pub fn trace(text: &str) -> Result<Vec<u8>, String> {
    if is_joint(text) { trace_of::<Joint>(text) } else { trace_of::<Muscle>(text) }
}

fn trace_of<K: Kind>(text: &str) -> Result<Vec<u8>, String> {
    let (scenario, _) = K::parse(text, WRITTEN)?;
    let mut trace = header::<K>().into_bytes();
    trace.push(b'\n');
    let mut run = scenario.start()?;
    let mut row = Vec::new();
    while K::step(&mut run, Some(&mut row))? {
        if !row.is_empty() {
            trace.extend_from_slice(cells_text(row.drain(..)).as_bytes());
            trace.push(b'\n');
        }
    }
    Ok(trace)
}

fn header<K: Kind>() -> String {
    K::COLUMNS.join(",")
}

impl<K: Kind + 'static> Live<K> {
    fn start(text: &str, origin: &str) -> Result<Box<dyn Running>, String> {
        let (scenario, warnings) = K::parse(text, origin)?;
        Ok(Box::new(Self::of(scenario, warnings)?))
    }

    fn of(scenario: K, warnings: String) -> Result<Self, String> {
        let run = scenario.endless().start()?;
        Ok(Self { scenario, run, warnings, steps: 0 })
    }
}

impl<K: Kind + 'static> Running for Live<K> {
    fn header(&self) -> String {
        header::<K>()
    }

    fn settings(&self) -> Vec<u8> {
        self.scenario.settings().to_string().into_bytes()
    }

    fn turn(&mut self, values: &[(String, f64)], configured: bool) -> Result<(), String> {
        let turned = self.scenario.turned(values, configured)?;
        if configured {
            *self = Self::of(turned, self.warnings.clone())?;
            return Ok(());
        }
        turned.endless().retune(&mut self.run)?;
        self.scenario = turned;
        Ok(())
    }

    fn advance(&mut self, steps: u32, every: u32, rows: &mut Vec<f64>) -> Result<(), String> {
        for _ in 0..steps {
            let taken = self.steps.is_multiple_of(every.max(1).into());
            K::step(&mut self.run, taken.then_some(&mut *rows))?;
            self.steps += 1;
        }
        Ok(())
    }

    fn state(&self) -> String {
        K::state(&self.run)
    }

    fn warnings(&self) -> String {
        self.warnings.clone()
    }

    fn scenario(&self) -> String {
        self.scenario.render()
    }
}
