"""Variances that no sensor has: a filter that believes one loses its covariance to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.columns import Columns
from cwcli.signals.covariances import (
    UNUSABLE_COVARIANCE_REASON,
    usable_plane_covariance_or_nan,
    usable_variances_or_nan,
)
from cwcli.signals.quality import RowLedger


def ledger(n: int) -> RowLedger:
    times = np.arange(n, dtype=np.int64) + 10**18
    columns = Columns("/gps/fix", "", "cdr", times, times, np.arange(n, dtype=np.uint32), {}, 0)
    return RowLedger(columns, "ego_position")


@pytest.mark.parametrize("tiny", [5.9e-322, 2.4e-259, 1e-19])
def test_variance_below_a_nanometres_is_unusable(tiny: float) -> None:
    found = ledger(3)
    assert np.isnan(usable_variances_or_nan(found, np.array([0.0, tiny, 1e-12]))).tolist() == [True, True, False]
    plane = usable_plane_covariance_or_nan(
        found, np.array([1.0, tiny, 1e-12]), np.zeros(3), np.array([1.0, 1.0, 1e-12])
    )
    assert np.isnan(plane[:, 0]).tolist() == [False, True, False]
    assert found.quality.repaired == {UNUSABLE_COVARIANCE_REASON: 2}  # one of each kind
