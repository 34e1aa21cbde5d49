"""trace.mcap, read by the format's own Python package: the numbers of trace.csv."""

import csv
import io
import json
import struct

import pytest

mcap = pytest.importorskip("mcap.reader")
EndOfFile = pytest.importorskip("mcap.exceptions").EndOfFile

SCENARIO = "[run]\nduration_s = 20.0\nlog_every = 10\n[plant]\nmodel = \"lumped\"\n"
TOPICS = {"/muscle", "/sensors", "/estimate", "/control", "/health"}


@pytest.fixture(scope="module")
def record(command, tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    (folder / "scenario.toml").write_text(SCENARIO)
    out = folder / "out"
    result = command("run", folder / "scenario.toml", "--quiet", "--out", out, "--log", "mcap")
    assert result.returncode == 0, result.stderr
    return out


def rows_of(messages):
    """Messages of all topics, joined by their time."""
    rows, topics = {}, set()
    for schema, channel, message in messages:
        topics.add(channel.topic)
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        known = json.loads(schema.data)["properties"]
        cells = json.loads(message.data)
        assert cells.keys() <= known.keys()
        rows.setdefault(message.log_time, {}).update(cells)
    return rows, topics


def test_every_number_is_the_tables(record):
    table = csv.DictReader((record / "trace.csv").open())
    with (record / "trace.mcap").open("rb") as file:
        reader = mcap.make_reader(file)
        assert reader.get_summary().statistics.message_count == 2001 * len(TOPICS)
        rows, topics = rows_of(reader.iter_messages())
    assert topics == TOPICS
    expected = {}
    for row in table:
        cells = {name: float(cell) for name, cell in row.items() if cell}
        expected[round(cells["time_s"] * 1e9)] = cells
    assert rows == expected


def test_a_file_that_is_cut_reads_up_to_the_cut(record):
    whole = (record / "trace.mcap").read_bytes()
    raised = set()

    def read(data):
        messages = []
        try:
            for message in mcap.NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False):
                messages.append(message)
        except (EndOfFile, struct.error) as error:  # see docs/how-to/logs.md
            assert data is not whole, error
            raised.add(type(error))
        return messages

    all_of_it = read(whole)
    assert len(all_of_it) == 2001 * len(TOPICS)
    before = 0
    for cut in [*range(100), *range(100, len(whole), len(whole) // 50)]:
        messages = read(whole[:cut])
        assert len(messages) >= before
        assert [m[2].data for m in messages] == [m[2].data for m in all_of_it[: len(messages)]]
        before = len(messages)
    assert before > 0.8 * len(all_of_it)
    assert raised == {EndOfFile, struct.error}
