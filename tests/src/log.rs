//! The firmware's log: defmt frames over RTT, decoded with the image's own table.

use defmt_decoder::{DecodeError, Table};
use std::path::Path;

/// Lines that an image has logged, from its first frame on.
pub fn lines(image: &Path, frames: &[u8]) -> Vec<String> {
    let image = std::fs::read(image).expect("an image");
    let table = Table::parse(&image).expect("an ELF file").expect("with a table of its logs");
    let mut decoder = table.new_stream_decoder();
    decoder.received(frames);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => lines.push(frame.display(false).to_string()),
            Err(DecodeError::UnexpectedEof) => return lines,
            // After a damaged frame, the next one starts behind its end.
            Err(DecodeError::Malformed) => (),
        }
    }
}
