"""The emulated board: the real firmware, with a simulated muscle at its pins."""

import os
import tempfile
import time

import pytest
import thermyo

SCENARIO = {"plant": {"model": "lumped"}, "load": {"force_n": 60.0}}

emulated = pytest.mark.skipif("THERMYO_SKIP_EMULATOR" in os.environ, reason="THERMYO_SKIP_EMULATOR is set")


@pytest.fixture(scope="module", autouse=True)
def place():
    """An emulated board of these tests alone, with an empty flash."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setenv("TMPDIR", folder)
        yield


@pytest.fixture
def board():
    with thermyo.Board("emulated", SCENARIO) as board:
        board.configure(SCENARIO)
        while board.read()["mode"] == "startup check":
            pass
        yield board


@emulated
def test_a_board_is_armed_set_streamed_and_vents_at_the_end():
    with thermyo.Board("emulated", SCENARIO) as board:
        with pytest.raises(thermyo.BoardError, match=r"^the board does not know its muscle yet: board.configure\(scenario\)$"):
            board.arm()
        board.configure(SCENARIO)
        assert board.info()["version"]["chip"] == "Rp2040"
        with pytest.raises(thermyo.BoardError, match=r"^the board is not armed: board.arm\(\)$"):
            board.set(pressure_pa=1.5e5)
        board.arm()
        with pytest.raises(thermyo.BoardError, match=r"^pressure_pa = 9000000000: must be from 101325 \(ambient, as the board is configured\) to 689\d00$"):
            board.set(pressure_pa=9e9)
        with pytest.raises(thermyo.BoardError, match=r"; 1.3 bar is pressure_pa=130000$"):
            board.set(pressure_pa=1.3)
        board.set(pressure_pa=1.5e5)
        stream = list(board.stream(duration_s=3.0))
        times = [telemetry["time_s"] for telemetry in stream]
        assert times == sorted(times) and 2.9 < times[-1] <= 3.0 and len(times) > 250
        assert abs(stream[-1]["measured_pressure_pa"] - 1.5e5) < 3.5e3
        assert stream[-1]["mode"].startswith("pressure") and stream[-1]["faults"] == []
        with pytest.raises(thermyo.BoardError, match=r"^armed_pa = 120000: must be from 14\d{4}\.?\d* to 66\d{4}\.?\d*; the lower end is the pressure now, at least ambient$"):
            board.arm(1.2e5)
    with pytest.raises(thermyo.BoardError, match="^the board is closed$"):
        board.read()
    with thermyo.Board("emulated") as board:
        after = board.read()
    assert after["mode"] == "vent" and after["measured_pressure_pa"] < 1.48e5


@emulated
def test_what_is_read_is_of_now_however_long_nobody_read(board):
    board.arm()
    board.set(pressure_pa=2e5)
    last = list(board.stream(duration_s=1.0))[-1]
    time.sleep(2.0)
    now = board.read()
    # Nearer to what is read next than to what was read last, however slow the emulated board is.
    assert board.read()["step"] - now["step"] < now["step"] - last["step"]
    assert now["mode"] == "vent" and now["faults"] == ["link lost"]
    board.clear()
    assert board.read()["faults"] == []
    # This includes the first dict of a stream.
    time.sleep(1.0)
    now = board.read()
    time.sleep(1.0)
    first = next(board.stream())
    assert board.read()["step"] - first["step"] < first["step"] - now["step"]


@emulated
@pytest.mark.parametrize("every", [0, -1, 65536])
def test_a_stream_has_a_whole_number_of_steps_between_its_dicts(board, every):
    with pytest.raises(ValueError, match=f"^every = {every}: must be from 1 to 65535 steps$"):
        board.stream(every=every)


@emulated
@pytest.mark.parametrize("duration_s", [-1.0, float("nan")])
def test_a_stream_has_a_duration(board, duration_s):
    with pytest.raises(ValueError, match="^duration_s = (-1|NaN): must be at least 0$"):
        board.stream(duration_s=duration_s)


@emulated
def test_a_slow_stream_is_waited_for(board):
    steps = [telemetry["step"] for telemetry in board.stream(duration_s=5.0, every=4000)]
    assert len(steps) == 2 and steps[1] == steps[0] + 4000
    # It ended with a further frame; a request in between does not wait for the next.
    assert board.read()["step"] < steps[1] + 6000
    board.stop()


@emulated
def test_a_board_is_recorded(board):
    board.arm()
    board.set(pressure_pa=1.5e5)
    record = board.record(2.0, every=5)
    assert isinstance(record, thermyo.Run)
    assert len(record["time_s"]) == 401 and record["time_s"][-1] == 2.0
    assert record["measured_pressure_pa"].dtype == float and set(record["mode"]) <= {"pressure", "pressure, held"}
    assert abs(record["measured_pressure_pa"][-1] - 1.5e5) < 3e3
    assert record.summary == {"duration_s": 2.0, "rows": 401, "faults": []}
    assert len(record.plot().axes) == 4
    with pytest.raises(ValueError, match="^duration_s = -1: must be at least 0$"):
        board.record(-1.0)


@emulated
def test_a_sensor_is_calibrated_by_what_a_function_reads(board):
    board.arm()
    before = board.info()["config_checksum"]
    asked = []

    def reference(question):
        asked.append(question)
        # Longer than the link's timeout: the board is kept alive.
        time.sleep(0.7)
        if len(asked) == 3:
            # It may use the board: it steers to the second point by itself.
            board.set(pressure_pa=2.5e5)
            time.sleep(2.0)
        return ["101,3", 101325.0, "2.525 bar"][len(asked) - 1]

    found = board.calibrate("pressure", reference)
    assert asked[0].startswith("first point, vented and at rest: what does the reference read? (Pa, kPa, ")
    assert asked[1].startswith('"101,3": the reference must be a number in Pa, or one with its unit: ')
    assert asked[1].endswith(asked[0])
    assert asked[2].startswith("the sensor reads 101.") and "\nsecond point, at another value" in asked[2]
    assert abs(found["shifts"][0]) < 1e3 and 1.0e3 < found["shifts"][1] < 4.0e3 and found["unit"] == "Pa"
    info = board.info()
    assert info["config_checksum"] == found["config_checksum"] != before
    assert info["armed_pa"] is None and board.read()["mode"] in ("startup check", "vent")


@emulated
def test_the_board_holds_the_second_point(board):
    with pytest.raises(thermyo.BoardError, match=r"^the board is not armed: board.arm\(\)$"):
        board.calibrate("pressure", lambda _: pytest.fail("it asks nothing"), hold_pa=2.5e5)
    board.arm()
    asked = []

    def reference(question):
        asked.append(question)
        return [101325.0, board.read()["measured_pressure_pa"]][len(asked) - 1]

    found = board.calibrate("pressure", reference, hold_pa=2.5e5)
    assert "\nit holds 250.0 kPa\nsecond point, " in asked[1]
    assert max(map(abs, found["shifts"])) < 2e3, found


@emulated
def test_a_calibration_that_ends_vents(board):
    with pytest.raises(ValueError, match='^sensor = "force": must be one of pressure, length, gas$'):
        board.calibrate("force", input)
    with pytest.raises(TypeError, match="^reference: must be a function "):
        board.calibrate("gas", 101325.0)
    board.arm()
    asked = []

    def wrong(question):
        board.set(pressure_pa=2e5)
        asked.append(question)
        return 101325.0

    # The muscle does not vent, and it does not get better.
    with pytest.raises(thermyo.BoardError, match="^not calibrated: it does not vent: "):
        board.calibrate("pressure", wrong)
    assert len(asked) == 3
    vented = board.read()
    assert vented["mode"] == "vent" and vented["faults"] == []

    def broken(question):
        board.set(pressure_pa=2e5)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        board.calibrate("length", broken)
    assert board.read()["mode"] == "vent"

    def closes(question):
        board.close()
        return 101325.0

    with pytest.raises(thermyo.BoardError, match="^the board is closed$"):
        board.calibrate("pressure", closes)


@emulated
def test_stops_are_measured(board):
    with pytest.raises(thermyo.BoardError, match=r"^the board is not armed: board.arm\(\)$"):
        board.measure_stop()
    with pytest.raises(ValueError, match="^stops = 2: must be from 3 to 100$"):
        board.measure_stop(2)
    with pytest.raises(ValueError, match="^stops = -1: must be from 3 to 100$"):
        board.measure_stop(stops=-1)
    with pytest.raises(thermyo.BoardError, match="^most_pa = 4: must be from .*; 4 bar is most_pa=400000$"):
        board.arm(4)
    with pytest.raises(thermyo.BoardError, match="^most_pa: a highest pressure of 9000000.0 Pa: must be from "):
        board.measure_stop(most_pa=9e6)
    with pytest.raises(thermyo.BoardError, match="^most_pa: a highest pressure of 9000000.0 Pa: must be from "):
        board.tune(SCENARIO, most_pa=9e6)
    # Four lags of the sensor: after 6 s gas and sensor may still be half a kelvin from rest.
    found = board.measure_stop(3, wait_s=12.0, period_s=1.0, arm=True)
    assert found["usable"] == 3 and found["planned"] == 3
    assert found["rms_k"]["estimate"] < 3.0
    assert board.read()["mode"] == "vent"


@emulated
def test_the_last_stream_has_the_telemetry(board):
    first = board.stream()
    next(first)
    second = board.stream(every=20)
    next(second)
    with pytest.raises(thermyo.BoardError, match="^another stream of this board has begun$"):
        next(first)
    assert next(second)["time_s"] == pytest.approx(0.02)


def test_a_port_that_is_none_is_said():
    with pytest.raises(thermyo.BoardError, match="^/dev/none: "):
        thermyo.Board("/dev/none")
    with pytest.raises(ValueError, match="another board has its own"):
        thermyo.Board("/dev/none", SCENARIO)
