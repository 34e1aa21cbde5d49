//! `summary.json` of a joint: the figures of a run.

use crate::load::JointLoaded;
use crate::rig::Row;
use model_core::Command;
use model_core::Duty;
use serde::Serialize;
use std::collections::VecDeque;
use thermyo_files::units::UnitSystem;
use thermyo_plant::Ledger;
use thermyo_plant::joint::ArmLedger;
use thermyo_record::following::{Followed, Following, Reference};
use thermyo_record::limit_cycle::{Detector, LimitCycle};
use thermyo_record::summary::TimingFigures;

/// Part of the run at its end that counts as rest \[s\].
const REST_S: f64 = 0.5;
/// Stiffness above which an error counts as a share of it \[N m/rad\].
const LEAST_STIFFNESS_N_M_RAD: f64 = 0.1;

/// Motion of a joint: from the plant in a run, from the readings on a board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    pub angle_rad: [f64; 2],
    /// RMS error of the angle against its set point, over the run \[rad\].
    pub rms_error_rad: f64,
    /// Mean error in the last half second \[rad\].
    pub end_error_rad: f64,
    /// RMS error of the stiffness, share of its set point \[-\].
    pub rms_stiffness_error: f64,
    /// Highest pressures of muscles a and b \[Pa\].
    pub highest_pressure_pa: [f64; 2],
    /// Pulses of all four valves \[1/s\].
    pub pulses_per_s: f64,
    /// Share of the time in which the limits of pressure limited the set point \[-\].
    pub limited: f64,
    /// Faults of muscle a, of muscle b, and of the joint, by name.
    pub faults: [Vec<&'static str>; 3],
    /// Time of the first step in which both muscles vented because of a fault \[s\].
    pub vented_s: Option<f64>,
    /// How the angle follows its set point, if it has one; errors in rad.
    pub control: Option<Followed>,
    /// The largest limit cycle around a constant set point, if there was one; its amplitude in rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit_cycle: Option<LimitCycle>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    pub duration_s: f64,
    /// Simulated time per wall-clock time \[-\].
    pub real_time_factor: f64,
    pub board: &'static str,
    #[serde(flatten)]
    pub figures: Figures,
    /// RMS errors of the gas temperatures, as estimated \[K\] ...
    pub estimate_rmse_k: [f64; 2],
    /// ... and as the bare sensors read them \[K\].
    pub sensor_rmse_k: [f64; 2],
    /// Error of the mechanism's balance of energy, relative \[-\].
    pub arm_balance_error: f64,
    /// Errors of the muscles' balances of mass and energy, relative \[-\].
    pub mass_balance_error: [f64; 2],
    pub energy_balance_error: [f64; 2],
    /// Timing of the board's steps, if the board is not this process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingFigures>,
}

/// Gathers a summary, step by step.
#[derive(Debug, Clone)]
pub struct Accumulator {
    step_s: f64,
    rows: f64,
    angle_rad: [f64; 2],
    squared_rad2: f64,
    tracked: f64,
    squared_stiffness: f64,
    /// Number of steps with a stiffness set point above 0.
    stiff: f64,
    highest_pa: [f64; 2],
    estimate_k2: [f64; 2],
    sensor_k2: [f64; 2],
    pulses: f64,
    limited: f64,
    found: [u32; 3],
    vented_s: Option<f64>,
    before: [Command; 2],
    /// Errors of the angle during the last period of rest \[rad\].
    last: VecDeque<f64>,
    at_rest: usize,
    following: Following,
    detector: Detector,
}

impl Figures {
    /// Warning about a loop that does not come to rest.
    pub fn unrest(&self, units: UnitSystem) -> Option<String> {
        let swing = self.limit_cycle?;
        let causes = "docs/how-to/joint.md, \"Where a joint swings\"";
        Some(swing.warning(&angle_text(swing.amplitude, units), causes))
    }
}

impl Accumulator {
    /// Accumulator for a run of this scenario.
    pub fn new(loaded: &JointLoaded) -> Self {
        let (drive, run) = (&loaded.drive, &loaded.muscles[0].plant.run);
        let step_s = run.step_s;
        let shape = loaded.profile.is_none().then_some(drive.shape);
        let reference = Reference::new(
            shape,
            (drive.angle_rad, drive.period_s),
            loaded.controller.dead_zone_rad,
            [step_s, run.duration_s],
        );
        Self {
            step_s,
            rows: 0.0,
            angle_rad: [f64::INFINITY, f64::NEG_INFINITY],
            squared_rad2: 0.0,
            tracked: 0.0,
            squared_stiffness: 0.0,
            stiff: 0.0,
            highest_pa: [0.0; 2],
            estimate_k2: [0.0; 2],
            sensor_k2: [0.0; 2],
            pulses: 0.0,
            limited: 0.0,
            found: [0; 3],
            vented_s: None,
            before: [Command::VENT; 2],
            last: VecDeque::new(),
            at_rest: ((REST_S / step_s) as usize).max(1),
            following: Following::new(reference),
            detector: Detector::new(loaded.controller.dead_zone_rad),
        }
    }

