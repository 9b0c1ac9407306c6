"""Files that lack what the format lets a writer leave out, and messages in unusual order."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType

from cwcli.errors import DataError, MissingSignalError
from cwcli.logs.format.chunks import decompress_chunk
from cwcli.logs.read import message_reader
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.builders import FIX, LAYOUTS, NOTES, T0_NS, Declared, Sent, fix_message, log_bytes, small_log
from tests.unit.logs_read.official import assert_same, read_officially


def check_against_official(path: Path, data: bytes) -> Log:
    """All topics of a file equal the official decoders' rows, and nothing is counted as damage."""
    path.write_bytes(data)
    official = read_officially(data, seeking=False)
    with Log.open(path) as log:
        for topic, columns in log.load_topics({channel.topic: None for channel in log.channels}).items():
            if topic in official:
                assert_same(columns, official[topic])
            else:
                assert len(columns) == 0
        assert log.faults.counts_by_reason() == {}
        return log


@pytest.mark.parametrize("name", LAYOUTS)
def test_layout_gives_the_same_rows(tmp_path: Path, name: str) -> None:
    log = check_against_official(tmp_path / "log.mcap", small_log(**LAYOUTS[name]))
    assert log.n_messages == 120
    assert (log.start_ns, log.end_ns) == (T0_NS, T0_NS + 59_500_000)
    assert {channel.topic: channel.message_count for channel in log.channels} == {"/fix": 60, "/notes": 60}
    with Log.open(log.name) as again:
        assert [(name, dict(values)) for name, values in again.metadata] == [("note", {"made by": "a test"})]


def test_times_out_of_order_are_sorted_in_file_order_where_equal(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    times = T0_NS + rng.integers(0, 40, 200)
    messages = [Sent("/fix", int(ns), fix_message(k), T0_NS - k - 1) for k, ns in enumerate(times)]
    check_against_official(tmp_path / "log.mcap", log_bytes([FIX], messages))


def test_two_channels_of_one_schema_are_one_topic(tmp_path: Path) -> None:
    messages = [Sent("/fix", T0_NS + 1000 - k, fix_message(k)) for k in range(50)]
    check_against_official(tmp_path / "log.mcap", log_bytes([FIX, FIX], messages))


def test_two_schemas_on_one_topic_are_an_error_that_names_both(tmp_path: Path) -> None:
    other = Declared("/fix", "json", "Other", "jsonschema", b"{}")
    path = tmp_path / "log.mcap"
    path.write_bytes(log_bytes([FIX, other], [Sent("/fix", T0_NS, fix_message(0)), Sent("/fix", T0_NS, b"{}")]))
    with Log.open(path) as log, pytest.raises(DataError, match=r"test_msgs/msg/Fix.*Other"):
        log.columns("/fix")


def test_channel_without_messages_gives_empty_columns(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_bytes([FIX, NOTES], [Sent("/notes", T0_NS, b'{"a": 1}')]))
    with Log.open(path) as log:
        columns = log.columns("/fix")
        fields: Mapping[str, Any] = columns.fields
        assert len(columns) == 0
        assert fields["latitude"].shape == (0,)
        assert fields["variance"].shape == (0, 3)


def test_log_without_messages_opens(tmp_path: Path) -> None:
    log = check_against_official(tmp_path / "log.mcap", log_bytes([FIX], []))
    assert (log.n_messages, log.start_ns, log.end_ns) == (0, 0, 0)


def test_unknown_topic_is_an_error_that_lists_the_topics(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(small_log())
    with Log.open(path) as log, pytest.raises(MissingSignalError) as caught:
        log.columns("/nothing")
    assert caught.value.found == ("/fix", "/notes")


def test_only_chunks_with_wanted_channels_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = [Sent("/notes", T0_NS + k, json.dumps({"k": k, "pad": "x" * 100}).encode()) for k in range(50)]
    messages += [Sent("/fix", T0_NS + 100 + k, fix_message(k)) for k in range(50)]
    path = tmp_path / "log.mcap"
    path.write_bytes(log_bytes([FIX, NOTES], messages, compression=CompressionType.LZ4))
    opened = []
    from cwcli.logs.read import message_reader

    real = decompress_chunk

    def counted(data: memoryview, chunk: object, *, verify: bool) -> memoryview:
        opened.append(chunk)
        return real(data, chunk, verify=verify)  # type: ignore[arg-type]

    monkeypatch.setattr(message_reader, real.__name__, counted)
    with Log.open(path) as log:
        assert len(log.columns("/fix")) == 50
        assert 0 < len(opened) < log.n_chunks / 2


def test_projection_gives_the_same_columns_as_everything(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(small_log())
    with Log.open(path) as log:
        whole: Mapping[str, Any] = log.load_topics({"/fix": None, "/notes": None})
        some: Mapping[str, Any] = log.load_topics(
            {"/fix": ["latitude", "header.frame_id", "nothing"], "/notes": {"text", "list"}}
        )
    assert set(some["/fix"].fields) == {"latitude", "header.frame_id"}
    assert set(some["/notes"].fields) == {"text", "list"}
    assert np.array_equal(some["/fix"].fields["latitude"], whole["/fix"].fields["latitude"])
    assert some["/fix"].fields["header.frame_id"].values == ("gps", "gpsgps", "gpsgpsgps")
    assert np.array_equal(some["/notes"].fields["list"], whole["/notes"].fields["list"])


@pytest.mark.parametrize("name", LAYOUTS)
def test_log_times_are_those_of_the_messages(tmp_path: Path, name: str) -> None:
    (tmp_path / "log.mcap").write_bytes(small_log(**LAYOUTS[name]))
    with Log.open(tmp_path / "log.mcap") as log:
        for topic in ("/fix", "/notes"):
            assert log.log_times_ns(topic).tolist() == log.columns(topic).log_time_ns.tolist()
            assert len(log.log_times_ns(topic)) == 60


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_span_is_the_whole_topic_cut(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "log.mcap").write_bytes(small_log(**LAYOUTS[name]))
    span = (T0_NS + 20_000_000, T0_NS + 22_500_000)  # from a message of /fix to before one of /notes
    opened: list[int] = []
    real = decompress_chunk

    def counted(*arguments: Any, **options: Any) -> memoryview:
        opened.append(arguments[1].chunk_start)
        return real(*arguments, **options)

    monkeypatch.setattr(message_reader, real.__name__, counted)
    with Log.open(tmp_path / "log.mcap") as log:
        wanted = {"/fix": ["latitude"], "/notes": ["k"]}
        part = log.load_topics(wanted, logged=span)
        n_opened = len(set(opened))
        whole = log.load_topics(wanted)
        assert {topic: len(columns) for topic, columns in part.items()} == {"/fix": 3, "/notes": 2}
        for topic, columns in part.items():
            cut = whole[topic].slice_by_log_time(*span)
            assert np.array_equal(columns.log_time_ns, cut.log_time_ns)
            assert np.array_equal(columns.sequence, cut.sequence)
            [leaf] = wanted[topic]
            assert np.array_equal(np.asarray(columns.fields[leaf]), np.asarray(cut.fields[leaf]))
        assert n_opened <= 2 < max(log.n_chunks, 3)
        assert len(log.columns("/fix", ["latitude"])) == 60  # a part is not kept as the whole
