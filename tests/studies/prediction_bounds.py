"""Is the default prediction ever worse than constant velocity? `python -m tests.studies.prediction_bounds [LOG...]`.

For each log, the bundled scenarios (`--seeds 1 2 3`; none: `--seeds`) and, if asked for, made-up dense traffic
(`--dense 1`, `dense_traffic`): `estimate`, then `predict` from the online states, judged 1, 2.5 and 5 s ahead against
the states in hindsight. One line per log, class and horizon: mean errors of constant velocity and of the default,
their ratio, that of the 95th percentiles, and what the 50 and 90 % ellipses held. The exit code is 1 if one of the
bounds below is broken.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cwcli.channels.published import EGO_ONLINE, EGO_STATE, REMOTE_ONLINE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_vehicle_states
from cwcli.errors import MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.prediction.calibrate import plan_vehicle_paths
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.outcome import ELLIPSE_50_SQUARED_RADIUS, ELLIPSE_90_SQUARED_RADIUS, HorizonErrors, horizon_errors
from cwcli.prediction.outcome_history import PathStarts
from cwcli.prediction.rollout import RolloutSettings
from cwcli.signals.columns import FloatArray
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.units import NS_PER_S
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from tests.studies.dense_traffic import VARIANTS, dense_states

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
BASELINE = "cv"
HORIZONS_S = (1.0, 2.5, 5.0)
WORSE_MEAN, WORSE_P95, BETTER = 1.02, 1.05, 0.8
POOLED_90, LONG_90, LONG_S = (0.85, 0.95), (0.80, 0.97), 60.0


@dataclass(frozen=True)
class Judged:
    """The vehicles of one class of one log, 1, 2.5 or 5 s ahead.

    Attributes:
        log, who: Its name; "ego" or "remote".
        duration_s: Of the log.
        horizon_s: How far ahead.
        baseline_m, default_m: Shape (n,): errors of all starts whose outcome is known.
        squared_50, squared_90: Shape (n,): Mahalanobis distances of the default, for the two ellipses.
    """

    log: str
    who: str
    duration_s: float
    horizon_s: float
    baseline_m: FloatArray
    default_m: FloatArray
    squared_50: FloatArray
    squared_90: FloatArray

    @property
    def mean_ratio(self) -> float:
        """Of the default's mean error to that of constant velocity."""
        return float(self.default_m.mean() / self.baseline_m.mean())

    @property
    def p95_ratio(self) -> float:
        """Of the 95th percentiles."""
        return float(np.quantile(self.default_m, 0.95) / np.quantile(self.baseline_m, 0.95))

    @property
    def inside_50(self) -> float:
        """The share of outcomes within the 50 % ellipse."""
        return float(np.mean(self.squared_50 <= ELLIPSE_50_SQUARED_RADIUS))

    @property
    def inside_90(self) -> float:
        """The share of outcomes within the 90 % ellipse."""
        return float(np.mean(self.squared_90 <= ELLIPSE_90_SQUARED_RADIUS))


class Known(NamedTuple):
    """The states of a class of vehicles: as they could have been known, and in hindsight."""

    online: VehicleStates
    happened: VehicleStates


def known_states(path: Path) -> dict[str, Known]:
    """Those of the ego and of the others as `estimate` gives them; none where the log has no position."""
    with Log.open(path) as log:
        try:
            made = log.with_channels(run_stage(STAGES["estimate"], log, EstimateConfig()).channels)
        except MissingSignalError:
            return {}
        topics = {channel.topic for channel in made.channels}
        channels = {"ego": (EGO_ONLINE, EGO_STATE), "remote": (REMOTE_ONLINE, REMOTE_STATE)}
        return {
            who: Known(*(read_vehicle_states(made.columns(channel.topic)) for channel in both))
            for who, both in channels.items()
            if topics.issuperset(channel.topic for channel in both)
        }


