//! A joint's scenario as `thermyo check` prints it: every key with its value and the allowed values.

use crate::load::JointLoaded;
use serde::Serialize;
use std::fmt::Write;
use thermyo_files::output::{Recorded, name_tables};
use thermyo_scenario::joint::{Joint, JointController, JointDrive, RADII};
use thermyo_scenario::schema::Table;
use thermyo_setup::Loaded;

/// The scenario as it lies in a result.
pub fn recorded(loaded: &JointLoaded) -> Recorded {
    let mut own = loaded.clone();
    let JointLoaded { joint, believed, drive, muscles: [a, b], .. } = &mut own;
    let [of_a, of_b] = [a, b].map(|Loaded { plant, believed, .. }| [plant, believed]);
    let chambers = of_a.into_iter().chain(of_b).map(|one| &mut one.table.csv).collect();
    let mut tables = name_tables([
        ("scenario_radius.csv", vec![&mut joint.radius_csv, &mut believed.radius_csv]),
        ("scenario_profile.csv", vec![&mut drive.profile_csv]),
        ("scenario_load.csv", vec![&mut drive.load_csv]),
        ("scenario_table.csv", chambers),
    ]);
    let [_, b] = &mut own.muscles;
    let other = &mut b.plant.table.csv;
    if other.as_ref().is_some_and(|csv| csv.is_absolute()) {
        tables.extend(name_tables([(
            "scenario_table_b.csv",
            vec![other, &mut b.believed.table.csv],
        )]));
    }
    Recorded { text: render(&own), tables }
}

/// The scenario with all defaults filled in; reading it back gives the same joint. Lines common to both muscles are
/// shared, all others belong to one muscle.
pub fn render(loaded: &JointLoaded) -> String {
    let mut text = String::new();
    let radii =
        |joint: &Joint| -> &[&str] { if joint.radius_csv.is_some() { &RADII } else { &[] } };
    push(&mut text, "joint", &Joint::TABLE, &loaded.joint, radii(&loaded.joint));
    if loaded.believed != loaded.joint {
        // A table belongs to the plant: if it is left out, the core has the cubic through it.
        let believed = Joint { radius_csv: None, ..loaded.believed.clone() };
        push(&mut text, "believed.joint", &Joint::TABLE, &believed, radii(&loaded.believed));
    }
    if let Some(off) = loaded.radii_off() {
        let percent = 100.0 * off.share;
        let _ = writeln!(text, "# The core's radii are {percent:.2} % off the table's at most.");
    }
    push(&mut text, "joint.controller", &JointController::TABLE, &loaded.controller, &[]);
    push(&mut text, "drive", &JointDrive::TABLE, &loaded.drive, &[]);
    let [a, b] = loaded.muscles.each_ref().map(sections);
    let shared: Vec<Section> = a.iter().filter_map(|of_a| both(of_a, &b)).collect();
    push_sections(&mut text, "", &shared);
    for (prefix, sections) in [("joint.a.", &a), ("joint.b.", &b)] {
        let own: Vec<Section> = sections.iter().filter_map(|one| beyond(one, &shared)).collect();
        push_sections(&mut text, prefix, &own);
    }
    text
}

/// A table of a printed scenario.
#[derive(Clone)]
struct Section {
    name: String,
    /// The rest of its header's line.
    meaning: String,
    lines: Vec<String>,
}

impl Section {
    fn of<'a>(all: &'a [Self], name: &str) -> Option<&'a Self> {
        all.iter().find(|section| section.name == name)
    }

    fn is_set(line: &str) -> bool {
        !line.starts_with('#')
    }
}

/// Tables of a muscle that the joint replaces.
fn left_out(table: &str) -> bool {
    ["load", "drive", "identify", "believed.load"].contains(&table)
}

/// Tables of a muscle as printed.
fn sections(loaded: &Loaded) -> Vec<Section> {
    let text = thermyo_setup::render(loaded);
    let mut sections: Vec<Section> = Vec::new();
    for line in text.lines().filter(|line| !line.is_empty()) {
        match line.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((name, meaning)) => sections.push(Section {
                name: name.to_owned(),
                meaning: meaning.to_owned(),
                lines: Vec::new(),
            }),
            None => {
                if let Some(section) = sections.last_mut() {
                    section.lines.push(line.to_owned());
                }
            }
        }
    }
    sections.retain(|section| !left_out(&section.name));
    for section in sections.iter_mut().filter(|section| section.name.ends_with("controller")) {
        section.meaning = "  # a joint uses minimum_pulse_s of it alone".to_owned();
    }
    sections
}

