//! The simulated plant in f64: true states of the gas, the muscle and the sensing elements.
//!
//! It shares no equations with the code of `model-core`, so that a test that compares the two compares two derivations.

#![warn(clippy::disallowed_methods)]

mod bristle;
mod build;
pub mod chamber;
mod closure;
mod end;
pub mod flow;
mod full;
pub mod gas;
pub mod heat;
pub mod hysteresis;
pub mod joint;
mod lag;
pub mod line;
mod local_power;
mod lumped;
mod ode;
mod piping;
mod proportional;
mod pull;
pub mod pulley;
mod pwm;
mod radial;
mod sensors;
mod start;
mod valve;
mod vessel;
pub mod zones;

pub use build::{build, build_driven_by_flows, build_driven_end};
use chamber::Chamber;
use model_core::Command;
use piping::Piping;
pub use piping::{Disturbance, Travel};
pub use pull::load_n;
use serde::Serialize;
pub use start::start_m;
use thermyo_scenario::Scenario;

/// Inputs of the plant during one step: the fraction of the step for which each valve is driven, 0
/// to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Actuation {
    pub inlet: f64,
    /// Outlet valve. A normally open valve is driven to close; this is its opening.
    pub outlet: f64,
}

impl From<Command> for Actuation {
    fn from(command: Command) -> Self {
        Self { inlet: f64::from(command.inlet.share()), outlet: f64::from(command.outlet.share()) }
    }
}

/// The plant's state as an outside observer with perfect instruments would see it, SI.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Truth {
    pub time_s: f64,
    /// Absolute pressure in the muscle or vessel \[Pa\].
    pub pressure_pa: f64,
    pub volume_m3: f64,
    /// Muscle length; a vessel's is its volume over its section \[m\].
    pub length_m: f64,
    /// Rate of change of the length \[m/s\].
    pub speed_m_s: f64,
    pub mass_kg: f64,
    pub flow_in_kg_s: f64,
    pub flow_out_kg_s: f64,
    /// Mass-weighted mean gas temperature \[K\].
    pub gas_temperature_k: f64,
    /// Mean temperature of the wall, weighted by heat capacity \[K\].
    pub wall_temperature_k: f64,
    pub sensor_gas_k: f64,
    pub sensor_wall_k: f64,
    /// Pressure at the sensor's element after its lag \[Pa\].
    pub sensor_pressure_pa: f64,
    /// Length at the potentiometer's wiper after its lag \[m\].
    pub sensor_length_m: f64,
    /// Force of friction and slip, positive when it opposes contraction \[N\].
    pub friction_n: f64,
}

/// The ledger of one run: flows in and out since the start, and the content, in J and kg.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Ledger {
    pub mass_initial_kg: f64,
    pub mass_kg: f64,
    pub mass_in_kg: f64,
    pub mass_out_kg: f64,
    /// Internal energy of the gas at the start \[J\].
    pub energy_initial_j: f64,
    /// Internal energy of the gas now \[J\].
    pub energy_j: f64,
    pub enthalpy_in_j: f64,
    pub enthalpy_out_j: f64,
    pub heat_to_wall_j: f64,
    /// Work of the gas on the muscle's wall (integral of P dV) \[J\].
    pub work_j: f64,
    /// Heat of friction, slip and creep \[J\].
    pub friction_heat_j: f64,
    /// Energy that slip and creep hold now \[J\].
    pub hysteresis_energy_j: f64,
    /// Part of the friction heat that went into the wall \[J\].
    pub friction_to_wall_j: f64,
    pub heat_to_ambient_j: f64,
    /// Energy of the wall now, relative to the initial temperature \[J\].
    pub wall_energy_j: f64,
}

impl Ledger {
    /// The additions to the ledger since `earlier`.
    pub fn since(&self, earlier: &Self) -> Self {
        Self {
            mass_initial_kg: earlier.mass_kg,
            mass_kg: self.mass_kg,
            mass_in_kg: self.mass_in_kg - earlier.mass_in_kg,
            mass_out_kg: self.mass_out_kg - earlier.mass_out_kg,
            energy_initial_j: earlier.energy_j,
            energy_j: self.energy_j,
            enthalpy_in_j: self.enthalpy_in_j - earlier.enthalpy_in_j,
            enthalpy_out_j: self.enthalpy_out_j - earlier.enthalpy_out_j,
            heat_to_wall_j: self.heat_to_wall_j - earlier.heat_to_wall_j,
            work_j: self.work_j - earlier.work_j,
            friction_heat_j: self.friction_heat_j - earlier.friction_heat_j,
            hysteresis_energy_j: self.hysteresis_energy_j,
            friction_to_wall_j: self.friction_to_wall_j - earlier.friction_to_wall_j,
            heat_to_ambient_j: self.heat_to_ambient_j - earlier.heat_to_ambient_j,
            wall_energy_j: self.wall_energy_j - earlier.wall_energy_j,
        }
    }

