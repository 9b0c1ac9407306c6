import tracemalloc

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from cwcli.tracking.assignment import rows_and_columns_assigned_in_groups, rows_and_columns_of_best_pairs


def best_by_scipy(gain):
    """Leaving out is free: pad with zeros."""
    m, n = gain.shape
    padded = np.zeros((m + n, m + n))
    padded[:m, :n] = np.where(gain > 0.0, gain, -1e6)
    i, j = linear_sum_assignment(padded, maximize=True)
    real = (i < m) & (j < n)
    return padded[i[real], j[real]].sum()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1), (5, 5), (3, 9), (12, 4), (20, 60)])
@pytest.mark.parametrize("share", [0.05, 0.4, 1.0])
def test_assignment_is_as_good_as_scipys(shape, share) -> None:
    rng = np.random.default_rng([*shape, int(100 * share)])
    for _ in range(20):
        gain = rng.normal(1.0, 3.0, shape)
        gain[rng.random(shape) > share] = -np.inf
        for method in (rows_and_columns_of_best_pairs, rows_and_columns_assigned_in_groups):
            i, j = method(gain)
            assert len(set(i.tolist())) == len(i)
            assert len(set(j.tolist())) == len(j)
            assert (gain[i, j] > 0.0).all()
            if method is rows_and_columns_of_best_pairs or shape[1] <= 32:
                assert gain[i, j].sum() == pytest.approx(best_by_scipy(gain), abs=1e-9)


def test_the_best_for_all_is_not_the_nearest_for_each() -> None:
    gain = np.array([[10.0, 9.0], [9.5, 1.0]])  # greedy: 10 + 1; global: 9 + 9.5
    i, j = rows_and_columns_assigned_in_groups(gain)
    assert dict(zip(i.tolist(), j.tolist(), strict=True)) == {0: 1, 1: 0}


def test_nothing_to_assign() -> None:
    for gain in (np.zeros((0, 3)), np.zeros((3, 0)), np.full((2, 2), -np.inf), np.full((2, 2), -1.0)):
        i, j = rows_and_columns_assigned_in_groups(gain)
        assert len(i) == len(j) == 0


def test_five_hundred_tracks_that_all_want_ten_thousand_detections_stay_small() -> None:
    gain = np.random.default_rng(0).random((500, 10_000)) + 1.0
    tracemalloc.start()
    i, j = rows_and_columns_assigned_in_groups(gain)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5 * gain.nbytes  # a square matrix of all would be 22 times
    assert len(i) == len(set(j.tolist())) > 450
