//! Replay of a joint's record, with the core in this process.

use super::{Drawn, Mismatch, Part, Replay, are_digital, most_code, part_of};
use model_core::Faults;
use model_core::joint::{
    Joint, JointConfig, JointMode, JointSample, JointSetPoint, JointTelemetry,
};
use model_core::safety::supervisor::VENTING;
use model_core::{AdcCode, RawCode};
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_joint::trace::{COLUMNS, LAST_KIND, is_output, set_point};
use thermyo_joint::{JointLoaded, Row as TraceRow};
use thermyo_protocol::joint_checksum;
use thermyo_simulation::board::BoardError;

const MOST_CHECK_STEPS: u32 = 100_000;

/// Columns and lines of its page.
pub(super) const DRAWN: Drawn = Drawn {
    columns: &[
        "time_s",
        "a_estimate_k",
        "a_estimate_difference_k",
        "b_estimate_k",
        "b_estimate_difference_k",
        "a_duty_in",
        "a_duty_out",
        "b_duty_in",
        "b_duty_out",
        "differs",
    ],
    estimates: &[
        ("muscle a", "a_estimate_k", "a_estimate_difference_k"),
        ("muscle b", "b_estimate_k", "b_estimate_difference_k"),
    ],
    duties: &[
        ("inlet a", "a_duty_in"),
        ("outlet a", "a_duty_out"),
        ("inlet b", "b_duty_in"),
        ("outlet b", "b_duty_out"),
    ],
};

#[derive(Debug, Clone, Copy, PartialEq)]
struct Inputs {
    sample: JointSample,
    /// Set point that holds after the step.
    set_point: JointSetPoint,
    /// Highest pressure for which the board was armed, if the record contains it \[Pa\].
    armed_pa: Option<f32>,
    /// Venting faults of the muscles and faults of the joint: latched until they are cleared.
    latched: [u32; 3],
}

/// A joint's record to replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    config: JointConfig,
    part: Part,
    inputs: Vec<Inputs>,
    /// Recorded outputs: their index in [`COLUMNS`], and their values.
    outputs: Vec<(usize, Vec<f64>)>,
}

/// Reads a record of the scenario.
///
/// # Errors
/// If the trace lacks a step or a column.
pub fn read_record(loaded: &JointLoaded, table: &Table) -> Result<Record, InputError> {
    let config = loaded.config();
    let part = part_of(table, joint_checksum(&config))?;
    let rows = part.before..part.before + part.rows;
    let mut outputs = Vec::new();
    for (i, name) in COLUMNS.iter().enumerate().filter(|(_, name)| is_output(name)) {
        let cells = &table.column(name)?[rows.clone()];
        outputs.push((i, cells.iter().map(|cell| cell.unwrap_or(f64::NAN)).collect()));
    }
    let read = Columns::new(table, &config)?;
    let inputs = rows.map(|row| read.inputs(row)).collect();
    Ok(Record { config, part, inputs, outputs })
}

struct Columns {
    /// Codes of pressure and gas of each muscle, and whether they come from digital sensors.
    codes: [[Vec<u32>; 2]; 2],
    digital: [[bool; 2]; 2],
    angle: Vec<u32>,
    /// Flags: emergency stop, heard, flooded.
    flags: [Vec<u32>; 3],
    missed_steps: Vec<u32>,
    kind: Vec<u32>,
    values: [Vec<f64>; 4],
    armed_pa: Option<Vec<Option<f64>>>,
    /// Faults of muscle a, of muscle b, and of the joint.
    faults: [Vec<u32>; 3],
}

impl Columns {
    fn new(table: &Table, config: &JointConfig) -> Result<Self, InputError> {
        let column = |name: &str| table.filled(name);
        let flag = |name: &str| table.whole(name, 1);
        let faults = |name: &str| table.whole(name, u32::MAX);
        let digital = config.muscles.each_ref().map(|muscle| are_digital(&muscle.sensors));
        let code = |name: &str, digital: bool| table.whole(name, most_code(digital));
        let [a, b] = digital;
        // A magnetic encoder's angle is on the converter's scale.
        let angle = code("code_angle", false)?;
        let has_armed = table.columns().iter().any(|column| column.name == "armed_pa");
        Ok(Self {
            codes: [
                [code("a_code_pressure", a[0])?, code("a_code_gas", a[1])?],
                [code("b_code_pressure", b[0])?, code("b_code_gas", b[1])?],
            ],
            digital,
            angle,
            flags: [flag("emergency_stop")?, flag("heard")?, flag("flooded")?],
            missed_steps: table.whole("missed_steps", u8::MAX.into())?,
            kind: table.whole("set_point_kind", LAST_KIND.into())?,
            values: [
                column("set_point_1")?,
                column("set_point_2")?,
                column("set_point_3")?,
                column("set_point_4")?,
            ],
            armed_pa: if has_armed { Some(table.column("armed_pa")?.to_vec()) } else { None },
            faults: [faults("a_faults")?, faults("b_faults")?, faults("faults")?],
        })
    }

