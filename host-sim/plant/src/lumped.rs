//! The lumped plant: one zone of gas, one wall, ideal valves, a quasi-static load.
//!
//! The length is no state of its own. Coulomb friction makes it a play operator: while the pull stays within the
//! friction band around the load the length is held, and beyond it the length follows the balance of pull, load and
//! friction, solved together with P = w V(L)^-e. A muscle's slip and creep resist as for a constant speed over the
//! step. The model `paper` is the same with eq. (12) for the gas.

use super::chamber::Chamber;
use super::closure::Closure;
use super::end::EndMotion;
use super::flow::Streams;
use super::heat::{Film, HEAT_TOO_LARGE, InnerHeat, Stirred};
use super::hysteresis::{ARMS, Elapsed, Hysteresis, Slip};
use super::local_power::LocalPower;
use super::ode::rk4;
use super::piping::{Disturbance, Piping};
use super::pull::{Pressed, Pull, Softening};
use super::sensors::{Exposure, Sensors};
use super::start::Start;
use super::{
    Actuation, BuildError, Diverged, DrivenEnd, Ledger, Plant, Substeps, Truth, check_gas,
    check_length, work_through,
};
use thermyo_compute::math;
use thermyo_scenario::Scenario;

const LONGEST_STEP_S: f64 = 0.002;
/// Upper limit on integration step times fastest rate: well inside the stability limit of RK4, 2.8.
const STEP_TIMES_RATE: f64 = 1.0;
/// Distance from the edge of the friction band that counts as on it, relative to the forces: at the start of a step a
/// sliding braid is on the edge but for rounding.
const EDGE: f64 = 1e-7;

// Indices into the state vector.
const MASS: usize = 0;
const W: usize = 1;
const WALL: usize = 2;
const MASS_IN: usize = 3;
const MASS_OUT: usize = 4;
const ENTHALPY_IN: usize = 5;
const ENTHALPY_OUT: usize = 6;
const HEAT: usize = 7;
const TO_AMBIENT: usize = 8;
const FRICTION: usize = 9;
const FRICTION_TO_WALL: usize = 10;
const STATES: usize = 11;

/// Everything that does not change during a run.
#[derive(Debug, Clone)]
struct Constants<C> {
    step_s: f64,
    substeps: Substeps,
    closure: Closure,
    pull: Pull<C>,
    hysteresis: Hysteresis,
    motion: EndMotion,
    coulomb: Slip,
    piping: Piping,
    /// The actuation is the mass flows themselves \[kg/s\], not the openings of the valves.
    given_flows: bool,
    heat: InnerHeat,
    outer_w_m2_k: f64,
    outer_per_speed: f64,
    wall_j_k: f64,
    friction_n: f64,
    pressed: Pressed,
    softening: Softening,
    friction_to_wall: f64,
    initial_k: f64,
}

/// Length, and the quantities that follow from it for a given w.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    /// Whether the pull has reached the edge of the friction band beyond which the muscle contracts; never on the inner
    /// stop.
    may_contract: bool,
    /// The same for extension; never on the outer stop.
    may_extend: bool,
    length: f64,
    volume: f64,
    /// V^-e.
    power: f64,
    pressure: f64,
    held: Held,
}

/// Force of slip and creep.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Held {
    slip_n: f64,
    creep_n: f64,
    /// Rate at which creep fades at a held length \[N/s\].
    fading_n_s: f64,
    /// Slope of slip and creep over contraction, faster than creep relaxes \[N/m\].
    stiffness_n_m: f64,
}

/// Slip and creep at the start of a step: the slip's slider \[m\], its limit \[N\], and the stretches
/// \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Memory {
    slider: f64,
    limit: f64,
    stretches: [f64; ARMS],
}

/// The play operator.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Play {
    /// Length at the end of the last step.
    held: Place,
    memory: Memory,
    guess: f64,
    power: LocalPower,
}

