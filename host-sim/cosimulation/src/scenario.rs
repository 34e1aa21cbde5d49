//! The scenario of a unit: of one muscle or of a joint.

use super::Kind;
use super::joint::Joint;
use super::muscle::Muscle;
use super::running::{Inputs, ModelError, Running};
use super::variables::{self, Variable};
use std::path::{Path, PathBuf};
use thermyo_files::input::InputError;
use thermyo_joint::JointLoaded;
use thermyo_record::units::{JOINT_UNITS, UNITS, Unit, unit_of};
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;
use thermyo_simulation::run::SetPoints;

/// A scenario, checked.
#[derive(Debug, Clone)]
pub enum Scenario {
    Muscle(Box<Loaded>),
    Joint(Box<JointLoaded>),
}

impl From<Loaded> for Scenario {
    fn from(loaded: Loaded) -> Self {
        Self::Muscle(Box::new(loaded))
    }
}

impl From<JointLoaded> for Scenario {
    fn from(loaded: JointLoaded) -> Self {
        Self::Joint(Box::new(loaded))
    }
}

impl Scenario {
    /// Loads a file.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        match thermyo_joint::load(path)? {
            Some(joint) => Ok(joint.into()),
            None => Ok(thermyo_setup::load(path)?.into()),
        }
    }

    pub fn run(&self) -> &thermyo_scenario::Run {
        match self {
            Self::Muscle(loaded) => &loaded.plant.run,
            Self::Joint(loaded) => &loaded.muscles[0].plant.run,
        }
    }

    pub fn variables(&self, kind: Kind) -> Vec<Variable> {
        match self {
            Self::Muscle(_) => variables::of_muscle(kind),
            Self::Joint(_) => variables::of_joint(kind),
        }
    }

    /// Columns of the scenario's trace.
    pub fn columns(&self) -> &'static [&'static str] {
        match self {
            Self::Muscle(_) => &thermyo_record::trace::COLUMNS,
            Self::Joint(_) => &thermyo_joint::COLUMNS,
        }
    }

    /// Initial values of the inputs. A muscle without power vents.
    pub fn inputs(&self, kind: Kind) -> Inputs {
        let numbers = match (self, kind) {
            (Self::Muscle(_), Kind::Plant) => vec![0.0, 1.0],
            (Self::Muscle(loaded), Kind::WithCore) => vec![SetPoints::new(loaded).value(0.0)],
            (Self::Joint(loaded), Kind::Plant) => vec![0.0, 1.0, 0.0, 1.0, loaded.load_n_m(0.0)],
            (Self::Joint(loaded), Kind::WithCore) => {
                let motion = loaded.motion(0.0);
                let [angle_rad, stiffness] = [motion.angle_rad, motion.stiffness_n_m_rad];
                vec![angle_rad.into(), stiffness.into(), loaded.load_n_m(0.0)]
            }
        };
        Inputs { numbers, follow_scenario: true }
    }

    /// Starts the operation.
    pub fn start(&self, kind: Kind, inputs: &Inputs) -> Result<Box<dyn Running>, ModelError> {
        match self {
            Self::Muscle(loaded) => Ok(Box::new(Muscle::new(loaded, kind, inputs)?)),
            Self::Joint(loaded) => Ok(Box::new(Joint::new(loaded, kind, inputs)?)),
        }
    }

    /// Text of the scenario.
    pub fn render(&self) -> String {
        match self {
            Self::Muscle(loaded) => thermyo_setup::render(loaded),
            Self::Joint(loaded) => thermyo_joint::render(loaded),
        }
    }

    /// Names of the scenario's tables in a unit, and the paths that name them.
    pub fn files(&mut self) -> Vec<(&'static str, Vec<&mut Option<PathBuf>>)> {
        match self {
            Self::Muscle(loaded) => {
                let (plant, believed) = (&mut loaded.plant, &mut loaded.believed);
                let volume = vec![&mut plant.vessel.volume_csv, &mut believed.vessel.volume_csv];
                let profile = vec![&mut plant.drive.profile_csv, &mut believed.drive.profile_csv];
                let table = vec![&mut plant.table.csv, &mut believed.table.csv];
                vec![("volume.csv", volume), ("profile.csv", profile), ("table.csv", table)]
            }
            Self::Joint(loaded) => {
                let JointLoaded { muscles: [a, b], joint, believed, drive, .. } = &mut **loaded;
                let [of_a, of_b] = [a, b].map(|muscle| {
                    vec![&mut muscle.plant.table.csv, &mut muscle.believed.table.csv]
                });
                let mut radii = vec![&mut joint.radius_csv];
                // There is none if the core has another radius.
                radii.extend(Some(&mut believed.radius_csv).filter(|path| path.is_some()));
                vec![
                    ("radius.csv", radii),
                    ("profile.csv", vec![&mut drive.profile_csv]),
                    ("load.csv", vec![&mut drive.load_csv]),
                    ("table_a.csv", of_a),
                    ("table_b.csv", of_b),
                ]
            }
        }
    }

    /// Units of the scenario's variables.
    pub fn units(&self) -> Vec<&'static Unit> {
        match self {
            Self::Muscle(_) => UNITS.iter().collect(),
            Self::Joint(_) => JOINT_UNITS.iter().chain(&UNITS).collect(),
        }
    }

    /// Unit of the input `set_point`, which is that of the drive.
    pub fn set_point_unit(&self) -> Option<&'static Unit> {
        match self {
            Self::Muscle(loaded) => match loaded.plant.drive.kind {
                DriveKind::MassFlow => unit_of("flow_kg_s"),
                DriveKind::Pressure => unit_of("pressure_pa"),
                _ => None,
            },
            Self::Joint(_) => None,
        }
    }
}
