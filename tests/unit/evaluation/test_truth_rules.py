"""A truth that differs from the track by one rule is named as such, with the number that was planted by hand."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cwcli.estimation.result import Track
from cwcli.evaluation.truth_rules import TruthRule, find_truth_rules

N, STEP_NS = 1200, 50_000_000
SIGMA = {"position": 0.1, "speed": 0.1, "heading": 0.01}
Truth = dict[str, np.ndarray]


def weaving_track() -> Track:
    """A minute at 8 to 12 m/s along a way that turns left and right."""
    time_s = np.arange(N) * STEP_NS / 1e9
    state = np.zeros((N, 8))
    state[:, 2] = 10.0 + 2.0 * np.sin(0.5 * time_s)
    state[:, 3] = 1.2 * np.sin(0.25 * time_s)
    velocity = state[:, 2, None] * np.column_stack([np.cos(state[:, 3]), np.sin(state[:, 3])])
    state[:, :2] = np.cumsum(velocity, axis=0) * STEP_NS / 1e9
    covariance = np.tile(np.diag([0.01, 0.01, 0.01, 1e-4, 1, 1, 1, 1]), (N, 1, 1))
    return Track(np.arange(N) * STEP_NS, state, covariance, np.zeros(N, np.uint8))


EGO = weaving_track()


def right_truth() -> Truth:
    """The track with errors as large as its covariance says."""
    rng = np.random.default_rng(1)
    noise = {name: sigma * rng.standard_normal((N, 2 if name == "position" else 1)) for name, sigma in SIGMA.items()}
    return {
        "position": EGO.state[:, :2] + noise["position"],
        "speed": EGO.state[:, 2] + noise["speed"][:, 0],
        "heading": EGO.state[:, 3] + noise["heading"][:, 0],
    }


def rules_of(truth: Truth, *names: str, late_ns: int = 0) -> dict[str, TruthRule]:
    return find_truth_rules(EGO.stamp_ns + late_ns, truth, EGO, EGO.covariance, names or tuple(truth))


def changed(**more: np.ndarray) -> Truth:
    return {**right_truth(), **more}


def ahead_and_left(ahead_m: float, left_m: float) -> np.ndarray:
    heading, xy = EGO.state[:, 3], right_truth()["position"]
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.asarray(xy + ahead_m * ahead + left_m * np.column_stack([-ahead[:, 1], ahead[:, 0]]))


def turned_map(turn_deg: float, scale: float) -> np.ndarray:
    z = (right_truth()["position"] @ [1.0, 1.0j]) * scale * np.exp(1j * np.radians(turn_deg))
    return np.column_stack([z.real, z.imag])


def held_from_10_to_20_s() -> np.ndarray:
    xy = right_truth()["position"]
    xy[200:401] = xy[200]
    return xy


@pytest.mark.parametrize(
    ("quantity", "values", "words"),
    [
        ("position", ahead_and_left(1.5, 0.0), "lies 1.5 m ahead of the estimated point, as another point of the car"),
        ("position", ahead_and_left(-1.0, -0.8), "lies 1 m behind and 0.8 m right of the estimated point"),
        ("position", right_truth()["position"] + [1.2, -0.7], "lies 1.2 m east and 0.7 m south of the track"),
        ("position", turned_map(1.5, 1.0), "is turned by 1.5 deg"),
        ("position", turned_map(0.0, 1.004), "scaled by 1.004"),
        ("position", held_from_10_to_20_s(), "repeats one value for 10 s while the car moves on"),
        ("speed", 3.6 * right_truth()["speed"], "times the estimated one, as in another unit"),
        ("heading", right_truth()["heading"] + np.radians(3.0), "is turned 3 deg to the left"),
        ("heading", np.pi / 2 - right_truth()["heading"], "counts clockwise, and 90 deg where the car heads east"),
    ],
)
def test_rule_is_told_with_its_number(quantity: str, values: np.ndarray, words: str) -> None:
    rule = rules_of(changed(**{quantity: values}), quantity)[quantity]
    assert words in rule.text
    assert rule.nees_per_dof < 2.0
    assert rule.advice.endswith(".")


@pytest.mark.parametrize("late_s", [0.2, -0.1, 18.0])
def test_clock_of_the_truth_is_one_rule_for_all_quantities(late_s: float) -> None:
    rules = rules_of(right_truth(), late_ns=round(late_s * 1e9))
    assert {rule.text for rule in rules.values()} == {
        f"is {abs(late_s):g} s {'late' if late_s > 0 else 'early'} against the track, as by another clock"
    }
    assert list(rules) == ["position", "speed", "heading"]


def test_clock_and_point_are_told_together() -> None:
    rule = rules_of(changed(position=ahead_and_left(2.0, 0.0)), "position", late_ns=300_000_000)["position"]
    found = re.search(r"is (\S+) s late against the track, as by another clock, and lies (\S+) m ahead", rule.text)
    assert found is not None
    # at a nearly even speed each makes up for the other: 2 m are 0.2 s
    assert float(found[1]) == pytest.approx(0.3, abs=0.02)
    assert float(found[2]) == pytest.approx(2.0, abs=0.2)


def test_errors_that_come_and_go_have_no_rule() -> None:
    """Errors three times as large as sigma that last for five seconds each."""
    slow = np.repeat(np.random.default_rng(3).standard_normal((N // 100, 2)), 100, axis=0)
    assert rules_of(changed(position=right_truth()["position"] + 0.3 * slow), "position") == {}


def test_offset_of_one_half_is_no_rule() -> None:
    xy = right_truth()["position"]
    xy[N // 2 :] += 2.0
    assert rules_of(changed(position=xy), "position") == {}


def test_few_rows_have_no_rule() -> None:
    few = {name: values[:30] + 3.0 for name, values in right_truth().items()}
    assert find_truth_rules(EGO.stamp_ns[:30], few, EGO, EGO.covariance[:30], tuple(few)) == {}
    holes = {name: np.where(np.arange(len(v)) < 1170, np.nan, v.T).T for name, v in right_truth().items()}
    assert rules_of(holes) == {}