impl Play {
    /// Play at rest, with slip and creep relaxed.
    fn begin(length: f64, volume: f64, pressure: f64, exponent: f64) -> Self {
        let held = Place {
            may_contract: false,
            may_extend: false,
            length,
            volume,
            power: math::pow(volume, -exponent),
            pressure,
            held: Held::default(),
        };
        let memory = Memory { slider: length, limit: 0.0, stretches: [0.0; ARMS] };
        Self { held, memory, guess: length, power: LocalPower::new(-exponent, volume) }
    }

    /// Place for w where a mechanism moves the end from the held length, at a rate \[m/s\].
    fn driven<C: Chamber>(
        &mut self,
        constants: &Constants<C>,
        w: f64,
        speed_m_s: f64,
        elapsed: &Elapsed,
    ) -> Place {
        let length = self.held.length + speed_m_s * elapsed.duration();
        let volume = constants.pull.chamber.volume(length);
        let power = self.power.at(volume);
        let held = self.memory.held(&constants.hysteresis, elapsed, self.held.length, length);
        Place { length, volume, power, pressure: w * power, held, ..self.held }
    }

    /// Place for w and the friction force \[N\], from the held length, after the elapsed time.
    fn place<C: Chamber>(
        &mut self,
        constants: &Constants<C>,
        w: f64,
        friction: f64,
        elapsed: &Elapsed,
    ) -> Place {
        let Constants { pull, hysteresis, .. } = constants;
        let mut place = Place { pressure: w * self.held.power, ..self.held };
        let (memory, from) = (self.memory, place.length);
        match constants.motion {
            EndMotion::Free => (),
            EndMotion::Fixed => return place,
            EndMotion::Driven(speed) => return self.driven(constants, w, speed, elapsed),
        }
        place.held = memory.held(hysteresis, elapsed, from, from);
        let held_n = place.held.slip_n + place.held.creep_n;
        let excess = pull.force(place.pressure, place.length) - held_n - pull.load_n;
        let edge = friction - EDGE * (pull.load_n.abs() + friction);
        let [shortest, longest] = pull.stops;
        let (off_inner, off_outer) = (place.length > shortest, place.length < longest);
        place.may_contract = off_inner && excess >= edge;
        place.may_extend = off_outer && excess <= -edge;
        let force = if excess > friction && off_inner {
            pull.load_n + friction
        } else if excess < -friction && off_outer {
            pull.load_n - friction
        } else {
            return place;
        };
        let exponent = constants.closure.exponent();
        let creep_n_m = elapsed.slope(hysteresis);
        let length = pull.balance(
            force,
            self.guess,
            |length| {
                let volume = pull.chamber.volume(length);
                let pressure = w * self.power.at(volume);
                (pressure, exponent * pressure * pull.chamber.force_area(length) / volume)
            },
            |length| {
                let held = memory.held(hysteresis, elapsed, from, length);
                let slope = hysteresis.slip.slope(memory.slider, length, memory.limit) + creep_n_m;
                (held.slip_n + held.creep_n, slope)
            },
        );
        if length >= longest {
            place.may_extend = false;
        }
        if length <= shortest {
            place.may_contract = false;
        }
        let length = pull.stopped(length);
        self.guess = length;
        let volume = pull.chamber.volume(length);
        let power = self.power.at(volume);
        let held = memory.held(hysteresis, elapsed, from, length);
        Place { length, volume, power, pressure: w * power, held, ..place }
    }
}

impl Memory {
    /// Advances over a step. Returns the heat of slip and creep \[J\]; creep's is its work less the energy it stores.
    fn advance(&mut self, hysteresis: &Hysteresis, elapsed: &Elapsed, places: [Place; 3]) -> f64 {
        let [start, _, end] = places;
        let work = work_through(places.map(|place| (place.held.creep_n, -place.length)));
        let before = hysteresis.energy(0.0, &self.stretches);
        self.stretches = elapsed.stretches(&self.stretches, start.length - end.length);
        let stored = hysteresis.energy(0.0, &self.stretches) - before;
        let (slider, slid) = hysteresis.slip.settle(self.slider, end.length, self.limit);
        self.slider = slider;
        slid + work - stored
    }

