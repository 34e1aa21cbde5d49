//! A parameter is declared once: name, unit, range, default and meaning. The struct that holds it, its default, its
//! check and its documentation follow from that, and so does the scenario's key on the host.
//!
//! # How to add a parameter
//!
//! Add one line in the `parameters!` of its table. Its name ends in the unit; the table's path and its name are the key
//! that a user writes, and that an error names. A key of `[estimator]` or `[controller]` is then part of the scenario;
//! `docs/reference/estimator-keys.md` and `docs/reference/controller-keys.md` have a row for each, which a test
//! compares. For the other tables the scenario lists the core's parameters that it takes: `declare.rs` in `host-sim`
//! has the rest of this list. The bytes of the configuration on the wire change: raise `PROTOCOL` in `link` and pin the
//! new bytes there.

use crate::math::{SMALLEST, absolute};

/// Declaration of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name of the parameter within its table.
    pub name: &'static str,
    /// Default; the core holds it in f32.
    pub default: f64,
    /// Unit in SI notation; empty for a ratio.
    pub unit: &'static str,
    /// Smallest permitted value.
    pub minimum: f64,
    /// Largest permitted value.
    pub maximum: f64,
    /// Meaning, as documents print it.
    pub meaning: &'static str,
}

/// Permitted range of a value, under the key that a user writes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limit {
    /// An image without keys has no room for a hundred empty ones.
    #[cfg(feature = "keys")]
    key: &'static str,
    minimum: f32,
    maximum: f32,
}

impl Limit {
    #[cfg(feature = "keys")]
    pub(crate) const fn new(key: &'static str, minimum: f32, maximum: f32) -> Self {
        Self { key, minimum, maximum }
    }

    #[cfg(not(feature = "keys"))]
    pub(crate) const fn new(_: &'static str, minimum: f32, maximum: f32) -> Self {
        Self { minimum, maximum }
    }

    #[cfg(feature = "keys")]
    const fn key(&self) -> &'static str {
        self.key
    }

    #[cfg(not(feature = "keys"))]
    const fn key(&self) -> &'static str {
        ""
    }
}

/// Checks values against their limits, in order.
pub(crate) fn check(values: &[f32], limits: &[Limit]) -> Result<(), ConfigError> {
    values
        .iter()
        .zip(limits)
        .try_for_each(|(value, limit)| within(limit.key(), *value, limit.minimum, limit.maximum))
}

/// A value that the core cannot work with.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ConfigError {
    /// Key of the scenario; for a converted value, with the converted quantity in brackets. Empty without the feature
    /// `keys`.
    pub field: &'static str,
    /// The refused value.
    pub value: f32,
    /// Smallest permitted value.
    pub minimum: f32,
    /// Largest permitted value.
    pub maximum: f32,
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { field, value, minimum, maximum } = self;
        if is_too_small(*value) {
            return write!(f, "{field} = {value:e}: must be 0, or {SMALLEST:e} or more in size");
        }
        write!(f, "{field} = {value}: must be from {minimum} to {maximum}")
    }
}

impl core::error::Error for ConfigError {}

