//! From text to checked entries: known keys, values of the right type and within range.

use super::schema::{self, Allowed, Key};
use std::path::{Path, PathBuf};
use thermyo_files::input::{InputError, Instead, Lines, Problem, nearest, quoted};
use toml::de::{DeInteger, DeTable, DeValue};
use toml::{Spanned, Value};

/// A number with a decimal comma, as the value of a line.
fn decimal_comma(line: &str) -> Option<&str> {
    let (_, value) = line.split_once('=')?;
    let value = value.split('#').next()?.trim();
    let (whole, decimals) = value.split_once(',')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    (digits(whole.trim_start_matches(['-', '+'])) && digits(decimals)).then_some(value)
}

/// A text without quotes, as the value of a line.
fn unquoted(line: &str) -> Option<&str> {
    let (_, value) = line.split_once('=')?;
    let value = value.split('#').next()?.trim();
    let is_text = value.starts_with(|first: char| first.is_ascii_alphanumeric())
        && value.contains(|c: char| c.is_ascii_alphabetic())
        && !value.contains(|c: char| c.is_control() || "\"'[{=,".contains(c));
    // Another part of a line with a valid value is wrong.
    (is_text && DeTable::parse(&format!("value = {value}")).is_err()).then_some(value)
}

/// Whether a text begins as a CSV file does, with the names of its columns.
fn begins_with_columns(text: &str) -> bool {
    let first = text.lines().next().unwrap_or_default();
    first.contains([',', ';']) && !first.contains(['=', '[', '#', '"'])
}

/// The tables of a text.
pub(super) fn toml_of<'a>(
    text: &'a str,
    lines: &Lines,
    origin: &Path,
) -> Result<Spanned<DeTable<'a>>, InputError> {
    DeTable::parse(text).map_err(|error| {
        let line = error.span().and_then(|span| {
            let from = text.get(..span.start)?.rfind('\n').map_or(0, |end| end + 1);
            text.get(from..)?.lines().next()
        });
        let number = line.and_then(decimal_comma);
        let bare = line.and_then(unquoted);
        let problem = Problem::Syntax(match (number, bare) {
            (Some(number), _) => format!("{number}: numbers need a decimal point"),
            (_, Some(bare)) => format!("{bare}: a text needs quotes: \"{bare}\""),
            _ if begins_with_columns(text) => {
                "it begins as a CSV file does; a scenario has tables such as [run], and keys with values".to_owned()
            }
            _ => error.message().replace('\n', ", "),
        });
        match error.span() {
            Some(span) => InputError::line(origin, lines.line_at(span.start), problem),
            None => InputError::file(origin, problem),
        }
    })
}

/// Converts a word to its value, if it is allowed.
pub(super) fn value_of(allowed: Allowed, word: &str) -> Option<Value> {
    match (allowed, word) {
        (Allowed::Choice(words), _) => {
            words.contains(&word).then(|| Value::String(word.to_owned()))
        }
        (Allowed::Switch, "true" | "false") => Some(Value::Boolean(word == "true")),
        (Allowed::Real(limits), _) => {
            let number = limits.wanted().read(word).ok();
            number.and_then(|number| limits.taken(number)).map(Value::Float)
        }
        (Allowed::Whole { min, max }, _) => {
            let whole = word.parse().ok().filter(|whole| (min..=max).contains(whole));
            whole.map(Value::Integer)
        }
        _ => None,
    }
}

/// The prefix of keys that the core is configured with.
const BELIEVED: &str = "believed";

#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// Name of the document in messages.
    pub origin: PathBuf,
    pub plant: Entries,
    /// Entries that the core is configured with where they differ from the plant's.
    pub believed: Entries,
}

/// Entries of a scenario, or of its `[believed]`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Entries {
    /// "" or "believed.".
    prefix: &'static str,
    list: Vec<Entry>,
}

/// Line, path and value of a key in a file.
pub type Given = (Option<u64>, String, String);

#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub table: String,
    /// The schema's entry.
    pub key: &'static Key,
    /// Value, of the type in the schema.
    pub value: Value,
    pub written: String,
    /// Line of the entry; none if [`Document::set`] set it.
    pub line: Option<u64>,
}

impl Entry {
    /// Path, such as "muscle.zones".
    pub fn path(&self) -> String {
        format!("{}.{}", self.table, self.key.name)
    }

    pub fn given(&self) -> Given {
        (self.line, self.path(), self.written.clone())
    }
}

impl Entries {
    /// Every entry, in order of the keys.
    pub fn iter(&self) -> impl Iterator<Item = &Entry> {
        self.list.iter()
    }

