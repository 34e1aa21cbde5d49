//! `trace.mcap`: the rows of `trace.csv` for PlotJuggler, Foxglove and Rerun, <https://mcap.dev>.
//!
//! Each row gives one JSON message per topic of [`TOPICS`], with a schema that states units; its
//! time is the row's `time_s`. Chunks are written whole, so that a truncated file can be read up
//! to the last whole chunk.

use super::topics::{TOPICS, write_json};
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Seek, Write};
use std::time::{Duration, Instant};
use thermyo_record::board_trace::every_column;
use thermyo_record::sinks::Sink;

/// Longest time that messages wait.
const LONGEST_WAIT: Duration = Duration::from_millis(500);
/// Size of a chunk in bytes: about a hundred rows.
const CHUNK: u64 = 1 << 17;

pub struct McapLog<W: Write + Seek = File> {
    writer: Writer<W>,
    channels: Vec<Channel>,
    rows: u32,
    text: String,
    handed_over: Instant,
}

struct Channel {
    id: u16,
    /// Indices of its cells in a row, and their names.
    cells: Vec<(usize, &'static str)>,
}

impl<W: Write + Seek> McapLog<W> {
    /// Begins with the topics and their schemas.
    pub fn new(out: W) -> io::Result<Self> {
        // Without seeking, a chunk is gathered in memory and written at once.
        let options = WriteOptions::new()
            .library(concat!("thermyo ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK))
            .disable_seeking(true);
        let mut writer = Writer::with_options(out, options).map_err(unwritable)?;
        let all = every_column();
        let mut channels = Vec::new();
        for topic in TOPICS {
            let schema = topic.json_schema().to_string();
            let id = writer
                .add_schema(topic.schema, "jsonschema", schema.as_bytes())
                .and_then(|schema| writer.add_channel(schema, topic.name, "json", &BTreeMap::new()))
                .map_err(unwritable)?;
            let cells = topic.places().into_iter().map(|place| (place, all[place])).collect();
            channels.push(Channel { id, cells });
        }
        writer.flush().map_err(unwritable)?;
        let handed_over = Instant::now();
        Ok(Self { writer, channels, rows: 0, text: String::with_capacity(512), handed_over })
    }
}

impl<W: Write + Seek + Send> Sink for McapLog<W> {
    fn row(&mut self, cells: &[f64]) -> io::Result<()> {
        let log_time = nanoseconds(cells[0]);
        for channel in &self.channels {
            self.text.clear();
            let known =
                channel.cells.iter().map(|(place, name)| (*name, cells.get(*place).copied()));
            write_json(&mut self.text, known);
            let header = MessageHeader {
                channel_id: channel.id,
                sequence: self.rows,
                log_time,
                publish_time: log_time,
            };
            self.writer
                .write_to_known_channel(&header, self.text.as_bytes())
                .map_err(unwritable)?;
        }
        self.rows = self.rows.wrapping_add(1);
        self.hand_over_in_time()
    }

    fn hand_over_in_time(&mut self) -> io::Result<()> {
        if self.handed_over.elapsed() < LONGEST_WAIT {
            return Ok(());
        }
        self.hand_over()
    }

    fn hand_over(&mut self) -> io::Result<()> {
        self.handed_over = Instant::now();
        self.writer.flush().map_err(unwritable)
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.writer.finish().map(drop).map_err(unwritable)
    }
}

/// Logs have whole nanoseconds.
fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

fn unwritable(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(format!("trace.mcap: {other}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::MessageStream;
    use mcap::read::Options;
    use serde_json::Value;
    use std::sync::{Arc, Mutex};

    /// Memory that a log and a test share.
    #[derive(Clone, Default)]
    struct Memory(Arc<Mutex<io::Cursor<Vec<u8>>>>);

    impl Memory {
        fn bytes(&self) -> Vec<u8> {
            self.0.lock().unwrap().get_ref().clone()
        }
    }

    impl Write for Memory {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Memory {
        fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
            self.0.lock().unwrap().seek(to)
        }
    }

    fn row(number: u32) -> Vec<f64> {
        let mut cells = vec![f64::from(number) * 0.001 / 3.0; every_column().len()];
        cells[0] = f64::from(number) * 0.01;
        cells
    }

    /// Messages up to the damage.
    fn messages(bytes: &[u8]) -> Vec<(String, u64, Value)> {
        let Ok(stream) = MessageStream::new_with_options(bytes, Options::IgnoreEndMagic.into())
        else {
            return Vec::new();
        };
        stream
            .map_while(Result::ok)
            .map(|message| {
                let value = serde_json::from_slice(&message.data).unwrap();
                (message.channel.topic.clone(), message.log_time, value)
            })
            .collect()
    }

    #[test]
    fn a_file_that_is_cut_anywhere_reads_up_to_the_cut() {
        let memory = Memory::default();
        let mut log = Box::new(McapLog::new(memory.clone()).unwrap());
        // Bytes after each chunk, and the rows in them.
        let mut ends = vec![(memory.bytes().len(), 0)];
        for number in 0..400 {
            log.row(&row(number)).unwrap();
            if number % 40 == 39 {
                log.hand_over().unwrap();
                ends.push((memory.bytes().len(), number + 1));
            }
        }
        log.finish().unwrap();
        let whole = memory.bytes();
        let all = messages(&whole);
        assert_eq!(all.len(), 400 * TOPICS.len());
        let last_end = ends.last().unwrap().0;
        for cut in (0..whole.len()).step_by(997).chain(ends.iter().map(|(end, _)| *end)) {
            let read = messages(&whole[..cut]);
            let rows = ends.iter().rev().find(|(end, _)| *end <= cut).map_or(0, |(_, rows)| *rows);
            assert!(
                read.len() >= rows as usize * TOPICS.len(),
                "cut at {cut}: {} read",
                read.len()
            );
            assert_eq!(read[..], all[..read.len()], "cut at {cut}");
        }
        assert!(last_end < whole.len(), "an index follows");
        let (topic, time_ns, first) = &all[TOPICS.len()];
        assert_eq!((topic.as_str(), *time_ns), ("/muscle", 10_000_000));
        assert_eq!(first["pressure_pa"].as_f64(), Some(0.001 / 3.0));
    }

    #[test]
    fn nothing_waits_for_a_second() {
        let memory = Memory::default();
        let mut log = McapLog::new(memory.clone()).unwrap();
        log.row(&row(0)).unwrap();
        assert!(messages(&memory.bytes()).is_empty(), "at once would be a chunk per row");
        std::thread::sleep(LONGEST_WAIT);
        log.hand_over_in_time().unwrap();
        assert_eq!(messages(&memory.bytes()).len(), TOPICS.len());
        std::thread::sleep(LONGEST_WAIT);
        log.row(&row(1)).unwrap();
        assert_eq!(messages(&memory.bytes()).len(), 2 * TOPICS.len());
    }
}