    pub fn add(&mut self, row: &Row) {
        let Row { truth, telemetry, .. } = row;
        let commands = telemetry.commands();
        let vents = commands == [Command::VENT; 2];
        self.rows += 1.0;
        let [least, most] = &mut self.angle_rad;
        *least = least.min(truth.angle_rad);
        *most = most.max(truth.angle_rad);
        if let Some([angle_rad, stiffness]) = row.wanted() {
            self.following.add(row.time_s, [angle_rad, truth.angle_rad], vents);
            let [a, b] = commands;
            let driven = |of_a: Duty, of_b: Duty| of_a > Duty::ZERO || of_b > Duty::ZERO;
            let driven = [driven(a.inlet, b.inlet), driven(a.outlet, b.outlet)];
            self.detector.add(row.time_s, angle_rad, truth.angle_rad, driven);
            let error = truth.angle_rad - angle_rad;
            self.squared_rad2 += error * error;
            if stiffness > LEAST_STIFFNESS_N_M_RAD {
                let off = row.stiffness_n_m_rad / stiffness - 1.0;
                self.squared_stiffness += off * off;
                self.stiff += 1.0;
            }
            self.tracked += 1.0;
            if self.last.len() == self.at_rest {
                self.last.pop_front();
            }
            self.last.push_back(error);
        }
        for (i, muscle) in telemetry.muscles.iter().enumerate() {
            let plant = &truth.muscles[i];
            self.highest_pa[i] = self.highest_pa[i].max(plant.pressure_pa);
            let squared = |value: f64| {
                let error = value - plant.gas_temperature_k;
                error * error
            };
            self.estimate_k2[i] += squared(f64::from(muscle.estimate.gas_k));
            self.sensor_k2[i] += squared(row.sensor_gas_k[i]);
            self.found[i] |= muscle.faults.0;
        }
        self.found[2] |= u32::from(telemetry.faults.0);
        self.limited += f64::from(u8::from(telemetry.limited));
        self.pulses += f64::from(pulses(commands, self.before));
        self.before = commands;
        let faulty =
            telemetry.faults.0 != 0 || telemetry.muscles.iter().any(|muscle| muscle.faults.0 != 0);
        if faulty && vents {
            self.vented_s.get_or_insert(row.time_s);
        }
    }

    /// Time of the steps so far \[s\].
    pub fn duration_s(&self) -> f64 {
        (self.rows - 1.0).max(0.0) * self.step_s
    }

    /// Motion of the joint so far.
    pub fn figures(&self) -> Figures {
        let names = |faults: u32| model_core::Faults(faults).names().collect();
        let joint = model_core::joint::JointFaults(self.found[2] as u8).names().collect();
        Figures {
            angle_rad: self.angle_rad,
            rms_error_rad: root(self.squared_rad2, self.tracked),
            end_error_rad: self.last.iter().sum::<f64>() / (self.last.len() as f64).max(1.0),
            rms_stiffness_error: root(self.squared_stiffness, self.stiff),
            highest_pressure_pa: self.highest_pa,
            pulses_per_s: self.pulses / self.duration_s().max(self.step_s),
            limited: self.limited / self.rows.max(1.0),
            faults: [names(self.found[0]), names(self.found[1]), joint],
            vented_s: self.vented_s,
            control: self.following.figures(),
            limit_cycle: self.detector.clone().finish(),
        }
    }

    /// The summary; `wall_clock_s` is the time that the run took \[s\].
    pub fn finish(self, wall_clock_s: f64, (arm, muscles): (ArmLedger, [Ledger; 2])) -> Summary {
        let duration_s = self.duration_s();
        Summary {
            duration_s,
            real_time_factor: duration_s / wall_clock_s.max(1e-9),
            board: "core",
            estimate_rmse_k: self.estimate_k2.map(|sum| root(sum, self.rows)),
            sensor_rmse_k: self.sensor_k2.map(|sum| root(sum, self.rows)),
            figures: self.figures(),
            arm_balance_error: arm.balance_error(),
            mass_balance_error: muscles.map(|ledger| ledger.mass_balance_error()),
            energy_balance_error: muscles.map(|ledger| ledger.energy_balance_error()),
            timing: None,
        }
    }
}

/// Angles in degrees, or in radians in SI.
pub fn angle_text(value_rad: f64, units: UnitSystem) -> String {
    match units {
        UnitSystem::Si => format!("{value_rad:.5} rad"),
        UnitSystem::Practical => format!("{:.3} deg", value_rad.to_degrees()),
    }
}

/// Root of the mean of squares.
fn root(sum: f64, count: f64) -> f64 {
    (sum / count.max(1.0)).sqrt()
}

/// Number of valves that a step switches on; one that was open to the end of its period stays on.
pub fn pulses(now: [Command; 2], before: [Command; 2]) -> u8 {
    let on = |now: Duty, before: Duty| {
        u8::from(now > Duty::ZERO && now != before && before < Duty::FULL)
    };
    let of = |i: usize| on(now[i].inlet, before[i].inlet) + on(now[i].outlet, before[i].outlet);
    of(0) + of(1)
}
