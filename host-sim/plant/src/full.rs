//! What moves, in full: axial zones, two wall layers, moving mass and bristle friction, switching valves,
//! tube, regulator, sensor housing.
//!
//! Integration is of fourth order. It stops at every kink of the valves' openings, so that each of its steps sees
//! them move straight. While both are shut its steps are longer: the tube is slower, and no flow law's kink matters.
//! Books are kept at the chamber's port: the tube is outside. A hole in it is beside the port.

use super::bristle::Drag;
use super::chamber::Chamber;
use super::closure::Closure;
use super::end::{End, Ends, Falling};
use super::flow::{Iso6358, Streams};
use super::gas::IdealGas;
use super::heat::{Film, HEAT_TOO_LARGE, InnerHeat, REFRESH_S, Section, Stirred};
use super::line::Line;
use super::local_power::LocalPower;
use super::ode::Rk4;
use super::piping::{Disturbance, Piping};
use super::pull::{Pull, Softening};
use super::pwm::PwmValve;
use super::radial::Place;
use super::sensors::{Exposure, Sensors};
use super::zones::Stirring;
use super::{
    Actuation, BuildError, Diverged, Ledger, Plant, Substeps, Truth, check_gas, check_length,
};
use thermyo_compute::math;
use thermyo_scenario::{LoadKind, Scenario};

/// Longest integration step while a valve is open, and while both are shut \[s\].
const LONGEST_OPEN_S: f64 = 1.0e-4;
const LONGEST_SHUT_S: f64 = 2.5e-4;
/// Integration step times the fastest rate, at most; RK4 is stable to 2.8.
const STEP_TIMES_RATE: f64 = 2.0;
/// Integration step times the angular frequency of what swings without damping, at most: the books close only where a
/// swing is resolved.
const STEP_TIMES_SWING: f64 = 0.5;
/// Largest share of the volume that moves past in an integration step: work is resolved near the end of a small volume.
const MOST_SWEPT: f64 = 0.02;
/// An end hardly moves faster \[m/s\].
const FASTEST_M_S: f64 = 10.0;
/// Response of the pressure regulator to a change of flow \[s\].
const REGULATOR_TIME_CONSTANT_S: f64 = 0.02;

// Places in the state vector; masses, inner and outer wall temperatures of the zones follow, then a line.
const W: usize = 0;
const LENGTH: usize = 1;
const SPEED: usize = 2;
const BRISTLE: usize = 3;
const TUBE_MASS: usize = 4;
const TUBE_ENERGY: usize = 5;
const REGULATOR: usize = 6;
const MASS_IN: usize = 7;
const MASS_OUT: usize = 8;
const ENTHALPY_IN: usize = 9;
const ENTHALPY_OUT: usize = 10;
const HEAT: usize = 11;
const TO_AMBIENT: usize = 12;
const FRICTION: usize = 13;
const FRICTION_TO_WALL: usize = 14;
const WORK: usize = 15;
const ZONES: usize = 16;

/// Everything that does not change during a run.
#[derive(Debug, Clone)]
struct Constants<C> {
    step_s: f64,
    /// While a valve is open, and while both are shut.
    open: Substeps,
    shut: Substeps,
    zones: usize,
    closure: Closure,
    pull: Pull<C>,
    isometric: bool,
    ends: Ends,
    softening: Softening,
    friction_to_wall: f64,
    piping: Piping,
    tube: Iso6358,
    tube_m3: f64,
    line: Option<Line>,
    /// Pressure per energy of the tube's gas \[Pa/J\].
    tube_pa_j: f64,
    droop_pa_s_kg: f64,
    heat: InnerHeat,
    stirring: Stirring,
    outer_w_m2_k: f64,
    outer_per_speed: f64,
    /// 1 over the number of zones.
    share: f64,
    /// Heat capacity of one zone's inner and outer layer \[J/K\], and 1 over it.
    inner_j_k: f64,
    outer_j_k: f64,
    inner_k_j: f64,
    outer_k_j: f64,
    /// Conductance between the layers of one zone \[W/K\].
    layers_w_k: f64,
    initial_k: f64,
    /// Weight of each zone in the foil's average.
    foil: Vec<f64>,
    foil_place: Place,
    wall_sensor_position: f64,
}

/// What acts at one instant.
#[derive(Debug, Clone, Copy)]
struct Drive {
    /// Opening of the valves \[-\].
    inlet: f64,
    outlet: f64,
    /// Factor on friction \[-\].
    softening: f64,
}

impl Drive {
    /// That share of the way to another one.
    fn towards(&self, end: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            inlet: between(self.inlet, end.inlet),
            outlet: between(self.outlet, end.outlet),
            softening: self.softening,
        }
    }
}

/// Where a run starts.
struct Start {
    pressure: f64,
    gas_k: f64,
    wall_k: f64,
    length: f64,
    volume: f64,
    /// Deflection of the bristles \[m\].
    deflection: f64,
}

