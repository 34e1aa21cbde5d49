//! The two points of a calibration, whose reference a Python function reads.

use crate::error::{self, BoardError};
use crate::experiments::Watch;
use crate::held::Held;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_simulation::board;
use thermyo_studies::calibrate::{self, Calibrated, Dialogue, Sensor, wait};

/// Number of refusals after which a point is given up: a program that reads a reference would try without end.
const MOST_REFUSALS: u32 = 3;
/// Pause between two uses of the board, in which other threads get it.
const PAUSE: Duration = Duration::from_millis(1);

const SENSORS: [(&str, Sensor); 3] =
    [("pressure", Sensor::Pressure), ("length", Sensor::Length), ("gas", Sensor::Gas)];

/// Calibrates a sensor. Any exception vents.
pub fn calibrate(
    py: Python<'_>,
    board: &Held,
    sensor: &str,
    reference: Bound<'_, PyAny>,
    hold_pa: Option<f32>,
) -> PyResult<Calibrated> {
    let known = SENSORS.iter().find(|(name, _)| *name == sensor);
    let (_, sensor) = known.ok_or_else(|| {
        let names = SENSORS.map(|(name, _)| name).join(", ");
        PyValueError::new_err(format!("sensor = {sensor:?}: must be one of {names}"))
    })?;
    if !reference.is_callable() {
        let text = "reference: must be a function that gets the question and returns the reading";
        return Err(PyTypeError::new_err(text));
    }
    let (notes, refusals) = (String::new(), 0);
    let mut reader = Reader { py, board, reference, notes, refusals, raised: None };
    let calibrated = calibrate::calibrate(&mut reader, *sensor, hold_pa);
    let raised = reader.raised;
    calibrated.map_err(|error| {
        // The board is vented whatever happened first; if it cannot be reached then, that is not the cause.
        let _ = board.with(py, |live| live.stop().map_err(error::board));
        raised.unwrap_or_else(|| match error {
            calibrate::CalibrateError::Board(error) => error::board(error),
            unfinished => BoardError::new_err(unfinished.to_string()),
        })
    })
}

/// Reads the reference by a Python function.
struct Reader<'a, 'py> {
    py: Python<'py>,
    board: &'a Held,
    reference: Bound<'py, PyAny>,
    /// Lines for the next question.
    notes: String,
    /// Refusals of the current point.
    refusals: u32,
    /// The exception that ends the calibration.
    raised: Option<PyErr>,
}

impl Dialogue for Reader<'_, '_> {
    type Board = LiveBoard;

    fn board<T: Send>(
        &mut self,
        using: impl FnOnce(&mut LiveBoard, &dyn Fn() -> bool) -> Result<T, board::BoardError> + Send,
    ) -> Result<T, board::BoardError> {
        let used = self.board.with(self.py, |live| {
            let watch = Watch::new();
            let used = using(live, &|| watch.stopped());
            watch.raise()?;
            used.map_err(error::board)
        });
        self.or_end(used)
    }

    fn ask(
        &mut self,
        question: &str,
        refused: Option<&str>,
    ) -> Result<Option<String>, board::BoardError> {
        self.refusals = refused.map_or(0, |_| self.refusals + 1);
        if self.refusals == MOST_REFUSALS {
            return Ok(None);
        }
        if let Some(why) = refused {
            self.say(why);
        }
        let question = std::mem::take(&mut self.notes) + question;
        let answer = self.answer(&question);
        self.or_end(answer).map(Some)
    }

    fn say(&mut self, text: &str) {
        self.notes += text;
        self.notes.push('\n');
    }
}

impl Reader<'_, '_> {
    /// Keeps an exception for the end.
    fn or_end<T>(&mut self, outcome: PyResult<T>) -> Result<T, board::BoardError> {
        outcome.map_err(|raised| {
            self.raised.get_or_insert(raised);
            board::BoardError::Interrupted
        })
    }

    /// The answer of the function, as text. Another thread keeps the board alive meanwhile.
    fn answer(&self, question: &str) -> PyResult<String> {
        let (board, answered) = (self.board, AtomicBool::new(false));
        thread::scope(|scope| {
            let kept = scope.spawn(|| keep_alive(board, &answered));
            let answer =
                self.reference.call1((question,)).and_then(|read| Ok(read.str()?.to_string()));
            answered.store(true, Ordering::Relaxed);
            let kept = self.py.detach(|| kept.join());
            let kept = kept.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            answer.and_then(|answer| kept.map(|()| answer))
        })
    }
}

/// Keeps the board alive until the reference is read. The function that reads it may use the board.
fn keep_alive(board: &Held, answered: &AtomicBool) -> PyResult<()> {
    let is_answered = || answered.load(Ordering::Relaxed);
    while !is_answered() {
        match board.lock().as_mut().map(|live| wait(live, &is_answered, |_| true)) {
            None => return Err(BoardError::new_err("the board is closed")),
            Some(Err(board::BoardError::Interrupted)) => {}
            Some(kept) => kept.map_err(error::board)?,
        }
        thread::sleep(PAUSE);
    }
    Ok(())
}
