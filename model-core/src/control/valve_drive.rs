//! From a requested gas mass to valve openings, one PWM period at a time.
//!
//! The mass flow of the open valve (ISO 6358) gives the time for which a valve must be open; a poppet that needs a
//! switching time t_s for its stroke turns a pulse w into an opening o of
//!
//! ```text
//! o = w                for t_s <= w <= T - t_s    what opening loses, closing gains
//! o = w^2/t_s          for w < t_s                the poppet turns before its stop: a triangle
//! o = T - (T-w)^2/t_s  for w > T - t_s            the same with the gap between two pulses
//! ```
//!
//! and this module inverts that. Dead time only shifts a pulse: its part that arrives after the next period's
//! measurement goes to the loops ([`FlowDrive::in_flight_kg`]). Pulses shorter than the shortest useful one are not
//! given; flows that need such pulses become rare ones of the shortest length ([`FlowDrive::flow`]). The valves are
//! never open together: after a pulse that reaches into the next period the other valve waits for one, within which the
//! first shuts: `Config::check` allows no switching time longer than a period.
//!
//! A proportional valve is held open by the share of the period for which a switching valve would be open; its command
//! is the inverse of the static curve ([`Spool::command`]). The opening s follows with a lag tau. Its equation is
//! linear, so a command for the opening o moves o T in all, however slow the valve is. The command acts for T - d of
//! its period, d being the dead time; after the period,
//!
//! ```text
//! o d + tau (o + (s - o) exp(-(T - d)/tau))
//! ```
//!
//! of an open valve's flow are in flight.

use crate::config::Config;
use crate::math::{exp, limit, sqrt};
use crate::physics::gas::Reservoir;
use crate::physics::valve::{Spool, Valve, ValveKind};
use crate::sample::{Command, Duty};

/// The valve that the last pulse keeps open beyond its period's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CarryOver {
    None,
    Inlet,
    Outlet,
}

/// Smallest opening that is given: a proportional valve repeats to a percent at best (assumption). A loop that is
/// nearly at rest then waits until its error is worth one \[-\].
const LEAST_OPENING: f32 = 0.01;
/// Opening below which a closing valve counts as shut \[-\].
const SHUT: f32 = 1.0e-3;

/// One proportional valve.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Follower {
    /// Opening at the end of the last period, a dead time late \[-\].
    opening: f32,
    /// Flow of the open valve when it was last driven \[kg/s\].
    open_kg_s: f32,
}

impl Follower {
    const SHUT: Self = Self { opening: 0.0, open_kg_s: 0.0 };

    /// Runs a period with a command for this opening; returns the mass that moves after it \[kg\].
    fn follow(&mut self, lag: &Lag, opening: f32) -> f32 {
        let approach = |share: f32| opening + (self.opening - opening) * share;
        let at_end = approach(lag.felt);
        let after_s = opening * lag.dead_time_s + lag.lag_s * at_end;
        self.opening = approach(lag.whole);
        if opening == 0.0 && self.opening < SHUT {
            *self = Self::SHUT;
        }
        after_s * self.open_kg_s
    }
}

/// The lag of both proportional valves over a period.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lag {
    dead_time_s: f32,
    lag_s: f32,
    /// exp(-t/tau) of a period less the dead time, and of a whole one \[-\].
    felt: f32,
    whole: f32,
}

impl Lag {
    fn new(spool: &Spool, valve: &Valve, period_s: f32) -> Self {
        let (lag_s, dead_time_s) = (spool.lag_s(), limit(valve.dead_time_s, 0.0, period_s));
        Self {
            dead_time_s,
            lag_s,
            felt: exp((dead_time_s - period_s) / lag_s),
            whole: exp(-period_s / lag_s),
        }
    }
}

/// A requested opening for a period.
struct Ask {
    filling: bool,
    /// Time for which the valve must be open \[s\].
    opening_s: f32,
    /// Flow of the open valve \[kg/s\].
    full_kg_s: f32,
    period_s: f32,
}

/// Conversion of an opening into a command.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    /// With the mass that a pulse moves later than a period after its own end \[kg\].
    Pulsed {
        carry_over: CarryOver,
        later_kg: f32,
    },
    Metered {
        spool: Spool,
        lag: Lag,
        inlet: Follower,
        outlet: Follower,
    },
}

