//! The plausibility monitor: compares gas and muscle with what valves and load can cause.
//!
//! Pressure and length show, by the energy balance (3), how much gas came or went:
//!
//! ```text
//! H = dU + P dV + heat        U = P V/(k-1)      (4)
//! gained = H/(cp T m)         share of the gas
//! ```
//!
//! The heat is the least certain part. Only gas that no heat transfer between none and the believed one explains is
//! counted: heat alone has a bounded effect, as the gas can never be more than a tenth or so warmer or colder than its
//! wall. A hole has no such bound. So for either valve, while the other one is shut, the gas that it must have passed
//! is added up, less the change that is found:
//!
//! - gas that the inlet must have let in, and that is not there, is missing. It left through a hole, or it never came;
//! - gas that the outlet must have let out, and that is still there, has stayed. Other gas has replaced it, or it never
//!   left.
//!
//! A sum beyond `TRIP` has a cause other than heat. Pulses add up, however short they are, so a loop that compensates a
//! leak shows it; and while both valves are shut, any gas that comes or goes is too much.
//!
//! A configured leak (`leak.conductance_m3_s_pa`) explains that much gas and no more: for any leak between none and the
//! believed one, gas counts neither as missing nor as excess.
//!
//! The believed conductance, pulses and supply may together be wrong by a factor of four. Drift of less than
//! `FORGOTTEN_PER_S` cannot be distinguished from warming and cooling over the day; nor can drift of less than
//! `FORGOTTEN_DRIVEN_PER_S` while a valve is driven.
//!
//! And the force derived from pressure and length is the load's, within a factor of three and friction: a muscle that
//! pulls a third of its load, or three times it, for a second has a sensor that has drifted.

use crate::config::{Config, Load};
use crate::estimation::Balance;
use crate::math::{absolute, is_above, limit};
use crate::physics::chamber::Chamber;
use crate::physics::valve::{ValveKind, reference_density_kg_m3};
use crate::sample::{Command, Duty, Faults};
use crate::step_counts::StepCounts;

/// Share of the gas that counts as missing, or as excess \[-\].
const TRIP: f32 = 0.25;
/// Share of the gas that is forgotten in a second while both valves are shut \[1/s\].
const FORGOTTEN_PER_S: f32 = 0.02;
/// Share that is forgotten in a second while one is driven: a healthy valve passes more than is counted, so that no
/// drift adds up \[1/s\].
const FORGOTTEN_DRIVEN_PER_S: f32 = 0.005;
/// Rate beyond which a loss is a burst, or an outlet that stands open; a slower loss is a leak. A valve of which more
/// than this is requested without effect is stuck \[1/s\].
const BURST_PER_S: f32 = 1.0;
/// Factor by which a believed flow may be wrong \[-\].
const WRONG: f32 = 4.0;
/// Factor by which a believed load may be wrong \[-\].
const WRONG_LOAD: f32 = 3.0;
/// Factor by which a proportional valve's dead band may be wider than believed (assumption) \[-\].
const WIDER_DEAD_BAND: f32 = 1.5;
/// Time constants after which a proportional valve has closed: e^-5 is 0.7 % \[-\].
const CLOSED_AFTER: f32 = 5.0;
/// Multiple of the ambient pressure up to which the muscle counts as empty \[-\].
const EMPTY: f32 = 1.15;
/// Share of its configured pressure to which the supply may fall: regulators lose some 5 % at their rated flow, and
/// gauges are accurate to 2.5 % (assumption) \[-\].
const SUPPLIED: f32 = 0.9;
/// Part of the rest length near either stop that is left out, and the way in a window up to which the muscle rests
/// \[-\].
const NEAR_STOP: f32 = 0.02;
const AT_REST: f32 = 0.002;
/// Permitted error of the force law, fraction of the force at the rest length \[-\].
const LAW: f32 = 0.15;

/// Constants that follow from the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limits {
    window_s: f32,
    /// Share of a window in a smoothed rate: a tenth of a second.
    rate_share: f32,
    /// Windows for which a force must be impossible: a second.
    impossible_windows: u16,
    /// Windows for which a leak stays shown after it was found: ten seconds.
    shown_windows: u16,
    /// Flow per pressure of an open valve \[kg/(s Pa)\].
    open_kg_s_pa: f32,
    supply_pa: f32,
    empty_pa: f32,
    ambient_pa: f32,
    critical_ratio: f32,
    /// Time that one part of a duty stands for in a step \[s\].
    part_s: f32,
    /// Parts of a duty whose pulse is as long as the valve's stroke \[-\].
    stroke_parts: u32,
    /// Parts of a command that may leave a valve shut \[-\].
    dead_parts: u32,
    /// Windows after its last command in which a valve may still be open, including the first.
    closing_windows: u16,
    /// The load, and the friction that may add to it \[N\]; `None` if the force is unknown.
    load_n: Option<(f32, f32)>,
}

impl Limits {
    /// Parts of a step for which a duty opens its valve. A pulse shorter than the stroke opens it in proportion to
    /// its length, for w^2/t_s of w.
    fn opened_parts(&self, duty: Duty) -> u32 {
        // At most 65 535^2, which is below 2^32.
        let full = u32::from(Duty::FULL.0);
        let beyond = u32::from(duty.0).saturating_sub(self.dead_parts) * full;
        let parts = beyond.checked_div(full - self.dead_parts).unwrap_or(0);
        let opened = if parts < self.stroke_parts {
            let nearest = parts.saturating_mul(parts).saturating_add(self.stroke_parts / 2);
            nearest.checked_div(self.stroke_parts).unwrap_or(parts)
        } else {
            parts
        };
        // At least 1 if driven, however briefly.
        opened.max(u32::from(duty != Duty::ZERO))
    }