    fn inputs(&self, row: usize) -> Inputs {
        let code = |muscle: usize, sensor: usize| {
            let bits = self.codes[muscle][sensor][row] as u16;
            RawCode::from_bits(bits, self.digital[muscle][sensor])
        };
        let [emergency_stop, heard, flooded] = self.flags.each_ref().map(|flags| flags[row] != 0);
        let [of_a, of_b, joint] = self.faults.each_ref().map(|faults| faults[row]);
        Inputs {
            sample: JointSample {
                pressure: [code(0, 0), code(1, 0)],
                gas: [code(0, 1), code(1, 1)],
                angle: AdcCode(self.angle[row] as u16),
                emergency_stop,
                heard,
                flooded,
                missed_steps: self.missed_steps[row] as u8,
            },
            set_point: set_point(
                self.kind[row] as u8,
                self.values.each_ref().map(|values| values[row] as f32),
            ),
            armed_pa: self.armed_pa.as_ref().and_then(|all| all[row]).map(|pa| pa as f32),
            latched: [Faults(of_a).of(VENTING).0, Faults(of_b).of(VENTING).0, joint],
        }
    }
}

impl Record {
    pub(super) fn part(&self) -> Part {
        self.part
    }

    /// Runs the record's samples through the core.
    pub(super) fn replay(
        &self,
        each: &mut dyn FnMut(&[f64]) -> bool,
    ) -> Result<Replay, BoardError> {
        let mut core = Joint::new(&self.config).map_err(BoardError::Config)?;
        let mut outcome = Replay::default();
        let mut before = None;
        for (i, inputs) in self.inputs.iter().enumerate() {
            let telemetry = step(&mut core, before, inputs);
            before = Some(inputs);
            let replayed = TraceRow::of_board(0.0, &self.config, &telemetry).cells();
            let differing =
                self.outputs.iter().find(|(place, cells)| !same(cells[i], replayed[*place]));
            outcome.steps += 1;
            if let Some((place, cells)) = differing {
                outcome.mismatches += 1;
                outcome.first.get_or_insert_with(|| Mismatch {
                    step: telemetry.step(),
                    recorded: format!("{} = {}", COLUMNS[*place], cells[i]),
                    replayed: replayed[*place].to_string(),
                });
            }
            if !each(&self.cells(i, &replayed, differing.is_some())) {
                break;
            }
        }
        Ok(outcome)
    }

    fn cells(&self, row: usize, replayed: &[f64], differs: bool) -> Vec<f64> {
        let [a, _] = &self.config.muscles;
        let at = |name: &str| {
            let found = self.outputs.iter().find(|(place, _)| COLUMNS[*place] == name);
            found.map_or([f64::NAN; 2], |(place, cells)| [cells[row], replayed[*place]])
        };
        let mut cells = vec![row as f64 * f64::from(a.step_s)];
        for (_, name, _) in DRAWN.estimates {
            let [recorded, replayed] = at(name);
            cells.extend([recorded, replayed - recorded]);
        }
        cells.extend(DRAWN.duties.iter().map(|(_, name)| at(name)[0]));
        cells.push(f64::from(u8::from(differs)));
        cells
    }
}

/// Whether both are bitwise equal: unknown equals itself, and the two zeros differ.
fn same(recorded: f64, replayed: f64) -> bool {
    recorded.to_bits() == replayed.to_bits() || recorded.is_nan() && replayed.is_nan()
}

/// Runs one recorded step; the first is repeated until the startup check is over, since a board is on before a run.
fn step(core: &mut Joint, before: Option<&Inputs>, inputs: &Inputs) -> JointTelemetry {
    let Some(before) = before else {
        // A refusal shows as a difference.
        let _ = core.set(inputs.set_point);
        let mut telemetry = core.step(&inputs.sample);
        let mut checks = 0..MOST_CHECK_STEPS;
        while telemetry.mode == JointMode::StartupCheck && checks.next().is_some() {
            telemetry = core.step(&inputs.sample);
        }
        return telemetry;
    };
    let cleared = before.latched.iter().zip(inputs.latched).any(|(was, is)| was & !is != 0);
    if cleared {
        core.clear_faults();
    }
    if inputs.set_point == before.set_point {
        return core.step(&inputs.sample);
    }
    // The core also vents and locks by itself within a step, which differs from a request before the step.
    if matches!(inputs.set_point, JointSetPoint::Vent | JointSetPoint::Lock) {
        let mut alone = core.clone();
        let telemetry = alone.step(&inputs.sample);
        if telemetry.set_point == inputs.set_point {
            *core = alone;
            return telemetry;
        }
    }
    let starts = before.set_point == JointSetPoint::Vent;
    if let Some(armed_pa) = inputs.armed_pa.filter(|pa| starts && *pa > 0.0) {
        let _ = core.arm(Some(armed_pa));
    }
    let _ = core.set(inputs.set_point);
    core.step(&inputs.sample)
}
