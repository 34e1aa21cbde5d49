//! `thermyo init`: a scenario of the user's own rig, from a few answers.

use super::{Console, Failure, FormatArgs, quantity};
use clap::Args;
use std::fmt::Write as _;
use std::io::{self, BufRead, IsTerminal, Write};
use std::path::PathBuf;
use thermyo_files::input::{is_new, write_new};
use thermyo_scenario::preset::{MusclePreset, Preset, PressurePreset, ValvePreset};
use thermyo_scenario::{Scenario, schema};
use thermyo_setup::{contraction_held, highest_pa};

/// Contraction of the drive where the rig reaches it \[-\].
const USUAL_CONTRACTION: f64 = 0.1;
const MM_PER_M: f64 = 1000.0;

#[derive(Debug, Args)]
pub(super) struct InitArgs {
    /// The scenario to write; a file that exists is left as it is
    #[arg(long, value_name = "FILE.toml", default_value = "muscle.toml")]
    out: PathBuf,
    /// Muscle: dmsp-10, dmsp-20, or none, which asks for its dimensions
    #[arg(long, value_name = "WORD")]
    muscle: Option<String>,
    /// Length of the muscle at rest, without pressure [m]
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = quantity("m"))]
    rest_length: Option<f64>,
    /// Diameter at rest [m]
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = quantity("m"))]
    diameter: Option<f64>,
    /// Angle of the threads to the axis at rest [deg]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = quantity("deg"))]
    braid_angle: Option<f64>,
    /// Valves: mhe2-class, mhe3-class, mhe4-class, mhj10-class, or none
    #[arg(long, value_name = "WORD")]
    valve: Option<String>,
    /// Pressure sensor: hsc-100psi-a, hsc-150psi-a, mpr-25psi-a, or none
    #[arg(long, value_name = "WORD")]
    pressure_sensor: Option<String>,
    /// Weight that hangs on the muscle [kg]
    #[arg(long, value_name = "KG", allow_hyphen_values = true, value_parser = quantity("kg"))]
    load: Option<f64>,
    /// Absolute pressure of the supply [Pa]
    #[arg(long, value_name = "PA", allow_hyphen_values = true, value_parser = quantity("Pa"))]
    supply: Option<f64>,
    #[command(flatten)]
    format: FormatArgs,
}

/// One question: its flag, its words, and the key that it answers.
struct Question {
    flag: &'static str,
    words: &'static str,
    key: &'static str,
}

const MUSCLE: Question = Question { flag: "--muscle", words: "Muscle", key: "muscle.preset" };
const VALVE: Question = Question { flag: "--valve", words: "Valves", key: "valve.preset" };
const SENSOR: Question =
    Question { flag: "--pressure-sensor", words: "Pressure sensor", key: "sensor.pressure.preset" };
const REST: Question = Question {
    flag: "--rest-length",
    words: "Length of the muscle at rest, in m",
    key: "muscle.rest_length_m",
};
const DIAMETER: Question =
    Question { flag: "--diameter", words: "Its diameter at rest, in m", key: "muscle.diameter_m" };
const ANGLE: Question = Question {
    flag: "--braid-angle",
    words: "Angle of its threads to the axis, in degrees",
    key: "muscle.braid_angle_deg",
};
const LOAD: Question =
    Question { flag: "--load", words: "Weight that hangs on it, in kg", key: "load.mass_kg" };
const SUPPLY: Question = Question {
    flag: "--supply",
    words: "Absolute pressure of the supply, in Pa",
    key: "supply.pressure_pa",
};

/// Sources of answers: flags, and a terminal if there is one.
struct Answers<'a> {
    typed: Option<&'a mut dyn BufRead>,
    stderr: &'a mut dyn Write,
}

