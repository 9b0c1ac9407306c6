"""A drift of fixes is found where the way is measured otherwise, and sigma holds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Measurements, estimate_track, slow_drift
from cwcli.estimation.calibration import Calibration, Constant, ConstantStatus
from cwcli.estimation.contradiction import Contradiction, SourceQuantity
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import ParameterStatus, SlowError
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.result import SourceReport
from cwcli.estimation.slow_drift import (
    covariance_from_fix_drifts,
    find_contradictions_of_drifting_fixes,
    slow_changes_along_to_across_or_nan,
)
from tests.studies.lying_sensors import estimated, run_fault, simulated
from tests.studies.sensor_faults import FAULTS
from tests.studies.sensor_model import measurements_of

DRIFT = SlowError(1.0, 30.0, ParameterStatus.USED, largest=8.0)
FIX = SourceReport("/fix", Kind.POSITION, n_used=500, slow_error=DRIFT)
SPEED = SourceReport("/speed", Kind.SPEED, n_used=500)
FIX_ID, SPEED_ID = SourceQuantity("/fix", Kind.POSITION), SourceQuantity("/speed", Kind.SPEED)


@pytest.mark.parametrize(
    ("sigma_m", "largest_m", "is_told"),
    [
        (1.1, 4.9, False),  # 4.5 sigma are 4.95 m
        (1.1, 5.0, True),
        (0.1, 3.2, False),  # as large as errors of receivers under open sky are
        (0.1, 3.4, True),
    ],
)
def test_a_slow_error_far_beyond_its_sigma_is_a_drift(sigma_m: float, largest_m: float, is_told: bool) -> None:
    drifting = replace(FIX, slow_error=SlowError(sigma_m, 30.0, ParameterStatus.USED, largest_m))
    found = find_contradictions_of_drifting_fixes([drifting, SPEED], [])
    assert [(each.who, each.against, each.left_out) for each in found] == [(FIX_ID, SPEED_ID, ())] * is_told
    assert bool(covariance_from_fix_drifts([drifting, SPEED]).any()) is is_told
    assert find_contradictions_of_drifting_fixes([drifting, SPEED], [Contradiction(SPEED_ID, FIX_ID, "...")]) == []


@pytest.mark.parametrize(("along", "across"), [(1.0, 1.0), (3.0, 1.0), (1.0, 2.0)])
def test_changes_along_the_way_are_told_from_those_across_it(along: float, across: float) -> None:
    time_s = 0.05 * np.arange(6000.0)
    state = np.zeros((6000, 10))
    state[:, 2], state[:, 3] = 10.0, 0.05 * time_s
    changes = np.random.default_rng(0).standard_normal((6000, 2)) @ np.diag([along, across])
    cos, sin = np.cos(state[:, 3]), np.sin(state[:, 3])
    state[:, 8] = np.cumsum(cos * changes[:, 0] - sin * changes[:, 1])
    state[:, 9] = np.cumsum(sin * changes[:, 0] + cos * changes[:, 1])
    fixes = SensorSeries("/fix", Kind.POSITION, time_s, state[:, :2], np.ones((6000, 3)), slow_state=8)
    assert slow_changes_along_to_across_or_nan(fixes, time_s, state) == pytest.approx(along / across, rel=0.3)
    assert np.isnan(slow_changes_along_to_across_or_nan(replace(fixes, slow_state=-1), time_s, state))
    assert np.isnan(slow_changes_along_to_across_or_nan(fixes, time_s[:1000], state[:1000]))  # 50 s are too few


def test_a_velocity_that_its_receiver_smooths_shows_no_drift() -> None:
    velocity = replace(SPEED, kind=Kind.VELOCITY)
    assert find_contradictions_of_drifting_fixes([FIX, velocity], []) == []
    assert not covariance_from_fix_drifts([FIX, velocity]).any()
    assert len(find_contradictions_of_drifting_fixes([FIX, replace(velocity, n_used=0)], [])) == 1


def test_the_variance_is_that_of_a_wave_with_the_height_of_the_drift() -> None:
    covariance = covariance_from_fix_drifts([FIX])
    assert np.flatnonzero(covariance).tolist() == [0, 9]  # east and north on the diagonal of (8, 8)
    assert covariance[0, 0] == covariance[1, 1] == 32.0  # 8^2 / 2


@pytest.mark.parametrize(
    "other",
    [
        replace(FIX, source="/other", slow_error=replace(DRIFT, largest=4.4)),
        replace(FIX, source="/other", slow_error=SlowError()),
    ],
)
def test_another_position_that_does_not_drift_holds_the_states(other: SourceReport) -> None:
    assert not covariance_from_fix_drifts([FIX, other]).any()
    assert covariance_from_fix_drifts([FIX, replace(other, n_used=0)]).any()


@pytest.mark.long
def test_fixes_that_drift_off_for_a_minute_and_a_half_are_named_beside_wheels_and_a_heading() -> None:
    drive = simulated("city", 8101)
    right = measurements_of(drive)
    fault = next(each for each in FAULTS if each.is_drift)
    case = run_fault(drive, right, fault, estimated(drive, right)[0])
    assert case.told.startswith("ego_position (gnss) contradicts ego_speed (speed): its fixes drift up to 10 m off")
    assert case.is_good
    assert case.nees < 2.0  # 12 with the sigma of the whole log


def found(value: float) -> Constant:
    return Constant(ConstantStatus.FOUND, value, 0.0)


def test_no_online_state_with_a_calibration_knows_of_a_later_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fixes are 4 m off in the last 4 s of 14 s: the sigma of the first 10 s is that of the cut log."""
    monkeypatch.setattr(slow_drift, "MIN_DRIFT_M", 0.1)
    monkeypatch.setattr(slow_drift, "MAX_SLOW_ERROR_SIGMAS_WITHOUT_DRIFT", 0.1)
    time_s = np.arange(0.0, 14.0, 0.1)
    stamp_ns = np.rint(1e9 * time_s).astype(np.int64)
    fixes_m = np.column_stack([10.0 * time_s + np.maximum(time_s - 10.0, 0.0), np.zeros(len(time_s))])
    speeds_mps = np.full((len(time_s), 1), 10.0)
    slow = {"slow_sigma": found(0.5), "slow_time_s": found(30.0), "noise_sigma": found(0.5)}
    calibration = Calibration(
        "car.toml", {"/fix": {"position": slow}, "/speed": {"speed": {"noise_sigma": found(0.1)}}}
    )
    config = EstimatorConfig(causal=True, calibration=calibration)
    output_ns = stamp_ns[20:100:10]
    covariances = []
    for n in (101, len(time_s)):
        whole = [
            Measurements("/fix", Kind.POSITION, stamp_ns[:n], fixes_m[:n]),
            Measurements("/speed", Kind.SPEED, stamp_ns[:n], speeds_mps[:n]),
        ]
        stamps = output_ns if n == 101 else np.append(output_ns, stamp_ns[-1])
        track = estimate_track(whole, config, stamps)
        covariances.append(track.covariance[: len(output_ns)])
        assert len(find_contradictions_of_drifting_fixes(track.sources, [])) == (n > 101)
    np.testing.assert_array_equal(covariances[0], covariances[1])
