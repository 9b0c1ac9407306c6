"""A log in parts is the log."""

from __future__ import annotations

import hashlib
import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cwcli.errors import InputError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from tests.unit.logs_read.builders import LAYOUTS
from tests.unit.logs_read.part_builders import (
    T0_NS,
    TOPICS,
    cut,
    messages,
    official,
    seen,
    write_log,
    write_metadata,
)

N = 200


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    return write_log(tmp_path / "whole.mcap", messages(N))


def names(paths: list[Path]) -> list[str]:
    return [str(path) for path in paths]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("ids", ["same", "shuffled", "first used"])
def test_parts_read_as_the_whole(whole: Path, tmp_path: Path, ids: str, layout: str) -> None:
    parts = cut(messages(N), tmp_path, 10, ids=ids, **LAYOUTS[layout])
    with Log.open(whole) as expected, Log.open(names(parts)) as log:
        assert seen(log) == seen(expected)
        assert {each.topic for each in log.channels} == set(TOPICS)
        assert (log.start_ns, log.end_ns, log.n_messages) == (expected.start_ns, expected.end_ns, N)
        counts = {each.topic: each.message_count for each in expected.channels}
        assert {each.topic: each.message_count for each in log.channels} == counts
        assert log.faults.counts_by_reason() == {}