impl Answers<'_> {
    /// Asks a question until the answer is allowed; `checked` states what is allowed.
    fn to<T>(
        &mut self,
        question: &Question,
        given: Option<T>,
        hint: &str,
        checked: impl Fn(&str) -> Result<T, String>,
    ) -> Result<T, Failure> {
        let Question { flag, words, .. } = question;
        if let Some(given) = given {
            return Ok(given);
        }
        let Some(typed) = &mut self.typed else {
            let message = format!("{flag} is missing: {hint}; there is no terminal to ask at");
            return Err(Failure::Usage(message));
        };
        loop {
            let _ = write!(self.stderr, "{words} ({hint}): ");
            let _ = self.stderr.flush();
            let mut line = String::new();
            let read = typed.read_line(&mut line);
            if !matches!(read, Ok(count) if count > 0) {
                // Puts the message that follows on a line of its own.
                let _ = writeln!(self.stderr);
                return Err(Failure::Usage(format!("no answer for {flag}; nothing is written")));
            }
            match checked(line.trim()) {
                Ok(answer) => return Ok(answer),
                Err(allowed) => {
                    let _ = writeln!(self.stderr, "{allowed}");
                }
            }
        }
    }

    fn word(
        &mut self,
        question: &Question,
        given: Option<&String>,
        words: &[&str],
    ) -> Result<String, Failure> {
        let hint = words.join(", ");
        let check = |word: &str| {
            let known = words.contains(&word);
            known.then(|| word.to_owned()).ok_or_else(|| format!("must be one of {hint}"))
        };
        let given = given.map(|word| check(word)).transpose();
        let given = given.map_err(|allowed| refused(question, &allowed))?;
        self.to(question, given, &hint, check)
    }

    fn number(&mut self, question: &Question, given: Option<f64>) -> Result<f64, Failure> {
        let check = |number: f64| allowed(question.key, number);
        let given = given.map(check).transpose().map_err(|allowed| refused(question, &allowed))?;
        let hint = schema::limits(question.key).to_string();
        self.to(question, given, &hint, |text| typed(question.key, text))
    }

    /// The muscle's dimensions by key; none that its preset has. Where they make no muscle, the typed ones are asked
    /// for again: a value in mm may be in range in m.
    fn dimensions(
        &mut self,
        args: &InitArgs,
        muscle: &str,
    ) -> Result<Vec<(&'static str, f64)>, Failure> {
        let asked =
            [(REST, args.rest_length), (DIAMETER, args.diameter), (ANGLE, args.braid_angle)];
        let of_preset = Preset::of("muscle", muscle).is_some();
        let is_typed = !of_preset && asked.iter().any(|(_, given)| given.is_none());
        loop {
            let mut dimensions = Vec::new();
            for (question, given) in asked.iter().filter(|(_, given)| given.is_some() || !of_preset)
            {
                dimensions.push((question.key, self.number(question, *given)?));
            }
            let parsed = |dimensions: &[(&str, f64)]| {
                thermyo_setup::parse(&muscle_table(muscle, dimensions), &args.out)
            };
            let Err(error) = parsed(&dimensions) else { return Ok(dimensions) };
            let mut message = error.problem.to_string();
            if let Some(place) = dimensions.iter().position(|(key, _)| *key == DIAMETER.key) {
                let diameter_mm = dimensions[place].1;
                dimensions[place].1 /= MM_PER_M;
                let hint =
                    parsed(&dimensions).map_or_else(|_| String::new(), |_| in_mm(diameter_mm));
                message += &hint;
            }
            if !is_typed {
                return Err(Failure::Usage(message));
            }
            let _ = writeln!(self.stderr, "{message}");
        }
    }
}

fn allowed(key: &str, number: f64) -> Result<f64, String> {
    let limits = schema::limits(key);
    if !limits.contains(number) {
        let is_mm = limits.unit == "m" && limits.contains(number / MM_PER_M);
        let hint = if is_mm { in_mm(number) } else { String::new() };
        return Err(format!("must be {limits}{hint}"));
    }
    let ambient_pa = Scenario::default().ambient.pressure_pa;
    if key == SUPPLY.key && number <= ambient_pa {
        let unit = match number {
            1.0..100.0 => Some("bar"),
            200.0..3000.0 => Some("kPa"),
            _ => None,
        };
        let hint =
            unit.map_or_else(String::new, |unit| format!("; {number} {unit} is {number}{unit}"));
        return Err(format!("must be absolute, and above the {ambient_pa} Pa of the air{hint}"));
    }
    Ok(number)
}

/// Hint how to write a length that was meant in mm.
fn in_mm(length_mm: f64) -> String {
    // To the micrometre: 13.9/1000 is 0.013900000000000001.
    let length_m = (length_mm * 1.0e3).round() / 1.0e6;
    format!("; for {length_mm} mm use {length_m} or {length_mm}mm")
}

