//! What the gas and the muscle do, against what valves and load can make of them.
//!
//! Pressure and length tell, by the energy balance (3), how much gas came or went:
//!
//! ```text
//! H = dU + P dV + heat        U = P V/(k-1)      (4)
//! gained = H/(cp T m)         share of the gas
//! ```
//!
//! A wrong heat transfer makes an error of that, too, but a bounded one: it can never be more than the
//! gas is warmer or colder than its wall, a tenth or so. A hole is not bounded. So shares are added up,
//! and what passes `TRIP` has another cause than heat:
//!
//! - *shut*: both valves are shut, and the gas grows more or less;
//! - *no inflow*, *no outflow*: a valve is driven, and less than a third of what it must pass does;
//! - *fed*, *spilt*: a loop that makes up for a leak drives its valve in every period, and neither of the
//!   others sees it. Pulses however short add up: gas that goes in and never comes to be there is lost,
//!   gas that goes out and is not missed has come in elsewhere.
//!
//! The conductance may be wrong by a factor of three, a pulse by `PULSE_S`, the supply by a tenth;
//! where pulses are added up, both together by a factor of four.
//! Drift of less than `FORGOTTEN_PER_S` is not told from what warms and cools with the day; where a
//! valve is driven, of less than `FORGOTTEN_DRIVEN_PER_S`.
//!
//! And the force that pressure and length stand for is that of the load, give or take a factor of three
//! and friction: a muscle that pulls a third of its load, or three times it, for a second has a sensor
//! that has drifted.

use crate::body::Shape;
use crate::config::{Config, Load};
use crate::estimator::{Balance, INTERVAL_STEPS};
use crate::math::{absolute, limit};
use crate::sample::{Command, Duty, Faults};
use crate::valve::reference_density_kg_m3;

/// Share of the gas that has to be missing, or too much \[-\].
const TRIP: f32 = 0.25;
/// Share of the gas that is forgotten in a second \[1/s\].
const FORGOTTEN_PER_S: f32 = 0.02;
/// The same of what is fed and spilt: a healthy valve passes more than is counted, so that no drift
/// adds up \[1/s\].
const FORGOTTEN_DRIVEN_PER_S: f32 = 0.005;
/// A loss faster than that is a burst, or an outlet that stands open; a slower one a leak \[1/s\].
const BURST_PER_S: f32 = 1.0;
/// Smoothing of the rate of a loss: five windows.
const RATE_SHARE: f32 = 0.2;
/// How wrong a believed conductance may be \[-\].
const WRONG: f32 = 3.0;
/// The same of a flow in pulses, however short \[-\].
const WRONG_PULSES: f32 = 4.0;
/// What a pulse opens a valve for may differ from its duty by so much \[s\].
const PULSE_S: f32 = 0.004;
/// Share of the believed supply that is there at least \[-\].
const SUPPLY: f32 = 0.9;
/// The muscle counts as empty up to this multiple of the ambient pressure \[-\].
pub const EMPTY: f32 = 1.15;
/// Windows for which a force must be impossible: a second at 1 kHz.
const IMPOSSIBLE_WINDOWS: u16 = 50;
/// Part of the rest length near either stop that is left out, and the way in a window that is no rest \[-\].
const NEAR_STOP: f32 = 0.02;
const AT_REST: f32 = 0.002;
/// What the force law may be wrong by, share of the force at the rest length \[-\].
const LAW: f32 = 0.15;
/// Windows for which a leak is shown after it was found: ten seconds at 1 kHz.
const SHOWN_WINDOWS: u16 = 500;

/// What the configuration makes of it, worked out once.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limits {
    window_s: f32,
    /// A PWM period that does not go into a window whole: its pulse may fall into another one \[s\].
    misplaced_s: f32,
    /// Least flow per pressure of an open valve \[kg/(s Pa)\].
    least_kg_s_pa: f32,
    supply_pa: f32,
    empty_pa: f32,
    ambient_pa: f32,
    critical_ratio: f32,
    /// Seconds of a window that one tick of a duty stands for \[s\].
    tick_s: f32,
    /// The load, and what friction may add \[N\]; none where the force is not known.
    load_n: Option<(f32, f32)>,
}

