"""Thermodynamics of a pneumatic muscle: simulate it, estimate its gas temperature, drive it.

A scenario is a path, a text that ends with ".toml" (a path too), the TOML itself, or a dict of tables. An error
in it raises `ScenarioError` with the message of the command `thermyo`. Everything is SI; names end
with their unit.
"""

from os import PathLike
from types import TracebackType
from typing import Any, Callable, Iterator, Literal, Mapping, Optional, Sequence, Union

import numpy
import numpy.typing

Scenario = Union[str, "PathLike[str]", Mapping[str, Any]]
"""A scenario as an argument; exists for type checkers only."""

Columns = Mapping[str, numpy.typing.ArrayLike]
"""Columns of a table by their names; exists for type checkers only."""

__version__: str

class ScenarioError(ValueError):
    """A scenario or a table of data cannot be used: file, line, key, value and allowed values."""

class ScenarioWarning(UserWarning):
    """A scenario is valid but probably unintended."""

class RunError(RuntimeError):
    """A run failed after its start."""

class BoardError(RuntimeError):
    """A board cannot be used, or refuses a request."""

class Run(dict[str, Any]):
    """A run: the columns of trace.csv, of a joint those of joint_trace.csv, as arrays of float64, one element per
    logged step (`[run] log_every`), and under "summary" the content of summary.json."""

    @property
    def summary(self) -> dict[str, Any]:
        """The content of summary.json."""
    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
    def to_pandas(self) -> Any:
        """The columns as a `pandas.DataFrame`, in SI, with `time_s` as its index."""
    def plot(self, *columns: str) -> Any:
        """A `matplotlib` figure over time: pressure, temperatures, length and duties, of a joint angle, stiffness,
        pressures and temperatures, or these columns."""

def run(scenario: Scenario, seed: Optional[int] = None) -> Run:
    """Runs a scenario, also of a joint, with the core in the loop. `seed`, 0 to 2**63 - 1, replaces `[run] seed`."""

def check(scenario: Scenario) -> str:
    """The scenario as TOML with every default filled in and its meaning: the output of `thermyo check`."""

def to_csv(columns: Columns) -> str:
    """Columns as the text of a CSV file: for a run, the bytes of its trace.csv. NaN is an empty cell, and
    "summary" is left out."""

def identify(
    data: Union[str, "PathLike[str]", Columns],
    scenario: Scenario,
    against: Union[str, "PathLike[str]", Columns, None] = None,
) -> dict[str, Any]:
    """Identifies the parameters that `[identify]` names from recorded data, a muscle from a static map, or a joint.

    Returns the content of summary.json of `thermyo identify`, and under "scenario" the identified scenario as
    TOML. `against` is a table of the same kind that is not used for the fit; a joint has none.
    """

class Sweep:
    """The points of `thermyo sweep`, which count from 1, and the rows of its sweep.csv, the same bytes: for engines
    that distribute them over machines.

    `vary` holds values of the option `--vary`; `lhs` is the number of points of a Latin hypercube. Values that do not fit
    the rest of the scenario give a row with a failure.
    """

    def __init__(
        self, scenario: Scenario, vary: Sequence[str], lhs: Optional[int] = None, seed: int = 1
    ) -> None: ...
    def __len__(self) -> int: ...
    @property
    def header(self) -> str:
        """Names of the columns, without the line's end."""
    def values(self, point: int) -> str:
        """The values of a point: "KEY = VALUE, KEY = VALUE"."""
    def row(self, point: int) -> str:
        """Runs a point; returns its row, without the line's end. A failure is in the row."""
    def record(self, point: int) -> dict[str, Union[int, float, str, None]]:
        """As `row`, by the names of the columns and without the checksum; an empty cell is None."""

