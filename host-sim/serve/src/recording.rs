//! A recording: every step of the link, written by a separate thread.

use super::results::{Outcome, next_folder};
use super::shared::Shared;
use super::state::{Recorded, Weight};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_logs::Logs;
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_studies::drive::{ConfigOf, Record, TelemetryOf};

/// Longest interval at which rows are flushed to the file.
const HAND_OVER: Duration = Duration::from_millis(500);

pub struct Recording<R: Record> {
    parts: Sender<Part<R>>,
    rows: Arc<AtomicU64>,
    began: Instant,
    thread: JoinHandle<()>,
}

/// Messages to the thread. The channel is unbounded: a disk that stalls for a while costs memory,
/// not rows.
enum Part<R: Record> {
    Step(Option<Status>, TelemetryOf<R>),
    End(Status, Timing),
}

impl<R: Record> Recording<R> {
    /// Starts a recording in a folder of `out` and at `logs`, with the board's configuration.
    ///
    /// # Errors
    /// If a file cannot be created, or no scenario can express the configuration.
    pub fn begin(
        out: &Path,
        logs: &Logs,
        port: &str,
        config: &ConfigOf<R>,
        shared: Arc<Shared>,
    ) -> Result<Self, InputError> {
        let record = R::of_board(config)?;
        let (folder, name) = next_folder(out, "record");
        let mut files = OutputDir::create(&folder)?;
        files.text("scenario.toml", &record.scenario())?;
        let recorder = logs.record(&mut files, R::LAYOUT, &(R::LAYOUT.columns)())?;
        let (parts, received) = mpsc::channel();
        let rows = Arc::new(AtomicU64::new(0));
        let (port, config) = (port.to_owned(), *config);
        let counted = Arc::clone(&rows);
        let writer = Writer::<R> { name, port, config, files, recorder, record, rows: counted };
        let thread = thread::spawn(move || writer.run(&received, &shared));
        Ok(Self { parts, rows, began: Instant::now(), thread })
    }

    pub fn step(&self, status: Option<Status>, telemetry: &TelemetryOf<R>) {
        // A write error has been reported already.
        let _ = self.parts.send(Part::Step(status, *telemetry));
    }

    /// Number of rows, and time, so far.
    pub fn recorded(&self) -> Recorded {
        let time_s = (self.began.elapsed().as_secs_f64() * 10.0).round() / 10.0;
        Recorded { rows: self.rows.load(Ordering::Relaxed), time_s }
    }

    /// Whether the thread has ended by itself.
    pub fn has_failed(&self) -> bool {
        self.thread.is_finished()
    }

    /// Ends the recording. Its thread, which writes the report, is returned.
    pub fn end(self, status: Status, timing: Timing) -> JoinHandle<()> {
        let _ = self.parts.send(Part::End(status, timing));
        self.thread
    }
}

/// State of the thread.
struct Writer<R: Record> {
    name: String,
    port: String,
    config: ConfigOf<R>,
    files: OutputDir,
    recorder: Recorder,
    record: R,
    rows: Arc<AtomicU64>,
}

impl<R: Record> Writer<R> {
    fn run(mut self, parts: &Receiver<Part<R>>, shared: &Shared) {
        loop {
            let written = match parts.recv_timeout(HAND_OVER) {
                Ok(Part::Step(status, telemetry)) => self.write(status.as_ref(), &telemetry),
                Ok(Part::End(status, timing)) => return self.finish(&status, &timing, shared),
                Err(RecvTimeoutError::Timeout) => self.recorder.hand_over(),
                // The operator has ended: the files stay in their working folder.
                Err(RecvTimeoutError::Disconnected) => return drop(self.files.leave()),
            };
            if let Err(error) = written {
                let error = self.files.unwritable(R::LAYOUT.file, &error);
                let left = self.files.leave();
                let text =
                    format!("recording: {error}; the record so far is in {}", left.display());
                return shared.log(Weight::Fault, text);
            }
        }
    }

    fn write(&mut self, status: Option<&Status>, telemetry: &TelemetryOf<R>) -> io::Result<()> {
        let row = R::write(&mut self.recorder, &self.config, status, telemetry)?;
        self.record.add(&row);
        self.rows.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn finish(self, status: &Status, timing: &Timing, shared: &Shared) {
        let Self { name, port, mut files, recorder, mut record, .. } = self;
        let folder = files.path().to_path_buf();
        let rows = recorder.rows();
        record.cut();
        let (scenario, steps) = (record.scenario(), record.steps());
        let text = format!("{:.1} s, {rows} steps, {} lost", steps.last_s, steps.lost);
        let (summary, report) = record.finish(&name, (&port, status, timing), None);
        let summary = serde_json::to_string_pretty(&summary).expect("plain data") + "\n";
        let written = recorder.finish().map_err(|error| files.unwritable(R::LAYOUT.file, &error));
        let published = written.and_then(|_| {
            files.text("scenario.toml", &scenario)?;
            files.text("summary.json", &summary)?;
            files.text("report.html", &report)?;
            files.publish().map(drop)
        });
        match published {
            Ok(()) => {
                shared.log(Weight::Plain, format!("recorded in {}: {text}", folder.display()));
                shared.add_result(Outcome { name, folder, text, trace: R::STUDIED });
            }
            Err(error) => shared.log(Weight::Fault, format!("recording: {error}")),
        }
    }
}
