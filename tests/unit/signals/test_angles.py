"""Angles: the half-open interval, its edges, and compass courses by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.signals.angles import compass_deg_from_heading, heading_from_compass_deg, wrap_angle

ATOL_RAD = 1e-12
ATOL_DEG = 1e-10


@pytest.mark.parametrize(
    ("angle_rad", "expected_rad"),
    [
        pytest.param(0.0, 0.0, id="zero"),
        pytest.param(math.pi, math.pi, id="pi-is-inside"),
        pytest.param(-math.pi, math.pi, id="minus-pi-becomes-pi"),
        pytest.param(1.5 * math.pi, -0.5 * math.pi, id="three-quarters"),
        pytest.param(-1.5 * math.pi, 0.5 * math.pi, id="minus-three-quarters"),
        pytest.param(2.0 * math.pi, 0.0, id="full-turn"),
        pytest.param(7.0 * math.pi, math.pi, id="seven-half-turns"),
        pytest.param(100.0 * math.pi + 0.25, 0.25, id="fifty-turns-and-a-quarter"),
    ],
)
def test_wrap_angle_by_hand(angle_rad: float, expected_rad: float) -> None:
    assert wrap_angle(angle_rad) == pytest.approx(expected_rad, abs=ATOL_RAD)


def test_wrap_angle_stays_in_half_open_interval() -> None:
    angle = np.concatenate(
        [
            np.random.default_rng(7).uniform(-1e3, 1e3, 10_000),
            np.nextafter(np.pi, 10.0) * np.array([1.0, -1.0, 3.0, -3.0]),
            np.nextafter(0.0, [1.0, -1.0]),
        ]
    )
    wrapped = wrap_angle(angle)
    assert np.all(wrapped > -np.pi)
    assert np.all(wrapped <= np.pi)
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-11)


def test_wrap_angle_keeps_the_bits_of_angles_inside() -> None:
    angle = np.random.default_rng(8).uniform(-3.14, 3.14, 1000)
    assert np.array_equal(wrap_angle(angle), angle)


def test_wrap_angle_nan_and_infinity_become_nan() -> None:
    assert np.isnan(wrap_angle(np.array([np.nan, np.inf, -np.inf]))).all()


@pytest.mark.parametrize(
    ("compass_deg", "heading_rad"),
    [
        pytest.param(0.0, math.pi / 2, id="north"),
        pytest.param(90.0, 0.0, id="east"),
        pytest.param(180.0, -math.pi / 2, id="south"),
        pytest.param(270.0, math.pi, id="west"),
        pytest.param(45.0, math.pi / 4, id="north-east"),
        pytest.param(359.9, math.pi / 2 + math.radians(0.1), id="just-left-of-north"),
    ],
)
def test_compass_and_heading_by_hand(compass_deg: float, heading_rad: float) -> None:
    assert heading_from_compass_deg(compass_deg) == pytest.approx(heading_rad, abs=ATOL_RAD)
    assert compass_deg_from_heading(heading_rad) == pytest.approx(compass_deg, abs=ATOL_DEG)


def test_compass_of_a_hair_left_of_north_is_below_360() -> None:
    assert 0.0 <= compass_deg_from_heading(math.pi / 2 + 1e-16) < 360.0
    assert np.all(compass_deg_from_heading(np.nextafter(np.pi / 2, [0.0, 4.0])) < 360.0)
