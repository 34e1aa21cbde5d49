//! Faults that a run injects: `[faults]` is one window of time, every `[faults.NAME]` another one.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A fault of one analog channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelFault {
    /// Healthy.
    None,
    /// The line is open: the code goes to the upper rail.
    Open,
    /// The line is shorted to ground: the code goes to the lower rail.
    Shorted,
    /// The code stays what it was when the fault began.
    Frozen,
    /// Strong noise on the line, 5 % of the range.
    Noisy,
    /// The sensor's reading runs away at a steady rate from the window's start on.
    Drifting,
}

/// A fault of one valve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValveFault {
    /// Healthy.
    None,
    /// Stuck open.
    Open,
    /// Stuck shut.
    Shut,
    /// It does not close tightly.
    Leaking,
}

/// A fault of the line between host and board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinkFault {
    /// Healthy.
    None,
    /// The host goes silent.
    Lost,
    /// More requests arrive than the board takes.
    Flooded,
}

/// What is broken in one window of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultWindow {
    /// Pressure channel.
    pub pressure: ChannelFault,
    /// Its drift \[Pa/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_drift_pa_s: Option<f64>,
    /// Gas sensor's channel.
    pub gas: ChannelFault,
    /// Its drift \[K/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gas_drift_k_s: Option<f64>,
    /// Length channel.
    pub length: ChannelFault,
    /// Its drift \[m/s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_drift_m_s: Option<f64>,
    /// Inlet valve.
    pub inlet: ValveFault,
    /// Share of its full conductance that a leaking inlet passes when it is shut \[-\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inlet_leak: Option<f64>,
    /// Outlet valve.
    pub outlet: ValveFault,
    /// Share of its full conductance that a leaking outlet passes when it is shut \[-\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outlet_leak: Option<f64>,
    /// Sonic conductance of a hole from the gas to ambient; 0 for none \[m3/(s Pa)\].
    pub leak_conductance_m3_s_pa: f64,
    /// Absolute supply pressure in the window \[Pa\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub supply_pressure_pa: Option<f64>,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// Line between host and board.
    pub link: LinkFault,
    /// Steps that the board leaves out together, at the window's start and again after every
    /// `missed_period_s`; 0 for none.
    pub missed_steps: u8,
    /// See `missed_steps` \[s\].
    pub missed_period_s: f64,
    /// Start of the window \[s\].
    pub from_s: f64,
    /// End of the window \[s\].
    pub until_s: f64,
}

impl Default for FaultWindow {
    fn default() -> Self {
        Self {
            pressure: ChannelFault::None,
            pressure_drift_pa_s: None,
            gas: ChannelFault::None,
            gas_drift_k_s: None,
            length: ChannelFault::None,
            length_drift_m_s: None,
            inlet: ValveFault::None,
            inlet_leak: None,
            outlet: ValveFault::None,
            outlet_leak: None,
            leak_conductance_m3_s_pa: 0.0,
            supply_pressure_pa: None,
            emergency_stop: false,
            link: LinkFault::None,
            missed_steps: 0,
            missed_period_s: 1.0,
            from_s: 0.0,
            until_s: 1.0e6,
        }
    }
}

impl FaultWindow {
    /// Whether that time \[s\] lies in the window; its end does not.
    pub fn contains(&self, time_s: f64) -> bool {
        (self.from_s..self.until_s).contains(&time_s)
    }

    /// Steps that are left out before the one at that time \[s\], of `step_s` \[s\].
    pub fn missed_steps_at(&self, time_s: f64, step_s: f64) -> u8 {
        // Times are sums: a period may end a rounding before its step.
        let periods = |time_s: f64| ((time_s - self.from_s) / self.missed_period_s + 1e-9).floor();
        let before_s = time_s - step_s;
        let first = !self.contains(before_s) || periods(time_s) > periods(before_s);
        if self.contains(time_s) && first { self.missed_steps } else { 0 }
    }

    /// The time that two windows share, start and end \[s\].
    pub fn shared_with(&self, other: &Self) -> Option<[f64; 2]> {
        let (from_s, until_s) = (self.from_s.max(other.from_s), self.until_s.min(other.until_s));
        (from_s < until_s).then_some([from_s, until_s])
    }

    /// Keys of the lines and parts that it breaks.
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
        ];
        broken.into_iter().filter_map(|(key, broken)| broken.then_some(key))
    }
}

/// All windows of a scenario. Where they overlap, they break different lines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default)]
pub struct Faults {
    /// The keys of `[faults]` itself.
    #[serde(flatten)]
    pub own: FaultWindow,
    /// The windows `[faults.NAME]`.
    #[serde(flatten)]
    pub named: BTreeMap<String, FaultWindow>,
}

impl Faults {
    /// Every window with the path of its table, `[faults]` first.
    pub fn windows(&self) -> impl Iterator<Item = (String, &FaultWindow)> {
        let named = self.named.iter().map(|(name, window)| (format!("faults.{name}"), window));
        std::iter::once(("faults".to_owned(), &self.own)).chain(named)
    }

    /// Sonic conductance of the largest hole \[m3/(s Pa)\].
    pub fn largest_leak_m3_s_pa(&self) -> f64 {
        self.windows().map(|(_, window)| window.leak_conductance_m3_s_pa).fold(0.0, f64::max)
    }
}