    /// The entry of a path such as "muscle.zones", if the file has it.
    pub fn get(&self, path: &str) -> Option<&Entry> {
        let (table, name) = path.rsplit_once('.')?;
        self.list.iter().find(|entry| entry.table == table && entry.key.name == name)
    }

    /// The whole path of a key as in the file.
    pub fn full_path(&self, path: &str) -> String {
        format!("{}{path}", self.prefix)
    }
}

impl Document {
    /// Parses a scenario; `origin` is its name in messages.
    ///
    /// # Errors
    /// For the first position in the file that is not TOML or not in the schema.
    pub fn parse(text: &str, origin: &Path) -> Result<Self, InputError> {
        let lines = Lines::of(text);
        let root = toml_of(text, &lines, origin)?;
        let mut walk = Walk {
            text,
            lines: &lines,
            plant: Entries::default(),
            believed: Entries { prefix: "believed.", list: Vec::new() },
            first_problem: None,
        };
        walk.table("", root.get_ref());
        match walk.first_problem {
            Some((offset, problem)) => {
                Err(InputError::line(origin, lines.line_at(offset), problem))
            }
            None => Ok(Self {
                origin: origin.to_path_buf(),
                plant: walk.plant,
                believed: walk.believed,
            }),
        }
    }

    /// This document, overlaid with the entries of another.
    #[must_use]
    pub fn overlaid(&self, over: &Self) -> Self {
        let both = |own: &Entries, over: &Entries| {
            let kept = own.list.iter().filter(|entry| over.get(&entry.path()).is_none());
            Entries { prefix: own.prefix, list: kept.chain(&over.list).cloned().collect() }
        };
        Self {
            origin: self.origin.clone(),
            plant: both(&self.plant, &over.plant),
            believed: both(&self.believed, &over.believed),
        }
    }

    /// Sets the key of a whole path, such as "sensor.gas.position" or "believed.heat.scale", to
    /// this number, as if it were in the file.
    ///
    /// # Errors
    /// When there is no such key, it is not a number, or this number is not allowed.
    pub fn set(&mut self, full_path: &str, number: f64) -> Result<(), Problem> {
        let key = self.settable(full_path)?;
        let value = match key.allowed {
            Allowed::Real(limits) => limits.taken(number).map(Value::Float),
            Allowed::Whole { min, max } => {
                let whole = number as i64;
                let taken = whole as f64 == number && (min..=max).contains(&whole);
                taken.then_some(Value::Integer(whole))
            }
            Allowed::Choice(_) | Allowed::Switch | Allowed::List | Allowed::Csv { .. } => {
                let allowed = key.allowed.to_string();
                return Err(Problem::NotANumber { key: full_path.to_owned(), allowed });
            }
        };
        self.put(full_path, key, value, number.to_string())
    }

    /// Sets a key to a word: a choice, "true" or "false", a number with its unit, or a whole number
    /// with more digits than an `f64` has.
    ///
    /// # Errors
    /// When there is no such key, or the word is not allowed.
    pub fn set_word(&mut self, full_path: &str, word: &str) -> Result<(), Problem> {
        let key = self.settable(full_path)?;
        self.put(full_path, key, value_of(key.allowed, word), word.to_owned())
    }

    /// The schema's entry of a key that can be set.
    fn settable(&self, full_path: &str) -> Result<&'static Key, Problem> {
        let (is_believed, path) = split_believed(full_path);
        if path.is_empty() || schema::is_table(path) {
            let allowed = "a table of keys".to_owned();
            return Err(Problem::NotANumber { key: full_path.to_owned(), allowed });
        }
        let Some((table, key)) = schema::key(path) else {
            return Err(unknown(full_path, path, false));
        };
        let place = table_of(path);
        if schema::is_fault_window(place) && !self.plant.list.iter().any(|e| e.table == place) {
            return Err(unknown_window(place, "one that the file has"));
        }
        if is_believed && !table.believed {
            return Err(Problem::NotBelieved { key: full_path.to_owned() });
        }
        Ok(key)
    }

    fn put(
        &mut self,
        full_path: &str,
        key: &'static Key,
        value: Option<Value>,
        written: String,
    ) -> Result<(), Problem> {
        let Some(value) = value else {
            let allowed = allowed_instead(key.allowed, Some(&written));
            return Err(Problem::NotAllowed { key: full_path.to_owned(), value: written, allowed });
        };
        let (is_believed, path) = split_believed(full_path);
        let list = if is_believed { &mut self.believed.list } else { &mut self.plant.list };
        list.retain(|entry| entry.path() != path);
        list.push(Entry { table: table_of(path).to_owned(), key, value, written, line: None });
        Ok(())
    }
}

