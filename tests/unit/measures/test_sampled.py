"""CPI and P_MC against random samples, in small; `tests.studies.sampled_measures` has a million of each encounter."""

from __future__ import annotations

import numpy as np

from cwcli.measures import MEASURES
from tests.studies.sampled_measures import approach, sampled_cpi, worst

ATOL = 0.005
N_SAMPLES = 200_000
"""Their standard error is at most 0.0011."""


def test_both_are_what_samples_say() -> None:
    for name, difference in worst(3, N_SAMPLES, seed=4).items():
        assert difference < ATOL, name


def test_the_approaches_need_all_kinds_of_braking() -> None:
    rng = np.random.default_rng(4)
    values = [sampled_cpi(approach(rng), 1000, rng) for _ in range(40)]
    assert min(values) < 0.05
    assert max(values) > 0.95
    assert sum(0.1 < value < 0.9 for value in values) >= 5


def test_what_needs_no_braking_has_no_crash_potential() -> None:
    closing = approach(np.random.default_rng(1))
    apart = type(closing)(closing.other, closing.host, closing.other_size, closing.host_size, closing.max_gap_s)
    assert float(apart.evaluate_measure(MEASURES["cpi"])) == 0.0
