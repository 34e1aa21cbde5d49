//! Scenario of a joint: shared tables, the tables that differ for one muscle, the mechanism and its drive.
//!
//! ```text
//! [muscle] ...            both muscles
//! [joint.a.muscle] ...    muscle a alone; [joint.b. ...] likewise
//! [joint], [believed.joint], [joint.a], [joint.b], [drive]    the joint's own keys
//! ```
//!
//! The text is split by its table headers into documents whose other lines are empty, so that each keeps its line
//! numbers. A key or table of the joint is written under a header, not with dots.

use super::declare::{choice, table};
use super::document::{
    Document, Entry, Given, allowed_instead, checked, toml_of, unknown_table, value_of,
};
use super::key::{Allowed, Key, Table};
use super::{Shape, schema};
use model_core::joint::{self, AnglePart};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;
use thermyo_files::input::{InputError, Instead, Lines, Problem, nearest, quoted};
use toml::Value;

choice! {
    /// Type of the angle's sensor.
    AngleKind {
        /// Potentiometer on the converter.
        Potentiometer = "potentiometer",
        /// ams AS5600 on I2C.
        As5600 = "as5600",
    }
}

impl AngleKind {
    pub fn part(self) -> AnglePart {
        match self {
            Self::Potentiometer => AnglePart::Potentiometer,
            Self::As5600 => AnglePart::As5600,
        }
    }
}

table! {
    "joint", "two muscles on a pulley; muscle a shortens as the angle grows", believed, physical;
    Joint as joint::Mechanism {
        core radius_m;
        radius_csv: csv ["angle_rad", "radius_a_m", "radius_b_m"], "radii over the angle by its rising values, in place of radius_m and the seven keys below it; the core has a cubic through them";
        core radius_a_per_rad;
        core radius_a_per_rad2;
        core radius_a_per_rad3;
        core radius_b_share;
        core radius_b_per_rad;
        core radius_b_per_rad2;
        core radius_b_per_rad3;
        core mid_length_a_m;
        core mid_length_b_m;
        core inertia_kg_m2;
        core gravity_n_m;
        core gravity_angle_rad;
        core viscous_n_m_s;
        core friction_n_m;
        core minimum_rad;
        core maximum_rad;
        sensor_kind: choice AngleKind::Potentiometer, "type of the angle's sensor";
        core sensor_minimum_rad;
        core sensor_maximum_rad;
        core torque_limit_n_m;
        core lock_s;
    }
}

table! {
    "joint.controller", "tuning of the joint's controller", believed;
    JointController as joint::JointTuning {
        core reference_rad_s;
        core reference_speed_rad_s;
        core reference_torque_n_m;
        core stiffness_rate_n_m_rad_s;
        core gain_n_m_rad;
        core damping_per_s;
        core integral_n_m_rad_s;
        core integral_limit_n_m;
        core observer_rad_s;
        core disturbance_rad_s;
        core observer_share;
        core lead_s;
        core mass_loop_s;
        core quiet_n_m;
        core waits_n_m;
        core dead_zone_rad;
        core dead_zone_stiffness;
    }
}

choice! {
    JointDriveKind {
        Joint = "joint",
    }
}

table! {
    "drive", "set point over the run";
    JointDrive {
        kind: choice JointDriveKind::Joint, "angle and stiffness of a joint";
        angle_rad: real 0.0, "rad", -6.3 to 6.3, "angle, or middle of the shape";
        stiffness_n_m_rad: real 14.0, "N m/rad", 0.0 to 1.0e6, "stiffness behind shut valves";
        shape: choice Shape::Constant, "angle over time";
        amplitude_rad: real 0.0, "rad", -6.3 to 6.3, "amplitude of the shape";
        period_s: real 1.0, "s", 0.01 to 86_400.0, "period of the shape";
        profile_csv: csv ["time_s", "angle_rad", "stiffness_n_m_rad"], "angle and stiffness over time";
        load_n_m: real 0.0, "N m", -1.0e6 to 1.0e6, "external torque, positive towards growing angles";
        load_csv: csv ["time_s", "torque_n_m"], "external torque over time, added to load_n_m";
    }
}

/// Keys of the radii, in place of which there may be `radius_csv`.
pub const RADII: [&str; 8] = [
    "radius_m",
    "radius_a_per_rad",
    "radius_a_per_rad2",
    "radius_a_per_rad3",
    "radius_b_share",
    "radius_b_per_rad",
    "radius_b_per_rad2",
    "radius_b_per_rad3",
];

