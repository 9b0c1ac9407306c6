"""Annotated logs: the source untouched, the new channels beside it, the summary right."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from cwcli.errors import EXIT_NOT_WRITTEN, OutputError
from cwcli.logs.write.annotate import annotate_log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import OutputChannel
from tests.unit.logs_write.builders import read_content, source_stub, state_channel, write_log

STATE = "/cwcli/ego/state"
RUN = {"cwcli.run.estimate": {"version": "1", "counts": "{}"}}
SOURCES: Mapping[str, dict[str, Any]] = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "one large chunk": {"chunk_size": 1 << 20},
    "unchunked": {"chunked": False},
    "unchunked without summary": {
        "chunked": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
        "index_types": IndexType.NONE,
    },
    "without message indexes": {"index_types": IndexType.CHUNK | IndexType.ATTACHMENT | IndexType.METADATA},
    "without any summary": {
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
        "index_types": IndexType.MESSAGE,
    },
    "summary without channels": {"repeat_channels": False, "repeat_schemas": False},
    "without CRCs": {"enable_crcs": False},
    "with a data CRC": {"enable_data_crcs": True},
}


def chunk_bytes(path: Path) -> list[bytes]:
    """The stored bytes of each chunk."""
    with path.open("rb") as stream:
        return [record.data for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)]


@pytest.mark.parametrize("kind", SOURCES)
def test_source_is_untouched_and_channel_is_there(tmp_path: Path, kind: str) -> None:
    source = write_log(tmp_path / "in.mcap", **SOURCES[kind])
    before = read_content(write_log(tmp_path / "same.mcap"))
    report = annotate_log(source_stub(source), [state_channel()], RUN, tmp_path / "out.mcap")
    after = read_content(tmp_path / "out.mcap")
    assert after.without(STATE) == before.messages
    assert after.attachments == before.attachments
    assert after.metadata == [*before.metadata, *RUN.items()]
    assert after.profile == "test-drive"
    state = after.messages[STATE]
    assert [row[1] for row in state] == state_channel().log_time_ns.tolist()
    assert {row[0] for row in state} == {"cwcli.v1.VehicleState"}
    assert (report.n_messages_copied, report.n_messages_added) == (440, 300)
    assert report.n_bytes == (tmp_path / "out.mcap").stat().st_size


@pytest.mark.parametrize("kind", ["zstd", "lz4", "uncompressed", "without message indexes"])
def test_chunks_are_copied_byte_for_byte(tmp_path: Path, kind: str) -> None:
    source = write_log(tmp_path / "in.mcap", **SOURCES[kind])
    report = annotate_log(source_stub(source), [state_channel()], RUN, tmp_path / "out.mcap")
    old, new = chunk_bytes(source), chunk_bytes(tmp_path / "out.mcap")
    assert [chunk for chunk in new if chunk in set(old)] == old
    assert (report.n_chunks_copied, report.n_chunks_added) == (len(old), len(new) - len(old))


def test_records_between_the_chunks_are_copied_byte_for_byte(tmp_path: Path) -> None:
    """With nothing to add, the whole data section is the source's."""
    source = write_log(tmp_path / "in.mcap")
    annotate_log(source_stub(source), [], {}, tmp_path / "out.mcap")
    with source.open("rb") as stream:
        summary_start = int.from_bytes(source.read_bytes()[-28:-20], "little")
        assert stream.read(summary_start) == (tmp_path / "out.mcap").read_bytes()[:summary_start]
    assert read_content(tmp_path / "out.mcap") == read_content(source)


# source's profile, its channels' (message encoding, schema encoding), whether a state is added -> profile
PROMISES: dict[str, tuple[str, list[tuple[str, str | None]], bool, str]] = {
    "ROS 2": ("ros2", [("cdr", "ros2msg"), ("cdr", "ros2idl")], False, "ros2"),
    "ROS 2 without definitions": ("ros2", [("cdr", None)], False, "ros2"),
    "ROS 2 and protobuf that is added": ("ros2", [("cdr", "ros2msg")], True, ""),
    "ROS 2 and JSON of the source": ("ros2", [("cdr", "ros2msg"), ("json", None)], False, ""),
    "ROS 2 and a foreign definition": ("ros2", [("cdr", "ros2msg"), ("cdr", "protobuf")], False, ""),
    "ROS 1": ("ros1", [("ros1", "ros1msg")], False, "ros1"),
    "ROS 1 and protobuf that is added": ("ros1", [("ros1", "ros1msg")], True, ""),
    "another's profile": ("acme", [("cdr", "ros2msg")], True, "acme"),
}