class Readings:
    """Readings of the sensors after a step, and the true values, by the names of trace.csv."""

    @property
    def time_s(self) -> float: ...
    @property
    def measured_pressure_pa(self) -> float:
        """Absolute pressure as the core reads it [Pa]."""
    @property
    def measured_length_m(self) -> float:
        """Length as the core reads it [m]."""
    @property
    def sensor_gas_k(self) -> float:
        """Reading of the sensor in the gas, with its lag and noise [K]."""
    @property
    def sensor_wall_k(self) -> float:
        """Reading of the sensor in the wall [K]."""
    @property
    def code_pressure(self) -> int: ...
    @property
    def code_gas(self) -> int: ...
    @property
    def code_length(self) -> int: ...
    @property
    def emergency_stop(self) -> bool: ...
    @property
    def pressure_pa(self) -> float:
        """True absolute pressure [Pa]."""
    @property
    def volume_m3(self) -> float: ...
    @property
    def length_m(self) -> float: ...
    @property
    def mass_kg(self) -> float: ...
    @property
    def flow_in_kg_s(self) -> float:
        """Mean over the last step [kg/s]."""
    @property
    def flow_out_kg_s(self) -> float:
        """Mean over the last step [kg/s]."""
    @property
    def gas_temperature_k(self) -> float: ...
    @property
    def wall_temperature_k(self) -> float: ...

class Muscle:
    """The plant of a scenario with its sensors, a step at a time: a muscle or a vessel, at rest at time zero."""

    def __init__(self, scenario: Scenario, seed: Optional[int] = None) -> None: ...
    def step(self, inlet: float, outlet: float) -> Readings:
        """Drives the valves for one step of `step_s`, each open for the given fraction of time, 0 to 1."""
    @property
    def readings(self) -> Readings:
        """The latest readings; before the first step, at rest."""
    @property
    def step_s(self) -> float: ...
    @property
    def rest_length_m(self) -> Optional[float]:
        """None for a vessel."""
    def ledger(self) -> dict[str, float]:
        """Balance of mass and energy since the start, in kg and J."""

class Output:
    """Outputs of a step of the core, by the names of trace.csv."""

    @property
    def duties(self) -> tuple[float, float]:
        """Fractions of time for which inlet and outlet are open: `muscle.step(*output.duties)`."""
    @property
    def duty_in(self) -> float: ...
    @property
    def duty_out(self) -> float: ...
    @property
    def step(self) -> int: ...
    @property
    def measured_pressure_pa(self) -> float: ...
    @property
    def measured_length_m(self) -> float: ...
    @property
    def estimate_k(self) -> float:
        """Estimated gas temperature [K]."""
    @property
    def estimate_sd_k(self) -> float:
        """Stated deviation of `estimate_k` [K]."""
    @property
    def estimate_valid(self) -> bool: ...
    @property
    def wall_estimate_k(self) -> float: ...
    @property
    def sensor_estimate_k(self) -> float: ...
    @property
    def mass_estimate_kg(self) -> float: ...
    @property
    def heat_scale(self) -> float: ...
    @property
    def sensor_lag_s(self) -> float: ...
    @property
    def mode(self) -> str: ...
    @property
    def limited(self) -> bool: ...
    @property
    def faults(self) -> list[str]: ...

class Core:
    """Model, estimator, controller and supervisor as on the board, configured with the scenario's believed values. It is
    armed, and starts with the first set point of the scenario's drive."""

    def __init__(self, scenario: Scenario) -> None: ...
    def step(self, readings: Readings) -> Output:
        """One step. The startup check runs on the readings of the first call."""
    def set(
        self,
        *,
        pressure_pa: Optional[float] = None,
        contraction: Optional[float] = None,
        flow_kg_s: Optional[float] = None,
        period_s: Optional[float] = None,
        duty: Optional[Sequence[float]] = None,
    ) -> None:
        """Changes the set point, from the next PWM period on: one of the keywords, a period only with a flow. A duty
        is two fractions of time, for inlet and outlet.

        Raises `ValueError` for a value that is out of its range, `BoardError` while it vents or is not armed.
        """
    def arm(self, most_pa: Optional[float] = None) -> None:
        """Arms up to this absolute pressure [Pa]."""
    def stop(self) -> None:
        """Vents and disarms."""
    def clear(self) -> None:
        """Clears latched faults whose cause is gone; it vents until it is armed and gets a set point."""
    @property
    def armed_pa(self) -> Optional[float]: ...

class Stream(Iterator[dict[str, Any]]):
    """Telemetry as it arrives."""

    def __iter__(self) -> Stream: ...
    def __next__(self) -> dict[str, Any]: ...

