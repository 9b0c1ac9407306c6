"""Two sources beside each other: what is wrong shows, with its number; what is right, or too little, does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.measurements import Kind
from cwcli.estimation.source_checks import (
    Judgement,
    MedianInterval,
    SourceComparison,
    StepComparison,
    compare_all_source_pairs,
    joint_judgement_and_number_of_step_lengths,
)
from tests.unit.estimation.made_drive import Values, as_series, drive_series, made_drive

TIME_S, VALUES = made_drive()
RATIO_ATOL = 0.03
"""Of a ratio of ways: a chord of 4 s in a bend of 0.4 rad/s is 0.974 of its arc, and few steps are in one."""


def _compared(values: Values, *kinds: Kind) -> dict[tuple[SourceComparisonCheck, Kind, Kind], SourceComparison]:
    found = compare_all_source_pairs(drive_series(values, TIME_S, *kinds))
    return {(each.check, each.one.kind, each.other.kind): each for each in found}


def _pair(check: SourceComparisonCheck, values: Values, *kinds: Kind) -> SourceComparison | None:
    """What a check says of two sources, the one that comes later first."""
    return _compared(values, *kinds).get((check, kinds[1], kinds[0]))


def test_right_sources_agree_in_everything() -> None:
    kinds = (Kind.POSITION, Kind.VELOCITY, Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)
    found = _compared(VALUES, *kinds)
    assert {each.judgement for each in found.values()} == {Judgement.AGREE}
    assert {check for check, _, _ in found} == {
        SourceComparisonCheck.WAY,
        SourceComparisonCheck.TURN,
        SourceComparisonCheck.COURSE,
        SourceComparisonCheck.SPEED_CHANGE,
    }


@pytest.mark.parametrize("factor", [3.6, 1 / 3.6, 2.23694, 1.94384, 3.28084, 0.5, 1.3, 0.8, -1.0, 0.0])
def test_a_speed_in_another_unit_contradicts_the_fixes(factor: float) -> None:
    found = _pair(
        SourceComparisonCheck.WAY, {**VALUES, Kind.SPEED: factor * VALUES[Kind.SPEED]}, Kind.POSITION, Kind.SPEED
    )
    assert found is not None
    assert found.judgement is Judgement.CONTRADICT
    assert found.number == pytest.approx(factor, abs=RATIO_ATOL * max(1.0, abs(factor)))


@pytest.mark.parametrize("factor", [0.9, 0.97, 1.0, 1.05, 1.1])
def test_worn_tyres_and_speedometers_do_not(factor: float) -> None:
    found = _pair(
        SourceComparisonCheck.WAY, {**VALUES, Kind.SPEED: factor * VALUES[Kind.SPEED]}, Kind.POSITION, Kind.SPEED
    )
    assert found is not None
    assert found.judgement is Judgement.AGREE


@pytest.mark.parametrize("other", [Kind.POSITION, Kind.VELOCITY, Kind.HEADING])
@pytest.mark.parametrize("factor", [-1.0, 0.5, 2.0, 0.0])
def test_a_gyroscope_with_another_sign_or_scale_contradicts_each_course(other: Kind, factor: float) -> None:
    values = {**VALUES, Kind.YAW_RATE: factor * VALUES[Kind.YAW_RATE]}
    kinds = (Kind.POSITION, Kind.YAW_RATE) if other is Kind.POSITION else (Kind.POSITION, other, Kind.YAW_RATE)
    found = _compared(values, *kinds)[SourceComparisonCheck.TURN, Kind.YAW_RATE, other]
    assert found.judgement is Judgement.CONTRADICT
    assert found.number == pytest.approx(factor, abs=0.1)  # a turn of 4 s lies in two or three steps of a chord each


@pytest.mark.parametrize(("factor", "offset"), [(1.03, 0.0), (0.97, 0.02), (1.0, -0.05)])
def test_a_gyroscope_with_a_small_error_does_not(factor: float, offset: float) -> None:
    values = {**VALUES, Kind.YAW_RATE: factor * VALUES[Kind.YAW_RATE] + offset}
    found = _compared(values, Kind.POSITION, Kind.HEADING, Kind.YAW_RATE).values()
    assert Judgement.CONTRADICT not in {each.judgement for each in found}


def test_a_yaw_rate_with_a_large_bias_contradicts() -> None:
    values = {**VALUES, Kind.YAW_RATE: VALUES[Kind.YAW_RATE] + 0.15}
    found = _compared(values, Kind.POSITION, Kind.HEADING, Kind.YAW_RATE)
    told = [each for (check, _, _), each in found.items() if check is SourceComparisonCheck.YAW_RATE_BIAS]
    assert [each.number for each in told] == pytest.approx([0.15, 0.15], abs=0.01)


@pytest.mark.parametrize("offset_deg", [90.0, 180.0, -90.0, 45.0])
def test_a_heading_that_points_elsewhere_contradicts_the_course(offset_deg: float) -> None:
    values = {**VALUES, Kind.HEADING: VALUES[Kind.HEADING] + math.radians(offset_deg)}
    found = _pair(SourceComparisonCheck.COURSE, values, Kind.POSITION, Kind.HEADING)
    assert found is not None
    assert found.judgement is Judgement.CONTRADICT
    assert abs(math.degrees(found.number)) == pytest.approx(abs(offset_deg), abs=2.0)


def test_a_heading_off_by_a_compass_error_does_not() -> None:
    values = {**VALUES, Kind.HEADING: VALUES[Kind.HEADING] + math.radians(20.0)}
    found = _pair(SourceComparisonCheck.COURSE, values, Kind.POSITION, Kind.HEADING)
    assert found is not None
    assert found.judgement is Judgement.AGREE


def test_a_clockwise_heading_turns_the_other_way() -> None:
    values = {**VALUES, Kind.HEADING: 0.5 * np.pi - VALUES[Kind.HEADING]}
    found = _pair(SourceComparisonCheck.TURN, values, Kind.POSITION, Kind.HEADING)
    assert found is not None
    assert found.judgement is Judgement.CONTRADICT
    assert found.number == pytest.approx(-1.0, abs=0.1)


@pytest.mark.parametrize("factor", [-1.0, 0.0, 9.80665, 1 / 9.80665])
def test_a_forward_axis_that_does_not_point_forward_contradicts_the_speed(factor: float) -> None:
    values = {**VALUES, Kind.ACCEL: factor * VALUES[Kind.ACCEL]}
    found = _compared(values, Kind.POSITION, Kind.SPEED, Kind.ACCEL)[
        SourceComparisonCheck.SPEED_CHANGE, Kind.ACCEL, Kind.SPEED
    ]
    assert found.judgement is Judgement.CONTRADICT
    assert found.number == pytest.approx(factor, abs=0.05 * max(1.0, abs(factor)))


def test_a_car_that_accelerates_evenly_shows_nothing_of_its_accelerometer() -> None:
    """2 m/s^2 for 20 s: what the accelerometer shows may be its bias, so that neither is in doubt."""
    time_s = np.arange(0.0, 20.0, 0.05)
    speed = 2.0 * time_s
    values = {
        Kind.POSITION: np.column_stack([0.5 * speed * time_s, np.zeros_like(time_s)]),
        Kind.SPEED: speed,
        Kind.ACCEL: np.full_like(time_s, 2.0) + 0.05 * np.random.default_rng(0).standard_normal(len(time_s)),
    }
    found = compare_all_source_pairs(drive_series(values, time_s, *values))
    changes = [each for each in found if each.check is SourceComparisonCheck.SPEED_CHANGE]
    assert all(each.judgement is Judgement.UNKNOWN for each in changes)
    assert not any(each.judgement is Judgement.CONTRADICT for each in found)


def test_an_accelerometer_with_a_bias_contradicts_only_where_it_is_large() -> None:
    for bias, judgement in ((0.8, None), (2.5, Judgement.CONTRADICT)):
        values = {**VALUES, Kind.ACCEL: VALUES[Kind.ACCEL] + bias}
        found = _compared(values, Kind.POSITION, Kind.SPEED, Kind.ACCEL)
        told = found.get((SourceComparisonCheck.ACCEL_BIAS, Kind.ACCEL, Kind.SPEED))
        assert (told.judgement if told else None) is judgement


def test_a_car_that_drives_backwards_contradicts_nothing() -> None:
    time_s, values = made_drive(backwards=True)
    found = compare_all_source_pairs(
        drive_series(values, time_s, Kind.POSITION, Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)
    )
    assert {each.judgement for each in found} == {Judgement.AGREE}


def test_a_receiver_that_is_a_second_late_contradicts_nothing() -> None:
    late = as_series(Kind.POSITION, TIME_S + 1.0, VALUES[Kind.POSITION])
    kinds = (Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)
    found = compare_all_source_pairs([late, *drive_series(VALUES, TIME_S, *kinds)])
    assert Judgement.CONTRADICT not in {each.judgement for each in found}


def test_noise_and_drift_of_the_fixes_contradict_nothing() -> None:
    rng = np.random.default_rng(5)
    kinds = (Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)
    for sigma_m in (0.6, 3.0, 10.0):
        drift = 5.0 * np.column_stack([np.sin(TIME_S / 15.0), np.cos(TIME_S / 22.0)])
        noisy = VALUES[Kind.POSITION] + drift + rng.normal(0.0, sigma_m, (len(TIME_S), 2))
        found = compare_all_source_pairs(
            [as_series(Kind.POSITION, TIME_S, noisy), *drive_series(VALUES, TIME_S, *kinds)]
        )
        assert Judgement.CONTRADICT not in {each.judgement for each in found}


def test_fixes_with_gaps_are_compared_only_where_they_are() -> None:
    rows = (TIME_S % 30.0) < 22.0
    fixes = as_series(Kind.POSITION, TIME_S[rows], VALUES[Kind.POSITION][rows])
    speed = as_series(Kind.SPEED, TIME_S, VALUES[Kind.SPEED])
    found = compare_all_source_pairs([fixes, speed])
    assert [(each.check, each.judgement) for each in found] == [(SourceComparisonCheck.WAY, Judgement.AGREE)]


def test_a_log_of_a_few_seconds_tells_nothing() -> None:
    rows = TIME_S < 5.0
    series = [
        as_series(Kind.POSITION, TIME_S[rows], VALUES[Kind.POSITION][rows]),
        as_series(Kind.SPEED, TIME_S[rows], 3.6 * VALUES[Kind.SPEED][rows]),
    ]
    assert compare_all_source_pairs(series) == []


def test_the_interval_of_a_median_holds_student_s_width() -> None:
    # Deviations 2 1 0 1 2 about 3: their median is 1; 4.60 * 1.4826 * 1.2533 * 1 / sqrt(5) = 3.8226
    interval = MedianInterval.from_values(np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    assert (interval.value, interval.low, interval.high) == pytest.approx((3.0, -0.8226, 6.8226), abs=1e-3)
    assert math.isnan(MedianInterval.from_values(np.array([1.0, 2.0, 3.0])).value)


@pytest.mark.parametrize(
    ("measured", "expected"),
    [
        ([StepComparison(Judgement.CONTRADICT, 3.6, 4)], Judgement.UNKNOWN),  # four steps of one length
        ([StepComparison(Judgement.CONTRADICT, 3.6, 8)], Judgement.CONTRADICT),
        ([StepComparison(Judgement.CONTRADICT, 3.6, 4), StepComparison(Judgement.CONTRADICT, 3.5, 4)],
        Judgement.CONTRADICT),
        ([StepComparison(Judgement.CONTRADICT, 0.5, 4), StepComparison(Judgement.UNKNOWN, 0.53, 5)],
        Judgement.CONTRADICT),
        ([StepComparison(Judgement.UNKNOWN, 0.5, 9), StepComparison(Judgement.UNKNOWN, 0.53, 5)], Judgement.UNKNOWN),
        ([StepComparison(Judgement.CONTRADICT, 0.2, 30), StepComparison(Judgement.UNKNOWN, 0.9, 9, 1.0, True)],
        Judgement.UNKNOWN),
        ([StepComparison(Judgement.CONTRADICT, 0.2, 30), StepComparison(Judgement.UNKNOWN, 0.5, 9)],
        Judgement.CONTRADICT),
        ([StepComparison(Judgement.AGREE, 1.0, 9, 0.1, True), StepComparison()], Judgement.AGREE),
        ([StepComparison(), StepComparison()], Judgement.UNKNOWN),
    ],
)  # fmt: skip
def test_steps_of_all_lengths_judge_together(measured: list[StepComparison], expected: Judgement) -> None:
    assert joint_judgement_and_number_of_step_lengths(measured)[0] is expected