/// A scenario of a joint, split and read.
#[derive(Debug, Clone, PartialEq)]
pub struct JointDocument {
    pub joint: Joint,
    /// The mechanism that the core is configured with.
    pub believed: Joint,
    pub controller: JointController,
    /// The set point over time.
    pub drive: JointDrive,
    pub muscles: [Document; 2],
    /// Entries of muscles a and b alone, which are above the shared ones.
    own: [Document; 2],
    /// Keys of the joint in the file, with their lines.
    given: Vec<(String, u64)>,
}

const OWN: [(&str, Table); 4] = [
    ("joint", Joint::TABLE),
    ("believed.joint", Joint::TABLE),
    ("joint.controller", JointController::TABLE),
    ("drive", JointDrive::TABLE),
];

/// Owner of the lines below a header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Shared,
    Own,
    Muscle(usize),
}

/// The name in a line that is a table's header, without the spaces and quotes that TOML allows in it, and the text behind
/// it.
fn header(line: &str) -> Option<(String, &str)> {
    let inside = line.trim_start().strip_prefix('[')?;
    if inside.starts_with('[') {
        return None;
    }
    let (name, rest) = inside.split_once(']')?;
    let parts: Vec<&str> =
        name.split('.').map(|part| part.trim().trim_matches(['"', '\''])).collect();
    Some((parts.join("."), rest))
}

/// Whether a scenario is one of a joint: it has a table `[joint]` or one below it.
pub fn is_joint(text: &str) -> bool {
    text.lines().filter_map(header).any(|(name, _)| is_of_joint(&name))
}

fn is_of_joint(table: &str) -> bool {
    let plain = table.strip_prefix("believed.").unwrap_or(table);
    plain == "joint" || plain.starts_with("joint.")
}

/// The part that a table belongs to, and its name there.
fn part_of(name: &str) -> (Part, &str) {
    if OWN.iter().any(|(own, _)| *own == name) {
        return (Part::Own, name);
    }
    for (i, prefix) in ["joint.a.", "joint.b."].into_iter().enumerate() {
        if let Some(table) = name.strip_prefix(prefix) {
            return (Part::Muscle(i), table);
        }
    }
    (Part::Shared, name)
}

/// Splits the text into parts: shared, own, muscle a, muscle b.
fn split(text: &str) -> [String; 4] {
    let mut texts = [const { String::new() }; 4];
    let mut part = Part::Shared;
    for line in text.lines() {
        let mut kept = line.to_owned();
        if let Some((name, rest)) = header(line) {
            let (found, table) = part_of(&name);
            part = found;
            kept = format!("[{table}]{rest}");
        }
        let place = match part {
            Part::Shared => 0,
            Part::Own => 1,
            Part::Muscle(i) => 2 + i,
        };
        for (i, text) in texts.iter_mut().enumerate() {
            if i == place {
                text.push_str(&kept);
            }
            text.push('\n');
        }
    }
    texts
}

impl JointDocument {
    /// Parses the scenario of a joint; `origin` is its name in messages.
    ///
    /// # Errors
    /// For the first key that is unknown, or not allowed; shared tables first.
    pub fn parse(text: &str, origin: &Path) -> Result<Self, InputError> {
        refuse_headers(text, origin)?;
        let [shared, own, a, b] = split(text);
        let shared = Document::parse(&shared, origin)?;
        refuse_senseless(&shared, Owner::Both)?;
        let own_entries = [Document::parse(&a, origin)?, Document::parse(&b, origin)?];
        for (own, owner) in own_entries.iter().zip([Owner::A, Owner::B]) {
            refuse_senseless(own, owner)?;
        }
        let muscles = own_entries.each_ref().map(|own| shared.overlaid(own));
        let own = own_tables(&own, origin)?;
        refuse_radii(&own, origin)?;
        let (tables, given) = own;
        let table = |name: &str| tables.get(name).cloned().unwrap_or_default();
        let mut believed = table("joint");
        if table("believed.joint").contains_key("radius_m") {
            believed.remove("radius_csv");
        }
        believed.extend(table("believed.joint"));
        Ok(Self {
            joint: filled(table("joint"), origin)?,
            believed: filled(believed, origin)?,
            controller: filled(table("joint.controller"), origin)?,
            drive: filled(table("drive"), origin)?,
            muscles,
            own: own_entries,
            given,
        })
    }

