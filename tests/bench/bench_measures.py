"""The measures' speed: microseconds a pair and step, and whole processes. `python tests/bench/bench_measures.py`.

It prints a Markdown table and exits with 1 when a limit is not reached. All times are processor time, so that what else
the machine does hardly counts. The states of the whole process are those of the ego and nineteen others that drive in
columns beside and behind one another for ten minutes, at 20 Hz.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.logs.write.writer import LogWriter
from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.columns import Strings
from cwcli.signals.vehicle_state import N_STATES

STEP_NS = 50_000_000
N_STEPS = 12_000
N_CARS = 20
ROUNDS = 5
STEERED = ("ttb", "ttk", "tts")
MAX_ALL_US, MAX_TTC_US, MAX_STEERED_US = 3.0, 0.3, 50.0
MAX_PROCESS_S, MAX_PROCESS_MB = 5.0, 400.0
MIB_PER_KIB = 1.0 / 1024.0


def drive(column: int, place: int, n: int) -> np.ndarray:
    """States (n, 8) of a car in a column that goes faster and slower, each a little later than the one ahead."""
    time_s = np.arange(n) * STEP_NS / 1e9
    phase = 0.4 * (time_s - 1.5 * place) + column
    speed, accel = 15.0 + 6.0 * np.sin(phase), 2.4 * np.cos(phase)
    way = 15.0 * time_s - 15.0 * np.cos(phase) - 25.0 * place
    state = np.zeros((n, N_STATES))
    state[:, 0], state[:, 1], state[:, 2], state[:, 4] = way, 3.5 * column, speed, accel
    return state


def near_pairs(n: int) -> list[Pair]:
    """The ego and each other one."""
    tracks = [ActualTrack(np.arange(n) * STEP_NS, drive(k % 2, k // 2, n)) for k in range(N_CARS)]
    return [Pair(tracks[0], other, (4.5, 1.8), (4.5, 1.8), 0.5) for other in tracks[1:]]


def microseconds(names: Sequence[str], n: int) -> float:
    """Best of some rounds, for a pair and step."""
    found = []
    for _ in range(ROUNDS):
        pairs = near_pairs(n)
        began = time.process_time()
        for pair in pairs:
            for name in names:
                pair.evaluate_measure(MEASURES[name])
        found.append((time.process_time() - began) / (len(pairs) * n) * 1e6)
    return min(found)


def on_collision_course() -> float:
    """TTB, TTK and TTS of one that closes up, microseconds a step."""
    n = 2000
    ego, other = np.zeros((2, n, N_STATES))
    ego[:, 2], other[:, 0], other[:, 2] = 20.0, np.linspace(80.0, 20.0, n), 8.0
    found = []
    for _ in range(ROUNDS):
        tracks = [ActualTrack(np.arange(n) * STEP_NS, each) for each in (ego, other)]
        pair = Pair(tracks[0], tracks[1], (4.5, 1.8), (4.5, 1.8), 0.5)
        began = time.process_time()
        for name in STEERED:
            pair.evaluate_measure(MEASURES[name])
        found.append((time.process_time() - began) / n * 1e6)
    return min(found)


def write_states_log(path: Path) -> None:
    """What `cwcli estimate` would have written, without its sensors."""
    stamps = 1_700_000_000_000_000_000 + np.arange(N_STEPS, dtype=np.int64) * STEP_NS
    covariance = np.diag([0.04, 0.04, 0.01, 1e-4, 0.04, 1e-4, 0.1, 0.01])
    ego = VehicleStates.from_ego_states(
        stamps, drive(0, 0, N_STEPS), np.tile(covariance, (N_STEPS, 1, 1)), size_m=(4.5, 1.8)
    )
    others = [drive(k % 2, k // 2, N_STEPS) for k in range(1, N_CARS)]
    n = len(others) * N_STEPS
    remote = VehicleStates(
        Strings(np.tile(np.arange(len(others), dtype=np.int32), N_STEPS), tuple(map(str, range(1, N_CARS)))),
        np.repeat(stamps, len(others)),
        np.repeat(stamps, len(others)),
        np.stack(others, axis=1).reshape(n, N_STATES),
        np.tile(covariance, (n, 1, 1)),
        np.full(n, 4.5),
        np.full(n, 1.8),
        np.zeros(n, np.uint8),
    )
    with LogWriter(path) as log:
        log.write_columns(make_vehicle_state_channel(EGO_STATE, ego, None))
        log.write_columns(make_vehicle_state_channel(REMOTE_STATE, remote, None))


def process() -> tuple[float, float]:
    """Processor seconds and peak MB of `cwcli measure` on that log."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        subprocess.run([sys.executable, __file__, "--write", str(log)], check=True)
        target = str(Path(folder) / "out.mcap")
        child = subprocess.Popen([sys.executable, "-m", "cwcli", "measure", str(log), "-o", target, "--quiet"])
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            sys.exit(f"cwcli measure ended with {child.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * MIB_PER_KIB


def main() -> None:
    """Time everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="only write the log of the whole process")
    options = parser.parse_args()
    if options.write is not None:
        write_states_log(options.write)
        return
    slow = (*STEERED, "ttr")  # which is the greatest of them
    quick = [name for name, measure in MEASURES.items() if not measure.is_expensive and name not in slow]
    seconds, megabytes = process()
    rows = (
        (
            f"all {len(quick)} but TTB, TTK, TTS, TTR, P_MC and P_c, us a pair and step",
            microseconds(quick, 2000),
            MAX_ALL_US,
        ),
        ("TTC, us a pair and step", microseconds(["ttc"], 2000), MAX_TTC_US),
        ("TTB, TTK, TTS on a collision course, us a step", on_collision_course(), MAX_STEERED_US),
        (f"`cwcli measure` of {N_CARS} cars, ten minutes at 20 Hz, s", seconds, MAX_PROCESS_S),
        ("its peak memory, MB", megabytes, MAX_PROCESS_MB),
    )
    print("| what | measured | limit |\n|---|---|---|")
    for what, measured, limit in rows:
        print(f"| {what} | {measured:.3g} | {limit:g} |")
    sys.exit(int(any(measured > limit for _, measured, limit in rows)))


if __name__ == "__main__":
    main()
