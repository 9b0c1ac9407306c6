"""Cases of the level `file`: a mutated log through the reader, and now and then through a command."""

from __future__ import annotations

import io
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import cache
from pathlib import Path
from typing import Any

import mcap.records
import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.reader import NonSeekingReader, make_reader

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BUG, EXIT_CODES, EXIT_NOT_WRITTEN, CwcliError
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    Opcode,
)
from cwcli.logs.read.reader import Log
from tests.fuzz.logs import MESSAGE_HEAD, Record, mutated_log, opened, split
from tests.fuzz.mutate import Rng
from tests.unit.logs_read.builders import LAYOUTS, small_log

COMMANDS = (
    ("info", "LOG", "--json"),
    ("info", "LOG", "--recover"),
    ("estimate", "LOG", "-o", "OUT", "--replace", "--sensor-model", "none"),
    ("estimate", "LOG", "--recover", "--tables"),
    ("predict", "LOG", "-o", "OUT", "--replace"),
    ("warn", "LOG", "-o", "OUT", "--replace"),
    ("run", "LOG", "-o", "OUT", "--replace", "--recover"),
    ("layout", "LOG", "-o", "OUT"),
    ("evaluate", "LOG", "--json"),
)
WITH_COMMAND = 0.1
N_INPUTS = 4
BEYOND_BYTES = 1 << 16
DEFINITIONS: dict[int, Any] = {Opcode.SCHEMA: mcap.records.Schema, Opcode.CHANNEL: mcap.records.Channel}
UNEXPECTED = {EXIT_BUG, EXIT_NOT_WRITTEN}
SCENARIO = """description = "two cars"
duration_s = 2
[vehicles.host]
x_m = 0
y_m = 0
heading_deg = 90
speed_mps = 9
[vehicles.other]
x_m = 3
y_m = 30
heading_deg = 200
speed_mps = 5
[sensors.gnss]
[sensors.gnss_heading]
[sensors.speed]
[sensors.imu]
[v2x]
"""
Row = tuple[int, int, int]


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate a log a few times and check each; counts of inputs and of exit codes."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        is_drive = rng.random() < WITH_COMMAND
        base = _drives()[int(rng.integers(2))] if is_drive else _small_logs(int(rng.integers(len(LAYOUTS))))
        data = mutated_log(rng, base)
        check_log(data, COMMANDS[int(rng.integers(len(COMMANDS)))] if is_drive else None, counts)
    return dict(counts)


def check_log(data: bytes, command: tuple[str, ...] | None, counts: Counter[str]) -> None:
    """Read a log as it is and with repairs, compare what is read, and run a command on it.

    Raises:
        AssertionError: A message is not the official one, or an exit code is not documented.
    """
    counts["inputs"] += 1
    with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
        path = Path(folder) / "in.mcap"
        path.write_bytes(data)
        found = _rows(path, recover=False)
        _rows(path, recover=True)
        if found is not None:
            counts["accepted"] += 1
            official = official_rows(data, seeking=False)
            if official is not None and loses_its_place(data):
                official = walked_rows(data, path)
            if official is not None:
                counts["compared"] += 1
                try:
                    assert_same_rows(found, official)
                except AssertionError:  # where a summary contradicts the data, it may win
                    if _names_channels_alike(path, data):
                        by_summary = official_rows(data, seeking=True)
                        if by_summary is None:
                            raise
                        assert_same_rows(found, by_summary)
        if command is not None:
            out = Path(folder) / "out"
            names = {"LOG": str(path), "OUT": str(out)}
            shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
            with redirect_stdout(shown), redirect_stderr(shown):
                code = run_command_line([names.get(each, each) for each in command])
            counts[f"exit {code}"] += 1
            shown.flush()
            said = shown.buffer.getvalue().decode()
            assert code in EXIT_CODES and code not in UNEXPECTED, said
            assert "Traceback" not in said, said
            assert out.exists() == (code == 0 and "OUT" in command), (code, said)
            assert {each.name for each in Path(folder).iterdir()} <= {"in.mcap", "out"}


def assert_same_rows(found: dict[str, tuple[list[Row], int]], official: dict[str, list[Row]]) -> None:
    """Of each topic that was read, all messages are there, but for those that are counted as undecodable."""
    for topic, (rows, n_undecodable) in found.items():
        expected = official.get(topic, [])
        assert len(rows) + n_undecodable == len(expected), (topic, len(rows), n_undecodable, len(expected))
        assert not Counter(rows) - Counter(expected), topic