    /// Sets the key of a whole path, such as "joint.inertia_kg_m2", "joint.b.muscle.zones" or "muscle.zones", as if it
    /// were in the file.
    ///
    /// # Errors
    /// When there is no such key, or the value is not allowed.
    pub fn set(&mut self, full_path: &str, value: Setting<'_>) -> Result<(), Problem> {
        for (muscle, owner) in self.muscles.iter_mut().zip([Owner::A, Owner::B]) {
            if let Some(path) = full_path.strip_prefix(owner.prefix()) {
                senseless(owner, path, &value.text()).map_or(Ok(()), Err)?;
                return value.put(muscle, path);
            }
        }
        if let Some((table, name, key)) = own_key(full_path) {
            return self.set_own((table, name), key, full_path, value);
        }
        if OWN
            .iter()
            .any(|(table, _)| full_path.rsplit_once('.').is_some_and(|(of, _)| of == *table))
        {
            let (table, name) = full_path.rsplit_once('.').unwrap_or_default();
            let keys = OWN.iter().find(|(own, _)| *own == table).map_or(&[][..], |(_, t)| t.keys);
            return Err(unknown(full_path, table, name, keys));
        }
        senseless(Owner::Both, full_path, &value.text()).map_or(Ok(()), Err)?;
        for (muscle, own) in self.muscles.iter_mut().zip(&self.own) {
            let mut set = muscle.clone();
            value.put(&mut set, full_path)?;
            // An entry of one muscle stays above the shared one.
            *muscle = set.overlaid(own);
        }
        Ok(())
    }

    fn set_own(
        &mut self,
        (table, name): (&str, &str),
        key: &Key,
        full_path: &str,
        value: Setting<'_>,
    ) -> Result<(), Problem> {
        let taken = value.of(key).ok_or_else(|| Problem::NotAllowed {
            key: full_path.to_owned(),
            value: value.text(),
            allowed: allowed_instead(key.allowed, Some(&value.text())),
        })?;
        let by_table = [("joint", &self.joint), ("believed.joint", &self.believed)]
            .into_iter()
            .any(|(of, joint)| of == table && joint.radius_csv.is_some());
        if by_table && RADII.contains(&name) {
            match table {
                // One radius in place of the plant's table.
                "believed.joint" if name == "radius_m" => self.believed.radius_csv = None,
                _ => return Err(beside_table(full_path, value.text())),
            }
        }
        let believed = format!("believed.joint.{name}");
        let follows = !self.has(&believed);
        match table {
            "drive" => put(&mut self.drive, name, taken),
            "joint.controller" => {
                put(&mut self.controller, name, taken);
                self.given.push((full_path.to_owned(), 0));
            }
            "believed.joint" => put(&mut self.believed, name, taken),
            _ => {
                if follows {
                    put(&mut self.believed, name, taken.clone());
                }
                put(&mut self.joint, name, taken);
            }
        }
        // A believed value that is set does not follow the plant.
        if table == "believed.joint" && follows {
            self.given.push((believed, 0));
        }
        Ok(())
    }

    /// A key whose value is a file, with its line, if there is one.
    pub fn file(&self) -> Option<(String, Option<u64>)> {
        let is_file = |key: &Key| matches!(key.allowed, Allowed::Csv { .. });
        let own = self.given.iter().find(|(path, _)| key(path).is_some_and(is_file));
        let muscles = self.muscles.iter().flat_map(|muscle| muscle.plant.iter());
        let shared = muscles.into_iter().find(|entry| is_file(entry.key));
        own.map(|(path, line)| (path.clone(), Some(*line)))
            .or_else(|| shared.map(|entry| (entry.path(), entry.line)))
    }

    /// Whether the file has, or a call has set, a key of the joint's own, by its whole path.
    pub fn has(&self, full_path: &str) -> bool {
        self.given.iter().any(|(given, _)| given == full_path)
    }

    /// Line, path and value of a key in the file, of the joint or of a muscle, by its whole path.
    pub fn given(&self, full_path: &str) -> Option<Given> {
        let path = full_path.to_owned();
        if let Some((_, line)) = self.given.iter().find(|(given, _)| given == full_path) {
            let (joint, plain) = match full_path.strip_prefix("believed.") {
                Some(plain) => (&self.believed, plain),
                None => (&self.joint, full_path),
            };
            let values = toml::Table::try_from(joint).ok()?;
            let value = values.get(plain.strip_prefix("joint.").unwrap_or_default());
            let value = value
                .and_then(Value::as_float)
                .map_or_else(String::new, |value| format!("{value:?}"));
            return Some((Some(*line), path, value));
        }
        let entry = self.muscles.iter().find_map(|muscle| entry(muscle, full_path))?;
        Some((entry.line, path, entry.written.clone()))
    }