impl Limits {
    /// Upstream pressure times at least what a subsonic flow is of the choked one (ISO 6358): the root
    /// of a share is more than the share \[Pa\].
    fn driving_pa(&self, upstream_pa: f32, downstream_pa: f32) -> f32 {
        let ratio = limit(downstream_pa / upstream_pa, self.critical_ratio, 1.0);
        let share = (ratio - self.critical_ratio) / (1.0 - self.critical_ratio);
        upstream_pa * (1.0 - share * share)
    }
}

/// State of the watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Watch {
    limits: Limits,
    /// Ticks for which the valves were driven in this window.
    inlet_ticks: u32,
    outlet_ticks: u32,
    driven_before: bool,
    /// Shares of the gas \[-\].
    shut: f32,
    no_inflow: f32,
    no_outflow: f32,
    fed: f32,
    spilt: f32,
    lost_per_s: f32,
    /// What is lost if the inlet gives what is believed \[1/s\].
    spent_per_s: f32,
    length_m: f32,
    impossible_windows: u16,
    leak_windows: u16,
}

impl Watch {
    /// One that has seen nothing.
    pub fn new(config: &Config) -> Self {
        let window_steps = INTERVAL_STEPS;
        let period_steps = config.drive.period_steps;
        let whole = window_steps.checked_rem(period_steps) == Some(0);
        let misplaced_s = if whole { 0.0 } else { f32::from(period_steps) * config.step_s };
        let load_n = match config.load {
            Load::Isotonic { force_n } => Some((force_n, 2.0 * config.friction.force_n)),
            Load::Isometric { .. } => None,
        };
        Self {
            limits: Limits {
                window_s: f32::from(window_steps) * config.step_s,
                misplaced_s,
                least_kg_s_pa: config.valve.conductance_m3_s_pa
                    * reference_density_kg_m3(&config.gas)
                    / WRONG,
                supply_pa: SUPPLY * config.supply.pressure_pa,
                empty_pa: EMPTY * config.ambient.pressure_pa,
                ambient_pa: config.ambient.pressure_pa,
                critical_ratio: limit(config.valve.critical_ratio, 0.0, 0.99),
                tick_s: config.step_s / f32::from(Duty::FULL.ticks()),
                load_n,
            },
            inlet_ticks: 0,
            outlet_ticks: 0,
            driven_before: true,
            shut: 0.0,
            no_inflow: 0.0,
            no_outflow: 0.0,
            fed: 0.0,
            spilt: 0.0,
            lost_per_s: 0.0,
            spent_per_s: 0.0,
            length_m: 0.0,
            impossible_windows: 0,
            leak_windows: 0,
        }
    }

    /// The valves are driven like this for one step.
    pub fn drive(&mut self, command: Command) {
        self.inlet_ticks = self.inlet_ticks.saturating_add(command.inlet.ticks().into());
        self.outlet_ticks = self.outlet_ticks.saturating_add(command.outlet.ticks().into());
    }

