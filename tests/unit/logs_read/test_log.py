"""The log as a whole: standard input, channels in memory, the hash, and how little opening one needs."""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from cwcli.errors import InputError, UsageError
from cwcli.logs.read.message_reader import MessageReader
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Columns, Field, OutputChannel, Ragged, Strings
from tests.unit.logs_read.builders import T0_NS, Declared, Sent, log_bytes, small_log


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A small log."""
    file = tmp_path / "log.mcap"
    file.write_bytes(small_log())
    return file


def test_standard_input_is_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    with Log.open("-") as log:
        assert log.name == "<stdin>"
        assert len(log.columns("/fix")) == 60


def test_empty_standard_input_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    for content in (b"", b"no log"):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
        with pytest.raises(InputError, match="<stdin>"):
            Log.open("-")
        assert list(tmp_path.iterdir()) == []


def test_named_pipe_is_read_like_standard_input(path: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["sh", "-c", f"cat {path} > {pipe}"]), Log.open(pipe) as log:
        assert len(log.columns("/fix")) == 60


def test_terminal_as_standard_input_is_a_usage_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Terminal())
    with pytest.raises(UsageError):
        Log.open("-")


def test_sha256_is_the_files(path: Path) -> None:
    with Log.open(path) as log:
        digest = log.begin_sha256()
        assert digest.result() == hashlib.sha256(path.read_bytes()).hexdigest()
        assert log.with_channels([]).begin_sha256() is digest


def test_an_error_of_hashing_is_told_to_whoever_waits(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise ValueError("not allowed here")

    monkeypatch.setattr(hashlib, "sha256", refuse)
    with Log.open(path) as log, pytest.raises(ValueError, match="not allowed here"):
        log.begin_sha256().result(20.0)


def test_opening_needs_no_heavy_module(path: Path) -> None:
    code = f"""
import sys
from cwcli.logs.read.reader import Log
with Log.open({str(path)!r}) as log:
    assert len(log.channels) == 2 and log.n_messages == 120 and log.metadata