    /// Index of the muscle for which alone the file has a key, by its whole path, and the key's line; the last one
    /// first.
    pub fn own(&self, full_path: &str) -> Option<(usize, Option<u64>)> {
        let own = self.own.iter().enumerate().rev();
        own.into_iter().find_map(|(i, own)| Some((i, entry(own, full_path)?.line)))
    }

    /// The error for a key of the joint, at its line if the file has it.
    pub fn blame(&self, key: &str, problem: Problem) -> InputError {
        let line = self.given.iter().find(|(given, _)| given == key).map(|(_, line)| *line);
        located(&self.muscles[0].origin, line, problem)
    }
}

fn entry<'a>(document: &'a Document, full_path: &str) -> Option<&'a Entry> {
    match full_path.strip_prefix("believed.") {
        Some(path) => document.believed.get(path),
        None => document.plant.get(full_path),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    Both,
    A,
    B,
}

impl Owner {
    fn prefix(self) -> &'static str {
        match self {
            Self::Both => "",
            Self::A => "joint.a.",
            Self::B => "joint.b.",
        }
    }
}

/// Tables of one muscle that a joint does not have.
const OF_ONE_MUSCLE: [(&str, &str); 2] = [
    ("load", "the joint is the load of both muscles; leave it out"),
    ("identify", "`thermyo identify` finds all values of a joint; leave it out"),
];
/// Tables that a joint has once.
const ONCE: [(&str, &str); 4] = [
    ("run", "a joint has one run, that of [run]"),
    ("ambient", "both muscles are in one room, that of [ambient]"),
    ("drive", "a joint has one set point, that of [drive]"),
    ("sensor.length", "a joint has one sensor of its angle, with the noise of [sensor.length]"),
];

/// The refusal of a key that means nothing in a joint; its path may begin with `believed`.
fn senseless(owner: Owner, path: &str, value: &str) -> Option<Problem> {
    let prefix = owner.prefix();
    let (table, name) = path.rsplit_once('.')?;
    let plain = table.strip_prefix("believed.").unwrap_or(table);
    let once = if owner == Owner::Both { &[][..] } else { &ONCE };
    if let Some((_, why)) = OF_ONE_MUSCLE.iter().chain(once).find(|(of, _)| *of == plain) {
        return Some(Problem::UnusedTable { table: format!("{prefix}{table}"), why });
    }
    let faults = plain == schema::FAULTS || schema::is_fault_window(plain);
    let breaks = (name == "length" && value != "none") || name == "length_drift_m_s";
    (owner == Owner::B && faults && breaks).then(|| Problem::NotAllowed {
        key: format!("{prefix}{path}"),
        value: quoted(value),
        allowed: format!(
            "left out: muscle b has no length sensor; joint.a.{path} breaks the sensor of the angle"
        ),
    })
}

/// Refuses the first key of a muscle's tables that means nothing in a joint.
fn refuse_senseless(document: &Document, owner: Owner) -> Result<(), InputError> {
    let entries = [&document.plant, &document.believed];
    let found = entries.into_iter().flat_map(|entries| {
        entries.iter().filter_map(|entry| {
            let value = entry.value.as_str().unwrap_or(&entry.written);
            let problem = senseless(owner, &entries.full_path(&entry.path()), value)?;
            Some((entry.line, problem))
        })
    });
    match found.min_by_key(|(line, _)| *line) {
        Some((line, problem)) => Err(located(&document.origin, line, problem)),
        None => Ok(()),
    }
}

/// Refuses the first unknown table of the joint or of one muscle.
fn refuse_headers(text: &str, origin: &Path) -> Result<(), InputError> {
    let mut headers = text.lines().zip(1..).filter_map(|(line, number)| {
        let (name, _) = header(line)?;
        Some((number, unknown_header(&name)?))
    });
    match headers.next() {
        Some((line, problem)) => Err(InputError::line(origin, line, problem)),
        None => Ok(()),
    }
}

