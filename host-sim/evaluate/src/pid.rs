//! PID baseline: a PID on the length sets the pressure, without a model of muscle, load or
//! friction.

use model_core::{Config, Sample, SetPoint};
use thermyo_simulation::board::{Board, BoardError, BoardStep, CoreBoard};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidGains {
    /// Pressure per error of contraction \[Pa\].
    pub proportional_pa: f64,
    /// Pressure per error of contraction and time \[Pa/s\].
    pub integral_pa_s: f64,
    /// Pressure per speed of contraction \[Pa s\].
    pub derivative_pa_s: f64,
}

/// A core that gets only set points of pressure.
#[derive(Debug)]
pub struct PidBoard {
    core: CoreBoard,
    gains: PidGains,
    period_steps: u64,
    period_s: f64,
    rest_length_m: f64,
    contraction: f64,
    integral_pa: f64,
    before: f64,
    steps: u64,
    limits_pa: (f64, f64),
}

impl PidBoard {
    pub fn new(gains: PidGains, rest_length_m: f64) -> Self {
        Self {
            core: CoreBoard::default(),
            gains,
            period_steps: 1,
            period_s: 0.0,
            rest_length_m,
            contraction: 0.0,
            integral_pa: 0.0,
            before: 0.0,
            steps: 0,
            limits_pa: (0.0, 0.0),
        }
    }

    fn pressure_pa(&mut self, contraction: f64) -> f64 {
        let PidGains { proportional_pa, integral_pa_s, derivative_pa_s } = self.gains;
        let error = self.contraction - contraction;
        // Derivative of the measurement: a step of the set point gives no kick.
        let speed_s = (contraction - self.before) / self.period_s;
        self.before = contraction;
        let (low, high) = self.limits_pa;
        let fast = low + proportional_pa * error - derivative_pa_s * speed_s;
        let integral_pa = self.integral_pa + integral_pa_s * error * self.period_s;
        // Anti-windup: the integral stays within the range of the pressure.
        self.integral_pa = integral_pa.clamp((low - fast).min(0.0), (high - fast).max(0.0));
        (fast + self.integral_pa).clamp(low, high)
    }
}

impl Board for PidBoard {
    fn name(&self) -> &'static str {
        "core, PID on pressure"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.period_steps = u64::from(config.pwm_period_steps);
        self.period_s = f64::from(config.pwm_period_steps) * f64::from(config.step_s);
        self.limits_pa =
            (f64::from(config.ambient.pressure_pa), f64::from(config.pressure_limit_pa));
        self.core.start(config, SetPoint::Pressure { pressure_pa: config.ambient.pressure_pa })?;
        self.set(set_point)
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        if let SetPoint::Contraction { contraction } = set_point {
            self.contraction = f64::from(contraction);
        }
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let step = self.core.step(sample)?;
        self.steps += 1;
        // A set point acts in the step after the next: set here, it acts when the period starts.
        if (self.steps + 1).is_multiple_of(self.period_steps)
            && let Some(telemetry) = &step.telemetry
        {
            let contraction = 1.0 - f64::from(telemetry.length_m) / self.rest_length_m;
            let pressure_pa = self.pressure_pa(contraction) as f32;
            self.core.set(SetPoint::Pressure { pressure_pa })?;
        }
        Ok(step)
    }
}
