//! `thermyo board PORT set`: sends a set point, shows the muscle, and vents in the end.

use super::muscle::{line, vents};
use super::{Console, Failure, core_quantity, interrupt, print, quantity};
use clap::{Args, Subcommand};
use crossterm::terminal;
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, SetPoint};
use serde_json::json;
use std::io::{self, IsTerminal};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::units::UnitSystem;
use thermyo_plant::chamber;
use thermyo_protocol::Refusal;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;

#[derive(Debug, Args)]
pub(super) struct SetArgs {
    #[command(subcommand)]
    pub(super) set_point: SetPointArgs,
    /// Vent after this time, such as 5 (s) or 2min [default: at Ctrl-C]
    #[arg(long, value_name = "TIME", global = true, allow_hyphen_values = true, value_parser = seconds)]
    pub(super) hold: Option<f64>,
    /// Arm the board first
    #[arg(long, global = true)]
    pub(super) arm: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value = quantity("s")(text)?;
    let allowed = (0.0..=1.0e6).contains(&value);
    allowed.then_some(value).ok_or_else(|| "must be a time from 0 to 1000000 s".to_owned())
}

/// An angle as it was typed.
#[derive(Debug, Clone, Copy)]
pub(super) struct TypedAngle {
    pub(super) angle_rad: f32,
    /// A number without a unit may have been meant in degrees.
    pub(super) has_unit: bool,
}

fn typed_angle(text: &str) -> Result<TypedAngle, String> {
    let angle_rad = core_quantity("rad")(text)?;
    Ok(TypedAngle { angle_rad, has_unit: text.trim().parse::<f64>().is_err() })
}

#[derive(Debug, Clone, Copy, Subcommand)]
pub(super) enum SetPointArgs {
    /// Absolute pressure
    Pressure {
        /// Pressure, such as 1.3bar, 130kPa or 130000 (Pa)
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("Pa"))]
        pressure_pa: f32,
    },
    /// Contraction
    Contraction {
        /// Fraction of the rest length, such as 5% or 0.05
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        contraction: f32,
    },
    /// Mass flow, or a working cycle that alternates inflow and outflow
    Flow {
        /// Mass flow, such as 0.36g/s or 3.6e-4 (kg/s), negative out of the muscle
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("kg/s"))]
        flow_kg_s: f32,
        /// Period of the cycle, such as 5 (s)
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("s"))]
        period_s: Option<f32>,
    },
    /// Fixed duties of the valves
    Duty {
        /// Inlet, 0 to 1 or 0% to 100%
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        inlet: f32,
        /// Outlet, 0 to 1 or 0% to 100%
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        outlet: f32,
    },
    /// Angle of a joint
    Angle {
        /// Angle, such as 20deg or 0.35 (rad)
        #[arg(allow_hyphen_values = true, value_parser = typed_angle)]
        angle: TypedAngle,
        /// Stiffness behind shut valves (N m/rad)
        #[arg(long, value_name = "STIFFNESS", allow_hyphen_values = true, value_parser = core_quantity("N m/rad"))]
        stiffness: f32,
    },
    /// Torque of a joint
    Torque {
        /// Torque (N m)
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("N m"))]
        torque_n_m: f32,
        /// Stiffness behind shut valves (N m/rad)
        #[arg(long, value_name = "STIFFNESS", allow_hyphen_values = true, value_parser = core_quantity("N m/rad"))]
        stiffness: f32,
    },
    /// Absolute pressures of a joint's muscles
    Pressures {
        /// Pressure of muscle a, such as 2bar, 200kPa or 200000 (Pa)
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("Pa"))]
        pressure_a_pa: f32,
        /// Pressure of muscle b
        #[arg(allow_hyphen_values = true, value_parser = core_quantity("Pa"))]
        pressure_b_pa: f32,
    },
    /// Fixed duties of a joint's valves
    Duties {
        /// Inlet of muscle a, 0 to 1 or 0% to 100%
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        inlet_a: f32,
        /// Outlet of muscle a
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        outlet_a: f32,
        /// Inlet of muscle b
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        inlet_b: f32,
        /// Outlet of muscle b
        #[arg(allow_hyphen_values = true, value_parser = core_quantity(""))]
        outlet_b: f32,
    },
    /// All valves of a joint shut, for joint.lock_s at most; then it vents
    Lock,
    /// Inlet shut, outlet open
    Vent,
}