impl Start {
    fn new<C: Chamber>(scenario: &Scenario, pull: &Pull<C>) -> Self {
        let Scenario { friction, load, plant, .. } = scenario;
        let pressure = plant.initial_pressure_pa;
        let wall_k = plant.initial_temperature_k;
        let coulomb = friction.force_n * Softening::new(friction).factor(wall_k);
        let isometric = load.kind == LoadKind::Isometric;
        let length = if isometric { load.length_m } else { pull.start_length(pressure, coulomb) };
        let mut deflection = 0.0;
        if !isometric && friction.presliding_stiffness_n_m > 0.0 {
            // What a stop carries, friction need not.
            let [shortest, longest] = pull.stops;
            let excess = pull.force(pressure, length) - pull.load_n;
            let held = excess.clamp(
                if length < longest { -coulomb } else { 0.0 },
                if length > shortest { coulomb } else { 0.0 },
            );
            deflection = held / friction.presliding_stiffness_n_m;
        }
        Self {
            pressure,
            gas_k: plant.gas_k(),
            wall_k,
            length,
            volume: pull.chamber.volume(length),
            deflection,
        }
    }

    fn mass(&self, gas: &IdealGas) -> f64 {
        self.pressure * self.volume / (gas.r * self.gas_k)
    }
}

/// Where the gas flows: from the valves to the muscle.
struct Way<'a> {
    piping: &'a Piping,
    tube: &'a Iso6358,
    tube_m3: f64,
    line: Option<&'a Line>,
}

/// Hottest that gas gets upstream \[K\].
fn hottest_k(scenario: &Scenario) -> f64 {
    let plant = &scenario.plant;
    scenario.supply.temperature_k.max(plant.initial_temperature_k).max(plant.gas_k())
}

