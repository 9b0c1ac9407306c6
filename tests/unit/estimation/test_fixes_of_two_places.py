"""Fixes of two receivers in turns are found by the distance that was planted; noise and motion are none."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.fixes_of_two_places import (
    covariance_from_fixes_of_two_places,
    distance_m_and_words_of_two_places,
)
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries

TIME_S = 0.1 * np.arange(600, dtype=np.float64)


def weaving_fixes(noise_m: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Fixes of a minute on a way that weaves at 10 m/s, and the headings."""
    heading = 1.5 * np.sin(0.2 * TIME_S)
    way = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return way + noise_m * np.random.default_rng(seed).standard_normal(way.shape), heading


def found_of(fixes: np.ndarray, time_s: np.ndarray = TIME_S) -> tuple[float, str]:
    """What is found of fixes whose mean way is that of the estimate."""
    way, _ = weaving_fixes(0.0)
    state = np.zeros((600, 8))
    there = np.isin(TIME_S, time_s)
    state[:, :2] = way + (fixes - way[there]).mean(axis=0)
    state[:, 3] = 1.5 * np.sin(0.2 * TIME_S)
    series = SensorSeries("/fix", Kind.POSITION, time_s, fixes, np.tile([0.36, 0.0, 0.36], (len(fixes), 1)))
    return distance_m_and_words_of_two_places(series, TIME_S, state)


@pytest.mark.parametrize(
    ("noise_m", "offset_m"), [(0.05, (3.0, -2.0)), (0.6, (3.0, -2.0)), (1.5, (2.4, -1.8)), (0.6, (0.0, 1.5))]
)
def test_distance_of_two_receivers_is_found(noise_m: float, offset_m: tuple[float, float]) -> None:
    fixes, _ = weaving_fixes(noise_m)
    fixes[1::2] += offset_m
    distance_m, words = found_of(fixes)
    assert distance_m == pytest.approx(np.hypot(*offset_m), rel=0.15)
    assert words == "every second fix lies"


def test_distance_of_two_antennas_turns_with_the_car() -> None:
    fixes, heading = weaving_fixes(0.3)
    fixes[::2] += 2.0 * np.column_stack([np.cos(heading), np.sin(heading)])[::2]
    assert found_of(fixes)[0] == pytest.approx(2.0, rel=0.1)


def test_missing_fixes_do_not_hide_it() -> None:
    fixes, _ = weaving_fixes(0.3)
    fixes[1::2] += (2.0, 0.0)
    there = np.random.default_rng(1).random(600) > 0.03
    assert found_of(fixes[there], TIME_S[there])[0] == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize("noise_m", [0.0, 0.02, 0.6, 5.0])
def test_right_fixes_are_not_in_turns(noise_m: float) -> None:
    for seed in range(20):
        fixes, _ = weaving_fixes(noise_m, seed)
        assert found_of(fixes)[0] == 0.0
    assert found_of(fixes[:50], TIME_S[:50])[0] == 0.0


@pytest.mark.parametrize(("noise_m", "share"), [(0.05, 0.4), (0.5, 0.4), (0.5, 0.75), (0.3, 0.2)])
def test_receivers_in_any_order_leave_two_heaps(noise_m: float, share: float) -> None:
    fixes, _ = weaving_fixes(noise_m)
    is_other = np.random.default_rng(2).random(600) < share
    fixes[is_other] += (2.4, 1.8)
    percent = round(100 * min(is_other.mean(), 1 - is_other.mean()))
    distance_m, words = found_of(fixes)
    assert distance_m == pytest.approx(3.0, rel=0.1)
    assert words in [f"{percent + k} % of its fixes lie" for k in (-1, 0, 1)]


@pytest.mark.parametrize("noise_m", [0.02, 0.6, 5.0])
def test_right_fixes_lie_in_one_heap(noise_m: float) -> None:
    rng = np.random.default_rng(3)
    for seed in range(20):
        fixes, heading = weaving_fixes(noise_m, seed)
        assert found_of(fixes)[0] == 0.0
        assert found_of(fixes + rng.uniform(-3.0, 3.0, fixes.shape))[0] == 0.0
        outliers = 30.0 * rng.standard_normal(fixes.shape) * (rng.random((600, 1)) < 0.1)
        assert found_of(fixes + outliers)[0] == 0.0
        late = 3.0 * np.column_stack([np.cos(heading), np.sin(heading)]) * (rng.random((600, 1)) < 0.4)
        assert found_of(fixes - late)[0] == 0.0
        lasting = np.where(TIME_S[:, None] % 20.0 < 8.0, 3.0, 0.0)
        assert found_of(fixes + lasting)[0] == 0.0


def test_a_right_position_needs_no_wider_sigma() -> None:
    assert covariance_from_fixes_of_two_places([("/a", 4.0, "")])[:2, :2].tolist() == [
        [2.0, 0.0],
        [0.0, 2.0],
    ]
    assert not covariance_from_fixes_of_two_places([("/a", 4.0, ""), ("/b", 0.0, "")]).any()
    assert not covariance_from_fixes_of_two_places([]).any()
