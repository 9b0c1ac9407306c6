"""Lane departure on made-up paths and boundaries: crossing times by hand, zones, suppression, life of a warning."""

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.prediction.paths import Paths
from cwcli.warning.lane_departure import (
    FrontAxle,
    LaneBoundaries,
    LaneDepartureConfig,
    LaneDepartureResult,
    earliest_warning_line_m,
    evaluate_lane_departure,
)

WIDTH_M = 1.8
LANE_M = 3.6
V = 25.0
T = np.arange(41.0) * 0.05


def evaluate(offset_m, rate_mps, *, speed=V, found=(True, True), curvature=0.0, config=None) -> LaneDepartureResult:
    """Frames at 10 Hz of a car at an offset from the lane's centre (left positive) that drifts at a rate."""
    offset_m = np.asarray(offset_m, dtype=float)
    n = len(offset_m)
    rate = np.broadcast_to(np.asarray(rate_mps, dtype=float), (n,))
    speed = np.broadcast_to(np.asarray(speed, dtype=float), (n,)).copy()
    x = np.tile(V * T, (n, 1))
    y = rate[:, None] * T + 0.5 * curvature * x**2
    zero = np.zeros_like(x)
    covariance = np.zeros((n, len(T), 3))
    covariance[..., 2] = 0.01
    paths = Paths(T, x, y, curvature * x, zero + V, covariance)
    sides = []
    for sign, is_found in ((1.0, found[0]), (-1.0, found[1])):
        side = np.column_stack([sign * LANE_M / 2 - offset_m, np.zeros(n), np.full(n, curvature)])
        side[~np.broadcast_to(is_found, n)] = np.nan
        sides.append(side)
    stamp_ns = np.arange(n, dtype=np.int64) * 100_000_000
    boundaries = LaneBoundaries(sides[0], sides[1])
    return evaluate_lane_departure(
        stamp_ns, stamp_ns + 5, paths, boundaries, speed, config, host=FrontAxle(WIDTH_M, 1e-9)
    )


def drift(rate_mps: float, n: int = 120) -> np.ndarray:
    return rate_mps * 0.1 * np.arange(n)