    /// Upstream pressure times a lower bound for the ratio of the subsonic flow to the choked flow (ISO 6358): the
    /// square root of a share is larger than the share \[Pa\].
    fn driving_pa(&self, upstream_pa: f32, downstream_pa: f32) -> f32 {
        let ratio = limit(downstream_pa / upstream_pa, self.critical_ratio, 1.0);
        let share = (ratio - self.critical_ratio) / (1.0 - self.critical_ratio);
        upstream_pa * (1.0 - share * share)
    }
}

/// State of one valve.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ValveBalance {
    /// Parts of a step for which the valve was open in this window; 0 without a command.
    parts: u32,
    /// Windows, including this one, for which the valve may still be open.
    open_windows: u16,
    /// Gas that the valve must have passed and that is missing, as a fraction of the gas \[-\].
    missing: f32,
    /// Requested flow, smoothed \[1/s\].
    asked_per_s: f32,
}

impl ValveBalance {
    /// Balance of a valve with an unknown past: it may have been driven.
    const UNKNOWN: Self = Self { parts: 1, open_windows: 0, missing: 0.0, asked_per_s: 0.0 };

    /// Ends a window; returns the parts of a step for which the valve was open at least.
    fn end_window(&mut self, closing_windows: u16) -> u32 {
        let parts = core::mem::take(&mut self.parts);
        self.open_windows = if parts > 0 {
            closing_windows.saturating_add(1)
        } else {
            self.open_windows.saturating_sub(1)
        };
        parts
    }

    /// Whether a pulse of the window before may end in this one, or a slow valve may still be closing.
    fn driven_lately(&self) -> bool {
        self.open_windows > 0
    }

    /// Counts a window in which one share of the gas was requested of the valve and another passed, if gas could pass
    /// nowhere else.
    fn count(&mut self, asked: f32, passed: f32, other: &Self, limits: &Limits) {
        let window_s = limits.window_s;
        self.asked_per_s += limits.rate_share * (asked / window_s - self.asked_per_s);
        if other.driven_lately() {
            return;
        }
        let forgotten_per_s =
            if self.driven_lately() { FORGOTTEN_DRIVEN_PER_S } else { FORGOTTEN_PER_S };
        let missing = asked / WRONG - passed - forgotten_per_s * window_s;
        self.missing = limit(self.missing + missing, 0.0, 1.0);
    }

    /// Whether enough gas is missing to have a cause; the count then starts again.
    fn trips(&mut self) -> bool {
        let trips = self.missing > TRIP;
        if trips {
            self.missing = 0.0;
        }
        trips
    }
}

/// State of the monitor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlausibilityMonitor {
    limits: Limits,
    /// The last command, and the parts of a step for which it opens inlet and outlet.
    command: Command,
    opened_parts: [u32; 2],
    inlet: ValveBalance,
    outlet: ValveBalance,
    /// Loss of gas while the outlet is shut, smoothed \[1/s\].
    lost_per_s: f32,
    length_m: f32,
    impossible_windows: u16,
    leak_windows: u16,
    /// Whether the last window had no trusted length.
    blind: bool,
    /// Faults found by the last window.
    found: Faults,
}

impl PlausibilityMonitor {
    /// Creates a monitor without any observation.
    ///
    /// ```
    /// use model_core::{Command, Config};
    /// use model_core::safety::plausibility::PlausibilityMonitor;
    ///
    /// let mut monitor = PlausibilityMonitor::new(&Config::default());
    /// monitor.drive(Command::VENT);
    /// ```
    pub fn new(config: &Config) -> Self {
        let load_n = match config.load {
            Load::Isotonic { force_n } => Some((force_n, 2.0 * config.friction.force_n)),
            Load::Isometric { .. } => None,
        };
        let counts = StepCounts::new(config.step_s);
        let window_s = f32::from(counts.interval_steps) * config.step_s;
        let (dead_band, lag_s) = match config.valve_kind {
            ValveKind::Switching => (0.0, 0.0),
            ValveKind::Proportional(spool) => {
                (limit(WIDER_DEAD_BAND * spool.dead_band, 0.0, 0.95), spool.lag_s())
            }
        };
        Self {
            limits: Limits {
                window_s,
                rate_share: 1.0 / f32::from(counts.tenth_intervals),
                impossible_windows: counts.second_intervals,
                shown_windows: counts.ten_seconds_intervals,
                open_kg_s_pa: config.valve.conductance_m3_s_pa
                    * reference_density_kg_m3(&config.gas),
                supply_pa: SUPPLIED * config.supply.pressure_pa,
                empty_pa: EMPTY * config.ambient.pressure_pa,
                ambient_pa: config.ambient.pressure_pa,
                critical_ratio: limit(config.valve.critical_ratio, 0.0, 0.99),
                part_s: config.step_s / f32::from(Duty::FULL.0),
                stroke_parts: (config.valve.switch_time_s * f32::from(Duty::FULL.0)
                    / (f32::from(config.pwm_period_steps) * config.step_s))
                    as u32,
                dead_parts: u32::from(Duty::from_share(dead_band).0),
                // The pulse of a switching valve may end in the following window.
                closing_windows: ((CLOSED_AFTER * lag_s / window_s) as u16).saturating_add(1),
                load_n,
            },
            command: Command::CLOSED,
            opened_parts: [0; 2],
            inlet: ValveBalance::UNKNOWN,
            outlet: ValveBalance::UNKNOWN,
            lost_per_s: 0.0,
            length_m: 0.0,
            impossible_windows: 0,
            leak_windows: 0,
            blind: true,
            found: Faults::NONE,
        }
    }