    /// Slip and creep at a length \[m\], after the time in which the muscle came there from another one.
    fn held(&self, hysteresis: &Hysteresis, elapsed: &Elapsed, from: f64, length: f64) -> Held {
        let stretches = elapsed.stretches(&self.stretches, from - length);
        let slip = &hysteresis.slip;
        let creep: f64 = hysteresis.creep.iter().map(|arm| arm.stiffness_n_m).sum();
        Held {
            slip_n: slip.force(self.slider, length, self.limit),
            creep_n: hysteresis.creep_n(&stretches),
            fading_n_s: hysteresis.fading_n_s(&stretches),
            stiffness_n_m: slip.slope(self.slider, length, self.limit) + creep,
        }
    }
}

impl<C: Chamber> Constants<C> {
    fn new(scenario: &Scenario, pull: Pull<C>, start: &Start) -> Result<Self, BuildError> {
        let chamber = &pull.chamber;
        let rest_length = chamber.rest_length();
        let (diameter_m, gas_m) = (chamber.diameter(rest_length), chamber.gas_length(rest_length));
        let closure = Closure::new(scenario);
        let mut constants = Self {
            step_s: scenario.run.step_s,
            substeps: Substeps::ONE,
            closure,
            hysteresis: Hysteresis::of(scenario),
            motion: EndMotion::of(scenario),
            coulomb: Slip::coulomb(&scenario.friction),
            piping: Piping::new(scenario, &closure.gas),
            given_flows: false,
            heat: InnerHeat::of_chamber(scenario, diameter_m, gas_m),
            outer_w_m2_k: scenario.heat.outer_w_m2_k,
            outer_per_speed: scenario.heat.outer_per_speed,
            wall_j_k: scenario.wall.heat_capacity_j_k,
            friction_n: scenario.friction.force_n,
            pressed: Pressed::new(scenario.friction.pressure_factor),
            softening: Softening::new(&scenario.friction),
            friction_to_wall: scenario.friction.heat_fraction,
            initial_k: start.wall_k,
            pull,
        };
        constants.substeps = constants.substeps_of(scenario, start)?;
        Ok(constants)
    }

    /// Substeps for the fastest process: the pressure of the smallest volume through both valves and the largest hole,
    /// near equal pressures, or its heat.
    fn substeps_of(&self, scenario: &Scenario, start: &Start) -> Result<Substeps, BuildError> {
        let Self { closure, piping, heat, .. } = self;
        let (gas, chamber) = (&closure.gas, &self.pull.chamber);
        let rest_length = chamber.rest_length();
        let smallest = chamber.volume(rest_length).min(start.volume);
        let hottest = piping.supply().1.max(start.wall_k).max(start.gas_k);
        let still = (scenario.ambient.pressure_pa, start.wall_k);
        let space = (chamber.volume(rest_length), chamber.surface(rest_length));
        let heat_rate =
            heat.fastest_rate(gas, still, space, (piping.largest_inflow(), heat.whole()));
        Substeps::new(scenario, piping, hottest, |leak, leak_too_large| {
            let rate = (2.0 + leak) * gas.k * gas.r * hottest * piping.steepest(hottest) / smallest;
            let because = if leak > 2.0 {
                leak_too_large
            } else {
                "valve.conductance_m3_s_pa is too large for the gas's volume"
            };
            let (rate, because) =
                if heat_rate > rate { (heat_rate, HEAT_TOO_LARGE) } else { (rate, because) };
            super::substeps(self.step_s, LONGEST_STEP_S.min(STEP_TIMES_RATE / rate), because)
        })
    }

