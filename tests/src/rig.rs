//! A muscle for a board to drive, a step at a time: the simulated plant behind its front end.

use model_core::safety::supervisor::FirstFailure;
use thermyo_boards::emulated::{EmulatedBoard, Exchange};
use thermyo_plant::{Actuation, Plant};
use thermyo_protocol::{Answer, HostCommand, Refusal};
use thermyo_simulation::board::{Board, BoardError};

use model_core::{Config, Sample, SetPoint};
use thermyo_setup::core_config::core_config;
use thermyo_simulation::adc::VirtualAdc;

pub const STARTUP_CHECK_STEPS: u32 = 50;

/// A muscle, its sensors and its valves.
pub struct Muscle {
    plant: Box<dyn Plant>,
    adc: VirtualAdc,
    config: Config,
}

impl Muscle {
    /// Builds the muscle of a scenario, given as text.
    pub fn new(text: &str) -> Self {
        let loaded = thermyo_setup::parse(text, "rig".as_ref()).expect("the scenario holds");
        let plant = thermyo_plant::build(&loaded.plant, None).expect("the plant is built");
        let adc = VirtualAdc::new(&loaded.plant);
        Self { plant, adc, config: core_config(&loaded.believed) }
    }

    /// Configuration of a board for this muscle.
    pub fn config(&self) -> &Config {
        &self.config
    }

    pub fn sample(&mut self) -> Sample {
        self.adc.convert(&self.plant.truth()).into()
    }

    pub fn advance(&mut self, actuation: Actuation) {
        self.plant.advance(actuation).expect("the plant goes on");
    }
}

/// Removes the requests that the emulated board sends by itself as a host.
pub fn silent(sample: Sample) -> Sample {
    Sample { heard: false, ..sample }
}

/// Whether a coil has power.
pub fn powered(exchange: &Exchange) -> bool {
    exchange.inlet_coil > 0.0 || exchange.outlet_coil > 0.0
}

/// The emulated board with a muscle.
pub struct Rig {
    pub board: EmulatedBoard,
    pub muscle: Muscle,
}

impl Rig {
    /// The muscle of a scenario, and a board right after power-on.
    pub fn new(scenario: &str) -> Self {
        let board = EmulatedBoard::new().expect("the emulator starts");
        Self { board, muscle: Muscle::new(scenario) }
    }

    /// The same, with the board plugged in.
    pub fn plugged(scenario: &str) -> Self {
        let mut rig = Self::new(scenario);
        rig.board.connect_usb().expect("the board enumerates");
        rig
    }

    /// Puts another muscle at the same board.
    pub fn replace_muscle(&mut self, scenario: &str) {
        self.muscle = Muscle::new(scenario);
    }

    /// Configures and starts the board, and waits for the startup check.
    pub fn start(&mut self, set_point: SetPoint) {
        self.board.start(self.muscle.config(), set_point).expect("the board starts");
    }

    /// Runs one millisecond.
    pub fn exchange(&mut self) -> Exchange {
        self.exchange_with(|sample| sample)
    }

    pub fn pass(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds {
            self.exchange();
        }
    }

    /// The first failure that the board remembers.
    #[track_caller]
    pub fn first_failure(&mut self) -> FirstFailure {
        match self.board.ask(HostCommand::FirstFailure) {
            Ok(Answer::FirstFailure(Some(first))) => first,
            other => panic!("{other:?}"),
        }
    }

    /// Returns the refusal of a request.
    #[track_caller]
    pub fn refused(&mut self, command: HostCommand) -> Refusal {
        match self.board.ask(command) {
            Err(BoardError::Refused(refusal)) => refusal,
            other => panic!("{command:?}: {other:?}"),
        }
    }

    /// Runs one millisecond in which the board reads the sample changed by `change`.
    pub fn exchange_with(&mut self, change: impl FnOnce(Sample) -> Sample) -> Exchange {
        let sample = change(self.muscle.sample());
        let exchange = self.board.exchange(&sample).expect("the emulator goes on");
        self.muscle.advance(exchange.set_duty());
        exchange
    }

    /// Runs less than a millisecond, in which the muscle does not change.
    pub fn run(&mut self, nanoseconds: u32, change: impl FnOnce(Sample) -> Sample) -> Exchange {
        let sample = change(self.muscle.sample());
        self.board.run(&sample, nanoseconds).expect("the emulator goes on")
    }
}
