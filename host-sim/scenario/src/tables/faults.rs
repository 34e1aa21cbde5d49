//! Faults that a run injects: `[faults]` is one window of time, every `[faults.NAME]` another one.

use super::air::IDEAL_GAS_PA;
use crate::declare::{choice, table};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

choice! {
    /// A fault of one analog channel.
    ChannelFault {
        None = "none",
        /// The wire is open: the code goes to the upper rail.
        Open = "open",
        /// The wire is shorted to ground: the code goes to the lower rail.
        Shorted = "shorted",
        /// The code stays at its value when the fault began.
        Frozen = "frozen",
        /// Strong noise on the channel, 5 % of the range.
        Noisy = "noisy",
        /// The reading drifts at a constant rate from the start of the window.
        Drifting = "drifting",
    }
}

choice! {
    /// A fault of one valve.
    ValveFault {
        None = "none",
        Open = "open",
        Shut = "shut",
        /// It leaks when shut.
        Leaking = "leaking",
    }
}

choice! {
    /// A fault of the link between host and board.
    LinkFault {
        None = "none",
        /// The host goes silent.
        Lost = "lost",
        /// More requests arrive than the board takes.
        Flooded = "flooded",
    }
}

table! {
    /// A fault that needs a number has one.
    "faults", "faults that the run injects in one window of time; every [faults.NAME] is another";
    FaultWindow {
        pressure: choice ChannelFault::None, "fault of the pressure channel";
        pressure_drift_pa_s: optional "Pa/s", -1.0e8 to 1.0e8, "drift of its sensor from the start on (drifting)";
        gas: choice ChannelFault::None, "fault of the gas sensor's channel";
        gas_drift_k_s: optional "K/s", -1000.0 to 1000.0, "drift of its sensor from the start on (drifting)";
        length: choice ChannelFault::None, "fault of the length channel";
        length_drift_m_s: optional "m/s", -10.0 to 10.0, "drift of its sensor from the start on (drifting)";
        inlet: choice ValveFault::None, "fault of the inlet valve: stuck open, stuck shut, not tight";
        inlet_leak: optional "", 0.0 to 1.0, "share of the conductance passed when shut (leaking)";
        outlet: choice ValveFault::None, "fault of the outlet valve: stuck open, stuck shut, not tight";
        outlet_leak: optional "", 0.0 to 1.0, "share of the conductance passed when shut (leaking)";
        leak_conductance_m3_s_pa: real 0.0, "m3/(s Pa)", 0.0 to 1.0e-3, "sonic conductance of a hole from the gas to ambient, large for a burst; 0: none";
        supply_pressure_pa: optional "Pa", 1.0 to IDEAL_GAS_PA, "in place of the supply's own; below the gas's, gas flows back through an open inlet";
        emergency_stop: switch false, "the emergency stop is pressed";
        link: choice LinkFault::None, "fault of the line to the board: the host is silent, or sends too much";
        missed_steps: whole u8, 0, 0 to 200, "steps that the board leaves out together";
        missed_period_s: real 1.0, "s", 1.0e-3 to 1.0e6, "they are left out again after that time";
        board_restart: switch false, "the board restarts at the window's start, and is not configured again";
        from_s: real 0.0, "s", 0.0 to 1.0e6, "start of the window";
        until_s: real 1.0e6, "s", 0.0 to 1.0e6, "end of the window";
    }
}

/// Required keys, each with the key and the word that require it.
pub const NEEDED: [[&str; 3]; 5] = [
    ["pressure", "drifting", "pressure_drift_pa_s"],
    ["gas", "drifting", "gas_drift_k_s"],
    ["length", "drifting", "length_drift_m_s"],
    ["inlet", "leaking", "inlet_leak"],
    ["outlet", "leaking", "outlet_leak"],
];

impl FaultWindow {
    /// Whether this time \[s\] lies in the window; its end does not.
    pub fn contains(&self, time_s: f64) -> bool {
        (self.from_s..self.until_s).contains(&time_s)
    }

    /// Whether the step at this time \[s\], of `step_s` \[s\], is the first in the window.
    pub fn starts_at(&self, time_s: f64, step_s: f64) -> bool {
        // Times are sums: the window may start a rounding error after its step.
        let steps = (time_s - self.from_s) / step_s + 1e-9;
        (0.0..1.0).contains(&steps) && time_s < self.until_s
    }

    /// Number of steps that are missed before the step at this time \[s\], for steps of `step_s`
    /// \[s\].
    pub fn missed_steps_at(&self, time_s: f64, step_s: f64) -> u8 {
        // A period may end a rounding error before its step.
        let periods = |time_s: f64| ((time_s - self.from_s) / self.missed_period_s + 1e-9).floor();
        let again = self.contains(time_s) && periods(time_s) > periods(time_s - step_s);
        if again || self.starts_at(time_s, step_s) { self.missed_steps } else { 0 }
    }

    /// The overlap of two windows, start and end \[s\].
    pub fn shared_with(&self, other: &Self) -> Option<[f64; 2]> {
        let (from_s, until_s) = (self.from_s.max(other.from_s), self.until_s.min(other.until_s));
        (from_s < until_s).then_some([from_s, until_s])
    }

    /// Keys of the faults in the window.
    pub fn broken(&self) -> impl Iterator<Item = &'static str> {
        let broken = [
            ("pressure", self.pressure != ChannelFault::None),
            ("gas", self.gas != ChannelFault::None),
            ("length", self.length != ChannelFault::None),
            ("inlet", self.inlet != ValveFault::None),
            ("outlet", self.outlet != ValveFault::None),
            ("leak_conductance_m3_s_pa", self.leak_conductance_m3_s_pa > 0.0),
            ("supply_pressure_pa", self.supply_pressure_pa.is_some()),
            ("emergency_stop", self.emergency_stop),
            ("link", self.link != LinkFault::None),
            ("missed_steps", self.missed_steps > 0),
            ("board_restart", self.board_restart),
        ];
        broken.into_iter().filter_map(|(key, broken)| broken.then_some(key))
    }
}

/// All windows of a scenario. Overlapping windows have faults in different parts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default)]
pub struct Faults {
    /// Keys of `[faults]` itself.
    #[serde(flatten)]
    pub own: FaultWindow,
    #[serde(flatten)]
    pub named: BTreeMap<String, FaultWindow>,
}

impl Faults {
    /// Every window with the path of its table, `[faults]` first.
    pub fn windows(&self) -> impl Iterator<Item = (String, &FaultWindow)> {
        let named = self.named.iter().map(|(name, window)| (format!("faults.{name}"), window));
        std::iter::once(("faults".to_owned(), &self.own)).chain(named)
    }

    pub fn windows_mut(&mut self) -> impl Iterator<Item = &mut FaultWindow> {
        std::iter::once(&mut self.own).chain(self.named.values_mut())
    }

    /// Sonic conductance of the largest hole \[m3/(s Pa)\].
    pub fn largest_leak_m3_s_pa(&self) -> f64 {
        self.windows().map(|(_, window)| window.leak_conductance_m3_s_pa).fold(0.0, f64::max)
    }
}
