//! The plant as a board meets it: sensors that it samples and valves that it drives, with the scenario's
//! faults in between.

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
    /// That of a scenario.
    pub fn new(loaded: &Loaded) -> Result<Self, BuildError> {
        Ok(Self {
            plant: thermyo_plant::build(&loaded.plant, loaded.volume_profile.clone())?,
            adc: VirtualAdc::new(&loaded.plant),
            faults: InjectedFaults::new(&loaded.plant),
        })
    }

    /// That of a scenario, behind the pins of a board that makes the pulses: each share given to
    /// [`Rig::advance`] is that of the step for which a valve was driven.
    pub fn behind_pins(loaded: &Loaded) -> Result<Self, BuildError> {
        let mut rig = Self::new(loaded)?;
        rig.plant.follow_pins();
        Ok(rig)
    }

    /// What arrives at the core now. Every call draws the sensors' noise: one per step.
    pub fn sample(&mut self) -> Sample {
        let truth = self.plant.truth();
        self.faults.apply(truth.time_s, self.adc.convert(&self.faults.sensed(&truth)))
    }

    /// One step with these openings, each a share of the PWM period from 0 to 1.
    pub fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged> {
        self.plant.disturb(self.faults.disturbance(self.plant.truth().time_s));
        self.plant.advance(actuation)
    }

    /// Takes over a scenario's supply, load, heat transfer and sensors' lags: see [`Plant::retune`].
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

    /// The plant's books.
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

    /// What the gas sensor read in the last sample, noise included \[K\].
    pub fn gas_reading_k(&self) -> f64 {
        self.adc.gas_reading_k()
    }

    /// What the wall sensor read in the last sample, noise included \[K\].
    pub fn wall_reading_k(&self) -> f64 {
        self.adc.wall_reading_k()
    }
}

/// What the core makes of pressure and length, where no core is: the same numbers, as long as the sensors are well.
#[derive(Debug)]
pub struct Reader {
    sensing: Sensing,
    chamber: AnyChamber,
}

impl Reader {
    /// That of a configuration.
    pub fn new(config: &Config) -> Self {
        Self { sensing: Sensing::new(config), chamber: AnyChamber::new(&config.chamber) }
    }

    /// Absolute pressure \[Pa\] and length \[m\]; once per step.
    pub fn read(&mut self, sample: &Sample) -> (f32, f32) {
        let readings = self.sensing.read(sample, false);
        (readings.pressure.value, self.chamber.limit_length_m(readings.length.value))
    }
}

/// Mean mass flows between two looks at the plant's books.
#[derive(Debug, Clone, Copy)]
pub struct MeanFlows {
    time_s: f64,
    in_kg: f64,
    out_kg: f64,
}

impl MeanFlows {
    /// The books as they are now.
    pub fn new(rig: &Rig) -> Self {
        let ledger = rig.ledger();
        Self { time_s: rig.truth().time_s, in_kg: ledger.mass_in_kg, out_kg: ledger.mass_out_kg }
    }

    /// Time since the last look \[s\].
    pub fn elapsed_s(&self, rig: &Rig) -> f64 {
        rig.truth().time_s - self.time_s
    }

    /// Mean flows in and out since the last look, `elapsed_s` ago \[kg/s\]; none at the start.
    pub fn since(&mut self, rig: &Rig, elapsed_s: f64) -> (f64, f64) {
        let before = std::mem::replace(self, Self::new(rig));
        if elapsed_s > 0.0 {
            ((self.in_kg - before.in_kg) / elapsed_s, (self.out_kg - before.out_kg) / elapsed_s)
        } else {
            (0.0, 0.0)
        }
    }
}
