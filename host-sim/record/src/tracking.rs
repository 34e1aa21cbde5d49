//! Tracking of the set point: figures of `control` in every summary, gathered step by step.

use crate::bandwidth::Bandwidth;
use crate::trace::Row;
use model_core::{Command, Mode};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use thermyo_compute::math;
use thermyo_files::number::significant;
use thermyo_files::units::{Unit, UnitSystem};
use thermyo_scenario::{Chirp, DriveKind, Scenario, Shape, ValveKind};

/// An error within this fraction of a jump counts as settled, as in `thermyo tune` \[-\].
const SETTLED: f64 = 0.05;
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
    /// Root-mean-square error.
    pub rms_error: f64,
    /// Mean error over the last tenth of the run, or from the time at which the last jump within it has settled; none
    /// if the run ended before.
    pub steady_error: Option<f64>,
    /// Largest excess over the largest set point, or below the smallest one if the set point falls, relative to the set
    /// point's range, or to the way to the first one if that is longer; for a constant set point, relative to the set
    /// point.
    pub overshoot: f64,
    /// Amplitude of the value over that of a sine of the set point, after its first period \[-\].
    pub gain: Option<f64>,
    /// Phase of the value against that sine; negative if it lags \[deg\].
    pub phase_deg: Option<f64>,
    /// Frequency up to which the gain of a chirp stays above -3 dB, at most the chirp's highest \[Hz\]; none for other
    /// shapes.
    pub bandwidth_hz: Option<f64>,
    /// Longest time from a jump of the set point until the error stays within 5 % of the jump, or within twice the
    /// controller's dead zone \[s\]; none if a jump never settled, or there was none.
    pub settled_s: Option<f64>,
    /// Jumps after which the value did not settle before the next one.
    pub unsettled: u64,
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
        let text = |value| self.quantity.text(value, units);
        let mut line = format!("set point: RMS error {}", text(self.rms_error));
        if let Some(error) = self.steady_error {
            line += &format!(", at the end {}", text(error));
        }
        line += &format!(", overshoot {:.1} %", self.overshoot * 100.0);
        if let (Some(gain), Some(phase_deg)) = (self.gain, self.phase_deg) {
            line += &format!(", gain {}, phase {phase_deg:.0} deg", significant(gain, 3));
        }
        if let Some(hz) = self.bandwidth_hz {
            line += &format!(", gain above -3 dB up to {} Hz", significant(hz, 2));
        }
        if let Some(settled_s) = self.settled_s {
            line += &format!(", settled in {} s", significant(settled_s, 3));
        }
        if self.unsettled > 0 {
            line += &format!(", not settled after {} jumps", self.unsettled);
        }
        let pulses =
            self.pulses_per_s.map_or_else(String::new, |rate| format!("{rate:.1} pulses/s; "));
        format!("{line}\nvalves: {pulses}{}\n", self.diagnosis)
    }
}

/// Inputs of the figures from a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    sine_s: Option<f64>,
    /// A chirp, and the set point about which it swings.
    chirp: Option<(Chirp, f64)>,
    /// Whether the set point jumps and is constant in between.
    jumps: bool,
    /// Error that the controller tolerates at rest, in the set point's unit.
    dead_zone: f64,
    /// Whether valves are driven by pulses, not in proportion.
    switches: bool,
    pwm_hz: f64,
    step_s: f64,
    duration_s: f64,
    from_s: f64,
}

impl Reference {
    pub fn of(scenario: &Scenario) -> Self {
        let (drive, controller) = (&scenario.drive, &scenario.controller);
        let dead_zone = match drive.kind {
            DriveKind::Contraction => controller.contraction_dead_zone,
            _ => controller.pressure_dead_zone_pa,
        };
        let two_periods = scenario.run.duration_s >= 2.0 * drive.period_s;
        Self {
            dead_zone: f64::from(dead_zone),
            sine_s: (drive.shape == Shape::Sine).then_some(drive.period_s),
            chirp: (drive.shape == Shape::Chirp)
                .then(|| (drive.chirp(scenario.run.duration_s), drive.middle())),
            jumps: matches!(drive.shape, Shape::Step | Shape::Staircase) || drive.is_constant(),
            switches: scenario.valve.kind == ValveKind::Switching,
            pwm_hz: scenario.valve.pwm_hz,
            step_s: scenario.run.step_s,
            duration_s: scenario.run.duration_s,
            from_s: if drive.shape != Shape::Constant && two_periods {
                drive.period_s
            } else {
                0.0
            },
        }
    }

