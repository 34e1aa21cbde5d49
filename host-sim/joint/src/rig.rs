//! Joint, sensors and core in lockstep, step by step.

use crate::load::JointLoaded;
use model_core::joint::{
    Joint as Core, JointError, JointMode, JointSample, JointSetPoint, JointTelemetry, Mechanism,
    Motion,
};
use model_core::{ConfigError, Duty};
use std::f64::consts::TAU;
use std::io;
use thermyo_plant::chamber::{self, Chamber};
use thermyo_plant::joint::{ArmLedger, Joint, JointTruth};
use thermyo_plant::{Actuation, BuildError, Diverged, Ledger};
use thermyo_scenario::Scenario;
use thermyo_scenario::joint::AngleKind;
use thermyo_simulation::adc::VirtualAdc;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::encoder::VirtualEncoder;
use thermyo_simulation::faults::InjectedFaults;

const MOST_CHECK_STEPS: u32 = 100_000;

/// Reason why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The plant cannot be built from the scenario.
    #[error(transparent)]
    Build(BuildError),
    #[error("the core refuses its configuration: {0}")]
    Config(ConfigError),
    #[error("the core refuses the set point: {0}")]
    SetPoint(JointError),
    /// The board cannot be used, or no longer can.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The plant left the range of its equations.
    #[error(transparent)]
    Diverged(Diverged),
    /// A row cannot be written, or the run was stopped.
    #[error(transparent)]
    Output(io::Error),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Set point from the next step on.
    pub set_point: JointSetPoint,
    pub load_n_m: f64,
    pub torn: [bool; 2],
}

impl Inputs {
    /// A motion, without load and with both tendons.
    pub fn of(motion: Motion) -> Self {
        Self { set_point: JointSetPoint::Angle(motion), load_n_m: 0.0, torn: [false; 2] }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    pub time_s: f64,
    /// The plant's state.
    pub truth: JointTruth,
    /// Stiffness behind shut valves, from the plant's pressures \[N m/rad\].
    pub stiffness_n_m_rad: f64,
    pub inputs: Inputs,
    /// The inputs' set point at this step: a motion has continued since it was set.
    pub set_point: JointSetPoint,
    /// The core's output.
    pub telemetry: JointTelemetry,
    /// Readings of the gas sensors, with their noise \[K\].
    pub sensor_gas_k: [f64; 2],
}

/// Plant, sensors and core.
pub struct Rig {
    plant: Joint,
    adc: [VirtualAdc; 2],
    /// The encoder, if one gives the angle.
    encoder: Option<VirtualEncoder>,
    faults: [InjectedFaults; 2],
    core: Core,
    scenarios: [Scenario; 2],
    chambers: [Option<Box<dyn Chamber>>; 2],
    sensor_rad: [f64; 2],
    mechanism: Mechanism,
    step: u64,
    inputs: Inputs,
    /// Step at which the set point began.
    set_step: u64,
}

impl Rig {
    /// A rig at rest, at the angle of the first set point.
    ///
    /// # Errors
    /// [`RunError`] for a scenario that cannot be run.
    pub fn new(loaded: &JointLoaded, inputs: Inputs) -> Result<Self, RunError> {
        let scenarios = scenarios(loaded);
        let start_rad = match inputs.set_point {
            JointSetPoint::Angle(motion) => f64::from(motion.angle_rad),
            _ => 0.0,
        };
        let [of_a, of_b] = &scenarios;
        let plant = Joint::new(loaded.arm(), [of_a, of_b], start_rad).map_err(RunError::Build)?;
        let config = loaded.config();
        let core = Core::new(&config).map_err(RunError::Config)?;
        let joint = &loaded.joint;
        let mut rig = Self {
            plant,
            adc: [VirtualAdc::new(of_a), VirtualAdc::new(of_b)],
            encoder: (joint.sensor_kind == AngleKind::As5600).then(|| VirtualEncoder::new(of_a)),
            faults: [InjectedFaults::new(of_a), InjectedFaults::new(of_b)],
            core,
            chambers: [chamber::of(of_a), chamber::of(of_b)],
            scenarios,
            sensor_rad: [joint.sensor_minimum_rad, joint.sensor_maximum_rad],
            mechanism: config.mechanism,
            step: 0,
            inputs,
            set_step: 0,
        };
        rig.set(inputs.set_point)?;
        Ok(rig)
    }

    /// Takes over the numbers of another scenario: see [`Joint::retune`]. The core keeps its configuration.
    ///
    /// # Errors
    /// [`RunError::Build`]; then nothing has changed.
    pub fn retune(&mut self, loaded: &JointLoaded) -> Result<(), RunError> {
        let scenarios = scenarios(loaded);
        self.plant.retune(loaded.arm(), scenarios.each_ref()).map_err(RunError::Build)?;
        self.scenarios = scenarios;
        Ok(())
    }

