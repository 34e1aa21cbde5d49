//! Tracking of the set point: figures of `control` in every summary, gathered step by step.

use crate::following::{Followed, Following, Reference};
use crate::trace::Row;
use model_core::{Command, Mode};
use serde::{Deserialize, Serialize};
use thermyo_files::number::significant;
use thermyo_files::units::{Unit, UnitSystem};
use thermyo_scenario::{DriveKind, Scenario, ValveKind};

/// Fraction of the time at its end from which a valve, or the limit, counts as limiting: an assumption \[-\].
const OFTEN: f64 = 0.1;
/// Distance of duties from 0 and 1 up to which they are no pulses \[-\].
const END: f64 = 1e-3;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Controlled {
    /// Absolute pressure \[Pa\].
    Pressure,
    /// Contraction, fraction of the rest length \[-\].
    Contraction,
}

impl Controlled {
    pub fn name(self) -> &'static str {
        match self {
            Self::Pressure => "Absolute pressure",
            Self::Contraction => "Contraction",
        }
    }

    pub fn unit(self) -> Unit {
        match self {
            Self::Pressure => Unit::of_column("pressure_pa"),
            Self::Contraction => Unit { symbol: "% of rest length", factor: 100.0 },
        }
    }

    pub fn text(self, value: f64, units: UnitSystem) -> String {
        let Unit { symbol, factor } = match (units, self) {
            (UnitSystem::Practical, _) => self.unit(),
            (UnitSystem::Si, Self::Pressure) => Unit { symbol: "Pa", factor: 1.0 },
            (UnitSystem::Si, Self::Contraction) => Unit { symbol: "of rest length", factor: 1.0 },
        };
        format!("{} {symbol}", significant(value * factor, 3))
    }
}

/// Control errors, in the set point's unit. The errors of a shape count after its first period, in which the muscle
/// reaches the shape's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Control {
    pub quantity: Controlled,
    #[serde(flatten)]
    pub followed: Followed,
    /// Pulses of both valves per second \[1/s\]; none for valves that open in proportion.
    pub pulses_per_s: Option<f64>,
    /// Fraction of the time in which the inlet is fully open \[-\].
    pub inlet_open: f64,
    /// Fraction of the time in which the outlet is fully open \[-\].
    pub outlet_open: f64,
    /// Fraction of the time in which the set point requires more than the allowed pressure \[-\].
    pub limited: f64,
    /// The limit of the loop, in a sentence.
    pub diagnosis: String,
}

impl Control {
    /// Two lines of text.
    pub fn text(&self, units: UnitSystem) -> String {
        let followed = &self.followed;
        let text = |value| self.quantity.text(value, units);
        let mut line = format!("set point: RMS error {}", text(followed.rms_error));
        if let Some(error) = followed.steady_error {
            line += &format!(", at the end {}", text(error));
        }
        line += &followed.shape_text();
        let pulses =
            self.pulses_per_s.map_or_else(String::new, |rate| format!("{rate:.1} pulses/s; "));
        format!("{line}\nvalves: {pulses}{}\n", self.diagnosis)
    }
}

/// Inputs of the figures from a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    reference: Reference,
    /// Whether valves are driven by pulses, not in proportion.
    switches: bool,
    pwm_hz: f64,
    step_s: f64,
}

impl Tracked {
    pub fn of(scenario: &Scenario) -> Self {
        let (drive, controller) = (&scenario.drive, &scenario.controller);
        let dead_zone = match drive.kind {
            DriveKind::Contraction => controller.contraction_dead_zone,
            _ => controller.pressure_dead_zone_pa,
        };
        let run_s = [scenario.run.step_s, scenario.run.duration_s];
        let shaped = (drive.middle(), drive.period_s);
        let shape = drive.profile_csv.is_none().then_some(drive.shape);
        Self {
            reference: Reference::new(shape, shaped, f64::from(dead_zone), run_s),
            switches: scenario.valve.kind == ValveKind::Switching,
            pwm_hz: scenario.valve.pwm_hz,
            step_s: scenario.run.step_s,
        }
    }
}

/// The figures while a run goes on, in constant memory.
#[derive(Debug, Clone)]
pub(crate) struct Tracking {
    tracked: Tracked,
    following: Following,
    pulses: f64,
    duties: [f64; 2],
    open: [u64; 2],
    limited: u64,
    vented: u64,
}

impl Tracking {
    pub(crate) fn new(tracked: Tracked) -> Self {
        Self {
            tracked,
            following: Following::new(tracked.reference),
            pulses: 0.0,
            duties: [0.0; 2],
            open: [0; 2],
            limited: 0,
            vented: 0,
        }
    }

    pub(crate) fn add(&mut self, row: &Row, value: f64) {
        let command = row.telemetry.command;
        // During a fault, or while the board waits, the loop is not what opens the outlet.
        let vents = row.telemetry.mode == Mode::Vent && command == Command::VENT;
        if !self.following.add(row.truth.time_s, [row.set_point, value], vents) {
            return;
        }
        self.limited += u64::from(row.telemetry.limited);
        let shares = [command.inlet, command.outlet].map(|duty| f64::from(duty.share()));
        self.add_valves(shares);
        self.vented += u64::from(vents);
    }

    fn add_valves(&mut self, shares: [f64; 2]) {
        let Tracked { pwm_hz, step_s, .. } = self.tracked;
        for ((share, before), open) in shares.into_iter().zip(&mut self.duties).zip(&mut self.open)
        {
            let full = share >= 1.0 - END;
            // A duty in between is a pulse in every PWM period.
            if share > END && !full {
                self.pulses += pwm_hz * step_s;
            } else if full && *before <= END {
                self.pulses += 1.0;
            }
            *open += u64::from(full);
            *before = share;
        }
    }

    /// The figures; none before the first step that counts.
    pub(crate) fn figures(self, quantity: Controlled) -> Option<Control> {
        let followed = self.following.figures()?;
        let steps = self.following.steps() as f64;
        let mut control = Control {
            quantity,
            followed,
            pulses_per_s: self
                .tracked
                .switches
                .then(|| self.pulses / (steps * self.tracked.step_s)),
            inlet_open: self.open[0] as f64 / steps,
            outlet_open: self.open[1] as f64 / steps,
            limited: self.limited as f64 / steps,
            diagnosis: String::new(),
        };
        let vented = self.vented as f64 / steps;
        control.diagnosis = if vented >= OFTEN {
            format!("it vents {}: see its faults", of_the_time(vented))
        } else {
            diagnosis(&control)
        };
        Some(control)
    }
}

fn of_the_time(share: f64) -> String {
    format!("{:.0} % of the time", 100.0 * share)
}

fn diagnosis(control: &Control) -> String {
    let Control { inlet_open, outlet_open, limited, .. } = *control;
    if limited >= OFTEN {
        return format!(
            "the set point asks for more than the allowed pressure {}: that limit stops it",
            of_the_time(limited)
        );
    }
    match (inlet_open >= OFTEN, outlet_open >= OFTEN) {
        (false, false) => {
            "no valve is fully open for long: the loop, not the valve, sets the error".to_owned()
        }
        (true, _) if inlet_open >= outlet_open => format!(
            "the inlet is fully open {}: the valve or the supply limits you",
            of_the_time(inlet_open)
        ),
        _ => format!("the outlet is fully open {}: the valve limits you", of_the_time(outlet_open)),
    }
}