def test_isos_earliest_lines() -> None:
    # 0.75 m up to 0.5 m/s, 1.5 s V up to 1 m/s, then 1.5 m.
    np.testing.assert_allclose(
        earliest_warning_line_m(np.array([0.1, 0.5, 0.8, 1.0, 2.0])), [0.75, 0.75, 1.2, 1.5, 1.5]
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_time_to_line_crossing_by_hand(side: float) -> None:
    # Tyre 0.9 m from the boundary in the middle; at 0.6 m offset 0.3 m remain: 0.6 s at 0.5 m/s.
    series = evaluate([0.6 * side], 0.5 * side).series.rows_as_dicts()[0]
    name = "left" if side > 0 else "right"
    assert series[f"{name}_gap_m"] == pytest.approx(0.3)
    assert series[f"{name}_departure_rate_mps"] == pytest.approx(0.5)
    assert series[f"{name}_time_to_line_crossing_s"] == pytest.approx(0.6)
    other = "right" if side > 0 else "left"
    assert series[f"{other}_time_to_line_crossing_s"] == np.inf


def test_a_bend_that_is_followed_is_no_departure() -> None:
    result = evaluate(np.zeros(50), 0.0, curvature=0.004)
    assert len(result.events) == 0
    assert np.isinf(np.asarray(result.series.columns["left_time_to_line_crossing_s"])).all()


@pytest.mark.parametrize("rate_mps", [0.1, 0.3, 0.5, 0.8, -0.1, -0.8])
def test_a_drift_is_warned_once_inside_isos_zone(rate_mps: float) -> None:
    events = evaluate(drift(rate_mps), rate_mps).events.rows_as_dicts()
    assert [event["side"] for event in events] == ["left" if rate_mps > 0 else "right"]
    assert -0.3 <= events[0]["gap_m"] <= events[0]["earliest_line_m"]
    assert events[0]["time_to_line_crossing_s"] == pytest.approx(0.6, abs=0.11)


def test_the_life_of_a_warning() -> None:
    offset = np.concatenate([np.linspace(0.0, 0.85, 20), np.full(10, 0.85), np.linspace(0.85, 0.0, 20), np.zeros(30)])
    rate = np.gradient(offset, 0.1)
    result = evaluate(offset, rate)
    states = list(result.rows.state)
    assert states[0] == 1
    assert states[-1] == 3
    assert set(states[1:-1]) == {2}
    assert set(result.rows.event_id) == {1}
    assert result.rows.other_id.values == ("left boundary",)
    assert set(result.rows.rule.values) == {"lane-departure"}
    np.testing.assert_array_equal(result.rows.log_time_ns, result.rows.stamp_ns + 5)
    assert "leaving the lane to the left" in result.rows.message.values[0]


def test_a_side_without_a_boundary_is_silent_and_counted() -> None:
    result = evaluate(drift(0.5), 0.5, found=(False, True))
    assert len(result.events) == 0
    assert result.counts["left_not_found"] == 120
    assert result.counts["left_evaluated"] == 0
    assert result.counts["right_evaluated"] == 120


def test_boundaries_lost_for_seconds_end_the_warning() -> None:
    found = np.ones(120, dtype=bool)
    found[16:50] = False
    result = evaluate(drift(0.5), 0.5, found=(found, True))
    raised = [event["raised_stamp_ns"] for event in result.events.rows_as_dicts()]
    assert len(raised) == 2
    assert raised[1] >= 5_000_000_000


def test_slow_cars_are_not_warned() -> None:
    for speed in (0.0, 10.0, 16.9, np.nan):
        result = evaluate(drift(0.5), 0.5, speed=speed)
        assert len(result.events) == 0
    assert result.counts["speed_not_known"] == 120
    assert len(evaluate(drift(0.5), 0.5, speed=17.0).events) == 1


def test_a_raised_warning_survives_a_little_slowing_down() -> None:
    speed = np.full(60, 17.2)
    speed[16:] = 16.5
    held = evaluate(drift(0.5, 60), 0.5, speed=speed).events.rows_as_dicts()
    assert len(held) == 1
    assert held[0]["last_held_stamp_ns"] == 5_900_000_000
    speed[16:] = 15.0
    assert evaluate(drift(0.5, 60), 0.5, speed=speed).events.rows_as_dicts()[0]["last_held_stamp_ns"] < 1_700_000_000


def test_boundaries_that_cross_are_not_believed() -> None:
    stamp_ns = np.arange(5, dtype=np.int64) * 100_000_000
    zeros = np.zeros((5, len(T)))
    paths = Paths(T, zeros + V * T, zeros, zeros, zeros + V, np.zeros((5, len(T), 3)))
    swapped = LaneBoundaries(np.tile([-1.8, 0, 0], (5, 1)), np.tile([1.8, 0, 0], (5, 1)))
    result = evaluate_lane_departure(stamp_ns, stamp_ns, paths, swapped, np.full(5, V))
    assert len(result.events) == 0
    assert result.counts["implausible_width"] == 5


def test_one_bad_frame_does_not_warn() -> None:
    offset = np.zeros(60)
    offset[30] = 0.95
    assert len(evaluate(offset, 0.0).events) == 0


def test_no_frames() -> None:
    result = evaluate(np.zeros(0), 0.0)
    assert len(result.events) == 0
    assert len(result.rows.log_time_ns) == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"warn_s": -1.0},
        {"warn_s": 2.0, "release_s": 1.5},
        {"min_speed_mps": np.nan},
        {"min_width_m": 7.0},
        {"persistence_s": np.inf},
    ],
)
def test_wrong_options_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="lane-departure"):
        LaneDepartureConfig(**changes)


def test_paths_that_are_too_short_are_refused() -> None:
    with pytest.raises(UsageError, match=r"the paths reach 2 s, the rule looks 2\.5 s ahead"):
        evaluate(np.zeros(3), 0.0, config=LaneDepartureConfig(warn_s=2.5, release_s=3.0))
