"""Rows of published states: in the order of their stamps, and how large the vehicles are."""

from __future__ import annotations

import math

import numpy as np

from cwcli.signals.row_order import rows_by_stamp_without_repeats
from cwcli.warning.types import DEFAULT_VEHICLE_LENGTH_M, DEFAULT_VEHICLE_WIDTH_M, median_length_and_width_m


def test_rows_by_stamp_keep_the_first_of_each_stamp() -> None:
    stamp_ns = np.array([30, 10, 20, 10, 30])
    np.testing.assert_array_equal(rows_by_stamp_without_repeats(stamp_ns), [1, 2, 0])
    np.testing.assert_array_equal(rows_by_stamp_without_repeats(stamp_ns, np.array([4, 3, 0])), [3, 4])
    assert len(rows_by_stamp_without_repeats(stamp_ns[:0])) == 0
    assert len(rows_by_stamp_without_repeats(stamp_ns, np.zeros(0, np.intp))) == 0


def test_outline_is_the_median_of_what_was_said_or_the_default() -> None:
    lengths_m = np.array([4.0, math.nan, 5.0, 12.0])
    assert median_length_and_width_m(lengths_m, np.full(4, math.nan)) == (5.0, DEFAULT_VEHICLE_WIDTH_M)
    assert median_length_and_width_m(np.zeros(3), np.array([-1.0, math.inf])) == (
        DEFAULT_VEHICLE_LENGTH_M,
        DEFAULT_VEHICLE_WIDTH_M,
    )
