//! Sensors and valves of the plant as a board sees them, with the scenario's faults in between.

use crate::adc::VirtualAdc;
use crate::faults::InjectedFaults;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::sensing::Sensing;
use model_core::{Config, Sample};
use thermyo_plant::{Actuation, BuildError, Diverged, Ledger, Plant, Truth};
use thermyo_scenario::Scenario;
use thermyo_setup::Loaded;

/// Plant, front end and faults of a scenario, at rest at time zero.
pub struct Rig {
    plant: Box<dyn Plant>,
    adc: VirtualAdc,
    faults: InjectedFaults,
}

impl Rig {
    pub fn new(loaded: &Loaded) -> Result<Self, BuildError> {
        Ok(Self {
            plant: thermyo_plant::build(&loaded.plant, loaded.volume_profile.clone())?,
            adc: VirtualAdc::new(&loaded.plant),
            faults: InjectedFaults::new(&loaded.plant),
        })
    }

    /// A rig behind the pins of a board that makes the pulses itself: [`Rig::advance`] takes the
    /// fraction of the step for which each valve was driven.
    pub fn behind_pins(loaded: &Loaded) -> Result<Self, BuildError> {
        let mut rig = Self::new(loaded)?;
        rig.plant.follow_pins();
        Ok(rig)
    }

    /// The inputs of the core. Every call draws new noise: call it once per step.
    pub fn sample(&mut self) -> Sample {
        let truth = self.plant.truth();
        self.faults.apply(truth.time_s, self.adc.convert(&self.faults.sensed(&truth)))
    }

    /// Advances by one step with these openings, each a fraction of the PWM period from 0 to 1.
    pub fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged> {
        self.plant.disturb(self.faults.disturbance(self.plant.truth().time_s));
        self.plant.advance(actuation)
    }

    /// Changes supply, load, heat transfer and sensor lags: see [`Plant::retune`].
    pub fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError> {
        self.plant.retune(scenario)
    }

    /// Whether the board restarts before the step that begins now.
    pub fn board_restarts(&self) -> bool {
        self.faults.board_restarts(self.plant.truth().time_s)
    }

    /// The plant's state.
    pub fn truth(&self) -> Truth {
        self.plant.truth()
    }

    pub fn ledger(&self) -> Ledger {
        self.plant.ledger()
    }

    /// Wall surface temperature per axial zone, port first \[K\].
    pub fn axial_wall_k(&self) -> Vec<f64> {
        self.plant.axial_wall_k()
    }

    /// Gas temperature per axial zone, port first \[K\].
    pub fn axial_gas_k(&self) -> Vec<f64> {
        self.plant.axial_gas_k()
    }

    /// The gas sensor's reading in the last sample, noise included \[K\].
    pub fn gas_reading_k(&self) -> f64 {
        self.adc.gas_reading_k()
    }

    /// The wall sensor's reading in the last sample, noise included \[K\].
    pub fn wall_reading_k(&self) -> f64 {
        self.adc.wall_reading_k()
    }
}

/// The core's readings of pressure and length without running a core; the same numbers while the
/// sensors are healthy.
#[derive(Debug)]
pub struct Reader {
    sensing: Sensing,
    chamber: AnyChamber,
}

impl Reader {
    pub fn new(config: &Config) -> Self {
        Self { sensing: config.sensing(), chamber: AnyChamber::new(&config.chamber) }
    }

    /// Absolute pressure \[Pa\] and length \[m\]; to be called once per step.
    pub fn read(&mut self, sample: &Sample) -> (f32, f32) {
        let readings = self.sensing.read(sample, false);
        (readings.pressure.value, self.chamber.limit_length_m(readings.length.value))
    }
}

/// Mean mass flows between two reads of the plant's ledger.
#[derive(Debug, Clone, Copy)]
pub struct MeanFlows {
    time_s: f64,
    in_kg: f64,
    out_kg: f64,
}

impl MeanFlows {
    /// Starts from the present ledger.
    pub fn new(rig: &Rig) -> Self {
        let ledger = rig.ledger();
        Self { time_s: rig.truth().time_s, in_kg: ledger.mass_in_kg, out_kg: ledger.mass_out_kg }
    }

    /// Time since the last read \[s\].
    pub fn elapsed_s(&self, rig: &Rig) -> f64 {
        rig.truth().time_s - self.time_s
    }

    /// Mean flows in and out since the last read, `elapsed_s` ago \[kg/s\]; none at the start.
    pub fn since(&mut self, rig: &Rig, elapsed_s: f64) -> (f64, f64) {
        let before = std::mem::replace(self, Self::new(rig));
        if elapsed_s > 0.0 {
            ((self.in_kg - before.in_kg) / elapsed_s, (self.out_kg - before.out_kg) / elapsed_s)
        } else {
            (0.0, 0.0)
        }
    }
}