    /// Error of the mass balance, relative to the mass handled.
    pub fn mass_balance_error(&self) -> f64 {
        let residual = self.mass_kg - self.mass_initial_kg - self.mass_in_kg + self.mass_out_kg;
        residual.abs() / (self.mass_initial_kg + self.mass_in_kg + self.mass_out_kg)
    }

    /// Error of the gas's energy balance, relative to the energy handled.
    pub fn energy_balance_error(&self) -> f64 {
        let residual = self.energy_j - self.energy_initial_j - self.enthalpy_in_j
            + self.enthalpy_out_j
            + self.heat_to_wall_j
            + self.work_j;
        residual.abs() / (self.energy_initial_j + self.enthalpy_in_j + self.enthalpy_out_j)
    }

    /// Error of the wall's energy balance, relative to the energy that the gas handled.
    pub fn wall_balance_error(&self) -> f64 {
        let residual = self.wall_energy_j - self.heat_to_wall_j - self.friction_to_wall_j
            + self.heat_to_ambient_j;
        residual.abs() / (self.energy_initial_j + self.enthalpy_in_j + self.enthalpy_out_j)
    }
}

/// The plant left the range in which its equations hold.
// Rounded to microseconds: a multiple of the step may print as 0.009000000000000001.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the plant diverged at {} s: {state}", (time_s * 1e6).round() / 1e6)]
pub struct Diverged {
    pub time_s: f64,
    /// The state, as `name = value unit` pairs.
    pub state: String,
}

pub trait Plant: Send {
    /// Makes an [`Actuation`] the action of a board's pins in each step, from the start on. Otherwise it is their duty,
    /// from which the plant makes its own pulses. For ideal valves both are the same: their mean opening in a step.
    fn follow_pins(&mut self) {}
    /// Advances by one exchange step (`[run] step_s`).
    fn advance(&mut self, actuation: Actuation) -> Result<(), Diverged>;
    /// Takes over the numbers of `[supply]`, `[load]`, `[heat]` and the sensors' lags from the next step on; states are
    /// kept. A muscle may go on with another exchange step if the time is a multiple of it. All other keys must equal
    /// those with which the plant was built.
    ///
    /// # Errors
    /// As [`build`]; on an error nothing has changed.
    fn retune(&mut self, scenario: &Scenario) -> Result<(), BuildError>;
    /// Sets the faults of the plant from the next step on.
    fn disturb(&mut self, disturbance: Disturbance);
    fn truth(&self) -> Truth;
    /// Shortest integration step \[s\], and the keys that make it so short, of a plant that divides its steps.
    fn shortest_step(&self) -> Option<(f64, &'static str)> {
        None
    }
    /// The ledger since the start.
    fn ledger(&self) -> Ledger;
    /// Wall surface temperature per axial zone, port first \[K\]; one element without zones.
    fn axial_wall_k(&self) -> Vec<f64> {
        vec![self.truth().wall_temperature_k]
    }
    /// Gas temperature per axial zone, port first \[K\]; one element without zones.
    fn axial_gas_k(&self) -> Vec<f64> {
        vec![self.truth().gas_temperature_k]
    }
}

/// A muscle, cylinder or table whose end a mechanism moves.
pub trait DrivenEnd: Plant {
    /// Changes the length at this rate from the next step on \[m/s\]. The previous hold of the end is released:
    /// friction, slip and creep act on the mechanism.
    fn drive_end(&mut self, speed_m_s: f64);
    /// Force that pulls the ends together now, friction included; negative where it pushes \[N\].
    fn tension_n(&self) -> f64;
}

/// Shortest integration step of a muscle, a thousandth of the usual one: a simulated second takes
/// minutes \[s\].
const SHORTEST_STEP_S: f64 = 1.0e-7;

/// The key that makes the plant too fast, if it is the leak or a hole.
const LEAK_TOO_LARGE: &str = "leak.conductance_m3_s_pa is too large for the gas's volume";
const HOLE_TOO_LARGE: &str =
    "leak_conductance_m3_s_pa of [faults] is too large for the gas's volume";