/// A rate \[1/s\] and the keys that make it so fast.
type Rate = (f64, &'static str);

fn fastest(rates: impl IntoIterator<Item = Rate>) -> Rate {
    rates.into_iter().fold((0.0, ""), |most, rate| if rate.0 >= most.0 { rate } else { most })
}

/// Substeps of a step, while a valve is open, and while both are shut: [`STEP_TIMES_RATE`] over the fastest rate.
///
/// The pressures of tube and muscle, of `smallest` volume \[m3\], are joined by the port. The sum of the rates at which each
/// follows the other alone is the trace of that system, whose eigenvalues are real and negative: none is faster.
fn substeps(
    scenario: &Scenario,
    gas: &IdealGas,
    way: &Way<'_>,
    others: &[Rate],
    smallest: f64,
) -> Result<[Substeps; 2], BuildError> {
    let Way { piping, tube, tube_m3, line } = way;
    let plant = &scenario.plant;
    let supply = piping.supply();
    let hottest = hottest_k(scenario);
    let per_flow = gas.k * gas.r * hottest;
    let port = tube.steepest(hottest);
    // The port is at the tube, or at the other end of a line.
    let (beside_tube, line_rate) = match line {
        None => (port, 0.0),
        Some(line) => {
            let least_pa = piping.ambient().0.min(plant.initial_pressure_pa).min(supply.0);
            (0.0, line.fastest_rate(port, least_pa, hottest))
        }
    };
    let chamber_rate = per_flow * port / smallest;
    let of = |longest: f64, valves: f64| {
        let tube_rate = per_flow * (valves * piping.steepest(hottest) + beside_tube) / tube_m3;
        let joined = [
            (tube_rate, "tube.volume_m3 is too small for the conductances of valve and tube"),
            (
                chamber_rate,
                "the chamber's smallest volume is too small for tube.conductance_m3_s_pa",
            ),
            (
                line_rate,
                "tube.length_m is too short, or tube.diameter_m too small, for a line in cells",
            ),
        ];
        Substeps::new(scenario, piping, hottest, |leak, leak_too_large| {
            let leak_rate = per_flow * leak * piping.steepest(hottest) / smallest;
            let joined = joined.into_iter().chain([(leak_rate, leak_too_large)]);
            let together = (joined.clone().map(|rate| rate.0).sum(), fastest(joined).1);
            let (rate, because) = fastest(others.iter().copied().chain([together]));
            super::substeps(scenario.run.step_s, longest.min(STEP_TIMES_RATE / rate), because)
        })
    };
    Ok([of(LONGEST_OPEN_S, 2.0)?, of(LONGEST_SHUT_S, 0.0)?])
}

impl<C: Chamber> Constants<C> {
    fn new(scenario: &Scenario, pull: Pull<C>, start: &Start) -> Result<Self, BuildError> {
        let chamber = &pull.chamber;
        let rest_length = chamber.rest_length();
        let diameter = chamber.diameter(rest_length);
        let zones = chamber.zones().max(1);
        let closure = Closure::new(scenario);
        let gas = closure.gas;
        let piping = Piping::new(scenario, &gas);
        let line = Line::new(scenario, &gas);
        let tube = Iso6358::port(&scenario.tube, scenario.valve.critical_ratio, &gas);
        let tube_m3 = scenario.tube.volume_m3 + line.as_ref().map_or(0.0, Line::half_cell_m3);
        let ends = Ends::new(scenario, pull.load_n, chamber.pushes());
        let way = Way { piping: &piping, tube: &tube, tube_m3, line: line.as_ref() };
        let smallest = chamber.volume(rest_length).min(start.volume);
        let Scenario { wall, sensor, heat, plant, .. } = scenario;
        let share = 1.0 / zones as f64;
        let inner_j_k = share * wall.heat_capacity_j_k * (1.0 - wall.outer_fraction);
        let outer_j_k = share * wall.heat_capacity_j_k * wall.outer_fraction;
        let layers_w_k = share * wall.conductance_w_k;
        let gas_length = chamber.gas_length(rest_length);
        let stirring = Stirring::new(zones, gas_length, diameter);
        let inner = InnerHeat::of_chamber(scenario, diameter, gas_length);
        let softening = Softening::new(&scenario.friction);
        let supply = piping.supply();
        let passes = piping.largest_inflow().min(tube.mass_flow(supply.0, supply.1, 0.0));
        let shares = stirring.largest();
        let coldest_k = plant.initial_temperature_k.min(scenario.ambient.temperature_k);
        let least_pa = piping.ambient().0.min(plant.initial_pressure_pa);
        let most_pa = supply.0.max(plant.initial_pressure_pa);
        let still = (least_pa, plant.initial_temperature_k);
        let space = (chamber.volume(rest_length), chamber.surface(rest_length));
        let into_wall = {
            let [from, to] = chamber.lengths().map(|length| chamber.surface(length));
            let (_, gas_k) = still;
            let surface = from.max(to).max(space.1);
            let within = inner.largest(most_pa, gas_k, piping.largest_inflow(), &shares);
            let outside = heat.outer_w_m2_k + heat.outer_per_speed * FASTEST_M_S;
            share * surface * (within / inner_j_k + outside / outer_j_k)
        };
        let area =
            chamber.force_area(rest_length).abs().max(chamber.force_area(start.length).abs());
        // What the gas in the smallest volume, and what is elastic, push back with.
        let spring_n_m =
            gas.k * most_pa * area * area / smallest + chamber.elastic_slope(rest_length).abs();
        // Volume flows through the port at the muscle's pressure: in, where the jet stirs too, and out.
        let volume_in = passes * gas.r * supply.1 / least_pa;
        let volume_out =
            tube.mass_flow(1.0, hottest_k(scenario), 0.0) * gas.r * hottest_k(scenario);
        let turnover =
            stirring.fastest_rate(smallest, chamber.gas_length(rest_length), volume_in, volume_out);
        let others = [
            (
                ends.fastest_rate(softening.factor(coldest_k).max(1.0)),
                "friction.presliding_stiffness_n_m or friction.viscous_n_s_m is too large for load.mass_kg, or for the 50 g of a muscle's slack end",
            ),
            (
                STEP_TIMES_RATE / STEP_TIMES_SWING * ends.fastest_swing(spring_n_m),
                "the gas in the chamber's smallest volume, or its spring, is too stiff for load.mass_kg, or for the 50 g of an end without a load",
            ),
            (
                turnover,
                "the chamber's smallest volume is too small for the conductances of valve and tube, or plant.initial_pressure_pa is too low, or there are too many zones",
            ),
            (
                inner.fastest_rate(&gas, still, space, (piping.largest_inflow(), &shares)),
                HEAT_TOO_LARGE,
            ),
            (
                into_wall + layers_w_k * (1.0 / inner_j_k + 1.0 / outer_j_k),
                "wall.heat_capacity_j_k is too small for wall.conductance_w_k and what [heat] transfers",
            ),
        ];
        let [open, shut] = substeps(scenario, &gas, &way, &others, smallest)?;
        Ok(Self {
            step_s: scenario.run.step_s,
            open,
            shut,
            zones,
            closure,
            isometric: scenario.load.kind == LoadKind::Isometric,
            ends,
            softening,
            friction_to_wall: scenario.friction.heat_fraction,
            piping,
            tube,
            tube_m3,
            tube_pa_j: (gas.k - 1.0) / tube_m3,
            line,
            droop_pa_s_kg: scenario.supply.droop_pa_s_kg,
            heat: inner,
            stirring,
            outer_w_m2_k: heat.outer_w_m2_k,
            outer_per_speed: heat.outer_per_speed,
            share,
            inner_j_k,
            outer_j_k,
            inner_k_j: 1.0 / inner_j_k,
            outer_k_j: 1.0 / outer_j_k,
            layers_w_k,
            initial_k: start.wall_k,
            foil: foil_weights(zones, sensor.gas.position, sensor.gas.span),
            foil_place: Place::at(sensor.gas.radius),
            wall_sensor_position: sensor.wall.position,
            pull,
        })
    }

    /// The state at the start.
    fn state(&self, start: &Start) -> Vec<f64> {
        let Start { pressure, gas_k, .. } = *start;
        let gas = &self.closure.gas;
        let line_states = self.line.as_ref().map_or(0, Line::states);
        let mut state = vec![start.wall_k; self.line_at() + line_states];
        state[..ZONES].fill(0.0);
        state[W] = pressure * math::pow(start.volume, self.closure.exponent());
        state[LENGTH] = start.length;
        state[BRISTLE] = start.deflection;
        state[TUBE_MASS] = pressure * self.tube_m3 / (gas.r * gas_k);
        state[TUBE_ENERGY] = pressure * self.tube_m3 / (gas.k - 1.0);
        state[ZONES..ZONES + self.zones].fill(start.mass(gas) / self.zones as f64);
        if let Some(line) = &self.line {
            line.fill(pressure, gas_k, &mut state[self.line_at()..]);
        }
        state
    }

    fn masses<'a>(&self, y: &'a [f64]) -> &'a [f64] {
        &y[ZONES..ZONES + self.zones]
    }

    fn inner<'a>(&self, y: &'a [f64]) -> &'a [f64] {
        &y[ZONES + self.zones..ZONES + 2 * self.zones]
    }

    fn outer<'a>(&self, y: &'a [f64]) -> &'a [f64] {
        &y[ZONES + 2 * self.zones..self.line_at()]
    }

    /// Place of a line's first state.
    fn line_at(&self) -> usize {
        ZONES + 3 * self.zones
    }

    /// Tube pressure \[Pa\] and temperature \[K\].
    fn tube_gas(&self, y: &[f64]) -> (f64, f64) {
        let gas = &self.closure.gas;
        (self.tube_pa_j * y[TUBE_ENERGY], y[TUBE_ENERGY] / (gas.cv * y[TUBE_MASS]))
    }

    /// Flow between tube, or line, and muscle, seen from the muscle.
    fn port(&self, y: &[f64], gas: (f64, f64), tube: (f64, f64)) -> Streams {
        let outside = self.line.as_ref().map_or(tube, |line| line.end(&y[self.line_at()..]));
        let mut streams = Streams::default();
        streams.add(gas, outside, |p, t, q| self.tube.mass_flow(p, t, q));
        streams
    }

    /// Rates of tube and regulator; `leaving` the tube, a mass flow and its enthalpy over cp.
    fn tube_rates(
        &self,
        y: &[f64],
        tube: (f64, f64),
        leaving: (f64, f64),
        drive: &Drive,
        rates: &mut [f64],
    ) {
        let droop_pa = self.droop_pa_s_kg * y[REGULATOR];
        let mut from_supply = Streams::default();
        self.piping.add_inlet(&mut from_supply, tube, droop_pa, drive.inlet);
        let mut valves = from_supply;
        self.piping.add_outlet(&mut valves, tube, drive.outlet);
        rates[TUBE_MASS] = valves.net() - leaving.0;
        rates[TUBE_ENERGY] =
            self.closure.gas.cp * (valves.net_enthalpy_over_cp(tube.1) - leaving.1);
        rates[REGULATOR] = (from_supply.inflow - y[REGULATOR]) * (1.0 / REGULATOR_TIME_CONSTANT_S);
    }

    /// Friction, and the rates of length, speed and bristles.
    fn mechanics(
        &self,
        y: &[f64],
        pressure: f64,
        end: &End,
        softening: f64,
        rates: &mut [f64],
    ) -> Drag {
        rates[LENGTH..=BRISTLE].fill(0.0);
        if self.isometric {
            return Drag::default();
        }
        let speed = y[SPEED];
        let drag = end.bristle.drag(speed, y[BRISTLE], softening);
        let net = self.pull.force(pressure, y[LENGTH]) - end.load_n - drag.force;
        // On a stop the load rests until it is lifted off.
        let [shortest, longest] = self.pull.stops;
        let outside = y[LENGTH] >= longest && speed <= 0.0 && net <= 0.0;
        let inside = y[LENGTH] <= shortest && speed >= 0.0 && net >= 0.0;
        if !(outside || inside) {
            rates[LENGTH] = -speed;
            rates[SPEED] = net * end.per_mass_kg;
            rates[BRISTLE] = drag.deflection_rate;
        }
        drag
    }

    /// Pressure \[Pa\] and volume \[m3\].
    fn place(&self, y: &[f64], power: &mut LocalPower) -> (f64, f64) {
        let volume = self.pull.chamber.volume(y[LENGTH]);
        (y[W] * power.at(volume), volume)
    }

    /// Sets what has gone beyond a stop back onto it.
    fn stop(&self, y: &mut [f64], power: &mut LocalPower) {
        let [shortest, longest] = self.pull.stops;
        let beyond = y[LENGTH] > longest || y[LENGTH] < shortest;
        if !beyond || self.isometric {
            return;
        }
        let (before_pa, before_m3) = self.place(y, power);
        if y[LENGTH] > longest {
            y[LENGTH] = longest;
            y[SPEED] = y[SPEED].max(0.0);
        } else {
            y[LENGTH] = shortest;
            y[SPEED] = y[SPEED].min(0.0);
        }
        let (pressure, volume) = self.place(y, power);
        let work = self.closure.work(before_pa, before_m3, pressure, volume);
        let heat = self.closure.heat_per_work() * work;
        y[WORK] += work;
        y[HEAT] += heat;
        for inner in &mut y[ZONES + self.zones..ZONES + 2 * self.zones] {
            *inner += self.share * heat * self.inner_k_j;
        }
    }

    /// Into how many parts a step \[s\] is divided, so that each sweeps no more than [`MOST_SWEPT`] of the volume.
    fn parts(&self, y: &[f64], step: f64) -> u32 {
        let chamber = &self.pull.chamber;
        let swept_m3 = step * (chamber.force_area(y[LENGTH]) * y[SPEED]).abs();
        (swept_m3 / (MOST_SWEPT * chamber.volume(y[LENGTH]))).ceil().max(1.0) as u32
    }

    /// Where the load is after a step; see [`Ends::hang`].
    fn hang(
        &self,
        y: &mut [f64],
        acceleration: f64,
        step: f64,
        falling: Option<Falling>,
    ) -> Option<Falling> {
        if self.isometric {
            return None;
        }
        let (falling, speed) = self.ends.hang(falling, step, (y[LENGTH], y[SPEED]), acceleration);
        // Caught on the stop, it rests.
        y[SPEED] = if y[LENGTH] < self.pull.stops[1] { speed } else { speed.max(0.0) };
        falling
    }

    /// All rates.
    fn rates(
        &self,
        y: &[f64],
        power: &mut LocalPower,
        air: &[Section],
        end: &End,
        drive: &Drive,
        rates: &mut [f64],
    ) {
        let closure = &self.closure;
        let gas = &closure.gas;
        let Self { zones, share, .. } = *self;
        let length = y[LENGTH];
        let volume = self.pull.chamber.volume(length);
        let inverse_power = power.at(volume);
        let pressure = y[W] * inverse_power;
        let drag = self.mechanics(y, pressure, end, drive.softening, rates);
        let (masses, inner, outer) = (self.masses(y), self.inner(y), self.outer(y));
        let zone_volume = share * volume;

        let tube = self.tube_gas(y);
        let port_k = closure.temperature(pressure, zone_volume, masses[0]);
        let port = self.port(y, (pressure, port_k), tube);
        let into_muscle = (port.net(), port.net_enthalpy_over_cp(port_k));
        let (rates, line_rates) = rates.split_at_mut(self.line_at());
        let leaving = match &self.line {
            Some(line) => line.rates(&y[self.line_at()..], tube, into_muscle, line_rates),
            None => into_muscle,
        };
        self.tube_rates(y, tube, leaving, drive, rates);
        let mut streams = port;
        self.piping.add_leak(&mut streams, (pressure, port_k));

        let length_rate = rates[LENGTH];
        let (zone_rates, wall_rates) = rates[ZONES..].split_at_mut(zones);
        let (inner_rates, outer_rates) = wall_rates.split_at_mut(zones);
        let gas_length = self.pull.chamber.gas_length(length);
        let surface = share * self.pull.chamber.surface(length);
        // Until they are known, the place of the outer layer's rates holds the zones' temperatures.
        let zones_k = &mut *outer_rates;
        for (zone_k, mass) in zones_k.iter_mut().zip(masses) {
            *zone_k = closure.temperature(pressure, zone_volume, *mass);
        }
        let walls = inner_rates.iter_mut().zip(inner);
        for (((rate, inner_k), zone_k), section) in walls.zip(&*zones_k).zip(air) {
            *rate = surface * section.film.flux(streams.inflow, zone_k - inner_k);
        }
        let convective = inner_rates.iter().fold(0.0, |sum, heat| sum + heat);
        // dV/dL is -force_area.
        let work = -pressure * self.pull.chamber.force_area(length) * length_rate;
        let heat =
            closure.heat_of_streams(&streams, port_k, convective) + closure.heat_per_work() * work;
        // What a closure adds to convection spreads evenly.
        let implied = share * (heat - convective);

        // Gas: enthalpy over the faces, from the closed end to the port.
        let gain = share * (gas.cp * streams.net_enthalpy_over_cp(port_k) - convective);
        let volume_inflow = streams.inflow_temperature * gas.r / pressure;
        let background = self.stirring.background(volume, gas_length);
        // One over cp T is the mass times this; eq. (1).
        let per_enthalpy = gas.r / (gas.cp * pressure * zone_volume);
        let per_zone_m3 = 1.0 / zone_volume;
        let (mut enthalpy, mut beyond) = (0.0, 0.0);
        for i in (1..zones).rev() {
            enthalpy += gain + inner_rates[i];
            let flow = if closure.is_isothermal() {
                // Equal temperatures: equal masses, so that each zone takes its share.
                share * (zones - i) as f64 * streams.net()
            } else {
                let upwind = masses[if enthalpy > 0.0 { i - 1 } else { i }];
                let exchange = self.stirring.exchange(i - 1, volume_inflow, background);
                let mixing = exchange * (masses[i - 1] - masses[i]) * per_zone_m3;
                enthalpy * upwind * per_enthalpy + mixing
            };
            zone_rates[i] = flow - beyond;
            beyond = flow;
        }
        zone_rates[0] = streams.net() - beyond;

        // Walls: friction heats the braid, the outer layer.
        let speed = if self.isometric { 0.0 } else { y[SPEED].abs() };
        let outer_coefficient = self.outer_w_m2_k + self.outer_per_speed * speed;
        let friction_to_wall = self.friction_to_wall * drag.heat;
        let mut to_ambient = 0.0;
        let layers = inner_rates.iter_mut().zip(outer_rates).zip(inner.iter().zip(outer));
        for ((inner_rate, outer_rate), (inner_k, outer_k)) in layers {
            let through = self.layers_w_k * (inner_k - outer_k);
            let lost = outer_coefficient * surface * (outer_k - self.piping.ambient().1);
            to_ambient += lost;
            *inner_rate = (*inner_rate + implied - through) * self.inner_k_j;
            *outer_rate = (through + share * friction_to_wall - lost) * self.outer_k_j;
        }
        rates[W] = closure.rate(1.0 / (inverse_power * volume), &streams, port_k, convective);
        rates[MASS_IN] = streams.inflow;
        rates[MASS_OUT] = streams.outflow;
        rates[ENTHALPY_IN] = gas.cp * streams.inflow_temperature;
        rates[ENTHALPY_OUT] = gas.cp * streams.outflow * port_k;
        rates[HEAT] = heat;
        rates[TO_AMBIENT] = to_ambient;
        rates[FRICTION] = drag.heat;
        rates[FRICTION_TO_WALL] = friction_to_wall;
        rates[WORK] = work;
    }

    /// Mean wall temperature \[K\], weighted by heat capacity.
    fn wall_k(&self, y: &[f64]) -> f64 {
        let mean = |layer: &[f64]| layer.iter().sum::<f64>() / self.zones as f64;
        (self.inner_j_k * mean(self.inner(y)) + self.outer_j_k * mean(self.outer(y)))
            / (self.inner_j_k + self.outer_j_k)
    }

    /// Outer layer at the wall sensor \[K\], linear between the middles of the zones.
    fn wall_at_sensor(&self, y: &[f64]) -> f64 {
        let outer = self.outer(y);
        let place = (self.wall_sensor_position * self.zones as f64 - 0.5)
            .clamp(0.0, (self.zones - 1) as f64);
        let before = place.floor() as usize;
        let after = (before + 1).min(self.zones - 1);
        outer[before] + (place - before as f64) * (outer[after] - outer[before])
    }
}

