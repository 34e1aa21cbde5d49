//! A joint's scenario as `thermyo check` prints it: every key with its value and the allowed values.

use crate::load::JointLoaded;
use serde::Serialize;
use std::fmt::Write;
use thermyo_scenario::joint::{Joint, JointController, JointDrive};
use thermyo_scenario::schema::Table;
use thermyo_setup::Loaded;

/// The scenario with all defaults filled in. Shared tables have the values of muscle a; those that are others for
/// muscle b follow.
pub fn render(loaded: &JointLoaded) -> String {
    let [a, b] = &loaded.muscles;
    let mut text = String::new();
    push(&mut text, "joint", &Joint::TABLE, &loaded.joint);
    if loaded.believed != loaded.joint {
        push(&mut text, "believed.joint", &Joint::TABLE, &loaded.believed);
    }
    push(&mut text, "joint.controller", &JointController::TABLE, &loaded.controller);
    push(&mut text, "drive", &JointDrive::TABLE, &loaded.drive);
    text += &shared(&thermyo_setup::render(a));
    let (of_a, of_b) = (lines(a), lines(b));
    for (table, lines) in &of_b {
        let others: Vec<&String> = lines
            .iter()
            .filter(|line| !of_a.iter().any(|(name, have)| name == table && have.contains(line)))
            .collect();
        if !others.is_empty() && !left_out(table) {
            let _ = write!(text, "\n[joint.b.{table}]\n");
            others.iter().for_each(|line| text += &format!("{line}\n"));
        }
    }
    text
}

/// Tables of a muscle that the joint stands for.
fn left_out(table: &str) -> bool {
    ["load", "drive", "identify", "believed.load"].contains(&table)
}

/// Tables of a printed scenario with their lines.
fn lines(loaded: &Loaded) -> Vec<(String, Vec<String>)> {
    let text = thermyo_setup::render(loaded);
    let mut tables: Vec<(String, Vec<String>)> = Vec::new();
    for line in text.lines().filter(|line| !line.is_empty()) {
        match line.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((name, _)) => tables.push((name.to_owned(), Vec::new())),
            None => {
                if let Some((_, lines)) = tables.last_mut() {
                    lines.push(line.to_owned());
                }
            }
        }
    }
    tables
}

/// A printed scenario without the tables that the joint stands for.
fn shared(text: &str) -> String {
    let mut kept = String::from("\n");
    let mut skipping = false;
    for line in text.lines() {
        if let Some((name, _)) = line.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            skipping = left_out(name);
        }
        if !skipping {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

fn push(text: &mut String, name: &str, table: &Table, values: &impl Serialize) {
    let values = toml::Table::try_from(values).unwrap_or_default();
    if !text.is_empty() {
        text.push('\n');
    }
    let _ = writeln!(text, "[{name}]  # {}", table.meaning);
    for key in table.keys {
        let _ = match values.get(key.name) {
            Some(value) => writeln!(text, "{} = {value}  # {}", key.name, key.comment()),
            None => writeln!(text, "# {} = \"FILE.csv\"  # {}", key.name, key.comment()),
        };
    }
}
