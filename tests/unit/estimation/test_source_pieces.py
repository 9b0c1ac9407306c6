"""A source whose unit, sign, axes or convention changes in mid-log is corrected where it is wrong, and told."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.source_judgement import JudgedSources
from tests.unit.estimation.test_source_judgement import ALL, LEAN, STAMP_NS, TIME_S, _drive, _gyro, _judge

Change = Callable[[np.ndarray], np.ndarray]


def _with_fault_between(
    measurements: list[Measurements], kind: Kind, change: Change, begin_s: float, end_s: float
) -> list[Measurements]:
    wrong = ((begin_s <= TIME_S) & (end_s > TIME_S))[:, None]
    return [
        replace(m, values=np.where(wrong, change(m.values), m.values)) if m.kind is kind else m for m in measurements
    ]


def _told(judged: JudgedSources) -> list[str]:
    return [c.sentence_on_fault_and_undoing.rpartition(" (")[0] for c in judged.corrections]


def _largest_differences(judged: JudgedSources, right: JudgedSources) -> dict[Kind, float]:
    """Return the largest difference of the used rows of each kind, of which both have the same."""
    found = {}
    for one, other in zip(judged.prepared, right.prepared, strict=True):
        apart = one.series.values - other.series.values
        turns = (apart + np.pi) % (2.0 * np.pi) - np.pi
        found[one.series.kind] = float(np.abs(turns if one.series.kind is Kind.HEADING else apart).max())
    return found


KMH, FROM_NORTH = "ego_speed (/speed) is in km/h, not m/s", "ego_heading (/heading) counts from north, not from east"
DEGREES = "imu (/imu) measures turn rates in degrees/s, not rad/s"
UPSIDE_DOWN = "imu (/imu) is mounted with x forward, -y left and -z up, not x, y and z"
X_DOWN = "imu (/imu) is mounted with z forward, y left and -x up, not x, y and z"


@pytest.mark.parametrize(
    ("kind", "change", "begin_s", "end_s", "sentence"),
    [
        (Kind.SPEED, lambda v: 3.6 * v, 45.0, np.inf, f"{KMH}, from 45.0 s: converted there"),
        (Kind.SPEED, lambda v: 3.6 * v, 0.0, 70.0, f"{KMH}, until 70.0 s: converted there"),
        (Kind.SPEED, lambda v: 3.6 * v, 30.0, 90.0, f"{KMH}, from 30.0 s until 90.0 s: converted there"),
        (Kind.SPEED, lambda v: 3.6 * v, 50.0, 70.0, f"{KMH}, from 50.0 s until 70.0 s: converted there"),
        (Kind.HEADING, lambda v: v - 0.5 * np.pi, 60.0, np.inf, f"{FROM_NORTH}, from 60.0 s: turned there"),
        (Kind.IMU, _gyro(180.0 / np.pi), 60.0, np.inf, f"{DEGREES}, from 60.0 s: converted there"),
        (Kind.IMU, lambda v: v * [1.0, -1.0, -1.0, 1.0, -1.0, -1.0], 60.0, np.inf,
         f"{UPSIDE_DOWN}, from 60.0 s: turned there"),
        # It reads upward as -x and forward as z.
        (Kind.IMU, lambda v: v[:, [2, 1, 0, 5, 4, 3]] * [-1.0, 1.0, 1.0, -1.0, 1.0, 1.0], 60.0, np.inf,
         f"{X_DOWN}, from 60.0 s: turned there"),
    ],
    ids=["km/h from", "km/h until", "km/h between", "km/h in 20 s", "from north", "deg/s", "upside down", "x down"],
)  # fmt: skip
def test_what_changes_in_mid_log_is_corrected_there(
    kind: Kind, change: Change, begin_s: float, end_s: float, sentence: str
) -> None:
    """The clear jump of the values tells the time to a row, so that all rows are right again."""
    right = _drive(*ALL)
    judged = _judge(_with_fault_between(right, kind, change, begin_s, end_s))
    assert _told(judged) == [sentence]
    assert judged.contradictions == ()
    apart = _largest_differences(judged, _judge(right))
    assert max(apart.values()) < 1e-6, apart


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
def test_a_sign_that_changes_on_a_straight_is_found_between_two_bends(kinds: tuple[Kind, ...]) -> None:
    """On a straight a sign shows nothing: the time is only known to lie between two bends."""
    wrong = _with_fault_between(_drive(*kinds), Kind.IMU, _gyro(-1.0), 55.0, np.inf)
    judged = _judge(wrong)
    (told,) = _told(judged)
    time_s = re.fullmatch(
        r"imu \(/imu\) has a gyroscope with the wrong sign, from (?:about )?([\d.]+) s: reversed there", told
    )
    assert time_s and 52 <= float(time_s[1]) <= 68
    yaw_rate = next(p.series for p in judged.prepared if p.series.kind is Kind.YAW_RATE)
    turning = np.abs(yaw_rate.time_s % 20.0 - 10.0) < 1.0
    expected = np.where((yaw_rate.time_s // 20.0).astype(int) % 2, -0.4, 0.4)
    assert np.abs(yaw_rate.values[turning, 0] - expected[turning]).max() < 0.05


def test_a_fault_of_the_whole_log_is_no_change_although_it_does_not_show_everywhere() -> None:
    """A heading that counts clockwise from east is right wherever the car drives to the east."""
    mirrored = _with_fault_between(_drive(*ALL), Kind.HEADING, lambda v: -v, 0.0, np.inf)
    (told,) = _told(_judge(mirrored))
    assert told == "ego_heading (/heading) counts clockwise from east, not counter-clockwise: turned"


def test_what_no_hypothesis_explains_is_set_aside_where_two_others_outvote_it() -> None:
    """A heading that drifts away at 10 degrees a second is in no list."""
    turning = _with_fault_between(
        _drive(*ALL), Kind.HEADING, lambda v: v + np.radians(25.0) * (TIME_S[:, None] - 60.0), 60.0, np.inf
    )
    judged = _judge(turning)
    (correction,) = judged.corrections
    assert correction.who.kind is Kind.HEADING
    assert correction.n_rows == 0
    assert correction.n_set_aside > 0.4 * len(STAMP_NS)


def test_a_trusted_source_is_left_as_it_is() -> None:
    wrong = _with_fault_between(_drive(*ALL), Kind.SPEED, lambda v: 3.6 * v, 45.0, np.inf)
    assert not any(c.who.kind is Kind.SPEED for c in _judge(wrong, trusted=["/speed"]).corrections)


def test_a_velocity_whose_unit_changes_is_corrected_by_the_fixes_alone() -> None:
    wrong = _with_fault_between(_drive(Kind.POSITION, Kind.VELOCITY), Kind.VELOCITY, lambda v: 3.6 * v, 60.0, np.inf)
    (told,) = _told(_judge(wrong))
    assert told == "ego_velocity (/velocity) is in km/h, not m/s, from 60.0 s: converted there"


def _drive_that_begins_backward(is_speed_signed: bool) -> list[Measurements]:
    """The usual drive, whose first 30 s are driven in reverse: speed and heading are those of such a car."""
    is_reverse = (TIME_S < 30.0)[:, None]
    found = []
    for m in _drive(*ALL):
        values = m.values
        if m.kind is Kind.SPEED and is_speed_signed:
            values = np.where(is_reverse, -values, values)
        elif m.kind is Kind.HEADING:
            values = np.where(is_reverse, values + np.pi, values)
        found.append(replace(m, values=values))
    return found


@pytest.mark.parametrize("is_speed_signed", [True, False])
@pytest.mark.parametrize(
    "kinds", [(Kind.POSITION, Kind.SPEED), (Kind.POSITION, Kind.HEADING), (Kind.POSITION, Kind.SPEED, Kind.HEADING)]
)
def test_a_drive_in_reverse_turns_no_sensor_wrong(kinds: tuple[Kind, ...], is_speed_signed: bool) -> None:
    judged = _judge([m for m in _drive_that_begins_backward(is_speed_signed) if m.kind in kinds])
    assert judged.corrections == ()


def test_each_quantity_of_a_topic_is_judged_by_itself() -> None:
    """One topic gives speed and heading, and both change their unit or convention at once."""
    wrong = _with_fault_between(_drive(*ALL), Kind.SPEED, lambda v: 3.6 * v, 60.0, np.inf)
    wrong = _with_fault_between(wrong, Kind.HEADING, lambda v: v - 0.5 * np.pi, 60.0, np.inf)
    judged = _judge([replace(m, source="/car") if m.kind in (Kind.SPEED, Kind.HEADING) else m for m in wrong])
    assert sorted(_told(judged)) == [
        "ego_heading (/car) counts from north, not from east, from 60.0 s: turned there",
        "ego_speed (/car) is in km/h, not m/s, from 60.0 s: converted there",
    ]