    /// Takes the balance of one interval of the estimator; returns what it finds, each fault once but
    /// for a leak, which is shown for a while. `length_m`: measured, `None` where it is not trusted, and
    /// with it the volume: such an interval says nothing.
    pub fn add(&mut self, shape: &Shape, balance: &Balance, length_m: Option<f32>) -> Faults {
        let limits = self.limits;
        let inlet_s = core::mem::take(&mut self.inlet_ticks) as f32 * limits.tick_s;
        let outlet_s = core::mem::take(&mut self.outlet_ticks) as f32 * limits.tick_s;
        let Some(length_m) = length_m else {
            self.driven_before = true;
            self.impossible_windows = 0;
            return Faults::NONE;
        };
        let Balance { gained, pressure_pa, mass_kg } = *balance;
        let driven = inlet_s > 0.0 || outlet_s > 0.0;
        let driven_before = core::mem::replace(&mut self.driven_before, driven);
        let shut = !driven && !driven_before;
        self.lost_per_s -= RATE_SHARE * (gained / limits.window_s + self.lost_per_s);

        // Open for that long at least, and so much of the gas passes for each pascal \[1/Pa\].
        let least = |driven_s: f32| {
            let whole = driven_s > 0.99 * limits.window_s;
            let open_s = driven_s - PULSE_S - if whole { 0.0 } else { limits.misplaced_s };
            limit(open_s, 0.0, limits.window_s) * limits.least_kg_s_pa / mass_kg
        };
        let forgotten = FORGOTTEN_PER_S * limits.window_s;
        let fade = |sum: f32| limit(sum - forgotten, 0.0, f32::MAX);
        if shut {
            self.shut += gained;
        }
        self.shut = if self.shut > 0.0 { fade(self.shut) } else { -fade(-self.shut) };
        self.no_inflow = fade(self.no_inflow);
        self.no_outflow = fade(self.no_outflow);
        let fade = |sum: f32| limit(sum - FORGOTTEN_DRIVEN_PER_S * limits.window_s, 0.0, f32::MAX);
        self.fed = fade(self.fed);
        self.spilt = fade(self.spilt);
        let believed = |driven_s: f32| driven_s * WRONG * limits.least_kg_s_pa / mass_kg;
        let mut inflow = 0.0;
        match (inlet_s > 0.0, outlet_s > 0.0) {
            (true, false) => {
                let driving_pa = limits.driving_pa(limits.supply_pa, pressure_pa);
                let due = least(inlet_s) * driving_pa;
                self.no_inflow = limit(self.no_inflow + due - gained, 0.0, 1.0);
                inflow = believed(inlet_s) * driving_pa;
                self.fed = limit(self.fed + inflow / WRONG_PULSES - gained, 0.0, 1.0);
            }
            (false, true) => {
                let driving_pa = if pressure_pa > limits.empty_pa {
                    limits.driving_pa(pressure_pa, limits.ambient_pa)
                } else {
                    0.0
                };
                let due = least(outlet_s) * driving_pa;
                self.no_outflow = limit(self.no_outflow + due + gained, 0.0, 1.0);
                let outflow = believed(outlet_s) * driving_pa;
                self.spilt = limit(self.spilt + outflow / WRONG_PULSES + gained, 0.0, 1.0);
            }
            _ => {}
        }
        self.spent_per_s += RATE_SHARE * ((inflow - gained) / limits.window_s - self.spent_per_s);
        self.force(shape, pressure_pa, length_m);
        self.findings()
    }

    /// Counts windows in which pressure and length stand for a force that cannot be.
    fn force(&mut self, shape: &Shape, pressure_pa: f32, length_m: f32) {
        let (Shape::Muscle(geometry), Some((load_n, friction_n))) = (shape, self.limits.load_n)
        else {
            return;
        };
        let moved_m = length_m - core::mem::replace(&mut self.length_m, length_m);
        let rest_m = geometry.muscle().rest_length_m;
        let free_m = NEAR_STOP * rest_m;
        let free = length_m > geometry.shortest_m() + free_m && length_m < rest_m - free_m;
        if !free || absolute(moved_m) > AT_REST * rest_m {
            self.impossible_windows = self.impossible_windows.saturating_sub(1);
            return;
        }
        let gauge_pa = pressure_pa - self.limits.ambient_pa;
        let force_n = geometry.force_n(gauge_pa, length_m);
        let tolerance_n = friction_n + LAW * absolute(geometry.force_n(gauge_pa, rest_m));
        let possible =
            force_n > load_n / WRONG - tolerance_n && force_n < load_n * WRONG + tolerance_n;
        self.impossible_windows = if possible {
            self.impossible_windows.saturating_sub(1)
        } else {
            self.impossible_windows.saturating_add(1)
        };
    }

