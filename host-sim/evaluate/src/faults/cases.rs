//! All faults of the evaluation: size and location, the bits that count as detection, the time
//! limit, and the required reaction.

use super::muscle::{Draw, Task};
use ChannelFault::{Drifting, Frozen, Noisy, Open, Shorted};
use Reaction::{NotStated, Shown, ShownOrVents, Vents, VentsInVain};
use model_core::{Command, Duty, Faults, Telemetry};
use thermyo_plant::Truth;
use thermyo_scenario::{ChannelFault, FaultWindow, LinkFault, Scenario, ValveFault};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaction {
    /// The muscle vents, latched: below 1.2 bar within [`super::VENTED_S`], and stays there.
    Vents,
    /// The muscle vents, latched, but the fault itself keeps gas in, or lets it in: software can
    /// only ensure that the pressure stops rising.
    VentsInVain,
    /// The fault is shown, and control continues.
    Shown,
    /// The fault is shown, and control continues until the muscle vents: the pressure stays below
    /// its limit.
    ShownOrVents,
    /// No requirement: the pressure may rise to the supply's, against which a relief valve
    /// protects.
    NotStated,
}

/// Speed below which motion counts as rest \[m/s\].
const MOVING_M_S: f64 = 0.001;

/// Condition under which the time until detection counts, namely when the fault is visible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counted {
    /// Always, from the start of the fault.
    Always,
    /// While a valve is driven.
    Driven,
    /// While a valve is driven and the muscle moves.
    Moving,
    /// While the inlet is driven and the outlet is not.
    Inlet,
    /// While the outlet is driven and the inlet is not.
    Outlet,
    /// While the pressure is above the limit.
    Above,
}

