//! The chamber in full detail: axial zones, two wall layers, moving mass and bristle friction, switching valves,
//! tube, regulator, sensor housing.
//!
//! Integration is of fourth order. It stops at every kink of the valves' openings, so that they move linearly within
//! each of its steps. While both are shut its steps are longer: the tube is slower, and the kinks of the flow laws do
//! not matter. The ledger is kept at the chamber's port: the tube is outside. A hole in the tube is beside the port.

use super::bristle::Drag;
use super::chamber::Chamber;
use super::closure::Closure;
use super::end::{End, EndMotion, Ends, Falling};
use super::flow::{Iso6358, Streams};
use super::heat::{Film, HEAT_TOO_LARGE, InnerHeat, REFRESH_S, Section, Stirred};
use super::hysteresis::Hysteresis;
use super::line::{Bore, Line};
use super::local_power::LocalPower;
use super::ode::Rk4;
use super::piping::{Disturbance, Piping};
use super::pull::{Pressed, Pull, Softening};
use super::radial::Place;
use super::sensors::{Exposure, Sensors};
use super::start::Start;
use super::valve::DrivenValve;
use super::zones::Stirring;
use super::{
    Actuation, BuildError, Diverged, DrivenEnd, Ledger, Plant, Substeps, Truth, check_gas,
    check_length,
};
use thermyo_compute::math;
use thermyo_scenario::{LoadKind, Scenario, Valve};

/// Longest integration step while a valve is open, and while both are shut \[s\].
const LONGEST_OPEN_S: f64 = 1.0e-4;
const LONGEST_SHUT_S: f64 = 2.5e-4;
/// Upper limit on integration step times fastest rate; RK4 is stable to 2.8.
const STEP_TIMES_RATE: f64 = 2.0;
/// Upper limit on integration step times the angular frequency of an undamped swing: the balance closes only where a
/// swing is resolved.
const STEP_TIMES_SWING: f64 = 0.5;
/// Largest share of the volume that may move past in an integration step: resolves the work near the end of a small
/// volume.
const MOST_SWEPT: f64 = 0.02;
/// Speed that an end hardly exceeds \[m/s\].
const FASTEST_M_S: f64 = 10.0;
/// Response of the pressure regulator to a change of flow \[s\].
const REGULATOR_TIME_CONSTANT_S: f64 = 0.02;

// Indices into the state vector; masses, inner and outer wall temperatures of the zones follow, then a line.
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
// Length at which the slip's spring is relaxed, and the stretches of the creeping arms.
const SLIDER: usize = 16;
const FAST: usize = 17;
const SLOW: usize = 18;
const ZONES: usize = 19;

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
    hysteresis: Hysteresis,
    motion: EndMotion,
    ends: Ends,
    softening: Softening,
    pressed: Pressed,
    friction_to_wall: f64,
    piping: Piping,
    tube: Iso6358,
    tube_m3: f64,
    tube_bore: Bore,
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
    /// Weight of each zone in the element's average.
    foil: Vec<f64>,
    foil_place: Place,
    wall_sensor_position: f64,
}

/// Valves and loads at one instant.
#[derive(Debug, Clone, Copy)]
struct Drive {
    /// Opening of the valves \[-\].
    inlet: f64,
    outlet: f64,
    /// Factor on friction \[-\].
    softening: f64,
}

impl Drive {
    /// Interpolates linearly towards `end` by this share of the way.
    fn towards(&self, end: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            inlet: between(self.inlet, end.inlet),
            outlet: between(self.outlet, end.outlet),
            softening: self.softening,
        }
    }
}

/// The gas at one instant.
#[derive(Debug, Clone, Copy)]
struct Now {
    length: f64,
    volume: f64,
    /// V^-e.
    inverse_power: f64,
    pressure: f64,
    /// Volume \[m3\] and surface \[m2\] of a zone.
    zone_m3: f64,
    zone_m2: f64,
    port_k: f64,
}

