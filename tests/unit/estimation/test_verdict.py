"""The sentence on an estimate follows its numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.result import SourceReport, TrackSummary
from cwcli.estimation.verdict import NeesOfQuantity, consistency_verdict_sentence

GOOD = SourceReport(
    "/gps", Kind.POSITION, n_read=1000, n_used=998, n_gated=2, nis_mean=2.0, nis_dof=2, nis_bounds=(1.8, 2.2),
    nis_inside=True, noise_origin="message",
)  # fmt: skip
IMU = replace(GOOD, source="/imu", kind=Kind.YAW_RATE, nis_mean=1.0, nis_dof=1, nis_bounds=(0.9, 1.1))
SPEED = replace(IMU, source="/wheels", kind=Kind.SPEED)
FLAGS = {"starting": 40, "after_reset": 0, "bridged": 0}
TRUE = NeesOfQuantity("position", 1.0, (0.6, 1.5))


def _track(*sources: SourceReport, n_states: int = 1000, bridged: int = 0, **more: Any) -> TrackSummary:
    return TrackSummary(n_states, 70.0, 20.0, 0.5, {**FLAGS, "bridged": bridged}, sources, (), **more)


def _said(*sources: SourceReport, bridged: int = 0, nees: tuple[NeesOfQuantity, ...] = (TRUE,)) -> str:
    return consistency_verdict_sentence(_track(*sources, bridged=bridged), nees)


def test_what_lies_in_its_bounds_is_consistent() -> None:
    assert _said(GOOD, IMU) == "consistent"
    assert _said(GOOD, SPEED, IMU, nees=()) == "consistent"


def test_a_drift_that_no_other_source_shows_is_excepted() -> None:
    no_speed = "; a slow drift or another scale of /gps would not show, because no wheel speed is measured"
    assert _said(GOOD, IMU, nees=()) == f"no contradiction{no_speed}"
    assert _said(GOOD, SPEED, nees=()).endswith("/gps would not show, because no heading or turn rate is measured")
    assert _said(GOOD, nees=()).endswith("because no wheel speed and no heading or turn rate is measured")
    unused = replace(SPEED, n_used=0, n_gated=0)
    assert _said(GOOD, unused, IMU, nees=()) == f"no contradiction{no_speed}"
    noisy = replace(IMU, nis_mean=1.4, nis_inside=False)
    assert _said(GOOD, noisy, nees=()) == (
        f"no contradiction within a factor of 2 in sigma: /imu yaw rate outside the 95 % bounds{no_speed}"
    )
    other = replace(GOOD, source="/other_gps")  # would show it
    assert _said(GOOD, other, IMU, nees=()) == "consistent"
    velocity = replace(SPEED, kind=Kind.VELOCITY)  # smoothed by a receiver
    assert _said(GOOD, velocity, IMU, nees=()) == f"no contradiction{no_speed}"


def test_jump_that_a_pause_of_the_only_fixes_hides_is_excepted() -> None:
    paused = replace(GOOD, gap_s_and_hidden_jump_m=(36.2, 12.3))
    jump = "; /gps may lie up to 12 m elsewhere since it paused for 36 s"
    assert _said(paused, SPEED, IMU, nees=()) == f"no contradiction{jump}"
    assert _said(paused, IMU, nees=()).endswith(f"because no wheel speed is measured{jump}")
    assert _said(paused, SPEED, IMU) == "consistent"  # a truth would show it


def test_a_short_log_shows_no_drift_but_a_truth_or_other_fixes_do() -> None:
    short = replace(_track(GOOD, SPEED, IMU), span_s=20.0)
    exception = "; in 20 s a slow drift, another scale or wrong axes of /gps may not show"
    assert consistency_verdict_sentence(short) == f"no contradiction{exception}"
    assert consistency_verdict_sentence(short, (TRUE,)) == "consistent"
    other = replace(GOOD, source="/other_gps")
    assert consistency_verdict_sentence(replace(short, sources=(GOOD, other, SPEED, IMU))) == "consistent"
    assert consistency_verdict_sentence(replace(short, sources=(GOOD, IMU))).endswith(exception)


def test_a_short_log_says_what_no_other_source_confirms() -> None:
    unsure = replace(IMU, is_checked=False)
    short = replace(_track(GOOD, SPEED, unsure), span_s=20.0)
    said = consistency_verdict_sentence(short)
    assert said.startswith("too short to check imu yaw rate (/imu); no contradiction otherwise; in 20 s")
    assert consistency_verdict_sentence(replace(short, span_s=120.0)) == "consistent"
    assert consistency_verdict_sentence(short, (TRUE,)) == "consistent"


def test_errors_that_last_are_told_behind_the_verdict() -> None:
    lasting = replace(GOOD, noise_origin="log", sigma=1.1, scatter=0.6)
    track = replace(_track(lasting, SPEED, IMU), span_s=120.0)
    said = consistency_verdict_sentence(track)
    assert said.startswith("no contradiction; but ego_position (/gps) errs by 0.92 m for long, and scatters by 0.6 m")
    assert consistency_verdict_sentence(track, (TRUE,)) == "consistent"


@pytest.mark.parametrize(
    ("nis_per_dof", "expected"),
    [
        (1.4, "consistent within a factor of 2 in sigma: /imu yaw rate outside the 95 % bounds"),
        (0.6, "consistent within a factor of 2 in sigma: /imu yaw rate outside the 95 % bounds"),
        (0.26, "consistent within a factor of 2 in sigma: /imu yaw rate outside the 95 % bounds"),
        (0.24, "consistent, with a covariance larger than necessary for /imu yaw rate"),
        (
            4.0,
            "not consistent: /imu yaw rate scatters by 2.0 times its sigma: its messages understate its noise, "
            "so trust the states less than their covariance",
        ),
    ],
)
def test_a_source_that_leaves_its_bounds_changes_the_verdict(nis_per_dof: float, expected: str) -> None:
    assert _said(GOOD, replace(IMU, nis_mean=nis_per_dof, nis_inside=False)) == expected


def test_noise_found_from_the_log_that_is_too_small_lasts() -> None:
    source = replace(IMU, nis_mean=9.0, nis_inside=False, noise_origin="log")
    assert "scatters by 3.0 times its sigma: its errors last" in _said(source)


def test_errors_that_are_larger_than_the_covariance_says_come_first() -> None:
    found = _said(replace(IMU, nis_mean=9.0, nis_inside=False), nees=(NeesOfQuantity("speed", 16.0, (0.7, 1.3)), TRUE))
    expected = "not consistent: the speed error is 4.0 times its sigma: multiply its covariance by 16; /imu"
    assert found.startswith(expected)


def test_rejected_rows_resets_and_bridged_gaps_are_told() -> None:
    assert "6 % of /gps position contradict the rest" in _said(replace(GOOD, n_used=940, n_gated=60))
    assert _said(replace(GOOD, n_used=960, n_gated=40)) == "consistent"
    assert "/gps position jumped 2 x" in _said(replace(GOOD, n_resets=2))
    assert _said(replace(IMU, n_resets=2)) == "consistent"  # of an inertial sensor a manoeuvre
    assert "21 % of the states bridge gaps" in _said(GOOD, bridged=210)
    assert _said(GOOD, bridged=190) == "consistent"


def test_the_worst_two_are_told_and_the_others_counted() -> None:
    wrong = replace(GOOD, n_used=900, n_gated=100, nis_mean=8.0, nis_inside=False)
    found = _said(wrong, bridged=500)
    assert found.count(";") == 1
    assert found.endswith(", and 1 more")


def test_without_enough_rows_nothing_is_claimed() -> None:
    few = replace(GOOD, nis_inside=None)
    assert _said(few, nees=()) == "too little was measured to judge whether the estimate is consistent"
    assert consistency_verdict_sentence(_track(GOOD, n_states=0)) == "nothing was estimated"


def test_sources_that_contradict_each_other_come_before_all_else() -> None:
    speed, fix = SourceQuantity("/wheel", Kind.SPEED), SourceQuantity("/gps", Kind.POSITION)
    wrong = Contradiction(speed, fix, "the car covered 3.60 times the distance between the fixes")
    told = (
        "ego_speed (/wheel) contradicts ego_position (/gps): the car covered 3.60 times the distance between the fixes"
    )
    alone = consistency_verdict_sentence(_track(GOOD, IMU, contradictions=(wrong,)), (TRUE,))
    assert alone == f"not consistent: {told} (no third source tells which of them is wrong; both are used)"
    outvoted = replace(wrong, allies=(SourceQuantity("/imu", Kind.ACCEL),)).with_left_out(speed)
    noisy = (NeesOfQuantity("speed", 16.0, (0.7, 1.3)),)
    both = consistency_verdict_sentence(_track(GOOD, contradictions=(outvoted,)), noisy)
    assert both.startswith(
        f"not consistent: {told} (imu accel (/imu) agrees with ego_position (/gps); ego_speed (/wheel) is left out of "
        "the estimate); the speed error is 4.0 times its sigma"
    )
