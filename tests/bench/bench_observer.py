"""Speed of the observers and the paths, in frames a second of one core: `python -m tests.bench.bench_observer`.

With the name of a log that has frames and a speed (`cwcli simulate road --set duration_s=100 -o drive.mcap`): how much
`observe` adds to `lanes` in one run.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import OBSERVER_METHODS, observe_lateral_motion
from cwcli.dynamics.samples import LaneSamples, ScalarSamples
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path

N_FRAMES = 20_000


def report(name: str, work: Callable[[], object]) -> None:
    """Best of three."""
    took = []
    for _ in range(3):
        begin = time.process_time()
        work()
        took.append(time.process_time() - begin)
    print(f"{name:32} {N_FRAMES / min(took):>12,.0f} frames/s")


def report_stages(name: str) -> None:
    """Processor time of `lanes` by each method, and of `observe` behind it."""
    from cwcli.logs.read.reader import Log
    from cwcli.stages.lanes import LanesConfig, lanes
    from cwcli.stages.observe import ObserveConfig, observe
    from cwcli.vision.methods import methods_without_model

    for method in methods_without_model():
        with Log.open(name) as log:
            begin = time.process_time()
            made = lanes(log, LanesConfig(method=method))
            between = time.process_time()
            found = observe(log.with_channels(made.channels), ObserveConfig(vehicle=load_vehicle()))
            end = time.process_time()
        took, more = between - begin, end - between
        n = len(found.tables["observer"])
        print(f"{n} frames: lanes ({method}) {took:.2f} s, observe {more:.2f} s more: {100.0 * more / took:.1f} %")


def main() -> None:
    """Measure and print."""
    if len(sys.argv) > 1:
        report_stages(sys.argv[1])
        return
    random = np.random.default_rng(0)
    stamp_ns = np.arange(N_FRAMES, dtype=np.int64) * 100_000_000
    lanes = LaneSamples(stamp_ns, *(s * random.standard_normal(N_FRAMES) for s in (0.05, 0.003, 2e-4)))
    speed, car = ScalarSamples(stamp_ns, np.full(N_FRAMES, 25.0)), load_vehicle()
    gyro_ns = np.arange(5 * N_FRAMES, dtype=np.int64) * 20_000_000
    gyro = ScalarSamples(gyro_ns, 0.002 * random.standard_normal(5 * N_FRAMES))
    for method in OBSERVER_METHODS:
        report(method, lambda method=method: observe_lateral_motion(lanes, speed, car, ObserverConfig(method)))  # type: ignore[misc]
    report("cwcli with a gyroscope of 50 Hz", lambda: observe_lateral_motion(lanes, speed, car, yaw_rate=gyro))
    track = observe_lateral_motion(lanes, speed, car)
    paths = predict_paths_from_observer(track, car)
    report("paths of 2 s", lambda: predict_paths_from_observer(track, car))
    report("their calibration", lambda: scale_covariance_across_path(paths, track))


if __name__ == "__main__":
    main()
