"""The studies behind the numbers of docs/*.md that are no paper's: lanes, observer, prediction, tracking, scenes."""

from __future__ import annotations

# Studies and benches are imported by name: they are not type-checked, and the benches need peers.
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

Numbers = dict[str, tuple[float, float, float] | str]
"""Key -> number with its interval (value, low, high), or a text."""
NOT_RANDOM = (float("nan"), float("nan"))
"""The interval of a number in which nothing is random."""
DEVELOPMENT_LOGS = Path(__file__).parents[3] / "shared" / "logs"
"""Real logs, which are not part of the repository; beside it where they are at hand."""
PREDICTION_LOGS = {
    "Dresden": "balzer-dresden-2014-03-26.ros2",
    "KITTI": "kitti-2011-10-03-drive-0027.first240s",
    "platoon 22": "openacc-dynamic-part22.ros2",
    "two cars": "psu-follow-2obu",
}
"""Name in docs/prediction.md -> file of the development logs."""
LANE_DRIVE_S = 40.0
"""Length of a rendered drive of `measure_lane_drives`. Chosen by hand: two drives of ten kinds take two minutes."""
KINDS_OF_SMALL_LANE_RUN = ("dots-joints", "exit", "merge", "ramp")
"""The kinds of road of the small run, which is rerun in each check: those on which most goes wrong, and bends."""
FRAMES_PER_INDEPENDENT_ONE = 20
"""Frames that count as one in the interval of a share, since neighbours are alike: 2 s at 10 Hz. Chosen by hand."""


def call_cwcli(folder: str, *arguments: str) -> str:
    """Run cwcli in a folder; returns what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", "cwcli", *arguments, "--quiet"], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout


def without_interval(values: Mapping[str, float]) -> Numbers:
    """Return numbers in which nothing is random."""
    return {key: (float(value), *NOT_RANDOM) for key, value in values.items()}


def measure_observer_drives(seeds: int) -> Numbers:
    """Errors of the observer and the path on rendered drives: median, and least to greatest as the interval."""
    drives = [_observer_errors(number) for number in range(seeds)]
    values: Numbers = {}
    for sensors, errors in drives[0].items():
        for what in errors:
            each = np.array([found[sensors][what] for found in drives])
            values[f"{sensors}: {what}"] = (float(np.median(each)), float(each.min()), float(each.max()))
    return values


def measure_lane_drives(seeds: int) -> Numbers:
    """Shares and counts of the default lane method on rendered drives of each kind of road, seeds 200, 201, ...

    One seed is the small run, of `KINDS_OF_SMALL_LANE_RUN` alone.
    """
    study = import_module("tests.studies.lane_drives")
    values: Numbers = {}
    for kind in study.KINDS if seeds > 1 else KINDS_OF_SMALL_LANE_RUN:
        total = study.Counts()
        for seed in range(200, 200 + seeds):
            total.add(_count_lane_drive(kind, seed))
        shares = {"right": (total.right, total.frames), "wrong": (total.wrong, max(total.found, 1))}
        for name, (count, n) in shares.items():
            independent = n / FRAMES_PER_INDEPENDENT_ONE
            values[f"{kind}: {name}"] = (count / n, *_wilson_interval(count / n, independent))
        values |= without_interval({f"{kind}: jumps": total.jumps, f"{kind}: departures": total.departures})
    return values


@cache
def _count_lane_drive(kind: str, seed: int) -> Any:
    """Return the counts of a rendered drive; the small set is a part of the whole one."""
    return import_module("tests.studies.lane_drives").one((kind, seed), LANE_DRIVE_S, True)


@cache
def _observer_errors(number: int) -> dict[str, dict[str, float]]:
    """Return the errors on a rendered drive: sensors -> what -> error."""
    study = import_module("tests.studies.rendered_motion")
    errors: dict[str, dict[str, float]] = study.drive(number, study.Setting())
    return errors


def _wilson_interval(share: float, n: float) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share of n samples."""
    z = 1.96
    middle, half = share + z * z / (2 * n), z * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return float((middle - half) / (1 + z * z / n)), float((middle + half) / (1 + z * z / n))


def measure_labelled_lanes(_: int) -> Numbers:
    """Scores of the default lane method on the 40 labelled frames, each alone."""
    with tempfile.TemporaryDirectory() as folder:
        call_cwcli(folder, "lanes", str(DEVELOPMENT_LOGS / "tusimple-0313-dev.mcap"), "-o", "lanes.mcap")
        return without_interval(_metrics_of_log(folder, "lanes.mcap", ("lanes.truth_",)))