    /// Whole periods of the sine, without the first one \[s\].
    fn counted_s(&self) -> Option<[f64; 2]> {
        let period_s = self.sine_s?;
        let periods = (self.duration_s / period_s + 1e-9).floor();
        (periods >= 2.0).then_some([period_s, periods * period_s])
    }
}

#[derive(Debug, Clone, Copy)]
struct Jump {
    at_s: f64,
    band: f64,
    /// Time at which the error was last beyond the band \[s\].
    beyond_s: f64,
}

/// The figures while a run goes on, in constant memory.
#[derive(Debug, Clone)]
pub(crate) struct Tracking {
    reference: Reference,
    steps: u64,
    squares: f64,
    late_steps: u64,
    late_sum: f64,
    set_points: [f64; 2],
    /// Smallest value since a value was first at or above the set point; largest since a value was first at or below
    /// it.
    values: [f64; 2],
    /// Way from the first value to the first set point.
    way: f64,
    /// Whether the set point was below the first value, or below an earlier set point.
    falls: bool,
    /// Sums of set point and value with sine and cosine.
    sums: [[f64; 2]; 2],
    bandwidth: Option<Bandwidth>,
    before: Option<f64>,
    jump: Option<Jump>,
    settled_s: Option<f64>,
    unsettled: u64,
    last_s: f64,
    pulses: f64,
    duties: [f64; 2],
    open: [u64; 2],
    limited: u64,
    vented: u64,
}

impl Tracking {
    pub(crate) fn new(reference: Reference) -> Self {
        Self {
            reference,
            steps: 0,
            squares: 0.0,
            late_steps: 0,
            late_sum: 0.0,
            set_points: [f64::INFINITY, f64::NEG_INFINITY],
            values: [f64::INFINITY, f64::NEG_INFINITY],
            way: 0.0,
            falls: false,
            sums: [[0.0; 2]; 2],
            bandwidth: reference.chirp.map(Bandwidth::new),
            before: None,
            jump: None,
            settled_s: None,
            unsettled: 0,
            last_s: 0.0,
            pulses: 0.0,
            duties: [0.0; 2],
            open: [0; 2],
            limited: 0,
            vented: 0,
        }
    }

    pub(crate) fn add(&mut self, row: &Row, value: f64) {
        let (time_s, set_point) = (row.truth.time_s, row.set_point);
        if time_s < self.reference.from_s - 0.5 * self.reference.step_s {
            self.before = Some(set_point);
            return;
        }
        let error = value - set_point;
        let command = row.telemetry.command;
        // During a fault, or while the board waits, the loop is not what opens the outlet.
        let vents = row.telemetry.mode == Mode::Vent && command == Command::VENT;
        if self.steps == 0 {
            self.way = error.abs();
        }
        let [least, most] = self.set_points;
        self.falls |= set_point < most || (self.steps == 0 && error > 0.0);
        self.set_points = [least.min(set_point), most.max(set_point)];
        let [low, high] = self.values;
        if !vents && (error >= 0.0 || low.is_finite()) {
            self.values[0] = low.min(value);
        }
        if error <= 0.0 || high.is_finite() {
            self.values[1] = high.max(value);
        }
        self.steps += 1;
        self.squares += error * error;
        self.limited += u64::from(row.telemetry.limited);
        self.add_sine(time_s, [set_point, value]);
        if let Some(bandwidth) = &mut self.bandwidth {
            bandwidth.add(time_s, [set_point, value]);
        }
        if self.reference.jumps {
            self.add_jump(time_s, set_point, value);
        }
        self.add_late(time_s, error);
        let shares = [command.inlet, command.outlet].map(|duty| f64::from(duty.share()));
        self.add_valves(shares);
        self.vented += u64::from(vents);
        self.last_s = time_s;
    }

