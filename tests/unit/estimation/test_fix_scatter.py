"""What neighbouring fixes do not scatter lasts, and is part of sigma."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cwcli.estimation.fix_scatter import covariance_from_lasting_errors
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import ParameterStatus, SlowError
from cwcli.estimation.result import SourceReport

FIX = SourceReport("/fix", Kind.POSITION, n_used=500, sigma=1.3, scatter=0.5, noise_origin="log")


@pytest.mark.parametrize(
    ("reports", "variance_m2"),
    [
        ([FIX], 1.44),
        ([replace(FIX, scatter=0.9)], 0.88),  # 1.44 times the scatter, where 1.18 times is clear for 500 rows
        ([replace(FIX, noise_origin="message, scaled")], 1.44),
        ([replace(FIX, noise_origin="message")], 0.0),
        ([replace(FIX, scatter=0.9, n_used=50)], 0.0),  # 1.44 times of 50 rows may be chance
        ([replace(FIX, scatter=1.2)], 0.0),
        ([replace(FIX, scatter=float("nan"))], 0.0),
        ([replace(FIX, sigma=0.05, scatter=0.001)], 0.0),  # the least noise that the estimator takes
        ([replace(FIX, slow_error=SlowError(1.0, 30.0, ParameterStatus.USED))], 0.0),
        ([FIX, replace(FIX, source="/other", scatter=1.2)], 0.0),
        ([FIX, replace(FIX, source="/unused", scatter=1.2, n_used=0)], 1.44),
        ([], 0.0),
    ],
)
def test_the_lasting_part_of_the_best_fixes_is_added(reports: list[SourceReport], variance_m2: float) -> None:
    added = covariance_from_lasting_errors(reports)
    assert added[0, 0] == added[1, 1] == pytest.approx(variance_m2)
    added[0, 0] = added[1, 1] = 0.0
    assert not added.any()