    /// The core, to arm it, vent it, or clear its faults.
    pub fn core(&mut self) -> &mut Core {
        &mut self.core
    }

    /// Takes a set point, from the next sample on; the telemetry has faults that vent.
    ///
    /// # Errors
    /// [`RunError::SetPoint`] if it is refused; the former set point then continues.
    pub fn set(&mut self, set_point: JointSetPoint) -> Result<(), RunError> {
        match self.core.set(set_point) {
            // A board that has restarted has neither the mechanism nor its stops.
            Err(error) if self.core.is_configured() && !of_faults(&error) => {
                Err(RunError::SetPoint(error))
            }
            _ => {
                self.inputs.set_point = set_point;
                self.set_step = self.step;
                Ok(())
            }
        }
    }

    /// Takes an external torque, which acts from now on \[N m\].
    pub fn load(&mut self, load_n_m: f64) {
        self.inputs.load_n_m = load_n_m;
    }

    /// Codes of all sensors that a board reads in a step, which ends with [`Self::advance`]. The angle goes through the
    /// length channel of muscle a, over its range, or through an encoder in its place.
    pub fn sample(&mut self) -> JointSample {
        let truth = self.plant.truth();
        let [least, most] = self.sensor_rad;
        let share = (truth.angle_rad - least) / (most - least);
        let mut samples = [0, 1].map(|i: usize| {
            let mut seen = self.faults[i].sensed(&truth.muscles[i]);
            // Drift of the channel, as a share of its range.
            let range_m = self.scenarios[i].sensor.length.range_m;
            let drift_m = seen.sensor_length_m - truth.muscles[i].sensor_length_m;
            let share = share + drift_m / range_m;
            seen.sensor_length_m = share * range_m;
            let mut codes = self.adc[i].convert(&seen);
            if let (0, Some(encoder)) = (i, &mut self.encoder) {
                codes.length = encoder.convert(share * (most - least) / TAU);
            }
            self.faults[i].apply(truth.muscles[i].time_s, codes)
        });
        let [a, b] = &mut samples;
        JointSample {
            pressure: [a.pressure, b.pressure],
            gas: [a.gas, b.gas],
            angle: a.length,
            emergency_stop: a.emergency_stop || b.emergency_stop,
            heard: a.heard && b.heard,
            flooded: a.flooded || b.flooded,
            missed_steps: a.missed_steps.max(b.missed_steps),
        }
    }

    /// Runs one step; `next` acts from the following step on.
    ///
    /// # Errors
    /// [`RunError`] if a set point is refused, or the plant diverges.
    pub fn step(&mut self, next: Inputs) -> Result<Row, RunError> {
        let row = self.observe();
        self.proceed(row.telemetry.commands().map(Actuation::from), next)?;
        Ok(row)
    }

    /// Resets the core as on a board that restarts and is not configured again: it recalls latched faults.
    fn restart(&mut self) {
        let (first, latched) = (self.core.first_failure(), self.core.latched());
        self.core = Core::unconfigured();
        if let Some(first) = first {
            self.core.recall(first, latched);
        }
    }

    /// Runs the core's step for a sample taken now, once between two calls of [`Self::proceed`].
    pub fn observe(&mut self) -> Row {
        if self.board_restarts() {
            self.restart();
        }
        let mut sample = self.sample();
        if let Some(encoder) = &mut self.encoder {
            sample.angle = encoder.take(sample.angle);
        }
        let mut telemetry = self.core.step(&sample);
        let mut checks = 0..MOST_CHECK_STEPS;
        // A board is on for a while before a run: the first sample is repeated until its check is over.
        while self.step == 0 && telemetry.mode == JointMode::StartupCheck && checks.next().is_some()
        {
            telemetry = self.core.step(&sample);
        }
        self.row()(telemetry)
    }

    /// Whether an injected fault restarts the board now.
    pub(crate) fn board_restarts(&self) -> bool {
        let time_s = self.plant.truth().muscles[0].time_s;
        self.faults.iter().any(|faults| faults.board_restarts(time_s))
    }

    /// The row of the latest sample, once the core's output is there.
    pub(crate) fn row(&self) -> impl FnOnce(JointTelemetry) -> Row + use<> {
        let truth = self.plant.truth();
        let step_s = self.scenarios[0].run.step_s;
        let age_s = (self.step - self.set_step) as f64 * step_s;
        let time_s = self.step as f64 * step_s;
        let stiffness_n_m_rad = self.stiffness_n_m_rad(&truth);
        let sensor_gas_k = [self.adc[0].gas_reading_k(), self.adc[1].gas_reading_k()];
        let inputs = self.inputs;
        let set_point = inputs.set_point.after(age_s as f32, &self.mechanism);
        move |telemetry| Row {
            time_s,
            truth,
            stiffness_n_m_rad,
            inputs,
            set_point,
            telemetry,
            sensor_gas_k,
        }
    }