/// Share of the foil, in the middle `position` over `span` of the length, that each zone holds.
fn foil_weights(zones: usize, position: f64, span: f64) -> Vec<f64> {
    let edge = |i: usize| i as f64 / zones as f64;
    // A foil of no length still sits in one zone.
    let half = 0.5 * span.max(1e-9);
    let (start, end) = ((position - half).max(0.0), (position + half).min(1.0));
    (0..zones)
        .map(|i| (edge(i + 1).min(end) - edge(i).max(start)).max(0.0) / (end - start))
        .collect()
}

/// How the gas stirs, and its profile in the zones, until they are refreshed.
#[derive(Debug, Clone)]
struct AirNow {
    stirred: Stirred,
    sections: Vec<Section>,
    /// When they were refreshed \[s\], and what had flowed in and out by then \[kg\].
    since_s: f64,
    flowed_kg: [f64; 2],
}

impl AirNow {
    fn new<C: Chamber>(constants: &Constants<C>, state: &[f64], place: (f64, f64)) -> Self {
        let mut air = Self {
            stirred: Stirred::default(),
            sections: vec![Section::flat(Film::default()); constants.zones],
            since_s: 0.0,
            flowed_kg: [0.0; 2],
        };
        air.set_sections(constants, state, place);
        air
    }

