//! Values of any type that serde can read, made from choices instead of text.

use arbitrary::Unstructured;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, SeqAccess,
    VariantAccess, Visitor,
};

pub trait Choices {
    fn real(&mut self) -> f32;
    /// A whole number of at most `bits` bits.
    fn whole(&mut self, bits: u32) -> u64;
    /// One of `count` choices.
    fn one_of(&mut self, count: u32) -> u32;
}

/// A value made of `choices`; `None` if they make none, such as a duty above 1.
pub fn value<T: DeserializeOwned>(choices: &mut impl Choices) -> Option<T> {
    T::deserialize(Chosen(choices)).ok()
}

/// Any bits, edge cases more often; zeros once the input has run out.
impl Choices for Unstructured<'_> {
    fn real(&mut self) -> f32 {
        const SPECIAL: [f32; 12] = [
            0.0,
            1.0,
            -0.0,
            -1.0,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MIN_POSITIVE,
            1.0e-40,
            -1.0e-40,
            f32::MAX,
            f32::EPSILON,
        ];
        match SPECIAL.get(usize::from(byte(self) % 24)) {
            Some(number) => *number,
            None => f32::from_bits(self.whole(32) as u32),
        }
    }

    fn whole(&mut self, bits: u32) -> u64 {
        (0..bits / 8).fold(0, |whole, _| whole << 8 | u64::from(byte(self)))
    }

    fn one_of(&mut self, count: u32) -> u32 {
        u32::from(byte(self)) % count.max(1)
    }
}

/// The next byte.
pub fn byte(bytes: &mut Unstructured) -> u8 {
    bytes.arbitrary().unwrap_or_default()
}

/// One of these values.
pub fn one_of<'a, T>(bytes: &mut Unstructured, all: &'a [T]) -> &'a T {
    let index = bytes.whole(if all.len() > 256 { 16 } else { 8 }) as usize;
    &all[index % all.len()]
}

struct Chosen<'a, C>(&'a mut C);

type Refused = de::value::Error;

macro_rules! whole_numbers {
    ($($deserialize:ident $visit:ident $type:ident),*) => {
        $(fn $deserialize<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refused> {
            visitor.$visit(self.0.whole($type::BITS) as $type)
        })*
    };
}

impl<'de, C: Choices> Deserializer<'de> for Chosen<'_, C> {
    type Error = Refused;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Refused> {
        Err(de::Error::custom("a type that the wire does not have"))
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refused> {
        visitor.visit_bool(self.0.one_of(2) == 1)
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refused> {
        visitor.visit_f32(self.0.real())
    }

    whole_numbers!(
        deserialize_u8 visit_u8 u8,
        deserialize_u16 visit_u16 u16,
        deserialize_u32 visit_u32 u32,
        deserialize_u64 visit_u64 u64
    );

    /// As on the wire, where tables are their numbers without names.
    fn is_human_readable(&self) -> bool {
        false
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refused> {
        if self.0.one_of(2) == 0 { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Refused> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        count: usize,
        visitor: V,
    ) -> Result<V::Value, Refused> {
        visitor.visit_seq(Fields { choices: self.0, left: count })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refused> {
        self.deserialize_tuple(fields.len(), visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refused> {
        let variant = self.0.one_of(variants.len() as u32);
        visitor.visit_enum(Variant { choices: self.0, variant })
    }

    serde::forward_to_deserialize_any! {
        i8 i16 i32 i64 i128 u128 f64 char str string bytes byte_buf unit unit_struct seq tuple_struct
        map identifier ignored_any
    }
}

struct Fields<'a, C> {
    choices: &'a mut C,
    left: usize,
}

impl<'de, C: Choices> SeqAccess<'de> for Fields<'_, C> {
    type Error = Refused;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Refused> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        seed.deserialize(Chosen(self.choices)).map(Some)
    }
}

struct Variant<'a, C> {
    choices: &'a mut C,
    variant: u32,
}

impl<'de, C: Choices> EnumAccess<'de> for Variant<'_, C> {
    type Error = Refused;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Refused> {
        let variant = IntoDeserializer::<Refused>::into_deserializer(self.variant);
        Ok((seed.deserialize(variant)?, self))
    }
}

impl<'de, C: Choices> VariantAccess<'de> for Variant<'_, C> {
    type Error = Refused;

    fn unit_variant(self) -> Result<(), Refused> {
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Refused> {
        seed.deserialize(Chosen(self.choices))
    }

    fn tuple_variant<V: Visitor<'de>>(self, count: usize, visitor: V) -> Result<V::Value, Refused> {
        Chosen(self.choices).deserialize_tuple(count, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refused> {
        Chosen(self.choices).deserialize_tuple(fields.len(), visitor)
    }
}