print(sorted({{"numpy", "mcap", "pyarrow", "google", "zstandard", "lz4"}} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("message_encoding", "schema_encoding"), [("flatbuffer", "flatbuffer"), ("cdr", "ros2idl"), ("cdr", ""), ("", "")]
)
def test_unknown_encoding_is_an_error_for_that_topic_alone(
    tmp_path: Path, message_encoding: str, schema_encoding: str
) -> None:
    odd = Declared("/odd", message_encoding, "Odd", schema_encoding, b"?")
    notes = Declared("/notes", "json", "Notes", "jsonschema", b"{}")
    path = tmp_path / "log.mcap"
    path.write_bytes(log_bytes([odd, notes], [Sent("/odd", T0_NS, b"1"), Sent("/notes", T0_NS, b'{"a": 1}')]))
    with Log.open(path) as log:
        assert len(log.columns("/notes")) == 1
        with pytest.raises(InputError, match=r"/odd.*encoding.*is unknown \(known: cdr/ros2msg"):
            log.columns("/odd")


def state(n: int) -> OutputChannel:
    """A flat channel with strings, matrices and a field that is left out."""
    rng = np.random.default_rng(4)
    return OutputChannel(
        "/cwcli/ego/state",
        "cwcli.v1.VehicleState",
        T0_NS + np.arange(n, dtype=np.int64),
        {
            "stamp_ns": T0_NS + np.arange(n, dtype=np.int64),
            "id": Strings(np.array([0, 1, -1, 0][:n], np.int32), ("ego", "other")),
            "x_m": rng.normal(size=n).astype(np.float32),
            "covariance": rng.normal(size=(n, 64)),
        },
    )


def path_channel() -> OutputChannel:
    """A flat channel with sequences of different lengths."""
    times = T0_NS + np.arange(3, dtype=np.int64)
    ragged = Ragged(np.arange(5.0), np.array([0, 2, 2, 5]))
    fields: dict[str, Any] = {"stamp_ns": times, "x_m": ragged, "y_m": np.ones((3, 4)), "heading_rad": np.ones((3, 0))}
    return OutputChannel("/cwcli/ego/path", "cwcli.v1.PredictedPath", times, fields)


def fix() -> OutputChannel:
    """A channel with messages inside."""
    times = T0_NS + np.arange(3, dtype=np.int64)
    fields: dict[str, Any] = {
        "timestamp": times,
        "frame_id": Strings(np.zeros(3, np.int32), ("gps",)),
        "latitude": np.array([48.0, 0.0, np.nan]),
        "position_covariance": np.ones((3, 9)),
        "position_covariance_type": np.full(3, 2, np.int32),
    }
    return OutputChannel("/cwcli/ego/fix", "foxglove.LocationFix", times, fields)


@pytest.mark.parametrize("channel", [state(4), state(1), state(0), path_channel(), fix()], ids=lambda each: each.topic)
def test_channel_in_memory_reads_as_from_the_written_file(path: Path, tmp_path: Path, channel: OutputChannel) -> None:
    written = tmp_path / "written.mcap"
    with LogWriter(written) as writer:
        writer.write_columns(channel)
    with Log.open(path) as log, Log.open(written) as other:
        memory = log.with_channels([channel], {"cwcli.run.test": {"a": "b"}})
        assert [each.topic for each in memory.channels] == ["/fix", "/notes", channel.topic]
        info = memory.channels[-1]
        file_info = other.channels[0]
        assert (info.schema_name, info.message_encoding, info.schema_encoding, info.message_count) == (
            file_info.schema_name,
            file_info.message_encoding,
            file_info.schema_encoding,
            file_info.message_count,
        )
        assert dict(memory.metadata)["cwcli.run.test"] == {"a": "b"}
        loaded = memory.load_topics({"/fix": ["latitude"], channel.topic: None})
        assert list(loaded) == ["/fix", channel.topic]
        assert_equal(loaded[channel.topic], other.columns(channel.topic))
        second_ns = T0_NS + 1
        assert_equal(
            memory.load_topics({channel.topic: None}, logged=(second_ns, second_ns + 1))[channel.topic],
            memory.columns(channel.topic).slice_by_log_time(second_ns, second_ns + 1),
        )
        one = next(iter(loaded[channel.topic].fields))
        assert list(memory.columns(channel.topic, [one]).fields) == [one]


def test_channel_in_memory_hides_the_files(path: Path) -> None:
    with Log.open(path) as log:
        memory = log.with_channels([OutputChannel("/fix", "cwcli.v1.VehicleState", np.zeros(0, np.int64), {})])
        assert [(each.topic, each.schema_name) for each in memory.channels] == [
            ("/notes", "Notes"),
            ("/fix", "cwcli.v1.VehicleState"),
        ]
        assert len(memory.columns("/fix")) == 0
        again = memory.with_channels([state(4)])
        assert [each.topic for each in again.added_channels] == ["/fix", "/cwcli/ego/state"]


def assert_equal(found: Columns, expected: Columns) -> None:
    """The same columns, types included."""
    assert found.schema_name == expected.schema_name
    assert found.message_encoding == expected.message_encoding
    assert np.array_equal(found.log_time_ns, expected.log_time_ns)
    assert np.array_equal(found.publish_time_ns, expected.publish_time_ns)
    assert np.array_equal(found.sequence, expected.sequence)
    assert set(found.fields) == set(expected.fields)
    for path, column in expected.fields.items():
        assert_equal_field(found.fields[path], column, path)


def assert_equal_field(found: Field, expected: Field, path: str) -> None:
    assert type(found) is type(expected), path
    if isinstance(expected, Strings) and isinstance(found, Strings):
        assert (found.codes.tolist(), found.values) == (expected.codes.tolist(), expected.values), path
    elif isinstance(expected, Ragged) and isinstance(found, Ragged):
        assert found.values.dtype == expected.values.dtype, path
        assert np.array_equal(found.values, expected.values) and np.array_equal(found.offsets, expected.offsets), path
    elif isinstance(expected, np.ndarray) and isinstance(found, np.ndarray):
        assert found.dtype == expected.dtype and found.shape == expected.shape, path
        assert np.array_equal(found, expected, equal_nan=expected.dtype.kind == "f"), path


def test_log_times_come_from_the_indexes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The log has its schemas in front of the chunks; those stay closed all the same."""
    path = Path(__file__).parents[3] / "sample_logs" / "curve.mcap"
    with path.open("rb") as stream:
        expected = [message.log_time for _, _, message in make_reader(stream).iter_messages(topics=["/gps/fix"])]

    def open_no_chunk(*_: object) -> None:
        raise AssertionError("a chunk was opened")

    monkeypatch.setattr(MessageReader, "iter_chunk_payloads", open_no_chunk)
    with Log.open(path) as log:
        assert log.log_times_ns("/gps/fix").tolist() == sorted(expected)
