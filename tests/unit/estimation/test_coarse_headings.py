"""Headings in sectors: only the changes from one sector to the next are used."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note, find_coarse_headings
from cwcli.signals.columns import FloatArray

TIME_S = 0.1 * np.arange(1001.0)
TURN = np.radians(3.6) * TIME_S  # once round in 100 s
SECTOR_DEG = 22.5


def rounded(heading_rad: FloatArray, step_deg: float) -> FloatArray:
    step_rad = np.radians(step_deg)
    return np.asarray((step_rad * np.rint(heading_rad / step_rad) + np.pi) % (2.0 * np.pi) - np.pi)


def test_each_change_lies_halfway_between_two_sectors() -> None:
    found = find_coarse_headings(TIME_S, rounded(TURN, SECTOR_DEG))
    assert found is not None
    assert np.degrees(found.step_rad) == pytest.approx(SECTOR_DEG)
    # 11.25 degrees at 3.6 degrees/s are reached after 3.125 s, between 3.1 and 3.2 s; then each 6.25 s
    np.testing.assert_allclose(found.time_s, 3.125 + 6.25 * np.arange(16), atol=0.051)
    np.testing.assert_allclose(np.degrees(found.heading_rad) % 360.0, 11.25 + 22.5 * np.arange(16))
    assert found.rows[0] == 32


@pytest.mark.parametrize(
    "heading_rad",
    [rounded(TURN, 2.0), TURN + 0.01 * np.random.default_rng(0).standard_normal(1001), rounded(0.1 * TURN, SECTOR_DEG)],
    ids=["steps of 2 degrees", "noise", "too few changes"],
)
def test_other_headings_are_left_as_they_are(heading_rad: FloatArray) -> None:
    assert find_coarse_headings(TIME_S, heading_rad) is None


def test_a_jump_of_two_sectors_and_one_across_a_gap_are_no_change() -> None:
    coarse = rounded(TURN, SECTOR_DEG)
    used = (TIME_S < 50.0) | (TIME_S > 55.0)  # the change at 53.1 s is lost
    coarse[250:300] = coarse[500]
    found = find_coarse_headings(TIME_S[used], coarse[used])
    assert found is not None
    assert len(found.time_s) < 15
    assert not ((found.time_s > 50.0) & (found.time_s < 55.0)).any()
    assert not ((found.time_s > 24.0) & (found.time_s < 31.0)).any()


def test_the_series_holds_the_changes_and_the_user_is_told() -> None:
    stamp_ns = np.rint(1e9 * TIME_S).astype(np.int64)
    m = Measurements(
        "/compass", Kind.HEADING, stamp_ns, rounded(TURN, SECTOR_DEG)[:, None], np.full((1001, 1, 1), 0.01)
    )
    prepared, notes = clean_and_sort_measurements_and_note([m], 0)
    assert len(prepared[0].series) == 16
    assert prepared[0].n_read == 1001
    np.testing.assert_allclose(prepared[0].series.noise[:, 0], 0.01)
    what = "its headings are rounded to steps of 22.5 degrees"
    assert notes == [f"/compass: {what}: only the 16 changes from one step to the next are used"]
