"""A boundary that has just been found, has jumped or is only carried on raises no lane departure."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.prediction.paths import Paths
from cwcli.warning.lane_agreement import agreement_duration_s, approach_speed_bound_mps
from cwcli.warning.lane_departure import FrontAxle, LaneBoundaries, LaneDepartureResult, evaluate_lane_departure

STEP_NS = 100_000_000
N = 40
T = np.arange(41.0) * 0.05


def stamps(n: int) -> np.ndarray:
    return np.arange(n, dtype=np.int64) * STEP_NS


def judged(
    left_m: np.ndarray,
    *,
    seen: np.ndarray | None = None,
    steady_s: np.ndarray | None = None,
    rate_mps: float = 0.0,
) -> LaneDepartureResult:
    """Frames at 10 Hz of a car that goes straight on, or to the left as its path says; the left boundary as found."""
    n = len(left_m)
    zero = np.zeros((n, len(T)))
    covariance = np.zeros((n, len(T), 3))
    covariance[..., 2] = 0.01
    paths = Paths(T, np.tile(25.0 * T, (n, 1)), zero + rate_mps * T, zero, zero + 25.0, covariance)
    left, right = (np.column_stack([side, np.zeros(n), np.zeros(n)]) for side in (left_m, np.full(n, -1.8)))
    boundaries = LaneBoundaries(left, right, 0.0, seen, steady_s)
    return evaluate_lane_departure(stamps(n), stamps(n), paths, boundaries, np.full(n, 25.0), host=FrontAxle(1.8))


def test_agreement_by_hand() -> None:
    place = np.array([1.8, 1.8, 1.81, 1.2, 1.2, np.nan, 1.2, 1.2])
    seen = np.array([True, True, True, True, True, True, True, False])
    np.testing.assert_allclose(agreement_duration_s(stamps(8), place, seen), [0.0, 0.1, 0.2, 0.0, 0.1, -1.0, 0.0, -1.0])


def test_what_a_car_can_do_agrees_and_a_gap_does_not() -> None:
    # 0.1 m + 1.5 m/s x 0.1 s = 0.25 m in a frame.
    assert agreement_duration_s(stamps(2), np.array([1.8, 1.56]), np.ones(2, bool))[1] == pytest.approx(0.1)
    assert agreement_duration_s(stamps(2), np.array([1.8, 1.54]), np.ones(2, bool))[1] == 0.0
    late = np.array([0, 600_000_000], np.int64)
    assert agreement_duration_s(late, np.array([1.8, 1.8]), np.ones(2, bool))[1] == 0.0
    assert len(agreement_duration_s(stamps(0), np.zeros(0), np.zeros(0, bool))) == 0


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
    assert result.counts["left_too_new_or_jumped"] >= 10


def test_a_lane_whose_method_tells_of_a_jump_is_silent_for_as_long() -> None:
    """The boundary comes nearer bit by bit, as a car can; its method says all the while that it has just jumped."""
    left = np.concatenate([np.full(10, 1.8), np.linspace(1.8, 0.8, 10), np.full(20, 0.8)])
    assert len(judged(left).events) == 1
    assert len(judged(left, steady_s=np.full(N, 0.2)).events) == 0
    assert len(judged(left, steady_s=np.full(N, np.nan)).events) == 1


def test_a_path_across_a_boundary_that_does_not_come_nearer_is_no_departure() -> None:
    """The tyre is 0.3 m beside the boundary, 0.3 s at the path's 1 m/s: a fact once the boundary does come nearer."""
    there = np.full(N, 1.2)
    assert len(judged(there, rate_mps=1.0).events) == 0
    assert len(judged(there + 0.02 * np.arange(N), rate_mps=1.0).events) == 0
    result = judged(np.maximum(1.8 - 0.1 * np.arange(N), 0.9), rate_mps=1.0)
    # Within 0.7 s from 0.2 s on, agreed with from 0.3 s on, for 0.1 s.
    assert [event["raised_stamp_ns"] for event in result.events.rows_as_dicts()] == [400_000_000]


def test_a_boundary_that_comes_too_slowly_to_be_crossed_soon_is_no_departure() -> None:
    """0.3 m at 0.1 m/s is 3 s, at 0.3 m/s 1 s; a warning is held up to 1.5 s."""
    slowly, faster = (1.2 + rate * 0.1 * (20.0 - np.arange(21)) for rate in (0.1, 0.3))
    assert len(judged(slowly, rate_mps=1.0).events) == 0
    assert len(judged(faster, rate_mps=1.0).events) == 1


def test_approach_by_hand() -> None:
    """0.3 s of 10 Hz are four frames: times -1.5, -0.5, 0.5, 1.5 tenths, so 0.05 s^2 in sum."""
    gap = np.array([1.1, 1.0, 0.9, 0.9, 0.8, np.nan, 0.8])
    found = approach_speed_bound_mps(stamps(7), gap, np.array([0.0, 0.1, 0.2, 0.3, 0.3, -1.0, 0.3]))
    # Of 1.0, 0.9, 0.9, 0.8: (1.5 x 0.2 + 0.5 x 0) x 0.1 / 0.05 = 0.6 m/s; residuals 0.01, -0.03, 0.03, -0.01 m,
    # of two degrees of freedom, so the slope's sigma is sqrt(0.002 / 2 / 0.05) = 0.141 m/s.
    np.testing.assert_allclose(found[:2], np.inf)
    assert found[4] == pytest.approx(0.6 + 2.0 * 0.1414, abs=1e-3)
    # Of 1.1, 1.0, 0.9 the slope is 1 m/s without a residual.
    assert found[2] == pytest.approx(1.0, abs=1e-6)
    assert found[5] == np.inf
    # Of 0.9, 0.8, 0.8 at 0, 0.1 and 0.3 s: mean 0.1333 s, sum 0.04667 s^2, 0.01333 m s, so 0.2857 m/s; the gap's own
    # sum of squares is 0.006667 m^2, so 0.002857 m^2 are left, of one degree of freedom: 0.2474 m/s.
    assert found[6] == pytest.approx(0.2857 + 2.0 * 0.2474, abs=1e-3)
    assert len(approach_speed_bound_mps(stamps(0), np.zeros(0), np.zeros(0))) == 0


def test_an_approach_is_that_of_the_last_half_second() -> None:
    gap = np.concatenate([np.full(10, 1.0), 1.0 - 0.05 * np.arange(1, 7)])
    found = approach_speed_bound_mps(stamps(16), gap, 0.1 * np.arange(16.0))
    np.testing.assert_allclose(found[[9, 15]], [0.0, 0.5], atol=1e-6)
