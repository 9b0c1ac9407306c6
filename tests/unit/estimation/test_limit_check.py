"""Nothing that is found of a sensor may be more than such sensors have: each bound from both sides."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, estimate_track, sensor_limits
from cwcli.estimation.contradiction import CAR_MOTION_TEXT, GRAVITY_TEXT, Contradiction, SourceQuantity
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.latency import Latency, LatencyStatus, mark_latency_beyond_limits
from cwcli.estimation.limit_check import (
    doubt_sentence_on_lasting_errors,
    find_contradictions_of_changing_latencies,
    find_values_beyond_sensor_limits,
)
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
from cwcli.estimation.result import SourceReport
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.verdict import consistency_verdict_sentence
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from tests.drive_truth import truth_stamps_ns
from tests.studies.sensor_model import measurements_of

USED, BEYOND = ParameterStatus.USED, ParameterStatus.CONTRADICTS
FIX = SourceReport("/fix", Kind.POSITION, n_read=500, n_used=500, sigma=0.6)
SPEED = SourceReport("/speed", Kind.SPEED, n_read=500, n_used=500, sigma=0.1)
ACCEL = SourceReport("/imu", Kind.ACCEL, n_read=500, n_used=500, sigma=0.1)
YAW_RATE = SourceReport("/imu", Kind.YAW_RATE, n_read=500, n_used=500, sigma=0.002)
PITCHED = ImuMounting(0.5, 0.0)  # 29 degrees nose up: 9.80665 sin 0.5 = 4.70 m/s^2


@pytest.mark.parametrize(
    ("report", "changes", "words"),
    [
        (SPEED, {"scale": Parameter(1.19, 0.01, USED)}, ""),
        (SPEED, {"scale": Parameter(1.21, 0.01, USED)}, "a scale of 1.21, and such a sensor has at most 1.2"),
        (SPEED, {"scale": Parameter(0.84, 0.01, USED)}, "a scale of 0.84, and such a sensor has at most 0.85"),
        (SPEED, {"scale": Parameter(2.139, status=BEYOND)}, "a scale of 2.14, and such a sensor has at most 1.2"),
        (SPEED, {"scale": Parameter(3.6, 0.01, ParameterStatus.GIVEN)}, ""),
        (SPEED, {"lever_arm_m": Parameter(2.9, 0.1, USED)}, ""),
        (SPEED, {"lever_arm_m": Parameter(-3.1, 0.1, USED)}, "a lever arm of -3.1 m"),
        (SPEED, {"sigma": 2.9}, ""),
        (SPEED, {"sigma": 3.1}, "white noise of 3.1 m/s"),
        (SPEED, {"sigma": 3.1, "n_used": 0}, ""),
        (SPEED, {"sigma": 3.1, "noise_origin": "message"}, ""),
        (SPEED, {"sigma": 3.1, "noise_origin": "message, scaled"}, "white noise of 3.1 m/s"),
        (FIX, {"ahead_m": Parameter(6.1, 0.1, USED)}, "a place ahead of 6.1 m"),
        (FIX, {"slow_error": SlowError(9.0, 30.0, USED)}, ""),
        (FIX, {"slow_error": SlowError(22.2, status=BEYOND)}, "a slow error of 22.2 m, and such"),
        (FIX, {"sigma": 31.0}, "white noise of 31 m"),
        (FIX, {"sigma": 8.3, "scatter": 0.6, "noise_origin": "log"}, "8.3 m beside the motion for long, and scatter"),
        (FIX, {"sigma": 8.3, "scatter": 4.2, "noise_origin": "log"}, ""),
        (FIX, {"sigma": 1.4, "scatter": 0.2, "noise_origin": "log"}, ""),
        (FIX, {"sigma": 8.3, "scatter": 0.6, "noise_origin": "message"}, ""),
        (FIX, {"stamp_error": Parameter(0.1, 0.01, USED)}, ""),
        (FIX, {"stamp_error": Parameter(0.0, status=BEYOND)}, "its stamps err by more than 0.2 s from row to row"),
        (FIX, {"latency": Latency(LatencyStatus.APPLIED, 1.0, 0.1)}, ""),
        (FIX, {"latency": Latency(LatencyStatus.CONTRADICTS, 1.369, 0.1)}, "a latency of 1.37 s"),
        (ACCEL, {"bias": 1.4}, ""),
        (ACCEL, {"bias": 9.48}, "a bias of 9.48 m/s^2, and such a sensor has at most 1.5 m/s^2"),
        (ACCEL, {"bias": 4.8, "mounting": PITCHED}, ""),
        (ACCEL, {"bias": -4.8, "mounting": PITCHED}, "a bias of -4.8 m/s^2"),
        (ACCEL, {"slow_error": SlowError(1.68, status=BEYOND)}, "a slow error of 1.68 m/s^2"),
        (YAW_RATE, {"bias": -0.09}, ""),
        (YAW_RATE, {"bias": -0.11}, "a bias of -0.11 rad/s, and such a sensor has at most -0.1 rad/s"),
        (YAW_RATE, {"sigma": 0.31}, "white noise of 0.31 rad/s"),
    ],
)  # fmt: skip
def test_each_bound(report: SourceReport, changes: dict[str, Any], words: str) -> None:
    others = [each for each in (FIX, SPEED) if each is not report]
    found = find_values_beyond_sensor_limits([*others, replace(report, **changes)])
    assert bool(found) == bool(words)
    if words:
        assert words in found[0].what
        assert found[0].who == SourceQuantity(report.source, report.kind)
        assert found[0].against == SourceQuantity(others[0].source, others[0].kind)
        assert found[0].left_out == ()


def test_a_biased_gyroscope_is_blamed_for_errors_that_last() -> None:
    fixes = replace(FIX, sigma=8.3, scatter=0.6, noise_origin="log")
    found = find_values_beyond_sensor_limits([fixes, replace(ACCEL, bias=0.17), replace(YAW_RATE, bias=-0.083)])
    assert [(each.who, each.against) for each in found] == [
        (SourceQuantity("/imu", Kind.YAW_RATE), SourceQuantity("/fix", Kind.POSITION))
    ]
    assert found[0].what == "with it the fixes lie 8.3 m beside the motion for long, and scatter by only 0.60 m"
    assert "no third source tells" in found[0].votes_and_left_out_sources_text


def test_a_source_alone_contradicts_how_cars_move() -> None:
    assert find_values_beyond_sensor_limits([replace(FIX, sigma=40.0)])[0].against == CAR_MOTION_TEXT


def test_what_is_told_already_is_not_told_again() -> None:
    wide = replace(FIX, slow_error=SlowError(22.2, status=BEYOND))
    told = Contradiction(SourceQuantity("/speed", Kind.SPEED), SourceQuantity("/fix", Kind.POSITION), "...")
    assert find_values_beyond_sensor_limits([wide, SPEED], [told]) == ()
    other = Contradiction(SourceQuantity("/imu", Kind.IMU), GRAVITY_TEXT, "...")
    assert len(find_values_beyond_sensor_limits([wide, SPEED], [other])) == 1


@pytest.mark.parametrize(
    ("latency", "status"),
    [
        (Latency(LatencyStatus.APPLIED, 1.2, 0.1), LatencyStatus.APPLIED),
        (Latency(LatencyStatus.APPLIED, 1.369, 0.1), LatencyStatus.CONTRADICTS),
        (Latency(LatencyStatus.APPLIED, -0.6, 0.1), LatencyStatus.CONTRADICTS),
        (Latency(LatencyStatus.DRIFTS, 1.5, 0.1, drift=1e-3), LatencyStatus.CONTRADICTS),
        (Latency(LatencyStatus.GIVEN, 5.0), LatencyStatus.GIVEN),
        (Latency(LatencyStatus.CALIBRATED, 5.0, 0.1), LatencyStatus.CALIBRATED),
    ],
)
def test_a_latency_beyond_what_sensors_have_is_not_corrected(latency: Latency, status: LatencyStatus) -> None:
    limited = mark_latency_beyond_limits(latency)
    assert limited.status is status
    if status is LatencyStatus.CONTRADICTS:
        assert limited.applied_s == 0.0
        assert limited.found_s == latency.found_s
        assert limited.drift == 0.0


def test_a_log_that_only_accelerates_contradicts_no_sensor() -> None:
    """From 0 by 1.8 m/s^2 for 14 s: the mean force leans by 10 degrees, and the bias of the IMU is 0."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 14.0, 0.05)
    stamp_ns = 10**18 + np.rint(time_s * 1e9).astype(np.int64)
    speed, zero = 1.8 * time_s, np.zeros_like(time_s)
    values = {
        Kind.POSITION: np.column_stack([0.5 * speed * time_s, zero]) + 0.3 * rng.standard_normal((len(time_s), 2)),
        Kind.SPEED: speed + 0.05 * rng.standard_normal(len(time_s)),
        Kind.IMU: np.column_stack([zero + 1.8, zero, zero + 9.80665, zero, zero, zero])
        + rng.standard_normal((len(time_s), 6)) * np.array([0.1] * 3 + [0.005] * 3),
    }
    track = estimate_track(
        [Measurements(f"/{kind.name.lower()}", kind, stamp_ns, own) for kind, own in values.items()], EstimatorConfig()
    )
    (accel,) = (report for report in track.sources if report.kind is Kind.ACCEL)
    assert accel.mounting is not None
    assert accel.mounting.nose_up_rad == pytest.approx(0.0, abs=np.radians(1.0))
    assert accel.bias == pytest.approx(0.0, abs=0.3)
    assert track.contradictions == ()


