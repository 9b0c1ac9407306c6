"""Runs over many logs: what a short log costs, two workers against one, and memory against the number of logs.

    PYTHONPATH=. python tests/bench/bench_fleet.py                  # 8 equal logs, 100 short ones
    PYTHONPATH=. python tests/bench/bench_fleet.py --short 1000     # as many short logs as docs/performance.md has

A short log is five seconds of the bundled intersection: an ego at 20 Hz, an IMU, another vehicle over V2X. The equal
logs are the ten-minute drive of the other benchmarks without its frames. Two workers need two free processors: beside
the wall times stands the processor time, of which two workers must not use more than one. Prints a Markdown table and
exits with 1 when a bound is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from tests.bench.make_log import WRITERS, drive

from tests.cli.fleet_logs import cut

ROOT = Path(__file__).parents[2]
MAX_SHORT_S = 0.1
MIN_SPEED_UP = 1.8
MAX_GROWTH_MB = 10.0
ROUNDS = 2


class Row(NamedTuple):
    """A line of the table."""

    what: str
    measured: str
    bound: str = ""
    is_met: bool = True


def run(folder: Path, pattern: str, jobs: int) -> tuple[float, float, dict[str, Any]]:
    """Wall seconds and peak memory (MB) of one fresh run, and its run times."""
    shutil.rmtree(folder / "out", ignore_errors=True)
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", "run", pattern, "-d", "out", "--jobs", str(jobs), "--quiet"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall_s = time.perf_counter() - begin
    if process.returncode != 0:
        raise SystemExit(f"cwcli run failed with {process.returncode}")
    return wall_s, usage.ru_maxrss / 1024, json.loads((folder / "out/run_times.json").read_text())


def processor_s(times: dict[str, Any]) -> float:
    """Processor time of all logs."""
    return float(sum(entry["cpu_s"] for entry in times["logs"].values()))


def worker_mb(times: dict[str, Any]) -> float:
    """Peak memory of the largest worker."""
    return max(float(entry["peak_mb"]) for entry in times["logs"].values())


def copies(folder: Path, log: Path, n: int) -> None:
    """`n` logs of one content."""
    folder.mkdir()
    for k in range(n):
        (folder / f"d{k:04}.mcap").hardlink_to(log)


def short_logs(folder: Path, n: int) -> list[Row]:
    """What a short log costs on one worker, and how memory grows."""
    log = cut(ROOT / "sample_logs/intersection.mcap", folder / "short.mcap", seconds=5.0)
    copies(folder / "few", log, n // 10)
    copies(folder / "many", log, n)
    _, few_mb, few = run(folder, "few/*.mcap", 1)
    wall_s, many_mb, many = run(folder, "many/*.mcap", 1)
    each_s, each_cpu_s = wall_s / n, processor_s(many) / n
    growth_mb = many_mb - few_mb
    workers_mb = worker_mb(many) - worker_mb(few)
    name = f"{n} logs of five seconds, one worker"
    more = f"{n} logs less {n // 10}"
    return [
        Row(f"{name}: wall time a log", f"{each_s:.3f} s", f"{MAX_SHORT_S} s", each_s <= MAX_SHORT_S),
        Row("the same: processor time a log", f"{each_cpu_s:.3f} s", f"{MAX_SHORT_S} s", each_cpu_s <= MAX_SHORT_S),
        Row(
            f"memory of the command: {more}",
            f"{growth_mb:+.1f} MB",
            f"{MAX_GROWTH_MB:g} MB",
            growth_mb <= MAX_GROWTH_MB,
        ),
        Row(
            f"memory of the worker: {more}",
            f"{workers_mb:+.1f} MB",
            f"{MAX_GROWTH_MB:g} MB",
            workers_mb <= MAX_GROWTH_MB,
        ),
    ]


def equal_logs(folder: Path, seconds: float) -> list[Row]:
    """Two workers against one on eight equal logs; they take turns, the best of each counts."""
    log = folder / "long.mcap"
    WRITERS["cdr"](log, drive(round(seconds)), images=False)
    copies(folder / "equal", log, 8)
    best_s, cpu_s = {1: float("inf"), 2: float("inf")}, {1: float("inf"), 2: float("inf")}
    for _ in range(ROUNDS):
        for jobs in (1, 2):
            wall_s, _, times = run(folder, "equal/*.mcap", jobs)
            best_s[jobs], cpu_s[jobs] = min(best_s[jobs], wall_s), min(cpu_s[jobs], processor_s(times))
    ratio = best_s[1] / best_s[2]
    walls = f"{best_s[1]:.1f} s / {best_s[2]:.1f} s = {ratio:.2f}"
    processors = f"{cpu_s[1]:.1f} s / {cpu_s[2]:.1f} s = {cpu_s[1] / cpu_s[2]:.2f}"
    return [
        Row("8 equal logs: one worker against two, wall time", walls, str(MIN_SPEED_UP), ratio >= MIN_SPEED_UP),
        Row("the same, processor time", processors),
        Row("of one worker's wall time, work on logs", f"{100 * cpu_s[1] / best_s[1]:.0f} %"),
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", type=int, default=100, help="number of short logs")
    parser.add_argument("--seconds", type=float, default=120.0, help="length of the equal logs")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = short_logs(Path(name), options.short) + equal_logs(Path(name), options.seconds)
    print("| what | measured | bound | |\n|---|---|---|---|")
    for row in rows:
        print(f"| {row.what} | {row.measured} | {row.bound} | {'' if row.is_met else 'MISSED'} |")
    return 0 if all(row.is_met for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
