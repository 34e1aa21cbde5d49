//! The points of a page's charts, packed for the script that makes the charts interactive.
//!
//! Every array is stored once, even if several charts show it. A value is an integer of 16 or 32
//! bits between the array's ends, written in base64: a third of the size of digits.

use serde_json::{Value, json};
use std::collections::HashMap;

/// Resolution of a stored array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bits {
    /// 65 535 steps: finer than a screen.
    Sixteen,
    /// For zooming in over many decades: time, and logarithmic axes.
    ThirtyTwo,
}

impl Bits {
    fn count(self) -> u32 {
        match self {
            Self::Sixteen => 16,
            Self::ThirtyTwo => 32,
        }
    }

    /// Code of a gap; codes of numbers are lower.
    fn gap(self) -> u32 {
        match self {
            Self::Sixteen => u32::from(u16::MAX),
            Self::ThirtyTwo => u32::MAX,
        }
    }
}

#[derive(Debug, Default)]
pub(super) struct Store {
    arrays: Vec<Value>,
    known: HashMap<String, usize>,
}

impl Store {
    /// The number of an array with these values; values that are not finite are gaps.
    pub(super) fn add(&mut self, values: &[f64], bits: Bits) -> usize {
        let array = packed(values, bits);
        let next = self.arrays.len();
        let index = *self.known.entry(array.to_string()).or_insert(next);
        if index == next {
            self.arrays.push(array);
        }
        index
    }

    /// All arrays, in the order of their numbers.
    pub(super) fn into_arrays(self) -> Vec<Value> {
        self.arrays
    }
}

fn packed(values: &[f64], bits: Bits) -> Value {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = finite()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let (low, span) = if low <= high { (low, high - low) } else { (0.0, 0.0) };
    let steps = f64::from(bits.gap() - 1);
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| {
            let code = match value {
                value if !value.is_finite() => bits.gap(),
                _ if span == 0.0 => 0,
                value => ((value - low) / span * steps).round() as u32,
            };
            code.to_le_bytes().into_iter().take(bits.count() as usize / 8)
        })
        .collect();
    json!({ "bits": bits.count(), "low": low, "span": span, "data": base64(&bytes) })
}

/// RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0_u32, |word, (i, byte)| word | u32::from(*byte) << (16 - 8 * i));
        for digit in 0..4 {
            if digit > chunk.len() {
                text.push('=');
            } else {
                text.push(char::from(DIGITS[(word >> (18 - 6 * digit)) as usize & 63]));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_the_one_of_the_rfc() {
        for (bytes, text) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn an_array_is_kept_once_with_its_gaps() {
        let mut store = Store::default();
        assert_eq!(store.add(&[1.0, f64::NAN, 3.0], Bits::Sixteen), 0);
        assert_eq!(store.add(&[2.0, 2.0], Bits::ThirtyTwo), 1);
        assert_eq!(store.add(&[1.0, f64::NAN, 3.0], Bits::Sixteen), 0);
        let arrays = store.into_arrays();
        // 0, a gap, 65 534: least significant byte first.
        let data = base64(&[0, 0, 255, 255, 254, 255]);
        assert_eq!(arrays[0], json!({ "bits": 16, "low": 1.0, "span": 2.0, "data": data }));
        let data = base64(&[0; 8]);
        assert_eq!(arrays[1], json!({ "bits": 32, "low": 2.0, "span": 0.0, "data": data }));
    }
}
