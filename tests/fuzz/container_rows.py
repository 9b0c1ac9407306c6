"""The messages of a bag or a database, by cwcli and by another reader: what their cases share."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from cwcli.errors import CwcliError
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from tests.fuzz.file_cases import fast_folder
from tests.fuzz.mutate import Rng

N_INPUTS = 4
Rows = Counter[tuple[str, int, bytes]]
"""Topic, log time in ns and payload of each message, and how often it occurs."""
Read = Callable[[InputFile, SourceFormat, ReadBounds], Iterable[Any]]
"""Schemas, channels and messages (channel, log time in ns, payload) of a file."""


def check_mutants(
    rng: Rng, name: str, mutant: Callable[[Rng], bytes], check: Callable[[Path, Counter[str]], None]
) -> dict[str, int]:
    """Check a few mutated files of a name; counts of inputs."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
            path = Path(folder) / name
            path.write_bytes(mutant(rng))
            check(path, counts)
    return dict(counts)


def compare_rows(path: Path, counts: Counter[str], read: Read, official_rows: Callable[[Path], Rows | None]) -> None:
    """Compare the messages of a file that both accept; where something is counted, both may lack messages.

    Raises:
        AssertionError: A message is another one, or recovery changes an intact file.
    """
    counts["inputs"] += 1
    ours, notes = read_rows(path, read, recover=False)
    recovered, _ = read_rows(path, read, recover=True)
    if ours is None:
        return
    assert recovered == ours, "recovery changes an intact file"
    counts["accepted"] += 1
    official = official_rows(path)
    if official is None:
        return
    counts["compared"] += 1
    if notes:
        counts["counted"] += 1
    else:
        assert official == ours, (list((official - ours).items())[:3], list((ours - official).items())[:3])


def read_rows(path: Path, read: Read, *, recover: bool) -> tuple[Rows | None, dict[str, int]]:
    """The messages that cwcli reads, None if it refuses; and what it counts."""
    source = SourceFormat("a file")
    topics: dict[int, str] = {}
    rows: Rows = Counter()
    try:
        with InputFile.open(path) as file:
            for item in read(file, source, ReadBounds(recover=recover)):
                if isinstance(item, Channel):
                    topics[item.id] = item.topic
                elif not isinstance(item, Schema):
                    rows[topics[item[0]], item[1], bytes(item[2])] += 1
    except CwcliError as error:
        assert "\n" not in str(error)
        return None, source.notes
    return rows, source.notes