/// Reason why a valid scenario gives no plant.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BuildError {
    #[error("the vessel's volume at {time_s} s is {volume_m3} m3; it must be positive")]
    VolumeNotPositive { time_s: f64, volume_m3: f64 },
    #[error("plant.kind = \"vessel\" has no end that moves")]
    NoEnd,
    /// The arm of a joint swings faster than it is integrated.
    #[error(
        "joint.inertia_kg_m2: must be at least {least_kg_m2:.1e} kg m2, by run.step_s and the stiffness of gas, \
         joint.gravity_n_m, joint.friction_n_m, friction.presliding_stiffness_n_m and muscle.slip_stiffness_n_m"
    )]
    TooLight { least_kg_m2: f64 },
    /// The plant is so fast that a run would not end.
    #[error(
        "{because}: it asks for integration steps of {asked_s:.1e} s, at least {SHORTEST_STEP_S:.0e} s are taken"
    )]
    TooFast {
        /// Required integration step, below 1e-7 \[s\].
        asked_s: f64,
        /// Keys that make it so fast.
        because: &'static str,
    },
}

/// Integration steps in an exchange step, and the keys that make them so many.
type Count = (u32, &'static str);

/// Number of integration steps in an exchange step, each of at most `longest_s`; `because` names the
/// keys that limit it.
fn substeps(step_s: f64, longest_s: f64, because: &'static str) -> Result<Count, BuildError> {
    if longest_s < SHORTEST_STEP_S {
        return Err(BuildError::TooFast { asked_s: longest_s, because });
    }
    // 10.000000000000002 substeps are 10.
    Ok(((step_s / longest_s - 1e-9).ceil().max(1.0) as u32, because))
}

/// Integration steps per exchange step. A hole needs shorter ones only while it is open: until
/// then the run is the same to the bit as without it.
#[derive(Debug, Clone, Copy)]
struct Substeps {
    whole: Count,
    holed: Count,
}

impl Substeps {
    /// One step, until the numbers are known.
    const ONE: Self = Self { whole: (1, ""), holed: (1, "") };

    /// `of` returns the number of steps for the leak and a hole, in open valves, and the key to name if they are too
    /// large. `hottest_k`: highest upstream temperature \[K\].
    fn new(
        scenario: &Scenario,
        piping: &Piping,
        hottest_k: f64,
        of: impl Fn(f64, &'static str) -> Result<Count, BuildError>,
    ) -> Result<Self, BuildError> {
        let largest = piping.in_valves(scenario.faults.largest_leak_m3_s_pa());
        let always = piping.leak_in_valves(hottest_k);
        Ok(Self {
            whole: of(always, LEAK_TOO_LARGE)?,
            holed: of(always + largest, HOLE_TOO_LARGE)?,
        })
    }

    fn now(self, piping: &Piping) -> u32 {
        if piping.is_holed() { self.holed.0 } else { self.whole.0 }
    }

    /// As [`Plant::shortest_step`].
    fn shortest(self, step_s: f64) -> (f64, &'static str) {
        let (count, because) = if self.holed.0 > self.whole.0 { self.holed } else { self.whole };
        (step_s / f64::from(count), because)
    }
}

/// Checks a gas state: finite, positive pressure and mass, 20 to 2000 K. `before` is the last
/// valid state.
fn check_gas(
    time_s: f64,
    pressure: f64,
    temperature: f64,
    mass: f64,
    before: &Truth,
) -> Result<(), Diverged> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if positive(pressure) && positive(mass) && (20.0..=2000.0).contains(&temperature) {
        return Ok(());
    }
    let Truth { pressure_pa, gas_temperature_k, mass_kg, .. } = before;
    Err(Diverged {
        time_s,
        state: format!(
            "pressure = {pressure} Pa, temperature = {temperature} K, mass = {mass} kg; a step before \
             {pressure_pa:.3e} Pa, {gas_temperature_k:.0} K, {mass_kg:.2e} kg. A drive that takes out \
             more gas than there is does that, or a value far from its default"
        ),
    })
}

/// Checks that a length is within the range of the chamber's equations.
fn check_length(time_s: f64, length: f64, chamber: &impl Chamber) -> Result<(), Diverged> {
    let [shortest, longest] = chamber.range();
    if length >= shortest && length <= longest {
        return Ok(());
    }
    let state = format!(
        "length = {length} m, and what is known of it reaches from {shortest} to {longest} m"
    );
    Err(Diverged { time_s, state })
}

/// Work of the gas, the integral of P dV through three equidistant instants: exact where P and V are
/// quadratic in time. It uses the volumes themselves, not dV/dt, which jumps where the braid
/// starts to slide.
fn work_through(places: [(f64, f64); 3]) -> f64 {
    let [(p0, v0), (pm, vm), (p1, v1)] = places;
    (p0 * (4.0 * vm - 3.0 * v0 - v1) + 4.0 * pm * (v1 - v0) + p1 * (v0 - 4.0 * vm + 3.0 * v1)) / 6.0
}
