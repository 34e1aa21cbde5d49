//! A joint of two muscles in operation.

use super::Kind;
use super::running::{Inputs, ModelError, Running};
use super::variables::{ANGLE, STIFFNESS};
use model_core::joint::{JointError, JointField, JointSetPoint, Motion};
use thermyo_joint::{Inputs as RigInputs, JointLoaded, Rig, Row, RunError};
use thermyo_plant::Actuation;

/// Plant and core in operation. If the importer drives the valves, the core's commands are ignored.
pub struct Joint {
    loaded: JointLoaded,
    kind: Kind,
    rig: Rig,
    inputs: RigInputs,
    row: Row,
}

impl Joint {
    /// Plant and core at time zero, at the angle of the first set point.
    pub fn new(loaded: &JointLoaded, kind: Kind, importer: &Inputs) -> Result<Self, ModelError> {
        let mut inputs = loaded.inputs(0.0);
        match kind {
            Kind::Plant => inputs.load_n_m = importer.numbers[4],
            Kind::WithCore if importer.follow_scenario => (),
            Kind::WithCore => {
                inputs.set_point = set_point(importer);
                inputs.load_n_m = importer.numbers[2];
            }
        }
        let mut rig = Rig::new(loaded, inputs).map_err(|error| refused(error, importer))?;
        let row = rig.observe();
        Ok(Self { loaded: loaded.clone(), kind, rig, inputs, row })
    }
}

impl Running for Joint {
    fn take(&mut self, importer: &Inputs) -> Result<(), ModelError> {
        let driven = match self.kind {
            Kind::Plant => importer.numbers[4],
            Kind::WithCore if importer.follow_scenario => return Ok(()),
            Kind::WithCore => {
                let asked = set_point(importer);
                if asked != self.inputs.set_point {
                    self.rig.set(asked).map_err(|error| refused(error, importer))?;
                    self.inputs.set_point = asked;
                }
                importer.numbers[2]
            }
        };
        self.inputs.load_n_m = driven;
        self.rig.load(driven);
        Ok(())
    }

    fn step(&mut self, steps: u64, importer: &Inputs) -> Result<(), ModelError> {
        let openings = match (self.kind, &importer.numbers[..]) {
            (Kind::Plant, [inlet_a, outlet_a, inlet_b, outlet_b, ..]) => [
                Actuation { inlet: *inlet_a, outlet: *outlet_a },
                Actuation { inlet: *inlet_b, outlet: *outlet_b },
            ],
            _ => self.row.telemetry.commands().map(Actuation::from),
        };
        if self.kind == Kind::WithCore && importer.follow_scenario {
            self.loaded.follow(&mut self.inputs, steps);
        }
        self.rig.proceed(openings, self.inputs)?;
        self.row = self.rig.observe();
        Ok(())
    }

    fn look(&mut self) -> Vec<f64> {
        self.row.cells()
    }
}

/// The importer's set point of angle and stiffness, without speed.
fn set_point(importer: &Inputs) -> JointSetPoint {
    let [angle_rad, stiffness_n_m_rad] = [importer.numbers[0], importer.numbers[1]];
    JointSetPoint::Angle(Motion::still(angle_rad as f32, stiffness_n_m_rad as f32))
}

/// A refused set point is the importer's fault if the importer sets it.
fn refused(error: RunError, importer: &Inputs) -> ModelError {
    match error {
        RunError::SetPoint(JointError::Range { field, minimum, maximum, .. })
            if !importer.follow_scenario =>
        {
            let (name, value) = match field {
                JointField::Angle => (ANGLE, importer.numbers[0]),
                _ => (STIFFNESS, importer.numbers[1]),
            };
            let allowed = format!("from {minimum} to {maximum}");
            ModelError::Value { name, value, allowed }
        }
        error => error.into(),
    }
}
