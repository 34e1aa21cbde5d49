//! Boards that run the core. The one in this module runs it in this process.

use model_core::control::{Mode, SetPointField};
use model_core::joint::{JointError, JointField, JointSample, JointSetPoint, JointTelemetry};
use model_core::{Config, ConfigError, Core, Faults, Sample, SetPoint, SetPointError, Telemetry};
use std::io;
use std::path::PathBuf;
use thermyo_plant::Actuation;
use thermyo_protocol::{Chip, PROTOCOL, Refusal, Timing};

/// A board: raw samples in, openings and telemetry out, once per step.
pub trait Board {
    /// Kind of board in summaries: "core", "emulated", "serial".
    fn name(&self) -> &'static str;
    /// Configures the core and sets the first set point. Steps then count from 0.
    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError>;
    /// Changes the set point from the step after the next on: on a real board it arrives while the
    /// next step is computed.
    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError>;
    /// Runs one step. After a start the first sample is repeated until the startup check is over,
    /// since a board is on for a while before a run.
    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError>;
    /// Restarts the board: it loses its configuration and keeps latched faults. It runs its
    /// startup check, and then counts from 0 again.
    ///
    /// # Errors
    /// [`BoardError::NoRestart`] if this board cannot be restarted from here.
    fn restart(&mut self) -> Result<(), BoardError> {
        Err(BoardError::NoRestart)
    }

    /// Timing of the steps, if they do not run in this process.
    fn timing(&mut self) -> Result<Option<Timing>, BoardError> {
        Ok(None)
    }
}

/// A board that drives a joint, in lockstep with its plant.
pub trait JointBoard {
    /// Kind of board in summaries.
    fn name(&self) -> &'static str;
    /// Runs one step; `next` acts from the following step on. The first step begins with configuration, arming and
    /// start, in which its sample is repeated until the startup check is over.
    fn step(
        &mut self,
        sample: &JointSample,
        next: Option<JointSetPoint>,
    ) -> Result<JointStep, BoardError>;
    /// Timing of the steps.
    fn timing(&mut self) -> Result<Timing, BoardError>;
}

