//! Each table of the scenario is declared once: keys with unit, range, default and meaning. The
//! struct, its `Default`, its serde form, its entry in [`super::schema`] (range checks, messages,
//! `thermyo check`) and the fields that the core shares follow from that.
//!
//! # How to add a parameter
//!
//! - A tuning value of the core: one line in the `parameters!` of `EstimatorConfig` or
//!   `ControllerConfig` in `model-core/src/config.rs`, and its row in the docs; see
//!   `model-core/src/parameter.rs`. Here: nothing.
//! - A parameter of the plant that the core has too: its line in the core's `parameters!`, and `core NAME;` in the
//!   `table!`. Where the scenario differs on purpose (another default, a wider range), `core NAME: real ...;` with a
//!   comment that says why. Where the core's value is not the plant's, [`thermyo_setup::core_config`] sets it.
//! - A parameter of the plant alone: one line in the `table!`.
//! - A table: a `table!` in `scenario/tables/`, its field in `Scenario`, its line in `TABLES`.
//!
//! An incomplete addition does not compile, or fails a test that names it.

pub use super::key::Allowed;
use super::key::{Key, Limits};
use model_core::parameter::Parameter;

/// Finds the parameter of this name, at compile time.
///
/// # Panics
/// If the core has no such parameter, the declaration does not compile.
pub const fn parameter(parameters: &[Parameter], name: &str) -> Parameter {
    let mut i = 0;
    while i < parameters.len() {
        if equal(parameters[i].name.as_bytes(), name.as_bytes()) {
            return parameters[i];
        }
        i += 1;
    }
    panic!("the core has no parameter of this name")
}

