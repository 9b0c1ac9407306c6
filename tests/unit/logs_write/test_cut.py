"""Cut logs: every message of the span with its bytes and times, by the official reader; whole chunks untouched."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.errors import InputError, UsageError
from cwcli.logs.format.chunks import decompress_chunk
from cwcli.logs.read.reader import Log
from cwcli.logs.write.cut import CutReport, CutSpan, cut_log, topics_matching_patterns
from tests.unit.logs_write.builders import MILLISECOND, T0_NS, Content, read_content, write_log
from tests.unit.logs_write.test_annotate import SOURCES, chunk_bytes

FIRST_NS, LAST_NS = T0_NS + 1005 * MILLISECOND, T0_NS + 2500 * MILLISECOND
LATCHED_QOS = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"

Messages = dict[str, list[tuple[str, int, int, int, bytes]]]


def cut(source: Path | list[Path], target: Path, span: CutSpan, *, recover: bool = False) -> tuple[CutReport, Content]:
    names = [str(each) for each in source] if isinstance(source, list) else source
    with Log.open(names, recover=recover) as log:
        report = cut_log(log, span, target)
    return report, read_content(target)


def expected_messages(
    content: Content, first_ns: int, last_ns: int
) -> dict[str, list[tuple[str, int, int, int, bytes]]]:
    inside = {topic: [row for row in rows if first_ns <= row[1] <= last_ns] for topic, rows in content.messages.items()}
    return {topic: rows for topic, rows in inside.items() if rows}


@pytest.mark.parametrize("kind", SOURCES)
def test_messages_of_the_span_are_byte_exact(tmp_path: Path, kind: str) -> None:
    source = write_log(tmp_path / "in.mcap", **SOURCES[kind])
    report, content = cut(source, tmp_path / "out.mcap", CutSpan(FIRST_NS, LAST_NS))
    expected = expected_messages(read_content(write_log(tmp_path / "same.mcap")), FIRST_NS, LAST_NS)
    assert content.messages == expected
    assert report.n_messages == {topic: len(rows) for topic, rows in sorted(expected.items())}
    assert content.metadata[0] == ("provenance", {"source": "here"})
    (_, record) = content.metadata[1]
    assert (record["first_log_time_ns"], record["last_log_time_ns"]) == (str(FIRST_NS), str(LAST_NS))
    assert [each[0] for each in content.attachments] == ["notes.txt"]  # logged at 1 ns, before the span
    assert content.profile == "test-drive"


@pytest.mark.parametrize("kind", ["zstd", "lz4", "uncompressed", "without message indexes"])
def test_chunks_inside_are_copied_and_only_edges_are_rewritten(tmp_path: Path, kind: str) -> None:
    source = write_log(tmp_path / "in.mcap", **{"chunk_size": 1000} | SOURCES[kind])
    report, _ = cut(source, tmp_path / "out.mcap", CutSpan(FIRST_NS, LAST_NS))
    old, new = chunk_bytes(source), chunk_bytes(tmp_path / "out.mcap")
    with source.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    spans = [(c.message_start_time, c.message_end_time) for c in summary.chunk_indexes]
    n_touched = sum(first <= LAST_NS and last >= FIRST_NS for first, last in spans)
    n_inside = sum(first >= FIRST_NS and last <= LAST_NS for first, last in spans)
    assert (report.n_chunks_copied, report.n_chunks_rewritten) == (n_inside, n_touched - n_inside)
    assert n_inside > 10
    assert len(new) == n_touched > n_inside
    assert len(set(new) & set(old)) == report.n_chunks_copied


def test_whole_chunks_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = write_log(tmp_path / "in.mcap")
    opened: list[int] = []
    from cwcli.logs.read import message_reader

    decompress = decompress_chunk

    def noting(file: object, chunk: object, *, verify: bool) -> memoryview:
        opened.append(chunk.chunk_start)  # type: ignore[attr-defined]
        return decompress(file, chunk, verify=verify)  # type: ignore[arg-type]

    monkeypatch.setattr(message_reader, "decompress_chunk", noting)
    report, _ = cut(source, tmp_path / "out.mcap", CutSpan(FIRST_NS, LAST_NS))
    assert len(opened) == report.n_chunks_rewritten > 0


@pytest.mark.parametrize("kind", ["zstd", "unchunked", "without any summary"])
def test_topics(tmp_path: Path, kind: str) -> None:
    source = write_log(tmp_path / "in.mcap", **SOURCES[kind])
    report, content = cut(source, tmp_path / "out.mcap", CutSpan(topics=frozenset({"/plain", "/silent"})))
    assert content.messages == {"/plain": read_content(source).messages["/plain"]}
    assert report.n_messages == {"/plain": 40}


def test_cut_of_a_cut_equals_the_smaller_cut(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    cut(source, tmp_path / "wide.mcap", CutSpan(FIRST_NS, LAST_NS))
    inner = CutSpan(FIRST_NS + 300 * MILLISECOND, LAST_NS - 300 * MILLISECOND)
    _, twice = cut(tmp_path / "wide.mcap", tmp_path / "twice.mcap", inner)
    _, once = cut(source, tmp_path / "once.mcap", inner)
    assert twice.messages == once.messages
    assert [name for name, _ in twice.metadata] == ["provenance", "cwcli.cut", "cwcli.cut"]
    assert [entries["source"] for _, entries in twice.metadata[1:]] == ["in.mcap", "wide.mcap"]


def test_parts_of_a_log_with_other_ids_are_joined(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap")
    parts = []
    for k, (topics, first_ns, last_ns) in enumerate(
        (({"/plain"}, 0, LAST_NS), ({"/imu"}, 0, FIRST_NS - 1), ({"/imu"}, FIRST_NS, 1 << 63))
    ):
        parts.append(tmp_path / f"part_{k}.mcap")
        cut(whole, parts[-1], CutSpan(first_ns, last_ns, frozenset(topics)))
    with parts[0].open("wb") as stream:  # the same channel under another id
        writer = Writer(stream)
        writer.start("test-drive", "test")
        other = writer.register_channel("/plain", "json", 0)
        for _, log_time, publish_time, sequence, data in read_content(whole).messages["/plain"]:
            writer.add_message(other, log_time, data, publish_time, sequence)
        writer.finish()
    span = CutSpan(FIRST_NS - 100 * MILLISECOND, FIRST_NS + 100 * MILLISECOND)
    _, content = cut(parts, tmp_path / "out.mcap", span)
    assert content.messages == expected_messages(read_content(whole), span.first_ns, span.last_ns)


def write_latched_log(path: Path) -> Path:
    """Two static transforms of two publishers, one sent twice; a latched map sent twice; a plain topic at 10 Hz."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=100)
        writer.start("", "test")
        static = writer.register_channel("/robot/tf_static", "cdr", 0)
        latched = writer.register_channel("/map", "cdr", 0, {"offered_qos_profiles": LATCHED_QOS})
        plain = writer.register_channel("/speed", "cdr", 0)
        for at, channel, data in (
            (0, static, b"lidar"),
            (1, static, b"camera"),
            (2, latched, b"old map"),
            (3, static, b"lidar"),
            (4, latched, b"map"),
            (70, latched, b"new map"),
            *((k, plain, b"%d" % k) for k in range(0, 100, 10)),
        ):
            writer.add_message(channel, at, data, at, at)
        writer.finish()
    return path