    /// What has passed its limit; it is counted anew from there.
    fn findings(&mut self) -> Faults {
        let mut found = Faults::NONE;
        let burst = self.lost_per_s > BURST_PER_S;
        if self.shut > TRIP || self.spilt > TRIP {
            found = found.with(Faults::GAS_GAINED);
        }
        if self.fed > TRIP {
            if self.spent_per_s > BURST_PER_S {
                found = found.with(Faults::BURST);
            } else {
                self.leak_windows = SHOWN_WINDOWS;
            }
            self.fed = 0.0;
        }
        if self.shut < -TRIP {
            if burst {
                found = found.with(Faults::BURST);
            } else {
                self.leak_windows = SHOWN_WINDOWS;
            }
        }
        if self.no_inflow > TRIP {
            found = found.with(if burst { Faults::BURST } else { Faults::NO_INFLOW });
        }
        if self.no_outflow > TRIP {
            found = found.with(Faults::NO_OUTFLOW);
        }
        if self.impossible_windows > IMPOSSIBLE_WINDOWS {
            found = found.with(Faults::FORCE);
            self.impossible_windows = 0;
        }
        if absolute(self.shut) > TRIP {
            self.shut = 0.0;
        }
        if found != Faults::NONE {
            (self.no_inflow, self.no_outflow) = (0.0, 0.0);
            (self.fed, self.spilt) = (0.0, 0.0);
        }
        self.leak_windows = self.leak_windows.saturating_sub(1);
        if self.leak_windows > 0 {
            found = found.with(Faults::LEAK);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MASS_KG: f32 = 6.0e-4;
    const PRESSURE_PA: f32 = 3.0e5;
    const LENGTH_M: f32 = 0.27;
    /// A length at which the load explains the pressure.
    const STILL_M: f32 = 0.25;
    /// Windows after which nothing more is to be expected.
    const FOREVER: u32 = 20_000;

    fn inlet(share: f32) -> Command {
        Command { inlet: Duty::from_share(share), outlet: Duty::ZERO }
    }

    fn outlet(share: f32) -> Command {
        Command { inlet: Duty::ZERO, outlet: Duty::from_share(share) }
    }

    fn gas(gained: f32, pressure_pa: f32) -> Balance {
        Balance { gained, pressure_pa, mass_kg: MASS_KG }
    }

    /// A watch and what it looks at.
    struct Bench {
        shape: Shape,
        watch: Watch,
    }

    impl Bench {
        fn new(config: &Config) -> Self {
            Self { shape: Shape::new(&config.body), watch: Watch::new(config) }
        }

        fn nominal() -> Self {
            Self::new(&Config::default())
        }

        fn window(&mut self, command: Command, balance: Balance, length_m: Option<f32>) -> Faults {
            for _ in 0..INTERVAL_STEPS {
                self.watch.drive(command);
            }
            self.watch.add(&self.shape, &balance, length_m)
        }

        /// Windows until something is found, and what.
        fn finds(&mut self, command: Command, balance: Balance) -> Option<(u32, Faults)> {
            (1..FOREVER).find_map(|count| {
                let found = self.window(command, balance, Some(STILL_M));
                (found != Faults::NONE).then_some((count, found))
            })
        }
    }

    /// Windows in which a share per window comes to what trips, less what is forgotten.
    fn windows_to_trip(share: f32) -> u32 {
        let forgotten = FORGOTTEN_PER_S * WINDOW_S;
        (TRIP / (share - forgotten)).ceil() as u32
    }

    /// Twenty steps of a millisecond.
    const WINDOW_S: f32 = 0.02;

    fn close(found: Option<(u32, Faults)>, windows: u32, fault: Faults) {
        let (count, faults) = found.unwrap();
        assert_eq!(faults, fault);
        let rounding = 1 + windows / 200;
        assert!(count.abs_diff(windows) <= rounding, "{count} windows, expected {windows}");
    }

    /// As [`close`], or sooner: what is fed or spilt may show before.
    fn by(found: Option<(u32, Faults)>, windows: u32, fault: Faults) {
        let (count, faults) = found.unwrap();
        let sooner = Faults::BURST.with(Faults::GAS_GAINED);
        assert!(faults.intersects(fault.with(sooner)), "{faults}, expected {fault}");
        assert!(count <= windows + 1 + windows / 200, "{count} windows, expected {windows}");
    }

    #[test]
    fn gas_that_comes_while_shut_is_found_and_counted_anew() {
        let mut bench = Bench::nominal();
        let share = 0.02;
        // What the last pulse moves after its end falls into the first window that is shut.
        for _ in 0..100 {
            assert_eq!(
                bench.window(inlet(0.9), gas(0.2, PRESSURE_PA), Some(STILL_M)),
                Faults::NONE
            );
            assert_eq!(
                bench.window(Command::CLOSED, gas(0.2, PRESSURE_PA), Some(STILL_M)),
                Faults::NONE
            );
        }
        for _ in 0..3 {
            let found = bench.finds(Command::CLOSED, gas(share, PRESSURE_PA));
            close(found, windows_to_trip(share), Faults::GAS_GAINED);
        }
    }

    #[test]
    fn a_slow_loss_is_shown_as_a_leak_and_a_fast_one_is_a_burst() {
        let share = BURST_PER_S * WINDOW_S;
        let mut bench = Bench::nominal();
        let slow = gas(-0.8 * share, PRESSURE_PA);
        close(bench.finds(Command::CLOSED, slow), 1 + windows_to_trip(0.8 * share), Faults::LEAK);
        let shown = (1..FOREVER)
            .take_while(|_| {
                bench.window(Command::CLOSED, gas(0.0, PRESSURE_PA), Some(STILL_M)) == Faults::LEAK
            })
            .count();
        assert!(shown.abs_diff(SHOWN_WINDOWS.into()) <= 2, "{shown} windows");
        let fast = gas(-1.3 * share, PRESSURE_PA);
        let found = Bench::nominal().finds(Command::CLOSED, fast);
        close(found, 1 + windows_to_trip(1.3 * share), Faults::BURST);
    }

    /// A muscle that warms and cools over minutes neither leaks nor gains; twice as much does.
    #[test]
    fn what_drifts_more_slowly_than_is_forgotten_is_not_found() {
        let forgotten = FORGOTTEN_PER_S * WINDOW_S;
        for (sign, fault) in [(1.0, Faults::GAS_GAINED), (-1.0, Faults::LEAK)] {
            let share = |times: f32| gas(sign * times * forgotten, PRESSURE_PA);
            assert_eq!(Bench::nominal().finds(Command::CLOSED, share(0.9)), None);
            let found = Bench::nominal().finds(Command::CLOSED, share(2.0));
            close(found, 1 + windows_to_trip(2.0 * forgotten), fault);
        }
    }

    /// Share of the gas in a window that an open valve must pass, however wrong its conductance is
    /// believed, for so long and from or to so much pressure.
    fn due(open_s: f32, over_pa: f32) -> f32 {
        let config = Config::default();
        // 4e-9 m3/(s Pa) of air of 1.1884 kg/m3.
        assert_eq!(config.valve.conductance_m3_s_pa, 4.0e-9);
        4.0e-9 * 1.1884 / WRONG * open_s * over_pa / MASS_KG
    }

    #[test]
    fn an_inlet_that_passes_nothing_is_found_the_later_the_shorter_it_is_driven() {
        let over_pa = SUPPLY * 7.0e5 - PRESSURE_PA;
        for share in [1.0, 0.5, 0.3] {
            let due = due(share * WINDOW_S - PULSE_S, over_pa);
            let nothing = gas(0.0, PRESSURE_PA);
            let found = Bench::nominal().finds(inlet(share), nothing);
            by(found, windows_to_trip(due), Faults::NO_INFLOW);
            let half = Bench::nominal().finds(inlet(share), gas(0.5 * due, PRESSURE_PA));
            by(half, windows_to_trip(0.5 * due), Faults::NO_INFLOW);
            assert_eq!(Bench::nominal().finds(inlet(share), gas(5.0 * due, PRESSURE_PA)), None);
        }
    }

    #[test]
    fn an_outlet_that_passes_nothing_is_found_until_the_muscle_is_empty() {
        let ambient_pa = 101_325.0;
        for (share, pressure_pa) in [(1.0, PRESSURE_PA), (0.4, PRESSURE_PA), (1.0, 1.3e5)] {
            let due = due(share * WINDOW_S - PULSE_S, pressure_pa - ambient_pa);
            let found = Bench::nominal().finds(outlet(share), gas(0.0, pressure_pa));
            by(found, windows_to_trip(due), Faults::NO_OUTFLOW);
            let half = Bench::nominal().finds(outlet(share), gas(-0.5 * due, pressure_pa));
            by(half, windows_to_trip(0.5 * due), Faults::NO_OUTFLOW);
            assert_eq!(Bench::nominal().finds(outlet(share), gas(-3.0 * due, pressure_pa)), None);
        }
        let empty = gas(0.0, 0.99 * EMPTY * ambient_pa);
        let mut bench = Bench::nominal();
        let found = |_| bench.window(Command::VENT, empty, Some(0.3));
        assert!((0..500).map(found).all(|found| found == Faults::NONE), "on its stop");
    }

    /// Found once, then counted anew; a muscle that bursts while it is filled gets gas and keeps none.
    #[test]
    fn a_loss_while_filling_is_a_burst() {
        let mut bench = Bench::nominal();
        let due = due(WINDOW_S - PULSE_S, SUPPLY * 7.0e5 - PRESSURE_PA);
        for _ in 0..3 {
            let found = bench.finds(inlet(1.0), gas(0.0, PRESSURE_PA));
            by(found, windows_to_trip(due), Faults::NO_INFLOW);
        }
        let share = 1.5 * BURST_PER_S * WINDOW_S;
        let found = Bench::nominal().finds(inlet(1.0), gas(-share, PRESSURE_PA));
        by(found, windows_to_trip(due + share), Faults::BURST);
    }

    /// Where PWM periods do not go into a window whole, one of its pulses may fall into the next.
    #[test]
    fn a_pulse_that_may_fall_into_the_next_window_is_not_counted() {
        let mut config = Config::default();
        config.drive.period_steps = 7;
        let over_pa = SUPPLY * 7.0e5 - PRESSURE_PA;
        for (share, open_s) in [(0.8, 0.8 * WINDOW_S - PULSE_S - 0.007), (1.0, WINDOW_S - PULSE_S)]
        {
            let found = Bench::new(&config).finds(inlet(share), gas(0.0, PRESSURE_PA));
            by(found, windows_to_trip(due(open_s, over_pa)), Faults::NO_INFLOW);
        }
    }

    /// Both valves open: what comes and goes is anybody's guess.
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
        let Shape::Muscle(geometry) = Shape::new(&Config::default().body) else { unreachable!() };
        let gauge_pa = 3.0e5;
        let force_n = geometry.force_n(gauge_pa, LENGTH_M);
        // Friction of 15 N either way, and what the law is wrong by.
        let tolerance_n = 2.0 * 15.0 + LAW * geometry.force_n(gauge_pa, 0.3);
        let least_n = (force_n - tolerance_n) / WRONG;
        let most_n = (force_n + tolerance_n) * WRONG;
        let windows = Some(u32::from(IMPOSSIBLE_WINDOWS) + 2);
        assert_eq!(force_found(0.98 * least_n, gauge_pa, LENGTH_M), windows);
        for load_n in [1.02 * least_n, force_n, 0.98 * most_n] {
            assert_eq!(force_found(load_n, gauge_pa, LENGTH_M), None, "{load_n} N");
        }
        assert_eq!(force_found(1.02 * most_n, gauge_pa, LENGTH_M), windows);
    }

    /// On its stops the load says nothing: 100 mbar do not hold 300 N, and need not there.
    #[test]
    fn the_force_on_a_stop_is_not_judged() {
        let Shape::Muscle(geometry) = Shape::new(&Config::default().body) else { unreachable!() };
        let margin_m = NEAR_STOP * 0.3;
        for (stop_m, inwards) in [(geometry.shortest_m(), 1.0), (0.3, -1.0)] {
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

    /// An impossible force has to last: what is possible in between counts against it, and a length
    /// that is not trusted starts anew.
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
            // The first one has moved there.
            assert_eq!(windows(1 + IMPOSSIBLE_WINDOWS, Some(LENGTH_M), 6.0e5), 0);
            assert_eq!(windows(between, length_m, pressure_pa), 0);
            assert_eq!(windows(between, Some(LENGTH_M), 6.0e5), 0);
            windows(1, Some(LENGTH_M), 6.0e5)
        };
        assert_eq!(found_after(20, Some(LENGTH_M), 2.0e5), 1, "possible for as long");
        assert_eq!(found_after(20, Some(0.2999), 6.0e5), 0, "there, and back again");
        assert_eq!(found_after(20, None, 6.0e5), 0, "without a length it starts anew");
    }

    #[test]
    fn what_does_not_move_has_no_force_to_judge() {
        let vessel = crate::config::Body::Vessel { section_m2: 0.01, surface_m2: 0.1 };
        let held = Load::Isometric { length_m: LENGTH_M };
        for config in [
            Config { body: vessel, ..Config::default() },
            Config { load: held, ..Config::default() },
        ] {
            let mut bench = Bench::new(&config);
            for _ in 0..1000 {
                let found = bench.window(Command::CLOSED, gas(0.0, 6.0e5), Some(LENGTH_M));
                assert_eq!(found, Faults::NONE);
            }
        }
    }
}

#[cfg(test)]
mod trials {
    use super::*;

