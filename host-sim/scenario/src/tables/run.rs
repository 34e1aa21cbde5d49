//! The run: duration, drive, link, and fit.

use crate::declare::{choice, table};
use model_core::config::{self, LinkConfig};

table! {
    "run", "length, step, seed";
    Run {
        duration_s: real 100.0, "s", 0.001 to 1.0e6, "simulated time";
        step_s: from config::STEP_S;
        seed: whole u64, 1, 0 to 9_223_372_036_854_775_807, "seed of every random number";
        log_every: whole u64, 10, 1 to 1_000_000_000, "one row of the trace per that many steps";
    }
}

impl Run {
    /// Steps of the run: its duration, rounded to whole steps.
    pub fn steps(&self) -> u64 {
        (self.duration_s / self.step_s).round() as u64
    }

    /// End of the last step \[s\].
    pub fn end_s(&self) -> f64 {
        let end_s = self.steps() as f64 * self.step_s;
        // As written in the file where only the last digits differ.
        let is_duration = (end_s - self.duration_s).abs() < 1e-6 * self.step_s;
        if is_duration { self.duration_s } else { end_s }
    }
}

choice! {
    /// Drive of the run.
    DriveKind {
        /// Constant inflow for half of the period, the same outflow for the other half.
        MassFlow = "mass-flow",
        /// Inlet duty (positive) or outlet duty (negative) from the profile.
        Duty = "duty",
        Pressure = "pressure",
        Contraction = "contraction",
        /// Vessel: nozzle open to ambient. Muscle: outlet open.
        Discharge = "discharge",
        /// Vessel: nozzle open to the supply. Muscle: inlet open.
        Fill = "fill",
        Closed = "closed",
    }
}

table! {
    "drive", "set point over the run";
    Drive {
        kind: choice DriveKind::MassFlow, "controlled quantity, or fixed openings";
        period_s: real 5.0, "s", 1.0e-3 to 86_400.0, "period of the cycle (mass-flow)";
        flow_kg_s: real 3.6e-4, "kg/s", 0.0 to 1.0, "flow, in for half of the period, then out (mass-flow)";
        pressure_pa: real 300_000.0, "Pa", 1.0 to 1.0e8, "set point, absolute (pressure)";
        contraction: real 0.1, "", -10.0 to 0.95, "set point, fraction of the rest length; negative where it lengthens (contraction)";
        profile_csv: csv "value", "flow (negative: out), duty (negative: outlet), pressure or contraction over time";
    }
}

table! {
    "link", "line between host and board";
    Link as LinkConfig {
        core timeout_s;
    }
}

table! {
    "identify", "what thermyo identify fits to measurements";
    Identify {
        parameters: list "keys whose values are fitted, such as heat.scale";
        columns: list "measured columns to compare with; empty: all that the data has";
        starts: whole u64, 6, 1 to 100, "starts of the search, the scenario's own values first";
        spread: real 2.0, "", 1.0 to 100.0, "factor that the other starts lie within";
    }
}
