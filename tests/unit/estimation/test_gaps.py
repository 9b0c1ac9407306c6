"""Gaps of half a minute: no state runs away, and the covariance tells how little is known."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements, estimate_track
from cwcli.estimation.consistency import nees
from tests.studies.city_drive import EPOCH_NS, Sensors, city_drive, measure

GAPS_S = ((40.0, 65.0), (90.0, 120.0))
TIME_S = np.arange(1.0, 149.0, 0.1)
FASTEST_MPS = 15.0  # of `city_drive`


def _outside(m: Measurements) -> Measurements:
    time_s = (m.stamp_ns - EPOCH_NS) / 1e9
    return m.select_rows(np.logical_and.reduce([(time_s < begin) | (time_s > end) for begin, end in GAPS_S]))


def _velocity(seed: int) -> Measurements:
    drive, rng = city_drive(seed, 150.0), np.random.default_rng(seed)
    time_s = np.arange(0.05, 149.9, 1.0)
    true = drive.at(time_s)
    course = np.stack([np.cos(true["heading_rad"]), np.sin(true["heading_rad"])], axis=1)
    values = true["speed_mps"][:, None] * course + 0.3 * rng.standard_normal((len(time_s), 2))
    return Measurements("velocity", Kind.VELOCITY, EPOCH_NS + (time_s * 1e9).astype(np.int64), values)


@pytest.mark.parametrize("causal", [False, True])
@pytest.mark.parametrize("sensors", ["fixes at 10 Hz", "fixes at 1 Hz", "fixes and velocities", "fixes and an IMU"])
def test_states_do_not_run_away_in_gaps(sensors: str, causal: bool) -> None:
    in_gap = np.logical_or.reduce([np.abs(TIME_S - (begin + end) / 2) < (end - begin) / 2 for begin, end in GAPS_S])
    nees_per_state = []
    for seed in range(3):
        drive = city_drive(seed, 150.0)
        fixes, _, _, imu = measure(drive, seed, {}, Sensors(position_hz=1.0 if "1 Hz" in sensors else 10.0))
        measurements = [_outside(fixes)]
        measurements += [imu] if "IMU" in sensors else []
        measurements += [_outside(_velocity(seed))] if "velocities" in sensors else []
        config = EstimatorConfig(latency="none", causal=causal)
        track = estimate_track(measurements, config, EPOCH_NS + (TIME_S * 1e9).astype(np.int64))
        true = drive.at(TIME_S)
        error = track.state[:, :3] - np.stack([true["x_m"], true["y_m"], true["speed_mps"]], axis=1)
        assert np.abs(track.state[:, 2]).max() < 1.6 * FASTEST_MPS
        assert np.abs(track.state[:, 4]).max() < 8.0
        if not causal:
            # A second behind the gap the speed is that of the fixes again.
            known = ~in_gap & ~np.logical_or.reduce([np.abs(TIME_S - end) < 1.0 for _, end in GAPS_S])
            assert np.abs(error[known, 2]).max() < (2.5 if "1 Hz" in sensors else 1.5)
        nees_per_state.append(float(np.median(nees(error, track.covariance[:, :3, :3])[in_gap])) / 3.0)
    assert max(nees_per_state) < 2.0