impl Counted {
    pub fn counts(self, telemetry: &Telemetry, truth: &Truth, above: bool) -> bool {
        let Command { inlet, outlet } = telemetry.command;
        let [inlet, outlet] = [inlet, outlet].map(|duty| duty > Duty::ZERO);
        match self {
            Self::Always => true,
            Self::Driven => inlet || outlet,
            Self::Moving => (inlet || outlet) && truth.speed_m_s.abs() > MOVING_M_S,
            Self::Inlet => inlet && !outlet,
            Self::Outlet => outlet && !inlet,
            Self::Above => above,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Always => "since it came",
            Self::Driven => "of driven valves",
            Self::Moving => "of driven valves and a muscle that moves",
            Self::Inlet => "of the inlet driven alone",
            Self::Outlet => "of the outlet driven alone",
            Self::Above => "above the limit",
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Fault {
    pub name: &'static str,
    /// Injected fault, in words.
    pub size: &'static str,
    /// Tasks of the muscle during the fault.
    pub tasks: &'static [Task],
    pub inject: fn(&mut Draw, &Scenario, &mut FaultWindow),
    /// Bits any of which counts as detection.
    pub found: Faults,
    pub counted: Counted,
    pub within_s: f64,
    pub reaction: Reaction,
    /// Time from the fault's start to the end of the observation \[s\].
    pub observed_s: f64,
}

impl Fault {
    /// Largest RMS error of the estimate while the fault is shown; infinite if there is no
    /// requirement \[K\].
    pub fn error_k(&self) -> f64 {
        match self.found {
            // A drifting reading pulls the estimate along until the fault is found.
            GAS if self.observed_s > 20.0 => 30.0,
            GAS => 4.0,
            LENGTH => 8.0,
            _ => f64::INFINITY,
        }
    }
}

impl Reaction {
    pub fn name(self) -> &'static str {
        match self {
            Self::Vents => "vents, latched",
            Self::VentsInVain => "vents, latched, as far as it can; no pressure rises",
            Self::Shown => "shown, control goes on",
            Self::ShownOrVents => "shown or vents; the pressure stays below its limit",
            Self::NotStated => "none stated",
        }
    }
}

const PRESSURE: Faults = Faults::PRESSURE_SENSOR;
const LENGTH: Faults = Faults::LENGTH_SENSOR;
const GAS: Faults = Faults::GAS_SENSOR;
const FORCE: Faults = Faults::FORCE;
const BURST: Faults = Faults::BURST;
/// Gas flow that the valves do not explain.
const FLOW: Faults =
    Faults::GAS_GAINED.with(Faults::NO_INFLOW).with(Faults::NO_OUTFLOW).with(BURST);
/// Gas that leaves without being replaced.
const LOST: Faults = Faults::LEAK.with(BURST).with(Faults::NO_INFLOW);

/// A fault that is visible at once during every task; without requirements yet.
fn fault(
    name: &'static str,
    size: &'static str,
    inject: fn(&mut Draw, &Scenario, &mut FaultWindow),
) -> Fault {
    Fault {
        name,
        size,
        tasks: &Task::ALL,
        inject,
        found: Faults::NONE,
        counted: Counted::Always,
        within_s: f64::INFINITY,
        reaction: NotStated,
        observed_s: 1.0,
    }
}

impl Fault {
    fn found(self, found: Faults, within_s: f64, reaction: Reaction) -> Self {
        Self { found, within_s, reaction, ..self }
    }

    /// Makes a fault visible only under a condition, or later.
    fn seen(self, counted: Counted, tasks: &'static [Task], observed_s: f64) -> Self {
        Self { counted, tasks, observed_s, ..self }
    }
}

pub fn all() -> Vec<Fault> {
    [
        of_the_pressure_sensor(),
        of_the_gas_sensor(),
        of_the_length_sensor(),
        of_the_valves(),
        of_the_gas(),
        of_the_board(),
    ]
    .concat()
}

fn of_the_pressure_sensor() -> Vec<Fault> {
    vec![
        fault("pressure sensor open", "code 32760", |_, _, w| w.pressure = Open)
            .found(PRESSURE, 0.011, Vents),
        fault("pressure sensor shorted", "code 0", |_, _, w| w.pressure = Shorted)
            .found(PRESSURE, 0.011, Vents),
        fault("pressure sensor frozen", "the code of that moment", |_, _, w| w.pressure = Frozen)
            .found(PRESSURE.with(FLOW), 0.1, Vents)
            .seen(Counted::Driven, &Task::MOVING, 6.0),
        fault("pressure sensor noisy", "5 % of the range", |_, _, w| w.pressure = Noisy)
            .found(PRESSURE, 0.05, Vents),
        fault("pressure sensor drifting up", "10 to 30 kPa/s", |draw, _, w| {
            let rate_per_s = draw.factor([1.0e4, 3.0e4]);
            (w.pressure, w.pressure_drift_pa_s) = (Drifting, Some(rate_per_s));
        })
        .found(PRESSURE.with(FLOW).with(FORCE).with(Faults::OVERPRESSURE), 40.0, Vents)
        .seen(Counted::Always, &Task::ALL, 42.0),
        fault("pressure sensor drifting down", "10 to 30 kPa/s", |draw, _, w| {
            let rate_per_s = -draw.factor([1.0e4, 3.0e4]);
            (w.pressure, w.pressure_drift_pa_s) = (Drifting, Some(rate_per_s));
        })
        .found(PRESSURE.with(FLOW).with(FORCE), f64::INFINITY, NotStated)
        .seen(Counted::Always, &Task::ALL, 32.0),
    ]
}

fn of_the_gas_sensor() -> Vec<Fault> {
    vec![
        fault("gas sensor open", "code 32760", |_, _, w| w.gas = Open).found(GAS, 0.001, Shown),
        fault("gas sensor shorted", "code 0", |_, _, w| w.gas = Shorted).found(GAS, 0.001, Shown),
        fault("gas sensor frozen", "the code of that moment", |_, _, w| w.gas = Frozen)
            .found(GAS, 12.0, Shown)
            .seen(Counted::Always, &Task::MOVING, 14.0),
        fault("gas sensor noisy", "5 % of the range", |_, _, w| w.gas = Noisy)
            .found(GAS, 0.05, Shown),
        fault("gas sensor drifting", "0.5 to 3 K/s, up or down", |draw, _, w| {
            let rate_per_s = draw.sign() * draw.factor([0.5, 3.0]);
            (w.gas, w.gas_drift_k_s) = (Drifting, Some(rate_per_s));
        })
        .found(GAS, 20.0, Shown)
        .seen(Counted::Always, &Task::ALL, 22.0),
    ]
}

fn of_the_length_sensor() -> Vec<Fault> {
    let drifting = "2 to 10 % of the rest length per second, up or down";
    vec![
        fault("length sensor open", "code 32760", |_, _, w| w.length = Open)
            .found(LENGTH, 0.001, Shown),
        fault("length sensor shorted", "code 0", |_, _, w| w.length = Shorted)
            .found(LENGTH, 0.001, Shown),
        fault("length sensor frozen", "the code of that moment", |_, _, w| w.length = Frozen)
            .found(LENGTH, 0.2, Shown)
            .seen(Counted::Moving, &Task::MOVING, 6.0),
        fault("length sensor noisy", "5 % of the range", |_, _, w| w.length = Noisy)
            .found(LENGTH, 0.05, Shown),
        fault("length sensor drifting", drifting, |draw, s, w| {
            let rest_m = s.muscle.rest_length_m;
            let rate_per_s = draw.sign() * draw.factor([0.02, 0.1]) * rest_m;
            (w.length, w.length_drift_m_s) = (Drifting, Some(rate_per_s));
        })
        .found(LENGTH.with(FORCE).with(FLOW), 20.0, ShownOrVents)
        .seen(Counted::Always, &Task::ALL, 22.0),
    ]
}

fn of_the_valves() -> Vec<Fault> {
    vec![
        fault("overpressure", "inlet commanded open, supply of 7.5 to 10 bar", |draw, _, w| {
            w.supply_pressure_pa = Some(draw.between([7.5e5, 1.0e6]));
        })
        .found(Faults::OVERPRESSURE, 0.015, Vents)
        .seen(Counted::Above, &[Task::Filling], 6.0),
        fault("inlet stuck open", "its full conductance", |_, _, w| w.inlet = ValveFault::Open)
            .found(FLOW.with(Faults::OVERPRESSURE), 1.0, VentsInVain)
            .seen(Counted::Always, &Task::ALL, 3.0),
        fault("inlet stuck shut", "no flow", |_, _, w| w.inlet = ValveFault::Shut)
            .found(Faults::NO_INFLOW, 2.0, Vents)
            .seen(Counted::Inlet, &Task::MOVING, 8.0),
        fault("inlet leaking", "5 to 20 % of its conductance", |draw, _, w| {
            let share = draw.factor([0.05, 0.2]);
            (w.inlet, w.inlet_leak) = (ValveFault::Leaking, Some(share));
        })
        .found(FLOW.with(Faults::OVERPRESSURE), 20.0, VentsInVain)
        .seen(Counted::Always, &Task::HOLDING, 22.0),
        fault("outlet stuck open", "its full conductance", |_, _, w| w.outlet = ValveFault::Open)
            .found(FLOW, 2.0, Vents)
            .seen(Counted::Always, &Task::ALL, 3.0),
        fault("outlet stuck shut", "no flow", |_, _, w| w.outlet = ValveFault::Shut)
            .found(Faults::NO_OUTFLOW, 2.0, VentsInVain)
            .seen(Counted::Outlet, &Task::MOVING, 8.0),
        fault("outlet leaking", "5 to 20 % of its conductance", |draw, _, w| {
            let share = draw.factor([0.05, 0.2]);
            (w.outlet, w.outlet_leak) = (ValveFault::Leaking, Some(share));
        })
        .found(LOST, 30.0, ShownOrVents)
        .seen(Counted::Always, &Task::HOLDING, 32.0),
    ]
}

fn of_the_gas() -> Vec<Fault> {
    vec![
        fault("muscle leaks", "a hole of 5 to 20 % of a valve", |draw, s, w| {
            let share = draw.factor([0.05, 0.2]);
            w.leak_conductance_m3_s_pa = share * s.valve.conductance_m3_s_pa;
        })
        .found(LOST, 30.0, ShownOrVents)
        .seen(Counted::Always, &Task::HOLDING, 32.0),
        fault("muscle bursts", "a hole of two to five valves", |draw, s, w| {
            let share = draw.factor([2.0, 5.0]);
            w.leak_conductance_m3_s_pa = share * s.valve.conductance_m3_s_pa;
        })
        .found(FLOW, 2.0, Vents)
        .seen(Counted::Always, &Task::ALL, 3.0),
        fault("supply lost", "the ambient's pressure in its place", |_, s, w| {
            w.supply_pressure_pa = Some(s.ambient.pressure_pa);
        })
        .found(Faults::NO_INFLOW.with(BURST), 1.0, Vents)
        .seen(Counted::Inlet, &Task::MOVING, 8.0),
    ]
}

fn of_the_board() -> Vec<Fault> {
    vec![
        fault("emergency stop", "pressed for 1 to 100 ms", |draw, _, w| {
            w.emergency_stop = true;
            w.until_s = w.from_s + draw.between([0.001, 0.1]);
        })
        .found(Faults::EMERGENCY_STOP, 0.001, Vents),
        fault("link lost", "the host goes silent; link.timeout_s = 0.5", |_, _, w| {
            w.link = LinkFault::Lost;
        })
        .found(Faults::LINK_LOST, 0.501, Vents),
        fault("link flooded", "more requests than the board takes", |_, _, w| {
            w.link = LinkFault::Flooded;
        })
        .found(Faults::LINK_FLOODED, 0.001, Shown),
        fault("missed steps", "5 to 200 left out together, or one in ten", |draw, s, w| {
            (w.missed_steps, w.missed_period_s) = if draw.sign() > 0.0 {
                (draw.between([5.0, 200.0]) as u8, w.until_s)
            } else {
                (1, 10.0 * s.run.step_s)
            };
        })
        .found(Faults::MISSED_STEPS, 0.2, Vents),
        fault("board restarts", "and is not configured again", |_, _, w| w.board_restart = true)
            .found(Faults::NOT_CONFIGURED, 0.001, Vents),
    ]
}
