//! Records of an MCAP file, <https://mcap.dev/spec>: JSON messages in uncompressed chunks, with an index. The format's
//! own crate needs seventeen others; the tests use it to read what is written here.

use std::io::{self, Write};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Size of a chunk in bytes: about a hundred rows.
const CHUNK: usize = 1 << 17;

/// A topic, its schema's name, and the schema.
pub(crate) struct Channel {
    pub(crate) topic: &'static str,
    pub(crate) schema: &'static str,
    pub(crate) json_schema: String,
}

pub(crate) struct Writer<W: Write> {
    out: W,
    position: u64,
    /// Schemas and channels, which the summary repeats.
    definitions: Vec<u8>,
    chunk: Chunk,
    chunk_indexes: Vec<u8>,
    chunks: u32,
    /// Earliest and latest time, and number of messages of each channel.
    span_ns: Option<(u64, u64)>,
    counts: Vec<u64>,
}

/// Messages that are not yet written.
struct Chunk {
    records: Vec<u8>,
    span_ns: Option<(u64, u64)>,
    /// For each channel, the time and the offset of every message.
    places: Vec<Vec<(u64, u64)>>,
}

impl Chunk {
    fn new(channels: usize) -> Self {
        Self { records: Vec::new(), span_ns: None, places: vec![Vec::new(); channels] }
    }
}

impl<W: Write> Writer<W> {
    /// Writes the header and the definitions of the channels.
    pub(crate) fn new(out: W, channels: &[Channel]) -> io::Result<Self> {
        let mut definitions = Vec::new();
        for (id, channel) in (0_u16..).zip(channels) {
            // Schema 0 stands for none.
            let schema = (id + 1).to_le_bytes();
            let [name, encoding] =
                [channel.schema, "jsonschema"].map(|text| block(text.as_bytes()));
            let content = block(channel.json_schema.as_bytes());
            record(&mut definitions, 0x03, &[&schema, &name, &encoding, &content]);
            let [topic, encoding] = [channel.topic, "json"].map(|text| block(text.as_bytes()));
            let metadata = block(&[]);
            let id = id.to_le_bytes();
            record(&mut definitions, 0x04, &[&id, &schema, &topic, &encoding, &metadata]);
        }
        let mut writer = Self {
            out,
            position: 0,
            definitions,
            chunk: Chunk::new(channels.len()),
            chunk_indexes: Vec::new(),
            chunks: 0,
            span_ns: None,
            counts: vec![0; channels.len()],
        };
        let mut head = MAGIC.to_vec();
        let library = concat!("thermyo ", env!("CARGO_PKG_VERSION"));
        record(&mut head, 0x01, &[&block(&[]), &block(library.as_bytes())]);
        head.extend_from_slice(&writer.definitions);
        writer.write(&head)?;
        Ok(writer)
    }

    /// Adds a message to the chunk, and writes the chunk once it is full.
    pub(crate) fn message(
        &mut self,
        channel: usize,
        sequence: u32,
        time_ns: u64,
        data: &[u8],
    ) -> io::Result<()> {
        let [time, id] = [time_ns, channel as u64].map(u64::to_le_bytes);
        self.chunk.places[channel].push((time_ns, self.chunk.records.len() as u64));
        self.chunk.span_ns = Some(widened(self.chunk.span_ns, (time_ns, time_ns)));
        let content: [&[u8]; 5] = [&id[..2], &sequence.to_le_bytes(), &time, &time, data];
        record(&mut self.chunk.records, 0x05, &content);
        if self.chunk.records.len() < CHUNK {
            return Ok(());
        }
        self.write_chunk()
    }

    pub(crate) fn flush(&mut self) -> io::Result<()> {
        self.write_chunk()?;
        self.out.flush()
    }