@pytest.mark.parametrize("case", PROMISES)
def test_profile_stays_only_while_every_channel_keeps_it(tmp_path: Path, case: str) -> None:
    profile, encodings, is_added, expected = PROMISES[case]
    source = tmp_path / "in.mcap"
    with source.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile, "recorder 1.2")
        for k, (message_encoding, schema_encoding) in enumerate(encodings):
            schema = writer.register_schema(f"a/msg/M{k}", schema_encoding, b"float64 x") if schema_encoding else 0
            writer.add_message(writer.register_channel(f"/{k}", message_encoding, schema), k, b"12345678", k)
        writer.finish()
    report = annotate_log(source_stub(source), [state_channel()] if is_added else [], {}, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        header = make_reader(stream).get_header()
    assert (header.profile, header.library) == (expected, "recorder 1.2")
    assert report.dropped_profile == (profile if expected == "" else "")
    assert read_content(tmp_path / "out.mcap").without(STATE) == read_content(source).messages


def test_replaced_channel_does_not_count_for_the_profile(tmp_path: Path) -> None:
    """A JSON channel that a stage's own replaces is gone; the state that takes its place is no ROS message either."""
    source = write_log(tmp_path / "in.mcap", profile="ros2")
    report = annotate_log(source_stub(source), [state_channel("/plain")], {}, tmp_path / "out.mcap", replace=True)
    assert report.dropped_profile == "ros2"
    assert read_content(tmp_path / "out.mcap").profile == ""


def test_new_messages_lie_near_their_time(tmp_path: Path) -> None:
    """Behind the chunk of their time, at most 64 KiB later: 2.5 s at these 30 kB/s."""
    source = write_log(tmp_path / "in.mcap")
    annotate_log(source_stub(source), [state_channel(n=180)], RUN, tmp_path / "out.mcap")
    latest_source_ns, waits_s = 0, []
    for topic, time_ns in read_content(tmp_path / "out.mcap").in_file_order:
        if topic == STATE:
            assert time_ns <= latest_source_ns
            waits_s.append((latest_source_ns - time_ns) * 1e-9)
        else:
            latest_source_ns = max(latest_source_ns, time_ns)
    assert max(waits_s) < 2.7


def test_many_new_bytes_lie_right_behind_each_chunk(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap", chunk_size=10_000)
    wide = state_channel(n=4000)
    wide = OutputChannel(STATE, wide.schema_name, wide.log_time_ns[0] + np.arange(4000) * 1_000_000, wide.fields)
    annotate_log(source_stub(source), [wide], RUN, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    is_new = [chunk.message_index_offsets.keys() == {4} for chunk in chunks]
    assert is_new == [False, True] * (len(chunks) // 2)
    for k in range(3, len(chunks), 2):
        assert chunks[k - 3].message_end_time < chunks[k].message_start_time
        assert chunks[k].message_end_time <= chunks[k - 1].message_end_time


def test_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    for name in ("a.mcap", "b.mcap"):
        annotate_log(source_stub(source), [state_channel()], RUN, tmp_path / name)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_channels_in_memory_are_written(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    stub = source_stub(source, added_channels=[state_channel("/a")], added_metadata={"cwcli.run.a": {"x": "1"}})
    annotate_log(stub, [state_channel("/b")], RUN, tmp_path / "out.mcap")
    content = read_content(tmp_path / "out.mcap")
    assert len(content.messages["/a"]) == len(content.messages["/b"]) == 300
    assert [name for name, _ in content.metadata] == ["provenance", "cwcli.run.a", "cwcli.run.estimate"]


def test_one_annotation_after_the_other(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    annotate_log(source_stub(source), [state_channel("/a")], {"cwcli.run.a": {}}, tmp_path / "1.mcap")
    annotate_log(source_stub(tmp_path / "1.mcap"), [state_channel("/b")], {"cwcli.run.b": {}}, tmp_path / "2.mcap")
    content = read_content(tmp_path / "2.mcap")
    assert content.without("/a", "/b") == read_content(source).messages
    assert content.messages["/a"] == read_content(tmp_path / "1.mcap").messages["/a"]
    with (tmp_path / "2.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert [schema.name for schema in summary.schemas.values()] == ["sensor_msgs/msg/Imu", "cwcli.v1.VehicleState"]


def test_channel_without_messages_is_declared(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    annotate_log(source_stub(source), [state_channel(n=0)], {}, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert STATE in {channel.topic for channel in summary.channels.values()}


def test_source_without_messages(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "in.mcap"):
        pass
    annotate_log(source_stub(tmp_path / "in.mcap"), [state_channel()], RUN, tmp_path / "out.mcap")
    assert len(read_content(tmp_path / "out.mcap").messages[STATE]) == 300


@pytest.mark.parametrize(
    ("channels", "metadata", "words"),
    [
        ([state_channel()], {}, "holds the channel /cwcli/ego/state already"),
        ([], RUN, "holds the metadata record cwcli.run.estimate already"),
    ],
)
def test_what_is_there_already_is_refused(
    tmp_path: Path, channels: list[OutputChannel], metadata: Mapping[str, Mapping[str, str]], words: str
) -> None:
    annotate_log(source_stub(write_log(tmp_path / "in.mcap")), [state_channel()], RUN, tmp_path / "1.mcap")
    with pytest.raises(OutputError, match=words) as caught:
        annotate_log(source_stub(tmp_path / "1.mcap"), channels, metadata, tmp_path / "2.mcap")
    assert caught.value.exit_code == EXIT_NOT_WRITTEN
    assert "--replace" in caught.value.hint
    assert not (tmp_path / "2.mcap").exists()


def test_replace_leaves_the_old_channel_out(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    both = [state_channel(name="old"), state_channel("/other")]
    annotate_log(source_stub(source), both, {**RUN, "cwcli.run.other": {}}, tmp_path / "1.mcap")
    new_run = {"cwcli.run.estimate": {"version": "2"}}
    report = annotate_log(
        source_stub(tmp_path / "1.mcap"), [state_channel(n=250, name="new")], new_run, tmp_path / "2.mcap", replace=True
    )
    before, after = read_content(tmp_path / "1.mcap"), read_content(tmp_path / "2.mcap")
    assert report.replaced_topics == (STATE,)
    assert after.without(STATE) == before.without(STATE)
    assert len(after.messages[STATE]) == 250
    assert all(b"new" in row[4] for row in after.messages[STATE])
    assert after.metadata == [("provenance", {"source": "here"}), ("cwcli.run.other", {}), *new_run.items()]
    assert after.attachments == before.attachments


def test_replace_again_and_again_does_not_grow(tmp_path: Path) -> None:
    path = tmp_path / "0.mcap"
    annotate_log(source_stub(write_log(tmp_path / "in.mcap")), [state_channel()], RUN, path)
    sizes = []
    for k in range(1, 4):
        annotate_log(source_stub(path), [state_channel()], RUN, tmp_path / f"{k}.mcap", replace=True)
        path = tmp_path / f"{k}.mcap"
        sizes.append(path.stat().st_size)
    assert len(set(sizes)) == 1
    assert read_content(path) == read_content(tmp_path / "0.mcap")


@pytest.mark.parametrize("chunked", [True, False])
def test_replace_a_channel_that_another_writer_mixed_in(tmp_path: Path, chunked: bool) -> None:
    """`/plain` shares its chunks with `/imu`: they are rewritten without it."""
    source = write_log(tmp_path / "in.mcap", chunked=chunked)
    before = read_content(source)
    annotate_log(source_stub(source), [state_channel("/plain")], {}, tmp_path / "out.mcap", replace=True)
    after = read_content(tmp_path / "out.mcap")
    assert after.without("/plain") == before.without("/plain")
    assert {row[0] for row in after.messages["/plain"]} == {"cwcli.v1.VehicleState"}


def test_input_and_existing_target_are_refused(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    content = source.read_bytes()
    with pytest.raises(OutputError, match="the input itself"):
        annotate_log(source_stub(source), [state_channel()], {}, source, force=True)
    (tmp_path / "out.mcap").write_bytes(b"old")
    with pytest.raises(OutputError, match="the file exists"):
        annotate_log(source_stub(source), [state_channel()], {}, tmp_path / "out.mcap")
    annotate_log(source_stub(source), [state_channel()], {}, tmp_path / "out.mcap", force=True)
    assert source.read_bytes() == content


def test_column_that_does_not_fit_leaves_no_file(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    wrong = OutputChannel("/a", "cwcli.v1.VehicleState", np.arange(2), {"speed_kmh": np.zeros(2)})
    with pytest.raises(ValueError, match="no field speed_kmh"):
        annotate_log(source_stub(source), [wrong], {}, tmp_path / "out.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]


def test_channels_of_a_new_chunk_lie_one_behind_the_other(tmp_path: Path) -> None:
    """Messages of one channel are alike; readers get the log-time order from the indexes."""
    source = write_log(tmp_path / "in.mcap", chunk_size=1 << 20)
    topics = ["/cwcli/ego/state", "/cwcli/remote/state"]
    annotate_log(source_stub(source), [state_channel(topic) for topic in topics], {}, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        rows = [(m.log_time, c.topic) for _, c, m in make_reader(stream).iter_messages(topics)]
        assert rows == sorted(rows, key=lambda row: row[0]) and len(rows) == 600
        stream.seek(0)
        in_file_order = [c.topic for _, c, _ in make_reader(stream).iter_messages(topics, log_time_order=False)]
    assert sum(a != b for a, b in itertools.pairwise(in_file_order)) == 3  # in two chunks, and between them
