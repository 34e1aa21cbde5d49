//! One muscle or vessel in operation.

use super::Kind;
use super::running::{Inputs, ModelError, Running};
use super::variables::SET_POINT;
use model_core::control::Mode;
use model_core::{Command, Estimate, Faults, Sample, SetPoint, SetPointError, Telemetry};
use thermyo_plant::Actuation;
use thermyo_record::trace::Row;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::{Board, BoardError, BoardStep, CoreBoard};
use thermyo_simulation::rig::{MeanFlows, Reader, Rig};
use thermyo_simulation::run::SetPoints;

/// Plant and board in operation.
pub struct Muscle {
    loaded: Loaded,
    rig: Rig,
    flows: MeanFlows,
    driver: Driver,
    /// The importer's last set point.
    given: f64,
    row: Row,
}

/// Source of the valves' openings.
enum Driver {
    /// The importer. The sensors are read as by the core.
    Importer(Box<Reader>),
    Core {
        board: Box<CoreBoard>,
        drive: Box<SetPoints>,
        step: BoardStep,
    },
}

impl Muscle {
    /// Plant and board at time zero.
    pub fn new(loaded: &Loaded, kind: Kind, inputs: &Inputs) -> Result<Self, ModelError> {
        let mut rig = Rig::new(loaded)?;
        let config = core_config(&loaded.believed);
        let flows = MeanFlows::new(&rig);
        let sample = rig.sample();
        let driver = match kind {
            Kind::Plant => Driver::Importer(Box::new(Reader::new(&config))),
            Kind::WithCore => {
                let mut board = Box::<CoreBoard>::default();
                let drive = Box::new(SetPoints::new(loaded));
                let set_point = if inputs.follow_scenario {
                    drive.at(0.0)
                } else {
                    drive.of(inputs.numbers[0])
                };
                board.start(&config, set_point).map_err(|error| refused(error, inputs))?;
                let step = board.step(&sample)?;
                Driver::Core { board, drive, step }
            }
        };
        let row = Row {
            truth: rig.truth(),
            sensor_gas_k: 0.0,
            sensor_wall_k: 0.0,
            model_k: f64::NAN,
            model_sensor_k: f64::NAN,
            set_point: f64::NAN,
            telemetry: unread(sample),
        };
        let given = inputs.numbers[0];
        let mut running = Self { loaded: loaded.clone(), rig, flows, driver, given, row };
        running.read(sample);
        Ok(running)
    }

    /// The board's output for a sample.
    fn read(&mut self, sample: Sample) {
        self.row.telemetry = match &mut self.driver {
            Driver::Importer(reader) => {
                let (pressure_pa, length_m) = reader.read(&sample);
                Telemetry { pressure_pa, length_m, ..unread(sample) }
            }
            Driver::Core { step, .. } => step.telemetry.unwrap_or_else(|| unread(sample)),
        };
    }
}

impl Running for Muscle {
    fn take(&mut self, inputs: &Inputs) -> Result<(), ModelError> {
        let Driver::Core { board, drive, .. } = &mut self.driver else { return Ok(()) };
        if inputs.follow_scenario || inputs.numbers[0] == self.given {
            return Ok(());
        }
        match board.core()?.set(drive.of(inputs.numbers[0])) {
            // Venting faults vent; the outputs state the reason.
            Ok(()) | Err(SetPointError::Faults(_)) => self.given = inputs.numbers[0],
            Err(error) => return Err(refused(BoardError::SetPoint(error), inputs)),
        }
        Ok(())
    }

    fn step(&mut self, steps: u64, inputs: &Inputs) -> Result<(), ModelError> {
        let actuation = match &mut self.driver {
            Driver::Importer(_) => {
                Actuation { inlet: inputs.numbers[0], outlet: inputs.numbers[1] }
            }
            Driver::Core { board, drive, step } => {
                let update = drive.acting_from(steps, &self.loaded);
                if let Some(set_point) = update.filter(|_| inputs.follow_scenario) {
                    match board.core()?.set(set_point) {
                        Ok(()) | Err(SetPointError::Faults(_)) => (),
                        Err(error) => return Err(BoardError::SetPoint(error).into()),
                    }
                }
                step.actuation
            }
        };
        self.rig.advance(actuation)?;
        let restarts = self.rig.board_restarts();
        let sample = self.rig.sample();
        if let Driver::Core { board, step, .. } = &mut self.driver {
            if restarts {
                board.restart()?;
            }
            *step = board.step(&sample)?;
        }
        self.read(sample);
        Ok(())
    }

    fn look(&mut self) -> Vec<f64> {
        let elapsed_s = self.flows.elapsed_s(&self.rig);
        self.row.truth = self.rig.truth();
        (self.row.truth.flow_in_kg_s, self.row.truth.flow_out_kg_s) =
            self.flows.since(&self.rig, elapsed_s);
        self.row.sensor_gas_k = self.rig.gas_reading_k();
        self.row.sensor_wall_k = self.rig.wall_reading_k();
        self.row.cells().to_vec()
    }
}

/// A refused set point is the importer's fault if the importer sets it.
fn refused(error: BoardError, inputs: &Inputs) -> ModelError {
    match error {
        BoardError::SetPoint(SetPointError::Range { minimum, maximum, .. })
            if !inputs.follow_scenario =>
        {
            let allowed = format!("from {minimum} to {maximum}");
            ModelError::Value { name: SET_POINT, value: inputs.numbers[0], allowed }
        }
        error => error.into(),
    }
}

/// Telemetry of a board without a core.
fn unread(sample: Sample) -> Telemetry {
    Telemetry {
        step: 0,
        sample,
        pressure_pa: 0.0,
        length_m: 0.0,
        estimate: Estimate::default(),
        command: Command::CLOSED,
        mode: Mode::Vent,
        limited: false,
        set_point: SetPoint::Vent,
        faults: Faults::NONE,
    }
}
