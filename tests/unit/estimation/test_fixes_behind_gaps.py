"""A fix that ends a gap many sigmas from where the others led is told; one within its sigma, or near, is not."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.fixes_behind_gaps import add_jumps_hidden_by_gaps, find_contradictions_of_fixes_behind_gaps
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.kernels.ekf import UpdateStatus

TIME_S = np.concatenate([np.arange(10.0), np.arange(46.0, 60.0)])
REPORTS = [SourceReport("/fix", Kind.POSITION, n_used=24), SourceReport("/wheel", Kind.SPEED, n_used=500)]


def fixes(source: str = "/fix") -> SensorSeries:
    return SensorSeries(source, Kind.POSITION, TIME_S, np.zeros((24, 2)), np.tile([0.36, 0.0, 0.36], (24, 1)))


def found(nis: float, distance_m: float, *more: SensorSeries, row: int = 10) -> list[Contradiction]:
    """What is told where one fix, the first behind a gap of 37 s, has this NIS and lies so far away."""
    rows = np.zeros((24, 5))
    rows[row, :2] = nis, 0.5 * distance_m**2  # the kernel gives the mean square over both axes
    series = [fixes(), *more]
    status = [np.full(24, UpdateStatus.USED, np.int8)] * len(series)
    return find_contradictions_of_fixes_behind_gaps(series, [rows] * len(series), status, REPORTS)


def test_far_fix_behind_a_gap_contradicts_the_speed() -> None:
    (told,) = found(49.0, 7.2)
    assert told.contradiction_sentence == (
        "ego_position (/fix) contradicts ego_speed (/wheel): after 37 s without fixes they are 7.2 m from where the "
        "other sources led, 7 sigmas (at 46.0 s)"
    )


@pytest.mark.parametrize(("nis", "distance_m", "row"), [(20.0, 70.0, 10), (49.0, 2.0, 10), (49.0, 7.2, 11)])
def test_what_dead_reckoning_may_err_is_not_told(nis: float, distance_m: float, row: int) -> None:
    assert found(nis, distance_m, row=row) == []


def test_another_source_of_fixes_judges_instead() -> None:
    assert found(49.0, 7.2, fixes("/other")) == []


def test_smallest_jump_that_would_show_is_five_sigmas_and_no_less_than_a_receiver_errs() -> None:
    rows = np.zeros((24, 5))
    rows[10, :2] = 4.0, 0.5 * 6.0**2  # 6 m are two sigmas, so that one is 3 m
    status = [np.full(24, UpdateStatus.USED, np.int8)]
    report, other = add_jumps_hidden_by_gaps([fixes()], [rows], status, REPORTS)
    assert report.gap_s_and_hidden_jump_m == pytest.approx((37.0, 15.0))
    assert other is REPORTS[1]
    rows[10, :2] = 4.0, 0.5 * 0.2**2
    assert add_jumps_hidden_by_gaps([fixes()], [rows], status, REPORTS)[0].gap_s_and_hidden_jump_m[1] == 3.3
