"""`cwcli.decoder_factory()` with the official reader: every channel decodes to the values that cwcli wrote."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mcap_ros2.decoder
import numpy as np
import pytest
from mcap.exceptions import DecoderNotFoundError
from mcap.reader import make_reader
from mcap.records import Schema

import cwcli
from cwcli.errors import InputError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import OutputField, Ragged, Repeated, Strings
from tests.laws.channel_cases import CASES, ROOT, N, Written

SAMPLE = ROOT / "sample_logs" / "intersection.mcap"
EARLY_NS = 1_700_000_000_000_000_000


def decoded(path: Path, factory: Any = None) -> Iterator[tuple[str, int, Any]]:
    """Topic, log time and decoded message of each message."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[factory or cwcli.decoder_factory()])
        for _, channel, message, value in reader.iter_decoded_messages():
            yield channel.topic, message.log_time, value


def leaves(message: Any, names: Sequence[str]) -> list[Any]:
    """All values of a field by its path, those of repeated messages one after the other; times in ns."""
    field = message.DESCRIPTOR.fields_by_name[names[0]]
    value = getattr(message, names[0])
    found: list[Any] = []
    each: Any
    for each in [value] if isinstance(value, str | bytes) or not isinstance(value, Sequence) else value:
        if names[1:]:
            found += leaves(each, names[1:])
        elif field.message_type is not None and field.message_type.name in ("Timestamp", "Duration"):
            found.append(each.seconds * 1_000_000_000 + each.nanos)
        else:
            found += each if isinstance(each, bytes) else [each]
    return found


def enum_of(descriptor: Any, names: Sequence[str]) -> Any:
    """The enum of a field by its path, or None."""
    field = descriptor.fields_by_name[names[0]]
    return enum_of(field.message_type, names[1:]) if names[1:] else field.enum_type


def given(column: OutputField, row: int) -> list[Any]:
    """The values of a column's row."""
    if isinstance(column, Strings):
        return [column.values[column.codes[row]] if column.codes[row] >= 0 else ""]
    if isinstance(column, Ragged):
        return list(column.values[column.offsets[row] : column.offsets[row + 1]].tolist())
    return list(np.atleast_1d(np.asarray(column)[row]).tolist())


def assert_row_is(message: Any, fields: Mapping[str, OutputField], row: int, prefix: tuple[str, ...] = ()) -> None:
    """Every field of a message is what the columns hold in that row."""
    for path, column in fields.items():
        names = (*prefix, *path.split("."))
        if isinstance(column, Repeated):
            inner = range(int(column.offsets[row]), int(column.offsets[row + 1]))
            elements = message
            for name in names:
                elements = getattr(elements, name)
            assert len(elements) == len(inner), names
            for element, k in zip(elements, inner, strict=True):
                assert_row_is(element, column.fields, k)
            continue
        found, expected = leaves(message, names), given(column, row)
        enum = enum_of(message.DESCRIPTOR, names)
        if enum is not None and isinstance(column, Strings):
            (name,) = (enum.values_by_number[each].name for each in found)
            assert name.lower().endswith(expected[0].lower() or "unspecified"), names
        else:
            assert len(found) == len(expected), names
            is_single = str(getattr(column, "dtype", "")) == "float32"
            for ours, theirs in zip(found, expected, strict=True):
                is_text = isinstance(theirs, str)
                assert ours == (theirs if is_text else pytest.approx(theirs, 1e-6 if is_single else 0, 0, nan_ok=True))


