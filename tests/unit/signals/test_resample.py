"""Resampling: what is between two samples, what is not, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.resample import Method, interpolate_signal_at_times

S = 1_000_000_000
STAMPS = np.array([10, 11, 12, 20, 21], dtype=np.int64) * S
VALUES = np.array([0.0, 10.0, 20.0, 100.0, 110.0])
NAN = float("nan")


@pytest.mark.parametrize(
    ("method", "at_s", "expected"),
    [
        pytest.param("linear", 10.5, 5.0, id="linear-between"),
        pytest.param("linear", 12.0, 20.0, id="linear-exact-at-the-edge-of-a-gap"),
        pytest.param("linear", 13.0, NAN, id="linear-in-the-gap"),
        pytest.param("linear", 9.9, NAN, id="linear-before"),
        pytest.param("linear", 21.0, 110.0, id="linear-last"),
        pytest.param("linear", 21.1, NAN, id="linear-after"),
        pytest.param("previous", 10.9, 0.0, id="previous"),
        pytest.param("previous", 14.0, 20.0, id="previous-as-old-as-allowed"),
        pytest.param("previous", 14.1, NAN, id="previous-too-old"),
        pytest.param("previous", 9.0, NAN, id="previous-none"),
        pytest.param("nearest", 10.6, 10.0, id="nearest-later"),
        pytest.param("nearest", 10.5, 0.0, id="nearest-tie-takes-the-earlier"),
        pytest.param("nearest", 16.0, NAN, id="nearest-too-far"),
        pytest.param("nearest", 8.5, 0.0, id="nearest-before-the-first"),
    ],
)
def test_resample_by_hand(method: Method, at_s: float, expected: float) -> None:
    at_ns = np.array([round(at_s * S)], dtype=np.int64)
    result = interpolate_signal_at_times(STAMPS, VALUES, at_ns, max_gap_s=2.0, method=method)
    np.testing.assert_allclose(result, [expected], atol=1e-12)


def test_resample_angle_goes_the_short_way_over_pi() -> None:
    stamps = np.array([0, 2], dtype=np.int64) * S
    angle = np.array([3.0, -3.0])
    middle = interpolate_signal_at_times(stamps, angle, np.array([S]), max_gap_s=5.0, is_angle=True)
    assert middle[0] == pytest.approx(np.pi, abs=1e-12)
    quarter = interpolate_signal_at_times(stamps, angle, np.array([S // 2]), max_gap_s=5.0, is_angle=True)
    assert quarter[0] == pytest.approx(3.0 + (2 * np.pi - 6.0) / 4, abs=1e-12)


def test_resample_nan_is_no_sample_and_bridges_nothing() -> None:
    values = np.array([0.0, NAN, 20.0, 100.0, 110.0])
    at_ns = np.array([11 * S])
    assert interpolate_signal_at_times(STAMPS, values, at_ns, max_gap_s=2.0)[0] == pytest.approx(10.0)
    assert np.isnan(interpolate_signal_at_times(STAMPS, values, at_ns, max_gap_s=1.5)[0])


def test_resample_columns_are_independent() -> None:
    table = np.stack([VALUES, np.where(np.arange(5) == 1, NAN, -VALUES)], axis=1)
    result = interpolate_signal_at_times(STAMPS, table, np.array([10 * S + S // 2, 20 * S + S // 4]), max_gap_s=1.0)
    np.testing.assert_allclose(result, [[5.0, NAN], [102.5, -102.5]])


def test_resample_keeps_nanoseconds_at_times_of_this_century() -> None:
    stamps = np.array([1_570_522_030_000_000_000, 1_570_522_030_000_000_100], dtype=np.int64)
    result = interpolate_signal_at_times(stamps, np.array([0.0, 100.0]), stamps[:1] + 37, max_gap_s=1.0)
    assert result[0] == pytest.approx(37.0, abs=1e-9)


def test_resample_agrees_with_numpy_where_there_is_no_gap() -> None:
    rng = np.random.default_rng(5)
    stamps = np.cumsum(rng.integers(1, 50, 300))
    values = rng.normal(size=300)
    at = rng.integers(stamps[0], stamps[-1], 1000)
    np.testing.assert_allclose(
        interpolate_signal_at_times(stamps, values, at, max_gap_s=1.0), np.interp(at, stamps, values), atol=1e-12
    )


def test_resample_empty_signal_is_nan_everywhere() -> None:
    assert np.isnan(interpolate_signal_at_times(STAMPS[:0], VALUES[:0], STAMPS, max_gap_s=1.0)).all()
    assert np.isnan(interpolate_signal_at_times(STAMPS, VALUES * NAN, STAMPS, max_gap_s=1.0)).all()


def test_resample_no_times_gives_no_values() -> None:
    assert interpolate_signal_at_times(STAMPS, VALUES, STAMPS[:0], max_gap_s=1.0).shape == (0,)


@pytest.mark.parametrize("is_angle", [False, True])
def test_columns_together_are_as_each_by_itself(is_angle: bool) -> None:
    rng = np.random.default_rng(6)
    stamp_ns = np.sort(rng.integers(0, 10**10, 50))
    at_ns = np.concatenate([rng.integers(-(10**9), 11 * 10**9, 200), stamp_ns[:5]])
    values = rng.uniform(-3.0, 3.0, (50, 3))
    together = interpolate_signal_at_times(stamp_ns, values, at_ns, max_gap_s=0.3, is_angle=is_angle)
    alone = [
        interpolate_signal_at_times(stamp_ns, column, at_ns, max_gap_s=0.3, is_angle=is_angle) for column in values.T
    ]
    assert np.isnan(together).any()
    np.testing.assert_array_equal(together, np.stack(alone, axis=1))