impl Stage {
    fn new(config: &Config, period_s: f32) -> Self {
        match config.valve_kind {
            ValveKind::Switching => Self::Pulsed { carry_over: CarryOver::None, later_kg: 0.0 },
            ValveKind::Proportional(spool) => Self::Metered {
                spool,
                lag: Lag::new(&spool, &config.valve, period_s),
                inlet: Follower::SHUT,
                outlet: Follower::SHUT,
            },
        }
    }

    /// Runs a period with both valves closed; returns the mass that arrives after its end \[kg\].
    fn close(&mut self) -> f32 {
        match self {
            Self::Pulsed { carry_over, later_kg } => {
                *carry_over = CarryOver::None;
                core::mem::take(later_kg)
            }
            Self::Metered { lag, inlet, outlet, .. } => {
                inlet.follow(lag, 0.0) - outlet.follow(lag, 0.0)
            }
        }
    }

    /// Returns the share of the command for an opening, and the mass that arrives after the period \[kg\]; `None` if
    /// the opening is too small, or has to wait for the other valve.
    fn give(&mut self, config: &Config, ask: &Ask, pwm_hz: f32) -> Option<(f32, f32)> {
        let Ask { filling, opening_s, full_kg_s, period_s } = *ask;
        match self {
            Self::Pulsed { carry_over, later_kg } => {
                let other = if filling { CarryOver::Outlet } else { CarryOver::Inlet };
                let pulse_s = pulse_for_opening_s(&config.valve, period_s, opening_s);
                let worth_it = pulse_s >= config.controller.minimum_pulse_s && pulse_s > 0.0;
                if !worth_it || *carry_over == other {
                    return None;
                }
                let switch_s = config.valve.switch_time_s;
                let shuts_s = pulse_s + switch_s;
                *carry_over = match (shuts_s > period_s, filling) {
                    (false, _) => CarryOver::None,
                    (true, true) => CarryOver::Inlet,
                    (true, false) => CarryOver::Outlet,
                };
                let flow_kg_s = if filling { full_kg_s } else { -full_kg_s };
                // The poppet starts to move a dead time after the pin, and is closed a switching time after the pulse.
                let shut_s = shuts_s + config.valve.dead_time_s;
                let after_kg = |end_s: f32| {
                    if shut_s <= end_s {
                        return 0.0;
                    }
                    flow_kg_s * limit(tail_s(shut_s - end_s, switch_s), 0.0, opening_s)
                };
                let mut in_flight_kg = core::mem::take(later_kg);
                // Most pulses end within their period.
                if shut_s > period_s {
                    in_flight_kg += after_kg(period_s);
                    *later_kg = after_kg(2.0 * period_s);
                }
                Some((pulse_s * pwm_hz, in_flight_kg))
            }
            Self::Metered { spool, lag, inlet, outlet } => {
                let opening = opening_s * pwm_hz;
                if !(opening >= LEAST_OPENING) {
                    return None;
                }
                let (into, out_of) = if filling { (opening, 0.0) } else { (0.0, opening) };
                (if filling { &mut *inlet } else { &mut *outlet }).open_kg_s = full_kg_s;
                let in_flight_kg = inlet.follow(lag, into) - outlet.follow(lag, out_of);
                Some((spool.command(opening), in_flight_kg))
            }
        }
    }

    /// Takes over openings that a set point gives directly.
    fn take(&mut self, command: Command) {
        match self {
            Self::Pulsed { carry_over, later_kg } => {
                *later_kg = 0.0;
                *carry_over = if command.outlet > Duty::ZERO {
                    CarryOver::Outlet
                } else if command.inlet > Duty::ZERO {
                    CarryOver::Inlet
                } else {
                    CarryOver::None
                };
            }
            // The next period assumes that the opening has been reached; the mass that moves after it is unknown.
            Self::Metered { spool, inlet, outlet, .. } => {
                let taken = |duty: Duty| Follower {
                    opening: spool.opening(duty.share()),
                    ..Follower::SHUT
                };
                (*inlet, *outlet) = (taken(command.inlet), taken(command.outlet));
            }
        }
    }
}

/// State of the valve layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowDrive {
    /// PWM periods that count as one.
    joined: u8,
    period_s: f32,
    pwm_hz: f32,
    /// Mass that remains to be moved, positive into the muscle \[kg\].
    owed_kg: f32,
    in_flight_kg: f32,
    stage: Stage,
    saturated: bool,
}