fn unknown_header(name: &str) -> Option<Problem> {
    let (part, table) = part_of(name);
    match part {
        Part::Shared if is_of_joint(name) => {
            let own = OWN.iter().map(|(own, _)| *own);
            // A muscle has tables alone.
            let muscle = ["joint.a", "joint.b"].contains(&name);
            let instead = match nearest(name, own.clone()).filter(|_| !muscle) {
                Some(near) => Instead::Near(vec![format!("[{near}]")]),
                None => {
                    let of_one = ["joint.a.TABLE", "joint.b.TABLE"];
                    let known = own.filter(|own| *own != "drive").chain(of_one);
                    Instead::Known(known.map(|known| format!("[{known}]")).collect())
                }
            };
            Some(Problem::UnknownTable { table: quoted(name), instead })
        }
        Part::Muscle(_) if is_of_joint(table) => {
            let why = "both muscles have one pulley and one controller, those of [joint] and [joint.controller]";
            Some(Problem::UnusedTable { table: quoted(name), why })
        }
        Part::Muscle(_) => match unknown_table(table)? {
            Problem::UnknownTable { instead, .. } => {
                let prefix = name.strip_suffix(table).unwrap_or_default();
                let named = |tables: Vec<String>| -> Vec<String> {
                    tables
                        .iter()
                        .map(|table| table.replacen('[', &format!("[{prefix}"), 1))
                        .collect()
                };
                let instead = match instead {
                    Instead::Near(tables) => Instead::Near(named(tables)),
                    Instead::Known(tables) => Instead::Known(named(tables)),
                };
                Some(Problem::UnknownTable { table: quoted(name), instead })
            }
            other => Some(other),
        },
        Part::Shared | Part::Own => None,
    }
}

/// A value that a key is set to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Setting<'a> {
    Number(f64),
    /// A choice, or a number with its unit.
    Word(&'a str),
}

impl Setting<'_> {
    fn put(self, document: &mut Document, path: &str) -> Result<(), Problem> {
        match self {
            Self::Number(number) => document.set(path, number),
            Self::Word(word) => document.set_word(path, word),
        }
    }

    fn text(self) -> String {
        match self {
            Self::Number(number) => number.to_string(),
            Self::Word(word) => word.to_owned(),
        }
    }

    /// The value of a key, if it is allowed.
    fn of(self, key: &Key) -> Option<Value> {
        match (key.allowed, self) {
            (Allowed::Real(limits), Self::Number(number)) => limits.taken(number).map(Value::Float),
            (allowed, Self::Word(word)) => value_of(allowed, word),
            _ => None,
        }
    }
}

/// Puts a checked value into the struct of a table.
fn put<T: Serialize + DeserializeOwned>(table: &mut T, name: &str, value: Value) {
    let changed = toml::Table::try_from(&*table).ok().and_then(|mut values| {
        values.insert(name.to_owned(), value);
        Value::Table(values).try_into().ok()
    });
    if let Some(changed) = changed {
        *table = changed;
    }
}

/// The table, the name and the schema of a key of the joint's own tables.
fn own_key(full_path: &str) -> Option<(&str, &str, &'static Key)> {
    let (of, name) = full_path.rsplit_once('.')?;
    let (_, table) = OWN.iter().find(|(own, _)| *own == of)?;
    let key = table.keys.iter().find(|key| key.name == name)?;
    Some((of, name, key))
}

/// The schema of a key that only a joint's scenario has: one of the joint's own tables.
pub fn key(full_path: &str) -> Option<&'static Key> {
    own_key(full_path).map(|(_, _, key)| key)
}

/// A path of one muscle's key without that muscle's prefix.
pub fn of_muscle(full_path: &str) -> &str {
    let [a, b] = ["joint.a.", "joint.b."].map(|prefix| full_path.strip_prefix(prefix));
    a.or(b).unwrap_or(full_path)
}

/// The refusal of a radius beside `joint.radius_csv`.
fn beside_table(full_path: &str, value: String) -> Problem {
    let allowed = if full_path.starts_with("believed.") {
        "left out, or beside a believed.joint.radius_m: joint.radius_csv gives the radii"
    } else {
        "left out: joint.radius_csv gives the radii"
    };
    Problem::NotAllowed { key: full_path.to_owned(), value, allowed: allowed.to_owned() }
}

/// Refuses a radius beside a table of radii, and a table that is only believed.
fn refuse_radii((tables, given): &Own, origin: &Path) -> Result<(), InputError> {
    let value = |of: &str, name: &str| tables.get(of)?.get(name);
    let refuse = |path: &str, problem| {
        let line = given.iter().find(|(given, _)| given == path).map(|(_, line)| *line);
        Err(located(origin, line, problem))
    };
    if value("believed.joint", "radius_csv").is_some() {
        let key = "believed.joint.radius_csv";
        return refuse(key, Problem::NotBelieved { key: key.to_owned() });
    }
    if value("joint", "radius_csv").is_none() {
        return Ok(());
    }
    let replaced = value("believed.joint", "radius_m").is_some();
    for of in ["joint", "believed.joint"].into_iter().filter(|of| *of == "joint" || !replaced) {
        for name in RADII {
            if let Some(value) = value(of, name) {
                let path = format!("{of}.{name}");
                return refuse(&path, beside_table(&path, value.to_string()));
            }
        }
    }
    Ok(())
}

