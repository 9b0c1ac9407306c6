"""The kernel of the record against its slow twin."""

import numpy as np
import pytest

from cwcli.kernels import paths as paths_kernel
from cwcli.kernels import record as kernel
from tests.unit.prediction import naive_record

SIZES = (40, 1, 25)


def test_changes() -> None:
    rng = np.random.default_rng(0)
    age_s = np.concatenate([np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.4, n - 1))]) for n in SIZES])
    first = np.repeat(np.cumsum([0, *SIZES[:-1]]), SIZES)
    value = rng.normal(size=(2, len(age_s)))
    look_back_s = np.array([0.3, 0.5, 2.5])
    found = kernel.changes(age_s, value, first, look_back_s)
    for one, other in zip(found, naive_record.changes(age_s, value, first, look_back_s), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("sizes", [(60,), SIZES])
def test_gains(sizes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    n, knots_s = sum(sizes), np.array([0.5, 1.0, 2.5])
    shares = rng.dirichlet(np.ones(3), size=(n, 2, 3))
    promised, followed = rng.normal(size=(2, n, 2, 3))
    followed[rng.uniform(size=followed.shape) < 0.2] = np.nan
    now_ns = np.concatenate([np.sort(rng.integers(0, 12, size)) * 5 * 10**8 for size in sizes])  # many at once
    ends = np.repeat(np.cumsum(sizes), sizes)
    known_row = np.arange(n)[:, None] + [2, 4, 9]
    known_row = np.where(known_row < ends[:, None], known_row, n)
    known_ns = np.append(now_ns, np.iinfo(np.int64).max)[known_row]
    carried = rng.uniform(0.0, 1.5, (2, 3, 3))
    carried[0, 1, 1] = np.nan
    shared = {
        "step_s": rng.uniform(0.0, 0.5, n),
        "knots_s": knots_s,
        "track": np.repeat(np.arange(len(sizes)), sizes),
        "known_row": known_row,
        "known_ns": known_ns,
        "now_ns": now_ns,
        "prior": rng.uniform(size=(2, 3, 3)),
        "error_m": rng.uniform(0.2, 2.0, (2, 3)),
        "carried": carried,
        "prior_outcomes": np.array([4.0, 1.0, 1.0]),
    }
    found = kernel.gains(
        shares,
        promised,
        followed,
        by_known=np.ascontiguousarray(np.argsort(known_ns, axis=0, kind="stable").T),
        by_now=np.argsort(now_ns, kind="stable"),
        **shared,
    )
    np.testing.assert_allclose(found, naive_record.gains(shares, promised, followed, **shared), atol=1e-9)
    assert np.ptp(found, axis=0).max() > 0.1


def test_stream_quantiles() -> None:
    rng = np.random.default_rng(2)
    cell, track = rng.integers(0, 20, 300), rng.integers(0, 4, 300)
    weight, prior = rng.uniform(size=300), rng.uniform(0.1, 1.0, 20)
    n_known, asking = np.sort(rng.integers(0, 301, 50)), rng.integers(0, 5, 50)
    levels = np.array([0.5, 0.9])
    found = paths_kernel.stream_quantiles(cell, weight, track, n_known, asking, prior, levels)
    expected = naive_record.stream_quantiles(cell, weight, track, n_known, asking, prior, levels)
    np.testing.assert_allclose(found, expected, atol=1e-9)
