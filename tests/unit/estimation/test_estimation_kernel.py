"""The small loops around the filter's passes against their plain twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.kernels.estimation import lay_steps, matching_factor
from tests.unit.estimation import naive_estimation

MAX_STEP_S, MAX_PIECES = 0.1, 7


def laid(update_s: list[float], output_s: list[float], start_s: float) -> tuple[np.ndarray, ...]:
    update, output = np.array(update_s, float), np.array(output_s, float)
    return lay_steps(update, output, start_s=start_s, max_step_s=MAX_STEP_S, max_pieces=MAX_PIECES)


def test_steps_by_hand() -> None:
    # start at 1.0; updates at 1.0 and twice at 1.25, which is three pieces on; an output at 1.25 comes behind them
    time_s, first, out_row = laid([1.0, 1.25, 1.25], [1.25, 1.3], 1.0)
    assert time_s.tolist() == pytest.approx([1.0, 1.0 + 0.25 / 3, 1.0 + 0.5 / 3, 1.25, 1.25, 1.3])
    assert first.tolist() == [0, 1, 1, 1, 3, 3, 3]
    assert out_row.tolist() == [-1, -1, -1, -1, 0, 1]


@pytest.mark.parametrize("seed", range(20))
def test_steps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    update_s = np.sort(rng.choice(np.arange(0.0, 3.0, 0.05), rng.integers(0, 40)))
    output_s = np.sort(np.append(rng.choice(np.arange(0.0, 4.0, 0.025), rng.integers(0, 20)), [9.0] * (seed % 2)))
    expected: tuple[np.ndarray, ...] = naive_estimation.steps(update_s, output_s, 0.0, MAX_STEP_S, MAX_PIECES)
    for found, plain in zip(laid(update_s.tolist(), output_s.tolist(), 0.0), expected, strict=True):
        assert found.tobytes() == plain.tobytes()


def test_steps_end_whatever_the_times_are() -> None:
    time_s, first, _ = laid([0.0, math.inf, math.nan], [math.inf, math.nan], 0.0)
    assert len(time_s) < 100
    assert first[-1] == 3


@pytest.mark.parametrize("seed", range(10))
def test_matching_factor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nu2, prior, noise = rng.chisquare(1, 90) * 10.0 ** rng.uniform(-2, 2), rng.uniform(0, 1, 90), rng.uniform(0, 1, 90)
    found = matching_factor(nu2, prior, noise, most=64.0, n_steps=16, limit=9.0)
    assert found == naive_estimation.matching_factor(nu2, prior, noise, most=64.0, n_steps=16, limit=9.0)
    nu2[3] = math.nan  # a row before the start: nothing is used
    assert matching_factor(nu2, prior, noise, most=64.0, n_steps=16, limit=9.0) == pytest.approx(1 / 64, rel=1e-3)
