"""Recorded conflicts driven again: what a careful driver makes of them, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.control.preventable import DRIVER_MODELS, DriverVerdict, judge_preventability
from cwcli.measures.pair import ActualTrack, Pair

CAR = (4.5, 1.8)
T0_NS = 1_700_000_000_000_000_000


def track(time_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray, speed: np.ndarray, heading: float) -> ActualTrack:
    state = np.column_stack([x_m, y_m, speed, np.full(len(time_s), heading)])
    return ActualTrack(T0_NS + np.round(time_s * 1e9).astype(np.int64), state)


def behind_a_standing_car(speed_mps: float = 20.0, duration_s: float = 10.0) -> tuple[Pair, int]:
    """The host runs at constant speed into one that stands; the crash is 8 s after the start."""
    time_s = np.arange(0.0, duration_s, 0.05)
    zero = np.zeros(len(time_s))
    host = track(time_s, speed_mps * time_s, zero, zero + speed_mps, 0.0)
    other = track(time_s, zero + 8.0 * speed_mps + 4.5, zero, zero, 0.0)
    return Pair(host, other, CAR, CAR, 0.5), T0_NS + 8 * 10**9


def by_name(found: list[DriverVerdict]) -> dict[str, DriverVerdict]:
    return {each.driver: each for each in found}


def test_a_standing_car_ahead() -> None:
    found = by_name(judge_preventability(*behind_a_standing_car()))
    assert list(found) == list(DRIVER_MODELS)
    human = found["careful human"]
    # it sees danger 2 s before contact, reacts for 8 steps, and then needs 400 / (2 * 7.59) m + the build-up: too late
    assert not human.avoided
    assert human.braked_s == pytest.approx(2.0 - 0.8, abs=0.11)
    assert 0.0 < human.impact_mps < 20.0
    # RSS looks 80 m ahead: 15 + 0.84 + 22.25^2 / 12 = 57 m, which is 2.86 s
    rss = found["RSS"]
    assert rss.avoided
    assert np.isnan(rss.impact_mps)
    assert rss.braked_s == pytest.approx(2.86 - 0.8, abs=0.11)
    assert rss.least_gap_m > 0.0
    # from its latest start it brakes at once after the reaction: 20^2 / (2 * 7.59) + 0.8 * 20 + build-up = 48.4 m
    assert rss.last_chance_s == pytest.approx(48.4 / 20.0, abs=0.15)


def test_later_than_the_last_chance_nobody_avoids_it() -> None:
    pair, conflict_ns = behind_a_standing_car()
    late = pair.slice_rows(int(np.searchsorted(pair.stamp_ns, conflict_ns - 10**9)), len(pair.stamp_ns))
    for each in judge_preventability(late, conflict_ns):
        assert not each.avoided
        assert np.isnan(each.last_chance_s)
        assert each.impact_mps > 5.0


def test_a_slow_approach_is_avoided_by_all() -> None:
    for each in judge_preventability(*behind_a_standing_car(speed_mps=5.0)):
        assert each.avoided
        assert each.least_gap_m > 0.0
        assert each.last_chance_s > 0.5


def test_a_crossing_that_a_careful_driver_avoids() -> None:
    time_s = np.arange(0.0, 10.0, 0.05)
    zero = np.zeros(len(time_s))
    host = track(time_s, 8.0 * time_s, zero, zero + 8.0, 0.0)
    # its front is in the host's way 3.15 s before its centre is, so that the human sees it 2 s before contact
    slow = track(time_s, zero + 64.0, time_s - 8.0, zero + 1.0, np.pi / 2)
    found = by_name(judge_preventability(Pair(host, slow, CAR, CAR, 0.5), T0_NS + 8 * 10**9))
    assert found["careful human"].avoided
    assert found["careful human"].braked_s > 0.8
    # at 3 m/s it is there 1.05 s before, which is less than the reaction and the way to stop
    fast = track(time_s, zero + 64.0, 3.0 * (time_s - 8.0), zero + 3.0, np.pi / 2)
    found = by_name(judge_preventability(Pair(host, fast, CAR, CAR, 0.5), T0_NS + 8 * 10**9))
    assert not found["careful human"].avoided
    assert found["careful human"].impact_mps > 5.0


def test_nothing_is_said_of_what_is_not_known() -> None:
    pair, conflict_ns = behind_a_standing_car()
    nothing = ActualTrack(np.zeros(0, np.int64), np.zeros((0, 4)))
    assert judge_preventability(Pair(pair.host, nothing, CAR, CAR, 0.5), conflict_ns) == []
    assert judge_preventability(pair, T0_NS - 10**9) == []