class Board:
    """A flashed board at a serial port, or "emulated": the firmware on an emulated Pico with a muscle at its pins.

    A context manager: at its end the board vents. Between two calls there are no keep-alive messages: it
    vents after `[link] timeout_s` (0.5 s), unless its telemetry is streamed.
    """

    def __init__(self, port: str, scenario: Optional[Scenario] = None) -> None:
        """`scenario` is the muscle of the emulated board, which is plugged in again if one is given; otherwise the
        present one is used, or the nominal one."""
    def info(self) -> dict[str, Any]: ...
    def configure(self, scenario: Scenario) -> None:
        """Sends the core's part of a scenario as a whole. The board vents and is not armed."""
    def arm(self, most_pa: Optional[float] = None) -> None: ...
    def set(
        self,
        *,
        pressure_pa: Optional[float] = None,
        contraction: Optional[float] = None,
        flow_kg_s: Optional[float] = None,
        period_s: Optional[float] = None,
        duty: Optional[Sequence[float]] = None,
    ) -> None:
        """Sends a set point: one of the keywords, a period only with a flow. A pressure is absolute, from ambient on."""
    def stop(self) -> None:
        """Vents; returns when the telemetry confirms it."""
    def clear(self) -> None:
        """Clears latched faults whose cause is gone; raises `BoardError` if one that vents is left."""
    def read(self) -> dict[str, Any]:
        """The latest telemetry, by the names of trace.csv; unread telemetry of a running stream is
        dropped."""
    def stream(self, duration_s: Optional[float] = None, every: int = 10) -> Stream:
        """Telemetry as it arrives, one dict per `every` steps (1 to 65535), with time_s since the first; without end
        if there is no duration. A board has one stream: a second one ends it, and the next dict requested from it
        raises `BoardError`."""
    def record(self, duration_s: float, every: int = 1) -> Run:
        """Records for `duration_s`, a row per `every` steps, what the board does meanwhile; the set point is sent before.

        The columns are the names of `read`, with `time_s` since the first row. "mode" and "faults" are lists of words and of
        lists; "summary" has duration_s, rows and the first faults."""
    def tune(self, scenario: Scenario, most_pa: Optional[float] = None) -> dict[str, Any]:
        """Tunes friction, valves and gains by the experiment of `thermyo tune`: it arms the board up to `most_pa` [Pa]
        (4 bar, or less where supply or limit are lower), moves the muscle for minutes, and vents.

        Returns the content of summary.json of `thermyo tune`, and under "scenario" the tuned scenario as TOML. The board has
        the tuned values, unsaved, if "adopted" is true, otherwise its former ones."""
    def measure_stop(
        self,
        stops: int = 8,
        *,
        wait_s: Optional[float] = None,
        period_s: float = 5.0,
        most_pa: Optional[float] = None,
        seed: int = 1,
        arm: bool = False,
    ) -> dict[str, Any]:
        """Measures gas temperature and heat transfer without a wire, as `thermyo measure stop`, with 3 to 100 stops, valves
        shut for `wait_s` (6 to 3600 s; four time constants of gas and sensor if None) in a cycle of `period_s`
        (0.5 to 120 s); vents. Returns the content of summary.json. Raises `BoardError` where fewer than three stops
        can be used."""
    def calibrate(
        self,
        sensor: Literal["pressure", "length", "gas"],
        reference: Callable[[str], Union[str, float]] = input,
        hold_pa: Optional[float] = None,
    ) -> dict[str, Any]:
        """Calibrates a sensor at two points, as `thermyo board PORT calibrate`: the first one vented and at rest, the
        second one held at `hold_pa` [Pa, absolute] by the armed board, or steered to by `reference`; vents.

        `reference` gets each question and returns what the reference instrument reads: a number in Pa, m or K, or
        text that may have a unit ("101.3 kPa"). The board is kept alive meanwhile, and `reference` may use it, such as
        `board.set(pressure_pa=2.5e5)` before the second point. A refused answer is asked for again, with the reason
        above the question.

        Returns "shifts", the corrections at the two points in "unit", "config_name" and "config_checksum". The board
        has the calibration, unsaved. Raises `BoardError` where a point is refused three times. Any exception vents."""
    def close(self) -> None:
        """Vents a driven board and closes the port."""
    def __enter__(self) -> Board: ...
    def __exit__(
        self,
        exception: Optional[type[BaseException]],
        value: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> None: ...
