//! `trace.mcap`: the rows of `trace.csv` for PlotJuggler, Foxglove and Rerun, <https://mcap.dev>.
//!
//! Each row gives one JSON message per topic of its [`Layout`], with a schema that states units; its
//! time is the row's `time_s`. Chunks are written whole, so that a truncated file can be read up
//! to the last whole chunk.

use super::topics::{Layout, write_json};
use crate::mcap_file::{Channel, Writer};
use std::fs::File;
use std::io::{self, Write};
use std::time::{Duration, Instant};
use thermyo_record::sinks::Sink;

const LONGEST_WAIT: Duration = Duration::from_millis(500);

pub struct McapLog<W: Write = File> {
    writer: Writer<W>,
    /// For each channel, the indices of its cells in a row, and their names.
    channels: Vec<Vec<(usize, &'static str)>>,
    rows: u32,
    text: String,
    handed_over: Instant,
}

impl<W: Write> McapLog<W> {
    /// Writes the topics and their schemas.
    pub fn new(out: W, layout: Layout) -> io::Result<Self> {
        let all = (layout.columns)();
        let cells = |place| (place, all[place]);
        let topics = layout.topics.iter();
        let channels = topics.map(|topic| topic.places(&all).into_iter().map(cells).collect());
        let channels = channels.collect();
        let topics = layout.topics.iter();
        let definitions = topics.map(|topic| Channel {
            topic: topic.name,
            schema: topic.schema,
            json_schema: topic.json_schema().to_string(),
        });
        let definitions: Vec<Channel> = definitions.collect();
        Ok(Self {
            writer: Writer::new(out, &definitions)?,
            channels,
            rows: 0,
            text: String::with_capacity(512),
            handed_over: Instant::now(),
        })
    }
}

impl<W: Write + Send> Sink for McapLog<W> {
    fn row(&mut self, cells: &[f64]) -> io::Result<()> {
        let log_time = nanoseconds(cells[0]);
        for (channel, columns) in self.channels.iter().enumerate() {
            self.text.clear();
            let known = columns.iter().map(|(place, name)| (*name, cells.get(*place).copied()));
            write_json(&mut self.text, known);
            self.writer.message(channel, self.rows, log_time, self.text.as_bytes())?;
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
        self.writer.flush()
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.writer.finish()
    }
}

/// Converts to the whole nanoseconds of logs.
fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::MUSCLE;
    use mcap::read::Options;
    use mcap::{Message, MessageStream, Summary};
    use serde_json::Value;
    use std::sync::{Arc, Mutex};
    use thermyo_record::board_trace::every_column;

    /// Memory that a log and a test share.
    #[derive(Clone, Default)]
    struct Memory(Arc<Mutex<Vec<u8>>>);

    impl Memory {
        fn bytes(&self) -> Vec<u8> {
            self.0.lock().unwrap().clone()
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

    fn row(number: u32) -> Vec<f64> {
        let mut cells = vec![f64::from(number) * 0.001 / 3.0; every_column().len()];
        cells[0] = f64::from(number) * 0.01;
        cells
    }

    /// Messages before the damage.
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
        let mut log = Box::new(McapLog::new(memory.clone(), MUSCLE).unwrap());
        // Bytes after each chunk, and the rows up to there.
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
        assert_eq!(all.len(), 400 * MUSCLE.topics.len());
        let last_end = ends.last().unwrap().0;
        for cut in (0..whole.len()).step_by(997).chain(ends.iter().map(|(end, _)| *end)) {
            let read = messages(&whole[..cut]);
            let rows = ends.iter().rev().find(|(end, _)| *end <= cut).map_or(0, |(_, rows)| *rows);
            assert!(
                read.len() >= rows as usize * MUSCLE.topics.len(),
                "cut at {cut}: {} read",
                read.len()
            );
            assert_eq!(read[..], all[..read.len()], "cut at {cut}");
        }
        assert!(last_end < whole.len(), "an index follows");
        let (topic, time_ns, first) = &all[MUSCLE.topics.len()];
        assert_eq!((topic.as_str(), *time_ns), ("/muscle", 10_000_000));
        assert_eq!(first["pressure_pa"].as_f64(), Some(0.001 / 3.0));
    }

    /// Reads by the index, as a viewer jumps in a long file, with the checksums verified.
    #[test]
    fn every_message_is_found_by_the_index() {
        let memory = Memory::default();
        let mut log = Box::new(McapLog::new(memory.clone(), MUSCLE).unwrap());
        for number in 0..400 {
            log.row(&row(number)).unwrap();
        }
        log.finish().unwrap();
        let whole = memory.bytes();
        let checked = MessageStream::new_with_options(&whole, Options::ValidateChunkCrcs.into());
        let mut all: Vec<_> = checked.unwrap().map(Result::unwrap).collect();
        let summary = Summary::read(&whole).unwrap().unwrap();
        let stats = summary.stats.as_ref().unwrap();
        assert_eq!(stats.message_count, 400 * MUSCLE.topics.len() as u64);
        assert_eq!((stats.message_start_time, stats.message_end_time), (0, 3_990_000_000));
        assert!(stats.channel_message_counts.values().all(|count| *count == 400));
        assert!(stats.chunk_count > 1 && stats.chunk_count as usize == summary.chunk_indexes.len());
        let mut found = Vec::new();
        for index in &summary.chunk_indexes {
            for place in summary.read_message_indexes(&whole, index).unwrap().values().flatten() {
                let message = summary.seek_message(&whole, index, place).unwrap();
                assert!(
                    (index.message_start_time..=index.message_end_time).contains(&message.log_time)
                );
                assert_eq!(message.log_time, place.log_time);
                found.push(message);
            }
        }
        let order = |message: &Message| (message.log_time, message.channel.topic.clone());
        found.sort_by_key(order);
        all.sort_by_key(order);
        assert!(found == all && all[0].channel.schema.as_ref().unwrap().name == "thermyo.Control");
        let footer = mcap::read::footer(&whole).unwrap();
        let checked = &whole[footer.summary_start as usize..whole.len() - 12];
        assert_eq!(footer.summary_crc, crc32fast::hash(checked));
    }

    #[test]
    fn nothing_waits_for_a_second() {
        let memory = Memory::default();
        let mut log = McapLog::new(memory.clone(), MUSCLE).unwrap();
        log.row(&row(0)).unwrap();
        assert!(messages(&memory.bytes()).is_empty(), "at once would be a chunk per row");
        std::thread::sleep(LONGEST_WAIT);
        log.hand_over_in_time().unwrap();
        assert_eq!(messages(&memory.bytes()).len(), MUSCLE.topics.len());
        std::thread::sleep(LONGEST_WAIT);
        log.row(&row(1)).unwrap();
        assert_eq!(messages(&memory.bytes()).len(), 2 * MUSCLE.topics.len());
    }
}
