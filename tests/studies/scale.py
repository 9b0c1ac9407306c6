"""What a million drive-hours would cost: `python -m tests.studies.scale [--seconds 60 180]`.

`cwcli run LOG -o FILE --metrics-dir DIR` runs on two simulated logs of different length, with 20 other vehicles at 20 Hz
(`tests.bench.make_long_log`). Processor seconds and bytes are a straight line through both: a constant of each log, and
a part that grows with its length. Memory is no such line, because arrays beyond a bound go to a file
(docs/performance.md), so it is not extrapolated. The rest is calculation, under assumptions that the table names: logs of
one hour, workers that each hold one processor, and a store that answers a request after 20 ms and sends 100 MB/s to
each reader. A worker copies a remote log before it reads it, so reading and computing follow one another.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cwcli.logs.read.read_bounds import COPY_BLOCK_BYTES

HOUR_S = 3600.0
DRIVE_HOURS = 1_000_000
LATENCY_S = 0.020
STORE_BYTES_PER_S = 100e6
WORKERS = 1000


class Cost(NamedTuple):
    """What one run of one log takes."""

    cpu_s: float
    read_bytes: float
    written_bytes: float
    memory_bytes: float


def measure(seconds: float, folder: Path) -> Cost:
    """Run all stages on a simulated log of that length."""
    log, out, tables = folder / f"{seconds:g}.mcap", folder / "out.mcap", folder / "tables"
    subprocess.run([sys.executable, "-m", "tests.bench.make_long_log", log, "--seconds", f"{seconds:g}"], check=True)
    command = [sys.executable, "-m", "cwcli", "run", str(log), "-o", str(out), "--force", "-q"]
    process = subprocess.Popen([*command, "--metrics-dir", str(tables)])
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"cwcli run failed with {process.returncode}")
    written = out.stat().st_size + sum(path.stat().st_size for path in tables.rglob("*") if path.is_file())
    return Cost(usage.ru_utime + usage.ru_stime, log.stat().st_size, written, usage.ru_maxrss * 1024)


def extrapolate(short: Cost, long: Cost, seconds: Sequence[float], to_s: float) -> Cost:
    """The straight line through both, at another length."""
    share = (to_s - seconds[0]) / (seconds[1] - seconds[0])
    return Cost(*(one + share * (two - one) for one, two in zip(short, long, strict=True)))


def copy_time_s(n_bytes: float, block_bytes: float) -> float:
    """How long one reader takes for a log, if each block is a request of its own."""
    return -(-n_bytes // block_bytes) * LATENCY_S + n_bytes / STORE_BYTES_PER_S


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, nargs=2, default=(60.0, 180.0), metavar=("SHORT", "LONG"))
    seconds = parser.parse_args(arguments).seconds
    with tempfile.TemporaryDirectory() as folder:
        costs = [measure(each, Path(folder)) for each in seconds]
    hour = extrapolate(costs[0], costs[1], seconds, HOUR_S)
    print("| log | processor | read | written | memory |\n|---|---|---|---|---|")
    names = [*(f"{each:g} s, measured" for each in seconds), "one hour, extrapolated"]
    for name, cost in zip(names, [*costs, hour], strict=True):
        sizes = f"{cost.read_bytes / 1e6:.0f} MB | {cost.written_bytes / 1e6:.0f} MB"
        memory = "" if cost is hour else f"{cost.memory_bytes / 1e6:.0f} MB"
        print(f"| {name} | {cost.cpu_s:.0f} s | {sizes} | {memory} |")
    print(f"\n| {DRIVE_HOURS:g} drive-hours on {WORKERS} workers | |\n|---|---|")
    print(f"| processor | {hour.cpu_s * DRIVE_HOURS / HOUR_S:.3g} processor-hours |")
    print(
        f"| read, written | {hour.read_bytes * DRIVE_HOURS / 1e12:.0f} TB, {hour.written_bytes * DRIVE_HOURS / 1e12:.0f} TB |"
    )
    for what, block in (("in one request", hour.read_bytes), ("1 MiB at a time", float(COPY_BLOCK_BYTES))):
        copy_s = copy_time_s(hour.read_bytes, block)
        whole_s = (copy_s + hour.cpu_s) * DRIVE_HOURS / WORKERS
        print(
            f"| copying a log {what} | {copy_s:.1f} s, {copy_s / (copy_s + hour.cpu_s):.1%} of the time of a worker |"
        )
        print(f"| the same: until all is done | {whole_s / 86400.0:.1f} days |")


if __name__ == "__main__":
    main()