    /// Writes the chunk at once, followed by the positions of its messages.
    fn write_chunk(&mut self) -> io::Result<()> {
        let chunk = std::mem::replace(&mut self.chunk, Chunk::new(self.counts.len()));
        let Some(span_ns) = chunk.span_ns else { return Ok(()) };
        let [first, last] = [span_ns.0, span_ns.1].map(u64::to_le_bytes);
        let size = (chunk.records.len() as u64).to_le_bytes();
        let crc = crc32fast::hash(&chunk.records).to_le_bytes();
        let uncompressed = block(&[]);
        let mut bytes = Vec::with_capacity(chunk.records.len() + chunk.records.len() / 4);
        let content: [&[u8]; 7] =
            [&first, &last, &size, &crc, &uncompressed, &size, &chunk.records];
        record(&mut bytes, 0x06, &content);
        let chunk_length = bytes.len() as u64;
        let mut indexes = Vec::new();
        for (id, (places, count)) in (0_u16..).zip(chunk.places.iter().zip(&mut self.counts)) {
            indexes.extend(id.to_le_bytes());
            indexes.extend((self.position + bytes.len() as u64).to_le_bytes());
            *count += places.len() as u64;
            let places: Vec<u8> = places
                .iter()
                .flat_map(|(time_ns, offset)| [time_ns.to_le_bytes(), offset.to_le_bytes()])
                .flatten()
                .collect();
            record(&mut bytes, 0x07, &[&id.to_le_bytes(), &block(&places)]);
        }
        let [start, length, index_length] =
            [self.position, chunk_length, bytes.len() as u64 - chunk_length].map(u64::to_le_bytes);
        let indexes = block(&indexes);
        let content: [&[u8]; 9] =
            [&first, &last, &start, &length, &indexes, &index_length, &uncompressed, &size, &size];
        record(&mut self.chunk_indexes, 0x08, &content);
        self.chunks += 1;
        self.span_ns = Some(widened(self.span_ns, span_ns));
        self.write(&bytes)
    }

    /// Writes the last chunk and the summary.
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        self.write_chunk()?;
        let no_checksum = 0_u32.to_le_bytes();
        let mut end = Vec::new();
        record(&mut end, 0x0f, &[&no_checksum]);
        self.write(&end)?;

        let mut summary = self.definitions.clone();
        summary.extend_from_slice(&self.chunk_indexes);
        record(&mut summary, 0x0b, &[&self.statistics()]);
        // The footer's record begins within the checksum of the summary.
        let start = self.position.to_le_bytes();
        let no_offsets = 0_u64.to_le_bytes();
        record(&mut summary, 0x02, &[&start, &no_offsets, &no_checksum]);
        let checked = summary.len() - no_checksum.len();
        let crc = crc32fast::hash(&summary[..checked]).to_le_bytes();
        summary[checked..].copy_from_slice(&crc);
        summary.extend_from_slice(MAGIC);
        self.write(&summary)?;
        self.out.flush()
    }

    fn statistics(&self) -> Vec<u8> {
        let channels = self.counts.len();
        let (first, last) = self.span_ns.unwrap_or_default();
        let mut bytes = self.counts.iter().sum::<u64>().to_le_bytes().to_vec();
        bytes.extend((channels as u16).to_le_bytes());
        // Channels, attachments, metadata, chunks.
        bytes.extend([channels as u32, 0, 0, self.chunks].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend([first, last].into_iter().flat_map(u64::to_le_bytes));
        let counts = (0_u16..).zip(&self.counts);
        let counts: Vec<u8> = counts
            .flat_map(|(id, count)| id.to_le_bytes().into_iter().chain(count.to_le_bytes()))
            .collect();
        bytes.extend(block(&counts));
        bytes
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.position += bytes.len() as u64;
        self.out.write_all(bytes)
    }
}

fn widened(span_ns: Option<(u64, u64)>, (first, last): (u64, u64)) -> (u64, u64) {
    span_ns.map_or((first, last), |(from, to)| (from.min(first), to.max(last)))
}

/// Bytes preceded by their length: a text, an array or a map.
fn block(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

/// Appends a record: its kind, its length, its fields.
fn record(to: &mut Vec<u8>, opcode: u8, fields: &[&[u8]]) {
    let length = fields.iter().map(|field| field.len() as u64).sum::<u64>();
    to.push(opcode);
    to.extend(length.to_le_bytes());
    fields.iter().for_each(|field| to.extend_from_slice(field));
}
