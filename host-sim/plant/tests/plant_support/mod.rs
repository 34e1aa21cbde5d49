//! Shared by the tests of the muscle: a scenario and a drive by mass flow.

use thermyo_plant::flow::Iso6358;
use thermyo_plant::gas::IdealGas;
use thermyo_plant::{Actuation, Truth};
use thermyo_scenario::{PlantModel, Scenario};

/// The default muscle, 0.30 m long, 20 mm wide, braided at 23 degrees.
pub fn muscle(model: PlantModel) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.plant.model = model;
    scenario
}

/// Drives a plant with `drive.flow_kg_s` in for half of `drive.period_s`, then out.
pub struct MassFlow {
    scenario: Scenario,
    valve: Iso6358,
}

impl MassFlow {
    pub fn new(scenario: &Scenario) -> Self {
        let valve = &scenario.valve;
        let gas = IdealGas::new(&scenario.gas);
        Self {
            valve: Iso6358::valve(valve.conductance_m3_s_pa, valve.critical_ratio, &gas),
            scenario: scenario.clone(),
        }
    }

    /// The openings for the requested flow at the plant's present pressure.
    pub fn actuation(&self, truth: &Truth) -> Actuation {
        let Scenario { supply, ambient, drive, .. } = &self.scenario;
        let pressure = truth.pressure_pa;
        let share = |open: f64| {
            if open > drive.flow_kg_s { self.duty(drive.flow_kg_s / open) } else { 1.0 }
        };
        if (truth.time_s / drive.period_s).fract() < 0.5 {
            let open = self.valve.mass_flow(supply.pressure_pa, supply.temperature_k, pressure);
            Actuation { inlet: share(open), outlet: 0.0 }
        } else {
            let open = self.valve.mass_flow(pressure, truth.gas_temperature_k, ambient.pressure_pa);
            Actuation { inlet: 0.0, outlet: share(open) }
        }
    }

    /// Duty for a mean opening. A switching valve whose pulse is shorter than its stroke opens in a
    /// triangle: its mean is duty^2 / (switching time times PWM frequency).
    fn duty(&self, opening: f64) -> f64 {
        let valve = &self.scenario.valve;
        let stroke = valve.switch_time_s * valve.pwm_hz;
        if self.scenario.plant.model == PlantModel::Full && opening < stroke {
            (opening * stroke).sqrt()
        } else {
            opening
        }
    }
}