/// Whether a whole path is below `[believed]`, and the path without that prefix.
fn split_believed(full_path: &str) -> (bool, &str) {
    match full_path.strip_prefix(BELIEVED) {
        Some("") => (true, ""),
        Some(rest) if rest.starts_with('.') => (true, &rest[1..]),
        _ => (false, full_path),
    }
}

/// Walks through the parsed file. Tables may be scattered over the file, so it looks at every
/// problem and keeps the first by line.
struct Walk<'a> {
    text: &'a str,
    lines: &'a Lines,
    plant: Entries,
    believed: Entries,
    first_problem: Option<(usize, Problem)>,
}

impl Walk<'_> {
    /// `path` is the table's whole path, `believed` included.
    fn table(&mut self, path: &str, table: &DeTable<'_>) {
        for (name, value) in table {
            let offset = name.span().start;
            let name = name.get_ref();
            // A name that contains a dot is not a path.
            let name = if name.contains('.') { format!("{name:?}") } else { name.to_string() };
            let path = if path.is_empty() { name } else { format!("{path}.{name}") };
            let after = |first: &Option<(usize, Problem)>| {
                first.as_ref().is_some_and(|(first, _)| *first < offset)
            };
            if after(&self.first_problem) && !value.get_ref().is_table() {
                continue;
            }
            if let Err(problem) = self.item(&path, offset, value)
                && !after(&self.first_problem)
            {
                self.first_problem = Some((offset, problem));
            }
        }
    }

    fn item(
        &mut self,
        full_path: &str,
        offset: usize,
        value: &Spanned<DeValue<'_>>,
    ) -> Result<(), Problem> {
        let written = quoted(self.text.get(value.span()).unwrap_or_default());
        let table = value.get_ref().as_table();
        let (is_believed, path) = split_believed(full_path);
        let is_window = table.is_some() && schema::is_fault_window(path);
        if path.is_empty() || schema::is_table(path) || is_window {
            if is_believed && schema::table(path).is_some_and(|table| !table.believed) {
                return Err(Problem::NotBelieved { key: full_path.to_owned() });
            }
            let table = table
                .ok_or_else(|| Problem::NotATable { table: quoted(full_path), value: written })?;
            self.table(full_path, table);
            return Ok(());
        }
        if path == "joint" {
            if table.is_none() {
                return Err(Problem::NotATable { table: quoted(full_path), value: written });
            }
            let why = "this takes one muscle; a joint, each table of it under a header of its own, is for \
                       `thermyo run`, `check`, `sweep`, `tune`, `identify`, `replay`, `monitor`, `fmu`, `evaluate joint` and `board`";
            return Err(Problem::UnusedTable { table: full_path.to_owned(), why });
        }
        let Some((_, key)) = schema::key(path) else {
            return Err(unknown(full_path, path, table.is_some()));
        };
        // The volume over time belongs to the plant; the core measures it.
        if is_believed && matches!(key.allowed, Allowed::Csv { .. }) {
            return Err(Problem::NotBelieved { key: full_path.to_owned() });
        }
        let Some(found) = checked(key.allowed, value.get_ref()) else {
            let mut allowed = allowed_instead(key.allowed, value.get_ref().as_str());
            if path == "drive.kind" && value.get_ref().as_str() == Some("joint") {
                allowed.push_str("; \"joint\" is for a scenario with a table [joint]");
            }
            return Err(Problem::NotAllowed { key: full_path.to_owned(), value: written, allowed });
        };
        let line = Some(self.lines.line_at(offset));
        let entries = if is_believed { &mut self.believed } else { &mut self.plant };
        let table = table_of(path).to_owned();
        entries.list.push(Entry { table, key, value: found, written, line });
        Ok(())
    }
}

/// Allowed values in place of a wrong one; for a text without a unit of the key, also the units.
pub(crate) fn allowed_instead(allowed: Allowed, text: Option<&str>) -> String {
    match (allowed, text) {
        (Allowed::Real(limits), Some(text)) if limits.wanted().read_with_unit(text).is_err() => {
            format!("{limits}, or a text with its unit: {}", limits.wanted().names())
        }
        _ => allowed.to_string(),
    }
}

