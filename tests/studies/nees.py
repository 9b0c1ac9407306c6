"""Is sigma as large as the error? `python -m tests.studies.nees [--seeds N] [--logs FOLDER] [SCENARIO ...]`.

Each seed of a bundled scenario is estimated as `cwcli estimate` does, in hindsight and online. Printed is the NEES per
degree of freedom (1 where the errors are as large as their covariance says) of position, speed and heading: median and
extremes over the seeds. With `--logs` the real logs that have a truth are in the table, too. The exit code is 1 where
a median lies outside of MEDIANS or a value above MOST (real logs: outside of REAL).

`--as-simulated` takes away what simulated cars lack and real ones have: the prior of unknown delays and the side slip.
Then sigma must fit. `--drawn-delays` does the opposite: each source but the IMU is late by a time that is drawn from that
prior, so that cars differ as the prior says. Over many seeds the mean must then be near 1 `--without-slip`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, delay_variance
from cwcli.estimation import track as track_module
from cwcli.estimation.consistency import nees
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.sensor_limits import UNKNOWN_DELAY_SIGMA_S
from cwcli.estimation.track import estimate_hindsight_and_online_tracks
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.signals.angles import wrap_angle
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from tests.studies.never_worse import REAL as REAL_LOGS
from tests.studies.sensor_model import KINDS
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns

FIRST_SEED = 4000
MEDIANS, MOST, REAL = (0.7, 1.4), 4.0, (0.5, 4.0)
COLUMNS = {"position": [0, 1], "speed": [2], "heading": [3]}
PRIOR_SIGMA_S = UNKNOWN_DELAY_SIGMA_S
SETTLED_S = 3.0
"""States before this time are starting, and flagged so."""

Nees = dict[tuple[str, str], float]
"""(mode, quantity) -> NEES per degree of freedom."""


def received_measurements(drive: SimulatedDrive) -> list[Measurements]:
    """The host's sensors with their log times and the noise that their messages state."""
    found = []
    for name, data in drive.sensors.items():
        order = np.argsort(data.stamp_ns, kind="stable")
        width = 2 if name == "gnss" else data.values.shape[1]
        variance = np.tile(data.sigma[:width] ** 2, (len(order), 1))
        found.append(
            Measurements(name, KINDS[name], data.stamp_ns[order], data.values[order, :width], variance,
                         data.log_time_ns[order])
        )  # fmt: skip
    return sorted(found, key=lambda m: m.kind is not Kind.POSITION)


def with_drawn_delays(drive: SimulatedDrive, seed: int) -> SimulatedDrive:
    """The drive with stamps of each source but the IMU that are late by a time drawn from the prior of delays."""
    rng = np.random.default_rng(seed)
    late_ns = {name: 0 if name == "imu" else round(1e9 * rng.normal(0.0, PRIOR_SIGMA_S)) for name in drive.sensors}
    sensors = {name: replace(data, stamp_ns=data.stamp_ns + late_ns[name]) for name, data in drive.sensors.items()}
    return replace(drive, sensors=sensors)


def track_nees(track: Track, stamp_ns: np.ndarray, truth: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """Mean NEES per degree of freedom of each quantity over some rows."""
    error = track.state - truth
    error[:, 3] = wrap_angle(error[:, 3])
    found = {}
    for name, columns in COLUMNS.items():
        covariance = track.covariance[:, columns][:, :, columns]
        found[name] = float(nees(error[rows][:, columns], covariance[rows]).mean()) / len(columns)
    return found


def drive_nees(drive: SimulatedDrive, config: EstimatorConfig = EstimatorConfig()) -> Nees:
    """Both tracks of a drive against its truth, 20 times a second."""
    stamp_ns, truth = truth_stamps_ns(drive)[::50], true_states_of_vehicle(drive, EGO_VEHICLE_KEY)[::50]
    rows = stamp_ns >= stamp_ns[0] + int(SETTLED_S * 1e9)
    tracks = estimate_hindsight_and_online_tracks(received_measurements(drive), config, stamp_ns, blind=False)
    return {
        (mode, name): value
        for mode, one in zip(("hindsight", "online"), tracks, strict=True)
        for name, value in track_nees(one, stamp_ns, truth, rows).items()
    }


def log_nees(path: Path, config: EstimateConfig) -> Nees:
    """What the command itself tells of a log with a truth, in hindsight and by the filter alone."""
    found: Nees = {}
    for mode, causal in (("hindsight", False), ("online", True)):
        with Log.open(path) as log:
            estimator = replace(config.estimator, causal=causal)
            summary = run_stage(STAGES["estimate"], log, replace(config, estimator=estimator)).summary
        section = next(each for each in summary.sections if each.key == "nees")
        found |= {(mode, str(row[0])): float(row[1]) for row in section.rows}  # type: ignore[arg-type]
    return found


def take_away_what_simulated_cars_lack(*, delays: bool) -> None:
    """Set the noise of side slip to next to nothing, and so the prior of unknown delays where that is asked for."""
    if delays:
        delay_variance.UNKNOWN_DELAY_SIGMA_S = 1e-6  # type: ignore[attr-defined]
    track_module.MotionParameters = partial(MotionParameters, side_slip_m=1e-3, course_rad=1e-5)  # type: ignore[attr-defined]


def show(name: str, runs: Sequence[Nees], bounds: tuple[float, float], most: float) -> bool:
    """Print the rows of one scenario or log; whether the bounds hold."""
    holds = True
    for mode, quantity in dict.fromkeys(key for run in runs for key in run):
        values = np.array([run[mode, quantity] for run in runs if (mode, quantity) in run])
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        good = bounds[0] <= np.median(values) <= bounds[1] and values.max() <= most
        holds &= bool(good)
        shown = (
            f"{len(values)} | {values.mean():.2f} | {np.median(values):.2f} | {values.min():.2f} | {values.max():.2f}"
        )
        print(f"| {name} | {mode} | {quantity} | {shown} | {'' if good else '**outside**'} |", flush=True)
    return holds


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "scenarios", nargs="*", default=[each for each in scenario_names() if "gnss" in load_scenario(each).sensors]
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--lean", action="store_true", help="fixes and IMU alone")
    parser.add_argument("--logs", type=Path, help="folder with the real logs")
    parser.add_argument("--as-simulated", action="store_true", help="without the priors that simulated cars lack")
    parser.add_argument("--without-slip", action="store_true", help="without the side slip alone")
    parser.add_argument("--drawn-delays", action="store_true", help="with delays drawn from their prior")
    given = parser.parse_args(arguments)
    if given.as_simulated or given.without_slip:
        take_away_what_simulated_cars_lack(delays=given.as_simulated)
    print(
        "| log | states | error of | seeds | NEES/dof: mean | median | least | largest | |\n"
        "|---|---|---|---|---|---|---|---|---|"
    )
    holds = []
    for scenario in given.scenarios:
        made = load_scenario(scenario)
        if given.lean:
            lean: Mapping[str, Mapping[str, object]] = {k: v for k, v in made.sensors.items() if k in ("gnss", "imu")}
            made = replace(made, sensors=lean)
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        drives = [
            with_drawn_delays(drive, seed) if given.drawn_delays else drive
            for seed in seeds
            for drive in [simulate_scenario(made, seed)]
        ]
        holds.append(show(scenario, [drive_nees(drive) for drive in drives], MEDIANS, MOST))
    if given.logs is not None:
        for name, config in REAL_LOGS.items():
            holds.append(show(name.split(".")[0], [log_nees(given.logs / name, config)], REAL, REAL[1]))
    return int(not all(holds))


if __name__ == "__main__":
    sys.exit(main())