/// The lines that the other muscle has too, if it has the table.
fn both(section: &Section, others: &[Section]) -> Option<Section> {
    let other = Section::of(others, &section.name)?;
    let mut shared = section.clone();
    shared.lines.retain(|line| other.lines.contains(line));
    // Only one of the tables may be unused.
    if other.meaning.len() < shared.meaning.len() {
        shared.meaning.clone_from(&other.meaning);
    }
    (!shared.lines.is_empty()).then_some(shared)
}

/// Lines with a value that are not shared. A comment would not unset anything.
fn beyond(section: &Section, shared: &[Section]) -> Option<Section> {
    let have = Section::of(shared, &section.name).map_or(&[][..], |shared| &shared.lines);
    let mut own = section.clone();
    own.lines.retain(|line| Section::is_set(line) && !have.contains(line));
    // A range common to both is shared; other ranges follow from the lengths of the muscles when the scenario is read
    // again.
    if section.name.ends_with("sensor.length") {
        own.lines.retain(|line| !line.starts_with("range_m = "));
    }
    (!own.lines.is_empty()).then_some(own)
}

fn push_sections(text: &mut String, prefix: &str, sections: &[Section]) {
    for Section { name, meaning, lines } in sections {
        let _ = write!(text, "\n[{prefix}{name}]{meaning}\n");
        lines.iter().for_each(|line| *text += &format!("{line}\n"));
    }
}

