"""A boundary that has just been found, has jumped or is only carried on raises no lane departure."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.prediction.paths import Paths
from cwcli.warning.lane_agreement import agreed_s
from cwcli.warning.lane_departure import Boundaries, LaneDepartureResult, evaluate_lane_departure

STEP_NS = 100_000_000
N = 40
T = np.arange(41) * 0.05


def stamps(n: int) -> np.ndarray:
    return np.arange(n, dtype=np.int64) * STEP_NS


def judged(
    left_m: np.ndarray, *, seen: np.ndarray | None = None, steady_s: np.ndarray | None = None
) -> LaneDepartureResult:
    """Frames at 10 Hz of a car that goes straight on in the middle of its lane; the left boundary as it is found."""
    n = len(left_m)
    zero = np.zeros((n, len(T)))
    covariance = np.zeros((n, len(T), 3))
    covariance[..., 2] = 0.01
    paths = Paths(T, np.tile(25.0 * T, (n, 1)), zero, zero, zero + 25.0, covariance)
    left, right = (np.column_stack([side, np.zeros(n), np.zeros(n)]) for side in (left_m, np.full(n, -1.8)))
    boundaries = Boundaries(left, right, 0.0, seen, steady_s)
    return evaluate_lane_departure(stamps(n), stamps(n), paths, boundaries, np.full(n, 25.0), width_m=1.8)


def test_agreement_by_hand() -> None:
    place = np.array([1.8, 1.8, 1.81, 1.2, 1.2, np.nan, 1.2, 1.2])
    seen = np.array([True, True, True, True, True, True, True, False])
    np.testing.assert_allclose(agreed_s(stamps(8), place, seen), [0.0, 0.1, 0.2, 0.0, 0.1, -1.0, 0.0, -1.0])


def test_what_a_car_can_do_agrees_and_a_gap_does_not() -> None:
    # 0.1 m + 1.5 m/s x 0.1 s = 0.25 m in a frame.
    assert agreed_s(stamps(2), np.array([1.8, 1.56]), np.ones(2, bool))[1] == pytest.approx(0.1)
    assert agreed_s(stamps(2), np.array([1.8, 1.54]), np.ones(2, bool))[1] == 0.0
    late = np.array([0, 600_000_000], np.int64)
    assert agreed_s(late, np.array([1.8, 1.8]), np.ones(2, bool))[1] == 0.0
    assert len(agreed_s(stamps(0), np.zeros(0), np.zeros(0, bool))) == 0


@pytest.mark.parametrize(("frames", "n_events"), [(3, 0), (10, 1)])
def test_a_boundary_that_jumps_onto_the_car_must_stay_there(frames: int, n_events: int) -> None:
    """0.85 m beside the car's middle the tyre is on the line: for 0.3 s nothing, in 1 s one warning."""
    left = np.full(N, 1.8)
    left[20 : 20 + frames] = 0.85
    assert len(judged(left).events) == n_events


def test_a_lane_that_is_only_carried_on_is_silent() -> None:
    left = np.full(N, 1.8)
    left[20:30] = 0.85
    seen = np.ones(N, bool)
    assert len(judged(left, seen=seen).events) == 1
    seen[20:30] = False
    result = judged(left, seen=seen)
    assert len(result.events) == 0
    assert result.counts["left_not_agreed"] >= 10


def test_a_lane_whose_method_tells_of_a_jump_is_silent_for_as_long() -> None:
    """The boundary comes nearer bit by bit, as a car can; its method says all the while that it has just jumped."""
    left = np.concatenate([np.full(10, 1.8), np.linspace(1.8, 0.8, 10), np.full(20, 0.8)])
    assert len(judged(left).events) == 1
    assert len(judged(left, steady_s=np.full(N, 0.2)).events) == 0
    assert len(judged(left, steady_s=np.full(N, np.nan)).events) == 1