#[derive(Debug, Clone, PartialEq)]
pub struct JointStep {
    /// The core's outputs that have arrived, of this step or of earlier ones.
    pub telemetry: Vec<JointTelemetry>,
    /// Duties of both muscles' valves until the next step.
    pub actuations: [Actuation; 2],
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardStep {
    /// The core's output for this sample, or for an earlier one over a serial link in real time:
    /// see `Telemetry::step`.
    pub telemetry: Option<Telemetry>,
    /// Duties of the valves until the next step, as held by the timer that drives them.
    pub actuation: Actuation,
}

/// Reason why a board cannot be used, or no longer can.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// The core refuses its configuration.
    #[error("the core refuses its configuration: {0}")]
    Config(ConfigError),
    #[error("the core refuses the set point: {0}")]
    SetPoint(SetPointError),
    #[error("the board was asked for a step before it was started")]
    NotStarted,
    #[error(
        "Node.js was not found: install Node.js 18 or newer for the emulated board, or set \
         THERMYO_SKIP_EMULATOR=1 to skip its tests"
    )]
    NoNode,
    /// Node.js is older than the emulator needs.
    #[error("Node.js {version} is too old for the emulated board: install 18 or newer")]
    OldNode { version: String },
    /// The program's emulator and images cannot be written to where Node.js finds them.
    #[error(
        "{folder}: cannot be written ({reason}), and the emulated board wants its files there: set \
         XDG_CACHE_HOME to a folder that can be"
    )]
    NotUnpacked { folder: PathBuf, reason: String },
    #[error("`npm ci` failed; it needs npm and its registry: {message}")]
    Npm { message: String },
    #[error("{message}")]
    Build { message: String },
    #[error("{path}: no such image: give the ELF or UF2 file that a build of the firmware left")]
    NoImage { path: PathBuf },
    /// The emulator cannot run the image.
    #[error("{message}")]
    Image { message: String },
    #[error("the emulated board stopped: {message}")]
    Emulator { message: String },
    /// The serial port cannot be opened.
    #[error(
        "{port}: {reason}: connect the board and name its port (Linux /dev/ttyACM0 or \
         /dev/ttyUSB0, macOS /dev/cu.*, Windows COM3; without hardware, `emulated`)"
    )]
    NoPort { port: String, reason: String },
    #[error(
        "{port}: no permission to open it: on Linux `sudo usermod -aG dialout $USER`, then log in \
         again (Arch: the group uucp)"
    )]
    NoPermission { port: String },
    /// Another program uses the port.
    #[error("{port}: another program has it open: close that one, then try again")]
    Taken { port: String },
    /// The link to the board broke.
    #[error("the line to the board broke ({0}): check its cable and start again")]
    Line(#[from] io::Error),
    #[error(
        "the board does not answer ({asked}): check power and wiring (GP0, GP1, 921600 baud), \
         and that this project's firmware is flashed"
    )]
    Silent { asked: &'static str },
    /// The emulated board does not answer: there is no wiring to check.
    #[error("the emulated board does not answer ({asked}): this machine may be too busy for it")]
    EmulatedSilent { asked: &'static str },
    #[error(
        "the board's firmware speaks protocol {board}, this program {PROTOCOL}: flash the \
         firmware of the same version"
    )]
    Protocol { board: u16 },
    #[error(
        "the board ({chip}) samples its own inputs: for simulated ones flash the firmware \
         built with `--features hil`"
    )]
    NotHil { chip: Chip },
    /// The board expects its samples from the host.
    #[error(
        "the board ({chip}) waits for simulated samples: to drive a muscle flash the firmware built \
         without the feature `hil`"
    )]
    Hil { chip: Chip },
    /// The configuration is for another chip's converter.
    #[error(
        "the configuration is one for the RP2040, whose converter has codes that are too wide; the board's \
         ({chip}) has none: [adc] wide_code_lsb = 0"
    )]
    OtherChip { chip: Chip },
    /// The board does not have the configuration that was sent.
    #[error("the board's configuration is not the one that was sent: another program talks to it")]
    Damaged,
    /// The user stopped the run; the board vents.
    #[error("ended by Ctrl-C; the board vents")]
    Interrupted,
    #[error("the board vents: {0}")]
    Vented(Faults),
    /// The board, as configured and armed, cannot hold this pressure.
    #[error("{}", pressure(*.pressure_pa, *.least_pa, *.most_pa))]
    Pressure {
        pressure_pa: f32,
        /// Ambient pressure of its configuration \[Pa\].
        least_pa: f32,
        /// Pressure up to which it is armed \[Pa\].
        most_pa: f32,
    },
    #[error("{}", refused(.0))]
    Refused(Refusal),
    /// The board restarted in the middle of a run.
    #[error("the board restarted in the middle of the run")]
    Restarted,
    #[error(
        "faults.board_restart: nothing here can restart this board; leave it out, or run in process; one muscle also \
         runs on the emulated board"
    )]
    NoRestart,
}

/// Allowed pressures, and the value in Pa if another unit was probably meant.
fn pressure(pressure_pa: f32, least_pa: f32, most_pa: f32) -> String {
    let meant = [("bar", 1e5), ("kPa", 1e3)].into_iter().find_map(|(unit, unit_pa)| {
        let meant_pa = f64::from(pressure_pa) * unit_pa;
        let can_be = (f64::from(least_pa)..=f64::from(most_pa)).contains(&meant_pa);
        can_be.then(|| format!("; use {pressure_pa}{unit}, which is {meant_pa:.0} Pa"))
    });
    // Rounded inwards, so that the printed values are allowed.
    let least_kpa = (f64::from(least_pa) / 10.0).ceil() / 100.0;
    let most_kpa = (f64::from(most_pa) / 10.0).floor() / 100.0;
    format!(
        "a pressure of {} kPa: must be from {least_kpa} kPa (ambient, as the board is configured) to \
         {most_kpa} kPa{}",
        pressure_pa / 1e3,
        meant.unwrap_or_default()
    )
}

/// Name of a value, its practical unit, and the factor from SI to that unit.
type Named = (&'static str, &'static str, f64);

const DEG_PER_RAD: f64 = 180.0 / std::f64::consts::PI;
const ARMED: Named = ("a highest pressure", "kPa", 1e-3);

fn of_muscle(field: SetPointField) -> Named {
    match field {
        SetPointField::Inlet => ("a duty of the inlet", "%", 100.0),
        SetPointField::Outlet => ("a duty of the outlet", "%", 100.0),
        SetPointField::Contraction => ("a contraction", "%", 100.0),
        SetPointField::Flow => ("a mass flow", "g/s", 1e3),
        SetPointField::Period => ("a period", "s", 1.0),
        SetPointField::Pressure => ("a pressure", "kPa", 1e-3),
        SetPointField::Armed => ARMED,
        other => (other.key(), "", 1.0),
    }
}