/// A typed number, which may have a unit as in a flag.
fn typed(key: &str, text: &str) -> Result<f64, String> {
    quantity(schema::limits(key).unit)(text).and_then(|number| allowed(key, number))
}

fn refused(question: &Question, allowed: &str) -> Failure {
    Failure::Usage(format!("{} {allowed}", question.flag))
}

pub(super) fn run(args: &InitArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    is_new(&args.out)?;
    let to = to.as_asked(args.format);
    let mut terminal = io::stdin().is_terminal().then(|| io::stdin().lock());
    let typed = terminal.as_mut().map(|typed| typed as &mut dyn BufRead);
    let mut answers = Answers { typed, stderr: to.err };
    let muscle = answers.word(&MUSCLE, args.muscle.as_ref(), MusclePreset::WORDS)?;
    let dimensions = answers.dimensions(args, &muscle)?;
    let valve = answers.word(&VALVE, args.valve.as_ref(), ValvePreset::WORDS)?;
    let sensor = answers.word(&SENSOR, args.pressure_sensor.as_ref(), PressurePreset::WORDS)?;
    let load_kg = answers.number(&LOAD, args.load)?;
    let supply_pa = answers.number(&SUPPLY, args.supply)?;
    let presets = [("muscle", muscle), ("valve", valve), ("sensor.pressure", sensor)];
    let rig = rig(&presets, &dimensions, load_kg, supply_pa);
    // Answers may contradict each other.
    let loaded = thermyo_setup::parse(&rig, &args.out)?;
    let (drive, note) = drive(&loaded.plant);
    let text = rig + &drive;
    let (_, warnings) = thermyo_setup::parse_with_warnings(&text, &args.out)?;
    write_new(&args.out, &text)?;
    to.warn(&warnings);
    let unknown = unknown(&presets);
    let name = args.out.display();
    let mut words = format!("{name} is written{note}. Still unknown, and how to find it:\n");
    for (keys, how) in &unknown {
        let _ = writeln!(words, "  {}: {how}", keys.join(", "));
    }
    let _ = writeln!(words, "next: thermyo run {name}");
    let unknown: Vec<_> =
        unknown.iter().map(|(keys, how)| serde_json::json!({ "keys": keys, "how": how })).collect();
    let json = serde_json::json!({ "scenario": args.out, "unknown": unknown });
    to.done(&json, &words)
}

/// The rig's text, each part with its source.
fn rig(
    presets: &[(&str, String)],
    dimensions: &[(&str, f64)],
    load_kg: f64,
    supply_pa: f64,
) -> String {
    let mut text =
        "# Written by thermyo init; thermyo check prints every key with its default.\n".to_owned();
    for (table, word) in presets {
        text += &match *table {
            "muscle" => muscle_table(word, dimensions),
            _ => preset_table(table, word),
        };
    }
    text + &format!(
        "\n[supply]\npressure_pa = {supply_pa:?}\n\n[load]\nkind = \"mass\"\nmass_kg = {load_kg:?}\n"
    )
}

fn preset_table(table: &str, word: &str) -> String {
    let mut text = format!("\n[{table}]\n");
    if let Some(preset) = Preset::of(table, word) {
        let _ = writeln!(text, "# {}", preset.source);
        let _ = writeln!(text, "preset = {word:?}");
    }
    text
}

fn muscle_table(word: &str, dimensions: &[(&str, f64)]) -> String {
    let mut text = preset_table("muscle", word);
    for (key, value) in dimensions {
        let _ = writeln!(text, "{} = {value:?}", key.trim_start_matches("muscle."));
    }
    text
}

/// The drive's text, with a set point that the rig reaches, and a note if it is not the usual one.
fn drive(plant: &Scenario) -> (String, &'static str) {
    if let Some(contraction) = contraction_held(plant, USUAL_CONTRACTION) {
        let text = format!("\n[drive]\nkind = \"contraction\"\ncontraction = {contraction:?}\n");
        return (text, "");
    }
    let middle_pa = 0.5 * (plant.ambient.pressure_pa + highest_pa(plant));
    let text = format!("\n[drive]\nkind = \"pressure\"\npressure_pa = {middle_pa:.0}.0\n");
    (text, ", and drives a pressure: supply and sensor do not reach the one that lifts this load")
}