@pytest.mark.parametrize("case", CASES)
def test_every_channel_decodes_to_the_values_that_were_written(
    case: Callable[[np.random.Generator, int], Written], tmp_path: Path
) -> None:
    channels = {channel.topic: channel for channel in case(np.random.default_rng(6), N).channels}
    with LogWriter(tmp_path / "log.mcap") as log:
        for channel in channels.values():
            log.write_columns(channel)
    rows = dict.fromkeys(channels, 0)
    for topic, log_time_ns, message in decoded(tmp_path / "log.mcap"):
        channel, row = channels[topic], rows[topic]
        assert log_time_ns == channel.log_time_ns[row]
        assert message.DESCRIPTOR.full_name == channel.schema_name
        assert_row_is(message, channel.fields, row)
        rows[topic] += 1
    assert rows == {topic: len(channel) for topic, channel in channels.items()}


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded log (CDR, JSON and protobuf) with all that `cwcli run` adds."""
    path = tmp_path_factory.mktemp("run") / "annotated.mcap"
    subprocess.run(
        [sys.executable, "-m", "cwcli", "run", str(SAMPLE), "-o", str(path)], check=True, capture_output=True
    )
    return path


def test_every_message_of_an_annotated_log_decodes(annotated: Path) -> None:
    counts: dict[str, int] = {}
    speeds = []
    for topic, _, message in decoded(annotated):
        counts[topic] = counts.get(topic, 0) + 1
        if topic == "/cwcli/ego/state":
            speeds.append(message.speed_mps)
    with Log.open(annotated) as log:
        assert counts == {channel.topic: channel.message_count for channel in log.channels if channel.message_count}
        assert len([topic for topic in counts if topic.startswith("/cwcli/")]) > 8
        np.testing.assert_array_equal(speeds, log.columns("/cwcli/ego/state").fields["speed_mps"])


def test_recorded_messages_decode_as_other_libraries_decode_them(annotated: Path) -> None:
    """ROS messages have the fields of the official ROS decoder, JSON is what `json` reads."""
    ours = {(topic, time_ns): value for topic, time_ns, value in decoded(annotated) if "/cwcli/" not in topic}
    n_ros = n_json = 0
    with annotated.open("rb") as stream:
        ros = mcap_ros2.decoder.DecoderFactory()
        for schema, channel, message in make_reader(stream).iter_messages():
            found = ours.get((channel.topic, message.log_time))
            if channel.message_encoding == "json":
                assert found == json.loads(message.data)
                n_json += 1
            elif channel.message_encoding == "cdr":
                theirs = ros.decoder_for("cdr", schema)
                assert theirs is not None
                assert_same_fields(found, theirs(message.data))
                n_ros += 1
    assert n_ros > 500
    assert n_json > 100


def assert_same_fields(ours: Any, theirs: Any) -> None:
    """Two objects have equal attributes."""
    if hasattr(theirs, "__slots__"):
        assert {*vars(ours)} == {*theirs.__slots__}
        for name in theirs.__slots__:
            assert_same_fields(getattr(ours, name), getattr(theirs, name))
    else:
        np.testing.assert_array_equal(ours, theirs)


def test_one_factory_serves_files_whose_ids_mean_different_schemas(tmp_path: Path) -> None:
    """Both files call their only schema 1."""
    factory = cwcli.decoder_factory()
    fields = {"a": ("float64 x", b"\0\1\0\0" + np.float64(2.5).tobytes()), "b": ("uint8 y", b"\0\1\0\0\x07")}
    for name, (text, payload) in fields.items():
        with LogWriter(tmp_path / name) as log:
            channel = log.add_channel("/t", "cdr", log.add_schema(f"p/msg/{name.upper()}", "ros2msg", text.encode()))
            log.write_messages(channel, np.array([EARLY_NS]), [payload])
    (_, _, first), (_, _, second) = *decoded(tmp_path / "a", factory), *decoded(tmp_path / "b", factory)
    assert (first.x, second.y) == (2.5, 7)


@pytest.mark.parametrize(
    ("encoding", "schema"),
    [("flatbuffer", Schema(id=1, name="A", encoding="flatbuffer", data=b"")), ("cdr", None), ("protobuf", None)],
)
def test_other_encodings_are_left_to_other_factories(encoding: str, schema: Schema | None) -> None:
    assert cwcli.decoder_factory().decoder_for(encoding, schema) is None


def test_a_file_with_an_unknown_encoding_gets_the_error_of_the_official_reader(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_messages(log.add_channel("/odd", "flatbuffer"), np.array([EARLY_NS]), [b""])
    with pytest.raises(DecoderNotFoundError):
        list(decoded(tmp_path / "log.mcap"))


def test_json_needs_no_schema() -> None:
    decode = cwcli.decoder_factory().decoder_for("json", None)
    assert decode is not None
    assert decode(b'{"a": [1]}') == {"a": [1]}


@pytest.mark.parametrize(
    ("encoding", "schema", "payload", "words"),
    [
        ("protobuf", Schema(id=1, name="A", encoding="protobuf", data=b"\xff"), b"", "the schema A can't be used"),
        ("cdr", Schema(id=1, name="p/msg/A", encoding="ros2msg", data=b"float64 x"), b"\0\1\0\0", "p/msg/A.*cut short"),
        ("json", None, b"{", "a message of json can't be decoded: no JSON"),
    ],
)
def test_damage_is_an_error_that_names_the_schema(
    encoding: str, schema: Schema | None, payload: bytes, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        decode = cwcli.decoder_factory().decoder_for(encoding, schema)
        assert decode is not None
        decode(payload)


def test_a_damaged_protobuf_message_is_an_error(annotated: Path) -> None:
    with annotated.open("rb") as stream:
        schema = next(s for s, c, _ in make_reader(stream).iter_messages() if c.topic == "/cwcli/ego/state")
    decode = cwcli.decoder_factory().decoder_for("protobuf", schema)
    assert decode is not None
    with pytest.raises(InputError, match=r"cwcli\.v1\.VehicleState can't be decoded: damaged"):
        decode(b"\xff\xff\xff")


def test_the_example_of_the_page_runs(
    annotated: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "viewers.md").read_text(encoding="utf-8")
    section = page.partition("\n## Python\n")[2].partition("\n## ")[0]
    code = "\n".join(line.removeprefix("    ") for line in section.splitlines() if line.startswith("    "))
    monkeypatch.chdir(annotated.parent)
    exec(code, {})  # the page's own example
    lines = capsys.readouterr().out.splitlines()
    with Log.open(annotated) as log:
        columns = log.columns("/cwcli/ego/state")
        rows = zip(*(np.asarray(columns.fields[name]) for name in ("stamp_ns", "x_m", "speed_mps")), strict=True)
        assert lines == [f"{stamp_ns} {x_m} {speed_mps}" for stamp_ns, x_m, speed_mps in rows]


def test_importing_cwcli_imports_no_library() -> None:
    code = "import sys; before = {*sys.modules}; import cwcli; print(sorted({*sys.modules} - before - {'cwcli'}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "mcap" not in done.stdout
    assert "google" not in done.stdout
    assert "numpy" not in done.stdout
