"""Reading all signal columns against the official reader with its official decoders, in one run.

    PYTHONPATH=. python tests/bench/bench_read.py                # ten minutes, signals only
    PYTHONPATH=. python tests/bench/bench_read.py --images       # the same with a camera in between (250 MB a file)

Both bring every leaf of the same topics into NumPy columns. The official loop fetches the leaves of a message with one
`operator.attrgetter` (for JSON: a chain of subscripts) and makes the arrays at the end. Each side opens the file anew;
the best of the runs counts. Prints a Markdown table and exits with 1 when a ratio is below its bound.
"""

from __future__ import annotations

import argparse
import json
import operator
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.bench.make_log import BSM_TOPIC, GNSS_TOPIC, IMU_TOPIC, WRITERS, drive
from mcap.decoder import DecoderFactory
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Factory

from cwcli.logs.read.reader import Log

BOUNDS = {"cdr": 8.0, "protobuf": 4.0, "json": 4.0}
TOPICS = (IMU_TOPIC, GNSS_TOPIC, BSM_TOPIC)


class JsonFactory(DecoderFactory):
    """The json module in the shape of the official decoders."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        return json.loads if message_encoding == "json" else None


def read_cwcli(path: Path) -> dict[str, list[str]]:
    """All leaves of the topics; returns their paths."""
    with Log.open(path) as log:
        loaded = log.load_topics(dict.fromkeys(TOPICS))
    return {topic: list(columns.fields) for topic, columns in loaded.items()}


def read_official(path: Path, paths: dict[str, list[str]]) -> dict[str, list[np.ndarray]]:
    """The same leaves by the official way."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Ros2Factory(), ProtobufFactory(), JsonFactory()])
        rows: dict[str, list[Any]] = {topic: [] for topic in TOPICS}
        getters = {topic: _getter(leaves, is_json="json" in path.name) for topic, leaves in paths.items()}
        for _, channel, _, decoded in reader.iter_decoded_messages(topics=TOPICS):
            rows[channel.topic].append(getters[channel.topic](decoded))
    return {topic: [np.array(column) for column in zip(*found, strict=True)] for topic, found in rows.items()}


def _getter(leaves: list[str], *, is_json: bool) -> Callable[[Any], Any]:
    if not is_json:
        return operator.attrgetter(*leaves)
    code = ", ".join("m" + "".join(f"[{name!r}]" for name in leaf.split(".")) for leaf in leaves)
    return eval(f"lambda m: ({code},)")  # our own field names


def _best(function: Callable[[], object], n: int) -> float:
    times = []
    for _ in range(n):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> int:
    """Measure; 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--images", action="store_true")
    parser.add_argument("--folder", type=Path, help="where the logs are, or are to be left")
    options = parser.parse_args()
    missed = False
    data = drive(options.seconds)
    print("| encoding | messages | cwcli | official | ratio | bound |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        for name, write in WRITERS.items():
            path = (options.folder or Path(temporary)) / f"{name}.mcap"
            if not path.exists():
                write(path, data, images=options.images)
            paths = read_cwcli(path)
            ours = _best(lambda path=path: read_cwcli(path), 5)
            official = _best(lambda path=path, paths=paths: read_official(path, paths), 1)
            n = len(data.imu_ns) + len(data.gnss_ns) + len(data.car_ns)
            ratio = official / ours
            print(f"| {name} | {n} | {ours:.3f} s | {official:.2f} s | {ratio:.0f} | {BOUNDS[name]:.0f} |", flush=True)
            missed |= ratio < BOUNDS[name]
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
