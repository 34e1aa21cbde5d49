//! A vessel: one zone of gas, fixed or prescribed volume, one wall.

use super::closure::Closure;
use super::flow::{Nozzle, Streams};
use super::gas::IdealGas;
use super::heat::{InnerHeat, Stirred};
use super::ode::DormandPrince;
use super::piping::{Disturbance, Piping};
use super::sensors::{Exposure, Sensors};
use super::start::Start;
use super::{Actuation, BuildError, Diverged, Ledger, Plant, Truth, check_gas};
use thermyo_compute::math;
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{DriveKind, Scenario};

/// Relative tolerance of one integration step.
const TOLERANCE: f64 = 1e-12;

// Places in the state vector; the first four are held to the tolerance.
const MASS: usize = 0;
const W: usize = 1;
const WALL: usize = 2;
const WORK: usize = 3;
const MASS_IN: usize = 4;
const MASS_OUT: usize = 5;
const ENTHALPY_IN: usize = 6;
const ENTHALPY_OUT: usize = 7;
const HEAT: usize = 8;
const TO_AMBIENT: usize = 9;
const STIRRED_IN: usize = 10;
const STIRRED_OUT: usize = 11;
const STATES: usize = 12;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Ports {
    Closed,
    /// A nozzle to ambient, open from the start.
    Discharge(Nozzle),
    /// A nozzle to the supply, open from the start.
    Fill(Nozzle),
    /// Inlet and outlet valve, opened by the actuation.
    Valves,
    /// The actuation is the mass flows themselves \[kg/s\], with the inflow at this temperature
    /// \[K\].
    Given {
        inflow_k: f64,
    },
}

impl Ports {
    fn of(scenario: &Scenario, gas: &IdealGas) -> Self {
        let orifice = &scenario.orifice;
        let nozzle = Nozzle::new(orifice.diameter_m, orifice.discharge_coefficient, gas);
        match scenario.drive.kind {
            DriveKind::Closed => Self::Closed,
            DriveKind::Discharge => Self::Discharge(nozzle),
            DriveKind::Fill => Self::Fill(nozzle),
            DriveKind::MassFlow
            | DriveKind::Duty
            | DriveKind::Pressure
            | DriveKind::Contraction => Self::Valves,
        }
    }
}

/// Everything that does not change during a run.
#[derive(Debug, Clone)]
struct Constants {
    step_s: f64,
    closure: Closure,
    volume: Profile,
    ports: Ports,
    piping: Piping,
    heat: InnerHeat,
    surface_m2: f64,
    wall_j_k: f64,
    outer_w_k: f64,
    section_m2: f64,
    initial_k: f64,
}

/// Quantities that follow from the state at one instant.
struct Instant {
    volume: f64,
    pressure: f64,
    temperature: f64,
    streams: Streams,
}

impl Constants {
    fn instant(&self, time: f64, y: &[f64; STATES], actuation: Actuation) -> Instant {
        let volume = self.volume.value(time);
        let pressure = y[W] * math::pow(volume, -self.closure.exponent());
        let temperature = self.closure.temperature(pressure, volume, y[MASS]);
        let mut streams = Streams::default();
        let gas = (pressure, temperature);
        match &self.ports {
            Ports::Closed => {}
            Ports::Discharge(nozzle) => {
                streams.add(gas, self.piping.ambient(), |p, t, q| nozzle.mass_flow(p, t, q));
            }
            Ports::Fill(nozzle) => {
                streams.add(gas, self.piping.supply(), |p, t, q| nozzle.mass_flow(p, t, q));
            }
            Ports::Valves => {
                self.piping.add_inlet(&mut streams, gas, 0.0, actuation.inlet);
                self.piping.add_outlet(&mut streams, gas, actuation.outlet);
            }
            // Leaks are part of the given flows.
            Ports::Given { inflow_k } => {
                streams = Streams::given(actuation.inlet, *inflow_k, actuation.outlet);
            }
        }
        if !matches!(self.ports, Ports::Given { .. }) {
            self.piping.add_leak(&mut streams, gas);
        }
        Instant { volume, pressure, temperature, streams }
    }