impl FlowDrive {
    /// Creates a drive that owes nothing.
    ///
    /// ```
    /// use model_core::control::valve_drive::FlowDrive;
    /// use model_core::physics::gas::Reservoir;
    /// use model_core::{Config, Duty};
    ///
    /// let config = Config::default();
    /// let mut drive = FlowDrive::new(&config);
    /// let muscle = Reservoir { pressure_pa: 2.0e5, temperature_k: 298.0 };
    /// let wanted_kg = drive.owing_kg(1.0e-3);
    /// assert!(drive.flow(&config, wanted_kg, muscle).inlet > Duty::ZERO);
    /// ```
    pub fn new(config: &Config) -> Self {
        let period_s = f32::from(config.pwm_period_steps) * config.step_s;
        Self {
            joined: 1,
            period_s,
            pwm_hz: 1.0 / period_s,
            owed_kg: 0.0,
            in_flight_kg: 0.0,
            stage: Stage::new(config, period_s),
            saturated: false,
        }
    }

    /// Treats `joined` PWM periods as one from now on: a pulse is one pulse over all of them, a proportional valve's
    /// command is held for all.
    pub fn join(&mut self, config: &Config, joined: u8) {
        if joined != self.joined {
            self.joined = joined;
            let steps = config.pwm_period_steps.saturating_mul(joined.into());
            self.period_s = f32::from(steps) * config.step_s;
            self.pwm_hz = 1.0 / self.period_s;
            if let Stage::Metered { spool, lag, .. } = &mut self.stage {
                *lag = Lag::new(spool, &config.valve, self.period_s);
            }
        }
    }

    /// Number of PWM periods that are joined into one.
    pub fn joined(&self) -> u8 {
        self.joined
    }

    /// Openings in the PWM period number `begun` of a command for all joined ones.
    pub fn part(&self, command: Command, begun: u8) -> Command {
        if self.joined == 1 || matches!(self.stage, Stage::Metered { .. }) {
            return command;
        }
        let whole = f32::from(self.joined);
        let of = |duty: Duty| Duty::from_share(duty.share() * whole - f32::from(begun));
        Command { inlet: of(command.inlet), outlet: of(command.outlet) }
    }

    /// Forgets the owed mass: a new set point starts without it.
    pub fn reset(&mut self) {
        self.owed_kg = 0.0;
    }

    /// Length of the PWM period, or of the joined ones \[s\].
    pub fn period_s(&self) -> f32 {
        self.period_s
    }

    /// Reciprocal of the period \[Hz\].
    pub fn pwm_hz(&self) -> f32 {
        self.pwm_hz
    }

    /// Mass, positive into the muscle, that the last pulse moves after its period's end \[kg\].
    pub fn in_flight_kg(&self) -> f32 {
        self.in_flight_kg
    }

    /// Whether more was requested for the last period than the open valve passes.
    pub fn saturated(&self) -> bool {
        self.saturated
    }

    /// Closes both valves for a period.
    pub fn closed(&mut self) -> Command {
        self.in_flight_kg = self.stage.close();
        self.saturated = false;
        Command::CLOSED
    }

    /// Takes openings directly from a set point; the mass that they move is unknown.
    pub fn direct(&mut self, command: Command) -> Command {
        self.in_flight_kg = 0.0;
        self.saturated = false;
        self.stage.take(command);
        command
    }

    /// Mass that a flow of `flow_kg_s` (negative: out) has to move in the coming period, including the mass owed in its
    /// own direction. Mass owed in the other direction would work against it.
    pub fn owing_kg(&self, flow_kg_s: f32) -> f32 {
        let owed_kg = if flow_kg_s > 0.0 {
            limit(self.owed_kg, 0.0, f32::MAX)
        } else if flow_kg_s < 0.0 {
            limit(self.owed_kg, f32::MIN, 0.0)
        } else {
            0.0
        };
        owed_kg + flow_kg_s * self.period_s
    }

    /// Openings for the coming period that move the permitted part of [`Self::owing_kg`]. Mass that the period cannot
    /// move, or that is too little for a pulse, is owed to the next one.
    pub fn flow(&mut self, config: &Config, mass_kg: f32, muscle: Reservoir) -> Command {
        let (command, moved_kg, full_kg) = self.pulse(config, mass_kg, muscle, None);
        // Mass beyond two open periods is not owed.
        self.owed_kg = limit(mass_kg - moved_kg, -2.0 * full_kg, 2.0 * full_kg);
        command
    }

