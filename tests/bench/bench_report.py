"""How long the page of a long log, or of one with many vehicles, takes, and how large it is.

    PYTHONPATH=. python tests/bench/bench_report.py --hours 10 --vehicles 500

The log is made here: the ego round a circle with states at 20 Hz and fixes at 10 Hz; the others pass by, 60 s each,
heard at 10 Hz. It fails where the page is larger than 8 MB or takes more than 20 s of the processor.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.records import map_origin_record_entries
from cwcli.signals.columns import OutputChannel, Strings
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S

ROOT = Path(__file__).parents[2]
RADIUS_M, SPEED_MPS = 1000.0, 15.0
STATE_HZ, FIX_HZ, HEARD_HZ, HEARD_S = 20, 10, 10, 60
ORIGIN = LocalMap(51.0, 13.7, 0.0)
MOST_BYTES, MOST_S = 8_000_000, 20.0


def round_circle(time_s: np.ndarray, radius_m: float, ahead_m: float = 0.0) -> np.ndarray:
    """States (n, 8) at times (n,) of a car that drives round the circle."""
    turned = (SPEED_MPS * time_s + ahead_m) / RADIUS_M
    state = np.zeros((len(time_s), 8))
    state[:, 0], state[:, 1] = radius_m * np.sin(turned), radius_m * (1.0 - np.cos(turned))
    state[:, 2], state[:, 3], state[:, 5] = SPEED_MPS, turned, SPEED_MPS / RADIUS_M
    return state


def write_long(target: Path, hours: float, vehicles: int) -> None:
    """An annotated log of so many hours with so many others."""
    rng = np.random.default_rng(1)
    with Log.open(ROOT / "sample_logs" / "straight.mcap") as log:
        start_ns = log.start_ns

        def stamps(first_s: float, last_s: float, rate_hz: int) -> np.ndarray:
            return start_ns + np.arange(round(first_s * rate_hz), round(last_s * rate_hz)) * (NS_PER_S // rate_hz)

        def seconds(stamp_ns: np.ndarray) -> np.ndarray:
            return (stamp_ns - start_ns) / NS_PER_S

        own_ns = stamps(0.0, 3600.0 * hours, STATE_HZ)
        covariance = np.tile(np.diag([0.04, 0.04, 0.01, 1e-4, 0.01, 1e-5, 0.01, 1e-3]), (len(own_ns), 1, 1))
        ego = VehicleStates.from_ego_states(own_ns, round_circle(seconds(own_ns), RADIUS_M), covariance)
        fix_ns = stamps(0.0, 3600.0 * hours, FIX_HZ)
        place = round_circle(seconds(fix_ns), RADIUS_M)[:, :2] + rng.normal(0.0, 0.3, (len(fix_ns), 2))
        latitude, longitude, _ = ORIGIN.wgs84_from_map(place[:, 0], place[:, 1], np.zeros(len(fix_ns)))
        fixes = {"timestamp": fix_ns, "latitude": latitude, "longitude": longitude, "altitude": np.zeros(len(fix_ns))}
        channels = [
            OutputChannel("/long/fix", "foxglove.LocationFix", fix_ns, fixes),
            make_vehicle_state_channel(EGO_STATE, ego, ORIGIN),
        ]
        if vehicles:
            begins_s = np.linspace(0.0, 3600.0 * hours - HEARD_S, vehicles)
            each_ns = [stamps(begin, begin + HEARD_S, HEARD_HZ) for begin in begins_s]
            state = [
                round_circle(seconds(own), RADIUS_M + 3.5 * (1 + k % 5), rng.uniform(-60.0, 60.0))
                for k, own in enumerate(each_ns)
            ]
            heard_ns = np.concatenate(each_ns)
            codes = np.repeat(np.arange(vehicles, dtype=np.int32), [len(own) for own in each_ns])
            order = np.argsort(heard_ns, kind="stable")
            others = VehicleStates.from_ego_states(
                heard_ns[order], np.concatenate(state)[order], np.tile(covariance[:1], (len(heard_ns), 1, 1))
            )
            ids = Strings(codes[order], tuple(f"{1000 + k}" for k in range(vehicles)))
            others = VehicleStates(**{**vars(others), "ids": ids})
            channels.append(make_vehicle_state_channel(REMOTE_STATE, others, ORIGIN))
        source = {"vehicle": "ego", "source": "/long/fix", "quantity": "position", "used": len(fix_ns), "gated": 0}
        configuration = {"sources": {"topics": {"ego_position": "/long/fix"}}}
        record = {
            **map_origin_record_entries(ORIGIN),
            "sources": json.dumps([source]),
            "configuration": json.dumps(configuration),
            "summary": json.dumps({"verdict": "made up", "notes": [], "sections": []}),
        }
        annotate_log(log, channels, {"cwcli.run.estimate": record}, target)


def measure(folder: Path, hours: float, vehicles: int) -> tuple[int, float, float]:
    """Bytes of the page, and seconds that it took: of the processor, and by the clock."""
    write_long(folder / "long.mcap", hours, vehicles)
    begin, begin_cpu = time.perf_counter(), time.process_time()
    assert (
        run_command_line(["report", str(folder / "long.mcap"), "-o", str(folder / "long.html"), "--quiet", "--force"])
        == 0
    )
    took_s, cpu_s = time.perf_counter() - begin, time.process_time() - begin_cpu
    return (folder / "long.html").stat().st_size, cpu_s, took_s


def main() -> int:
    """Measure, print, and judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--vehicles", type=int, default=500)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        n_bytes, cpu_s, took_s = measure(Path(folder), options.hours, options.vehicles)
        log_bytes = (Path(folder) / "long.mcap").stat().st_size
    print(f"{options.hours:g} h, {options.vehicles} vehicles, log of {log_bytes / 1e6:.0f} MB")
    print(f"page of {n_bytes / 1e6:.1f} MB (at most {MOST_BYTES / 1e6:g})")
    print(f"{cpu_s:.1f} s of the processor (at most {MOST_S:g}), {took_s:.1f} s by the clock")
    return 0 if n_bytes <= MOST_BYTES and cpu_s <= MOST_S else 1


if __name__ == "__main__":
    sys.exit(main())
