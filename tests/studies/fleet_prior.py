"""Make `cwcli/prediction/fleet_prior.toml`: `python -m tests.studies.fleet_prior [--write]`.

What a vehicle's record begins with, learned from the bundled scenarios (`--seeds`, which `prediction_bounds` need not
share) and the logs named in `LEARNED_FROM`; the other development logs stay aside and show whether it holds elsewhere.

A group is one class of vehicles (ego, remote) of one scenario, its seeds together, or of one log. It counts once
however long it is, and twice: as its filter sees it, and with half the sigmas, for filters that are too sure of
themselves. The gains of all parts but the unclear one, which a vehicle can only learn from its own record, are searched
in steps of 0.05, at all knots together because one path has to meet them all, for the least sum over the knots of

    mean(r) + 20 mean(max(r - 1, 0)) + 10 mean(max(r95 - 1, 0)),

r and r95 the ratios of the mean error and of its 95th percentile to those of constant velocity: never to be worse is
worth more than to be better. The ellipses begin with the quantiles of the outcomes' squared Mahalanobis distances
before any scale, each group weighing the same.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.prediction import fleet
from cwcli.prediction.fleet import (
    DERIVATIVE_PART_NAMES,
    HORIZON_KNOTS_S,
    FLEET_QUANTILE_LEVELS,
    FleetPrior,
    acting_time_from_displacement_share_s,
)
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.outcome import horizon_errors
from cwcli.prediction.outcome_history import (
    PathStarts,
    actual_displacement_beyond_constant_velocity_m,
    unclear_lasting_new_shares_of_derivatives,
    measure_acting_time_s,
    displacement_from_accel_and_yaw_rate_m,
    state_histories_by_vehicle,
)
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import SPEED
from cwcli.simulation.catalogue import scenario_names
from tests.studies.prediction_bounds import LOGS, Known, known_states, scenario_states

LEARNED_FROM = ("balzer-dresden-2014-03-26.ros2", "openacc-dynamic-part23.ros2")
SEEDS = (11, 12, 13, 14)
TARGET = Path(fleet.__file__).with_name(fleet.FLEET_PRIOR_FILE)
TOO_SURE = 0.5
STEPS = (0.2, 0.1, 0.05)
MAX_STARTS = 600  # of a group: more of a longer one say little more
MIN_OUTCOMES = 20
WORSE, WORSE_P95 = 20.0, 10.0


@dataclass(frozen=True)
class Group:
    """Starts of one class of vehicles, n in all.

    Attributes:
        speed_mps: Shape (n,).
        promised_m: Shape (n, 2, k): see `record`.
        parts: Shape (n, 2, k, 3).
        followed_m: Shape (n, 2, k).
    """

    speed_mps: FloatArray
    promised_m: FloatArray
    parts: FloatArray
    followed_m: FloatArray

    def errors_m(self, share: FloatArray, k: int) -> FloatArray:
        """Distances at knot k of the known starts, if `share` (n, 2) of what was promised follows."""
        is_known = np.isfinite(self.followed_m[:, 0, k])
        reach_m = self.speed_mps[is_known] * HORIZON_KNOTS_S[k]

        def point(added_m: FloatArray) -> FloatArray:
            along = reach_m + added_m[:, 0]
            arc = np.where(reach_m < 0.0, np.minimum(along, 0.0), np.maximum(along, 0.0))
            angle = added_m[:, 1] / np.maximum(np.abs(reach_m), 1e-3)
            return arc * np.sinc(angle / np.pi) * np.exp(1j * angle)

        predicted = point(share[is_known] * self.promised_m[is_known, :, k])
        return np.asarray(np.abs(predicted - point(self.followed_m[is_known, :, k])))


def group_of(several: Sequence[VehicleStates], too_sure: float) -> Group:
    """All vehicles of some states, their sigmas multiplied."""
    tracks = [
        track
        for states in several
        for track in state_histories_by_vehicle(
            PathStarts(
                states.ids.codes, states.stamp_ns, states.state, states.covariance * too_sure**2, states.log_time_ns
            )
        )
        if len(track.rows) > 1
    ]
    thinned = slice(None, None, max(sum(len(track.rows) for track in tracks) // MAX_STARTS, 1))
    return Group(
        np.concatenate([track.state[:, SPEED] for track in tracks])[thinned],
        np.concatenate([displacement_from_accel_and_yaw_rate_m(track.state) for track in tracks])[thinned],
        np.concatenate([unclear_lasting_new_shares_of_derivatives(track) for track in tracks])[thinned],
        np.concatenate([actual_displacement_beyond_constant_velocity_m(track) for track in tracks])[thinned],
    )


def learned_gains(groups: Sequence[Group]) -> tuple[FloatArray, FloatArray]:
    """Gains (2, k, 3) and what they leave over (2, k)."""
    baselines = [_baselines(each) for each in groups]
    gain = np.zeros((2, len(HORIZON_KNOTS_S), 3))
    gain[:, :, 1:] = (0.5, 0.3)
    gain = _searched(gain, partial(_cost, groups=groups, baselines=baselines))
    left_m = [np.nanmean(np.abs(_left(each, gain)), axis=0) for each in groups]
    return gain, np.asarray(np.nanmean(left_m, axis=0))


def _baselines(group: Group) -> list[tuple[float, float] | None]:
    """Mean and 95th percentile of the errors of constant velocity by knot; None where few outcomes are known."""
    found: list[tuple[float, float] | None] = []
    for k in range(len(HORIZON_KNOTS_S)):
        errors = group.errors_m(np.zeros((len(group.speed_mps), 2)), k)
        found.append((float(errors.mean()), float(np.quantile(errors, 0.95))) if len(errors) > MIN_OUTCOMES else None)
    return found


def _cost(gain: FloatArray, groups: Sequence[Group], baselines: Sequence[list[tuple[float, float] | None]]) -> float:
    shares = [reached(each, gain) for each in groups]
    cost = 0.0
    for k in range(len(HORIZON_KNOTS_S)):
        ratios = []
        for each, share, baseline in zip(groups, shares, baselines, strict=True):
            judged = baseline[k]
            if judged is not None:
                errors = each.errors_m(share[:, :, k], k)
                ratios.append((errors.mean() / judged[0], np.quantile(errors, 0.95) / judged[1]))
        worse, worse_p95 = np.maximum(np.array(ratios) - 1.0, 0.0).mean(axis=0)
        cost += float(np.mean(ratios, axis=0)[0] + WORSE * worse + WORSE_P95 * worse_p95)
    return cost


def _left(group: Group, gain: FloatArray) -> FloatArray:
    return group.followed_m - group.promised_m * np.einsum("naki,aki->nak", group.parts, gain)


def reached(group: Group, gain: FloatArray) -> FloatArray:
    """The share of what is promised that a path reaches at each knot, (n, 2, k)."""
    acted = acting_time_from_displacement_share_s(np.einsum("naki,aki->nak", group.parts, gain))
    steps_s = np.diff(HORIZON_KNOTS_S, prepend=0.0)
    before = np.concatenate([np.zeros((*acted.shape[:2], 1)), acted[:, :, :-1]], axis=2)
    return np.asarray(((before + acted) * steps_s / 2.0).cumsum(axis=2) / (HORIZON_KNOTS_S**2 / 2.0))


def _searched(gain: FloatArray, cost: Callable[[FloatArray], float]) -> FloatArray:
    """Descent along each axis in turn, with shrinking steps."""
    best = cost(gain)
    for step in STEPS:
        improves = True
        while improves:
            improves = False
            for axis, k, part, move in product((0, 1), range(len(HORIZON_KNOTS_S)), (1, 2), (-step, step)):
                trial = gain.copy()
                trial[axis, k, part] = np.clip(round(trial[axis, k, part] + move, 2), 0.0, 1.0)
                found = cost(trial)
                if found < best - 1e-6:
                    best, gain, improves = found, trial, True
    return gain


def learned_quantiles(classes: Sequence[Sequence[VehicleStates]], prior: FleetPrior) -> FloatArray:
    """Of the squared distances at each knot, (k, l) at `QUANTILES`; each class counts the same."""
    found: list[FloatArray] = []
    weights: list[FloatArray] = []
    for several in classes:
        squared = np.concatenate([_squared(states, prior) for states in several])
        found.append(squared)
        weights.append(1.0 / np.maximum(np.isfinite(squared).sum(axis=0), 1) * np.ones_like(squared))
    out = []
    for k in range(len(HORIZON_KNOTS_S)):
        value, weight = np.concatenate([r[:, k] for r in found]), np.concatenate([w[:, k] for w in weights])
        value, weight = value[np.isfinite(value)], weight[np.isfinite(value)]
        order = np.argsort(value)
        share = np.cumsum(weight[order]) / weight.sum()
        out.append(value[order][np.searchsorted(share, FLEET_QUANTILE_LEVELS)])
    return np.array(out)


def _squared(states: VehicleStates, prior: FleetPrior) -> FloatArray:
    """Squared Mahalanobis distances before any scale, (n, k)."""
    acted = measure_acting_time_s(
        PathStarts(states.ids.codes, states.stamp_ns, states.state, states.covariance, states.log_time_ns), prior
    )
    paths = roll_out_paths(
        DEFAULT_MODEL,
        states.state,
        states.covariance,
        settings=RolloutSettings(horizon_s=HORIZON_KNOTS_S[-1]),
        acting_s=acted,
    )
    tracks = state_histories_by_vehicle(
        PathStarts(states.ids.codes, states.stamp_ns, states.state, states.covariance, states.log_time_ns)
    )
    out = [
        horizon_errors(paths.paths_of_rows(t.rows), t.stamp_ns, t.stamp_ns, t.state[:, :2], HORIZON_KNOTS_S.tolist())
        for t in tracks
        if len(t.rows) > 1
    ]
    return np.concatenate([np.where(each.is_known, each.mahalanobis2, np.nan) for each in out])


def classes_of(logs: Sequence[Mapping[str, Known]]) -> list[list[VehicleStates]]:
    """The states of each class, those of several logs together."""
    found: dict[str, list[VehicleStates]] = {}
    for states in logs:
        for who, each in states.items():
            found.setdefault(who, []).append(each.online)
    return list(found.values())


def written(prior: FleetPrior, source: str) -> str:
    """The file."""
    out = ["# Made by `python -m tests.studies.fleet_prior --write`. Learned from", f"# {source}.", ""]
    out.append(f"knots_s = {HORIZON_KNOTS_S.tolist()}")
    for name, gain, error_m in zip(("along", "across"), prior.gain, prior.error_m, strict=True):
        out += [
            "",
            f"[{name}]",
            *(f"{part} = {gain[:, i].round(2).tolist()}" for i, part in enumerate(DERIVATIVE_PART_NAMES)),
        ]
        out.append(f"error_m = {error_m.round(3).tolist()}")
    out += ["", "[ellipse]", f"quantiles = {FLEET_QUANTILE_LEVELS.tolist()}", "squared = ["]
    out += [f"    {row.round(3).tolist()}," for row in np.exp(prior.log_squared)]
    out.append("]")
    return "\n".join(out) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Learn, print, and with `--write` put it into the package."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--logs", nargs="*", default=list(LEARNED_FROM))
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args(arguments)
    classes = [group for name in asked.logs for group in classes_of([known_states(LOGS / f"{name}.mcap")])]
    for name in scenario_names():
        classes += classes_of([scenario_states(name, seed) for seed in asked.seeds])
    gain, error_m = learned_gains([group_of(each, sure) for sure in (1.0, TOO_SURE) for each in classes])
    prior = FleetPrior(gain, error_m, np.zeros((len(HORIZON_KNOTS_S), len(FLEET_QUANTILE_LEVELS))))
    prior = replace(prior, log_squared=np.log(learned_quantiles(classes, prior)))
    names = ", ".join(scenario_names())
    source = f"scenarios {names} (seeds {', '.join(map(str, asked.seeds))})\n# and logs {', '.join(asked.logs)}"
    text = written(prior, source)
    print(text, end="")
    if asked.write:
        TARGET.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