    fn refresh<C: Chamber>(
        &mut self,
        constants: &Constants<C>,
        state: &[f64],
        place: (f64, f64),
        now_s: f64,
    ) {
        let step_s = now_s - self.since_s;
        let flowed_kg = [state[MASS_IN], state[MASS_OUT]];
        let [inflow, outflow] = [0, 1].map(|i| (flowed_kg[i] - self.flowed_kg[i]) / step_s);
        self.stirred = constants.heat.stirred(&self.stirred, (inflow, outflow), step_s);
        (self.since_s, self.flowed_kg) = (now_s, flowed_kg);
        self.set_sections(constants, state, place);
    }

    fn set_sections<C: Chamber>(
        &mut self,
        constants: &Constants<C>,
        state: &[f64],
        (pressure, volume): (f64, f64),
    ) {
        let zone_m3 = constants.share * volume;
        let (masses, inner) = (constants.masses(state), constants.inner(state));
        let forced = constants.heat.forced(&self.stirred, inner[0]);
        let zones = masses.iter().zip(inner).zip(constants.stirring.zones());
        for (section, ((mass, wall_k), shares)) in self.sections.iter_mut().zip(zones) {
            let gas_k = constants.closure.temperature(pressure, zone_m3, *mass);
            let state = (pressure, gas_k, *wall_k);
            *section = constants.heat.section(section, state, &forced, shares);
        }
    }
}

