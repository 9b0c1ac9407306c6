"""Cases of the level `bag`: a mutated ROS 1 bag, compared with what the library `rosbags` reads."""

from __future__ import annotations

import tempfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cwcli.errors import CwcliError
from cwcli.input import InputFile
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from cwcli.logs.ros1.bag import BagReader
from tests.fuzz.file_cases import fast_folder
from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.logs_read.test_bags import bag

N_INPUTS = 4
MARKS = (b"op=\x02", b"op=\x05", b"op=\x07", b"conn=", b"time=")
TOKENS = (*NUMBERS, *MARKS, b"float64", b"string", b"[]", b"[3]", b"[9999999]")
HEADER = "std_msgs/msg/Header"
COMPRESSIONS = (None, None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4)
Rows = Counter[tuple[str, int, bytes]]
"""Topic, log time in ns and payload of each message, and how often it occurs."""


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate a bag a few times and check each; counts of inputs."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        data = mutate(rng, _bag(int(rng.integers(len(COMPRESSIONS)))), TOKENS)
        with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
            path = Path(folder) / "in.bag"
            path.write_bytes(data)
            check_bag(path, counts)
    return dict(counts)


def check_bag(path: Path, counts: Counter[str]) -> None:
    """Compare the messages of a bag that both accept; where something is counted, both may lack messages."""
    counts["inputs"] += 1
    ours, notes = read_bag(path, recover=False)
    recovered, _ = read_bag(path, recover=True)
    assert ours is None or recovered == ours, "recovery changes an intact bag"
    official = official_rows(path)
    if ours is not None:
        counts["accepted"] += 1
    if ours is None or official is None:
        return
    counts["compared"] += 1
    if notes:
        counts["counted"] += 1
    else:
        assert official == ours, (list((official - ours).items())[:3], list((ours - official).items())[:3])


def read_bag(path: Path, *, recover: bool) -> tuple[Rows | None, dict[str, int]]:
    """The messages that cwcli reads, None if it refuses; and what it counts."""
    source = SourceFormat("a bag")
    topics: dict[int, str] = {}
    rows: Rows = Counter()
    try:
        with InputFile.open(path) as file:
            for item in BagReader(file, source, ReadBounds(recover=recover)).iter_content():
                if isinstance(item, Channel):
                    topics[item.id] = item.topic
                elif not isinstance(item, Schema):
                    rows[topics[item[0]], item[1], item[2]] += 1
    except CwcliError as error:
        assert "\n" not in str(error)
        return None, source.notes
    return rows, source.notes


def official_rows(path: Path) -> Rows | None:
    """The same by `rosbags`, None if it refuses."""
    rows: Rows = Counter()
    try:
        with Reader(path) as reader:
            stores: dict[int, Any] = {}
            for each in reader.connections:
                types = get_types_from_msg(each.msgdef.data, each.msgtype)
                if HEADER in types:
                    types[HEADER] = get_typestore(Stores.LATEST).fielddefs[HEADER]
                stores[each.id] = get_typestore(Stores.EMPTY)
                stores[each.id].register(types)
            for connection, time_ns, data in reader.messages():
                converted = stores[connection.id].ros1_to_cdr(data, connection.msgtype)
                rows[connection.topic, time_ns, bytes(converted)] += 1
    except Exception:  # it raises what it comes upon
        return None
    return rows


@cache
def _bag(k: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return bag(Path(folder) / "x.bag", COMPRESSIONS[k]).read_bytes()
