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

from cwcli.logs.ros1.bag import BagReader
from tests.fuzz.container_rows import Rows, check_mutants, compare_rows
from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.logs_read.test_bags import bag

MARKS = (b"op=\x02", b"op=\x05", b"op=\x07", b"conn=", b"time=")
TOKENS = (*NUMBERS, *MARKS, b"float64", b"string", b"[]", b"[3]", b"[9999999]")
HEADER = "std_msgs/msg/Header"
COMPRESSIONS = (None, None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4)


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate a bag a few times and check each; counts of inputs."""
    return check_mutants(
        rng, "in.bag", lambda rng: mutate(rng, _bag(int(rng.integers(len(COMPRESSIONS)))), TOKENS), check_bag
    )


def check_bag(path: Path, counts: Counter[str]) -> None:
    """Compare the messages of a bag with those that `rosbags` reads."""
    compare_rows(
        path, counts, lambda file, source, bounds: BagReader(file, source, bounds).iter_content(), official_rows
    )


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
