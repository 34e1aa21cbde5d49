//! A recording: every step of the link, written by a separate thread.

use super::results::{Outcome, next_folder};
use super::shared::Shared;
use super::state::{Recorded, Weight};
use model_core::Config;
use model_core::Telemetry;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_logs::Logs;
use thermyo_logs::topics::MUSCLE;
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_scenario::DriveKind;
use thermyo_setup::{Loaded, from_config};
use thermyo_studies::drive;
use thermyo_studies::drive::{Drawn, Gathered};

/// Rows are flushed to the file at least at this interval.
const HAND_OVER: Duration = Duration::from_millis(500);

pub struct Recording {
    parts: Sender<Part>,
    rows: Arc<AtomicU64>,
    began: Instant,
    thread: JoinHandle<()>,
}

/// Messages to the thread. The channel is unbounded: a disk that stalls for a while costs memory,
/// not rows.
enum Part {
    Step(Option<Status>, Telemetry),
    End(Status, Timing),
}

impl Recording {
    /// Starts a recording in a folder of `out` and at `logs`, with the board's configuration.
    ///
    /// # Errors
    /// If no file can be created, or no scenario expresses the configuration.
    pub fn begin(
        out: &Path,
        logs: &Logs,
        port: &str,
        config: Config,
        shared: Arc<Shared>,
    ) -> Result<Self, InputError> {
        let mut configured = from_config::to_scenario(&config)?.scenario;
        // The user drives the muscle.
        (configured.plant.drive.kind, configured.believed.drive.kind) =
            (DriveKind::Closed, DriveKind::Closed);
        let (folder, name) = next_folder(out, "record");
        let mut files = OutputDir::create(&folder)?;
        files.text("scenario.toml", &thermyo_setup::render(&configured))?;
        let recorder = Recorder::new(files.file("trace.csv")?)
            .map_err(|error| files.unwritable("trace.csv", &error))?
            .beside(logs.open(&mut files, MUSCLE)?);
        let (parts, received) = mpsc::channel();
        let rows = Arc::new(AtomicU64::new(0));
        let writer = Writer {
            name,
            port: port.to_owned(),
            config,
            gathered: Gathered::of_record(&configured),
            configured,
            files,
            recorder,
            drawn: Drawn::new(),
            rows: Arc::clone(&rows),
        };
        let thread = thread::spawn(move || writer.run(&received, &shared));
        Ok(Self { parts, rows, began: Instant::now(), thread })
    }

    pub fn step(&self, status: Option<Status>, telemetry: &Telemetry) {
        // A write error has been reported already.
        let _ = self.parts.send(Part::Step(status, *telemetry));
    }

    /// Rows and time so far.
    pub fn recorded(&self) -> Recorded {
        let time_s = (self.began.elapsed().as_secs_f64() * 10.0).round() / 10.0;
        Recorded { rows: self.rows.load(Ordering::Relaxed), time_s }
    }

    /// Whether the thread has ended by itself.
    pub fn has_failed(&self) -> bool {
        self.thread.is_finished()
    }

    /// Ends the recording. Its thread writes the report, and is returned.
    pub fn end(self, status: Status, timing: Timing) -> JoinHandle<()> {
        let _ = self.parts.send(Part::End(status, timing));
        self.thread
    }
}

/// State of the thread.
struct Writer {
    name: String,
    port: String,
    config: Config,
    configured: Loaded,
    files: OutputDir,
    recorder: Recorder<File>,
    gathered: Gathered,
    drawn: Drawn,
    rows: Arc<AtomicU64>,
}

impl Writer {
    fn run(mut self, parts: &Receiver<Part>, shared: &Shared) {
        loop {
            let written = match parts.recv_timeout(HAND_OVER) {
                Ok(Part::Step(status, telemetry)) => self.write(status.as_ref(), &telemetry),
                Ok(Part::End(status, timing)) => return self.finish(&status, &timing, shared),
                Err(RecvTimeoutError::Timeout) => self.recorder.hand_over(),
                // The operator is gone: the files stay in their working folder.
                Err(RecvTimeoutError::Disconnected) => return drop(self.files.leave()),
            };
            if let Err(error) = written {
                let error = self.files.unwritable("trace.csv", &error);
                let left = self.files.leave();
                let text =
                    format!("recording: {error}; the record so far is in {}", left.display());
                return shared.log(Weight::Fault, text);
            }
        }
    }

    fn write(&mut self, status: Option<&Status>, telemetry: &Telemetry) -> std::io::Result<()> {
        let row = self.recorder.write(&self.config, status, telemetry)?;
        self.gathered.add(&row);
        self.drawn.add(&row);
        self.rows.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn finish(self, status: &Status, timing: &Timing, shared: &Shared) {
        let Self { name, port, mut configured, mut files, recorder, gathered, drawn, .. } = self;
        let folder = files.path().to_path_buf();
        let rows = gathered.rows();
        let summary = gathered.finish(&port, status, timing);
        configured.plant.run.duration_s = summary.duration_s.max(configured.plant.run.step_s);
        configured.believed.run = configured.plant.run.clone();
        let written = recorder.finish().map_err(|error| files.unwritable("trace.csv", &error));
        let json = serde_json::to_string_pretty(&summary).expect("plain data") + "\n";
        let published = written.and_then(|_| {
            files.text("scenario.toml", &thermyo_setup::render(&configured))?;
            files.text("summary.json", &json)?;
            files.text("report.html", &drive::page(&name, &configured, &drawn, &summary))?;
            files.publish().map(drop)
        });
        match published {
            Ok(()) => {
                let lost = summary.lost_steps;
                let text = format!("{:.1} s, {rows} steps, {lost} lost", summary.duration_s);
                shared.log(Weight::Plain, format!("recorded in {}: {text}", folder.display()));
                shared.add_result(Outcome { name, folder, text, trace: true });
            }
            Err(error) => shared.log(Weight::Fault, format!("recording: {error}")),
        }
    }
}