const fn equal(a: &[u8], b: &[u8]) -> bool {
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

pub const fn key(name: &'static str, allowed: Allowed, meaning: &'static str) -> Key {
    Key { name, allowed, meaning, core: false }
}

pub const fn real(
    name: &'static str,
    unit: &'static str,
    [min, max]: [f64; 2],
    meaning: &'static str,
) -> Key {
    key(name, Allowed::Real(Limits { min, max, unit }), meaning)
}

pub const fn whole(name: &'static str, [min, max]: [i64; 2], meaning: &'static str) -> Key {
    key(name, Allowed::Whole { min, max }, meaning)
}

/// The key of a parameter that the core declares.
pub const fn key_of(parameter: &Parameter) -> Key {
    let Parameter { name, unit, minimum, maximum, meaning, .. } = *parameter;
    real(name, unit, [minimum, maximum], meaning)
}

/// The keys of a table that is the core's own.
pub const fn keys_of<const N: usize>(parameters: &[Parameter]) -> [Key; N] {
    let mut keys = [Key { name: "", allowed: Allowed::Switch, meaning: "", core: true }; N];
    let mut i = 0;
    while i < N {
        keys[i] = Key { core: true, ..key_of(&parameters[i]) };
        i += 1;
    }
    keys
}

/// Declares a table of the scenario. Its head is the path, the meaning, and the flags of [`super::schema::Table`]; `as`
/// names the struct of the core that has the same fields. A field is one of
///
/// ```text
/// core name;                                      declared by the core's table
/// core name: real default, unit, min to max, meaning;
///                                                 the core has it too, with other values
/// name: from PATH;                                declared by that constant of the core
/// name: real default, unit, min to max, meaning;
/// name: optional unit, min to max, meaning;       a number that may be left out
/// name: whole type, default, min to max, meaning;
/// name: choice type::default, meaning;            the type is a `choice!`
/// name: switch default, meaning;
/// name: list meaning;                             of words
/// name: csv column, meaning;                      the path of a file with time_s and that column
/// name: csv [column, ...], meaning;               the path of a file with these columns
/// ```
macro_rules! table {
    (
        $(#[$attribute:meta])*
        $path:literal, $meaning:literal $(, $flag:ident)*;
        $struct:ident $(as $core:path)? { $($fields:tt)* }
    ) => {
        $crate::declare::table! {
            @field [
                [$(#[$attribute])*] [$path, $meaning $(, $flag)*] $struct [$($core)?]
            ] [] [] $($fields)*
        }
    };

    // Takes one field at a time: [attributes] doc, name: type = default, key. The list after them has the fields shared
    // with the core.
    (@field [$head:tt $table:tt $struct:ident [$core:path]] $done:tt [$($shared:ident)*]
        core $name:ident; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add [$head $table $struct [$core]] $done [$($shared)* $name] {
                []
                concat!("As the core has it: [`", stringify!($core), "::", stringify!($name), "`]."),
                $name: f64 = const { $crate::declare::parameter(
                    <$core>::PARAMETERS,
                    stringify!($name),
                ) }.default,
                key_of(&parameter(<$core>::PARAMETERS, stringify!($name)))
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt [$($shared:ident)*]
        core $name:ident: $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @field $head $done [$($shared)* $name] $name: $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: from $parameter:path; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!("As the core has it: [`", stringify!($parameter), "`]."),
                $name: f64 = $parameter.default,
                key_of(&$parameter)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: real $default:expr, $unit:tt, $min:literal to $max:expr, $meaning:literal;
        $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!($meaning, $crate::declare::unit!($unit), "."),
                $name: f64 = $default,
                real(stringify!($name), $unit, [$min, $max], $meaning)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: optional $unit:tt, $min:literal to $max:expr, $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                [#[serde(skip_serializing_if = "Option::is_none")]]
                concat!($meaning, $crate::declare::unit!($unit), "."),
                $name: Option<f64> = None,
                real(stringify!($name), $unit, [$min, $max], $meaning)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: whole $type:ty, $default:expr, $min:literal to $max:literal, $meaning:literal;
        $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!($meaning, "."),
                $name: $type = $default,
                whole(
                    stringify!($name),
                    // Fails to compile if the type cannot hold both limits.
                    [{ let min: $type = $min; min as i64 }, { let max: $type = $max; max as i64 }],
                    $meaning,
                )
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: choice $type:ident::$default:ident, $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!($meaning, "."),
                $name: $type = $type::$default,
                key(stringify!($name), Allowed::Choice($type::WORDS), $meaning)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: switch $default:expr, $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!($meaning, "."),
                $name: bool = $default,
                key(stringify!($name), Allowed::Switch, $meaning)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: list $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                []
                concat!($meaning, "."),
                $name: Vec<String> = Vec::new(),
                key(stringify!($name), Allowed::List, $meaning)
            } $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: csv $column:literal, $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @field $head $done $shared
            $name: csv ["time_s", $column], $meaning; $($rest)*
        }
    };
    (@field $head:tt $done:tt $shared:tt
        $name:ident: csv [$($column:literal),*], $meaning:literal; $($rest:tt)*
    ) => {
        $crate::declare::table! {
            @add $head $done $shared {
                [#[serde(skip_serializing_if = "Option::is_none")]]
                concat!($meaning, ": the path of a CSV file with the columns" $(, " ", $column)*, "."),
                $name: Option<std::path::PathBuf> = None,
                key(stringify!($name), Allowed::Csv { columns: &[$($column),*] }, $meaning)
            } $($rest)*
        }
    };

    (@add $head:tt [$($done:tt)*] $shared:tt $field:tt $($rest:tt)*) => {
        $crate::declare::table! { @field $head [$($done)* $field] $shared $($rest)* }
    };

    (@field [
            [$(#[$attribute:meta])*] [$path:literal, $meaning:literal $(, $flag:ident)*]
            $struct:ident [$($core:path)?]
        ]
        [$({
            [$($serde:tt)*] $doc:expr, $name:ident: $type:ty = $default:expr, $key:expr
        })*]
        $shared:tt
    ) => {
        #[doc = concat!("`[", $path, "]`: ", $meaning, ".")]
        $(#[$attribute])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $struct {
            $(
                #[doc = $doc]
                $($serde)*
                pub $name: $type,
            )*
        }

        impl Default for $struct {
            fn default() -> Self {
                Self { $($name: $default),* }
            }
        }

        impl $struct {
            const KEYS: &[$crate::key::Key] = {
                use $crate::declare::*;
                &[$($key),*]
            };

            /// The schema's entry.
            pub const TABLE: $crate::key::Table =
                $crate::key::Table::new($path, $meaning, Self::KEYS)$(.$flag())*;
        }

        $crate::declare::table! { @core $struct [$($core)?] $shared }
    };

    (@core $struct:ident [] []) => {};
    (@core $struct:ident [$core:path] [$($shared:ident)*]) => {
        impl $struct {
            /// The fields that the core shares, in its f32.
            pub fn core(&self) -> $core {
                $core { $($shared: self.$shared as f32),* }
            }

            /// Takes the shared fields from the core.
            pub fn take(&mut self, core: &$core) {
                $(self.$shared = $crate::short(core.$shared);)*
            }
        }
    };
}

/// The unit in a field's documentation; empty for a ratio.
macro_rules! unit {
    ("") => {
        ""
    };
    ($unit:tt) => {
        concat!(" \\[", $unit, "\\]")
    };
}

/// Declares an enum of the scenario, each variant with the word that a user writes.
macro_rules! choice {
    (
        $(#[$attribute:meta])*
        $enum:ident {
            $($(#[$variant_attribute:meta])* $variant:ident = $word:literal,)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $enum {
            $(
                $(#[$variant_attribute])*
                #[serde(rename = $word)]
                $variant,
            )*
        }

        impl $enum {
            /// The words in a file, in the order of the variants.
            pub const WORDS: &[&str] = &[$($word),*];

            /// The word in a file.
            #[allow(dead_code)]
            pub const fn word(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)*
                }
            }
        }
    };
}

pub(crate) use {choice, table, unit};