    /// Whether a muscle at this absolute pressure \[Pa\] has gas to let out.
    pub fn has_gas(&self, pressure_pa: f32) -> bool {
        is_above(pressure_pa, self.limits.empty_pa)
    }

    /// Records the command to the valves for one step.
    pub fn drive(&mut self, command: Command) {
        if command != self.command {
            self.command = command;
            self.opened_parts =
                [command.inlet, command.outlet].map(|duty| self.limits.opened_parts(duty));
        }
        let [inlet, outlet] = self.opened_parts;
        // A window of 65 535 steps stays below 2^32.
        self.inlet.parts = self.inlet.parts.wrapping_add(inlet);
        self.outlet.parts = self.outlet.parts.wrapping_add(outlet);
    }

    /// Whether a leak was found within the last ten seconds of intervals.
    pub fn leaks(&self) -> bool {
        self.leak_windows > 0
    }

    /// Takes the balance of one of the estimator's intervals; returns the faults of the previous one, each once;
    /// [`leaks`](Self::leaks) lasts for a while. `length_m`: the measured length, `None` if it, and with it the volume,
    /// is not trusted. Such an interval is not used, nor is the one before it, in which the length failed, nor the one
    /// after it, in which the volume returns.
    pub fn add(
        &mut self,
        chamber: &impl Chamber,
        balance: &Balance,
        length_m: Option<f32>,
    ) -> Faults {
        let closing_windows = self.limits.closing_windows;
        let inlet_parts = self.inlet.end_window(closing_windows);
        let outlet_parts = self.outlet.end_window(closing_windows);
        self.leak_windows = self.leak_windows.saturating_sub(1);
        let Some(length_m) = length_m else {
            self.blind = true;
            self.found = Faults::NONE;
            self.impossible_windows = 0;
            return Faults::NONE;
        };
        let found = if core::mem::replace(&mut self.blind, false) {
            Faults::NONE
        } else {
            self.count(balance, inlet_parts, outlet_parts);
            self.force(chamber, balance, length_m);
            self.findings()
        };
        let found = core::mem::replace(&mut self.found, found);
        if found.intersects(Faults::LEAK) {
            self.leak_windows = self.limits.shown_windows;
        }
        found
    }

    /// Counts the gas that came and went against the requests to the valves.
    fn count(&mut self, balance: &Balance, inlet_parts: u32, outlet_parts: u32) {
        let limits = &self.limits;
        let Balance { pressure_pa, mass_kg, .. } = *balance;
        // More than the gas in the chamber in one window, or not a number: almost no gas, and noise.
        let gained = |share: f32| limit(share, -1.0, 1.0);
        let (least_gained, most_gained) =
            (gained(balance.least_gained), gained(balance.most_gained));
        let asked = |parts: u32, driving_pa: f32| {
            let passed_kg = parts as f32 * limits.part_s * limits.open_kg_s_pa * driving_pa;
            limit(passed_kg / mass_kg, 0.0, 1.0)
        };
        let inflow = asked(inlet_parts, limits.driving_pa(limits.supply_pa, pressure_pa));
        let outflow = if is_above(pressure_pa, limits.empty_pa) {
            asked(outlet_parts, limits.driving_pa(pressure_pa, limits.ambient_pa))
        } else {
            0.0
        };
        self.inlet.count(inflow, most_gained, &self.outlet, limits);
        self.outlet.count(outflow, -least_gained, &self.inlet, limits);
        let lost = if self.outlet.driven_lately() { 0.0 } else { -most_gained };
        self.lost_per_s += limits.rate_share * (lost / limits.window_s - self.lost_per_s);
    }

    /// Counts windows in which pressure and length imply an impossible force.
    fn force(&mut self, chamber: &impl Chamber, balance: &Balance, length_m: f32) {
        let Some((load_n, friction_n)) = self.limits.load_n.filter(|_| chamber.moves()) else {
            return;
        };
        let moved_m = length_m - core::mem::replace(&mut self.length_m, length_m);
        let rest_m = chamber.rest_length_m();
        let free_m = NEAR_STOP * rest_m;
        let free =
            length_m > chamber.shortest_m() + free_m && length_m < chamber.longest_m() - free_m;
        if !free || absolute(moved_m) > AT_REST * rest_m {
            self.impossible_windows = self.impossible_windows.saturating_sub(1);
            return;
        }
        let gauge_pa = balance.pressure_pa - self.limits.ambient_pa;
        let pull_n = chamber.force_n(gauge_pa, length_m) - balance.held_n;
        let force_n = limit(pull_n, chamber.least_force_n(), f32::MAX);
        let tolerance_n = friction_n + LAW * absolute(chamber.force_n(gauge_pa, rest_m));
        // Against the load's own direction: some chambers push.
        let (force_n, load_n) = if load_n < 0.0 { (-force_n, -load_n) } else { (force_n, load_n) };
        let possible = force_n > load_n / WRONG_LOAD - tolerance_n
            && force_n < load_n * WRONG_LOAD + tolerance_n;
        self.impossible_windows = if possible {
            self.impossible_windows.saturating_sub(1)
        } else {
            self.impossible_windows.saturating_add(1)
        };
    }

