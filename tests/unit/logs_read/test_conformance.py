"""The 416 files of the MCAP conformance suite: read, recovered and copied without a loss, and without a false fault."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from cwcli.logs.read.message_reader import MessageReader
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import CopyOptions, annotate_log
from tests.unit.logs_read.conformance import CONTENTS, PAYLOAD, SHA256, Content, every_file

FILES = {name: (content, data) for name, content, data in every_file()}
Rows = list[tuple[int, int, int, bytes]]


def messages(log: Log) -> Rows:
    """Sequence, log time, publish time and payload of every message, in file order."""
    reader = MessageReader(log.file, log._index, log.faults, recover=log.recover)
    return [
        (int(sequence), log_time_ns, int(publish_time_ns), bytes(payload))
        for batch in reader.iter_batches([channel.id for channel in log.channels])
        for sequence, publish_time_ns, (log_time_ns, payload) in zip(
            batch.sequence, batch.publish_time_ns, batch.iter_log_times_and_payloads(), strict=True
        )
    ]


def check(path: Path, content: Content, *, recover: bool) -> None:
    """Everything of the content is in the file, once, and nothing is wrong with it."""
    with Log.open(path, recover=recover) as log:
        assert messages(log) == [(*each, PAYLOAD) for each in content.messages]
        assert [channel.topic for channel in log.channels] == ["example"] * bool(content.messages)
        assert [each.name for each in log.attachments] == ["myFile"] * content.has_attachment
        assert list(log.metadata) == [("myMetadata", {"foo": "bar"})] * content.has_metadata
        assert log.faults.counts_by_reason() == {}


def test_files_are_those_that_are_published() -> None:
    lines: dict[str, list[str]] = {name: [] for name in CONTENTS}
    for name, (_, data) in sorted(FILES.items()):
        lines[name.split("-")[0]].append(f"{name} {sha256(data).hexdigest()}\n")
    assert sum(map(len, lines.values())) == 416
    assert {name: sha256("".join(each).encode()).hexdigest() for name, each in lines.items()} == SHA256


@pytest.mark.parametrize("recover", [False, True], ids=["plain", "recover"])
@pytest.mark.parametrize("content", CONTENTS)
def test_every_file_is_read_and_copied(
    tmp_path: Path, content: str, recover: bool, tries: Callable[[int, int], int]
) -> None:
    """With `--recover` every third file, and with pytest's `--long` every one."""
    source, target = tmp_path / "in.mcap", tmp_path / "out.mcap"
    files = [(name, *each) for name, each in FILES.items() if name.split("-")[0] == content]
    for name, expected, data in files[:: tries(3, 1) if recover else 1]:
        source.write_bytes(data)
        check(source, expected, recover=recover)
        with Log.open(source, recover=recover) as log:
            report = annotate_log(log, [], {}, target, force=True, options=CopyOptions(durable=False))
        assert (report.n_chunks_lost, report.n_bytes_lost) == (0, 0), name
        check(target, expected, recover=False)
        with target.open("rb") as stream:
            read = [(m.sequence, m.log_time, m.publish_time, m.data) for _, _, m in make_reader(stream).iter_messages()]
        assert sorted(read) == sorted((*each, PAYLOAD) for each in expected.messages), name
        with target.open("rb") as stream:
            assert [*StreamReader(stream, validate_crcs=True).records], name