    const HELD_PA: f32 = 4.0e5;
    const MASS_KG: f32 = 7.0e-4;
    /// What an open inlet of the nominal muscle brings in a window, share of its gas \[-\].
    const OPEN: f32 = 4.0e-9 * 1.185 * 6.0e5 * 0.02 / MASS_KG;

    fn shape() -> Shape {
        Shape::new(&Config::default().body)
    }

    /// The faults of so many windows in which valves are driven for these shares, and gas is gained.
    fn after(watch: &mut Watch, windows: u32, drive: (f32, f32), gained: f32) -> Faults {
        let balance = Balance { gained, pressure_pa: HELD_PA, mass_kg: MASS_KG };
        let command =
            Command { inlet: Duty::from_share(drive.0), outlet: Duty::from_share(drive.1) };
        (0..windows).fold(Faults::NONE, |found, _| {
            for _ in 0..INTERVAL_STEPS {
                watch.drive(command);
            }
            found.with(watch.add(&shape(), &balance, Some(0.27)))
        })
    }

    fn watch() -> Watch {
        let load = Load::Isometric { length_m: 0.27 };
        Watch::new(&Config { load, ..Config::default() })
    }

    /// A loop that makes up for a leak of a tenth of its valve, by pulses that are too short for
    /// anything else to be sure of.
    #[test]
    fn a_leak_that_is_made_up_for_shows() {
        assert_eq!(after(&mut watch(), 120, (0.1, 0.0), 0.0), Faults::NONE, "2.4 s");
        assert_eq!(after(&mut watch(), 250, (0.1, 0.0), 0.0), Faults::LEAK, "5 s");
        let third = OPEN * 0.1 / 3.0;
        assert_eq!(after(&mut watch(), 5000, (0.1, 0.0), third), Faults::NONE, "it fills, slowly");
    }