def write_part(path: Path, channels: list[tuple[int, str, dict[str, str]]], first: int) -> Path:
    """A part whose channels have a schema record each, all of the same type, as rosbag2 splits them."""
    stream = BytesIO()
    writer = Writer(stream)
    writer.start(profile="", library="test")
    made = [
        writer.register_channel(topic, "json", writer.register_schema("Same", "jsonschema", b"{}"), metadata)
        for _, topic, metadata in channels
    ]
    for k in range(10):
        for channel_id, (sender, _, _) in zip(made, channels, strict=True):
            at_ns = T0_NS + (first + k) * 10_000_000
            writer.add_message(channel_id, at_ns, json.dumps({"sender": sender}).encode(), at_ns, k)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        pytest.param([[(1, "/a", {}), (2, "/b", {})], [(2, "/b", {}), (1, "/a", {})]], ["/a", "/b"], id="turned"),
        pytest.param([[(2, "/b", {}), (1, "/a", {})], [(1, "/a", {})]], ["/a", "/b"], id="one-is-silent"),
        pytest.param([[(1, "/a", {"qos": "1"})], [(1, "/a", {"qos": "2"})]], ["/a"], id="metadata-differ"),
        pytest.param(
            [
                [(1, "/a", {"from": "1"}), (2, "/a", {"from": "2"})],
                [(2, "/a", {"from": "2"}), (1, "/a", {"from": "1"})],
                [(2, "/a", {"from": "2"})],
            ],
            ["/a", "/a"],
            id="two-senders-of-one-topic",
        ),
    ],
)
def test_channels_of_equal_topic_and_type_are_one_across_parts(
    tmp_path: Path, parts: list[list[tuple[int, str, dict[str, str]]]], expected: list[str]
) -> None:
    """Every message is on the channel of its own sender, in the log and in its copy."""
    paths = [write_part(tmp_path / f"drive_{k}.mcap", each, 10 * k) for k, each in enumerate(parts)]
    with Log.open(names(paths)) as log:
        annotate_log(log, (), {}, tmp_path / "copy.mcap")
        assert sorted(each.topic for each in log.channels) == expected
        assert sum(each.message_count or 0 for each in log.channels) == 10 * sum(map(len, parts))
    senders: dict[int, set[int]] = {}
    with (tmp_path / "copy.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            senders.setdefault(channel.id, set()).add(json.loads(message.data)["sender"])
    assert sorted(map(sorted, senders.values())) == [[k + 1] for k in range(len(expected))]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("ids", ["same", "shuffled", "first used"])
def test_the_copy_of_parts_is_one_file_that_others_read(whole: Path, tmp_path: Path, ids: str, layout: str) -> None:
    parts = cut(messages(N), tmp_path, 7, ids=ids, **LAYOUTS[layout])
    with Log.open(names(parts)) as log:
        report = annotate_log(log, (), {"note": {"is": "new"}}, tmp_path / "copy.mcap")
    assert report.n_messages_copied == N
    assert sorted(official(tmp_path / "copy.mcap")) == sorted(official(whole))
    with Log.open(tmp_path / "copy.mcap") as copy, Log.open(whole) as expected:
        assert seen(copy) == seen(expected)
        assert copy.faults.counts_by_reason() == {}
        assert dict(copy.metadata) == {"note": {"is": "new"}}


def test_the_order_of_the_names_does_not_matter(whole: Path, tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 12)
    with Log.open(sorted(names(parts), reverse=True)) as log, Log.open(whole) as expected:
        assert seen(log) == seen(expected)


def test_the_hash_is_that_of_the_parts_one_behind_the_other(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 3)
    with Log.open(names(parts[::-1])) as log:
        found = log.begin_sha256().result()
    assert found == hashlib.sha256(b"".join(path.read_bytes() for path in parts)).hexdigest()


def test_messages_of_a_channel_that_its_part_does_not_define_are_nobodys(tmp_path: Path) -> None:
    """Never those of the channel that has the id in another part."""
    first = write_log(tmp_path / "drive_0.mcap", messages(40), ["/a", "/b", "/c"], use_chunking=False)
    later = [("/a", T0_NS + (40 + k) * 10_000_000, b'{"value": 7}') for k in range(5)]
    second = write_log(tmp_path / "drive_1.mcap", later, ["/b", "/a"], use_chunking=False)
    orphan = second.read_bytes().replace(
        b"\x05" + (22 + 12).to_bytes(8, "little") + b"\x02\0", b"\x05" + (22 + 12).to_bytes(8, "little") + b"\x03\0"
    )
    assert orphan != second.read_bytes()
    second.write_bytes(orphan)
    with Log.open([str(first), str(second)], recover=True) as log, Log.open(first) as expected:
        assert seen(log)["/c"] == seen(expected)["/c"]
        assert seen(log)["/a"] == seen(expected)["/a"]


@pytest.mark.parametrize("left_out", [0, 4, 9])
def test_a_missing_part_is_told(tmp_path: Path, left_out: int) -> None:
    parts = cut(messages(N), tmp_path, 10)
    write_metadata(tmp_path, parts, [20] * 10)
    parts[left_out].unlink()
    with Log.open(tmp_path) as log:
        assert log.n_messages == N - 20
        assert log.faults.counts_by_reason() == {f"parts missing that metadata.yaml lists (drive_{left_out}.mcap)": 1}


def test_a_missing_number_and_a_silence_are_told(tmp_path: Path) -> None:
    parts = cut(messages(2000), tmp_path, 10)
    with Log.open(names(parts[:4] + parts[5:])) as log:
        assert log.faults.counts_by_reason() == {
            "parts missing by the numbers in the names (4)": 1,
            "gaps between parts (drive_3.mcap and drive_5.mcap: 2.0 s)": 1,
        }


def test_a_folder_is_its_metadata(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    parts = cut(messages(N), folder, 10)
    write_metadata(folder, parts, [20] * 10)
    write_log(folder / "annotated.mcap", messages(N))
    with Log.open(folder) as log, Log.open(whole) as expected:
        assert seen(log) == seen(expected)
        assert log.name == str(folder)
        assert log.faults.counts_by_reason() == {"logs that metadata.yaml does not list, not read (annotated.mcap)": 1}


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_files_that_the_recorder_compressed(whole: Path, tmp_path: Path, suffix: str) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    packed = []
    for path in cut(messages(N), folder, 4):
        packed.append(path.with_name(f"{path.name}{suffix}"))
        packed[-1].write_bytes(zstandard.compress(path.read_bytes()))
        path.unlink()
    write_metadata(folder, packed, [50] * 4, compression_format="zstd", compression_mode="FILE")
    with Log.open(folder) as log, Log.open(whole) as expected:
        assert seen(log) == seen(expected)
        assert log.faults.counts_by_reason() == {}
        hashed = log.begin_sha256().result()
    assert hashed == hashlib.sha256(b"".join(path.read_bytes() for path in packed)).hexdigest()


def test_metadata_that_lies_is_told(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 4)
    write_metadata(tmp_path, parts, [50, 50, 51, 50])
    with Log.open(tmp_path) as log:
        assert log.n_messages == N
        told = "wrong numbers of messages in metadata.yaml (drive_2.mcap: 51 instead of 50)"
        assert log.faults.counts_by_reason() == {told: 1}
    write_metadata(tmp_path, parts, [50] * 4, message_count=7)
    with Log.open(tmp_path) as log:
        told = "wrong numbers of messages in metadata.yaml (all: 7 instead of 200)"
        assert log.faults.counts_by_reason() == {told: 1}
    write_metadata(tmp_path, parts, [50] * 4, relative_file_paths=["/etc/passwd", *(path.name for path in parts)])
    with Log.open(tmp_path) as log:
        assert log.n_messages == N
        assert log.faults.counts_by_reason() == {"parts missing that metadata.yaml lists (passwd)": 1}


DOUBLING = "a0: &a0 {k: 1}\n" + "".join(
    f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 8)}]}}\n" for k in range(1, 20)
)