fn of_joint(field: JointField) -> Named {
    match field {
        JointField::Inlet => of_muscle(SetPointField::Inlet),
        JointField::Outlet => of_muscle(SetPointField::Outlet),
        JointField::Pressure => of_muscle(SetPointField::Pressure),
        JointField::Torque => ("a torque", "N m", 1.0),
        JointField::Stiffness => ("a stiffness", "N m/rad", 1.0),
        JointField::Angle => ("an angle", "deg", DEG_PER_RAD),
        JointField::Speed => ("a speed", "deg/s", DEG_PER_RAD),
        JointField::Acceleration => ("an acceleration", "deg/s2", DEG_PER_RAD),
        JointField::Armed => ARMED,
        other => (other.key(), "(SI)", 1.0),
    }
}

/// A value outside of its range, in a practical unit.
fn outside((name, unit, factor): Named, value: f32, range: [f32; 2]) -> String {
    let [least, most] = range.map(|end| f64::from(end) * factor * 1e3);
    // Rounded inwards, so that the printed values are allowed.
    let (lowest, highest) = (least.ceil() / 1e3, most.floor() / 1e3);
    let value = in_f32_digits(f64::from(value) * factor);
    format!("{name} of {value} {unit}: must be from {lowest} to {highest} {unit}")
}