/// Deflection of the bristles at the start \[m\].
fn deflection<C: Chamber>(scenario: &Scenario, pull: &Pull<C>, start: &Start) -> f64 {
    let friction = &scenario.friction;
    let stiffness = friction.presliding_stiffness_n_m;
    if scenario.load.kind == LoadKind::Isometric || stiffness <= 0.0 {
        return 0.0;
    }
    let pressed = Pressed::new(friction.pressure_factor).factor(start.pressure - pull.ambient_pa);
    let coulomb = friction.force_n * pressed * Softening::new(friction).factor(start.wall_k);
    // Friction carries only the part of the force that a stop does not.
    let [shortest, longest] = pull.stops;
    let excess = pull.force(start.pressure, start.length) - pull.load_n;
    let held = excess.clamp(
        if start.length < longest { -coulomb } else { 0.0 },
        if start.length > shortest { coulomb } else { 0.0 },
    );
    held / stiffness
}

/// Highest temperature of the gas upstream \[K\].
fn hottest_k(scenario: &Scenario) -> f64 {
    let plant = &scenario.plant;
    scenario.supply.temperature_k.max(plant.initial_temperature_k).max(plant.gas_k())
}

/// A rate \[1/s\] and the keys that make it so fast.
type Rate = (f64, &'static str);

fn fastest(rates: impl IntoIterator<Item = Rate>) -> Rate {
    rates.into_iter().fold((0.0, ""), |most, rate| if rate.0 >= most.0 { rate } else { most })
}

impl<C: Chamber> Constants<C> {
    fn new(scenario: &Scenario, pull: Pull<C>, start: &Start) -> Result<Self, BuildError> {
        let Scenario { wall, sensor, heat, .. } = scenario;
        let chamber = &pull.chamber;
        let rest_length = chamber.rest_length();
        let (diameter, gas_length) =
            (chamber.diameter(rest_length), chamber.gas_length(rest_length));
        let zones = chamber.zones().max(1);
        let closure = Closure::new(scenario);
        let gas = closure.gas;
        let line = Line::new(scenario, &gas);
        let tube = Iso6358::port(&scenario.tube, scenario.valve.critical_ratio, &gas);
        let tube_m3 = scenario.tube.volume_m3 + line.as_ref().map_or(0.0, Line::half_cell_m3);
        let share = 1.0 / zones as f64;
        let inner_j_k = share * wall.heat_capacity_j_k * (1.0 - wall.outer_fraction);
        let outer_j_k = share * wall.heat_capacity_j_k * wall.outer_fraction;
        let mut constants = Self {
            step_s: scenario.run.step_s,
            open: Substeps::ONE,
            shut: Substeps::ONE,
            zones,
            closure,
            hysteresis: Hysteresis::of(scenario),
            motion: EndMotion::of(scenario),
            ends: Ends::new(scenario, pull.load_n, chamber.pushes()),
            softening: Softening::new(&scenario.friction),
            pressed: Pressed::new(scenario.friction.pressure_factor),
            friction_to_wall: scenario.friction.heat_fraction,
            piping: Piping::new(scenario, &gas),
            tube_m3,
            tube_bore: Bore::of_tube(scenario, &gas),
            tube,
            tube_pa_j: (gas.k - 1.0) / tube_m3,
            line,
            droop_pa_s_kg: scenario.supply.droop_pa_s_kg,
            heat: InnerHeat::of_chamber(scenario, diameter, gas_length),
            stirring: Stirring::new(zones, gas_length, diameter),
            outer_w_m2_k: heat.outer_w_m2_k,
            outer_per_speed: heat.outer_per_speed,
            share,
            inner_j_k,
            outer_j_k,
            inner_k_j: 1.0 / inner_j_k,
            outer_k_j: 1.0 / outer_j_k,
            layers_w_k: share * wall.conductance_w_k,
            initial_k: start.wall_k,
            foil: foil_weights(zones, sensor.gas.position, sensor.gas.span),
            foil_place: Place::at(sensor.gas.radius),
            wall_sensor_position: sensor.wall.position,
            pull,
        };
        [constants.open, constants.shut] = constants.substeps(scenario, start)?;
        Ok(constants)
    }

    /// Smallest volume of the chamber \[m3\].
    fn smallest_m3(&self, start: &Start) -> f64 {
        let chamber = &self.pull.chamber;
        chamber.volume(chamber.rest_length()).min(start.volume)
    }

    /// Substeps of a step, while a valve is open, and while both are shut: [`STEP_TIMES_RATE`] over the fastest rate.
    ///
    /// The port joins the pressures of tube and muscle at the smallest volume. The sum of the rates at which each
    /// follows the other alone is the trace of that system, whose eigenvalues are real and negative: none is faster.
    fn substeps(&self, scenario: &Scenario, start: &Start) -> Result<[Substeps; 2], BuildError> {
        let Self { piping, tube, .. } = self;
        let gas = &self.closure.gas;
        let supply = piping.supply();
        let hottest = hottest_k(scenario);
        let smallest = self.smallest_m3(start);
        let others = self.rates_beside_pressures(scenario, start);
        let per_flow = gas.k * gas.r * hottest;
        let port = tube.steepest(hottest);
        let least_pa = piping.ambient().0.min(start.pressure).min(supply.0);
        // The port is at the tube, or at the other end of a line.
        let (beside_tube, line_rate) = match &self.line {
            None => (port, 0.0),
            Some(line) => (0.0, line.fastest_rate(port, least_pa, hottest)),
        };
        let chamber_rate = per_flow * port / smallest;
        let tube_heat =
            self.tube_bore.fastest_rate(gas, least_pa, hottest, piping.largest_inflow());
        let of = |longest: f64, valves: f64| {
            let tube_rate = tube_heat
                + per_flow * (valves * piping.steepest(hottest) + beside_tube) / self.tube_m3;
            let joined = [
                (
                    tube_rate,
                    "tube.volume_m3 is too small for valve.conductance_m3_s_pa and tube.conductance_m3_s_pa",
                ),
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
                let (rate, because) = fastest(others.into_iter().chain([together]));
                super::substeps(self.step_s, longest.min(STEP_TIMES_RATE / rate), because)
            })
        };
        Ok([of(LONGEST_OPEN_S, 2.0)?, of(LONGEST_SHUT_S, 0.0)?])
    }

    /// Fastest rates that the pressures do not set: the end, the gas of a zone, heat.
    fn rates_beside_pressures(&self, scenario: &Scenario, start: &Start) -> [Rate; 5] {
        let chamber = &self.pull.chamber;
        let rest_length = chamber.rest_length();
        let gas = &self.closure.gas;
        let coldest_k = start.wall_k.min(scenario.ambient.temperature_k);
        let least_pa = self.piping.ambient().0.min(start.pressure);
        let largest_inflow = self.piping.largest_inflow();
        let shares = self.stirring.largest();
        let still = (least_pa, start.wall_k);
        let space = (chamber.volume(rest_length), chamber.surface(rest_length));
        let (swing, too_stiff) = self.fastest_swing(start);
        [
            (
                self.ends.fastest_rate(self.softening.factor(coldest_k).max(1.0)),
                "friction.presliding_stiffness_n_m or friction.viscous_n_s_m is too large for load.mass_kg, or for the 50 g of a muscle's slack end",
            ),
            (STEP_TIMES_RATE / STEP_TIMES_SWING * swing, too_stiff),
            (
                self.turnover(scenario, start, least_pa),
                "the chamber's smallest volume is too small for valve.conductance_m3_s_pa and tube.conductance_m3_s_pa, or plant.initial_pressure_pa or ambient.pressure_pa is too low, or there are too many zones",
            ),
            (self.heat.fastest_rate(gas, still, space, (largest_inflow, &shares)), HEAT_TOO_LARGE),
            (
                self.wall_rate(start)
                    + self.layers_w_k * (1.0 / self.inner_j_k + 1.0 / self.outer_j_k),
                "wall.heat_capacity_j_k is too small for wall.conductance_w_k and what [heat] transfers",
            ),
        ]
    }

    /// Angular frequency of the end on everything that pushes back, the gas in the smallest volume and the elastic
    /// parts; and the keys that make it so fast.
    fn fastest_swing(&self, start: &Start) -> (f64, &'static str) {
        let chamber = &self.pull.chamber;
        let rest_length = chamber.rest_length();
        let most_pa = self.piping.supply().0.max(start.pressure);
        let area =
            chamber.force_area(rest_length).abs().max(chamber.force_area(start.length).abs());
        let spring_n_m = self.closure.gas.k * most_pa * area * area / self.smallest_m3(start)
            + chamber.elastic_slope(rest_length).abs();
        let held_n_m = self.hysteresis.stiffness_n_m();
        let too_stiff = if held_n_m > spring_n_m {
            "muscle.slip_stiffness_n_m, creep_fast_n_m or creep_slow_n_m is too large for load.mass_kg, or for the 50 g of an end without a load"
        } else {
            "the gas in the chamber's smallest volume, or its spring, is too stiff for load.mass_kg, or for the 50 g of an end without a load"
        };
        (self.ends.fastest_swing(spring_n_m + held_n_m), too_stiff)
    }

    /// Rate at which a zone's gas is replaced by the volume flow through the port at the muscle's pressure: inward,
    /// where the jet stirs too, or outward.
    fn turnover(&self, scenario: &Scenario, start: &Start, least_pa: f64) -> f64 {
        let (supply, r) = (self.piping.supply(), self.closure.gas.r);
        let hottest = hottest_k(scenario);
        let passes = self.piping.largest_inflow().min(self.tube.mass_flow(supply.0, supply.1, 0.0));
        let volume_in = passes * r * supply.1 / least_pa;
        let volume_out = self.tube.mass_flow(1.0, hottest, 0.0) * r * hottest;
        let chamber = &self.pull.chamber;
        let gas_length = chamber.gas_length(chamber.rest_length());
        self.stirring.fastest_rate(self.smallest_m3(start), gas_length, volume_in, volume_out)
    }

    /// Rate at which the wall's layers follow gas and ambient.
    fn wall_rate(&self, start: &Start) -> f64 {
        let chamber = &self.pull.chamber;
        let [from, to] = chamber.lengths().map(|length| chamber.surface(length));
        let surface = from.max(to).max(chamber.surface(chamber.rest_length()));
        let most_pa = self.piping.supply().0.max(start.pressure);
        let largest_inflow = self.piping.largest_inflow();
        let within =
            self.heat.largest(most_pa, start.wall_k, largest_inflow, &self.stirring.largest());
        let outside = self.outer_w_m2_k + self.outer_per_speed * FASTEST_M_S;
        self.share * surface * (within / self.inner_j_k + outside / self.outer_j_k)
    }

    fn state(&self, start: &Start, deflection: f64) -> Vec<f64> {
        let Start { pressure, gas_k, .. } = *start;
        let gas = &self.closure.gas;
        let line_states = self.line.as_ref().map_or(0, Line::states);
        let mut state = vec![start.wall_k; self.line_at() + line_states];
        state[..ZONES].fill(0.0);
        state[W] = pressure * math::pow(start.volume, self.closure.exponent());
        state[LENGTH] = start.length;
        state[BRISTLE] = deflection;
        state[SLIDER] = start.length;
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

    /// Index of a line's first state.
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

    /// Rates of tube and regulator. `leaving` is the mass flow out of the tube and its enthalpy over cp.
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
        rates[TUBE_ENERGY] = self.closure.gas.cp
            * (valves.net_enthalpy_over_cp(tube.1) - leaving.1)
            - self.tube_bore.heat_w(self.tube_m3, tube.1, leaving.0);
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
        rates[SLIDER..=SLOW].fill(0.0);
        if self.motion == EndMotion::Fixed {
            return Drag::default();
        }
        let speed = y[SPEED];
        let pressed = self.pressed.factor(pressure - self.pull.ambient_pa);
        let mut drag = end.bristle.drag(speed, y[BRISTLE], softening, pressed);
        let stretches = &y[FAST..=SLOW];
        let held = self.slip_n(y, pressure, softening) + self.hysteresis.creep_n(stretches);
        let net = self.pull.force(pressure, y[LENGTH]) - end.load_n - drag.force - held;
        drag.heat += self.hysteresis.loss(stretches);
        // The load rests on a stop until it is lifted off.
        let [shortest, longest] = self.pull.stops;
        let outside = y[LENGTH] >= longest && speed <= 0.0 && net <= 0.0;
        let inside = y[LENGTH] <= shortest && speed >= 0.0 && net >= 0.0;
        if let EndMotion::Driven(speed_m_s) = self.motion {
            rates[LENGTH] = speed_m_s;
            rates[BRISTLE] = drag.deflection_rate;
        } else if !(outside || inside) {
            rates[LENGTH] = -speed;
            rates[SPEED] = net * end.per_mass_kg;
            rates[BRISTLE] = drag.deflection_rate;
        }
        let moves = rates[LENGTH];
        for ((rate, stretch), arm) in
            rates[FAST..=SLOW].iter_mut().zip(stretches).zip(&self.hysteresis.creep)
        {
            *rate = -moves - arm.per_s * stretch;
        }
        drag
    }

    fn slip_n(&self, y: &[f64], pressure: f64, softening: f64) -> f64 {
        let slip = &self.hysteresis.slip;
        let limit = slip.limit(pressure - self.pull.ambient_pa, softening);
        slip.force(y[SLIDER], y[LENGTH], limit)
    }

    /// Drags the slider after a step, and adds the heat of slip to friction and wall.
    fn slide(&self, y: &mut [f64], power: &mut LocalPower, softening: f64) {
        if self.motion == EndMotion::Fixed {
            return;
        }
        let slip = &self.hysteresis.slip;
        let gauge_pa = self.place(y, power).0 - self.pull.ambient_pa;
        let limit = slip.limit(gauge_pa, softening);
        let (slider, heat) = slip.settle(y[SLIDER], y[LENGTH], limit);
        y[SLIDER] = slider;
        if heat == 0.0 {
            return;
        }
        let to_wall = self.friction_to_wall * heat;
        y[FRICTION] += heat;
        y[FRICTION_TO_WALL] += to_wall;
        let outer = ZONES + 2 * self.zones..self.line_at();
        for outer_k in &mut y[outer] {
            *outer_k += self.share * to_wall * self.outer_k_j;
        }
    }

    /// Pressure \[Pa\] and volume \[m3\].
    fn place(&self, y: &[f64], power: &mut LocalPower) -> (f64, f64) {
        let volume = self.pull.chamber.volume(y[LENGTH]);
        (y[W] * power.at(volume), volume)
    }

    /// Sets an end that has passed a stop back onto it.
    fn stop(&self, y: &mut [f64], power: &mut LocalPower) {
        let [shortest, longest] = self.pull.stops;
        let beyond = y[LENGTH] > longest || y[LENGTH] < shortest;
        if !beyond || self.motion != EndMotion::Free {
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

    /// Number of parts into which a step \[s\] is divided, so that each sweeps no more than [`MOST_SWEPT`] of the
    /// volume.
    fn parts(&self, y: &[f64], step: f64) -> u32 {
        let chamber = &self.pull.chamber;
        let swept_m3 = step * (chamber.force_area(y[LENGTH]) * y[SPEED]).abs();
        (swept_m3 / (MOST_SWEPT * chamber.volume(y[LENGTH]))).ceil().max(1.0) as u32
    }

    /// Moves the load after a step; see [`Ends::hang`].
    fn hang(
        &self,
        y: &mut [f64],
        acceleration: f64,
        step: f64,
        falling: Option<Falling>,
    ) -> Option<Falling> {
        if self.motion != EndMotion::Free {
            return None;
        }
        let (falling, speed) = self.ends.hang(falling, step, (y[LENGTH], y[SPEED]), acceleration);
        // Once caught on the stop, the load rests.
        y[SPEED] = if y[LENGTH] < self.pull.stops[1] { speed } else { speed.max(0.0) };
        falling
    }

    /// The gas at one instant.
    fn now(&self, y: &[f64], power: &mut LocalPower) -> Now {
        let chamber = &self.pull.chamber;
        let length = y[LENGTH];
        let volume = chamber.volume(length);
        let inverse_power = power.at(volume);
        let pressure = y[W] * inverse_power;
        let zone_m3 = self.share * volume;
        Now {
            length,
            volume,
            inverse_power,
            pressure,
            zone_m3,
            zone_m2: self.share * chamber.surface(length),
            port_k: self.closure.temperature(pressure, zone_m3, self.masses(y)[0]),
        }
    }

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
        let now = self.now(y, power);
        let Now { pressure, port_k, .. } = now;
        let drag = self.mechanics(y, pressure, end, drive.softening, rates);
        let streams = self.path_rates(y, &now, drive, rates);
        // dV/dL is -force_area.
        let work = -pressure * self.pull.chamber.force_area(now.length) * rates[LENGTH];
        let (rates, zone_rates) = rates.split_at_mut(ZONES);
        let (gas_rates, wall_rates) = zone_rates.split_at_mut(self.zones);
        let (inner_rates, outer_rates) = wall_rates.split_at_mut(self.zones);
        let convective = self.convection(y, &now, (air, streams.inflow), inner_rates, outer_rates);
        let heat =
            closure.heat_of_streams(&streams, port_k, convective) + closure.heat_per_work() * work;
        self.zone_rates(y, &now, (&streams, convective), inner_rates, gas_rates);
        // The heat that a closure adds to convection spreads evenly.
        let implied = self.share * (heat - convective);
        let friction_to_wall = self.friction_to_wall * drag.heat;
        let gains = (implied, self.share * friction_to_wall);
        let to_ambient = self.wall_rates(y, now.zone_m2, gains, inner_rates, outer_rates);
        let inverse_volume = 1.0 / (now.inverse_power * now.volume);
        rates[W] = closure.rate(inverse_volume, &streams, port_k, convective);
        rates[MASS_IN] = streams.inflow;
        rates[MASS_OUT] = streams.outflow;
        rates[ENTHALPY_IN] = closure.gas.cp * streams.inflow_temperature;
        rates[ENTHALPY_OUT] = closure.gas.cp * streams.outflow * port_k;
        rates[HEAT] = heat;
        rates[TO_AMBIENT] = to_ambient;
        rates[FRICTION] = drag.heat;
        rates[FRICTION_TO_WALL] = friction_to_wall;
        rates[WORK] = work;
    }

    /// Flows through the port and the leak, and the rates of tube and line.
    fn path_rates(&self, y: &[f64], now: &Now, drive: &Drive, rates: &mut [f64]) -> Streams {
        let tube = self.tube_gas(y);
        let gas = (now.pressure, now.port_k);
        let mut streams = self.port(y, gas, tube);
        let into_muscle = (streams.net(), streams.net_enthalpy_over_cp(now.port_k));
        let (rates, line_rates) = rates.split_at_mut(self.line_at());
        let leaving = match &self.line {
            Some(line) => line.rates(&y[self.line_at()..], tube, into_muscle, line_rates),
            None => into_muscle,
        };
        self.tube_rates(y, tube, leaving, drive, rates);
        self.piping.add_leak(&mut streams, gas);
        streams
    }

    /// Writes the heat from each zone to its wall \[W\]; returns their sum.
    fn convection(
        &self,
        y: &[f64],
        now: &Now,
        (air, inflow): (&[Section], f64),
        heat: &mut [f64],
        scratch: &mut [f64],
    ) -> f64 {
        // A separate loop for the zones' temperatures, so that its divisions run side by side.
        for (zone_k, mass) in scratch.iter_mut().zip(self.masses(y)) {
            *zone_k = self.closure.temperature(now.pressure, now.zone_m3, *mass);
        }
        let walls = heat.iter_mut().zip(self.inner(y));
        for (((heat, inner_k), zone_k), section) in walls.zip(&*scratch).zip(air) {
            *heat = now.zone_m2 * section.film.flux(inflow, zone_k - inner_k);
        }
        heat.iter().fold(0.0, |sum, heat| sum + heat)
    }

    /// Rates of the zones' masses, from the heat that each loses: enthalpy over the faces, from the closed end to the
    /// port.
    fn zone_rates(
        &self,
        y: &[f64],
        now: &Now,
        (streams, convective): (&Streams, f64),
        heat: &[f64],
        rates: &mut [f64],
    ) {
        let Self { zones, share, .. } = *self;
        let (masses, gas) = (self.masses(y), &self.closure.gas);
        let gain = share * (gas.cp * streams.net_enthalpy_over_cp(now.port_k) - convective);
        let volume_inflow = streams.inflow_temperature * gas.r / now.pressure;
        let gas_length = self.pull.chamber.gas_length(now.length);
        let background = self.stirring.background(now.volume, gas_length);
        // One over cp T is the mass times this; eq. (1).
        let per_enthalpy = gas.r / (gas.cp * now.pressure * now.zone_m3);
        let per_zone_m3 = 1.0 / now.zone_m3;
        let (mut enthalpy, mut beyond) = (0.0, 0.0);
        for i in (1..zones).rev() {
            enthalpy += gain + heat[i];
            let flow = if self.closure.is_isothermal() {
                // Equal temperatures mean equal masses, so that each zone takes its share.
                share * (zones - i) as f64 * streams.net()
            } else {
                let upwind = masses[if enthalpy > 0.0 { i - 1 } else { i }];
                let exchange = self.stirring.exchange(i - 1, volume_inflow, background);
                let mixing = exchange * (masses[i - 1] - masses[i]) * per_zone_m3;
                enthalpy * upwind * per_enthalpy + mixing
            };
            rates[i] = flow - beyond;
            beyond = flow;
        }
        rates[0] = streams.net() - beyond;
    }

    /// Turns the heat of the zones into the rates of both layers; the inner and the outer one gain further heat \[W\]:
    /// friction heats the braid, the outer layer. Returns the heat to ambient \[W\].
    fn wall_rates(
        &self,
        y: &[f64],
        zone_m2: f64,
        (to_inner, to_outer): (f64, f64),
        inner_rates: &mut [f64],
        outer_rates: &mut [f64],
    ) -> f64 {
        let speed = if self.motion == EndMotion::Fixed { 0.0 } else { y[SPEED].abs() };
        let outer_coefficient = self.outer_w_m2_k + self.outer_per_speed * speed;
        let mut to_ambient = 0.0;
        let temperatures = self.inner(y).iter().zip(self.outer(y));
        let layers = inner_rates.iter_mut().zip(outer_rates).zip(temperatures);
        for ((inner_rate, outer_rate), (inner_k, outer_k)) in layers {
            let through = self.layers_w_k * (inner_k - outer_k);
            let lost = outer_coefficient * zone_m2 * (outer_k - self.piping.ambient().1);
            to_ambient += lost;
            *inner_rate = (*inner_rate + to_inner - through) * self.inner_k_j;
            *outer_rate = (through + to_outer - lost) * self.outer_k_j;
        }
        to_ambient
    }

    /// Mean wall temperature \[K\], weighted by heat capacity.
    fn wall_k(&self, y: &[f64]) -> f64 {
        let mean = |layer: &[f64]| layer.iter().sum::<f64>() / self.zones as f64;
        (self.inner_j_k * mean(self.inner(y)) + self.outer_j_k * mean(self.outer(y)))
            / (self.inner_j_k + self.outer_j_k)
    }

    /// Temperature of the outer layer at the wall sensor \[K\], linear between the middles of the zones.
    fn wall_at_sensor(&self, y: &[f64]) -> f64 {
        let outer = self.outer(y);
        let place = (self.wall_sensor_position * self.zones as f64 - 0.5)
            .clamp(0.0, (self.zones - 1) as f64);
        let before = place.floor() as usize;
        let after = (before + 1).min(self.zones - 1);
        outer[before] + (place - before as f64) * (outer[after] - outer[before])
    }
}

/// Share of the element that each zone holds; it lies in the middle `position` over `span` of the length.
fn foil_weights(zones: usize, position: f64, span: f64) -> Vec<f64> {
    let edge = |i: usize| i as f64 / zones as f64;
    // An element of no length still sits in one zone.
    let half = 0.5 * span.max(1e-9);
    let (start, end) = ((position - half).max(0.0), (position + half).min(1.0));
    (0..zones)
        .map(|i| (edge(i + 1).min(end) - edge(i).max(start)).max(0.0) / (end - start))
        .collect()
}

/// Stirring of the gas, and its profile in the zones, until the next refresh.
#[derive(Debug, Clone)]
struct AirNow {
    stirred: Stirred,
    sections: Vec<Section>,
    /// Time of the last refresh \[s\], and the masses that had flowed in and out by then \[kg\].
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

#[derive(Debug, Clone)]
pub struct Full<C> {
    constants: Constants<C>,
    steps: u64,
    state: Vec<f64>,
    falling: Option<Falling>,
    integrator: Rk4,
    power: LocalPower,
    air: AirNow,
    inlet: DrivenValve,
    outlet: DrivenValve,
    /// Pressure \[Pa\] and volume \[m3\] now.
    place: (f64, f64),
    truth: Truth,
    initial: Ledger,
    sensors: Sensors,
}

impl<C: Chamber + Copy + Send> Full<C> {
    pub fn new(scenario: &Scenario, chamber: C) -> Result<Self, BuildError> {
        let pull = Pull::new(scenario, chamber);
        let start = Start::of_chamber(scenario, &pull);
        let deflection = deflection(scenario, &pull, &start);
        let constants = Constants::new(scenario, pull, &start)?;
        let state = constants.state(&start, deflection);
        let closure = &constants.closure;
        let housing_s = scenario.sensor.gas.housing_time_constant_s;
        // The board's timer counts steps: a valve with another period would latch its duties late, by up to a whole
        // period.
        let valve = Valve { pwm_hz: 1.0 / scenario.pwm_period_s(), ..scenario.valve.clone() };
        let mut full = Self {
            integrator: Rk4::new(state.len()),
            steps: 0,
            falling: None,
            power: LocalPower::new(-closure.exponent(), start.volume),
            air: AirNow::new(&constants, &state, (start.pressure, start.volume)),
            inlet: DrivenValve::new(&valve),
            outlet: DrivenValve::new(&valve),
            place: (start.pressure, start.volume),
            state,
            truth: Truth::default(),
            initial: start.ledger(&closure.gas),
            sensors: Sensors::new(scenario, housing_s, &start.exposure()),
            constants,
        };
        full.observe();
        Ok(full)
    }

    /// Integrates from one instant to another, between which the valves move linearly.
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
                constants.slide(state, power, start.softening);
                let acceleration = integrator.last_rates()[SPEED];
                *falling = constants.hang(state, acceleration, step, *falling);
            }
        }
    }

    fn exposure(&self, zones_k: &[f64]) -> Exposure {
        let constants = &self.constants;
        let zones = zones_k.iter().zip(constants.inner(&self.state));
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
        let pressed = constants.pressed.factor(pressure - constants.pull.ambient_pa);
        let drag = end.bristle.drag(state[SPEED], state[BRISTLE], softening, pressed);
        let slip_n = constants.slip_n(state, pressure, softening);
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
            friction_n: drag.force + slip_n,
            ..Truth::default()
        };
        self.sensors.read(&mut self.truth);
    }
}

