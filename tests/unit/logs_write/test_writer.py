"""New logs: the official reader finds everything, in log-time order, and the same calls give the same bytes."""

from __future__ import annotations

import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import cwcli
from cwcli.errors import OutputError
from cwcli.logs.write.message_merge import BYTES_OF_FULL_NEW_CHUNK
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import OutputChannel, Ragged
from tests.unit.logs_write.builders import T0_NS, read_content, state_channel


def write_example(path: Path, **options: Any) -> Path:
    with LogWriter(path, profile="x", **options) as log:
        log.write_columns(state_channel(n=5000))
        raw = log.add_channel("/raw", "json", log.add_schema("Raw", "jsonschema", b"{}"), {"a": "b"})
        times = T0_NS + np.arange(0, 3_000_000_000, 7_000_000, dtype=np.int64)
        log.write_messages(raw, times, [b"{}" + b" " * (k % 9) for k in range(len(times))], publish_time_ns=times - 4)
        log.write_messages(raw, times[:2] + 1, [b"", b"late"])
        log.add_channel("/silent", "json")
        log.add_metadata("about", {"k": "v", "z": ""})
    return path


def test_official_reader_finds_everything(tmp_path: Path) -> None:
    content = read_content(write_example(tmp_path / "a.mcap"))
    assert content.profile == "x"
    assert content.metadata == [("about", {"k": "v", "z": ""})]
    raw = content.messages["/raw"]
    assert [row[4] for row in raw[:4]] == [b"{}", b"", b"{} ", b"late"]
    assert raw[0][:4] == ("Raw", T0_NS, T0_NS - 4, 0)
    assert sorted(row[3] for row in raw) == list(range(len(raw)))
    assert len(content.messages["/cwcli/ego/state"]) == 5000
    times = [time_ns for _, time_ns in content.in_file_order]
    assert times == sorted(times)


