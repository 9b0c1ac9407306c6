"""Whole processes: `cwcli estimate` against the official reading loop alone, its memory; `cwcli info` against numpy.

    PYTHONPATH=. python tests/bench/bench_process.py                 # the ten-minute log with 640 x 480 JPEG frames
    PYTHONPATH=. python tests/bench/bench_process.py --seconds 120   # a small one

`cwcli estimate` writes the annotated file too. The official loop brings the same topics into NumPy columns and does
nothing else. Anonymous memory is polled from /proc (Linux), once with the frames in the log and once without them.
Prints a Markdown table and exits with 1 when a bound is missed.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.bench.bench_read import read_cwcli, read_official
from tests.bench.make_log import WRITERS, drive

MAX_ANONYMOUS_MB = 300.0
MAX_GROWTH_MB = 15.0
MAX_INFO_RATIO = 2.0
POLL_S = 0.002


def peak_anonymous_mb(command: list[str]) -> tuple[float, float]:
    """Seconds and peak anonymous memory of a process."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak_kb = 0
    while process.poll() is None:
        try:
            found = re.search(r"RssAnon:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text())
        except OSError:
            break
        peak_kb = max(peak_kb, int(found[1]) if found else 0)
        time.sleep(POLL_S)
    seconds = time.perf_counter() - start
    if process.wait() != 0:
        raise SystemExit(f"{' '.join(command)} failed")
    return seconds, peak_kb / 1024


def estimate(source: Path, target: Path) -> tuple[float, float]:
    """Seconds and memory of `cwcli estimate`."""
    return peak_anonymous_mb([sys.executable, "-m", "cwcli", "estimate", str(source), "-o", str(target), "--force"])


def best_seconds(command: list[str], repeats: int = 7) -> float:
    """The shortest of some runs of a process."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> int:
    """Measure; 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=600)
    options = parser.parse_args()
    rows: list[tuple[str, str, str, str, bool]] = []
    data = drive(options.seconds)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        for name, write in WRITERS.items():
            source = path / f"{name}.mcap"
            write(source, data, images=True)
            leaves = read_cwcli(source)
            start = time.perf_counter()
            read_official(source, leaves)
            official_s = time.perf_counter() - start
            ours_s, memory_mb = min(estimate(source, path / "out.mcap") for _ in range(3))
            rows.append(
                (
                    f"{name}: `cwcli estimate`, process",
                    f"{ours_s:.2f} s",
                    f"official loop {official_s:.2f} s",
                    f"{ours_s / official_s:.2f}, below 1",
                    ours_s < official_s,
                )
            )
            plain = path / f"{name}-plain.mcap"
            write(plain, data, images=False)
            _, plain_mb = estimate(plain, path / "out.mcap")
            growth_mb = memory_mb - plain_mb
            rows.append(
                (
                    f"{name}: anonymous memory",
                    f"{memory_mb:.0f} MB",
                    f"without frames {plain_mb:.0f} MB",
                    f"below {MAX_ANONYMOUS_MB:.0f} MB, growth below {MAX_GROWTH_MB:.0f} MB",
                    memory_mb < MAX_ANONYMOUS_MB and growth_mb < MAX_GROWTH_MB,
                )
            )
            source.unlink()
            plain.unlink()
        log = path / "info.mcap"
        WRITERS["cdr"](log, drive(60), images=False)
        numpy_s = best_seconds([sys.executable, "-c", "import numpy"])
        info_s = best_seconds([sys.executable, "-m", "cwcli", "info", str(log)])
        rows.append(
            (
                "`cwcli info`, process",
                f"{1e3 * info_s:.0f} ms",
                f"`import numpy` {1e3 * numpy_s:.0f} ms",
                f"{info_s / numpy_s:.2f}, below {MAX_INFO_RATIO:.0f}",
                info_s < MAX_INFO_RATIO * numpy_s,
            )
        )
    print("| what | cwcli | beside | bound | holds |\n|---|---|---|---|---|")
    for what, ours, beside, bound, holds in rows:
        print(f"| {what} | {ours} | {beside} | {bound} | {'yes' if holds else 'NO'} |")
    return int(not all(row[-1] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