/// The value in the schema's type, if it is allowed.
pub(crate) fn checked(allowed: Allowed, value: &DeValue<'_>) -> Option<Value> {
    match allowed {
        Allowed::Real(limits) => {
            let number = match value {
                DeValue::Float(float) => float.as_str().parse().ok()?,
                DeValue::Integer(integer) => whole(integer)? as f64,
                DeValue::String(text) => limits.wanted().read_with_unit(text).ok()?,
                _ => return None,
            };
            limits.taken(number).map(Value::Float)
        }
        Allowed::Whole { min, max } => {
            let number = whole(value.as_integer()?)?;
            (min..=max).contains(&number).then_some(Value::Integer(number))
        }
        Allowed::Choice(words) => {
            let word = value.as_str()?;
            words.contains(&word).then(|| Value::String(word.to_owned()))
        }
        Allowed::Switch => value.as_bool().map(Value::Boolean),
        Allowed::List => {
            let word = |item: &Spanned<DeValue<'_>>| {
                item.get_ref().as_str().map(|word| Value::String(word.to_owned()))
            };
            value.as_array()?.iter().map(word).collect::<Option<_>>().map(Value::Array)
        }
        Allowed::Csv { .. } => {
            let path = value.as_str()?;
            (!path.is_empty()).then(|| Value::String(path.to_owned()))
        }
    }
}

fn whole(integer: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn table_of(path: &str) -> &str {
    path.rsplit_once('.').map_or("", |(table, _)| table)
}

/// The error for a wrong window of faults; `name` describes the allowed name.
fn unknown_window(path: &str, name: &str) -> Problem {
    let known = vec!["[faults]".to_owned(), format!("[faults.NAME], NAME {name}")];
    Problem::UnknownTable { table: quoted(path), instead: Instead::Known(known) }
}

/// The error for a table's path if it is not in the schema.
pub(crate) fn unknown_table(full_path: &str) -> Option<Problem> {
    let (_, path) = split_believed(full_path);
    let is_known = path.is_empty() || schema::is_table(path) || schema::is_fault_window(path);
    (!is_known).then(|| unknown(full_path, path, true))
}

/// The error for a path that is not in the schema. `path` is without `believed`.
fn unknown(full_path: &str, path: &str, is_table: bool) -> Problem {
    let prefix = full_path.strip_suffix(path).unwrap_or_default();
    let (parent, name) = path.rsplit_once('.').unwrap_or(("", path));
    let siblings = schema::table(parent).map_or(&[][..], |table| table.keys);
    let all_keys: Vec<String> = schema::TABLES
        .iter()
        .filter(|table| prefix.is_empty() || table.believed)
        .flat_map(|table| table.keys.iter().map(|key| format!("{}.{}", table.name, key.name)))
        .collect();
    let tables = schema::TABLES.iter().filter(|table| prefix.is_empty() || table.believed);
    if is_table && path.starts_with(schema::FAULT_WINDOWS) {
        return unknown_window(full_path, "made of letters, digits, - and _");
    }
    if is_table {
        let tables: Vec<&str> = tables.map(|table| table.name).collect();
        let with_believed = prefix.is_empty().then_some(BELIEVED);
        let others = with_believed.into_iter().chain(prefix.is_empty().then_some("joint"));
        let near = nearest(path, tables.iter().copied().chain(others));
        let bracketed = |name: &str| format!("[{prefix}{name}]");
        // A table within a wrong one, or one that only holds others.
        let within = tables.iter().find(|table| **table == name);
        let groups = tables.iter().filter_map(|table| table.split_once('.'));
        let group = nearest(path.split('.').next().unwrap_or(path), groups.map(|(group, _)| group));
        let of_group = |group: &str| -> Vec<String> {
            let own =
                |table: &&&str| table.split_once('.').is_some_and(|(first, _)| first == group);
            tables.iter().filter(own).map(|table| bracketed(table)).collect()
        };
        let instead = match (near, within, group) {
            (Some(name), ..) | (_, Some(&name), _) => Instead::Near(vec![bracketed(name)]),
            (_, _, Some(group)) => Instead::Near(of_group(group)),
            _ => Instead::Known(tables.iter().copied().map(bracketed).collect()),
        };
        return Problem::UnknownTable { table: quoted(full_path), instead };
    }
    let near = if let Some(name) = nearest(name, siblings.iter().map(|key| key.name)) {
        vec![format!("{parent}.{name}")]
    } else {
        let elsewhere: Vec<String> =
            all_keys.iter().filter(|key| key.rsplit('.').next() == Some(name)).cloned().collect();
        if elsewhere.is_empty() {
            nearest(path, all_keys.iter().map(String::as_str))
                .map(str::to_owned)
                .into_iter()
                .collect()
        } else {
            elsewhere
        }
    };
    let instead = if !near.is_empty() {
        Instead::Near(near.into_iter().map(|key| format!("{prefix}{key}")).collect())
    } else if siblings.is_empty() {
        Instead::Known(tables.map(|table| format!("[{prefix}{}]", table.name)).collect())
    } else {
        Instead::Known(siblings.iter().map(|key| key.name.to_owned()).collect())
    };
    Problem::UnknownKey { key: quoted(full_path), instead }
}