    fn streams(&self, gas: (f64, f64), actuation: Actuation) -> Streams {
        if self.given_flows {
            return Streams::given(actuation.inlet, self.piping.supply().1, actuation.outlet);
        }
        let mut streams = Streams::default();
        self.piping.add_inlet(&mut streams, gas, 0.0, actuation.inlet);
        self.piping.add_outlet(&mut streams, gas, actuation.outlet);
        self.piping.add_leak(&mut streams, gas);
        streams
    }

    /// dL/dt while sliding: the balance of forces, differentiated. The drift of friction with the
    /// wall's temperature is left out; it is below 1e-4 of the speed.
    fn speed(&self, place: &Place, w_rate: f64) -> f64 {
        if let EndMotion::Driven(speed_m_s) = self.motion {
            return speed_m_s;
        }
        if !(place.may_contract || place.may_extend) {
            return 0.0;
        }
        let area = self.pull.chamber.force_area(place.length);
        let slope = self.closure.exponent() * place.pressure * area / place.volume;
        let stiffness =
            self.pull.stiffness(place.pressure, slope, place.length) + place.held.stiffness_n_m;
        let speed = -(place.power * area * w_rate + place.held.fading_n_s) / stiffness;
        if (speed < 0.0 && place.may_contract) || (speed > 0.0 && place.may_extend) {
            speed
        } else {
            0.0
        }
    }

    fn rates(
        &self,
        y: &[f64; STATES],
        place: &Place,
        friction: f64,
        film: &Film,
        actuation: Actuation,
    ) -> [f64; STATES] {
        let closure = &self.closure;
        let temperature = closure.temperature(place.pressure, place.volume, y[MASS]);
        let streams = self.streams((place.pressure, temperature), actuation);
        let surface = self.pull.chamber.surface(place.length);
        let convective = film.coefficient(streams.inflow) * surface * (temperature - y[WALL]);
        let volume_power = 1.0 / (place.power * place.volume);
        let w_rate = closure.rate(volume_power, &streams, temperature, convective);
        let speed = self.speed(place, w_rate).abs();
        let heat = closure.heat_of_streams(&streams, temperature, convective);
        let outer = self.outer_w_m2_k + self.outer_per_speed * speed;
        let to_ambient = outer * surface * (y[WALL] - self.piping.ambient().1);
        // Where a mechanism drives the end, the heat follows from the play.
        let is_driven = matches!(self.motion, EndMotion::Driven(_));
        let friction = if is_driven { 0.0 } else { friction * speed };
        let friction_to_wall = self.friction_to_wall * friction;
        let mut rates = [0.0; STATES];
        rates[MASS] = streams.net();
        rates[W] = w_rate;
        rates[WALL] = (heat + friction_to_wall - to_ambient) / self.wall_j_k;
        rates[MASS_IN] = streams.inflow;
        rates[MASS_OUT] = streams.outflow;
        rates[ENTHALPY_IN] = closure.gas.cp * streams.inflow_temperature;
        rates[ENTHALPY_OUT] = closure.gas.cp * streams.outflow * temperature;
        rates[HEAT] = heat;
        rates[TO_AMBIENT] = to_ambient;
        rates[FRICTION] = friction;
        rates[FRICTION_TO_WALL] = friction_to_wall;
        rates
    }
}

#[derive(Debug, Clone)]
pub struct Lumped<C> {
    constants: Constants<C>,
    steps: u64,
    state: [f64; STATES],
    play: Play,
    /// Where a mechanism drives the end: the length at which dry friction is zero \[m\].
    slider: f64,
    work_j: f64,
    stirred: Stirred,
    film: Film,
    truth: Truth,
    initial: Ledger,
    sensors: Sensors,
}

