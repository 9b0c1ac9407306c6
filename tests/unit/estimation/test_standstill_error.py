"""What a standing vehicle shows of its sensors' errors: by hand, and that sigma then holds them."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.standstill_error import (
    StandstillErrors,
    covariance_from_standstill_errors,
    standstill_errors_of_best_position_source,
)
from cwcli.estimation.track import estimate_hindsight_and_online_tracks
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import N_STATES

TIME_S = 0.1 * np.arange(401.0)


def _fixes(xy: FloatArray) -> SensorSeries:
    return SensorSeries("/fix", Kind.POSITION, TIME_S, xy, np.tile([0.01, 0.0, 0.01], (len(xy), 1)))


def _errors(xy: FloatArray, speed_mps: float = 0.0) -> StandstillErrors:
    state, covariance = np.zeros((len(TIME_S), N_STATES)), np.tile(1e-4 * np.eye(N_STATES), (len(TIME_S), 1, 1))
    state[:, :2], state[:, 2] = xy.mean(axis=0), speed_mps
    return standstill_errors_of_best_position_source([_fixes(xy)], TIME_S, state, covariance)


def test_the_wander_of_standing_fixes_is_their_lasting_error() -> None:
    """0.2 sin(2 pi t / 20 s) east: covariance 0.02 cos(2 pi 0.5 / 20) over 0.5 s, half of it on each axis."""
    xy = np.column_stack([0.2 * np.sin(2.0 * np.pi * TIME_S / 20.0), np.zeros_like(TIME_S)])
    assert _errors(xy).position_m == pytest.approx(np.sqrt(0.01 * np.cos(np.pi / 20.0)), rel=0.02)


def test_white_noise_is_no_lasting_error() -> None:
    xy = 0.1 * np.random.default_rng(1).standard_normal((len(TIME_S), 2))
    assert _errors(xy).position_m == 0.0


@pytest.mark.parametrize("speed_mps", [0.2, 10.0])
def test_a_moving_vehicle_shows_nothing(speed_mps: float) -> None:
    assert _errors(np.column_stack([speed_mps * TIME_S, np.zeros_like(TIME_S)])) == StandstillErrors()


def test_the_speed_of_a_standing_vehicle_is_an_error() -> None:
    """0.04 m/s with a sigma of 0.01 m/s: the rest is the root of 0.04^2 - 0.01^2."""
    errors = _errors(np.zeros((len(TIME_S), 2)), 0.04)
    assert errors.speed_mps == pytest.approx(np.sqrt(0.0015))
    state = np.zeros((2, N_STATES))
    state[:, 2] = 0.04, 5.0
    added = covariance_from_standstill_errors(state, StandstillErrors(0.3, 0.05))
    assert added[:, 2, 2].tolist() == [0.05**2, 0.0]
    assert added[:, 0, 0].tolist() == added[:, 1, 1].tolist() == [0.3**2, 0.3**2]


@pytest.mark.parametrize("has_speed", [True, False])
def test_sigma_of_a_standing_vehicle_holds_its_wander(has_speed: bool) -> None:
    """Fixes that wander by 0.08 m for 3 s, and a speed that is read as a magnitude."""
    n, squared, differences = 300, [], []
    stamp_ns = 10**18 + 10**8 * np.arange(n)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        decay = np.exp(-0.1 / 3.0)
        wander = 0.08 * rng.standard_normal((n, 2))
        for i in range(1, n):
            wander[i] = decay * wander[i - 1] + np.sqrt(1.0 - decay**2) * wander[i]
        measurements = [
            Measurements("/bsm", Kind.POSITION, stamp_ns, wander + 0.01 * rng.standard_normal((n, 2)), None, stamp_ns),
            Measurements("/bsm", Kind.HEADING, stamp_ns, 0.3 + 0.02 * rng.standard_normal(n), None, stamp_ns),
            Measurements("/bsm", Kind.SPEED, stamp_ns, np.abs(0.05 * rng.standard_normal(n)), None, stamp_ns),
        ]
        tracks = estimate_hindsight_and_online_tracks(
            measurements if has_speed else measurements[:2], EstimatorConfig(), stamp_ns, blind=False
        )
        hindsight, online = (track.state[50:, :2] for track in tracks)
        inverse = [np.linalg.inv(track.covariance[50:, :2, :2]) for track in tracks]
        squared.append(np.einsum("ni,nij,nj->n", hindsight, inverse[0], hindsight))
        differences.append(np.einsum("ni,nij,nj->n", online - hindsight, inverse[1], online - hindsight))
    assert 0.3 < np.mean(squared) / 2.0 < 2.0
    assert np.mean(differences) / 2.0 < 2.0
