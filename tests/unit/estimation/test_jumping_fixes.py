"""Fixes that jump away and back are set aside, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.jumping_fixes import do_fixes_jump_for_good, fixes_jumped_away_mask
from cwcli.signals.columns import FloatArray

TIME_S = np.arange(0.0, 60.0, 0.1)
SCATTER_M = 0.6


def drive(seed: int = 0, speed_mps: float = 10.0) -> FloatArray:
    """Fixes of a car that goes round a bend, with white noise."""
    angle = speed_mps * TIME_S / 80.0
    way = 80.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    return np.asarray(way + SCATTER_M * np.random.default_rng(seed).standard_normal(way.shape))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("speed_mps", [0.0, 10.0, 30.0])
def test_good_fixes_stay(seed: int, speed_mps: float) -> None:
    assert not fixes_jumped_away_mask(TIME_S, drive(seed, speed_mps), SCATTER_M).any()


@pytest.mark.parametrize("seed", range(10))
def test_stamps_that_err_make_no_jump(seed: int) -> None:
    """Fixes that are stamped when they arrive, up to half a second late, come in bursts: their values are right."""
    late_s = np.maximum.accumulate(TIME_S + 0.5 * np.random.default_rng(seed).random(len(TIME_S)))
    assert not fixes_jumped_away_mask(late_s, drive(seed, 15.0), 0.3).any()


@pytest.mark.parametrize("offset_m", [12.0, 60.0, 15_000.0])
def test_a_stretch_between_two_jumps_is_set_aside(offset_m: float) -> None:
    fixes = drive()
    fixes[200:320, 0] += offset_m
    assert np.flatnonzero(fixes_jumped_away_mask(TIME_S, fixes, SCATTER_M)).tolist() == list(range(200, 320))


def test_a_lost_minus_sign_is_set_aside() -> None:
    fixes = drive() - np.array([700.0, 0.0])
    fixes[200:320, 0] *= -1.0
    assert np.flatnonzero(fixes_jumped_away_mask(TIME_S, fixes, SCATTER_M)).tolist() == list(range(200, 320))


def test_single_wrong_fixes_are_set_aside_and_not_what_lies_between() -> None:
    fixes = drive()
    wrong = np.sort(np.random.default_rng(1).choice(len(fixes), 40, replace=False))
    fixes[wrong] += 50.0
    found = fixes_jumped_away_mask(TIME_S, fixes, SCATTER_M)
    assert found[wrong].mean() > 0.9
    assert found.sum() - found[wrong].sum() <= 10


@pytest.mark.parametrize(
    "rows",
    [slice(300, None), slice(None, 300), slice(100, 500)],
    ids=["one jump late", "one jump early", "longer than what is left"],
)
def test_jumps_that_do_not_show_which_side_is_wrong_stay(rows: slice) -> None:
    fixes = drive()
    fixes[rows] += 20.0
    found = fixes_jumped_away_mask(TIME_S, fixes, SCATTER_M)
    assert not found[100:500].any()


def test_a_second_jump_elsewhere_is_not_the_way_back() -> None:
    """A receiver that settles in two steps to the same side is right at the end."""
    fixes = drive()
    fixes[:200] -= 20.0
    fixes[200:300] -= 10.0
    assert not fixes_jumped_away_mask(TIME_S, fixes, SCATTER_M).any()


def test_a_pause_of_the_fixes_is_no_jump() -> None:
    fixes, kept = drive(), np.r_[0:200, 260:600]
    assert not fixes_jumped_away_mask(TIME_S[kept], fixes[kept], SCATTER_M).any()


@pytest.mark.parametrize("n", [0, 1, 3])
def test_few_fixes_show_nothing(n: int) -> None:
    assert fixes_jumped_away_mask(TIME_S[:n], drive()[:n], SCATTER_M).shape == (n,)


@pytest.mark.parametrize(
    ("rows", "is_for_good"), [(slice(300, None), True), (slice(300, 304), False), (slice(0, 0), False)]
)
def test_a_jump_without_one_back_shows_that_some_fixes_are_wrong(rows: slice, is_for_good: bool) -> None:
    fixes = drive()
    fixes[rows] += 20.0
    assert do_fixes_jump_for_good(TIME_S, fixes, SCATTER_M) is is_for_good