@pytest.mark.parametrize(
    "text",
    [
        DOUBLING,
        "[" * 100_000,
        "- " * 100_000,
        "a: " + "b" * 16_000_000,
        "",
        "\0",
        "- 1",
        "{",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {files: 2}",
        "&a [*a]",
    ],
)
def test_metadata_that_is_none_is_told(tmp_path: Path, text: str) -> None:
    cut(messages(N), tmp_path, 4)
    (tmp_path / "metadata.yaml").write_text(text)
    with Log.open(tmp_path) as log:
        assert log.n_messages == N
        assert log.faults.counts_by_reason() == {"metadata.yaml that can't be understood": 1}


def test_a_repeated_part_counts_once(whole: Path, tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 4)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(parts[1].read_bytes())
    link = tmp_path / "link.mcap"
    link.symlink_to(parts[2])
    with Log.open(names([*parts, parts[0], copy, link])) as log, Log.open(whole) as expected:
        assert seen(log) == seen(expected)
        assert log.faults.counts_by_reason() == {"repeated parts (drive_0.mcap, copy.mcap, link.mcap)": 3}


def test_parts_that_overlap_are_told_and_read(tmp_path: Path) -> None:
    content = messages(N)
    one = write_log(tmp_path / "one.mcap", content[:120])
    two = write_log(tmp_path / "two.mcap", content[100:])
    with Log.open([str(two), str(one)]) as log:
        assert log.n_messages == 220
        assert log.faults.counts_by_reason() == {"parts that overlap in time (one.mcap and two.mcap: 0.190 s)": 1}
        times_ns = log.columns("/a").log_time_ns
        assert (np.diff(times_ns) >= 0).all()


def test_an_empty_part_is_told(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 2)
    empty = tmp_path / "drive_2.mcap"
    empty.touch()
    with Log.open(names([*parts, empty])) as log:
        assert log.n_messages == N
        assert log.faults.counts_by_reason() == {"empty parts (drive_2.mcap)": 1}
    with pytest.raises(InputError, match="all of its parts are empty"):
        Log.open([str(empty)])


def test_a_part_that_was_cut_is_named_and_recovered(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 4)
    parts[3].write_bytes(parts[3].read_bytes()[:-300])
    with pytest.raises(InputError, match=r"drive_3\.mcap: the file is cut short"):
        Log.open(names(parts))
    with Log.open(names(parts), recover=True) as log:
        assert log.n_messages >= 150
        assert log.faults.truncated
    parts[2].write_bytes(b"no log")
    with Log.open(names(parts), recover=True) as log:
        assert "parts that can't be read (drive_2.mcap: it is not an MCAP file)" in log.faults.counts_by_reason()


def test_damage_is_told_with_the_part_and_its_offset(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 4, compression=CompressionType.NONE)
    data = bytearray(parts[2].read_bytes())
    at = data.index(b'{"value": 1')
    data[at + 2] ^= 1
    parts[2].write_bytes(data)
    with Log.open(names(parts)) as log, pytest.raises(InputError, match=r"drive_2\.mcap: .*CRC.*at byte") as caught:
        seen(log)
    place = int(str(caught.value).partition("at byte ")[2].partition(")")[0])
    assert place < len(data)


def test_parts_of_several_profiles_are_told(tmp_path: Path) -> None:
    content = messages(N)
    one = write_log(tmp_path / "drive_0.mcap", content[:100], profile="ros2")
    two = write_log(tmp_path / "drive_1.mcap", content[100:])
    with Log.open([str(one), str(two)]) as log:
        assert log.profile == ""
        assert log.faults.counts_by_reason() == {"parts with different profiles": 2}


def test_what_is_no_log_of_parts_is_refused(tmp_path: Path) -> None:
    cut(messages(N), tmp_path, 2)
    with pytest.raises(InputError, match=r"holds 2 logs and no metadata\.yaml"):
        Log.open(tmp_path)
    with pytest.raises(UsageError, match="standard input"):
        Log.open(["-", str(tmp_path / "drive_0.mcap")])
    (tmp_path / "drive_1.mcap").unlink()
    with Log.open(tmp_path) as log:
        assert log.n_messages == 100
    with pytest.raises(InputError, match="No such file"):
        Log.open([str(tmp_path / "drive_0.mcap"), str(tmp_path / "nothing.mcap")])


def test_a_part_that_changes_while_it_is_read_is_told(tmp_path: Path) -> None:
    parts = cut(messages(N), tmp_path, 3)
    with pytest.raises(InputError, match=r"drive_1\.mcap: the log changed"), Log.open(names(parts)) as log:
        seen(log)
        with parts[1].open("ab") as stream:
            stream.write(b"more")