    fn rates(
        &self,
        time: f64,
        volume_slope: f64,
        y: &[f64; STATES],
        actuation: Actuation,
    ) -> [f64; STATES] {
        let closure = &self.closure;
        let Instant { volume, pressure, temperature, streams } = self.instant(time, y, actuation);
        let stirred = Stirred { inflow: y[STIRRED_IN], outflow: y[STIRRED_OUT] };
        let forced = self.heat.forced(&stirred, temperature);
        let film = self.heat.film(pressure, temperature, y[WALL], &forced, self.heat.whole());
        let convective =
            film.coefficient(streams.inflow) * self.surface_m2 * (temperature - y[WALL]);
        let work = pressure * volume_slope;
        let heat = closure.heat_of_streams(&streams, temperature, convective)
            + closure.heat_per_work() * work;
        let to_ambient = self.outer_w_k * (y[WALL] - self.piping.ambient().1);
        let volume_power = math::pow(volume, closure.exponent() - 1.0);
        let mut rates = [0.0; STATES];
        rates[MASS] = streams.net();
        rates[W] = closure.rate(volume_power, &streams, temperature, convective);
        rates[WALL] = (heat - to_ambient) / self.wall_j_k;
        rates[MASS_IN] = streams.inflow;
        rates[MASS_OUT] = streams.outflow;
        rates[ENTHALPY_IN] = closure.gas.cp * streams.inflow_temperature;
        rates[ENTHALPY_OUT] = closure.gas.cp * streams.outflow * temperature;
        rates[HEAT] = heat;
        rates[WORK] = work;
        rates[TO_AMBIENT] = to_ambient;
        [rates[STIRRED_IN], rates[STIRRED_OUT]] =
            self.heat.stirring_rates(&stirred, (streams.inflow, streams.outflow));
        rates
    }
}

#[derive(Debug, Clone)]
pub struct Vessel {
    constants: Constants,
    integrator: DormandPrince,
    steps: u64,
    state: [f64; STATES],
    truth: Truth,
    initial: Ledger,
    sensors: Sensors,
}

impl Vessel {
    /// The vessel of a scenario; `volume`, if present, replaces the fixed volume.
    ///
    /// # Errors
    /// [`BuildError::VolumeNotPositive`] for a profile that empties the vessel.
    pub fn new(scenario: &Scenario, volume: Option<Profile>) -> Result<Self, BuildError> {
        let volume = match volume {
            Some(profile) => profile.raised(scenario.vessel.dead_volume_m3),
            None => Profile::constant(scenario.vessel.volume_m3),
        };
        if let Some(&(time_s, volume_m3)) = volume.points().iter().find(|point| point.1 <= 0.0) {
            return Err(BuildError::VolumeNotPositive { time_s, volume_m3 });
        }
        let closure = Closure::new(scenario);
        let gas = &closure.gas;
        let constants = Constants {
            step_s: scenario.run.step_s,
            ports: Ports::of(scenario, gas),
            piping: Piping::new(scenario, gas),
            heat: InnerHeat::of_vessel(scenario),
            surface_m2: scenario.vessel.surface_m2,
            wall_j_k: scenario.vessel.wall_heat_capacity_j_k,
            outer_w_k: scenario.heat.outer_w_m2_k * scenario.vessel.surface_m2,
            section_m2: scenario.vessel.section_m2(),
            initial_k: scenario.plant.initial_temperature_k,
            closure,
            volume,
        };
        let volume = constants.volume.value(0.0);
        let start = Start::new(scenario, volume / constants.section_m2, volume);
        let mut state = [0.0; STATES];
        state[MASS] = start.mass(gas);
        state[W] = start.pressure * math::pow(volume, closure.exponent());
        state[WALL] = start.wall_k;
        let mut vessel = Self {
            sensors: Sensors::new(scenario, 0.0, &start.exposure()),
            integrator: DormandPrince::new(TOLERANCE, 1e-3 * constants.step_s),
            constants,
            steps: 0,
            state,
            truth: Truth::default(),
            initial: start.ledger(gas),
        };
        vessel.observe(Actuation::default());
        Ok(vessel)
    }

