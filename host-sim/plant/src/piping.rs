//! Connections of the gas to supply and ambient, with their faults. Faults of the plant act only here.

use super::flow::{Iso6358, Streams};
use super::gas::IdealGas;
use thermyo_scenario::Scenario;

/// Faults of the plant; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbance {
    pub inlet: Travel,
    pub outlet: Travel,
    /// Sonic conductance of a hole from the gas to ambient, at ANR \[m3/(s Pa)\]; no larger than the scenario's
    /// largest, which sets the integration step. Its critical ratio is that of the valves.
    pub leak_m3_s_pa: f64,
    /// Absolute pressure of the supply at no flow, if it differs from the scenario \[Pa\].
    pub supply_pa: Option<f64>,
}

/// Flow of a valve at the ends of its travel, as fractions of its full conductance, 0 to 1. A stuck valve has equal
/// values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel {
    /// When driven shut.
    pub shut: f64,
    /// When driven open.
    pub open: f64,
}

impl Travel {
    /// Mean opening of a valve that is driven open for this fraction of the time.
    fn opening(&self, driven: f64) -> f64 {
        self.shut + (self.open - self.shut) * driven
    }
}

impl Default for Travel {
    fn default() -> Self {
        Self { shut: 0.0, open: 1.0 }
    }
}

/// Supply, inlet valve, outlet valve, ambient, the leak, and a hole if there is one. Gas flows
/// through each in the direction of the pressures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piping {
    valve: Iso6358,
    conductance_m3_s_pa: f64,
    leak: Option<Iso6358>,
    supply: (f64, f64),
    ambient: (f64, f64),
    broken: Disturbance,
    /// The hole's conductance, in open valves.
    hole: f64,
}

impl Piping {
    /// The piping of a scenario, without faults.
    pub fn new(scenario: &Scenario, gas: &IdealGas) -> Self {
        let Scenario { valve, leak, .. } = scenario;
        Self {
            valve: Iso6358::valve(valve.conductance_m3_s_pa, valve.critical_ratio, gas),
            conductance_m3_s_pa: valve.conductance_m3_s_pa,
            leak: Iso6358::leak(leak.conductance_m3_s_pa, leak.critical_ratio, gas),
            supply: (scenario.supply.pressure_pa, scenario.supply.temperature_k),
            ambient: (scenario.ambient.pressure_pa, scenario.ambient.temperature_k),
            broken: Disturbance::default(),
            hole: 0.0,
        }
    }

    /// Sets the faults from now on.
    pub fn disturb(&mut self, disturbance: Disturbance) {
        self.broken = disturbance;
        self.hole = self.in_valves(disturbance.leak_m3_s_pa);
    }

    /// Pressure \[Pa\] and temperature \[K\] of the supply at no flow.
    pub fn supply(&self) -> (f64, f64) {
        (self.broken.supply_pa.unwrap_or(self.supply.0), self.supply.1)
    }

    /// Pressure \[Pa\] and temperature \[K\] of the surroundings.
    pub fn ambient(&self) -> (f64, f64) {
        self.ambient
    }

    pub fn is_holed(&self) -> bool {
        self.broken.leak_m3_s_pa > 0.0
    }

    /// [`Iso6358::steepest`] of the leak, in open valves.
    pub fn leak_in_valves(&self, upstream_k: f64) -> f64 {
        self.leak.map_or(0.0, |leak| leak.steepest(upstream_k) / self.steepest(upstream_k))
    }

    /// A hole's conductance, in open valves.
    pub fn in_valves(&self, leak_m3_s_pa: f64) -> f64 {
        leak_m3_s_pa / self.conductance_m3_s_pa
    }

    /// [`Iso6358::steepest`] of one open valve.
    pub fn steepest(&self, upstream_k: f64) -> f64 {
        self.valve.steepest(upstream_k)
    }

    /// Mass flow through the inlet into vacuum, the largest possible inflow \[kg/s\].
    pub fn largest_inflow(&self) -> f64 {
        self.valve.mass_flow(self.supply.0, self.supply.1, 0.0)
    }

    /// Sum of the openings of both valves for these duties \[-\].
    pub fn openings(&self, inlet: f64, outlet: f64) -> f64 {
        self.broken.inlet.opening(inlet) + self.broken.outlet.opening(outlet)
    }

    /// Adds the flow through the inlet valve to gas (p, T), with the supply `drop_pa` below its pressure at no flow.
    pub fn add_inlet(&self, streams: &mut Streams, gas: (f64, f64), drop_pa: f64, driven: f64) {
        let (pressure, temperature) = self.supply();
        let opening = self.broken.inlet.opening(driven);
        self.add(streams, gas, (pressure - drop_pa, temperature), opening);
    }

    /// Adds the flow through the outlet valve from gas (p, T).
    pub fn add_outlet(&self, streams: &mut Streams, gas: (f64, f64), driven: f64) {
        self.add(streams, gas, self.ambient, self.broken.outlet.opening(driven));
    }

    /// Adds the leak from gas (p, T), and the flow through the hole.
    pub fn add_leak(&self, streams: &mut Streams, gas: (f64, f64)) {
        if let Some(leak) = &self.leak {
            streams.add(gas, self.ambient, |p, t, q| leak.mass_flow(p, t, q));
        }
        self.add(streams, gas, self.ambient, self.hole);
    }

    fn add(&self, streams: &mut Streams, gas: (f64, f64), reservoir: (f64, f64), valves: f64) {
        if valves > 0.0 {
            streams.add(gas, reservoir, |p, t, q| valves * self.valve.mass_flow(p, t, q));
        }
    }
}