def _rows(path: Path, *, recover: bool) -> dict[str, tuple[list[Row], int]] | None:
    """Times and sequence of each message of each topic, and how many are undecodable; None if the log is refused.

    A topic that can't be read, by its schema for one, is left out.
    """
    read: dict[str, tuple[list[Row], int]] = {}
    try:
        with Log.open(path, recover=recover) as log:
            with suppress(CwcliError):
                assert len(log.metadata) <= len(log.metadata_names)
            for topic in dict.fromkeys(channel.topic for channel in log.channels):
                try:
                    columns = log.columns(topic)
                except CwcliError as error:
                    assert "\n" not in str(error)
                    continue
                times = (columns.log_time_ns, columns.publish_time_ns)
                rows = zip(*(each.astype(np.uint64).tolist() for each in times), columns.sequence.tolist(), strict=True)
                read[topic] = list(rows), columns.n_undecodable
    except CwcliError as error:
        assert "\n" not in str(error)
        return None
    return read


def official_rows(data: bytes, *, seeking: bool) -> dict[str, list[Row]] | None:
    """The same by an official reader: record by record, or by the summary; None if it refuses the log."""
    found: dict[str, list[Row]] = {}
    stream = io.BytesIO(data)
    try:
        reader = make_reader(stream, validate_crcs=True) if seeking else NonSeekingReader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, message.publish_time, message.sequence))
    except Exception:  # it raises what it comes upon
        return None
    return found


def loses_its_place(data: bytes) -> bool:
    """Whether the official reader does not go on behind a schema or channel where its length says.

    It takes the rest of one that is shorter than its fields from what follows, and in a chunk takes what is behind the
    fields of a longer one for the next record.
    """
    for record, is_in_chunk in _records(data):
        if record.opcode in DEFINITIONS:
            stream = ReadDataStream(io.BytesIO(record.content + bytes(BEYOND_BYTES)))
            DEFINITIONS[record.opcode].read(stream)
            if stream.count > len(record.content) or (is_in_chunk and stream.count < len(record.content)):
                return True
    return False


def walked_rows(data: bytes, path: Path) -> dict[str, list[Row]]:
    """As `official_rows`, by the lengths of the records alone; channels are called as cwcli does."""
    with Log.open(path) as log:
        topics = {channel.id: channel.topic for channel in log.channels}
    found: dict[str, list[Row]] = {}
    for each, _ in _records(data):
        if each.opcode == Opcode.MESSAGE:
            channel, sequence, log_time_ns, publish_time_ns = MESSAGE_HEAD.unpack_from(each.content)
            found.setdefault(topics[channel], []).append((log_time_ns, publish_time_ns, sequence))
    return found


def _records(data: bytes) -> Iterator[tuple[Record, bool]]:
    """Those of the data section, and whether each is in a chunk; none of a chunk that can't be unpacked."""
    for record in split(data[len(MCAP_MAGIC) : -len(MCAP_MAGIC)]):
        if record.opcode == Opcode.DATA_END:
            return
        if record.opcode == Opcode.CHUNK:
            with suppress(Exception):  # each library raises its own
                yield from ((each, True) for each in split(opened(record)[3]))
        else:
            yield record, False


def _names_channels_alike(path: Path, data: bytes) -> bool:
    """Whether the log's channels, by its summary, are those that its messages have."""
    messages = NonSeekingReader(io.BytesIO(data)).iter_messages()
    with Log.open(path) as log:
        return {(each.id, each.topic) for _, each, _ in messages} <= {(each.id, each.topic) for each in log.channels}


@cache
def _small_logs(k: int) -> bytes:
    return small_log(30, **list(LAYOUTS.values())[k])


@cache
def _drives() -> tuple[bytes, bytes]:
    """Two seconds of a drive, and the same with everything that cwcli makes of it."""
    with tempfile.TemporaryDirectory() as folder:
        scenario, plain, annotated = (Path(folder) / name for name in ("two.toml", "plain.mcap", "annotated.mcap"))
        scenario.write_text(SCENARIO, encoding="utf-8")
        shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
        with redirect_stdout(shown), redirect_stderr(shown):
            assert run_command_line(["simulate", str(scenario), "-o", str(plain)]) == 0, shown.buffer.getvalue()
            assert run_command_line(["run", str(plain), "-o", str(annotated)]) == 0
        return plain.read_bytes(), annotated.read_bytes()


def annotated_drive() -> bytes:
    """Two seconds of a drive with everything that cwcli makes of it."""
    return _drives()[1]


def fast_folder() -> str | None:
    """Memory, where there is such a folder: each input is a file."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