def test_latched_messages_before_the_span_are_kept_in_a_chunk_of_their_own(tmp_path: Path) -> None:
    source = write_latched_log(tmp_path / "in.mcap")
    report, content = cut(source, tmp_path / "out.mcap", CutSpan(35, 80))
    by_topic = {topic: [(row[1], row[4]) for row in rows] for topic, rows in content.messages.items()}
    assert by_topic["/robot/tf_static"] == [(1, b"camera"), (3, b"lidar")]
    assert by_topic["/map"] == [(4, b"map"), (70, b"new map")]
    assert [at for at, _ in by_topic["/speed"]] == [40, 50, 60, 70, 80]
    assert content.in_file_order[:3] == [("/robot/tf_static", 1), ("/robot/tf_static", 3), ("/map", 4)]
    assert report.n_earlier == {"/map": 1, "/robot/tf_static": 2}
    _, plain = cut(source, tmp_path / "plain.mcap", CutSpan(35, 80, keeps_latched=False))
    assert "/robot/tf_static" not in plain.messages
    _, speed = cut(source, tmp_path / "last.mcap", CutSpan(35, 80, last_of=frozenset({"/speed"})))
    assert [row[1] for row in speed.messages["/speed"]] == [30, 40, 50, 60, 70, 80]


def test_attachments_after_the_span_are_left_out_and_counted(tmp_path: Path) -> None:
    source = tmp_path / "in.mcap"
    with source.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "test")
        channel = writer.register_channel("/a", "json", 0)
        for at in range(10):
            writer.add_message(channel, at, b"{}", at)
            writer.add_attachment(at, at, f"{at}.txt", "text/plain", b"x")
        writer.finish()
    report, content = cut(source, tmp_path / "out.mcap", CutSpan(2, 4))
    assert [each[0] for each in content.attachments] == ["0.txt", "1.txt", "2.txt", "3.txt", "4.txt"]
    assert (report.n_attachments, report.n_attachments_left_out) == (5, 5)


def test_span_without_messages_leaves_no_file(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    with pytest.raises(UsageError, match="no message of the chosen topics"):
        cut(source, tmp_path / "out.mcap", CutSpan(T0_NS + 2, T0_NS + 3))
    with pytest.raises(UsageError, match="no message of the chosen topics"):
        cut(source, tmp_path / "out.mcap", CutSpan(topics=frozenset({"/silent"})))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["in.mcap"]


def test_damaged_chunk_at_the_edge_is_an_error_and_recover_leaves_it_out(tmp_path: Path) -> None:
    source = write_log(tmp_path / "in.mcap")
    with Log.open(source) as log:
        chunk = next(each for each in log.index.items if getattr(each, "end_ns", 0) >= FIRST_NS)
        at = chunk.chunk_start + chunk.chunk_length - 20  # type: ignore[union-attr]
    data = bytearray(source.read_bytes())
    data[at] ^= 0xFF
    source.write_bytes(data)
    with pytest.raises(InputError, match="chunk"):
        cut(source, tmp_path / "out.mcap", CutSpan(FIRST_NS, LAST_NS))
    assert not (tmp_path / "out.mcap").exists()
    report, _ = cut(source, tmp_path / "out.mcap", CutSpan(FIRST_NS, LAST_NS), recover=True)
    assert report.faults


def test_names_of_topics() -> None:
    known = ("/gps/fix", "/gps/heading", "/imu", "/odd[1]")
    assert topics_matching_patterns("/gps/*, /imu", known, "log") == {"/gps/fix", "/gps/heading", "/imu"}
    assert topics_matching_patterns("/odd[1]", known, "log") == {"/odd[1]"}
    with pytest.raises(UsageError) as caught:
        topics_matching_patterns("/gps/fox", known, "log")
    assert "did you mean /gps/fix" in caught.value.hint
    with pytest.raises(UsageError, match="empty name"):
        topics_matching_patterns("/imu,,", known, "log")