def measure_departure(_: int) -> Numbers:
    """The pipeline of a lane departure: what is found, observed and warned of, against the truth."""
    with tempfile.TemporaryDirectory() as folder:
        call_cwcli(folder, "simulate", "departure", "-o", "road.mcap")
        stages = ("--stage", "lanes,observe,predict-lane,warn-lane")
        printed = call_cwcli(folder, "run", "road.mcap", "-o", "lane.mcap", *stages, "--json")
        (event,) = json.loads(printed)["stages"]["warn-lane"]["sections"]["lane_departures"]
        values = without_interval({f"warning: {key}": event[key] for key in ("at_s", "crossing_in_s", "to_the_line_m")})
        return values | without_interval(_metrics_of_log(folder, "lane.mcap", ("lanes.", "observer.")))


def _metrics_of_log(folder: str, log: str, prefixes: Iterable[str]) -> dict[str, float]:
    """Return the metrics of an annotated log whose names begin so."""
    document = json.loads(call_cwcli(folder, "evaluate", log, "--json"))
    metrics = document["logs"][0]["metrics"]
    return {name: row["value"] for name, row in metrics.items() if name.startswith(tuple(prefixes))}


def measure_prediction(_: int) -> Numbers:
    """Errors of constant velocity and of the default prediction on real logs, against hindsight."""
    study = import_module("tests.studies.prediction_bounds")
    values: Numbers = {}
    for name, file in PREDICTION_LOGS.items():
        for row in study.judged(name, study.known_states(DEVELOPMENT_LOGS / f"{file}.mcap")):
            found = {
                "cv": float(row.baseline_m.mean()),
                "auto": float(row.default_m.mean()),
                "ratio": row.mean_ratio,
                "p95 ratio": row.p95_ratio,
                "in 50": row.inside_50,
                "in 90": row.inside_90,
            }
            where = f"{name} {row.who} {row.horizon_s:g} s"
            values |= without_interval({f"{where}: {key}": value for key, value in found.items()})
    return values


def measure_planted_events(drives: int) -> Numbers:
    """What `cwcli find` finds in drives with one planted event each, and in an hour without any for 20 of these."""
    study = import_module("tests.studies.planted_events")
    counts = study.count_planted(drives)
    each = counts.values()
    return without_interval(
        {
            "planted": sum(event.n_planted for event in each),
            "found": sum(event.n_found for event in each),
            "false": sum(event.n_false for event in each),
            "balanced accuracy": study.balanced_accuracy(counts),
            "worst error [s]": max(max(event.errors_s, default=np.nan) for event in each),
            "quiet hours": drives / 20,
            "in quiet hours": study.count_in_quiet_hours(drives / 20),
        }
    )


def measure_tracking(_: int) -> Numbers:
    """Errors of `cwcli track` on a real log of one target, causal and smoothed."""
    log = str(DEVELOPMENT_LOGS / "udacity-obj-pose.ros2.mcap")
    return {
        f"{name}: {key}": value
        for name, options in {"causal": ("--causal",), "smoothed": ()}.items()
        for key, value in without_interval(errors_of_only_target(log, options)).items()
    }


def errors_of_only_target(log: str, options: Sequence[str]) -> dict[str, float]:
    """Run `cwcli track`; returns the RMSE of the only target by name."""
    printed = call_cwcli(str(Path(log).parent), "track", log, *options, "--json")
    (row,) = json.loads(printed)["stages"]["track"]["sections"]["errors"]
    return {name: row[name] for name in ("x_m", "y_m", "vx_mps", "vy_mps")}


def measure_crossing_targets(seeds: int) -> Numbers:
    """GOSPA of the causal tracker on five crossing targets among clutter."""
    from cwcli.tracking.gospa import TargetMoments, score_tracks

    bench = import_module("tests.bench.bench_tracking")
    rows = []
    for seed in range(seeds):
        scene = bench.scene_of(seed)
        truth = TargetMoments(scene.truth_stamp_ns, scene.truth_id, scene.truth_state)
        score = score_tracks(truth, bench.cwcli_tracks(scene), cutoff_m=bench.CUTOFF_M)
        rows.append([score.distance.mean(), score.n_missed.mean(), score.n_false.mean(), score.id_switches])
    mean, half = np.mean(rows, axis=0), 1.96 * np.std(rows, axis=0, ddof=1) / np.sqrt(seeds)
    names = ("GOSPA", "missed", "false", "id switches")
    return {name: (float(m), float(m - h), float(m + h)) for name, m, h in zip(names, mean, half, strict=True)}