/// The key, or nothing in an image that has no room for keys.
pub(crate) const fn named(key: &'static str) -> &'static str {
    if cfg!(feature = "keys") { key } else { "" }
}

/// Whether a processor that flushes subnormal numbers could compute different bits from this value.
fn is_too_small(value: f32) -> bool {
    // On such a processor a comparison with zero would also hold for a subnormal number.
    absolute(value) < SMALLEST && value.to_bits() << 1 != 0
}

/// Not inlined: it has some eighty calls.
#[inline(never)]
pub(crate) fn within(
    field: &'static str,
    value: f32,
    minimum: f32,
    maximum: f32,
) -> Result<(), ConfigError> {
    if value >= minimum && value <= maximum && !is_too_small(value) {
        Ok(())
    } else {
        Err(ConfigError { field: named(field), value, minimum, maximum })
    }
}

/// Declares a table of parameters: the struct, `Default`, `PARAMETERS` for printing, and `check`, whose errors name the
/// key that a user writes. On the wire a table is its values, in order; in a file it is a table of keys, each of which
/// may be omitted.
macro_rules! parameters {
    (
        $(#[$attribute:meta])*
        $table:literal: $struct:ident {
            $($name:ident: $default:literal, $unit:literal, $minimum:literal to $maximum:literal, $meaning:literal;)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $struct {
            $(
                #[doc = concat!($meaning, " \\[", $unit, "\\], from ", $minimum, " to ", $maximum, ".")]
                pub $name: f32,
            )*
        }

        impl Default for $struct {
            fn default() -> Self {
                // Copied from one place: a constant is written value by value, at ten bytes of code each.
                static DEFAULT: $struct = $struct { $($name: $default as f32),* };
                DEFAULT
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
            pub fn check(&self) -> Result<(), $crate::parameter::ConfigError> {
                const LIMITS: &[$crate::parameter::Limit] = &[
                    $($crate::parameter::Limit::new(
                        concat!($table, ".", stringify!($name)),
                        $minimum,
                        $maximum,
                    )),*
                ];
                $crate::parameter::check(&[$(self.$name),*], LIMITS)
            }
        }

        #[cfg(feature = "serde")]
        impl $crate::parameter::wire::Table for $struct {
            const PARAMETERS: &'static [$crate::parameter::Parameter] = Self::PARAMETERS;
        }

        #[cfg(feature = "serde")]
        impl serde::Serialize for $struct {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                $crate::parameter::wire::write::<S, Self>(serializer, &[$(self.$name),*])
            }
        }

        #[cfg(feature = "serde")]
        impl<'de> serde::Deserialize<'de> for $struct {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let Self { $($name),* } = Self::default();
                let mut values = [$($name),*];
                $crate::parameter::wire::read::<D, Self>(deserializer, &mut values)?;
                let [$($name),*] = values;
                Ok(Self { $($name),* })
            }
        }
    };
}

pub(crate) use parameters;

/// Tables on the wire and in files. The values are read and written by loops: derived code for each of some
/// eighty fields takes kilobytes of flash.
#[cfg(feature = "serde")]
pub(crate) mod wire {
    use super::Parameter;
    use core::fmt;
    use core::marker::PhantomData;
    use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
    use serde::ser::{SerializeMap, SerializeTuple, Serializer};

    /// A declared table. Data that only files need are a constant of its type: no other code refers to it, so it is not
    /// in the image.
    pub trait Table {
        const PARAMETERS: &'static [Parameter];
    }

    pub fn write<S: Serializer, T: Table>(
        serializer: S,
        values: &[f32],
    ) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            let mut map = serializer.serialize_map(Some(values.len()))?;
            for (parameter, value) in T::PARAMETERS.iter().zip(values) {
                map.serialize_entry(parameter.name, value)?;
            }
            map.end()
        } else {
            let mut tuple = serializer.serialize_tuple(values.len())?;
            for value in values {
                tuple.serialize_element(value)?;
            }
            tuple.end()
        }
    }

    /// A key that the file omits keeps its value.
    pub fn read<'de, D: Deserializer<'de>, T: Table>(
        deserializer: D,
        values: &mut [f32],
    ) -> Result<(), D::Error> {
        if deserializer.is_human_readable() {
            deserializer.deserialize_map(Keys::<T>(values, PhantomData))
        } else {
            deserializer.deserialize_tuple(values.len(), Values(values))
        }
    }

    struct Values<'a>(&'a mut [f32]);

    impl<'de> Visitor<'de> for Values<'_> {
        type Value = ();

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<(), A::Error> {
            for (place, value) in self.0.iter_mut().enumerate() {
                let next = from.next_element()?;
                *value = next.ok_or_else(|| A::Error::invalid_length(place, &"more numbers"))?;
            }
            Ok(())
        }
    }

    struct Keys<'a, T>(&'a mut [f32], PhantomData<T>);

    impl<'de, T: Table> Visitor<'de> for Keys<'_, T> {
        type Value = ();

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("a table of numbers")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<(), A::Error> {
            while let Some(place) = entries.next_key_seed(Key::<T>(PhantomData))? {
                let next = entries.next_value()?;
                if let Some(value) = self.0.get_mut(place) {
                    *value = next;
                }
            }
            Ok(())
        }
    }

    /// Index of a key in its table.
    struct Key<T>(PhantomData<T>);

    impl<'de, T: Table> DeserializeSeed<'de> for Key<T> {
        type Value = usize;

        fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<usize, D::Error> {
            deserializer.deserialize_identifier(self)
        }
    }

    impl<T: Table> Visitor<'_> for Key<T> {
        type Value = usize;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("a key")
        }

        fn visit_str<E: Error>(self, key: &str) -> Result<usize, E> {
            let place = T::PARAMETERS.iter().position(|parameter| parameter.name == key);
            place.ok_or_else(|| E::custom(format_args!("unknown key `{key}`")))
        }
    }
}
