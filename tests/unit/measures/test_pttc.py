"""Potential time to collision: hand vectors, and steps of a millisecond as the second implementation."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair

CAR = (4.0, 2.0)


def pttc_s(gap_m: float, host_mps: float, other_mps: float, accel_mps2: float, turn_rad: float = 0.0) -> float:
    """The measure of one moment: the other `gap_m` ahead of the host's front, both on one line in a direction."""
    stamp_ns = np.array([0, 100_000_000])
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)

    def track(along_m: float, speed_mps: float, accel: float) -> ActualTrack:
        row = [along_m * cosine, along_m * sine, speed_mps, turn_rad, accel, 0.0, 0.0, 0.0]
        return ActualTrack(stamp_ns, np.array([row, row]))

    pair = Pair(track(0.0, host_mps, 0.0), track(gap_m + 4.0, other_mps, accel_mps2), CAR, CAR, 0.5)
    return float(pair.evaluate_measure(MEASURES["pttc"])[0])


def test_hand_vectors() -> None:
    assert pttc_s(16.0, 20.0, 20.0, -2.0) == pytest.approx(4.0)  # 16 = 2 t^2 / 2
    assert pttc_s(30.0, 20.0, 15.0, -4.0) == pytest.approx((-5.0 + np.sqrt(25.0 + 240.0)) / 4.0)  # 30 = 5 t + 2 t^2
    assert pttc_s(24.0, 20.0, 22.0, -4.0) == pytest.approx(4.0)  # 24 + 2 t = 2 t^2


def test_a_vehicle_at_constant_speed_has_the_plain_time_to_collision() -> None:
    assert pttc_s(20.0, 20.0, 10.0, 0.0) == pytest.approx(2.0)
    assert pttc_s(20.0, 20.0, 10.0, 1.0) == pytest.approx(10.0 - np.sqrt(60.0))  # 20 = 10 t - t^2 / 2


def test_a_vehicle_that_is_never_reached_has_none() -> None:
    assert np.isnan(pttc_s(20.0, 20.0, 25.0, 0.0))
    assert np.isnan(pttc_s(60.0, 20.0, 10.0, 1.0))
    assert np.isnan(pttc_s(-30.0, 20.0, 10.0, -2.0)), "it is behind"


def test_steps_of_a_millisecond_agree() -> None:
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 40.0, 0.001)
    for _ in range(40):
        gap, host, other, braking = rng.uniform(1, 60), rng.uniform(5, 30), rng.uniform(5, 30), rng.uniform(0.5, 8)
        left = gap + (other - host) * time_s - 0.5 * braking * time_s**2
        first = time_s[np.flatnonzero(left <= 0.0)[0]]
        turn = rng.uniform(-3, 3)
        assert pttc_s(gap, host, other, -braking, turn) == pytest.approx(first, abs=2e-3)