    /// Openings for the coming period that move `mass_kg` (negative: out), once. For a loop, which measures the rest.
    pub fn mass(&mut self, config: &Config, mass_kg: f32, muscle: Reservoir) -> Command {
        self.pulse(config, mass_kg, muscle, None).0
    }

    /// Does the same as [`mass`](Self::mass) for a loop that has already computed an open valve's flow.
    pub fn mass_through(
        &mut self,
        config: &Config,
        mass_kg: f32,
        muscle: Reservoir,
        open: OpenFlow,
    ) -> Command {
        self.pulse(config, mass_kg, muscle, Some(open)).0
    }

    /// Returns the command for a mass, the mass that it moves, and the mass of a whole period.
    fn pulse(
        &mut self,
        config: &Config,
        mass_kg: f32,
        muscle: Reservoir,
        known: Option<OpenFlow>,
    ) -> (Command, f32, f32) {
        let filling = mass_kg > 0.0;
        let full_kg_s = match known {
            Some(open) if open.filling == filling => open.kg_s,
            _ => OpenFlow::new(config, mass_kg, muscle).kg_s,
        };
        let full_kg = full_kg_s * self.period_s;
        let wanted_kg = if filling { mass_kg } else { -mass_kg };
        let opening_s = if wanted_kg < full_kg {
            wanted_kg / full_kg_s
        } else if full_kg > 0.0 {
            self.period_s
        } else {
            0.0
        };
        let saturated = wanted_kg > full_kg;
        let ask = Ask { filling, opening_s, full_kg_s, period_s: self.period_s };
        let given = self.stage.give(config, &ask, self.pwm_hz);
        let Some((share, in_flight_kg)) = given else {
            let command = self.closed();
            self.saturated = saturated;
            return (command, 0.0, full_kg);
        };
        self.saturated = saturated;
        let sign = if filling { 1.0 } else { -1.0 };
        self.in_flight_kg = in_flight_kg;
        let duty = Duty::from_share(share);
        let command = if filling {
            Command { inlet: duty, outlet: Duty::ZERO }
        } else {
            Command { inlet: Duty::ZERO, outlet: duty }
        };
        (command, sign * full_kg_s * opening_s, full_kg)
    }
}

/// Flow of an open valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenFlow {
    filling: bool,
    /// \[kg/s\].
    pub kg_s: f32,
}

impl OpenFlow {
    /// No flow.
    pub const NONE: Self = Self { filling: true, kg_s: 0.0 };

    /// Flow of the valve that moves a mass in this direction \[kg\].
    pub fn new(config: &Config, mass_kg: f32, muscle: Reservoir) -> Self {
        let filling = mass_kg > 0.0;
        let (upstream, downstream) =
            if filling { (config.supply.into(), muscle) } else { (muscle, config.ambient.into()) };
        let kg_s = config.valve.mass_flow_kg_s(&config.gas, upstream, downstream.pressure_pa);
        Self { filling, kg_s }
    }
}

/// Pulse \[s\] that opens a valve for `opening_s` of a period.
fn pulse_for_opening_s(valve: &Valve, period_s: f32, opening_s: f32) -> f32 {
    let switch_s = valve.switch_time_s;
    let gap_s = period_s - opening_s;
    if opening_s < switch_s {
        sqrt(opening_s * switch_s)
    } else if gap_s < switch_s {
        period_s - sqrt(gap_s * switch_s)
    } else {
        opening_s
    }
}

/// Opening \[s\] of a poppet in the time until it is shut \[s\]; the time is above 0.
fn tail_s(until_s: f32, switch_s: f32) -> f32 {
    if until_s < switch_s { 0.5 * until_s * until_s / switch_s } else { until_s - 0.5 * switch_s }
}

/// Opening of the shortest pulse in a period \[s\].
pub fn least_opening_s(config: &Config, period_s: f32) -> f32 {
    match config.valve_kind {
        ValveKind::Switching => {
            let (pulse_s, switch_s) =
                (config.controller.minimum_pulse_s, config.valve.switch_time_s);
            if pulse_s < switch_s { pulse_s * pulse_s / switch_s } else { pulse_s }
        }
        ValveKind::Proportional(_) => LEAST_OPENING * period_s,
    }
}