    fn add_sine(&mut self, time_s: f64, values: [f64; 2]) {
        let (Some(period_s), Some([from_s, to_s])) =
            (self.reference.sine_s, self.reference.counted_s())
        else {
            return;
        };
        // The end of the last period is the start of the next.
        if time_s < from_s - 0.5 * self.reference.step_s
            || time_s > to_s - 0.5 * self.reference.step_s
        {
            return;
        }
        let angle = TAU * time_s / period_s;
        let parts = [math::sin(angle), math::cos(angle)];
        for (sums, value) in self.sums.iter_mut().zip(values) {
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += value * part;
            }
        }
    }

    fn add_jump(&mut self, time_s: f64, set_point: f64, value: f64) {
        let before = self.before.replace(set_point).unwrap_or(value);
        if set_point != before {
            self.end_jump();
            let band = (SETTLED * (set_point - before).abs()).max(2.0 * self.reference.dead_zone);
            self.jump = Some(Jump { at_s: time_s, band, beyond_s: time_s });
        }
        if let Some(jump) = &mut self.jump
            && (value - set_point).abs() > jump.band
        {
            jump.beyond_s = time_s;
        }
    }

    fn add_late(&mut self, time_s: f64, error: f64) {
        let late_s = 0.9 * self.reference.duration_s;
        if time_s < late_s {
            return;
        }
        let settles =
            self.jump.as_ref().is_some_and(|jump| jump.at_s >= late_s && jump.beyond_s == time_s);
        if settles {
            (self.late_steps, self.late_sum) = (0, 0.0);
        } else {
            self.late_steps += 1;
            self.late_sum += error;
        }
    }

    fn end_jump(&mut self) {
        let Some(Jump { at_s, beyond_s, .. }) = self.jump.take() else { return };
        if self.last_s <= at_s {
            // In the last step of the run there is no time to settle.
        } else if beyond_s >= self.last_s {
            self.unsettled += 1;
        } else {
            let settled_s = beyond_s - at_s;
            self.settled_s = Some(self.settled_s.map_or(settled_s, |most| most.max(settled_s)));
        }
    }

    fn add_valves(&mut self, shares: [f64; 2]) {
        let Reference { pwm_hz, step_s, .. } = self.reference;
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

    /// The figures; none before the first step.
    pub(crate) fn figures(mut self, quantity: Controlled) -> Option<Control> {
        if self.steps == 0 {
            return None;
        }
        self.end_jump();
        let steps = self.steps as f64;
        let [least, most] = self.set_points;
        let span = if most > least { (most - least).max(self.way) } else { most.abs() };
        let [low, high] = self.values;
        let below = if self.falls { least - low } else { 0.0 };
        let [[set_sin, set_cos], [sin, cos]] = self.sums;
        let size = math::hypot(set_sin, set_cos);
        let phase = math::atan2(cos, sin) - math::atan2(set_cos, set_sin);
        let sine = size > 0.0;
        let mut control = Control {
            quantity,
            rms_error: (self.squares / steps).sqrt(),
            steady_error: (self.late_steps > 0).then(|| self.late_sum / self.late_steps as f64),
            overshoot: ((high - most).max(below) / span).max(0.0),
            gain: sine.then(|| math::hypot(sin, cos) / size),
            phase_deg: sine.then(|| wrapped(phase).to_degrees()),
            bandwidth_hz: self.bandwidth.as_ref().and_then(Bandwidth::hz),
            settled_s: self.settled_s.filter(|_| self.unsettled == 0),
            unsettled: self.unsettled,
            pulses_per_s: self
                .reference
                .switches
                .then(|| self.pulses / (steps * self.reference.step_s)),
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

/// An angle from -pi to pi.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
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
