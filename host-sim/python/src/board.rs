//! A flashed board, or the emulated one.

use crate::calibrate;
use crate::core::telemetry_dict;
use crate::error::{self, BoardError};
use crate::experiments;
use crate::held::Held;
use crate::run::{plain, results};
use crate::scenario;
use crate::set_point::set_point;
use model_core::Telemetry;
use model_core::safety::supervisor::VENTING;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use thermyo_boards::live::{LiveBoard, VIEW_DIVIDER};
use thermyo_boards::plug::plug_into_this_process;
use thermyo_boards::port::EMULATED;
use thermyo_boards::service;
use thermyo_boards::subject::Subject;
use thermyo_scenario::short;
use thermyo_setup::core_config::core_config;
use thermyo_setup::parse;
use thermyo_studies::stops::Asked;

/// Time without data after which a board is reported as gone.
const PATIENCE: Duration = Duration::from_secs(3);

/// A board. It vents when it is closed.
#[pyclass(frozen, module = "thermyo")]
pub struct Board {
    live: Held,
    /// Number of streams so far; only the latest receives telemetry.
    streams: AtomicU32,
}

impl Board {
    /// Sends a request without holding the interpreter's lock.
    fn ask<T: Send>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&mut LiveBoard) -> Result<T, thermyo_simulation::board::BoardError> + Send,
    ) -> PyResult<T> {
        self.live.with(py, |board| ask(board).map_err(error::board))
    }
}

#[pymethods]
impl Board {
    #[new]
    #[pyo3(signature = (port, scenario = None))]
    fn new(py: Python<'_>, port: &str, scenario: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let muscle = match scenario {
            Some(_) if port != EMULATED => {
                let text =
                    "scenario is the muscle of the board \"emulated\": another board has its own";
                return Err(PyValueError::new_err(text));
            }
            Some(scenario) => Some(scenario::load(scenario, None)?),
            None => None,
        };
        let live = py.detach(|| {
            if port == EMULATED && (muscle.is_some() || !service::is_plugged_in()) {
                let nominal = || parse("", Path::new("the nominal muscle"));
                let muscle = muscle.map_or_else(nominal, Ok).map_err(error::input)?;
                plug_into_this_process(muscle).map_err(error::board)?;
            }
            LiveBoard::open(port).map_err(error::board)
        })?;
        Ok(Self { live: Held::new(live), streams: AtomicU32::new(0) })
    }

    /// Identity and configuration of the board.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (version, status) = self.ask(py, |board| Ok((board.version(), board.status()?)))?;
        let info = plain(py, &status)?;
        info.set_item("config_name", status.config_name.as_str())?;
        info.set_item("version", plain(py, &version)?)?;
        Ok(info)
    }

    /// Sends the core's part of a scenario as a whole. The board vents and is not armed.
    #[pyo3(signature = (scenario))]
    fn configure(&self, py: Python<'_>, scenario: &Bound<'_, PyAny>) -> PyResult<()> {
        let config = core_config(&scenario::load(scenario, None)?.believed);
        let file = scenario::name(scenario);
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.ask(py, |board| board.configure(&config, &name).map(drop))
    }

    /// Arms the board up to this absolute pressure.
    #[pyo3(signature = (most_pa = None))]
    fn arm(&self, py: Python<'_>, most_pa: Option<f32>) -> PyResult<()> {
        self.live.with(py, |board| board.arm(most_pa).map_err(error::arming))
    }

    /// Sends a set point: one of the keywords, flow and period together.
    #[pyo3(signature = (*, pressure_pa = None, contraction = None, flow_kg_s = None, period_s = None, duty = None))]
    fn set(
        &self,
        py: Python<'_>,
        pressure_pa: Option<f32>,
        contraction: Option<f32>,
        flow_kg_s: Option<f32>,
        period_s: Option<f32>,
        duty: Option<[f32; 2]>,
    ) -> PyResult<()> {
        let set_point = set_point(pressure_pa, contraction, flow_kg_s, period_s, duty)?;
        self.ask(py, |board| board.set(set_point).map(drop))
    }

    /// Vents; returns when the telemetry confirms it.
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.ask(py, LiveBoard::stop)
    }

    /// Clears latched faults whose cause is gone; raises if one that vents is left.
    fn clear(&self, py: Python<'_>) -> PyResult<()> {
        let left = self.ask(py, LiveBoard::clear)?;
        if left.intersects(VENTING) {
            return Err(BoardError::new_err(format!("still there: {left}")));
        }
        Ok(())
    }

    /// The latest telemetry.
    fn read<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let telemetry = self.ask(py, LiveBoard::fresh_telemetry)?;
        telemetry_dict(py, &telemetry)
    }

    /// Telemetry as it arrives, one dict per this many steps. Streaming keeps the link alive.
    #[pyo3(signature = (duration_s = None, every = i64::from(VIEW_DIVIDER)))]
    fn stream(this: Bound<'_, Self>, duration_s: Option<f64>, every: i64) -> PyResult<Stream> {
        if let Some(duration_s) =
            duration_s.filter(|duration_s| duration_s.is_nan() || *duration_s < 0.0)
        {
            let text = format!("duration_s = {duration_s}: must be at least 0");
            return Err(PyValueError::new_err(text));
        }
        let steps = u16::try_from(every).ok().filter(|steps| *steps > 0).ok_or_else(|| {
            PyValueError::new_err(format!("every = {every}: must be from 1 to {} steps", u16::MAX))
        })?;
        let (py, board) = (this.py(), this.get());
        let (number, step_s) = board.ask(py, |live| {
            let number = board.streams.fetch_add(1, Ordering::Relaxed) + 1;
            live.telemetry_anew(steps)?;
            // As decimals: with f32 steps of 1 ms, 2 s end slightly after 2 s, and their last row would be lost.
            Ok((number, short(live.config()?.step_s)))
        })?;
        // An emulated board may take three times as long if the machine is busy.
        let patience = PATIENCE + Duration::from_secs_f64(3.0 * f64::from(steps) * step_s);
        let first = Mutex::new(None);
        Ok(Stream { board: this.unbind(), number, step_s, patience, duration_s, first })
    }

    /// Records the board while it does what it does: columns as those of a run.
    #[pyo3(signature = (duration_s, every = 1))]
    fn record<'py>(
        this: Bound<'py, Self>,
        duration_s: f64,
        every: i64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = this.py();
        let stream = Self::stream(this, Some(duration_s), every)?;
        results(py)?.getattr("recorded")?.call1((stream,))
    }

    /// Tunes friction, valves and gains by the experiment of `thermyo tune`, and vents.
    #[pyo3(signature = (scenario, most_pa = None))]
    fn tune<'py>(
        &self,
        py: Python<'py>,
        scenario: &Bound<'_, PyAny>,
        most_pa: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (loaded, file) = (scenario::load(scenario, None)?, scenario::name(scenario));
        let tuned =
            self.live.with(py, |live| experiments::tune_on(live, &loaded, &file, most_pa))?;
        experiments::tuned(py, &tuned)
    }

    /// Measures gas temperature and heat transfer by the stops of `thermyo measure stop`, and vents.
    #[pyo3(signature = (stops = 8, *, wait_s = None, period_s = 5.0, most_pa = None, seed = 1, arm = false))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn measure_stop<'py>(
        &self,
        py: Python<'py>,
        stops: i128,
        wait_s: Option<f64>,
        period_s: f64,
        most_pa: Option<f64>,
        seed: i128,
        arm: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let stops = error::within("stops", stops, 3..=100)? as usize;
        let seed = error::seed(seed)?;
        error::within("period_s", period_s, 0.5..=120.0)?;
        error::within("wait_s", wait_s.unwrap_or(6.0), 6.0..=3600.0)?;
        let asked = Asked { stops, wait_s, period_s, highest_pa: most_pa, seed };
        let findings = self.live.with(py, |live| experiments::measure_stop(live, &asked, arm))?;
        plain(py, &findings)
    }

    /// Calibrates a sensor at two points, and vents.
    #[pyo3(signature = (sensor, reference = None, hold_pa = None))]
    fn calibrate<'py>(
        &self,
        py: Python<'py>,
        sensor: &str,
        reference: Option<Bound<'py, PyAny>>,
        hold_pa: Option<f32>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let reference =
            reference.map_or_else(|| py.import("builtins")?.getattr("input"), PyResult::Ok)?;
        let calibrated = calibrate::calibrate(py, &self.live, sensor, reference, hold_pa)?;
        plain(py, &calibrated)
    }

    /// Vents a driven board and closes the port.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.live.lock().take()));
    }

    fn __enter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        self.close(py);
    }
}

