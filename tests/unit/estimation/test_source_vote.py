"""Who is wrong where sources contradict each other, and what becomes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.check_texts import SourceComparisonCheck
from cwcli.estimation.contradiction import GRAVITY_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.measurements import Kind
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.source_checks import Judgement, SourceComparison
from cwcli.estimation.source_vote import (
    find_contradicting_sources,
    find_unchecked_quantities,
    leave_out_outvoted_sources,
)
from tests.unit.estimation.made_drive import Values, drive_series, made_drive

FIX, SPEED, HEADING = (
    SourceQuantity("/fix", Kind.POSITION),
    SourceQuantity("/speed", Kind.SPEED),
    SourceQuantity("/heading", Kind.HEADING),
)
ACCEL, YAW_RATE = SourceQuantity("/imu", Kind.ACCEL), SourceQuantity("/imu", Kind.YAW_RATE)
TIME_S, VALUES = made_drive()


def _against(
    check: SourceComparisonCheck, one: SourceQuantity, other: SourceQuantity, number: float
) -> SourceComparison:
    return SourceComparison(check, one, other, Judgement.CONTRADICT, number)


def _with(check: SourceComparisonCheck, one: SourceQuantity, other: SourceQuantity) -> SourceComparison:
    return SourceComparison(check, one, other, Judgement.AGREE, 1.0)


def test_a_source_that_two_others_contradict_is_outvoted_and_left_out() -> None:
    found = find_contradicting_sources(
        [
            _against(SourceComparisonCheck.WAY, SPEED, FIX, 3.6),
            _against(SourceComparisonCheck.SPEED_CHANGE, ACCEL, SPEED, 1.0 / 3.6),
            _with(SourceComparisonCheck.SPEED_CHANGE, ACCEL, FIX),
        ]
    )
    assert [(each.who, each.against, each.allies, each.left_out) for each in found] == [
        (SPEED, FIX, (ACCEL,), (SPEED,))
    ]
    assert found[0].contradiction_sentence == (
        "ego_speed (/speed) contradicts ego_position (/fix): the car covered 3.60 times the distance between the "
        "fixes, as if km/h were taken for m/s"
    )
    assert found[0].votes_and_left_out_sources_text == (
        "imu accel (/imu) agrees with ego_position (/fix); ego_speed (/speed) is left out of the estimate"
    )


def test_of_two_that_contradict_each_other_the_positions_stay() -> None:
    found = find_contradicting_sources([_against(SourceComparisonCheck.TURN, YAW_RATE, FIX, -1.0)])
    assert [(each.who, each.allies, each.left_out) for each in found] == [(YAW_RATE, (), (YAW_RATE,))]
    assert found[0].votes_and_left_out_sources_text == (
        "no third source tells which of them is wrong; imu yaw rate (/imu) is left out of the estimate"
    )


def test_positions_that_two_others_contradict_are_named_and_stay() -> None:
    found = find_contradicting_sources(
        [
            _against(SourceComparisonCheck.WAY, SPEED, FIX, 0.5),
            _against(SourceComparisonCheck.SPEED_CHANGE, ACCEL, FIX, 0.5),
            _with(SourceComparisonCheck.SPEED_CHANGE, ACCEL, SPEED),
        ]
    )
    assert [(each.who, each.against, each.left_out) for each in found] == [(FIX, SPEED, ())]
    assert "the fixes lie 2.00 times as far apart as the car went" in found[0].contradiction_sentence


def test_two_sources_without_a_judge_are_told_and_neither_is_used() -> None:
    found = find_contradicting_sources([_against(SourceComparisonCheck.TURN, YAW_RATE, HEADING, 0.5)])
    assert [set(each.left_out) for each in found] == [{YAW_RATE, HEADING}]
    assert (
        found[0].votes_and_left_out_sources_text
        == "no third source tells which of them is wrong; both are left out of the estimate"
    )


def test_the_heading_is_outvoted_by_the_fixes_and_the_gyroscope() -> None:
    found = find_contradicting_sources(
        [
            _against(SourceComparisonCheck.TURN, HEADING, FIX, -1.0),
            _against(SourceComparisonCheck.TURN, YAW_RATE, HEADING, -1.0),
            _with(SourceComparisonCheck.TURN, YAW_RATE, FIX),
        ]
    )
    assert [(each.who, each.allies) for each in found] == [(HEADING, (YAW_RATE,))]


def test_two_sources_that_are_both_wrong_are_both_named() -> None:
    found = find_contradicting_sources(
        [
            _against(SourceComparisonCheck.WAY, SPEED, FIX, 3.6),
            _against(SourceComparisonCheck.TURN, YAW_RATE, FIX, -1.0),
        ]
    )
    assert {each.who for each in found} == {SPEED, YAW_RATE}


def test_sources_that_agree_are_not_named() -> None:
    assert (
        find_contradicting_sources(
            [_with(SourceComparisonCheck.WAY, SPEED, FIX), _with(SourceComparisonCheck.TURN, YAW_RATE, HEADING)]
        )
        == []
    )


def _prepared(
    values: Values, *kinds: Kind, force: tuple[float, float, float] = (0.0, 0.0, 9.81)
) -> list[PreparedSeries]:
    made = []
    for s in drive_series(values, TIME_S, *kinds):
        is_imu = s.kind in (Kind.ACCEL, Kind.YAW_RATE)
        mounting = ImuMounting(0.0, 0.0) if is_imu and force[2] > 5.0 else None
        mean = np.array(force) if is_imu else None
        made.append(
            PreparedSeries(
                replace(s, source="/imu") if is_imu else s, is_imu, len(s), 0, mounting=mounting, mean_force_mps2=mean
            )
        )
    return made


def _rows(prepared: list[PreparedSeries]) -> dict[Kind, int]:
    return {p.series.kind: len(p.series) for p in prepared}


ALL = (Kind.POSITION, Kind.SPEED, Kind.HEADING, Kind.ACCEL, Kind.YAW_RATE)


def test_right_sources_all_take_part() -> None:
    prepared = _prepared(VALUES, *ALL)
    voted = leave_out_outvoted_sources(prepared)
    assert voted.contradictions == ()
    assert voted.prepared == prepared


def test_what_no_other_topic_confirms_is_unchecked() -> None:
    prepared = _prepared(VALUES, *ALL)
    assert find_unchecked_quantities(prepared, leave_out_outvoted_sources(prepared).comparisons) == frozenset()
    fix = SourceQuantity("/position", Kind.POSITION)
    way = [_with(SourceComparisonCheck.WAY, SPEED, fix), _with(SourceComparisonCheck.TURN, YAW_RATE, ACCEL)]
    assert {str(each) for each in find_unchecked_quantities(prepared, way)} == {
        "ego_heading (/heading)", "imu accel (/imu)", "imu yaw rate (/imu)",
    }  # fmt: skip
    assert find_unchecked_quantities(prepared[:1], ()) == frozenset()


def test_what_is_outvoted_has_no_rows_left() -> None:
    voted = leave_out_outvoted_sources(_prepared({**VALUES, Kind.SPEED: 3.6 * VALUES[Kind.SPEED]}, *ALL))
    assert [each.who for each in voted.contradictions] == [SourceQuantity("/speed", Kind.SPEED)]
    n = len(TIME_S)
    assert _rows(voted.prepared) == {**dict.fromkeys(ALL, n), Kind.SPEED: 0}


@pytest.mark.parametrize(
    ("force", "what"),
    [
        ((9.81, 0.1, 0.0), "on average it reads 9.8 m/s^2 along its forward axis and 0.0 along its vertical one"),
        ((0.0, -9.81, 0.5), "on average it reads -9.8 m/s^2 along its left axis and 0.5 along its vertical one"),
        ((0.0, 5.0, -8.4), "on average it reads -8.4 m/s^2 along its vertical axis, downward"),
    ],
)
def test_an_imu_that_is_not_level_contradicts_gravity(force: tuple[float, float, float], what: str) -> None:
    voted = leave_out_outvoted_sources(_prepared(VALUES, *ALL, force=force))
    assert voted.contradictions == (
        Contradiction(
            SourceQuantity("/imu", Kind.IMU),
            GRAVITY_TEXT,
            f"{what}: it is not mounted with x forward and z up",
            left_out=(SourceQuantity("/imu", Kind.IMU),),
        ),
    )
    assert voted.contradictions[0].votes_and_left_out_sources_text == "imu (/imu) is left out of the estimate"
    assert _rows(voted.prepared)[Kind.ACCEL] == _rows(voted.prepared)[Kind.YAW_RATE] == 0


@pytest.mark.parametrize("force", [(4.9, 0.0, 8.5), (0.0, 3.0, 9.3), (0.1, 0.2, -0.1)])
def test_an_imu_that_is_pitched_or_has_no_gravity_in_it_does_not(force: tuple[float, float, float]) -> None:
    assert leave_out_outvoted_sources(_prepared(VALUES, *ALL, force=force)).contradictions == ()


def test_an_accelerometer_s_bias_is_no_fault_where_gravity_shows_its_mount() -> None:
    biased = {**VALUES, Kind.ACCEL: VALUES[Kind.ACCEL] + 2.5}
    assert leave_out_outvoted_sources(_prepared(biased, *ALL)).contradictions == ()
    told = leave_out_outvoted_sources(_prepared(biased, *ALL, force=(0.0, 0.0, 0.0))).contradictions
    assert [(each.who.kind, len(each.left_out)) for each in told] == [(Kind.ACCEL, 1)]
