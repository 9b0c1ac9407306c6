"""The scale of an accelerometer by gravity and by the motion, and that of the map of the fixes by the accelerometer."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.source_judgement import JudgedSources
from tests.unit.estimation.test_source_judgement import ALL, LEAN, _drive, _gyro, _judge, _with_fault


def _forward_accelerations(judged: JudgedSources) -> np.ndarray:
    return next(p.series.values[:, 0] for p in judged.prepared if p.series.kind is Kind.ACCEL)


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(
    ("scale", "told"), [(0.8, "0.80 times too much, gravity too"), (1.3, "1.30 times too much, gravity too")]
)
def test_an_accelerometer_of_another_scale_is_corrected_by_gravity(
    kinds: tuple[Kind, ...], scale: float, told: str
) -> None:
    right = _drive(*kinds)
    judged = _judge(_with_fault(right, Kind.IMU, lambda v: v * np.repeat([scale, 1.0], 3)))
    (correction,) = judged.corrections
    assert told in correction.fault
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


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(("columns", "name"), [((3, 4, 5), "a gyroscope"), ((0, 1), "an accelerometer")])
def test_a_part_of_an_imu_that_lags_behind_the_other_is_moved(
    kinds: tuple[Kind, ...], columns: tuple[int, ...], name: str
) -> None:
    """Both have one clock, so that no latency explains it; 16 rows at 20 Hz are 0.8 s."""

    def lagging(values: np.ndarray) -> np.ndarray:
        late = values.copy()
        late[16:, list(columns)] = values[:-16, list(columns)]
        return late

    judged = _judge(_with_fault(_drive(*kinds), Kind.IMU, lagging))
    (correction,) = judged.corrections
    assert re.match(rf"has {name} that lags behind its \w+ by 0\.[89] s", correction.fault)
    moved = next(p.series for p in judged.prepared if p.series.kind is Kind.YAW_RATE)
    assert judged.contradictions == ()
    assert np.abs(moved.values[moved.time_s % 20.0 > 13.0, 0]).max() < 0.05  # going straight again


def test_a_clipped_accelerometer_is_set_aside_where_it_is_at_the_end_of_its_range() -> None:
    (correction,) = _judge(_with_fault(_drive(*LEAN), Kind.IMU, lambda v: np.clip(v, -1.0, 20.0))).corrections
    assert "saturated" in correction.fault
    # It brakes by 2 m/s^2 in six times 4 s. To the right it turns three times alone, which is no end of a range yet.
    assert correction.n_set_aside == pytest.approx(6 * 4 * 20, abs=10)


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
def test_an_imu_that_is_seconds_late_is_moved_unless_the_user_says_how_late_it_is(kinds: tuple[Kind, ...]) -> None:
    """Of two clocks that differ by 2 s the fixes' is no later: a receiver reports what was, never what comes."""
    late = [replace(m, stamp_ns=m.stamp_ns + 2 * 10**9) if m.kind is Kind.IMU else m for m in _drive(*kinds)]
    judged = _judge(late)
    (correction,) = judged.corrections
    assert correction.fault.startswith("lags behind /position by about 2.0 s")
    moved = next(p.series for p in judged.prepared if p.series.kind is Kind.YAW_RATE)
    assert moved.time_s[0] == pytest.approx(0.0, abs=0.26)
    assert _judge(late, trusted_clocks=["/imu"]).corrections == ()
    early = [replace(m, stamp_ns=m.stamp_ns - 2 * 10**9) if m.kind is Kind.IMU else m for m in _drive(*kinds)]
    assert not any("lags behind /position" in each.fault for each in _judge(early).corrections)


def test_a_gyroscope_and_a_heading_that_both_count_clockwise_do_not_mirror_the_map() -> None:
    """Two against one: but the IMU's own lateral acceleration is with the fixes."""
    both = _with_fault(_with_fault(_drive(*ALL), Kind.IMU, _gyro(-1.0)), Kind.HEADING, lambda v: 0.5 * np.pi - v)
    judged = _judge(both)
    assert [(each.who.kind, each.name) for each in judged.corrections] == [
        (Kind.IMU, "gyro-reversed"),
        (Kind.HEADING, "clockwise-from-north"),
    ]
    assert judged.contradictions == ()


def test_a_mirrored_map_does_not_reverse_the_gyroscope() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.POSITION, lambda v: v * [-1.0, 1.0]))
    assert [each.who.kind for each in judged.corrections] == [Kind.POSITION]


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_coarse_imu_is_not_at_the_end_of_its_range(step: float) -> None:
    """Rounded to few values it often repeats its greatest one, but the one beside it more often."""

    def rounded(values: np.ndarray) -> np.ndarray:
        return np.column_stack([step * np.rint(values[:, :3] / step), values[:, 3:]])

    coarse = _with_fault(_drive(*LEAN), Kind.IMU, rounded)
    assert not any("saturated" in each.fault for each in _judge(coarse).corrections)