/// Mass of the shortest pulse, in the direction of `mass_kg` \[kg\].
pub(super) fn least_kg(config: &Config, period_s: f32, mass_kg: f32, muscle: Reservoir) -> f32 {
    least_opening_s(config, period_s) * OpenFlow::new(config, mass_kg, muscle).kg_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Opening of a pulse that is repeated in every period.
    fn opening_s(pulse_s: f32) -> f32 {
        let switch_s = Config::default().valve.switch_time_s;
        if pulse_s < switch_s {
            pulse_s * pulse_s / switch_s
        } else if 0.01 - pulse_s < switch_s {
            0.01 - (0.01 - pulse_s) * (0.01 - pulse_s) / switch_s
        } else {
            pulse_s
        }
    }

    /// Openings of one period for an unlimited flow.
    fn flowing(drive: &mut FlowDrive, flow_kg_s: f32, muscle: Reservoir) -> Command {
        let mass_kg = drive.owing_kg(flow_kg_s);
        drive.flow(&Config::default(), mass_kg, muscle)
    }

    proptest! {
        /// For any flow, its mean arrives and the valves are never open together.
        #[test]
        fn the_mean_flow_arrives(flow in -3.0e-4_f32..3.0e-4, pressure in 1.3e5_f32..5.0e5) {
            let config = Config::default();
            let mut drive = FlowDrive::new(&config);
            let muscle = Reservoir { pressure_pa: pressure, temperature_k: 298.0 };
            let full = |up: Reservoir, down: Reservoir|
                config.valve.mass_flow_kg_s(&config.gas, up, down.pressure_pa);
            let (inlet, outlet) = (full(config.supply.into(), muscle), full(muscle, config.ambient.into()));
            prop_assume!(flow > -0.9 * outlet);
            let mut moved = 0.0;
            let periods = 1000;
            for _ in 0..periods {
                let command = flowing(&mut drive, flow, muscle);
                prop_assert!(command.inlet == Duty::ZERO || command.outlet == Duty::ZERO);
                let pulse = command.inlet.max(command.outlet).share() * 0.01;
                let shortest = config.controller.minimum_pulse_s;
                prop_assert!(pulse == 0.0 || pulse >= 0.999 * shortest, "pulse of {pulse} s");
                moved += f64::from(opening_s(command.inlet.share() * 0.01) * inlet
                    - opening_s(command.outlet.share() * 0.01) * outlet);
            }
            let wanted = f64::from(flow) * 0.01 * f64::from(periods);
            // One shortest pulse may still be owed; a duty has 50 000 steps.
            let bound = 0.002 * f64::from(inlet.max(outlet)) + 1e-3 * wanted.abs();
            prop_assert!((moved - wanted).abs() <= bound, "{moved} for {wanted}");
        }

        #[test]
        fn pulse_inverts_opening(opening in 1.0e-5_f32..0.00999) {
            let pulse = pulse_for_opening_s(&Config::default().valve, 0.01, opening);
            prop_assert!((0.0..=0.01).contains(&pulse));
            prop_assert!((opening_s(pulse) / opening - 1.0).abs() < 1e-3);
        }

        /// Random flow in and out, as a loop may request it: the poppets never overlap, however slowly they close.
        #[test]
        fn never_both_open(
            masses in prop::collection::vec(-4.0e-5_f32..4.0e-5, 200),
            switch_time_s in 0.0_f32..0.02,
        ) {
            let mut config = Config::default();
            config.valve.switch_time_s = switch_time_s;
            prop_assume!(config.check().is_ok());
            let mut drive = FlowDrive::new(&config);
            let muscle = Reservoir { pressure_pa: 3.0e5, temperature_k: 298.0 };
            let (mut inlet_shut_s, mut outlet_shut_s) = (0.0, 0.0);
            for (period, mass) in masses.into_iter().enumerate() {
                let now = drive.mass(&config, mass, muscle);
                let start_s = 0.01 * period as f32;
                let shut_s = |duty: Duty| start_s + 0.01 * duty.share() + switch_time_s;
                if now.inlet > Duty::ZERO {
                    prop_assert!(outlet_shut_s < start_s + 1.0e-5, "period {period}");
                    inlet_shut_s = shut_s(now.inlet);
                }
                if now.outlet > Duty::ZERO {
                    prop_assert!(inlet_shut_s < start_s + 1.0e-5, "period {period}");
                    outlet_shut_s = shut_s(now.outlet);
                }
            }
        }
    }

    #[test]
    fn what_is_in_flight_is_the_end_of_the_pulse() {
        let config = Config::default();
        let mut drive = FlowDrive::new(&config);
        let muscle = Reservoir { pressure_pa: 3.0e5, temperature_k: 298.0 };
        let supply = Reservoir { pressure_pa: 7.0e5, temperature_k: 298.0 };
        let full = config.valve.mass_flow_kg_s(&config.gas, supply, 3.0e5);
        // Open for the whole period: 1 ms of dead time and half of 2 ms of closing are left.
        drive.mass(&config, 1.0, muscle);
        assert!(drive.saturated());
        assert!((drive.in_flight_kg() / (0.002 * full) - 1.0).abs() < 1e-4);
        // Closing from 9 to 11 ms: of the last millisecond's slope 0.25 ms is left.
        drive.mass(&config, 0.008 * full, muscle);
        assert!((drive.in_flight_kg() / (0.000_25 * full) - 1.0).abs() < 1e-3);
        // Closed 6 ms after the pin has risen: nothing is left.
        drive.mass(&config, 0.003 * full, muscle);
        assert!(!drive.saturated());
        assert_eq!(drive.in_flight_kg(), 0.0);
    }

    const MUSCLE: Reservoir = Reservoir { pressure_pa: 3.0e5, temperature_k: 298.0 };

    /// Mass that the open inlet, and the open outlet, pass in one period of 10 ms \[kg\].
    fn full_kg() -> (f32, f32) {
        let config = Config::default();
        let flow = |pressure_pa, down_pa| {
            let upstream = Reservoir { pressure_pa, temperature_k: 298.0 };
            config.valve.mass_flow_kg_s(&config.gas, upstream, down_pa)
        };
        (0.01 * flow(7.0e5, 3.0e5), 0.01 * flow(3.0e5, 101_325.0))
    }

    /// Both ways: mass of a pulse in shares of an open period, and whether it is more than one.
    #[test]
    fn more_than_an_open_valve_passes_is_marked() {
        let config = Config::default();
        let (inlet_kg, outlet_kg) = full_kg();
        for full_kg in [inlet_kg, -outlet_kg] {
            let mut drive = FlowDrive::new(&config);
            for (share, saturated) in [(0.5, false), (1.5, true), (0.98, false), (1.02, true)] {
                let command = drive.mass(&config, share * full_kg, MUSCLE);
                assert_eq!(drive.saturated(), saturated, "{share} of {full_kg} kg");
                let open = if full_kg > 0.0 { command.inlet } else { command.outlet };
                assert_eq!(open == Duty::FULL, saturated);
            }
            drive.closed();
            assert!(!drive.saturated());
            // The other valve must wait for the end of that pulse, and too much is requested of it all the same.
            drive.mass(&config, 1.5 * full_kg, MUSCLE);
            assert_eq!(drive.mass(&config, -10.0 * full_kg, MUSCLE), Command::CLOSED);
            assert!(drive.saturated());
        }
    }

    /// A valve that closes within its period lets the other one open in the next; a valve that does not makes it wait
    /// for one period.
    #[test]
    fn after_a_pulse_to_the_end_of_its_period_the_other_valve_waits_for_one() {
        let config = Config::default();
        let (inlet_kg, outlet_kg) = full_kg();
        let fill = Command { inlet: Duty::FULL, outlet: Duty::ZERO };
        for (mass_kg, back_kg, direct) in
            [(inlet_kg, -0.5 * outlet_kg, fill), (-outlet_kg, 0.5 * inlet_kg, Command::VENT)]
        {
            let mut drive = FlowDrive::new(&config);
            let mut waits = |before: &dyn Fn(&mut FlowDrive)| {
                before(&mut drive);
                let [first, second] = [(); 2].map(|()| drive.mass(&config, back_kg, MUSCLE));
                assert_ne!(second, Command::CLOSED);
                first == Command::CLOSED
            };
            // It takes 2 ms to close.
            assert!(!waits(&|drive| _ = drive.mass(&config, 0.79 * mass_kg, MUSCLE)));
            assert!(waits(&|drive| _ = drive.mass(&config, 0.82 * mass_kg, MUSCLE)));
            assert!(waits(&|drive| _ = drive.direct(direct)));
            assert!(!waits(&|drive| _ = drive.direct(Command::CLOSED)));
            assert!(!waits(&|drive| {
                drive.direct(direct);
                drive.closed();
            }));
        }
    }

    /// Flow that no valve passes is owed for two periods of an open valve; another set point owes none.
    #[test]
    fn what_cannot_be_moved_is_owed_for_two_periods() {
        let config = Config::default();
        let (inlet_kg, outlet_kg) = full_kg();
        for flow_kg_s in [1000.0 * inlet_kg, -1000.0 * outlet_kg] {
            let mut drive = FlowDrive::new(&config);
            for _ in 0..10 {
                flowing(&mut drive, flow_kg_s, MUSCLE);
            }
            let owed = [(); 3].map(|()| flowing(&mut drive, 1.0e-9 * flow_kg_s, MUSCLE));
            let open = if flow_kg_s > 0.0 { owed.map(|c| c.inlet) } else { owed.map(|c| c.outlet) };
            assert_eq!(open[0], Duty::FULL);
            assert!(
                open[1] > Duty::from_share(0.99) && open[2] < Duty::from_share(0.1),
                "{open:?}"
            );
            flowing(&mut drive, flow_kg_s, MUSCLE);
            drive.reset();
            let command = flowing(&mut drive, 1.0e-9 * flow_kg_s, MUSCLE);
            assert_eq!(command, Command::CLOSED, "forgotten");
        }
    }

    /// A poppet of 2 ms opens for the equivalent of half a millisecond in a pulse of 1 ms, the shortest.
    #[test]
    fn a_mass_that_is_too_little_for_a_pulse_is_not_moved() {
        let config = Config::default();
        let (inlet_kg, outlet_kg) = full_kg();
        for full_kg in [inlet_kg, -outlet_kg] {
            let mut drive = FlowDrive::new(&config);
            assert_eq!(drive.mass(&config, 0.049 * full_kg, MUSCLE), Command::CLOSED);
            let command = drive.mass(&config, 0.051 * full_kg, MUSCLE);
            let pulse_s = 0.01 * command.inlet.max(command.outlet).share();
            assert!((0.001..0.00102).contains(&pulse_s), "{pulse_s} s");
            assert_eq!(drive.in_flight_kg(), 0.0);
        }
    }

    #[test]
    fn where_no_pressure_drives_it_no_valve_opens() {
        let config = Config::default();
        for (pressure_pa, mass_kg) in [(7.0e5, 1.0e-5), (101_325.0, -1.0e-5)] {
            let mut drive = FlowDrive::new(&config);
            let muscle = Reservoir { pressure_pa, ..MUSCLE };
            assert_eq!(drive.mass(&config, mass_kg, muscle), Command::CLOSED);
            assert!(drive.saturated(), "it was asked for some");
            assert_eq!(drive.mass(&config, 0.0, muscle), Command::CLOSED);
            assert!(!drive.saturated(), "nor was it asked to");
        }
    }

    /// A pulse of such a slow valve would end after its period, however short it is.
    #[test]
    fn where_nothing_is_asked_for_nothing_is_in_flight() {
        let mut config = Config::default();
        config.valve = Valve { switch_time_s: 0.008, dead_time_s: 0.004, ..config.valve };
        config.controller.minimum_pulse_s = 0.0;
        let mut drive = FlowDrive::new(&config);
        drive.mass(&config, 1.0e-6, MUSCLE);
        assert!(drive.in_flight_kg() > 0.0);
        assert_eq!(drive.mass(&config, 0.0, MUSCLE), Command::CLOSED);
        assert_eq!(drive.in_flight_kg(), 0.0);
    }

    #[test]
    fn what_leaves_after_its_period_is_in_flight_too() {
        let config = Config::default();
        let (_, outlet_kg) = full_kg();
        let mut drive = FlowDrive::new(&config);
        drive.mass(&config, -1.0, MUSCLE);
        // 2 ms of the 10 ms in a period, outwards.
        assert!((drive.in_flight_kg() / (-0.2 * outlet_kg) - 1.0).abs() < 1e-4);
        drive.direct(Command::VENT);
        assert_eq!(drive.in_flight_kg(), 0.0, "not known");
    }

    fn proportional(bandwidth_hz: f32) -> Config {
        let spool = Spool { dead_band: 0.2, bandwidth_hz };
        let mut config = Config { valve_kind: ValveKind::Proportional(spool), ..Config::default() };
        config.valve.switch_time_s = 0.0;
        config
    }

    /// A command skips the dead band; one that is too small to be given is owed.
    #[test]
    fn a_proportional_valve_opens_by_the_share_that_is_wanted() {
        let config = proportional(50.0);
        let (inlet_kg, outlet_kg) = full_kg();
        for full_kg in [inlet_kg, -outlet_kg] {
            let mut drive = FlowDrive::new(&config);
            for (share, expected) in [(0.5, 0.6), (0.02, 0.216), (1.0, 1.0), (1.2, 1.0)] {
                let command = drive.mass(&config, share * full_kg, MUSCLE);
                let duty = command.inlet.max(command.outlet).share();
                assert!((duty - expected).abs() < 1e-4, "{share}: {duty}");
                assert!(command.inlet == Duty::ZERO || command.outlet == Duty::ZERO);
                assert_eq!((command.inlet > Duty::ZERO), full_kg > 0.0);
                assert_eq!(drive.saturated(), share > 1.0);
            }
            assert_eq!(drive.mass(&config, 0.009 * full_kg, MUSCLE), Command::CLOSED);
            let mut drive = FlowDrive::new(&config);
            let flow_kg_s = 0.6 * full_kg;
            let given = (0..10).filter(|_| {
                let mass_kg = drive.owing_kg(flow_kg_s);
                drive.flow(&config, mass_kg, MUSCLE) != Command::CLOSED
            });
            assert_eq!(given.count(), 5, "0.6 % a period");
        }
    }

    proptest! {
        /// For any sequence of requests, the moved mass plus the mass in flight equals the mass given. The valves
        /// follow here in steps of 10 us.
        #[test]
        fn what_is_in_flight_of_a_proportional_valve_moves_after_its_period(
            bandwidth_hz in 5.0_f32..300.0,
            shares in proptest::collection::vec(-1.0_f32..1.0, 1..12),
        ) {
            const STEPS: u32 = 1000;
            let config = proportional(bandwidth_hz);
            let (inlet_kg, outlet_kg) = full_kg();
            let lag_s = 1.0 / (std::f64::consts::TAU * f64::from(bandwidth_hz));
            let per_step = 1.0 - (-1.0e-5 / lag_s).exp();
            let mut drive = FlowDrive::new(&config);
            let (mut given_kg, mut moved_kg) = (0.0, 0.0);
            let (mut openings, mut before) = ([0.0_f64; 2], Command::CLOSED);
            for share in shares {
                let full_kg = if share > 0.0 { inlet_kg } else { outlet_kg };
                let now = drive.mass(&config, share * full_kg, MUSCLE);
                let commands = |of: Command| [of.inlet, of.outlet].map(|duty| {
                    ((f64::from(duty.share()) - 0.2) / 0.8).max(0.0)
                });
                let goals = commands(now);
                given_kg += goals[0] * f64::from(inlet_kg) - goals[1] * f64::from(outlet_kg);
                for step in 0..STEPS {
                    // 1 ms of dead time.
                    let goals = if step < STEPS / 10 { commands(before) } else { goals };
                    for (opening, goal) in openings.iter_mut().zip(goals) {
                        *opening += per_step * (goal - *opening);
                    }
                    let flow_kg = openings[0] * f64::from(inlet_kg) - openings[1] * f64::from(outlet_kg);
                    moved_kg += flow_kg / f64::from(STEPS);
                }
                before = now;
                let in_flight_kg = f64::from(drive.in_flight_kg());
                // Below a thousandth of its opening a valve counts as shut.
                let bound_kg = f64::from(inlet_kg.max(outlet_kg)) * (0.003 + 0.002 * lag_s / 0.01);
                let off_kg = given_kg - moved_kg - in_flight_kg;
                prop_assert!(off_kg.abs() < bound_kg, "{off_kg} kg of {given_kg}");
            }
        }
    }

    /// A loop rests only when nothing is in flight.
    #[test]
    fn what_a_proportional_valve_has_in_flight_comes_to_an_end() {
        let config = proportional(20.0);
        let mut drive = FlowDrive::new(&config);
        drive.mass(&config, 1.0, MUSCLE);
        assert!(drive.in_flight_kg() > 0.0);
        let periods = (0..100).take_while(|_| {
            drive.closed();
            drive.in_flight_kg() != 0.0
        });
        // 8 ms of lag, seven of them to a thousandth.
        assert!((4..=6).contains(&periods.count()));
        drive.direct(Command::VENT);
        assert_eq!(drive.in_flight_kg(), 0.0, "not known");
    }
}