/// A full plant in operation.
#[derive(Debug, Clone)]
pub struct Full<C> {
    constants: Constants<C>,
    steps: u64,
    state: Vec<f64>,
    falling: Option<Falling>,
    integrator: Rk4,
    power: LocalPower,
    air: AirNow,
    inlet: PwmValve,
    outlet: PwmValve,
    /// Pressure \[Pa\] and volume \[m3\] now.
    place: (f64, f64),
    truth: Truth,
    initial: Ledger,
    sensors: Sensors,
}

impl<C: Chamber + Copy + Send> Full<C> {
    /// The full plant of a scenario with that chamber.
    ///
    /// # Errors
    /// [`BuildError::TooFast`].
    pub fn new(scenario: &Scenario, chamber: C) -> Result<Self, BuildError> {
        let pull = Pull::new(scenario, chamber);
        let start = Start::new(scenario, &pull);
        let constants = Constants::new(scenario, pull, &start)?;
        let state = constants.state(&start);
        let closure = &constants.closure;
        let mass = start.mass(&closure.gas);
        let housing_s = scenario.sensor.gas.housing_time_constant_s;
        let exposure = Exposure {
            gas_k: start.gas_k,
            wall_k: start.wall_k,
            pressure_pa: start.pressure,
            length_m: start.length,
        };
        let mut full = Self {
            integrator: Rk4::new(state.len()),
            steps: 0,
            falling: None,
            power: LocalPower::new(-closure.exponent(), start.volume),
            air: AirNow::new(&constants, &state, (start.pressure, start.volume)),
            inlet: PwmValve::new(&scenario.valve),
            outlet: PwmValve::new(&scenario.valve),
            place: (start.pressure, start.volume),
            state,
            truth: Truth::default(),
            initial: Ledger {
                mass_initial_kg: mass,
                energy_initial_j: closure.gas.cv * mass * start.gas_k,
                ..Ledger::default()
            },
            sensors: Sensors::new(scenario, housing_s, &exposure),
            constants,
        };
        full.observe();
        Ok(full)
    }

