"""The last check: a source that spoils all others is left out, and named; one that is right never is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.leave_one_out import (
    constant_angle_to_course_rad,
    find_spoiling_sources,
    quantities_in_doubt,
    quantities_with_unusual_noise_or_error,
    quantity_groups_to_leave_out,
)
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import ParameterStatus, SlowError
from cwcli.estimation.result import SourceReport
from tests.studies.lying_sensors import run_fault, simulated, variants
from tests.studies.sensor_faults import FAULTS
from tests.studies.sensor_model import measurements_of
from tests.unit.estimation.made_drive import as_series, made_drive

FIX = SourceReport("/fix", Kind.POSITION, n_used=500, sigma=0.6, scatter=0.6, noise_origin="log", log_likelihood=-500.0)
SPEED = SourceReport("/speed", Kind.SPEED, n_used=500, sigma=0.1, scatter=0.1, noise_origin="log")
HEADING = SourceReport("/heading", Kind.HEADING, n_used=500, sigma=0.01, scatter=0.01, noise_origin="log")
ACCEL, YAW_RATE = (SourceReport("/imu", kind, n_used=500) for kind in (Kind.ACCEL, Kind.YAW_RATE))
ALL = (FIX, SPEED, HEADING, ACCEL, YAW_RATE)
SPEED_QUANTITY, IMU = SourceQuantity("/speed", Kind.SPEED), (
    SourceQuantity("/imu", Kind.ACCEL),
    SourceQuantity("/imu", Kind.YAW_RATE),
)  # fmt: skip


@pytest.mark.parametrize(
    ("report", "is_misfit"),
    [
        (FIX, False),
        (replace(FIX, sigma=1.9), True),
        (replace(FIX, sigma=1.9, noise_origin="message"), False),
        (replace(FIX, sigma=1.4), False),  # the errors of a good receiver last, too
        (replace(FIX, slow_error=SlowError(2.4, 30.0, ParameterStatus.USED)), False),
        (replace(FIX, slow_error=SlowError(2.6, 30.0, ParameterStatus.USED)), True),
        (replace(SPEED, sigma=0.8), True),
        (replace(SPEED, sigma=0.8, n_used=0), False),
        (replace(HEADING, sigma=0.08), True),
        (replace(ACCEL, slow_error=SlowError(0.7, 30.0, ParameterStatus.USED)), True),
        (replace(YAW_RATE, bias=0.11), True),
        (replace(FIX, n_gated=20), False),
        (replace(FIX, n_gated=40), True),
        (replace(YAW_RATE, n_gated=40), False),
    ],
)
def test_what_is_a_misfit(report: SourceReport, is_misfit: bool) -> None:
    assert bool(quantities_with_unusual_noise_or_error([report])) is is_misfit


@pytest.mark.parametrize(
    ("report", "is_doubt"),
    [
        (SPEED, False),
        (replace(SPEED, sigma=0.25), True),
        (replace(SPEED, sigma=0.25, scatter=0.22), False),  # 1.14 times the scatter
        (replace(SPEED, sigma=0.15), False),  # 0.11 m/s last, less than a quarter of what a wrong source does
        (replace(SPEED, sigma=0.25, scatter=0.2, n_used=50), False),  # 1.25 times of 50 rows may be chance
        (replace(SPEED, sigma=0.25, noise_origin="message"), False),
        (replace(SPEED, kind=Kind.VELOCITY, sigma=0.25), False),  # receivers smooth it
        (replace(HEADING, sigma=0.025), True),
        (replace(FIX, sigma=0.8), True),
        (replace(FIX, slow_error=SlowError(1.0, 30.0, ParameterStatus.USED, along_to_across=1.5)), True),
        (replace(FIX, slow_error=SlowError(1.0, 30.0, ParameterStatus.USED, along_to_across=1.3)), False),
        (replace(FIX, slow_error=SlowError(along_to_across=1.5)), False),
        (
            replace(
                FIX,
                sigma=0.09,
                scatter=0.09,
                slow_error=SlowError(1.0, 30.0, ParameterStatus.USED, along_to_across=1.5),
            ),
            False,  # fixes as smooth as that may lag themselves
        ),
        (replace(SPEED, n_gated=6), True),
        (replace(SPEED, n_gated=5), False),
        (replace(SPEED, latency=Latency(LatencyStatus.DRIFTS, 0.1, 0.01, drift=1.1e-3)), True),
        (replace(SPEED, latency=Latency(LatencyStatus.DRIFTS, 0.1, 0.01, drift=0.9e-3)), False),
    ],
)
def test_what_is_in_doubt(report: SourceReport, is_doubt: bool) -> None:
    assert bool(quantities_in_doubt([report])) is is_doubt
    assert not quantities_with_unusual_noise_or_error([report])


def test_a_doubt_leaves_no_source_out_that_no_third_one_judges() -> None:
    doubtful = replace(FIX, sigma=1.2, log_likelihood=-900.0)
    tried = []

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        tried.append(tuple(quantities))
        return [FIX, *(r for r in ALL[1:] if SourceQuantity(r.source, r.kind) not in quantities)]

    assert find_spoiling_sources((doubtful, ACCEL, YAW_RATE), reports_without) == ()
    assert tried == []
    assert find_spoiling_sources((doubtful, *ALL[1:]), reports_without) != ()


@pytest.mark.parametrize(("gain", "is_left_out"), [(22.0, False), (23.0, True)])
def test_half_the_gain_is_enough_where_what_was_doubted_alone_explains_it(gain: float, is_left_out: bool) -> None:
    doubted = replace(SPEED, sigma=0.25)

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        left = [FIX, doubted, *ALL[2:]]
        better = [replace(FIX, log_likelihood=-500.0 + gain), *ALL[2:]]
        return better if quantities == (SPEED_QUANTITY,) else left

    found = find_spoiling_sources((FIX, doubted, *ALL[2:]), reports_without)
    assert found == (SPEED_QUANTITY,) * is_left_out


def test_positions_and_trusted_sources_are_never_left_out_and_an_imu_also_as_a_whole() -> None:
    assert quantity_groups_to_leave_out(ALL, {"/speed"}) == [
        (SourceQuantity("/heading", Kind.HEADING),), IMU[:1], IMU[1:], IMU,
    ]  # fmt: skip


def test_the_one_without_which_the_others_fit_best_is_found() -> None:
    wrong = (replace(FIX, sigma=4.0, log_likelihood=-900.0), *ALL[1:])

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        left = [r for r in ALL if SourceQuantity(r.source, r.kind) not in quantities]
        if SPEED_QUANTITY in quantities:
            return left
        if len(quantities) == 2:  # without the IMU the misfit goes, too, but the others fit worse
            return [replace(FIX, log_likelihood=-700.0), *left[1:]]
        return [wrong[0], *left[1:]]

    assert find_spoiling_sources(wrong, reports_without) == (SPEED_QUANTITY,)
    assert find_spoiling_sources(wrong, reports_without, {"/speed"}) == IMU
    assert find_spoiling_sources(ALL, reports_without) == ()
    slightly = (replace(wrong[0], log_likelihood=-544.0), *ALL[1:])  # a gain of 44 of 45
    assert find_spoiling_sources(slightly, reports_without) == ()


@pytest.mark.parametrize(
    ("speed_without_imu", "expected"),
    [(-600.0, ()), (-540.0, IMU)],  # 100 worse without the IMU than without the heading, or 40, which is less than 45
)
def test_a_source_that_denies_a_lagging_one_is_not_blamed(speed_without_imu: float, expected: object) -> None:
    """Without the IMU a heading that lags is predicted well, but the speed is worse than without the heading."""
    lags = replace(HEADING, sigma=0.03, log_likelihood=-2000.0)
    every = (FIX, replace(SPEED, log_likelihood=-500.0), lags, ACCEL, YAW_RATE)

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        left = [r for r in every if SourceQuantity(r.source, r.kind) not in quantities]
        if len(quantities) == 2:
            return [FIX, replace(SPEED, log_likelihood=speed_without_imu), HEADING]
        return left

    assert find_spoiling_sources(every, reports_without) == expected


def test_a_latency_beyond_limits_is_not_explained_by_a_part_of_a_source() -> None:
    late = replace(FIX, latency=Latency(LatencyStatus.CONTRADICTS, 1.6, 0.1))
    tried = []

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        tried.append(tuple(quantities))
        return [replace(FIX, log_likelihood=-100.0), ACCEL, YAW_RATE]

    assert find_spoiling_sources((late, ACCEL, YAW_RATE), reports_without) == IMU
    assert tried == [IMU]


def test_a_drift_without_a_source_means_that_it_was_not_the_wrong_one() -> None:
    drift = SlowError(1.1, 30.0, ParameterStatus.USED, largest=15.0)

    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        return [replace(FIX, slow_error=drift, log_likelihood=-100.0), *ALL[1:]]

    assert find_spoiling_sources((replace(FIX, sigma=4.0), *ALL[1:]), reports_without) == ()


@pytest.mark.parametrize(("sigma_m", "is_resolved"), [(0.89, True), (0.91, False)])  # 1.5 times the scatter of 0.6 m
def test_what_is_left_has_to_agree_clearly(sigma_m: float, is_resolved: bool) -> None:
    def reports_without(quantities: Sequence[SourceQuantity]) -> Sequence[SourceReport]:
        left = [r for r in ALL[1:] if SourceQuantity(r.source, r.kind) not in quantities]
        is_better = SPEED_QUANTITY in quantities
        return [replace(FIX, sigma=sigma_m if is_better else 4.0, log_likelihood=-100.0), *left]

    found = find_spoiling_sources((replace(FIX, sigma=4.0), *ALL[1:]), reports_without)
    assert found == (SPEED_QUANTITY,) * is_resolved


def test_only_a_source_that_is_left_out_is_said_to_be() -> None:
    fix = SourceQuantity("/fix", Kind.POSITION)
    imu = Contradiction(SourceQuantity("/imu", Kind.IMU), fix, "...", left_out=IMU)
    assert imu.votes_and_left_out_sources_text.endswith(
        "which of them is wrong; imu (/imu) is left out of the estimate"
    )
    both = Contradiction(SPEED_QUANTITY, IMU[0], "...", left_out=(SPEED_QUANTITY, IMU[0]))
    assert both.votes_and_left_out_sources_text.endswith("both are left out of the estimate")


@pytest.mark.parametrize(
    ("name", "variant", "who"),
    [
        ("gyro bias steps in mid-log", "full", "imu yaw rate (imu)"),
        ("speed + 2 m/s", "full", "ego_speed (speed)"),
        (
            "IMU 2 s late",
            "lean",
            "ego_position (gnss) contradicts imu (imu): the same turns and changes of speed come about 2.0 s earlier "
            "in its fixes: check the clocks of both",
        ),
    ],
)
def test_a_source_that_no_step_shows_to_be_wrong_is_left_out(name: str, variant: str, who: str) -> None:
    # With it the position errs by 1.2 to 5 m, and the verdict of the first was "consistent".
    drive = simulated("curve", 7401)
    fault = next(each for each in FAULTS if each.name == name)
    case = run_fault(drive, variants(measurements_of(drive))[variant], fault, 0.11)
    assert case.ratio < 1.4
    assert case.told.startswith(who)
    assert case.verdict.startswith("not consistent: ")


@pytest.mark.parametrize(("offset_rad", "lag_s", "expected_rad"), [(0.2, 0.0, 0.2), (0.0, 3.0, math.nan)])
def test_only_a_heading_that_is_turned_throughout_has_a_constant_angle_to_the_course(
    offset_rad: float, lag_s: float, expected_rad: float
) -> None:
    time_s, values = made_drive()
    lagging = np.interp(time_s - lag_s, time_s, values[Kind.HEADING])
    noisy = lagging + offset_rad + 0.02 * np.random.default_rng(1).standard_normal(len(time_s))
    found = constant_angle_to_course_rad(
        as_series(Kind.HEADING, time_s, noisy), as_series(Kind.POSITION, time_s, values[Kind.POSITION])
    )
    assert found == pytest.approx(expected_rad, abs=0.02, nan_ok=True)
