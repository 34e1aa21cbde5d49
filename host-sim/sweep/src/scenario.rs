//! The scenario of a sweep, of one muscle or of a joint.

use super::measure::{self, Figures, settled_s};
use std::io;
use std::path::Path;
use thermyo_files::input::{InputError, Problem, read_text};
use thermyo_joint::JointLoaded;
use thermyo_scenario::joint::{JointDocument, Setting, is_joint};
use thermyo_scenario::{Document, Run};
use thermyo_setup::{Loaded, assemble};

/// A scenario whose keys can be set.
#[derive(Debug, Clone)]
pub enum Swept {
    Muscle(Document),
    Joint(Box<JointDocument>),
}

/// A scenario that can be run.
pub(super) enum Assembled {
    Muscle(Box<Loaded>),
    Joint(Box<JointLoaded>),
}

impl Swept {
    pub(super) fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?, path)
    }

    /// A scenario from its text; `origin` is its name in messages.
    pub fn parse(text: &str, origin: &Path) -> Result<Self, InputError> {
        if is_joint(text) {
            return Ok(Self::Joint(Box::new(JointDocument::parse(text, origin)?)));
        }
        Ok(Self::Muscle(Document::parse(text, origin)?))
    }

    /// Name of the file.
    pub(super) fn origin(&self) -> &Path {
        match self {
            Self::Muscle(document) => &document.origin,
            Self::Joint(document) => &document.muscles[0].origin,
        }
    }

    pub(super) fn set(&mut self, full_path: &str, value: Setting<'_>) -> Result<(), Problem> {
        match (self, value) {
            (Self::Joint(document), value) => document.set(full_path, value),
            (Self::Muscle(document), Setting::Number(number)) => document.set(full_path, number),
            (Self::Muscle(document), Setting::Word(word)) => document.set_word(full_path, word),
        }
    }

    pub(super) fn assemble(&self) -> Result<Assembled, InputError> {
        Ok(match self {
            Self::Muscle(document) => Assembled::Muscle(Box::new(assemble(document)?)),
            Self::Joint(document) => Assembled::Joint(Box::new(thermyo_joint::joint(document)?)),
        })
    }

    /// Warnings about a key, if the scenario is valid.
    pub(super) fn warnings_of(&self, full_path: &str) -> Vec<Problem> {
        let all = match (self, self.assemble()) {
            (Self::Muscle(document), Ok(Assembled::Muscle(loaded))) => {
                thermyo_setup::warnings(document, &loaded)
            }
            (Self::Joint(document), Ok(Assembled::Joint(loaded))) => {
                thermyo_joint::warnings(document, &loaded)
            }
            _ => Vec::new(),
        };
        let of_key =
            |problem: &Problem| matches!(problem, Problem::NoSense { key, .. } if key == full_path);
        all.into_iter().map(|warning| *warning.problem).filter(of_key).collect()
    }
}

impl Assembled {
    /// The scenario as `thermyo check` prints it.
    pub(super) fn render(&self) -> String {
        match self {
            Self::Muscle(loaded) => thermyo_setup::render(loaded),
            Self::Joint(loaded) => thermyo_joint::render(loaded),
        }
    }

    fn run(&self) -> &Run {
        match self {
            Self::Muscle(loaded) => &loaded.plant.run,
            Self::Joint(loaded) => &loaded.muscles[0].plant.run,
        }
    }

    /// Start of the errors' evaluation \[s\], and the seed of its noise.
    pub(super) fn settled_and_seed(&self) -> (f64, u64) {
        (settled_s(self.run()), self.run().seed)
    }

    /// Runs the scenario. `go_on` is called in each step, and its error ends the run.
    pub(super) fn measure(
        self,
        from_s: f64,
        go_on: &mut dyn FnMut() -> io::Result<()>,
    ) -> Result<Figures, String> {
        match self {
            Self::Muscle(loaded) => {
                measure::measure(*loaded, from_s, go_on).map_err(|error| error.to_string())
            }
            Self::Joint(loaded) => {
                measure::measure_joint(*loaded, from_s, go_on).map_err(|error| error.to_string())
            }
        }
    }
}