impl<C: Chamber + Copy> Lumped<C> {
    pub fn new(scenario: &Scenario, chamber: C) -> Result<Self, BuildError> {
        let pull = Pull::new(scenario, chamber);
        let start = Start::of_chamber(scenario, &pull);
        let constants = Constants::new(scenario, pull, &start)?;
        let gas = &constants.closure.gas;
        let exponent = constants.closure.exponent();
        let Start { pressure, volume, length, .. } = start;
        let power = math::pow(volume, -exponent);
        let mut state = [0.0; STATES];
        state[MASS] = start.mass(gas);
        state[W] = pressure / power;
        state[WALL] = start.wall_k;
        let mut lumped = Self {
            initial: start.ledger(gas),
            constants,
            steps: 0,
            state,
            play: Play::begin(length, volume, pressure, exponent),
            slider: length,
            work_j: 0.0,
            stirred: Stirred::default(),
            film: Film::default(),
            truth: Truth::default(),
            sensors: Sensors::new(scenario, 0.0, &start.exposure()),
        };
        lumped.set_film();
        lumped.observe(0.0, Actuation::default());
        Ok(lumped)
    }

    /// Returns the same plant without valves: the actuation is the mass flows \[kg/s\].
    pub fn driven_by_flows(mut self) -> Self {
        self.constants.given_flows = true;
        self
    }

    fn substep(&mut self, step: f64, actuation: Actuation) {
        let flowed_kg = [self.state[MASS_IN], self.state[MASS_OUT]];
        let Self { constants, play, film, .. } = self;
        let softening = constants.softening.around(self.state[WALL]);
        let mut stage = 0;
        let mut middle = play.held;
        let start = play.held;
        let gauge_pa = start.pressure - constants.pull.ambient_pa;
        let friction_n = constants.friction_n * constants.pressed.factor(gauge_pa);
        let friction_at = |wall_k: f64| friction_n * softening.factor(wall_k);
        let slip = &constants.hysteresis.slip;
        play.memory.limit = slip.limit(gauge_pa, softening.factor(self.state[WALL]));
        let [half, whole] =
            [0.5 * step, step].map(|time| Elapsed::new(&constants.hysteresis, time));
        let elapsed = [Elapsed::NONE, half, half, whole];
        self.state = rk4(&self.state, step, |y| {
            let friction = friction_at(y[WALL]);
            let place = play.place(constants, y[W], friction, &elapsed[stage]);
            stage += 1;
            if stage == 3 {
                middle = place;
            }
            constants.rates(y, &place, friction, film, actuation)
        });
        let end = play.place(constants, self.state[W], friction_at(self.state[WALL]), &whole);
        play.held = end;
        let mut lost = play.memory.advance(&constants.hysteresis, &whole, [start, middle, end]);
        if let EndMotion::Driven(_) = constants.motion {
            let coulomb_n = friction_at(self.state[WALL]);
            let (slider, heat) = constants.coulomb.settle(self.slider, end.length, coulomb_n);
            self.slider = slider;
            lost += heat;
        }
        let to_wall = constants.friction_to_wall * lost;
        self.state[FRICTION] += lost;
        self.state[FRICTION_TO_WALL] += to_wall;
        self.state[WALL] += to_wall / constants.wall_j_k;
        let work = work_through([start, middle, end].map(|place| (place.pressure, place.volume)));
        self.work_j += work;
        let heat = constants.closure.heat_per_work() * work;
        self.state[HEAT] += heat;
        self.state[WALL] += heat / constants.wall_j_k;
        let flows = (
            (self.state[MASS_IN] - flowed_kg[0]) / step,
            (self.state[MASS_OUT] - flowed_kg[1]) / step,
        );
        self.stirred = self.constants.heat.stirred(&self.stirred, flows, step);
        self.set_film();
    }

    fn set_film(&mut self) {
        let Self { constants, state, play, .. } = self;
        let place = &play.held;
        let gas_k = constants.closure.temperature(place.pressure, place.volume, state[MASS]);
        let forced = constants.heat.forced(&self.stirred, gas_k);
        let heat = &constants.heat;
        self.film = heat.film(place.pressure, gas_k, state[WALL], &forced, heat.whole());
    }