def test_the_table_of_the_docs_has_these_bounds() -> None:
    text = (Path(__file__).parents[3] / "docs" / "estimation.md").read_text(encoding="utf-8")
    section = text.split("## Sources that contradict each other")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if " to " in line]
    stated = {row[0]: row[1] for row in rows if len(row) == 3}
    limits = {
        "speed: scale": sensor_limits.SPEED_SCALE_RANGE,
        "speed: lever arm": sensor_limits.ESTIMATED_POINT_ABOVE_SPEED_POINT_RANGE,
        "accelerometer: bias": sensor_limits.ACCEL_BIAS_RANGE,
        "accelerometer: grade": sensor_limits.ROAD_GRADE_ACCEL_SIGMA_RANGE,
        "gyroscope: bias": sensor_limits.YAW_RATE_BIAS_RANGE,
        "position: slow error": sensor_limits.SLOW_POSITION_SIGMA_RANGE,
        "position: stamp jitter (sigma)": sensor_limits.STAMP_SIGMA_RANGE,
        "place ahead": sensor_limits.LONGITUDINAL_LEVER_ARM_RANGE,
        "latency: change in a second": sensor_limits.LATENCY_CHANGE_PER_SECOND_RANGE,
        "latency": sensor_limits.LATENCY_RANGE,
        **{f"white noise: {kind.name.lower()}": each for kind, each in sensor_limits.WHITE_NOISE_RANGE_BY_KIND.items()},
    }
    assert stated == {
        name: re.sub(r"\s+", " ", f"{limit.low:g} to {limit.high:g} {limit.unit}").strip()
        for name, limit in limits.items()
    }