impl<C: Chamber + Copy + Send> DrivenEnd for Full<C> {
    fn drive_end(&mut self, speed_m_s: f64) {
        self.constants.motion = EndMotion::Driven(speed_m_s);
        self.state[SPEED] = -speed_m_s;
    }

    fn tension_n(&self) -> f64 {
        let Self { constants, state, .. } = self;
        let (pressure, _) = self.place;
        let softening = constants.softening.factor(self.truth.wall_temperature_k);
        let end = constants.ends.moving(self.falling);
        let pressed = constants.pressed.factor(pressure - constants.pull.ambient_pa);
        let drag = end.bristle.drag(state[SPEED], state[BRISTLE], softening, pressed);
        let creep_n = constants.hysteresis.creep_n(&state[FAST..=SLOW]);
        let held_n = drag.force + constants.slip_n(state, pressure, softening) + creep_n;
        constants.pull.force(pressure, state[LENGTH]) - held_n
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
            // A refresh within rounding of the end makes no separate stretch.
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
        let zones_k = self.axial_gas_k();
        let exposure = self.exposure(&zones_k);
        let pressure = self.place.0;
        let mass: f64 = self.constants.masses(&self.state).iter().sum();
        for temperature in zones_k {
            check_gas(end, pressure, temperature, mass, &self.truth)?;
        }
        check_length(end, self.state[LENGTH], &self.constants.pull.chamber)?;
        self.sensors.advance(&exposure);
        self.observe();
        Ok(())
    }

    fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError> {
        let Self { constants, sensors, .. } = Self::new(scenario, self.constants.pull.chamber)?;
        self.steps = (self.truth.time_s / constants.step_s).round() as u64;
        self.constants = constants;
        self.sensors.retune(&sensors);
        Ok(())
    }

    fn disturb(&mut self, disturbance: Disturbance) {
        self.constants.piping.disturb(disturbance);
    }

    fn shortest_step(&self) -> Option<(f64, &'static str)> {
        Some(self.constants.open.shortest(self.constants.step_s))
    }

    fn truth(&self) -> Truth {
        self.truth
    }

    fn ledger(&self) -> Ledger {
        let constants = &self.constants;
        let y = &self.state;
        let softening = constants.softening.factor(self.truth.wall_temperature_k);
        let slip_n = constants.slip_n(y, self.place.0, softening);
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
            hysteresis_energy_j: constants.hysteresis.energy(slip_n, &y[FAST..=SLOW]),
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
