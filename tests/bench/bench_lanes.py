"""`cwcli lanes`, the whole process, against decoding the same frames to grey alone.

    PYTHONPATH=. python tests/bench/bench_lanes.py                  # ten minutes at 10 Hz, 640 x 480
    PYTHONPATH=. python tests/bench/bench_lanes.py --frames 600     # a minute
    PYTHONPATH=. python tests/bench/bench_lanes.py --log drive.mcap # a log of your own

The log holds rendered frames (`cwcli simulate road`), a drive of twenty seconds over and over. Decoding alone is a
process too: it takes the frames from the file with the official reader and decodes them to grey, at full size, with
OpenCV in two threads. Both are run in turn, so that other work on the machine meets both; the ratio is the median of
those of the pairs. Prints a Markdown table and exits with 1 when a bound is missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

MAX_RATIO = 1.5
TOPIC = "/camera/image"
LOOP_S, RATE_HZ = 20.0, 10.0
START_NS = 1_700_000_000_000_000_000
THREADS = 2


def write_log(path: Path, n_frames: int) -> None:
    """A log of rendered JPEG frames, with the official writer."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from mcap_protobuf.writer import Writer

    from cwcli.simulate.road_log import plan_configured_drive, parse_road_log_config

    config = parse_road_log_config("clear", 1, (f"duration_s={LOOP_S}", f"rate_hz={RATE_HZ}", "size=640x480"))
    import cv2

    pictures = [
        cv2.imencode(".jpg", frame.grey, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        for frame in plan_configured_drive(config).iter_rendered_frames()
    ]
    with path.open("wb") as stream, Writer(stream) as writer:
        for k in range(n_frames):
            ns = START_NS + round(k * 1e9 / RATE_HZ)
            message = CompressedImage(frame_id="camera", format="jpeg", data=pictures[k % len(pictures)])
            message.timestamp.FromNanoseconds(ns)
            writer.write_message(TOPIC, message, ns, ns)


def decode(path: Path) -> int:
    """Decode all frames of a log to grey; how many there were."""
    import cv2
    import numpy as np
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from mcap.reader import make_reader

    cv2.setNumThreads(1)

    def grey(data: bytes) -> int:
        message = CompressedImage.FromString(data)
        return int(np.asarray(cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE)).shape[0])

    n = 0
    waiting: deque[Future[int]] = deque()
    with path.open("rb") as stream, ThreadPoolExecutor(THREADS) as pool:
        for _, _, message in make_reader(stream).iter_messages(topics=[TOPIC]):
            waiting.append(pool.submit(grey, message.data))
            if len(waiting) > 4 * THREADS:
                n += waiting.popleft().result() > 0
        n += sum(future.result() > 0 for future in waiting)
    return n


def seconds(command: list[str]) -> tuple[float, float]:
    """Wall and processor time of a process."""
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - start, used


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=6000)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--decode", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.decode is not None:
        print(decode(options.decode))
        return 0
    from cwcli.vision.methods import methods_without_model

    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled
    subprocess.run([sys.executable, "-m", "cwcli", "lanes", "--help"], check=True, stdout=subprocess.DEVNULL)
    print("| method | cwcli lanes | decoding alone | ratio of each pair | median | bound | ratio of processor times |")
    print("|---|---|---|---|---|---|---|")
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        log = options.log
        if log is None:
            log = Path(folder) / "frames.mcap"
            write_log(log, options.frames)
        for method in methods_without_model():
            whole, alone = [], []
            for _ in range(options.pairs):
                alone.append(seconds([sys.executable, __file__, "--decode", str(log)]))
                target = Path(folder) / "out.mcap"
                target.unlink(missing_ok=True)  # the removal of half a gigabyte is no part of the work
                arguments = ["lanes", str(log), "--method", method, "-o", str(target)]
                whole.append(seconds([sys.executable, "-m", "cwcli", *arguments]))
            ratios = [ours[0] / theirs[0] for ours, theirs in zip(whole, alone, strict=True)]
            used = statistics.median(ours[1] / theirs[1] for ours, theirs in zip(whole, alone, strict=True))
            ratio = statistics.median(ratios)
            failed |= ratio > MAX_RATIO
            each = ", ".join(f"{value:.2f}" for value in ratios)
            times = " | ".join(f"{statistics.median(wall for wall, _ in runs):.1f} s" for runs in (whole, alone))
            print(f"| {method} | {times} | {each} | {ratio:.2f} | {MAX_RATIO:g} | {used:.2f} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