    fn observe(&mut self, time: f64, actuation: Actuation) {
        let Self { constants, state, play, film, .. } = self;
        let place = &play.held;
        let closure = &constants.closure;
        let temperature = closure.temperature(place.pressure, place.volume, state[MASS]);
        let pressed = constants.pressed.factor(place.pressure - constants.pull.ambient_pa);
        let limit = constants.friction_n * pressed * constants.softening.factor(state[WALL]);
        let rates = constants.rates(state, place, limit, film, actuation);
        let Held { slip_n, creep_n, .. } = place.held;
        let pull_n = constants.pull.force(place.pressure, place.length);
        let excess = pull_n - slip_n - creep_n - constants.pull.load_n;
        self.truth = Truth {
            time_s: time,
            pressure_pa: place.pressure,
            volume_m3: place.volume,
            length_m: place.length,
            speed_m_s: constants.speed(place, rates[W]),
            mass_kg: state[MASS],
            flow_in_kg_s: rates[MASS_IN],
            flow_out_kg_s: rates[MASS_OUT],
            gas_temperature_k: temperature,
            wall_temperature_k: state[WALL],
            friction_n: match constants.motion {
                EndMotion::Fixed => 0.0,
                EndMotion::Free => slip_n + excess.clamp(-limit, limit),
                EndMotion::Driven(_) => {
                    slip_n + constants.coulomb.force(self.slider, place.length, limit)
                }
            },
            ..Truth::default()
        };
        self.sensors.read(&mut self.truth);
    }
}

impl<C: Chamber + Copy + Send> DrivenEnd for Lumped<C> {
    fn drive_end(&mut self, speed_m_s: f64) {
        self.constants.motion = EndMotion::Driven(speed_m_s);
    }

    fn tension_n(&self) -> f64 {
        let Place { pressure, length, held, .. } = self.play.held;
        self.constants.pull.force(pressure, length) - held.creep_n - self.truth.friction_n
    }
}

impl<C: Chamber + Copy + Send> Plant for Lumped<C> {
    fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged> {
        let substeps = self.constants.substeps.now(&self.constants.piping);
        let step = self.constants.step_s / f64::from(substeps);
        for _ in 0..substeps {
            self.substep(step, actuation);
        }
        self.steps += 1;
        let time = self.steps as f64 * self.constants.step_s;
        let place = &self.play.held;
        let closure = &self.constants.closure;
        let temperature = closure.temperature(place.pressure, place.volume, self.state[MASS]);
        check_gas(time, place.pressure, temperature, self.state[MASS], &self.truth)?;
        check_length(time, place.length, &self.constants.pull.chamber)?;
        self.sensors.advance(&Exposure {
            gas_k: temperature,
            wall_k: self.state[WALL],
            pressure_pa: place.pressure,
            length_m: place.length,
        });
        self.observe(time, actuation);
        Ok(())
    }

    fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError> {
        let Self { constants, sensors, .. } = Self::new(scenario, self.constants.pull.chamber)?;
        self.steps = (self.truth.time_s / constants.step_s).round() as u64;
        self.constants = Constants { given_flows: self.constants.given_flows, ..constants };
        self.set_film();
        self.sensors.retune(&sensors);
        Ok(())
    }

    fn disturb(&mut self, disturbance: Disturbance) {
        self.constants.piping.disturb(disturbance);
    }

    fn shortest_step(&self) -> Option<(f64, &'static str)> {
        Some(self.constants.substeps.shortest(self.constants.step_s))
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
            work_j: self.work_j,
            friction_heat_j: y[FRICTION],
            hysteresis_energy_j: self
                .constants
                .hysteresis
                .energy(self.play.held.held.slip_n, &self.play.memory.stretches),
            friction_to_wall_j: y[FRICTION_TO_WALL],
            heat_to_ambient_j: y[TO_AMBIENT],
            wall_energy_j: self.constants.wall_j_k * (y[WALL] - self.constants.initial_k),
            ..self.initial
        }
    }
}