/// The number in seven digits: more are the rounding errors of the core's f32.
pub fn in_f32_digits(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// Appended to the allowed range where a highest pressure is below it.
pub const LEAST_IS_NOW: &str = "; the lower end is the pressure now, at least ambient";

/// A highest pressure for which the board does not arm: with a higher pressure in the muscle it would vent at once.
fn not_armed_for(value: f32, [least_pa, most_pa]: [f32; 2]) -> String {
    let range_pa = [least_pa, most_pa];
    if least_pa > most_pa {
        let [least_kpa, most_kpa] = range_pa.map(|pa| (pa / 10.0).round() / 100.0);
        return format!(
            "the pressure now is {least_kpa} kPa, and the board arms for {most_kpa} kPa at most: it has to vent first"
        );
    }
    let range = outside(ARMED, value, range_pa);
    if value < least_pa { format!("{range}{LEAST_IS_NOW}") } else { range }
}

fn refused(refusal: &Refusal) -> String {
    match refusal {
        Refusal::SetPoint(SetPointError::Range {
            field: SetPointField::Armed,
            value,
            minimum,
            maximum,
        })
        | Refusal::JointSetPoint(JointError::Range {
            field: JointField::Armed,
            value,
            minimum,
            maximum,
        }) => not_armed_for(*value, [*minimum, *maximum]),
        Refusal::NotConfigured
        | Refusal::SetPoint(SetPointError::Faults(Faults::NOT_CONFIGURED)) => {
            "the board does not know its muscle yet".to_owned()
        }
        Refusal::SetPoint(SetPointError::NotArmed) => "the board is not armed".to_owned(),
        Refusal::SetPoint(SetPointError::Range { field, value, minimum, maximum })
            if minimum < maximum =>
        {
            outside(of_muscle(*field), *value, [*minimum, *maximum])
        }
        Refusal::JointSetPoint(JointError::Range { field, value, minimum, maximum }) => {
            outside(of_joint(*field), *value, [*minimum, *maximum])
        }
        refusal => format!("the board refused: {refusal}"),
    }
}

/// The core in this process: its commands reach the valves at once.
#[derive(Debug, Default)]
pub struct CoreBoard {
    core: Option<Core>,
    pending: Option<SetPoint>,
    /// Whether the startup check is still to run before the first step.
    to_judge: bool,
}

impl CoreBoard {
    /// The core, once started.
    pub fn core(&mut self) -> Result<&mut Core, BoardError> {
        self.core.as_mut().ok_or(BoardError::NotStarted)
    }
}

impl Board for CoreBoard {
    fn name(&self) -> &'static str {
        "core"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        let mut core = Core::new(config).map_err(BoardError::Config)?;
        core.set(set_point).map_err(BoardError::SetPoint)?;
        self.core = Some(core);
        self.to_judge = true;
        Ok(())
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.pending = Some(set_point);
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let pending = self.pending.take();
        let to_judge = std::mem::take(&mut self.to_judge);
        let core = self.core()?;
        let mut telemetry = core.step(sample);
        while to_judge && telemetry.mode == Mode::StartupCheck {
            telemetry = core.step(sample);
        }
        if let Some(set_point) = pending {
            match core.set(set_point) {
                // Venting faults vent; the telemetry has the reason.
                Ok(()) | Err(SetPointError::Faults(_)) => (),
                Err(error) => return Err(BoardError::SetPoint(error)),
            }
        }
        Ok(BoardStep { telemetry: Some(telemetry), actuation: telemetry.command.into() })
    }

    fn restart(&mut self) -> Result<(), BoardError> {
        let core = self.core()?;
        let supervisor = *core.supervisor();
        *core = Core::unconfigured().map_err(BoardError::Config)?;
        if let Some(first) = supervisor.first_failure() {
            core.recall(first, supervisor.latched());
        }
        self.pending = None;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pressure_in_another_unit_is_said_in_pascals() {
        let said = |pressure_pa| pressure(pressure_pa, 101_325.0, 689_500.0);
        assert_eq!(
            said(1.3),
            "a pressure of 0.0013 kPa: must be from 101.33 kPa (ambient, as the board is configured) to 689.5 kPa; \
             use 1.3bar, which is 130000 Pa"
        );
        assert!(said(150.0).ends_with("; use 150kPa, which is 150000 Pa"));
        assert!(said(-3000.0).ends_with("to 689.5 kPa") && said(9e5).ends_with("to 689.5 kPa"));
    }

    fn of_muscle(field: SetPointField, value: f32, minimum: f32, maximum: f32) -> String {
        let range = SetPointError::Range { field, value, minimum, maximum };
        BoardError::Refused(Refusal::SetPoint(range)).to_string()
    }

    fn of_joint(field: JointField, value: f32, minimum: f32, maximum: f32) -> String {
        let range = JointError::Range { field, value, minimum, maximum };
        BoardError::Refused(Refusal::JointSetPoint(range)).to_string()
    }

    /// The lower end used to be printed without a reason; below the present pressure the message was "refused:
    /// armed_pa".
    #[test]
    fn a_highest_pressure_below_the_one_now_is_refused_with_that_reason() {
        let now = "a highest pressure of 130 kPa: must be from 158.25 to 689.5 kPa; the lower end is the pressure now, at \
                   least ambient";
        assert_eq!(of_muscle(SetPointField::Armed, 1.3e5, 158_250.0, 689_500.0), now);
        assert_eq!(of_joint(JointField::Armed, 1.3e5, 158_250.0, 689_500.0), now);
        assert!(of_joint(JointField::Armed, 9.0e5, 158_250.0, 689_500.0).ends_with("to 689.5 kPa"));
        // This was printed as 200.00002 kPa.
        assert!(
            of_joint(JointField::Armed, 2.0e5, 305_424.0, 660_090.0)
                .starts_with("a highest pressure of 200 kPa: ")
        );
        assert_eq!(
            of_muscle(SetPointField::Armed, 6.895e5, 705_120.0, 689_500.0),
            "the pressure now is 705.12 kPa, and the board arms for 689.5 kPa at most: it has to vent first"
        );
    }

    /// The largest contraction used to be printed as 0.37278953.
    #[test]
    fn a_value_that_is_refused_is_in_a_practical_unit() {
        assert_eq!(
            of_muscle(SetPointField::Contraction, 0.9, 0.0, 0.372_789_53),
            "a contraction of 90 %: must be from 0 to 37.278 %"
        );
        assert!(
            of_muscle(SetPointField::Contraction, 5.0, 0.0, 0.372_789_53).ends_with(" 37.278 %")
        );
        assert!(
            of_muscle(SetPointField::Inlet, -0.1, 0.0, 1.0).ends_with("must be from 0 to 100 %")
        );
        assert_eq!(
            of_muscle(SetPointField::Flow, 0.9, -0.001_234_9, 0.001_234_9),
            "a mass flow of 900 g/s: must be from -1.234 to 1.234 g/s"
        );
        assert_eq!(
            of_joint(JointField::Pressure, 2e6, 0.0, 689_500.0),
            "a pressure of 2000 kPa: must be from 0 to 689.5 kPa"
        );
        assert_eq!(
            of_joint(JointField::Angle, 3.0, -0.8, 0.8),
            "an angle of 171.8873 deg: must be from -45.836 to 45.836 deg"
        );
        assert_eq!(
            of_joint(JointField::Stiffness, -1.0, 0.0, 1e6),
            "a stiffness of -1 N m/rad: must be from 0 to 1000000 N m/rad"
        );
        let still = of_muscle(SetPointField::Contraction, 0.1, 0.0, 0.0);
        assert!(still.contains("this chamber does not move"), "{still}");
    }
}
