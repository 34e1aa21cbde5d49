//! A muscle for a board to drive, a step at a time: the simulated plant behind its front end.

use thermyo_boards::emulated::{EmulatedBoard, Exchange};
use thermyo_plant::{Actuation, Plant};
use thermyo_simulation::board::Board;

use model_core::{AdcCode, Config, Sample, SetPoint};
use thermyo_setup::core_config::core_config;
use thermyo_simulation::adc::VirtualAdc;

/// Steps for which a core judges its sensors after a start, at a step of a millisecond.
pub const JUDGING_STEPS: u16 = 50;

/// A muscle, its sensors and its valves.
pub struct Muscle {
    plant: Box<dyn Plant>,
    adc: VirtualAdc,
    config: Config,
}

impl Muscle {
    /// The one of a scenario, given as text.
    ///
    /// # Panics
    /// For a scenario that is refused.
    pub fn new(text: &str) -> Self {
        let loaded = thermyo_setup::parse(text, "rig".as_ref()).expect("the scenario holds");
        let plant = thermyo_plant::build(&loaded.plant, None).expect("the plant is built");
        let adc = VirtualAdc::new(&loaded.plant);
        Self { plant, adc, config: core_config(&loaded.believed) }
    }

    /// What a board is configured with of it.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// What a board reads now.
    pub fn sample(&mut self) -> Sample {
        let codes = self.adc.convert(&self.plant.truth());
        Sample::new(AdcCode(codes.pressure), AdcCode(codes.gas), AdcCode(codes.length))
    }

    /// One step with these openings.
    ///
    /// # Panics
    /// When the plant leaves the range of its equations.
    pub fn advance(&mut self, actuation: Actuation) {
        self.plant.advance(actuation).expect("the plant goes on");
    }
}

/// A muscle at the emulated board.
pub struct Rig {
    /// The board.
    pub board: EmulatedBoard,
    /// What it drives.
    pub muscle: Muscle,
}

impl Rig {
    /// The muscle of a scenario, and a board right after power came.
    ///
    /// # Panics
    /// Without an emulator.
    pub fn new(scenario: &str) -> Self {
        let board = EmulatedBoard::new().expect("the emulator starts");
        Self { board, muscle: Muscle::new(scenario) }
    }

    /// Another muscle at the same board.
    ///
    /// # Panics
    /// For a scenario that is refused.
    pub fn replace_muscle(&mut self, scenario: &str) {
        self.muscle = Muscle::new(scenario);
    }

    /// Tells the board about the muscle and what to do with it, and lets it judge its sensors.
    ///
    /// # Panics
    /// When the board refuses.
    pub fn start(&mut self, set_point: SetPoint) {
        self.board.start(self.muscle.config(), set_point).expect("the board starts");
    }

    /// One millisecond.
    ///
    /// # Panics
    /// When the emulator ends.
    pub fn exchange(&mut self) -> Exchange {
        self.exchange_with(|sample| sample)
    }

    /// One millisecond in which the board reads what `change` makes of the sample.
    ///
    /// # Panics
    /// When the emulator ends.
    pub fn exchange_with(&mut self, change: impl FnOnce(Sample) -> Sample) -> Exchange {
        let sample = change(self.muscle.sample());
        let exchange = self.board.exchange(&sample).expect("the emulator goes on");
        self.muscle.advance(exchange.set_duty());
        exchange
    }

    /// Less than a millisecond, in which the muscle stands still.
    ///
    /// # Panics
    /// When the emulator ends.
    pub fn run(&mut self, nanoseconds: u32, change: impl FnOnce(Sample) -> Sample) -> Exchange {
        let sample = change(self.muscle.sample());
        self.board.run(&sample, nanoseconds).expect("the emulator goes on")
    }
}
