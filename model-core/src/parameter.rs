//! A parameter is declared once: name, unit, range, default and meaning. The struct that holds it, its
//! default, its check and its documentation follow from that, and on the host the key of the scenario.
//!
//! # How to add a parameter
//!
//! One line in the `parameters!` of its table. Its name ends in the unit; the table's path and its name are
//! the key that a user writes, and what an error calls it. A key of `[estimator]` or `[controller]` is in the
//! scenario with that; `docs/estimator.md` and `docs/control.md` have a row for each, which a test compares.
//! For the other tables the scenario says which of the core's parameters it takes: `declare.rs` in `host-sim`
//! has the rest of this list. The bytes of the configuration on the wire change: raise `PROTOCOL` in
//! `link` and pin the new ones there.

/// What is known of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name within its table.
    pub name: &'static str,
    /// Its default; the core has it in f32.
    pub default: f64,
    /// Unit, as the SI writes it; empty for a ratio.
    pub unit: &'static str,
    /// Smallest value allowed.
    pub minimum: f64,
    /// Largest value allowed.
    pub maximum: f64,
    /// What it means.
    pub meaning: &'static str,
}

/// Declares a table of parameters: the struct, `Default`, `PARAMETERS` for whoever prints them, and
/// `check`, whose errors name the key that a user writes.
macro_rules! parameters {
    (
        $(#[$attribute:meta])*
        $table:literal: $struct:ident {
            $($name:ident: $default:literal, $unit:literal, $minimum:literal to $maximum:literal, $meaning:literal;)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "link", serde(default, deny_unknown_fields))]
        pub struct $struct {
            $(
                #[doc = concat!($meaning, " \\[", $unit, "\\], from ", $minimum, " to ", $maximum, ".")]
                pub $name: f32,
            )*
        }

        impl Default for $struct {
            fn default() -> Self {
                Self { $($name: $default as f32),* }
            }
        }

        impl $struct {
            /// Every parameter of the table, in the order of the fields.
            pub const PARAMETERS: &[$crate::parameter::Parameter] = &[
                $($crate::parameter::Parameter {
                    name: stringify!($name),
                    default: $default,
                    unit: $unit,
                    minimum: $minimum,
                    maximum: $maximum,
                    meaning: $meaning,
                }),*
            ];

            /// Checks every value.
            ///
            /// # Errors
            /// The first value that is not a number or lies outside of its range.
            pub fn check(&self) -> Result<(), $crate::config::ConfigError> {
                $(
                    $crate::config::within(
                        concat!($table, ".", stringify!($name)),
                        self.$name,
                        $minimum,
                        $maximum,
                    )?;
                )*
                Ok(())
            }
        }
    };
}

pub(crate) use parameters;
