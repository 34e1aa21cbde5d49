//! A violated rule between keys.

use super::schema::{Limits, limits};

/// A CSV cell with a value that is not allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongCell {
    /// Its row, from 0.
    pub row: usize,
    /// Its column, from 0, in the order of the key's columns.
    pub column: usize,
    pub allowed: String,
}

/// A violated rule and the key that violates it.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    pub path: String,
    pub fault: Fault,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// Its value is inconsistent with others.
    NotAllowed {
        value: String,
        /// Allowed values, and the reason.
        allowed: String,
    },
    Missing {
        /// The key that needs it.
        for_path: String,
        why: String,
    },
}

impl Violation {
    /// A number outside the limits that other keys set.
    pub fn number(path: &str, value: f64, allowed: &Limits, why: &str) -> Self {
        Self::value(path, &format!("{value:?}"), format!("{allowed}, {why}"))
    }

    pub fn missing(path: &str, for_path: &str, why: &str) -> Self {
        let fault = Fault::Missing { for_path: for_path.to_owned(), why: why.to_owned() };
        Self { path: path.to_owned(), fault }
    }

    /// A value that is not allowed; `allowed` gives the reason.
    pub fn value(path: &str, value: &str, allowed: String) -> Self {
        let fault = Fault::NotAllowed { value: value.to_owned(), allowed };
        Self { path: path.to_owned(), fault }
    }
}

/// Checks a number against limits that other keys set.
pub fn within(path: &str, value: f64, (min, max): (f64, f64), why: &str) -> Result<(), Violation> {
    let allowed = limits(path).between(min, max);
    if allowed.contains(value) {
        Ok(())
    } else {
        Err(Violation::number(path, value, &allowed, why))
    }
}
