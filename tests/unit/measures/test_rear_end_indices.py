"""PICUD, inverse TTC and Ozbay's crash index: hand vectors, and a drive in steps as the second implementation."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair

CAR = (4.0, 2.0)
STEP_S = 0.001
"""Step of the drives, s."""


def value(
    name: str, gap_m: float, own: tuple[float, float], theirs: tuple[float, float], turn_rad: float = 0.0
) -> float:
    """A measure of one moment: the other `gap_m` ahead of the host's front; speed and acceleration of each."""
    stamp_ns = np.array([0, 100_000_000])
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)

    def track(along_m: float, speed_mps: float, accel: float) -> ActualTrack:
        row = [along_m * cosine, along_m * sine, speed_mps, turn_rad, accel, 0.0, 0.0, 0.0]
        return ActualTrack(stamp_ns, np.array([row, row]))

    pair = Pair(track(0.0, *own), track(gap_m + 4.0, *theirs), CAR, CAR, 0.5)
    return float(pair.evaluate_measure(MEASURES[name])[0])


def test_picud_by_hand() -> None:
    assert value("picud", 30.0, (20.0, 0.0), (20.0, 0.0)) == pytest.approx(10.0)  # the reaction takes 20 m
    assert value("picud", 30.0, (20.0, 0.0), (10.0, 0.0)) == pytest.approx(10.0 - 300.0 / 6.6)
    assert value("picud", 5.0, (0.0, 0.0), (0.0, 0.0)) == pytest.approx(5.0)
    assert np.isnan(value("picud", -30.0, (20.0, 0.0), (10.0, 0.0))), "it is behind"


def test_contact_psd_by_hand() -> None:
    # contact after 2 s, 40 m on; 20^2 / (2 11.5) m to a stand
    assert value("contact-psd", 20.0, (20.0, 0.0), (10.0, 0.0)) == pytest.approx(40.0 / (400.0 / 23.0))
    assert np.isnan(value("contact-psd", 20.0, (10.0, 0.0), (10.0, 0.0))), "they never touch"


def test_inverse_ttc_by_hand() -> None:
    assert value("ittc", 20.0, (20.0, 0.0), (10.0, 0.0)) == pytest.approx(0.5)
    assert value("ittc", 20.0, (10.0, 0.0), (10.0, 0.0)) == 0.0
    assert value("ittc", 0.0, (20.0, 0.0), (10.0, 0.0)) == np.inf
    assert value("ittc", 20.0, (20.0, 0.0), (10.0, 0.0)) == 1.0 / value("ttc", 20.0, (20.0, 0.0), (10.0, 0.0))


def test_crash_index_by_hand() -> None:
    # constant speeds: contact after 20 / 10 s; (400 - 100) / (2 2)
    assert value("crash-index", 20.0, (20.0, 0.0), (10.0, 0.0)) == pytest.approx(75.0)
    # 16 = 2 t^2 / 2 after 4 s, where the one ahead has 20 - 8 m/s: (400 - 144) / (2 4)
    assert value("crash-index", 16.0, (20.0, 0.0), (20.0, -2.0)) == pytest.approx(32.0)
    assert np.isnan(value("crash-index", 20.0, (10.0, 0.0), (20.0, 0.0))), "it is never reached"


def test_picud_is_the_gap_after_a_drive_in_steps() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        gap, own, theirs = rng.uniform(1.0, 60.0), rng.uniform(0.0, 30.0), rng.uniform(0.0, 30.0)
        time_s = np.arange(0.0, 12.0, STEP_S)
        own_mps = np.maximum(own - 3.3 * np.maximum(time_s - 1.0, 0.0), 0.0)
        their_mps = np.maximum(theirs - 3.3 * time_s, 0.0)
        left_m = gap + np.trapezoid(their_mps - own_mps, dx=STEP_S)
        found = value("picud", gap, (own, 0.0), (theirs, 0.0), rng.uniform(-3.0, 3.0))
        assert found == pytest.approx(left_m, abs=1e-3)


def test_crash_index_and_inverse_ttc_are_those_of_a_drive_in_steps() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        gap, theirs = rng.uniform(2.0, 40.0), rng.uniform(5.0, 20.0)
        own, own_accel, accel = theirs + rng.uniform(2.0, 10.0), rng.uniform(0.0, 1.0), rng.uniform(-1.0, 0.0)
        time_s = np.arange(0.0, 25.0, STEP_S)
        own_mps, their_mps = own + own_accel * time_s, theirs + accel * time_s
        left_m = gap - np.concatenate([[0.0], np.cumsum(STEP_S * (own_mps - their_mps)[1:])])
        hit = int(np.flatnonzero(left_m <= 0.0)[0])
        turn = rng.uniform(-3.0, 3.0)
        energy = 0.5 * (own_mps[hit] ** 2 - their_mps[hit] ** 2) / time_s[hit]
        assert value("crash-index", gap, (own, own_accel), (theirs, accel), turn) == pytest.approx(energy, rel=5e-3)
        steady_s = time_s[np.flatnonzero(gap - (own - theirs) * time_s <= 0.0)[0]]
        assert value("ittc", gap, (own, 0.0), (theirs, 0.0), turn) == pytest.approx(1.0 / steady_s, rel=5e-3)