def scenario_states(name: str, seed: int) -> dict[str, Known]:
    """The same of a simulated log."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        write_simulated_log(simulate_scenario(load_scenario(name, ()), seed), path)
        return known_states(path)


def judged(log: str, states: dict[str, Known]) -> Iterator[Judged]:
    """All classes and horizons of a log."""
    stamps = np.concatenate([each.online.stamp_ns for each in states.values()]) if states else np.zeros(0, np.int64)
    duration_s = float(np.ptp(stamps)) / NS_PER_S if len(stamps) else 0.0
    for who, each in states.items():
        if not len(each.online):
            continue
        baseline, default = (_errors(model, each) for model in (BASELINE, DEFAULT_MODEL))
        for k, horizon_s in enumerate(HORIZONS_S):
            known = [errors.is_known[:, k] for errors in default]
            if not any(rows.any() for rows in known):
                continue
            yield Judged(
                log,
                who,
                duration_s,
                horizon_s,
                np.concatenate([e.distance_m[rows, k] for e, rows in zip(baseline, known, strict=True)]),
                np.concatenate([e.distance_m[rows, k] for e, rows in zip(default, known, strict=True)]),
                np.concatenate([e.core_mahalanobis2[rows, k] for e, rows in zip(default, known, strict=True)]),
                np.concatenate([e.mahalanobis2[rows, k] for e, rows in zip(default, known, strict=True)]),
            )


def _errors(model: str, known: Known) -> list[HorizonErrors]:
    """One per vehicle: online paths against how it really moved."""
    states, tracks = known.online, dict(iter_track_rows(known.happened.ids, known.happened.stamp_ns))
    paths = plan_vehicle_paths(
        model,
        PathStarts(states.ids.codes, states.stamp_ns, states.state, states.covariance, states.log_time_ns),
        settings=RolloutSettings(horizon_s=HORIZONS_S[-1]),
    ).paths_of_rows(slice(None), has_core=True)
    found = []
    for name, rows in iter_track_rows(states.ids, states.stamp_ns):
        track_ns, track_xy = known.happened.stamp_ns[tracks[name]], known.happened.state[tracks[name], :2]
        found.append(horizon_errors(paths.paths_of_rows(rows), states.stamp_ns[rows], track_ns, track_xy, HORIZONS_S))
    return found


def broken(rows: Sequence[Judged]) -> list[str]:
    """Which bounds are not kept, in words."""
    out = []
    for row in rows:
        where = f"{row.log} {row.who} {row.horizon_s:g} s"
        if row.mean_ratio > WORSE_MEAN:
            out.append(f"{where}: mean error {row.mean_ratio:.2f} of constant velocity's")
        if row.p95_ratio > WORSE_P95:
            out.append(f"{where}: 95th percentile {row.p95_ratio:.2f} of constant velocity's")
        if row.duration_s >= LONG_S and not LONG_90[0] <= row.inside_90 <= LONG_90[1]:
            out.append(f"{where}: {row.inside_90:.0%} in the 90 % ellipse")
    for horizon_s in HORIZONS_S:
        some = [row for row in rows if row.horizon_s == horizon_s]
        inside = float(np.mean(np.concatenate([row.squared_90 for row in some]) <= ELLIPSE_90_SQUARED_RADIUS))
        if not POOLED_90[0] <= inside <= POOLED_90[1]:
            out.append(f"all at {horizon_s:g} s: {inside:.0%} in the 90 % ellipse")
    mean = float(np.mean([row.mean_ratio for row in rows]))
    if mean > BETTER:
        out.append(f"all: {mean:.2f} of constant velocity's mean error")
    return out


def lines(rows: Sequence[Judged]) -> Iterator[str]:
    """The table, and pooled lines for real logs, scenarios and all."""
    yield (
        f"{'log':36} {'class':6} {'s':>4} {'starts':>6} {'cv m':>7} {'auto m':>7} {'ratio':>6} {'p95':>6} "
        f"{'50 %':>5} {'90 %':>5}"
    )
    for row in rows:
        yield (
            f"{row.log:36} {row.who:6} {row.horizon_s:4.1f} {len(row.default_m):6d} {row.baseline_m.mean():7.2f} "
            f"{row.default_m.mean():7.2f} {row.mean_ratio:6.2f} {row.p95_ratio:6.2f} "
            f"{row.inside_50:5.0%} {row.inside_90:5.0%}"
        )
    kinds = ("log", "scenario", "dense")
    kind_of = {row.log: row.log.split()[0] if row.log.split()[0] in kinds else "log" for row in rows}
    for kind in kinds:
        for horizon_s in HORIZONS_S:
            some = [row for row in rows if row.horizon_s == horizon_s and kind_of[row.log] == kind]
            if some:
                inside_50 = np.concatenate([row.squared_50 for row in some]) <= ELLIPSE_50_SQUARED_RADIUS
                inside_90 = np.concatenate([row.squared_90 for row in some]) <= ELLIPSE_90_SQUARED_RADIUS
                mean = np.mean([row.mean_ratio for row in some])
                worst, p95 = max(row.mean_ratio for row in some), max(row.p95_ratio for row in some)
                yield (
                    f"all {kind} {horizon_s:g} s: mean ratio {mean:.3f}, worst {worst:.3f}, worst p95 {p95:.3f}, "
                    f"inside {inside_50.mean():.1%} / {inside_90.mean():.1%}"
                )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; the exit code says whether every bound is kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="MCAP files; none: the development logs")
    parser.add_argument("--seeds", nargs="*", type=int, default=[1, 2, 3])
    parser.add_argument("--dense", nargs="*", type=int, default=[], help="seeds of made-up dense traffic")
    asked = parser.parse_args(arguments)
    rows: list[Judged] = []
    for path in asked.logs or sorted(LOGS.glob("*.mcap")):
        rows += judged(path.stem, known_states(path))
    for seed in asked.seeds:
        for name in scenario_names():
            rows += judged(f"scenario {name} {seed}", scenario_states(name, seed))
    dense: list[Judged] = []
    for seed in asked.dense:
        for variant in VARIANTS:
            states = dense_states(variant, seed)
            dense += judged(f"dense {variant.name} {seed}", {"remote": Known(states, states)})
    for line in lines(rows + dense):
        print(line)
    failures = [line for some in (rows, dense) if some for line in broken(some)]
    for line in failures:
        print("broken:", line)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