    /// Faults whose limit is exceeded.
    fn findings(&mut self) -> Faults {
        let mut found = Faults::NONE;
        if self.inlet.trips() {
            if self.lost_per_s > BURST_PER_S {
                found = found.with(Faults::BURST);
            } else if self.inlet.asked_per_s + self.lost_per_s > BURST_PER_S {
                found = found.with(Faults::NO_INFLOW);
            } else {
                found = found.with(Faults::LEAK);
            }
        }
        if self.outlet.trips() {
            let asked = self.outlet.driven_lately();
            found = found.with(if asked { Faults::NO_OUTFLOW } else { Faults::GAS_GAINED });
        }
        if self.impossible_windows > self.limits.impossible_windows {
            found = found.with(Faults::FORCE);
            self.impossible_windows = 0;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::{AnyChamber, ChamberConfig, Vessel};
    use crate::physics::valve::Spool;

    const MASS_KG: f32 = 6.0e-4;
    const PRESSURE_PA: f32 = 3.0e5;
    /// Lowest permitted supply, for 7 bar.
    const SUPPLY_PA: f32 = SUPPLIED * 7.0e5;
    const LENGTH_M: f32 = 0.27;
    /// A length at which the load explains the pressure.
    const STILL_M: f32 = 0.25;
    /// Windows after which nothing more can be expected.
    const FOREVER: u32 = 20_000;

    fn inlet(share: f32) -> Command {
        Command { inlet: Duty::from_share(share), outlet: Duty::ZERO }
    }

    fn outlet(share: f32) -> Command {
        Command { inlet: Duty::ZERO, outlet: Duty::from_share(share) }
    }

    fn gas(gained: f32, pressure_pa: f32) -> Balance {
        Balance {
            least_gained: gained,
            most_gained: gained,
            pressure_pa,
            mass_kg: MASS_KG,
            held_n: 0.0,
        }
    }

    /// A monitor and its chamber.
    struct Bench {
        chamber: AnyChamber,
        monitor: PlausibilityMonitor,
    }

    impl Bench {
        fn new(config: &Config) -> Self {
            Self {
                chamber: AnyChamber::new(&config.chamber),
                monitor: PlausibilityMonitor::new(config),
            }
        }

        fn nominal() -> Self {
            Self::new(&Config::default())
        }

        fn window(&mut self, command: Command, balance: Balance, length_m: Option<f32>) -> Faults {
            for _ in 0..20 {
                self.monitor.drive(command);
            }
            let found = self.monitor.add(&self.chamber, &balance, length_m);
            found.with(Faults::LEAK.when(self.monitor.leaks()))
        }

        /// Faults found in this many windows.
        fn windows(&mut self, count: u32, command: Command, balance: Balance) -> Faults {
            (0..count).fold(Faults::NONE, |found, _| {
                found.with(self.window(command, balance, Some(STILL_M)))
            })
        }

        /// Windows until a fault is found, and the fault.
        fn finds(&mut self, command: Command, balance: Balance) -> Option<(u32, Faults)> {
            (1..FOREVER).find_map(|count| {
                let found = self.window(command, balance, Some(STILL_M));
                (found != Faults::NONE).then_some((count, found))
            })
        }
    }

    /// Twenty steps of a millisecond.
    const WINDOW_S: f32 = 0.02;

    /// Windows in which a share per window adds up to the trip, less the forgotten share; and two more of a new
    /// monitor: one without information, and one by which a finding is late.
    fn windows_to_trip(share: f32, forgotten_per_s: f32) -> u32 {
        2 + (TRIP / (share - forgotten_per_s * WINDOW_S)).ceil() as u32
    }

    fn close(found: Option<(u32, Faults)>, windows: u32, fault: Faults) {
        let (count, faults) = found.unwrap();
        assert_eq!(faults, fault);
        let rounding = 2 + windows / 200;
        assert!(count.abs_diff(windows) <= rounding, "{count} windows, expected {windows}");
    }

    #[test]
    fn gas_that_comes_while_shut_is_found_and_counted_again() {
        let mut bench = Bench::nominal();
        // Gas that the last pulse moves after its end falls into the first shut window.
        for _ in 0..100 {
            for command in [inlet(0.9), Command::CLOSED] {
                let found = bench.window(command, gas(0.2, PRESSURE_PA), Some(STILL_M));
                assert_eq!(found, Faults::NONE);
            }
        }
        let share = 0.02;
        for _ in 0..3 {
            let found = bench.finds(Command::CLOSED, gas(share, PRESSURE_PA));
            close(found, windows_to_trip(share, FORGOTTEN_PER_S), Faults::GAS_GAINED);
        }
    }

    #[test]
    fn a_slow_loss_is_shown_as_a_leak_and_a_fast_one_is_a_burst() {
        let share = BURST_PER_S * WINDOW_S;
        let mut bench = Bench::nominal();
        let slow = gas(-0.8 * share, PRESSURE_PA);
        let found = bench.finds(Command::CLOSED, slow);
        close(found, windows_to_trip(0.8 * share, FORGOTTEN_PER_S), Faults::LEAK);
        assert!(bench.monitor.leaks(), "also between two windows");
        let still = gas(0.0, PRESSURE_PA);
        let shown = (1..FOREVER)
            .take_while(|_| bench.window(Command::CLOSED, still, Some(STILL_M)) == Faults::LEAK)
            .count();
        assert!(shown.abs_diff(500) <= 2, "{shown} windows");
        let found = Bench::nominal().finds(Command::CLOSED, gas(-1.3 * share, PRESSURE_PA));
        close(found, windows_to_trip(1.3 * share, FORGOTTEN_PER_S), Faults::BURST);
    }

    /// The interval in which the length failed finds no leak, which would end a lock; a leak found before is shown for
    /// ten seconds even without a length.
    #[test]
    fn without_a_length_no_leak_is_found_and_none_is_shown_for_ever() {
        let slow = gas(-0.8 * BURST_PER_S * WINDOW_S, PRESSURE_PA);
        let (count, _) = Bench::nominal().finds(Command::CLOSED, slow).unwrap();
        let leaks_after = |windows: u32, blind: u32| {
            let mut bench = Bench::nominal();
            bench.windows(windows, Command::CLOSED, slow);
            (0..blind).for_each(|_| _ = bench.window(Command::CLOSED, slow, None));
            bench.monitor.leaks()
        };
        assert!(!leaks_after(count - 1, 1), "the interval in which it broke");
        assert!(leaks_after(count, 1) && leaks_after(count, 490));
        assert!(!leaks_after(count, 510));
    }

    /// A muscle that warms and cools over minutes neither leaks nor gains; twice that rate is found.
    #[test]
    fn what_drifts_more_slowly_than_is_forgotten_is_not_found() {
        let forgotten = FORGOTTEN_PER_S * WINDOW_S;
        for (sign, fault) in [(1.0, Faults::GAS_GAINED), (-1.0, Faults::LEAK)] {
            let share = |times: f32| gas(sign * times * forgotten, PRESSURE_PA);
            assert_eq!(Bench::nominal().finds(Command::CLOSED, share(0.9)), None);
            let found = Bench::nominal().finds(Command::CLOSED, share(2.0));
            close(found, windows_to_trip(2.0 * forgotten, FORGOTTEN_PER_S), fault);
        }
    }

    /// Share of the gas that a valve, by its configuration, passes in a window if it is open for this long.
    fn open(open_s: f32, over_pa: f32) -> f32 {
        // 4e-9 m3/(s Pa) of air of 1.1884 kg/m3.
        assert_eq!(Config::default().valve.conductance_m3_s_pa, 4.0e-9);
        4.0e-9 * 1.1884 * open_s * over_pa / MASS_KG
    }

    /// Fraction of the time for which a valve with a stroke of 2 ms is open at a duty and 100 Hz.
    fn opened(duty: f32) -> f32 {
        assert_eq!(Config::default().valve.switch_time_s, 0.002);
        if duty < 0.2 { duty * duty / 0.2 } else { duty }
    }

    /// Duty at which the valve is open for this fraction of the time.
    fn duty_for(opened: f32) -> f32 {
        if opened < 0.2 { (0.2 * opened).sqrt() } else { opened }
    }

    /// A pulse shorter than the stroke passes less than its length suggests; a healthy inlet driven by such pulses is
    /// not stuck.
    #[test]
    fn a_short_pulse_counts_for_the_gas_that_it_passes() {
        for duty in [0.003, 0.03, 0.1, 0.19] {
            let due = open(opened(duty) * WINDOW_S, over_pa(SUPPLY_PA, PRESSURE_PA));
            let healthy = gas(due, PRESSURE_PA);
            assert_eq!(Bench::nominal().finds(inlet(duty), healthy), None, "{duty}");
        }
        let due = open(opened(0.05) * WINDOW_S, over_pa(SUPPLY_PA, PRESSURE_PA)) / WRONG;
        let found = Bench::nominal().finds(inlet(0.05), gas(0.0, PRESSURE_PA));
        close(found, windows_to_trip(due, FORGOTTEN_DRIVEN_PER_S), Faults::LEAK);
    }

    /// Least driving pressure of gas from `from_pa` to `to_pa`, by ISO 6358 \[Pa\].
    fn over_pa(from_pa: f32, to_pa: f32) -> f32 {
        let subsonic = ((to_pa / from_pa - 0.3) / 0.7).max(0.0);
        from_pa * (1.0 - subsonic * subsonic)
    }

    #[test]
    fn an_inlet_that_passes_nothing_is_found_the_later_the_shorter_it_is_driven() {
        for (share, fault) in
            [(1.0, Faults::NO_INFLOW), (0.3, Faults::NO_INFLOW), (0.1, Faults::LEAK)]
        {
            let due = open(opened(share) * WINDOW_S, over_pa(SUPPLY_PA, PRESSURE_PA)) / WRONG;
            let windows = |share| windows_to_trip(share, FORGOTTEN_DRIVEN_PER_S);
            let found = Bench::nominal().finds(inlet(share), gas(0.0, PRESSURE_PA));
            close(found, windows(due), fault);
            let half = Bench::nominal().finds(inlet(share), gas(0.5 * due, PRESSURE_PA));
            close(half, windows(0.5 * due), fault);
            let enough = gas(1.05 * due, PRESSURE_PA);
            assert_eq!(Bench::nominal().finds(inlet(share), enough), None);
        }
    }

    /// A loop that compensates a leak may request as much as is lost, and more in a single pulse: an inlet counts as
    /// stuck only if its mean request exceeds a burst.
    #[test]
    fn an_inlet_that_passes_nothing_is_a_leak_up_to_what_a_burst_takes() {
        let per_s = open(1.0, over_pa(SUPPLY_PA, PRESSURE_PA));
        let still = gas(0.0, PRESSURE_PA);
        // Gas lost meanwhile adds to it, gas gained counts against it.
        for (asked, lost, fault) in [
            (0.9, 0.0, Faults::LEAK),
            (1.1, 0.0, Faults::NO_INFLOW),
            (0.8, 0.3, Faults::NO_INFLOW),
            (1.2, -0.25, Faults::LEAK),
        ] {
            let command = inlet(duty_for(asked * BURST_PER_S / per_s));
            let lost = gas(-lost * BURST_PER_S * WINDOW_S, PRESSURE_PA);
            let (_, found) = Bench::nominal().finds(command, lost).unwrap();
            assert_eq!(found, fault, "{asked} of a burst");
        }
        let mut bench = Bench::nominal();
        let pulse = inlet(duty_for(5.0 * 0.6 * BURST_PER_S / per_s));
        let found = (0..FOREVER).find_map(|window| {
            let command = if window % 5 == 0 { pulse } else { Command::CLOSED };
            let found = bench.window(command, still, Some(STILL_M));
            (found != Faults::NONE).then_some(found)
        });
        assert_eq!(found, Some(Faults::LEAK), "in one window of five");
    }

    /// A muscle at the pressure of its supply takes no more gas, nor does one whose supply is lower than configured.
    #[test]
    fn an_inlet_that_stays_open_at_the_supply_is_healthy() {
        for share in [0.91, 0.94, 0.97, 0.999] {
            let full = gas(0.0, share * 7.0e5);
            let mut bench = Bench::nominal();
            let flow = Faults::NO_INFLOW.with(Faults::LEAK).with(Faults::BURST);
            let found = |_| bench.window(inlet(1.0), full, Some(STILL_M)).intersects(flow);
            assert!(!(0..2_000).any(found), "{share}");
        }
    }

    #[test]
    fn an_outlet_that_passes_nothing_is_found_until_the_muscle_is_empty() {
        let ambient_pa = 101_325.0;
        for (share, pressure_pa) in [(1.0, PRESSURE_PA), (0.1, PRESSURE_PA), (1.0, 1.3e5)] {
            let over_pa = over_pa(pressure_pa, ambient_pa);
            let due = open(opened(share) * WINDOW_S, over_pa) / WRONG;
            let windows = |share| windows_to_trip(share, FORGOTTEN_DRIVEN_PER_S);
            let found = Bench::nominal().finds(outlet(share), gas(0.0, pressure_pa));
            close(found, windows(due), Faults::NO_OUTFLOW);
            let half = Bench::nominal().finds(outlet(share), gas(-0.5 * due, pressure_pa));
            close(half, windows(0.5 * due), Faults::NO_OUTFLOW);
            let enough = gas(-1.05 * due, pressure_pa);
            assert_eq!(Bench::nominal().finds(outlet(share), enough), None);
        }
        let empty = gas(0.0, 0.99 * EMPTY * ambient_pa);
        let mut bench = Bench::nominal();
        let found = |_| bench.window(Command::VENT, empty, Some(0.3));
        assert!((0..500).map(found).all(|found| found == Faults::NONE), "on its stop");
    }

    /// A muscle that bursts while it is filled gets gas, and loses more.
    #[test]
    fn a_loss_while_filling_is_a_burst() {
        let share = 1.5 * BURST_PER_S * WINDOW_S;
        let found = Bench::nominal().finds(inlet(1.0), gas(-share, PRESSURE_PA));
        let due = open(WINDOW_S, over_pa(SUPPLY_PA, PRESSURE_PA)) / WRONG;
        close(found, windows_to_trip(due + share, FORGOTTEN_DRIVEN_PER_S), Faults::BURST);
        // Gas that the outlet lets out is no loss: it has just been open.
        let mut bench = Bench::nominal();
        bench.windows(20, outlet(1.0), gas(-0.2, PRESSURE_PA));
        let (_, found) = bench.finds(inlet(1.0), gas(0.0, PRESSURE_PA)).unwrap();
        assert_eq!(found, Faults::NO_INFLOW);
    }

    /// A loop that compensates a leak gives occasional pulses: the gas lost in between counts, also in the window after
    /// a pulse.
    #[test]
    fn a_leak_that_is_made_up_for_shows_however_seldom_the_pulses_are() {
        let lost = 0.004;
        for between in [0_u8, 1, 2, 5] {
            let pulse =
                lost * f32::from(between + 1) / open(WINDOW_S, over_pa(SUPPLY_PA, PRESSURE_PA));
            let refilled = gas(lost * f32::from(between), PRESSURE_PA);
            let mut bench = Bench::nominal();
            let mut leaks = || {
                let mut found = bench.window(inlet(duty_for(pulse)), refilled, Some(STILL_M));
                for _ in 0..between {
                    let shut =
                        bench.window(Command::CLOSED, gas(-lost, PRESSURE_PA), Some(STILL_M));
                    found = found.with(shut);
                }
                found
            };
            let (count, found) = (1..FOREVER)
                .map(|count| (count * u32::from(between + 1), leaks()))
                .find(|(_, found)| *found != Faults::NONE)
                .unwrap();
            assert_eq!(found, Faults::LEAK, "a pulse in {} windows", between + 1);
            // A quarter of the pulses' gas is missing, less the forgotten share.
            let slowest = windows_to_trip(lost / WRONG, FORGOTTEN_PER_S);
            assert!((250..slowest).contains(&count), "{count} of {slowest} windows");
        }
    }

    /// A wall believed too cold makes gas at rest look as if it came in, and one believed too warm as if it left:
    /// without any heat, none did.
    #[test]
    fn what_heat_may_explain_is_no_gas() {
        for [least_gained, most_gained] in [[-0.02, 0.0], [0.0, 0.02], [-0.02, 0.02]] {
            let balance = Balance { least_gained, most_gained, ..gas(0.0, PRESSURE_PA) };
            assert_eq!(Bench::nominal().finds(Command::CLOSED, balance), None);
        }
        for (least_gained, most_gained, fault) in
            [(-0.03, -0.01, Faults::LEAK), (0.01, 0.03, Faults::GAS_GAINED)]
        {
            let balance = Balance { least_gained, most_gained, ..gas(0.0, PRESSURE_PA) };
            let found = Bench::nominal().finds(Command::CLOSED, balance);
            close(found, windows_to_trip(0.01, FORGOTTEN_PER_S), fault);
        }
    }

    /// Almost no gas, or an energy that is not a number, leaves no trace a window later.
    #[test]
    fn nonsense_leaves_nothing_behind() {
        let nonsense = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0e30];
        for (gained, mass_kg) in nonsense.into_iter().zip([0.0, 1.0e-38, f32::NAN, 0.0]) {
            let mut bench = Bench::nominal();
            let balance = Balance { mass_kg, ..gas(gained, PRESSURE_PA) };
            bench.windows(3, inlet(1.0), balance);
            bench.windows(3, Command::CLOSED, balance);
            let known = |monitor: &PlausibilityMonitor| monitor == &monitor.clone();
            assert!(known(&bench.monitor), "{gained}, {mass_kg} kg");
        }
    }

    fn proportional(dead_band: f32, bandwidth_hz: f32) -> Bench {
        let spool = Spool { dead_band, bandwidth_hz };
        let valve_kind = ValveKind::Proportional(spool);
        Bench::new(&Config { valve_kind, ..Config::default() })
    }

    /// A dead band may be wider than believed, or not: a command slightly beyond it opens the valve.
    #[test]
    fn gas_that_a_small_command_may_let_in_has_not_come_through_a_shut_valve() {
        for (dead_band, command) in [(0.2, 0.25), (0.5, 0.7), (0.8, 0.94)] {
            let filled = gas(0.02, PRESSURE_PA);
            assert_eq!(proportional(dead_band, 50.0).finds(inlet(command), filled), None);
            let found = proportional(dead_band, 50.0).finds(Command::CLOSED, filled);
            close(found, windows_to_trip(0.02, FORGOTTEN_PER_S), Faults::GAS_GAINED);
        }
    }

    /// A valve of 2 Hz closes with a time constant of 80 ms, four windows.
    #[test]
    fn gas_that_a_slow_valve_lets_in_while_it_closes_is_its_own() {
        let mut bench = proportional(0.2, 2.0);
        bench.windows(5, inlet(1.0), gas(0.2, PRESSURE_PA));
        for closing in 0..20_u8 {
            let left = (-f32::from(closing) / 4.0).exp();
            let found = bench.window(Command::CLOSED, gas(0.2 * left, PRESSURE_PA), Some(STILL_M));
            assert_eq!(found, Faults::NONE, "{closing} windows after its command");
        }
        let (_, found) = bench.finds(Command::CLOSED, gas(0.02, PRESSURE_PA)).unwrap();
        assert_eq!(found, Faults::GAS_GAINED, "it has not closed");
    }

    /// With both valves open, nothing is known about the gas that comes and goes.
    #[test]
    fn nothing_is_concluded_while_both_valves_are_driven() {
        let both = Command { inlet: Duty::FULL, outlet: Duty::FULL };
        for gained in [-0.1, 0.0, 0.1] {
            assert_eq!(Bench::nominal().finds(both, gas(gained, PRESSURE_PA)), None);
        }
    }

    /// A muscle at rest with this load, gauge pressure and length: windows until its force is found
    /// impossible.
    fn force_found(load_n: f32, gauge_pa: f32, length_m: f32) -> Option<u32> {
        let load = Load::Isotonic { force_n: load_n };
        let mut bench = Bench::new(&Config { load, ..Config::default() });
        let balance = gas(0.0, 101_325.0 + gauge_pa);
        (1..2000).find(|_| {
            let found = bench.window(Command::CLOSED, balance, Some(length_m));
            assert!(found == Faults::NONE || found == Faults::FORCE);
            found == Faults::FORCE
        })
    }

    #[test]
    fn a_force_is_impossible_beyond_three_times_the_load_or_below_a_third_of_it() {
        let muscle = AnyChamber::new(&Config::default().chamber);
        let gauge_pa = 3.0e5;
        let force_n = muscle.force_n(gauge_pa, LENGTH_M);
        // Friction of 15 N either way, and the error of the law.
        let tolerance_n = 2.0 * 15.0 + LAW * muscle.force_n(gauge_pa, 0.3);
        let least_n = (force_n - tolerance_n) / WRONG_LOAD;
        let most_n = (force_n + tolerance_n) * WRONG_LOAD;
        let windows = Some(54);
        assert_eq!(force_found(0.98 * least_n, gauge_pa, LENGTH_M), windows);
        for load_n in [1.02 * least_n, force_n, 0.98 * most_n] {
            assert_eq!(force_found(load_n, gauge_pa, LENGTH_M), None, "{load_n} N");
        }
        assert_eq!(force_found(1.02 * most_n, gauge_pa, LENGTH_M), windows);
    }

    /// On a stop the load cannot be checked: 100 mbar do not hold 300 N, and need not do so there.
    #[test]
    fn the_force_on_a_stop_is_not_judged() {
        let muscle = AnyChamber::new(&Config::default().chamber);
        let margin_m = NEAR_STOP * 0.3;
        for (stop_m, inwards) in [(muscle.shortest_m(), 1.0), (0.3, -1.0)] {
            let at =
                |margins: f32| force_found(300.0, 1.0e4, stop_m + inwards * margins * margin_m);
            assert_eq!([at(0.0), at(0.9)], [None; 2], "at {stop_m} m");
            assert!(at(1.1).is_some(), "near {stop_m} m");
        }
    }

    #[test]
    fn a_force_is_judged_at_rest_and_not_in_motion() {
        for (share, found) in [(1.1, false), (0.9, true)] {
            let mut bench = Bench::nominal();
            let step_m = share * AT_REST * 0.3;
            let judged = (0..1000_u16).any(|window| {
                let there_m = LENGTH_M + step_m * f32::from(window % 2);
                let balance = gas(0.0, 6.0e5);
                bench.window(Command::CLOSED, balance, Some(there_m)) == Faults::FORCE
            });
            assert_eq!(judged, found, "{share} of what counts as rest");
        }
    }

    /// An impossible force must last: possible forces in between count against it, and an untrusted length starts the
    /// count again.
    #[test]
    fn an_impossible_force_has_to_last() {
        let found_after = |between: u16, length_m: Option<f32>, pressure_pa: f32| {
            let mut bench = Bench::nominal();
            let mut windows = |count: u16, length_m, pressure_pa| {
                (0..count)
                    .map(|_| bench.window(Command::CLOSED, gas(0.0, pressure_pa), length_m))
                    .filter(|&found| found == Faults::FORCE)
                    .count()
            };
            // The first window gives no information, and the second has moved there.
            assert_eq!(windows(52, Some(LENGTH_M), 6.0e5), 0);
            assert_eq!(windows(between, length_m, pressure_pa), 0);
            assert_eq!(windows(between, Some(LENGTH_M), 6.0e5), 0);
            // A finding is a window late.
            windows(2, Some(LENGTH_M), 6.0e5)
        };
        assert_eq!(found_after(20, Some(LENGTH_M), 2.0e5), 1, "possible for as long");
        assert_eq!(found_after(20, Some(0.2999), 6.0e5), 0, "there, and back again");
        assert_eq!(found_after(20, None, 6.0e5), 0, "without a length it starts again");
    }

    #[test]
    fn what_does_not_move_has_no_force_to_judge() {
        let vessel = ChamberConfig::Vessel(Vessel { section_m2: 0.01, surface_m2: 0.1 });
        let held = Load::Isometric { length_m: LENGTH_M };
        for config in [
            Config { chamber: vessel, ..Config::default() },
            Config { load: held, ..Config::default() },
        ] {
            let mut bench = Bench::new(&config);
            for _ in 0..1000 {
                let found = bench.window(Command::CLOSED, gas(0.0, 6.0e5), Some(LENGTH_M));
                assert_eq!(found, Faults::NONE);
            }
        }
    }

    /// The window in which a length fails is full of nonsense, and so is the one in which it returns.
    #[test]
    fn a_length_that_breaks_leaves_nothing_behind() {
        let mut bench = Bench::nominal();
        bench.windows(10, Command::CLOSED, gas(0.0, PRESSURE_PA));
        let nonsense = gas(-0.9, PRESSURE_PA);
        assert_eq!(bench.window(Command::CLOSED, nonsense, Some(STILL_M)), Faults::NONE);
        for _ in 0..100 {
            assert_eq!(bench.window(Command::CLOSED, nonsense, None), Faults::NONE);
        }
        assert_eq!(bench.window(Command::CLOSED, nonsense, Some(STILL_M)), Faults::NONE);
        let still = gas(0.0, PRESSURE_PA);
        assert_eq!(bench.windows(100, Command::CLOSED, still), Faults::NONE);
        let leak = gas(-0.015, PRESSURE_PA);
        assert!(bench.finds(Command::CLOSED, leak).is_some(), "with it, again");
    }
}