    /// From one instant to another, between which the valves move straight.
    fn stretch(&mut self, duration: f64, start: &Drive, end: &Drive) {
        let Self { constants, integrator, state, power, air, falling, .. } = self;
        let opening = |drive: &Drive| constants.piping.openings(drive.inlet, drive.outlet);
        let open = opening(start) > 0.0 || opening(end) > 0.0;
        let substeps = if open { &constants.open } else { &constants.shut };
        let longest = constants.step_s / f64::from(substeps.now(&constants.piping));
        // As in `substeps`.
        let count = (duration / longest - 1e-9).ceil().max(1.0);
        let step = duration / count;
        for i in 0..count as u32 {
            let parts = constants.parts(state, step);
            let step = step / f64::from(parts);
            for part in 0..parts {
                let moving = constants.ends.moving(*falling);
                integrator.step(state, step, |share, y, rates| {
                    let share = (f64::from(part) + share) / f64::from(parts);
                    let drive = start.towards(end, (f64::from(i) + share) / count);
                    constants.rates(y, power, &air.sections, moving, &drive, rates);
                });
                constants.stop(state, power);
                let acceleration = integrator.last_rates()[SPEED];
                *falling = constants.hang(state, acceleration, step, *falling);
            }
        }
    }

    fn exposure(&self) -> Exposure {
        let constants = &self.constants;
        let zones = self.axial_gas_k().into_iter().zip(constants.inner(&self.state));
        let at_foil = zones.zip(&self.air.sections).map(|((gas_k, wall_k), section)| {
            gas_k + section.above_mean(&constants.foil_place, gas_k - wall_k)
        });
        Exposure {
            gas_k: at_foil.zip(&constants.foil).map(|(t, weight)| t * weight).sum(),
            wall_k: constants.wall_at_sensor(&self.state),
            pressure_pa: self.place.0,
            length_m: self.state[LENGTH],
        }
    }

