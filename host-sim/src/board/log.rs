//! The firmware's log: defmt frames over RTT, in words again with the image's own table.

use defmt_decoder::{DecodeError, Table};
use std::path::Path;

/// Ends a frame (defmt's rzCOBS encoding).
const END: u8 = 0;

/// Turns log bytes into lines.
pub struct LogDecoder {
    table: Table,
    bytes: Vec<u8>,
    lines: Vec<String>,
}

impl LogDecoder {
    /// A decoder for an image; `None` when it has no table of its logs, as a UF2 file.
    pub fn of_image(path: &Path) -> Option<Self> {
        let table = Table::parse(&std::fs::read(path).ok()?).ok()??;
        Some(Self { table, bytes: Vec::new(), lines: Vec::new() })
    }

    /// Takes bytes.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        let Some(end) = self.bytes.iter().rposition(|&byte| byte == END) else { return };
        let mut decoder = self.table.new_stream_decoder();
        decoder.received(&self.bytes[..=end]);
        loop {
            match decoder.decode() {
                Ok(frame) => self.lines.push(frame.display(false).to_string()),
                Err(DecodeError::UnexpectedEof) => break,
                // A damaged frame: the next one starts behind its end.
                Err(DecodeError::Malformed) => (),
            }
        }
        drop(decoder);
        self.bytes.drain(..=end);
    }

    /// Lines since the last call.
    pub fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.lines)
    }
}
