"""The scale of an accelerometer by gravity and by the motion, and that of the map of the fixes by the accelerometer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.source_judgement import JudgedSources
from tests.unit.estimation.test_source_judgement import ALL, LEAN, _drive, _judge, _with_fault


def _forward_accelerations(judged: JudgedSources) -> np.ndarray:
    return next(p.series.values[:, 0] for p in judged.prepared if p.series.kind is Kind.ACCEL)


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize("scale", [0.8, 1.3])
def test_an_accelerometer_of_another_scale_is_corrected_by_gravity(kinds: tuple[Kind, ...], scale: float) -> None:
    right = _drive(*kinds)
    judged = _judge(_with_fault(right, Kind.IMU, lambda v: v * np.repeat([scale, 1.0], 3)))
    (correction,) = judged.corrections
    assert f"reads {scale:.2f} times too much, gravity too" in correction.fault
    assert judged.contradictions == ()
    accel, expected = (_forward_accelerations(each) for each in (judged, _judge(right)))
    assert np.abs(accel - expected).max() < 0.01 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("east", "north"), [(0.6, 0.6), (1.5, 1.5), (1.5, 1.0), (1.0, 0.6)], ids=["degrees", "far", "east", "north"]
)
def test_a_map_of_another_scale_is_named_where_gravity_shows_that_of_the_accelerometer(
    east: float, north: float
) -> None:
    """A map may be stretched in one direction alone, as where a longitude is not multiplied by its cosine."""
    judged = _judge(_with_fault(_drive(*LEAN), Kind.POSITION, lambda v: v * [east, north]))
    assert judged.corrections == ()
    found = judged.contradictions[0]
    assert str(found.who) == "ego_position (/position)"
    assert "the accelerations of /imu show, whose gravity is right" in found.what
    assert found.left_out == ()


def test_an_imu_without_gravity_shows_no_scale() -> None:
    def fault(m: Measurements) -> Measurements:
        return replace(m, values=0.7 * m.values if m.kind is Kind.POSITION else m.values - [0, 0, 9.80665, 0, 0, 0])

    assert not any(
        str(each.who).startswith("ego_position") for each in _judge(list(map(fault, _drive(*LEAN)))).contradictions
    )