fn located(origin: &Path, line: Option<u64>, problem: Problem) -> InputError {
    InputError { file: origin.to_path_buf(), line, problem: Box::new(problem) }
}

/// Fills the struct of a table, with defaults for missing keys.
fn filled<T: DeserializeOwned>(table: toml::Table, origin: &Path) -> Result<T, InputError> {
    let read = Value::Table(table).try_into();
    read.map_err(|error: toml::de::Error| {
        InputError::file(origin, Problem::Syntax(error.message().to_owned()))
    })
}

type Own = (std::collections::BTreeMap<String, toml::Table>, Vec<(String, u64)>);

/// The joint's own tables, each value checked, and the lines of their keys.
fn own_tables(text: &str, origin: &Path) -> Result<Own, InputError> {
    let lines = Lines::of(text);
    let root = toml_of(text, &lines, origin)?;
    let mut entries = Vec::new();
    for (path, table) in &OWN {
        let mut below = Some(root.get_ref());
        for part in path.split('.') {
            below = below.and_then(|table| table.get(part)?.get_ref().as_table());
        }
        entries.extend(below.into_iter().flatten().map(|(name, value)| (path, table, name, value)));
    }
    // The parser sorts a table by its keys.
    entries.sort_by_key(|(_, _, name, _)| name.span().start);
    let mut found = Own::default();
    for (path, table, name, value) in entries {
        let full = format!("{path}.{}", name.get_ref());
        if OWN.iter().any(|(own, _)| *own == full) {
            continue;
        }
        let line = lines.line_at(name.span().start);
        let refuse = |problem| InputError::line(origin, line, problem);
        let Some(key) = table.keys.iter().find(|key| key.name == name.get_ref()) else {
            return Err(refuse(unknown(&full, path, name.get_ref(), table.keys)));
        };
        let Some(taken) = checked(key.allowed, value.get_ref()) else {
            let allowed = allowed_instead(key.allowed, value.get_ref().as_str());
            let value = quoted(text.get(value.span()).unwrap_or_default());
            return Err(refuse(Problem::NotAllowed { key: full, value, allowed }));
        };
        found.0.entry((*path).to_owned()).or_default().insert(key.name.to_owned(), taken);
        found.1.push((full, line));
    }
    Ok(found)
}