/// Telemetry as it arrives.
#[pyclass(frozen, module = "thermyo")]
pub struct Stream {
    board: Py<Board>,
    number: u32,
    step_s: f64,
    patience: Duration,
    duration_s: Option<f64>,
    /// Step at which the stream's time starts.
    first: Mutex<Option<u32>>,
}

#[pymethods]
impl Stream {
    fn __iter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let telemetry = self.wait(py)?;
        let mut first = self.first.lock().unwrap_or_else(PoisonError::into_inner);
        let steps = telemetry.step.wrapping_sub(*first.get_or_insert(telemetry.step));
        let time_s = f64::from(steps) * self.step_s;
        if self.duration_s.is_some_and(|duration_s| time_s > duration_s) {
            return Ok(None);
        }
        let dict = telemetry_dict(py, &telemetry)?;
        dict.set_item("time_s", time_s)?;
        Ok(Some(dict))
    }
}

impl Stream {
    fn wait(&self, py: Python<'_>) -> PyResult<Telemetry> {
        let (start, board) = (Instant::now(), self.board.get());
        loop {
            let is_last = || board.streams.load(Ordering::Relaxed) == self.number;
            let polled = board.ask(py, |live| is_last().then(|| live.poll()).transpose())?;
            match polled {
                None => return Err(BoardError::new_err("another stream of this board has begun")),
                Some(Some(telemetry)) => return Ok(telemetry),
                Some(None) => py.check_signals()?,
            }
            if start.elapsed() > self.patience {
                return Err(error::silent("telemetry"));
            }
        }
    }
}
