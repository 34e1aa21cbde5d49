//! A fitted value, with its standard error.

use serde::Serialize;
use thermyo_files::number::{significant, with_error};

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fitted {
    /// Value \[unit\].
    pub value: f64,
    /// Standard error \[unit\]; none if the data leave the value open, or it is at a limit.
    pub standard_error: Option<f64>,
    /// Unit, as the SI writes it; empty for a ratio.
    pub unit: &'static str,
}

impl Fitted {
    /// Whether the value has no standard error, or one above the share `most` of it.
    pub fn is_open(&self, most: f64) -> bool {
        self.standard_error.is_none_or(|error| error > most * self.value)
    }

    /// Value with its standard error, and unit.
    pub fn text(&self) -> String {
        let value = match self.standard_error {
            Some(error) => with_error(self.value, error),
            None => format!("{} ± open", significant(self.value, 6)),
        };
        format!("{value} {}", self.unit).trim_end().to_owned()
    }

    /// A line for a terminal.
    pub fn line(&self, path: &str) -> String {
        format!("{path:<34} {}\n", self.text())
    }
}