/// A table; keys that `follow` from others are comments.
fn push(text: &mut String, name: &str, table: &Table, values: &impl Serialize, follow: &[&str]) {
    let values = toml::Table::try_from(values).unwrap_or_default();
    if !text.is_empty() {
        text.push('\n');
    }
    let _ = writeln!(text, "[{name}]  # {}", table.meaning);
    for key in table.keys {
        let _ = match values.get(key.name) {
            Some(value) if follow.contains(&key.name) => {
                writeln!(text, "# {} = {value}, by radius_csv  # {}", key.name, key.comment())
            }
            Some(value) => writeln!(text, "{} = {value}  # {}", key.name, key.comment()),
            None => writeln!(text, "# {} = \"FILE.csv\"  # {}", key.name, key.comment()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::parse;
    use thermyo_scenario::schema::{Allowed, Key, TABLES};

    const TUBE: &str = "length_m = 0.5\ndiameter_m = 0.004\n";
    const MULTI: &str = "pressure = \"drifting\"\npressure_drift_pa_s = ";

    /// Tables that one muscle may have, each with two texts.
    fn differing() -> Vec<(&'static str, [String; 2])> {
        let of = |text: &str, values: [&str; 2]| values.map(|value| text.replace('?', value));
        vec![
            ("muscle", of("bladder_stiffness_n_m = ?\n", ["700", "900"])),
            ("muscle", of("braid_angle_deg = ?\n", ["22", "25"])),
            ("muscle", of("rest_length_m = ?\n", ["0.41", "0.43"])),
            ("believed.muscle", of("bladder_stiffness_n_m = ?\n", ["2000", "700"])),
            ("believed.muscle", of("braid_angle_deg = ?\n", ["22", "25"])),
            ("heat", of("inlet_diameter_m = ?\n", ["0.003", "0.004"])),
            ("heat", of("model = \"correlation\"\nscale = ?\n", ["0.8", "1.2"])),
            ("believed.heat", of("scale = ?\n", ["0.7", "1.3"])),
            ("plant", of("initial_gas_temperature_k = ?\n", ["300", "310"])),
            ("tube", [TUBE.to_owned(), TUBE.replace("0.5", "0.7")]),
            ("friction", of("force_n = ?\n", ["0", "3.5"])),
            ("supply", of("pressure_pa = ?\n", ["500000", "600000"])),
            ("sensor.gas", of("kind = \"max31865\"\ntime_constant_s = ?\n", ["0.1", "0.2"])),
            ("faults", of(&format!("{MULTI}?\nfrom_s = 3\n"), ["10", "20"])),
            ("faults.second", of("gas = \"?\"\nfrom_s = 4\n", ["open", "frozen"])),
        ]
    }

    fn same_again(text: &str) {
        let read =
            |text: &str| parse(text, "joint.toml".as_ref()).map_err(|e| format!("{e}\n{text}"));
        let loaded = read(text).unwrap_or_else(|error| panic!("{error}"));
        let printed = render(&loaded);
        let again = read(&printed).unwrap_or_else(|error| panic!("{error}"));
        for (muscle, again) in loaded.muscles.iter().zip(&again.muscles) {
            assert_eq!(muscle.plant, again.plant, "{text}\n{printed}");
            assert_eq!(muscle.believed, again.believed, "{text}\n{printed}");
        }
        assert_eq!(again.config(), loaded.config(), "{text}");
        assert_eq!((&again.joint, &again.believed), (&loaded.joint, &loaded.believed));
        assert_eq!((&again.controller, &again.drive), (&loaded.controller, &loaded.drive));
        assert_eq!(render(&again), printed, "{text}");
    }

    #[test]
    fn a_controller_of_one_muscle_is_stated_to_be_unused_but_for_its_pulse() {
        let text = render(&parse("[joint]\n", "j.toml".as_ref()).unwrap());
        assert!(
            text.contains("\n[controller]  # a joint uses minimum_pulse_s of it alone\n"),
            "{text}"
        );
    }

    #[test]
    fn a_key_of_one_muscle_stays_its_own() {
        for (table, [one, other]) in differing() {
            let a = format!("[joint.a.{table}]\n{one}");
            let b = format!("[joint.b.{table}]\n{other}");
            let shared = format!("[{table}]\n{one}");
            for parts in [vec![&a], vec![&b], vec![&a, &b], vec![&shared, &b], vec![&shared]] {
                let parts: String = parts.into_iter().map(String::as_str).collect();
                same_again(&format!(
                    "[joint]\ninertia_kg_m2 = 0.03\nradius_m = 0.01\nmid_length_a_m = 0.29\nmid_length_b_m = 0.29\n{parts}"
                ));
            }
        }
    }

    /// Values of a key that may differ from its default.
    fn values(key: &Key, default: Option<&toml::Value>) -> Vec<String> {
        match (key.allowed, default.and_then(toml::Value::as_float)) {
            (Allowed::Real(limits), Some(number)) => {
                let others = [0.99 * number, 1.02 * number, 0.5 * (number + limits.min)];
                others.map(|other| format!("{other:?}")).to_vec()
            }
            (Allowed::Real(limits), None) => {
                let middle = 0.5 * (limits.min + limits.max);
                [middle, 0.01 * middle].map(|number| format!("{number:?}")).to_vec()
            }
            (Allowed::Whole { min, max }, _) => {
                [min + 1, min + 2, max].map(|number| number.to_string()).to_vec()
            }
            (Allowed::Choice(words), _) => words.iter().map(|word| format!("{word:?}")).collect(),
            (Allowed::Switch, _) => vec!["true".to_owned(), "false".to_owned()],
            (Allowed::List | Allowed::Csv { .. }, _) => Vec::new(),
        }
    }

    /// Every key by which the muscles may differ, for the plant and for the core's configuration.
    #[test]
    fn every_key_of_one_muscle_stays_its_own() {
        let defaults = toml::Table::try_from(thermyo_scenario::Scenario::default()).unwrap();
        let mut kept = 0;
        for table in TABLES {
            let of_table = table
                .name
                .split('.')
                .try_fold(&defaults, |found, part| found.get(part).and_then(toml::Value::as_table));
            for (key, prefix) in table.keys.iter().flat_map(|key| [(key, ""), (key, "believed.")]) {
                let default = of_table.and_then(|found| found.get(key.name));
                for (value, muscle) in
                    values(key, default).iter().zip(["a", "b"].into_iter().cycle())
                {
                    let table = format!("joint.{muscle}.{prefix}{}", table.name);
                    let text = format!("[joint]\n[{table}]\n{} = {value}\n", key.name);
                    if parse(&text, "joint.toml".as_ref()).is_ok() {
                        same_again(&text);
                        kept += 1;
                    }
                }
            }
        }
        assert!(kept > 300, "{kept}");
    }

    /// The angle's sensor is that of muscle a, and muscle b has none that could break.
    #[test]
    fn a_broken_angle_sensor_is_muscle_a_s() {
        let drifting = "length = \"drifting\"\nlength_drift_m_s = 0.1\n";
        for text in [
            format!("[faults]\n{drifting}"),
            format!("[joint.a.faults]\n{drifting}"),
            format!("[faults]\n{drifting}[joint.a.faults]\nlength = \"none\"\n"),
            format!("[faults]\n{drifting}[joint.b.faults]\nlength = \"none\"\n"),
        ] {
            same_again(&format!("[joint]\n{text}"));
        }
    }

    #[test]
    fn a_line_of_both_muscles_is_shared() {
        let text = "[joint]\n[joint.a.tube]\nlength_m = 0.5\ndiameter_m = 0.004\n";
        let printed = render(&parse(text, "joint.toml".as_ref()).unwrap());
        let (_, own) = printed.split_once("\n[joint.a.").unwrap();
        assert!(own.starts_with("tube]") && !own.contains("[joint."), "{own}");
        let set = own.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
        assert_eq!(set.count(), 3, "{own}");
        assert!(!printed.contains("[joint.b."), "{printed}");
    }
}
