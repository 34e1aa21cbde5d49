//! A rule between keys that does not hold.

use super::schema::{Limits, limits};

/// A cell of a CSV file that may not be what it is.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongCell {
    /// Its row, from 0.
    pub row: usize,
    /// Its column, from 0, in the order of the key's columns.
    pub column: usize,
    /// What it may be.
    pub allowed: String,
}

/// A rule that does not hold, and the key to blame.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    /// Path of the key.
    pub path: String,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with a key.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// Its value does not fit the others.
    NotAllowed {
        /// The value.
        value: String,
        /// What it may be, and why.
        allowed: String,
    },
    /// It has to be there.
    Missing {
        /// The key that needs it.
        for_path: String,
        /// Why.
        why: String,
    },
}

impl Violation {
    /// A number outside of the limits that other keys set.
    pub fn number(path: &str, value: f64, allowed: &Limits, why: &str) -> Self {
        Self::value(path, &format!("{value:?}"), format!("{allowed}, {why}"))
    }

    /// A key that has to be there.
    pub fn missing(path: &str, for_path: &str, why: &str) -> Self {
        let fault = Fault::Missing { for_path: for_path.to_owned(), why: why.to_owned() };
        Self { path: path.to_owned(), fault }
    }

    /// A value that does not fit; `allowed` says why.
    pub fn value(path: &str, value: &str, allowed: String) -> Self {
        let fault = Fault::NotAllowed { value: value.to_owned(), allowed };
        Self { path: path.to_owned(), fault }
    }
}

/// Checks a number against limits that other keys set.
///
/// # Errors
/// When it lies outside.
pub fn within(path: &str, value: f64, (min, max): (f64, f64), why: &str) -> Result<(), Violation> {
    let allowed = limits(path).between(min, max);
    if allowed.contains(value) {
        Ok(())
    } else {
        Err(Violation::number(path, value, &allowed, why))
    }
}
