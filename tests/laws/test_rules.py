"""Laws that every registered collision rule obeys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.warning.evaluate import _times_along_predicted_paths_s
from cwcli.warning.pair import PairEvaluation, evaluate_pairs
from cwcli.warning.rules import RULES
from cwcli.warning.types import VehicleTrack, WarningConfig
from tests.unit.warning.vehicles import T0_NS, evaluate, stamps

FloatArray = npt.NDArray[np.float64]
N = 61
TIME_S = np.arange(float(N)) * 0.1
SIGMAS = np.array([0.3, 0.3, 0.2, 0.02, 0.3, 0.01, 0.3, 0.01])

every_rule = pytest.mark.parametrize("name", RULES)


def states(
    x_m: float, y_m: float, speed_mps: float, heading_rad: float, accel_mps2: float = 0.0, jerk_mps3: float = 0.0
) -> FloatArray:
    """Six seconds at 10 Hz on a straight line, (n, 8); with these derivatives, so that the paths differ from it."""
    way = speed_mps * TIME_S
    place = np.column_stack([x_m + way * np.cos(heading_rad), y_m + way * np.sin(heading_rad)])
    rest = np.tile([speed_mps, heading_rad, accel_mps2, 0.0, jerk_mps3, 0.0], (N, 1))
    return np.column_stack([place, rest])


def vehicle(name: str, state: FloatArray, *, model: str, shift_ns: int) -> VehicleTrack:
    """A vehicle with these states, and paths and onset paths from them."""
    covariance = np.tile(np.diag(SIGMAS**2), (len(state), 1, 1))
    stamp_ns = stamps(TIME_S) + shift_ns
    paths, onset = (
        roll_out_paths(each, state, covariance, settings=RolloutSettings(horizon_s=3.5, step_s=0.1))
        for each in (model, "onset")
    )
    return VehicleTrack(name, stamp_ns, stamp_ns, state, paths, onset_paths=onset)


Tracks = tuple[VehicleTrack, VehicleTrack]


def pair_of(one: FloatArray, other: FloatArray, *, shift_ns: int = 0, model: str = "auto") -> Tracks:
    one_track, other_track = (
        vehicle(name, state, shift_ns=shift_ns, model=model) for name, state in (("one", one), ("other", other))
    )
    return one_track, other_track


def judged(name: str, pair: Tracks, config: WarningConfig | None = None) -> PairEvaluation:
    """What a rule makes of a pair."""
    host, other = pair
    config = replace(config or WarningConfig(), rule=name)
    time_s = _times_along_predicted_paths_s(host, config, RULES[name])
    return evaluate_pairs(host, [other], RULES[name], config, time_s)[0]


def raised(found: PairEvaluation) -> set[int]:
    """The stamps, from the first one on, at which the rule raises."""
    decision = found.decision
    rows = decision.raised if decision.at_once is None else decision.raised | decision.at_once
    return {int(stamp - T0_NS) for stamp in found.stamp_ns[rows]}


def scenes(n: int = 25) -> list[tuple[FloatArray, FloatArray]]:
    """Pairs of all kinds, many of which nearly or really collide."""
    rng = np.random.default_rng(11)
    made = []
    for _ in range(n):
        meet, at_s = rng.uniform(-40.0, 40.0, 2), rng.uniform(1.0, 6.0)
        both = []
        for _ in range(2):
            speed, heading = rng.uniform(0.0, 20.0), rng.uniform(-9.0, 9.0)
            x, y = meet + rng.normal(0.0, 5.0, 2) - at_s * speed * np.array([np.cos(heading), np.sin(heading)])
            both.append(states(x, y, speed, heading, rng.normal(0.0, 0.5), rng.normal(0.0, 0.5)))
        made.append((both[0], both[1]))
    return made


def test_some_scenes_are_warned_of_and_some_are_not() -> None:
    warned = [bool(raised(judged("cwcli", pair_of(*scene)))) for scene in scenes()]
    assert 5 <= sum(warned) <= 20


@every_rule
def test_two_that_move_apart_are_never_warned_of(name: str) -> None:
    rng = np.random.default_rng(12)
    n = 0
    while n < 40:
        away, heading = rng.uniform(-np.pi, np.pi, 2)
        own_speed, speed, turn = rng.uniform(0.0, 20.0, 3)
        start = rng.uniform(9.0, 40.0) * np.array([np.cos(away), np.sin(away)])
        own, theirs = states(0.0, 0.0, own_speed, heading), states(start[0], start[1], speed, turn)
        moved = (theirs[1] - own[1]) - (theirs[0] - own[0])
        if start @ moved[:2] < 0.0:
            continue
        n += 1
        scene = pair_of(own, theirs, model="cv")
        found = judged(name, (scene[0], replace(scene[1], onset_paths=None)))
        assert not raised(found)
        assert not found.spans


@pytest.mark.parametrize("name", [name for name, rule in RULES.items() if rule.is_of_collisions])
def test_a_collision_is_warned_of_before_it_happens(name: str) -> None:
    for heading in np.linspace(0.0, 2.0 * np.pi, 9):
        meet = 50.0 * np.array([np.cos(heading), np.sin(heading)])
        host, other = pair_of(
            states(-meet[0], -meet[1], 10.0, heading), states(meet[0], meet[1], 10.0, heading + np.pi)
        )
        result = evaluate(host, [other], WarningConfig(rule=name))
        (outcome,) = np.asarray(result.conflicts.columns["outcome"])
        assert outcome == "true"


def turned(state: FloatArray, angle_rad: float) -> FloatArray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    place = state[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    return np.column_stack([place, state[:, 2], state[:, 3] + angle_rad, state[:, 4:]])


@pytest.mark.parametrize(
    ("change", "shift_ns"),
    [
        (lambda state: state + np.array([1e5, -3e4, *[0.0] * 6]), 0),
        (lambda state: turned(state, 0.7), 0),
        (lambda state: turned(state, np.pi), 0),
        (lambda state: state * np.array([1, -1, 1, -1, 1, -1, 1, -1]), 0),
        (lambda state: state, 12_345_678_900_000_000),
    ],
    ids=["moved", "turned", "turned round", "mirrored", "later"],
)
@every_rule
def test_no_place_direction_or_time_counts(
    name: str, change: Callable[[FloatArray], FloatArray], shift_ns: int
) -> None:
    for one, other in scenes():
        found = judged(name, pair_of(one, other))
        moved = judged(name, pair_of(change(one), change(other), shift_ns=shift_ns))
        assert {at - shift_ns for at in raised(moved)} == raised(found)
        for part in ("armed", "held", "time_to_event_s", "predicted_distance_m"):
            expected, got = getattr(found.decision, part), getattr(moved.decision, part)
            np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(moved.probability, found.probability, rtol=1e-6, atol=1e-6)


@every_rule
def test_either_vehicle_may_be_the_host(name: str) -> None:
    differing = 0
    braking = states(30.0, 0.0, 15.0, 0.0, -5.0)
    for one, other in (*scenes(), (states(0.0, 0.0, 15.0, 0.0), braking)):
        host, guest = pair_of(one, other)
        host, guest = replace(host, onset_paths=None), replace(guest, onset_paths=None)  # only the other's counts
        differing += raised(judged(name, (host, guest))) != raised(judged(name, (guest, host)))
    assert (differing == 0) == RULES[name].is_symmetric


@pytest.mark.parametrize(
    ("strict", "lenient"),
    [({"distance_m": 1.0}, {}), ({}, {"distance_m": 6.0}), ({"probability": 0.9}, {}), ({}, {"probability": 0.0})],
    ids=["nearer", "farther", "surer", "unsure"],
)
@every_rule
def test_a_stricter_threshold_warns_at_no_other_moment(
    name: str, strict: dict[str, Any], lenient: dict[str, Any]
) -> None:
    for scene in scenes():
        pair, default = pair_of(*scene), WarningConfig()
        narrow, wide = replace(default, **strict), replace(default, **lenient)
        assert raised(judged(name, pair, narrow)) <= raised(judged(name, pair, wide))


@every_rule
def test_what_a_warning_says_is_possible(name: str) -> None:
    for scene in scenes():
        found = judged(name, pair_of(*scene))
        decision = found.decision
        assert not (decision.raised & ~decision.armed).any()
        assert not (decision.raised & ~decision.held).any()
        for values in (found.probability, found.alert_probability):
            known = values[~np.isnan(values)]
            assert ((known >= 0.0) & (known <= 1.0)).all()
        assert (decision.time_to_event_s >= 0.0).all()
        assert (decision.predicted_distance_m >= 0.0).all()


ODD = {
    "both stand": (states(0.0, 0.0, 0.0, 0.0), states(10.0, 0.0, 0.0, 1.0)),
    "one place": (states(0.0, 0.0, 0.0, 0.0), states(0.0, 0.0, 0.0, 0.0)),
    "one place and motion": (states(5.0, 5.0, 9.0, 0.3), states(5.0, 5.0, 9.0, 0.3)),
    "overlapping at the start": (states(0.0, 0.0, 10.0, 0.0), states(1.0, 0.5, 5.0, 2.0)),
    "one stands": (states(0.0, 0.0, 10.0, 0.0), states(60.0, 0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("odd", ODD)
@every_rule
def test_odd_pairs_are_judged(name: str, odd: str) -> None:
    found = judged(name, pair_of(*ODD[odd]))
    assert found.n_evaluated == N
    assert not np.isnan(found.decision.predicted_distance_m).any()
    if odd == "both stand":
        assert not raised(found)


@every_rule
def test_a_state_that_is_no_number_raises_nothing_and_spoils_no_other(name: str) -> None:
    for one, other in scenes():
        whole = raised(judged(name, pair_of(one, other)))
        holed = other.copy()
        holed[[7, 30]] = np.nan
        for pair in ((one, holed), (holed, one)):
            found = judged(name, pair_of(*pair))
            at_holes = {7 * 10**8, 30 * 10**8}
            assert not raised(found) & at_holes
            if pair[0] is one:
                assert raised(found) == whole - at_holes