impl TryFrom<SetPointArgs> for SetPoint {
    type Error = Failure;

    fn try_from(args: SetPointArgs) -> Result<Self, Failure> {
        Ok(match args {
            SetPointArgs::Angle { .. }
            | SetPointArgs::Torque { .. }
            | SetPointArgs::Pressures { .. }
            | SetPointArgs::Duties { .. }
            | SetPointArgs::Lock => {
                return Err(BoardError::Refused(Refusal::OtherImage { joint: false }).into());
            }
            SetPointArgs::Pressure { pressure_pa } => Self::Pressure { pressure_pa },
            SetPointArgs::Contraction { contraction } => Self::Contraction { contraction },
            SetPointArgs::Flow { flow_kg_s, period_s: None } => Self::MassFlow { flow_kg_s },
            SetPointArgs::Flow { flow_kg_s, period_s: Some(period_s) } => {
                Self::MassFlowCycle { flow_kg_s, period_s }
            }
            SetPointArgs::Duty { inlet, outlet } => Self::Duty { inlet, outlet },
            SetPointArgs::Vent => Self::Vent,
        })
    }
}

/// Interval of the printed lines, and of the refreshed line of a terminal \[s\].
const LINE_S: [f64; 2] = [0.5, 0.1];
/// Pressure and contraction are averaged over this time before the end \[s\].
const HELD_S: f64 = 1.0;

/// The muscle at a time since the set point.
#[derive(Debug, Clone, Copy)]
struct Held {
    time_s: f64,
    pressure_pa: f64,
    /// NaN if the rest length is unknown.
    contraction: f64,
    limited: bool,
}

pub(super) fn run(
    board: &mut LiveBoard,
    args: &SetArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let set_point = SetPoint::try_from(args.set_point)?;
    let config = board.config()?;
    interrupt::watch();
    if args.arm {
        // A refused set point leaves a board that is not armed as it was.
        board.check_set_point(set_point)?;
        board.arm(None)?;
    }
    let first = board.set(set_point)?;
    if set_point == SetPoint::Vent {
        return to.done(&vents(), "it vents\n");
    }
    if args.hold.is_none() {
        to.format.done(to.err, &json!({}), "Ctrl-C ends it, and vents\n")?;
    }
    let (stopped, mut held) = hold(board, args, (first, &config), to)?;
    board.stop()?;
    let Some(&Held { time_s: end_s, .. }) = held.last() else { return Err(Failure::Interrupted) };
    held.retain(|held| held.time_s >= end_s - HELD_S);
    result(set_point, &held, to)?;
    if !stopped {
        return Ok(());
    }
    Err(stopped_at(end_s, args.hold))
}

/// Ctrl-C was pressed at this time, before the time to hold was over \[s\].
pub(super) fn stopped_at(time_s: f64, hold_s: Option<f64>) -> Failure {
    let of = hold_s.map_or_else(String::new, |hold_s| format!(" of {hold_s} s"));
    Failure::StoppedAt(format!("{time_s:.2} s{of}"))
}

/// A difference with its sign.
fn signed(difference: f64, si: &'static str, units: UnitSystem) -> String {
    let sign = if difference < 0.0 { '-' } else { '+' };
    format!("{sign}{}", units.text(difference.abs(), si, 2))
}

/// The time over which the pressure is averaged.
fn averaged(held: &[Held]) -> String {
    match held {
        [.., Held { time_s, .. }] if *time_s < HELD_S => format!("{time_s:.2} s"),
        _ => "the last second".to_owned(),
    }
}