    fn observe(&mut self) {
        let Self { constants, state, .. } = self;
        let (pressure, volume) = self.place;
        let closure = &constants.closure;
        let mass: f64 = constants.masses(state).iter().sum();
        let port_volume = volume / constants.zones as f64;
        let port_k = closure.temperature(pressure, port_volume, constants.masses(state)[0]);
        let tube = constants.tube_gas(state);
        let mut streams = constants.port(state, (pressure, port_k), tube);
        constants.piping.add_leak(&mut streams, (pressure, port_k));
        let wall_k = constants.wall_k(state);
        let softening = constants.softening.factor(wall_k);
        let end = constants.ends.moving(self.falling);
        let drag = end.bristle.drag(state[SPEED], state[BRISTLE], softening);
        self.truth = Truth {
            time_s: self.steps as f64 * constants.step_s,
            pressure_pa: pressure,
            volume_m3: volume,
            length_m: state[LENGTH],
            speed_m_s: -state[SPEED],
            mass_kg: mass,
            flow_in_kg_s: streams.inflow,
            flow_out_kg_s: streams.outflow,
            gas_temperature_k: closure.temperature(pressure, volume, mass),
            wall_temperature_k: wall_k,
            friction_n: drag.force,
            ..Truth::default()
        };
        self.sensors.read(&mut self.truth);
    }
}

impl<C: Chamber + Copy + Send> Plant for Full<C> {
    fn follow_pins(&mut self) {
        self.inlet.follow_pin(self.constants.step_s);
        self.outlet.follow_pin(self.constants.step_s);
    }

    fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged> {
        let mut time = self.steps as f64 * self.constants.step_s;
        self.steps += 1;
        let end = self.steps as f64 * self.constants.step_s;
        self.inlet.latch(end, actuation.inlet);
        self.outlet.latch(end, actuation.outlet);
        // The wall warms by less than 0.01 K in a step.
        let softening = self.constants.softening.factor(self.truth.wall_temperature_k);
        while time < end {
            let refresh = self.air.since_s + REFRESH_S;
            // Within rounding of the end it makes no separate stretch.
            let stop = if refresh < end - 1e-9 { refresh } else { end };
            let until = self.inlet.kink(time, stop).min(self.outlet.kink(time, stop));
            let [inlet, outlet] =
                [&mut self.inlet, &mut self.outlet].map(|valve| valve.advance(time, until));
            let [from, to] =
                [0, 1].map(|at| Drive { inlet: inlet[at], outlet: outlet[at], softening });
            self.stretch(until - time, &from, &to);
            time = until;
            if time > refresh - 1e-9 {
                let place = self.constants.place(&self.state, &mut self.power);
                self.air.refresh(&self.constants, &self.state, place, time);
            }
        }
        self.place = self.constants.place(&self.state, &mut self.power);
        let exposure = self.exposure();
        let pressure = self.place.0;
        let mass: f64 = self.constants.masses(&self.state).iter().sum();
        for temperature in self.axial_gas_k() {
            check_gas(end, pressure, temperature, mass, &self.truth)?;
        }
        check_length(end, self.state[LENGTH], &self.constants.pull.chamber)?;
        self.sensors.advance(&exposure);
        self.observe();
        Ok(())
    }

    fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError> {
        let Self { constants, sensors, .. } = Self::new(scenario, self.constants.pull.chamber)?;
        self.constants = constants;
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
        let constants = &self.constants;
        let y = &self.state;
        let layer = |capacity: f64, temperatures: &[f64]| -> f64 {
            temperatures.iter().map(|t| capacity * (t - constants.initial_k)).sum()
        };
        Ledger {
            mass_kg: constants.masses(y).iter().sum(),
            mass_in_kg: y[MASS_IN],
            mass_out_kg: y[MASS_OUT],
            energy_j: constants.closure.internal_energy(&self.truth),
            enthalpy_in_j: y[ENTHALPY_IN],
            enthalpy_out_j: y[ENTHALPY_OUT],
            heat_to_wall_j: y[HEAT],
            work_j: y[WORK],
            friction_heat_j: y[FRICTION],
            friction_to_wall_j: y[FRICTION_TO_WALL],
            heat_to_ambient_j: y[TO_AMBIENT],
            wall_energy_j: layer(constants.inner_j_k, constants.inner(y))
                + layer(constants.outer_j_k, constants.outer(y)),
            ..self.initial
        }
    }

    fn axial_wall_k(&self) -> Vec<f64> {
        self.constants.outer(&self.state).to_vec()
    }

    fn axial_gas_k(&self) -> Vec<f64> {
        let (pressure, volume) = self.place;
        let zone_volume = volume / self.constants.zones as f64;
        self.constants
            .masses(&self.state)
            .iter()
            .map(|mass| self.constants.closure.temperature(pressure, zone_volume, *mass))
            .collect()
    }
}
