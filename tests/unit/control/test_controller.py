"""The controller as a table of what a careful driver would do, and as laws over its whole input range."""

import numpy as np
import pytest

from cwcli.control.controller import (
    MAX_BRAKE_PRESSURE_MPA,
    fuzzy_throttle_and_pressure,
    speed_difference_along_heading_mps,
)


def at(ttc_s: float, dv_mps: float) -> tuple[float, float]:
    throttle, pressure = fuzzy_throttle_and_pressure(np.array([ttc_s]), np.array([dv_mps]))
    return float(throttle[0]), float(pressure[0])


@pytest.mark.parametrize(
    ("ttc_s", "dv_mps", "low_mpa", "high_mpa"),
    [
        pytest.param(0.5, 15.0, 9.5, 10.0, id="about to hit, closing fast: full"),
        pytest.param(1.0, 15.0, 9.5, 10.0, id="the paper's most dangerous TTC"),
        pytest.param(2.9, 3.0, 7.0, 8.0, id="the paper's following TTC, closing slowly: strong"),
        pytest.param(np.inf, -5.0, 0.0, 0.3, id="the gap opens: none"),
    ],
)
def test_pressure_in_plain_situations(ttc_s: float, dv_mps: float, low_mpa: float, high_mpa: float) -> None:
    assert low_mpa <= at(ttc_s, dv_mps)[1] <= high_mpa


def test_throttle_opens_only_when_the_gap_opens() -> None:
    assert at(np.inf, -5.0)[0] == pytest.approx(0.5, abs=0.02)  # "half" is a symmetric triangle about 0.5
    assert at(1.0, 10.0)[0] == 0.0


def test_pressure_never_falls_when_ttc_falls_or_closing_speed_rises() -> None:
    ttc_s, dv_mps = np.meshgrid(np.linspace(0.0, 6.0, 61), np.linspace(0.0, 20.0, 41), indexing="ij")
    pressure = fuzzy_throttle_and_pressure(ttc_s.ravel(), dv_mps.ravel())[1].reshape(ttc_s.shape)
    # Clipping and the centroid make small dips where two sets cross; more than a tenth would be a wrong rule.
    assert np.diff(pressure, axis=0).max() < 0.1 * MAX_BRAKE_PRESSURE_MPA
    assert np.diff(pressure, axis=1).min() > -0.1 * MAX_BRAKE_PRESSURE_MPA
    assert pressure.min() >= 0.0
    assert pressure.max() <= MAX_BRAKE_PRESSURE_MPA


def test_brake_and_throttle_are_never_used_together() -> None:
    ttc_s, dv_mps = np.meshgrid(np.linspace(0.0, 6.0, 61), np.linspace(-5.0, 20.0, 51))
    throttle, pressure = fuzzy_throttle_and_pressure(ttc_s.ravel(), dv_mps.ravel())
    assert not np.any((throttle > 0.0) & (pressure > 0.5))


def test_speed_difference_is_equation_11() -> None:
    # cos(60 deg) = 0.5: 9 - 10 * 0.5 = 4.
    dv = speed_difference_along_heading_mps(np.array([9.0]), np.array([10.0]), np.array([np.pi / 3.0]))
    np.testing.assert_allclose(dv, [4.0])


@pytest.mark.parametrize(
    ("ttc_s", "dv_mps", "pressure_mpa"),
    [
        (0.5, 10.0, 9.7333),
        (1.5, 2.0, 8.0794),
        (2.5, 5.0, 7.9074),
        (2.5, -1.0, 5.6506),
        (3.5, 1.0, 5.7773),
        (3.7, 6.0, 6.5644),
        (5.5, -4.0, 0.1333),
        (6.0, 0.0, 5.0),
    ],
)
def test_pressure_is_that_of_scikit_fuzzy(ttc_s: float, dv_mps: float, pressure_mpa: float) -> None:
    """Made with scikit-fuzzy 0.5.0 on the same sets and rules; it integrates between the points, we sum over them."""
    assert at(ttc_s, dv_mps)[1] == pytest.approx(pressure_mpa, abs=0.03)
