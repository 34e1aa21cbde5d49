//! The wire: random bytes, and valid frames.

use crate::any::{self, Choices, byte};
use arbitrary::Unstructured;
use serde::Serialize;
use serde::de::DeserializeOwned;
use thermyo_protocol::{Decoder, MAX_FRAME, Message, Request, encode};

const MOST_FRAMES: usize = 64;

/// Sends a stream; returns the number of its frames, including those of garbage.
pub fn run(bytes: &[u8]) -> u64 {
    let mut bytes = Unstructured::new(bytes);
    match byte(&mut bytes) % 4 {
        0 => {
            let bytes = bytes.take_rest();
            garbage::<Request>(bytes) + garbage::<Message>(bytes)
        }
        1 => stream::<Request>(&mut bytes),
        _ => stream::<Message>(&mut bytes),
    }
}

/// Random bytes. Each frame is a message or counts as malformed, and each message survives being sent again.
fn garbage<T: Serialize + DeserializeOwned>(bytes: &[u8]) -> u64 {
    let mut decoder = Decoder::new();
    let mut messages = 0;
    for byte in bytes {
        if let Some(message) = decoder.push::<T>(*byte) {
            sent::<T>(&message);
            messages += 1;
        }
    }
    let dropped = decoder.malformed();
    assert!(messages + dropped <= bytes.len() as u32, "{messages} messages, {dropped} dropped");
    u64::from(messages + dropped)
}

/// Frames of any messages, some of them damaged. A whole frame arrives, whatever comes before the zero that precedes
/// it.
fn stream<T: Serialize + DeserializeOwned>(bytes: &mut Unstructured) -> u64 {
    let mut decoder = Decoder::new();
    let mut frames = 0;
    while !bytes.is_empty() && frames < MOST_FRAMES {
        let Some(message) = any::value::<T>(bytes) else { continue };
        let frame = sent(&message);
        frames += 1;
        if bytes.one_of(2) == 0 {
            let arrived =
                frame.iter().filter_map(|byte| decoder.push::<T>(*byte)).collect::<Vec<_>>();
            let [arrived] = &arrived[..] else { panic!("{} messages in a frame", arrived.len()) };
            assert_eq!(encode(arrived).as_deref(), Ok(&frame[..]), "what arrives is what was sent");
        } else {
            let mut damaged = frame;
            let place = bytes.whole(16) as usize % damaged.len();
            match byte(bytes) % 4 {
                0 => damaged.truncate(place),
                1 => damaged.insert(place, byte(bytes)),
                2 => drop(damaged.remove(place)),
                _ => damaged[place] ^= byte(bytes),
            }
            for byte in damaged.iter().chain(&[0]) {
                if let Some(message) = decoder.push::<T>(*byte) {
                    sent::<T>(&message);
                }
            }
        }
    }
    frames as u64
}

/// The frame of a message: within its limit, with one zero, at its end.
fn sent<T: Serialize>(message: &T) -> Vec<u8> {
    let frame = encode(message).expect("every message fits a frame");
    assert!(frame.len() <= MAX_FRAME);
    let zero = frame.iter().position(|byte| *byte == 0);
    assert_eq!(zero, Some(frame.len() - 1), "{frame:?}");
    frame.to_vec()
}