def test_columns_decode_to_their_values(tmp_path: Path) -> None:
    with write_example(tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        rows = [row.decoded_message for row in reader.iter_decoded_messages("/cwcli/ego/state")]
    assert [row.x_m for row in rows] == (np.arange(5000) * 0.5).tolist()
    assert list(rows[17].covariance) == np.arange(64.0).tolist()
    assert rows[3].id == "ego"


def test_the_file_is_what_the_official_library_writes(tmp_path: Path) -> None:
    """Byte for byte what its `Writer` makes of the same records, in log-time order; the header names cwcli."""
    times = {"/a": [T0_NS, T0_NS + 2, T0_NS + 2], "/b": [T0_NS + 1, T0_NS + 2]}
    with LogWriter(tmp_path / "ours.mcap", profile="p") as log:
        log.add_metadata("m", {"k": "v"})
        for topic, each in times.items():
            channel = log.add_channel(topic, "json", log.add_schema("S", "jsonschema", b"{}"), {"x": topic})
            log.write_messages(channel, np.array(each), [b'{"n": %d}' % k for k in range(len(each))])
    with (tmp_path / "theirs.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("p", f"cwcli {cwcli.__version__}")
        writer.add_metadata("m", {"k": "v"})
        schema = writer.register_schema("S", "jsonschema", b"{}")
        a, b = (writer.register_channel(topic, "json", schema, {"x": topic}) for topic in times)
        for channel, k, time_ns in ((a, 0, T0_NS), (b, 0, T0_NS + 1), (a, 1, T0_NS + 2), (a, 2, T0_NS + 2)):
            writer.add_message(channel, time_ns, b'{"n": %d}' % k, time_ns, k)
        writer.add_message(b, T0_NS + 2, b'{"n": 1}', T0_NS + 2, 1)
        writer.finish()
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()


def test_same_calls_give_the_same_bytes(tmp_path: Path) -> None:
    first = write_example(tmp_path / "a.mcap").read_bytes()
    assert write_example(tmp_path / "b.mcap").read_bytes() == first


def test_chunks_are_of_moderate_size_and_in_order(tmp_path: Path) -> None:
    with write_example(tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    assert len(chunks) > 2
    longest = 1000  # bytes of a message: the official library closes a chunk behind the message that fills it
    assert max(chunk.uncompressed_size for chunk in chunks) <= BYTES_OF_FULL_NEW_CHUNK + longest
    starts = [chunk.message_start_time for chunk in chunks]
    assert starts == sorted(starts)
    assert {chunk.compression for chunk in chunks} == {"zstd"}


def test_message_indexes_point_at_the_messages(tmp_path: Path) -> None:
    path = write_example(tmp_path / "a.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        middle = T0_NS + 1_000_000_000
        found = [
            m.log_time for _, _, m in reader.iter_messages("/raw", start_time=middle, end_time=middle + 50_000_000)
        ]
    expected = [T0_NS + k * 7_000_000 for k in range(430) if 1000 <= k * 7 < 1050]
    assert found == expected


def test_a_large_message_and_ragged_columns(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    counts = rng.integers(0, 60, 200)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    path_x_m = Ragged(rng.normal(size=int(offsets[-1])), offsets)
    times = T0_NS + np.arange(200, dtype=np.int64)
    with LogWriter(tmp_path / "a.mcap") as log:
        log.write_columns(OutputChannel("/cwcli/ego/path", "cwcli.v1.PredictedPath", times, {"x_m": path_x_m}))
        log.write_messages(log.add_channel("/blob", "x"), times[:1], [bytes(3 * BYTES_OF_FULL_NEW_CHUNK)])
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [list(row.decoded_message.x_m) for row in reader.iter_decoded_messages("/cwcli/ego/path")]
    assert found == [path_x_m.values[a:b].tolist() for a, b in pairwise(offsets)]
    assert len(read_content(tmp_path / "a.mcap").messages["/blob"][0][4]) == 3 * BYTES_OF_FULL_NEW_CHUNK


def test_empty_log(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "a.mcap"):
        pass
    content = read_content(tmp_path / "a.mcap")
    assert content.messages == {}
    assert content.metadata == []


def test_error_inside_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="stop"), LogWriter(tmp_path / "a.mcap") as log:
        log.write_columns(state_channel())
        raise ValueError("stop")
    assert list(tmp_path.iterdir()) == []


def test_existing_file_is_refused(tmp_path: Path) -> None:
    path = write_example(tmp_path / "a.mcap")
    with pytest.raises(OutputError, match="the file exists"):
        LogWriter(path)
    write_example(path, force=True)


@pytest.mark.parametrize(
    ("times", "messages", "words"),
    [([2, 1], [b"", b""], "go back"), ([-1], [b""], "negative"), ([1, 2], [b""], "1 messages, 2 log times")],
)
def test_wrong_times_are_refused(tmp_path: Path, times: list[int], messages: list[bytes], words: str) -> None:
    with pytest.raises(ValueError, match=words), LogWriter(tmp_path / "a.mcap") as log:
        log.write_messages(log.add_channel("/a", "x"), np.array(times), messages)
    assert list(tmp_path.iterdir()) == []


def test_wrong_column_length_is_refused(tmp_path: Path) -> None:
    channel = OutputChannel("/a", "cwcli.v1.VehicleState", np.arange(3), {"x_m": np.zeros(4)})
    with pytest.raises(ValueError, match="/a: x_m has 4 rows instead of 3"), LogWriter(tmp_path / "a.mcap") as log:
        log.write_columns(channel)


def test_crcs_are_really_checked(tmp_path: Path) -> None:
    """The reader above notices a flipped bit, so its silence means something."""
    path = write_example(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    data[summary.chunk_indexes[0].chunk_start_offset + 9 + 24] ^= 1
    path.write_bytes(data)
    with pytest.raises((ValueError, McapError), match="crc"):
        read_content(path)


def test_summary_crc_is_right(tmp_path: Path) -> None:
    data = write_example(tmp_path / "a.mcap").read_bytes()
    start = int.from_bytes(data[-28:-20], "little")
    assert int.from_bytes(data[-12:-8], "little") == zlib.crc32(data[start:-12])


def test_names_that_are_not_utf_8_become_their_escapes(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "a.mcap") as log:
        log.add_metadata("from \udcff", {"file": "s\udcff.toml"})
        log.write_messages(log.add_channel("/t\udcff", "x"), np.array([1], np.int64), [b"1"])
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file)
        assert [(each.name, each.metadata) for each in reader.iter_metadata()] == [
            ("from \\xff", {"file": "s\\xff.toml"})
        ]
        assert [channel.topic for _, channel, _ in reader.iter_messages()] == ["/t\\xff"]