fn unknown(full: &str, table: &str, name: &str, keys: &[Key]) -> Problem {
    let names = || keys.iter().map(|key| key.name);
    let instead = match nearest(name, names()) {
        Some(near) => Instead::Near(vec![format!("{table}.{near}")]),
        None => Instead::Known(names().map(str::to_owned).collect()),
    };
    Problem::UnknownKey { key: quoted(full), instead }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<JointDocument, String> {
        JointDocument::parse(text, "joint.toml".as_ref()).map_err(|error| error.to_string())
    }

    #[test]
    fn tables_are_shared_or_of_one_muscle() {
        let document = parse(
            "[muscle]\nzones = 4\nslip_force_n = 3\n[joint]\nradius_m = \"25 mm\"\n\
             [joint.b.muscle]\nzones = 2\n[believed.joint]\ninertia_kg_m2 = 0.03\n",
        )
        .unwrap();
        assert_eq!(document.joint.radius_m, 0.025);
        assert_eq!(document.believed.inertia_kg_m2, 0.03);
        assert_eq!(document.believed.radius_m, 0.025);
        let zones = |i: usize| document.muscles[i].plant.get("muscle.zones").unwrap();
        assert_eq!((zones(0).written.as_str(), zones(0).line), ("4", Some(2)));
        assert_eq!((zones(1).written.as_str(), zones(1).line), ("2", Some(7)));
        assert!(document.muscles[1].plant.get("muscle.slip_force_n").is_some());
    }

    #[test]
    fn a_key_is_set_as_if_it_were_in_the_file() {
        let mut document =
            parse("[joint]\n[believed.joint]\nradius_m = 0.03\n[joint.b.muscle]\nzones = 2\n")
                .unwrap();
        let mut set = |path: &str, value: Setting| {
            document.set(path, value).map_err(|problem| problem.to_string())
        };
        set("joint.radius_m", Setting::Word("25 mm")).unwrap();
        set("joint.inertia_kg_m2", Setting::Number(0.04)).unwrap();
        set("muscle.zones", Setting::Number(4.0)).unwrap();
        set("drive.shape", Setting::Word("sine")).unwrap();
        set("joint.a.muscle.slip_force_n", Setting::Number(3.0)).unwrap();
        for (path, value, message) in [
            ("joint.radius_m", -1.0, "joint.radius_m = -1: must be "),
            ("joint.radus_m", 1.0, "unknown key joint.radus_m; did you mean joint.radius_m?"),
            ("load.force_n", 1.0, "[load] is not used: the joint is the load"),
            ("joint.b.run.seed", 1.0, "[joint.b.run] is not used: a joint has one run"),
            ("joint.b.faults.length_drift_m_s", 1.0, "joint.b.faults.length_drift_m_s = 1: must"),
            ("muscle.zones", 0.5, "muscle.zones = 0.5: must be a whole number"),
            ("drive.shape", 1.0, "drive.shape = 1: must be one of "),
        ] {
            let said = set(path, Setting::Number(value)).unwrap_err();
            assert!(said.starts_with(message), "{said}");
        }
        assert_eq!((document.joint.radius_m, document.believed.radius_m), (0.025, 0.03));
        assert_eq!(document.believed.inertia_kg_m2, 0.04, "it follows the plant");
        assert_eq!(document.drive.shape, Shape::Sine);
        let zones = |i: usize| document.muscles[i].plant.get("muscle.zones").unwrap();
        assert_eq!([zones(0), zones(1)].map(|entry| entry.written.as_str()), ["4", "2"]);
        assert!(document.muscles[1].plant.get("muscle.slip_force_n").is_none());
    }

    /// Such a header used to count as one of both muscles.
    #[test]
    fn a_header_may_have_spaces_and_quotes() {
        let document =
            parse("[ joint ]\nradius_m = 0.02\n[ joint . \"b\".muscle]\nzones = 2\n").unwrap();
        assert_eq!(document.joint.radius_m, 0.02);
        let zones = |i: usize| document.muscles[i].plant.get("muscle.zones").is_some();
        assert_eq!([zones(0), zones(1)], [false, true]);
    }

    #[test]
    fn a_table_of_radii_takes_the_place_of_the_others() {
        let table = "[joint]\nradius_csv = \"radius.csv\"\n";
        let mut document = parse(table).unwrap();
        assert_eq!(document.believed.radius_csv, document.joint.radius_csv);
        let mut set = |path: &str, value: f64| {
            document.set(path, Setting::Number(value)).map_err(|problem| problem.to_string())
        };
        let said = set("joint.radius_m", 0.02).unwrap_err();
        assert_eq!(
            said,
            "joint.radius_m = 0.02: must be left out: joint.radius_csv gives the radii"
        );
        let said = set("believed.joint.radius_b_share", 1.1).unwrap_err();
        assert!(
            said.ends_with("or beside a believed.joint.radius_m: joint.radius_csv gives the radii")
        );
        set("believed.joint.radius_m", 0.021).unwrap();
        set("believed.joint.radius_b_share", 1.1).unwrap();
        assert_eq!((&document.believed.radius_csv, document.believed.radius_m), (&None, 0.021));
        let constant = parse(&format!("{table}[believed.joint]\nradius_m = 0.03\n")).unwrap();
        assert!(constant.joint.radius_csv.is_some() && constant.believed.radius_csv.is_none());
        for (text, message) in [
            (
                format!("{table}radius_b_share = 1.1\n"),
                "joint.toml:3: joint.radius_b_share = 1.1: must be left out: joint.radius_csv gives the radii",
            ),
            (
                format!("{table}[believed.joint]\nradius_a_per_rad = 0.1\n"),
                "joint.toml:4: believed.joint.radius_a_per_rad = 0.1: must be left out, or beside a \
                 believed.joint.radius_m: joint.radius_csv gives the radii",
            ),
            (
                "[joint]\n[believed.joint]\nradius_csv = \"radius.csv\"\n".to_owned(),
                "joint.toml:3: believed.joint.radius_csv",
            ),
        ] {
            let said = parse(&text).unwrap_err();
            assert!(said.starts_with(message), "{said}");
        }
    }

    #[test]
    fn each_mistake_has_its_line() {
        for (text, message) in [
            (
                "[joint]\nradius_m = 0.02\nmid_lenght_a_m = 0.2\n",
                "joint.toml:3: unknown key joint.mid_lenght_a_m; did you mean joint.mid_length_a_m?",
            ),
            (
                "[joint]\nradius_m = 0.02\nmaximum_rad = 99\ninertia_kg_m2 = -3\n",
                "joint.toml:3: joint.maximum_rad = 99: must be a number from -6.3 to 6.3 rad",
            ),
            (
                "[joint.controller]\nlead_s = -1\n[joint]\nradius_m = -1\n",
                "joint.toml:2: joint.controller.lead_s = -1: must be a number from 0 to 0.1 s",
            ),
            (
                "[joint]\n[drive]\nkind = \"pressure\"\n",
                "joint.toml:3: drive.kind = \"pressure\": must be one of \"joint\"",
            ),
            (
                "[joint]\n\n[joint.a.muscle]\nzones = 0\n",
                "joint.toml:4: muscle.zones = 0: must be a whole number from 1 to 64",
            ),
            (
                "[joint]\n[load]\nforce_n = 3\n",
                "joint.toml:3: [load] is not used: the joint is the load of both muscles; leave it out",
            ),
            (
                "[joint]\n[joint.a.load]\nforce_n = 3\n",
                "joint.toml:3: [joint.a.load] is not used: the joint is the load of both muscles; leave it out",
            ),
            (
                "[joint]\n[joint.b.believed.load]\nforce_n = 3\n",
                "joint.toml:3: [joint.b.believed.load] is not used: the joint is the load of both muscles; leave it out",
            ),
            (
                "[joint]\n[identify]\nparameters = [\"heat.scale\"]\n",
                "joint.toml:3: [identify] is not used: `thermyo identify` finds all values of a joint; leave it out",
            ),
            (
                "[joint]\n[joint.a.drive]\nkind = \"closed\"\n",
                "joint.toml:3: [joint.a.drive] is not used: a joint has one set point, that of [drive]",
            ),
            (
                "[joint]\n[joint.b.run]\n\nseed = 3\n[joint.a.run]\nseed = 2\n",
                "joint.toml:6: [joint.a.run] is not used: a joint has one run, that of [run]",
            ),
            (
                "[joint]\n[joint.b.ambient]\npressure_pa = 90000\n",
                "joint.toml:3: [joint.b.ambient] is not used: both muscles are in one room, that of [ambient]",
            ),
            (
                "[joint]\n[joint.a.sensor.length]\nnoise_m = 0.001\n",
                "joint.toml:3: [joint.a.sensor.length] is not used: a joint has one sensor of its angle, with the noise \
                 of [sensor.length]",
            ),
            (
                "[joint]\n[joint.b.faults]\nlength = \"open\"\n",
                "joint.toml:3: joint.b.faults.length = open: must be left out: muscle b has no length sensor; \
                 joint.a.faults.length breaks the sensor of the angle",
            ),
            (
                "[joint]\n[joint.c.muscle]\nzones = 3\n",
                "joint.toml:2: unknown table [joint.c.muscle]; known here: [joint], [believed.joint], [joint.controller], \
                 [joint.a.TABLE], [joint.b.TABLE]",
            ),
            (
                "[joint]\n[joint.a]\nmuscle.zones = 3\n",
                "joint.toml:2: unknown table [joint.a]; known here: [joint], [believed.joint], [joint.controller], \
                 [joint.a.TABLE], [joint.b.TABLE]",
            ),
            (
                "[joint]\n[joint.a.joint]\nradius_m = 0.02\n",
                "joint.toml:2: [joint.a.joint] is not used: both muscles have one pulley and one controller, those of \
                 [joint] and [joint.controller]",
            ),
            (
                "[joint]\n[joint.b.believed.joint]\nradius_m = 0.02\n",
                "joint.toml:2: [joint.b.believed.joint] is not used: both muscles have one pulley and one controller, \
                 those of [joint] and [joint.controller]",
            ),
            (
                "[joint.controler]\nsettling_s = 1\n",
                "joint.toml:1: unknown table [joint.controler]; did you mean [joint.controller]?",
            ),
            (
                "[joint]\n[joint.a.musle]\nzones = 3\n",
                "joint.toml:2: unknown table [joint.a.musle]; did you mean [joint.a.muscle]?",
            ),
        ] {
            assert_eq!(parse(text).unwrap_err(), message);
        }
    }

    #[test]
    fn a_scenario_is_one_of_a_joint_by_its_tables() {
        assert!(is_joint("[run]\nseed = 1\n [joint] # two\n"));
        assert!(is_joint("[joint.a.muscle]\n"));
        assert!(is_joint("[believed.joint]\n"));
        assert!(!is_joint("[run]\n# [joint]\n[drive]\nkind = \"closed\"\n"));
    }
}