/// Prints the means of the last second, or of the whole time if that is shorter, and their differences from the set
/// point.
fn result(set_point: SetPoint, held: &[Held], to: &mut Console<'_>) -> Result<(), Failure> {
    let count = held.len().max(1) as f64;
    let mean_pa = held.iter().map(|held| held.pressure_pa).sum::<f64>() / count;
    let contraction = held.iter().map(|held| held.contraction).sum::<f64>() / count;
    let contraction = Some(contraction).filter(|contraction| contraction.is_finite());
    let limited = held.iter().any(|held| held.limited);
    let (mut error_pa, mut contraction_error) = (None, None);
    let units = to.units;
    let mut text = units.text(mean_pa, "Pa", 2);
    let of_last = format!("in the mean of {}", averaged(held));
    match (set_point, contraction) {
        (SetPoint::Pressure { pressure_pa }, _) => {
            let off_pa = mean_pa - f64::from(pressure_pa);
            error_pa = Some(off_pa);
            text += &format!(" {of_last}, {} from the set point", signed(off_pa, "Pa", units));
        }
        (SetPoint::Contraction { contraction: wanted }, Some(mean)) => {
            let off = mean - f64::from(wanted);
            contraction_error = Some(off);
            let contracted = units.text(mean, "", 2);
            text = format!(
                "{contracted} contracted {of_last}, {} from the set point, at {text}",
                signed(off, "", units)
            );
        }
        _ => text += &format!(" {of_last}"),
    }
    if limited {
        text += "; limited by the highest pressure that it is armed for";
    }
    let json = json!({
        "mean_pressure_pa": mean_pa,
        "error_pa": error_pa,
        "mean_contraction": contraction,
        "contraction_error": contraction_error,
        "limited": limited,
        "held_s": held.last().map(|held| held.time_s),
        "mode": "vent",
    });
    to.answer(&json, &format!("{text}; it vents\n"))
}

/// Prints the muscle from the step `first` on, until the time is over or the user stops it. Returns whether the user
/// stopped it, and the muscle over time.
fn hold(
    board: &mut LiveBoard,
    args: &SetArgs,
    (first, config): (u32, &Config),
    to: &mut Console<'_>,
) -> Result<(bool, Vec<Held>), Failure> {
    let step_s = f64::from(config.step_s);
    let scenario = from_config::to_scenario(config).ok();
    let chamber = scenario.and_then(|scenario| chamber::of(&scenario.scenario.believed));
    let rest_m = chamber.map_or(f64::NAN, |chamber| chamber.rest_length());
    let columns = terminal::size().ok().filter(|_| io::stdout().is_terminal());
    // A terminal that states no width gets whole lines.
    let columns =
        columns.map(|(columns, _)| usize::from(columns).checked_sub(1).unwrap_or(usize::MAX));
    let (mut next_line_s, mut held) = (0.0, Vec::new());
    let stopped = loop {
        if interrupt::is_requested() {
            break true;
        }
        let Some(telemetry) = board.poll()? else { continue };
        // Skips telemetry from before the set point, which may show a lost link that arming has cleared.
        let Some(steps) = telemetry.step.checked_sub(first) else { continue };
        let faults = telemetry.faults.of(VENTING);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults).into());
        }
        let time_s = f64::from(steps) * step_s;
        held.push(Held {
            time_s,
            pressure_pa: f64::from(telemetry.pressure_pa),
            contraction: 1.0 - f64::from(telemetry.length_m) / rest_m,
            limited: telemetry.limited,
        });
        if time_s >= next_line_s && to.is_read() {
            next_line_s += LINE_S[usize::from(columns.is_some())];
            let text = format!("{time_s:7.2} s  {}", line(&telemetry, to.units));
            match columns {
                // Rewrites the same line: a longer line would not return to its start.
                Some(columns) => {
                    let cut: String = text.chars().take(columns).collect();
                    print(&mut io::stdout(), &format!("\r{cut}\x1b[K"))?;
                }
                None => to.print(&format!("{text}\n"))?,
            }
        }
        if args.hold.is_some_and(|hold_s| time_s >= hold_s) {
            break false;
        }
    };
    if columns.is_some() && !held.is_empty() && to.is_read() {
        print(&mut io::stdout(), "\n")?;
    }
    Ok((stopped, held))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mean over 0.2 s used to be printed as "the mean of the last second".
    #[test]
    fn a_mean_names_the_time_that_it_is_taken_over() {
        let held =
            |time_s: f64| Held { time_s, pressure_pa: 2e5, contraction: 0.1, limited: false };
        assert_eq!(averaged(&[held(0.0), held(0.2)]), "0.20 s");
        assert_eq!(averaged(&[held(0.1), held(1.0)]), "the last second");
        assert_eq!(averaged(&[held(9.0)]), "the last second");
    }
}