    /// Moves the plant by one step with these openings; `next` acts from then on.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn proceed(&mut self, openings: [Actuation; 2], next: Inputs) -> Result<(), RunError> {
        self.advance(openings)?;
        if next.set_point != self.inputs.set_point {
            self.set(next.set_point)?;
        }
        self.inputs = next;
        Ok(())
    }

    /// Moves the plant by one step with these openings.
    ///
    /// # Errors
    /// [`RunError::Diverged`].
    pub fn advance(&mut self, openings: [Actuation; 2]) -> Result<(), RunError> {
        let truth = self.plant.truth();
        let disturbances =
            [0, 1].map(|i: usize| self.faults[i].disturbance(truth.muscles[i].time_s));
        self.plant.disturb(disturbances);
        self.plant.load(self.inputs.load_n_m);
        self.plant.tear(self.inputs.torn);
        self.plant.advance(openings).map_err(RunError::Diverged)?;
        self.step += 1;
        Ok(())
    }

    /// The plant's state.
    pub fn truth(&self) -> JointTruth {
        self.plant.truth()
    }

    /// K = sum r_i^2 (k P A^2/V + P_g dA/dL + k_b) - r_a' F_a + r_b' F_b, with the gas of a muscle's tube, and forces of
    /// gas and bladder.
    fn stiffness_n_m_rad(&self, truth: &JointTruth) -> f64 {
        let muscles = self.scenarios.iter().zip(&self.chambers).zip(&truth.muscles);
        let springs = muscles.map(|((scenario, chamber), muscle)| {
            let Some(chamber) = chamber else { return [0.0; 2] };
            let tube_m3 = if scenario.moves_in_full() { scenario.tube.volume_m3 } else { 0.0 };
            let (length, pressure) = (muscle.length_m, muscle.pressure_pa);
            let area = chamber.force_area(length);
            let gas = scenario.gas.heat_capacity_ratio * pressure * area * area
                / (muscle.volume_m3 + tube_m3);
            let gauge_pa = pressure - scenario.ambient.pressure_pa;
            let spring =
                gas + gauge_pa * chamber.force_area_slope(length) + chamber.elastic_slope(length);
            [spring, gauge_pa * area + chamber.elastic(length)]
        });
        let pulley = &self.plant.arm().pulley;
        let [of_a, of_b] = pulley.slopes_per_rad(truth.angle_rad);
        let levers = pulley.shares(truth.angle_rad).into_iter().zip([-of_a, of_b]);
        let (mut spring_n_m, mut turn_n) = (0.0, 0.0);
        for ([spring, force], (share, turn)) in springs.zip(levers) {
            spring_n_m += share * share * spring;
            turn_n += turn * force;
        }
        let radius_m = pulley.radius_m;
        radius_m * radius_m * spring_n_m + radius_m * turn_n
    }

    /// Ledgers of the mechanism and of both muscles.
    pub fn ledgers(&self) -> (ArmLedger, [Ledger; 2]) {
        (self.plant.arm_ledger(), self.plant.ledgers())
    }
}

/// Whether a set point is refused because of the state, and not for its value.
fn of_faults(error: &JointError) -> bool {
    matches!(error, JointError::Faults(..) | JointError::NotArmed)
}

/// The plants of muscles a and b.
fn scenarios(loaded: &JointLoaded) -> [Scenario; 2] {
    let [a, b] = &loaded.muscles;
    let mut scenarios = [a.plant.clone(), b.plant.clone()];
    // The other muscle's noise has another seed.
    scenarios[1].run.seed = scenarios[1].run.seed.wrapping_add(1 << 32);
    scenarios
}

impl Row {
    /// Set point of angle \[rad\] and stiffness \[N m/rad\], if the row has them.
    pub fn wanted(&self) -> Option<[f64; 2]> {
        match self.set_point {
            JointSetPoint::Angle(Motion { angle_rad, stiffness_n_m_rad, .. }) => {
                Some([angle_rad, stiffness_n_m_rad].map(f64::from))
            }
            _ => None,
        }
    }

    /// Whether all four valves are shut.
    pub fn shut(&self) -> bool {
        let shut = |duty: Duty| duty == Duty::ZERO;
        self.telemetry.commands().iter().all(|command| shut(command.inlet) && shut(command.outlet))
    }
}