    /// Returns the same vessel without valves: the actuation is the mass flows \[kg/s\], with the
    /// inflow at `inflow_k` \[K\].
    pub fn driven_by_flows(mut self, inflow_k: f64) -> Self {
        self.constants.ports = Ports::Given { inflow_k };
        self
    }

    fn observe(&mut self, actuation: Actuation) {
        let constants = &self.constants;
        let time = self.steps as f64 * constants.step_s;
        let now = constants.instant(time, &self.state, actuation);
        self.truth = Truth {
            time_s: time,
            pressure_pa: now.pressure,
            volume_m3: now.volume,
            length_m: now.volume / constants.section_m2,
            speed_m_s: constants.volume.slope_after(time) / constants.section_m2,
            mass_kg: self.state[MASS],
            flow_in_kg_s: now.streams.inflow,
            flow_out_kg_s: now.streams.outflow,
            gas_temperature_k: now.temperature,
            wall_temperature_k: self.state[WALL],
            ..Truth::default()
        };
        self.sensors.read(&mut self.truth);
    }
}

impl Plant for Vessel {
    fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged> {
        let constants = &self.constants;
        let mut start = self.steps as f64 * constants.step_s;
        self.steps += 1;
        let end = self.steps as f64 * constants.step_s;
        while start < end {
            // The slope of the volume jumps at a knot: no step reaches across one.
            let stop = constants.volume.knot_after(start).map_or(end, |knot| knot.min(end));
            let slope = constants.volume.slope_after(start);
            let energy = constants.closure.internal_energy(&self.truth);
            let scales = [self.state[MASS], self.state[W], self.state[WALL], energy];
            self.integrator
                .advance(start, stop, &mut self.state, scales, |t, y| {
                    constants.rates(t, slope, y, actuation)
                })
                .map_err(|_| Diverged {
                    time_s: start,
                    state: format!("mass = {} kg, no step is small enough", self.state[MASS]),
                })?;
            start = stop;
        }
        let now = constants.instant(end, &self.state, actuation);
        check_gas(end, now.pressure, now.temperature, self.state[MASS], &self.truth)?;
        self.sensors.advance(&Exposure {
            gas_k: now.temperature,
            wall_k: self.state[WALL],
            pressure_pa: now.pressure,
            length_m: now.volume / constants.section_m2,
        });
        self.observe(actuation);
        Ok(())
    }

    fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError> {
        let Self { constants, sensors, .. } = Self::new(scenario, None)?;
        let kept = &self.constants;
        self.constants = Constants { ports: kept.ports, volume: kept.volume.clone(), ..constants };
        self.sensors.retune(&sensors);
        Ok(())
    }

    fn disturb(&mut self, disturbance: Disturbance) {
        self.constants.piping.disturb(disturbance);
    }

    fn truth(&self) -> Truth {
        self.truth
    }

    fn ledger(&self) -> Ledger {
        let y = &self.state;
        Ledger {
            mass_kg: y[MASS],
            mass_in_kg: y[MASS_IN],
            mass_out_kg: y[MASS_OUT],
            energy_j: self.constants.closure.internal_energy(&self.truth),
            enthalpy_in_j: y[ENTHALPY_IN],
            enthalpy_out_j: y[ENTHALPY_OUT],
            heat_to_wall_j: y[HEAT],
            work_j: y[WORK],
            heat_to_ambient_j: y[TO_AMBIENT],
            wall_energy_j: self.constants.wall_j_k * (y[WALL] - self.constants.initial_k),
            ..self.initial
        }
    }
}