    #[test]
    fn a_large_hole_that_is_made_up_for_is_a_burst() {
        let found = after(&mut watch(), 60, (0.9, 0.0), 0.0);
        assert!(found.intersects(Faults::BURST) && !found.intersects(Faults::LEAK), "{found}");
    }

    #[test]
    fn an_inlet_whose_leak_is_let_out_again_shows() {
        assert_eq!(after(&mut watch(), 150, (0.0, 0.1), 0.0), Faults::NONE, "three seconds");
        assert_eq!(after(&mut watch(), 250, (0.0, 0.1), 0.0), Faults::GAS_GAINED, "5 s");
        let third = OPEN * 0.1 / 3.0;
        assert_eq!(after(&mut watch(), 5000, (0.0, 0.1), -third), Faults::NONE, "it empties");
    }

    #[test]
    fn without_a_length_nothing_is_known_of_the_gas() {
        let mut watch = watch();
        let balance = Balance { gained: -0.1, pressure_pa: HELD_PA, mass_kg: MASS_KG };
        for _ in 0..1000 {
            assert_eq!(watch.add(&shape(), &balance, None), Faults::NONE);
        }
        assert_eq!(watch.add(&shape(), &balance, Some(0.27)), Faults::NONE);
        let found = (0..20)
            .fold(Faults::NONE, |found, _| found.with(watch.add(&shape(), &balance, Some(0.27))));
        assert_eq!(found, Faults::BURST, "with it, again");
    }
}