/// Keys that no answer has settled, and the experiment that finds them.
fn unknown(presets: &[(&str, String)]) -> Vec<(Vec<&'static str>, &'static str)> {
    let of = |table: &str| {
        presets
            .iter()
            .find(|(name, _)| *name == table)
            .and_then(|(_, word)| Preset::of(table, word))
    };
    let mut all = Vec::new();
    if of("muscle").is_none() {
        all.push((
            vec!["muscle.bladder_saturation_n", "muscle.bladder_strain", "muscle.slack_m"],
            "five static readings, which thermyo identify --plan lists for scenarios/static_map.toml with your dimensions",
        ));
    }
    if of("muscle")
        .is_none_or(|preset| preset.unknown.iter().any(|key| key == "muscle.slip_force_n"))
    {
        all.push((
            vec!["muscle.slip_force_n", "muscle.creep_fast_n_m", "muscle.creep_slow_n_m"],
            "four minutes of motion on the board: thermyo tune --plan motion",
        ));
    }
    all.push((
        vec!["friction.force_n", "valve.conductance_m3_s_pa", "valve.switch_time_s"],
        "a minute of motion on the board: thermyo tune",
    ));
    all.push((
        vec!["heat.scale", "sensor.gas.time_constant_s"],
        "stops, with the valves shut: thermyo measure stop, then thermyo identify",
    ));
    all.push((
        vec!["sensor.pressure.offset_pa", "sensor.length.offset_m", "sensor.gas.offset_k"],
        "two points each, with the gain: thermyo board PORT calibrate",
    ));
    all.push((vec!["muscle.dead_volume_m3", "sensor.length.range_m"], "fittings and data sheet"));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diameter in mm used to be refused only after the last question, and all answers were lost.
    #[test]
    fn dimensions_that_make_no_muscle_are_asked_for_again() {
        let args = InitArgs {
            out: PathBuf::from("muscle.toml"),
            muscle: None,
            rest_length: None,
            diameter: None,
            braid_angle: Some(25.0),
            valve: None,
            pressure_sensor: None,
            load: None,
            supply: None,
            format: FormatArgs::default(),
        };
        let dimensions = |mut typed: &[u8], args: &InitArgs| {
            let mut stderr = Vec::new();
            let mut answers = Answers { typed: Some(&mut typed), stderr: &mut stderr };
            let found = answers.dimensions(args, "none");
            (found, String::from_utf8(stderr).unwrap())
        };
        let (found, seen) = dimensions(b"0.25\n13.9\n250 mm\n13.9 mm\n", &args);
        let expected = [(REST.key, 0.25), (DIAMETER.key, 0.0139), (ANGLE.key, 25.0)];
        assert_eq!(found.unwrap(), expected);
        assert!(seen.contains("): muscle.diameter_m = 13.9: must be a number from "), "{seen}");
        let (found, seen) = dimensions(b"0.25\n", &args);
        let Err(Failure::Usage(why)) = found else { panic!("{seen}") };
        assert_eq!(why, "no answer for --diameter; nothing is written");
        assert!(seen.ends_with("): \n"), "{seen:?}");
        let flags = InitArgs { rest_length: Some(0.25), diameter: Some(13.9), ..args };
        let Err(Failure::Usage(why)) = dimensions(b"", &flags).0 else { panic!() };
        assert!(why.starts_with("muscle.diameter_m = 13.9: must be a number from "), "{why}");
        assert!(why.ends_with("; for 13.9 mm use 0.0139 or 13.9mm"), "{why}");
    }

    #[test]
    fn an_answer_may_have_a_unit_as_a_flag_may() {
        for (question, text, number) in [
            (REST, "300mm", Ok(0.3)),
            (SUPPLY, "7 bar", Ok(7.0e5)),
            (LOAD, "5", Ok(5.0)),
            (ANGLE, "25 deg", Ok(25.0)),
            (LOAD, "-1kg", Err("must be a number from 0 to 1e5 kg".to_owned())),
        ] {
            assert_eq!(typed(question.key, text), number);
        }
        let wrong = typed(REST.key, "3bar").unwrap_err();
        assert!(wrong.contains("or one with its unit: m, "), "{wrong}");
    }
}