def test_a_speed_in_km_h_that_nobody_compares_is_absorbed_by_no_parameter() -> None:
    """The bounds are a second net: without the comparison of the sources nothing beyond them is used either."""
    drive = simulate_scenario(load_scenario("city"), 9301)
    in_kmh = [
        replace(m, values=3.6 * m.values) if m.kind is Kind.SPEED else m
        for m in measurements_of(drive)
        if m.kind is not Kind.HEADING
    ]
    track = estimate_track(in_kmh, EstimatorConfig(compares_sources=False), truth_stamps_ns(drive)[::50])
    for report in track.sources:
        for part, parameter in (("scale", report.scale), ("ahead", report.ahead_m)):
            if parameter.status is USED:
                assert sensor_limits.range_of_sensor_error(part, report.kind).contains_or_is_nan(parameter.value)
        if report.slow_error.status is USED:
            assert sensor_limits.range_of_sensor_error("slow", report.kind).contains_or_is_nan(report.slow_error.sigma)
        if report.latency.status is LatencyStatus.APPLIED:
            assert sensor_limits.LATENCY_RANGE.contains_or_is_nan(report.latency.found_s)
    assert BEYOND in {each.status for report in track.sources for each in (report.scale, report.slow_error)}
    assert consistency_verdict_sentence(summarise_track(track)).startswith(
        "not consistent: ego_position (gnss) contradicts ego_speed (speed)"
    )


def test_a_latency_that_changes_faster_than_a_clock_is_told_once_and_used() -> None:
    drifting = Latency(LatencyStatus.DRIFTS, 0.3, 0.01, drift=5.8e-3)
    imu = [replace(each, latency=drifting) for each in (ACCEL, YAW_RATE)]
    (found,) = find_contradictions_of_changing_latencies([FIX, *imu], ())
    assert str(found.who) == "imu (/imu)"
    assert "changes by 348 ms a minute, and a clock's by at most 60 ms" in found.what
    assert found.left_out == ()
    assert find_contradictions_of_changing_latencies([FIX, *imu], [found]) == []
    steady = replace(FIX, latency=replace(drifting, drift=-9e-4))
    assert find_contradictions_of_changing_latencies([steady], ()) == []


def test_a_doubt_names_the_source_that_errs_for_long_and_all_that_it_is_compared_with() -> None:
    fixes = replace(FIX, sigma=1.0, scatter=0.6, noise_origin="log")
    words = doubt_sentence_on_lasting_errors([fixes, YAW_RATE])
    assert words.startswith("ego_position (/fix) errs by 0.8 m for long, and scatters by 0.6 m")
    assert "imu yaw rate (/imu)" in words
    assert doubt_sentence_on_lasting_errors([replace(fixes, sigma=0.65), YAW_RATE]) == ""
    assert doubt_sentence_on_lasting_errors([replace(fixes, slow_error=SlowError(1.0, 30.0, USED)), YAW_RATE]) == ""
    along = replace(fixes, slow_error=SlowError(1.2, 30.0, USED, along_to_across=1.9))
    assert doubt_sentence_on_lasting_errors([along, YAW_RATE]).startswith(
        "ego_position (/fix) errs by 1.2 m for long, and scatters by 0.6 m, 1.9 times as much along the way as across"
    )
