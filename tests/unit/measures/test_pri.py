"""The pedestrian risk index: hand vectors, and outlines that are moved in steps as the second implementation."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair

CAR, WALKER = (4.0, 2.0), (0.5, 0.5)
STEP_S = 0.1
"""Step of the tracks, s."""
BRAKING_MPS2, REACTION_S = 11.5, 1.0


def track(time_s: np.ndarray, x_m: float, y_m: float, speed_mps: float, heading_rad: float) -> ActualTrack:
    """A straight drive at constant speed."""
    way_m = speed_mps * time_s
    rows = [x_m + way_m * np.cos(heading_rad), y_m + way_m * np.sin(heading_rad)]
    rows += [np.full(len(time_s), each) for each in (speed_mps, heading_rad, 0.0, 0.0, 0.0, 0.0)]
    return ActualTrack(np.rint(time_s * 1e9).astype(np.int64), np.column_stack(rows))


def pri_m2(host: ActualTrack, other: ActualTrack, other_size: tuple[float, float] = WALKER) -> float:
    return float(Pair(host, other, CAR, other_size, 0.5).evaluate_measure(MEASURES["pri"]))


def test_pri_of_one_moment_by_hand() -> None:
    """The area is 0.5 m along the host's way, so its front reaches it half of that and of the car before the centres.

    At 11.5 m/s the car stops after 1 + 1 s; its front is 13.8 m from the area: 1.2 s, 0.2 s of which it brakes.
    """
    time_s = np.array([0.0, 0.1])
    host = track(time_s, 0.0, 0.0, 11.5, 0.0)
    in_conflict = track(time_s, 13.8 + 2.25, -1.25 - 1.1, 1.0, np.pi / 2)  # 1.1 m before the host's lane
    impact_m2ps2 = 11.5**2 - 2.0 * 11.5 * (11.5 * 0.2)
    late = 11.5**2 - 2.0 * 11.5 * (11.5 * 0.1)
    expected = 0.1 * impact_m2ps2 * (2.0 - 1.2) + 0.1 * late * (2.0 - 1.1)
    assert pri_m2(host, in_conflict) == pytest.approx(expected)
    walker_later = track(time_s, 13.8 + 2.25, -1.25 - 1.3, 1.0, np.pi / 2)
    assert pri_m2(host, walker_later) == 0.0, "the host is first"
    far = track(time_s, 23.0 + 2.25 + 1.15, -1.25 - 1.1, 1.0, np.pi / 2)
    assert pri_m2(host, far) == 0.0, "the host can still stop"
    within_reaction = track(time_s, 5.75 + 2.25, -1.25 - 0.3, 1.0, np.pi / 2)
    assert pri_m2(host, within_reaction) == pytest.approx(0.1 * 11.5**2 * (2.0 - 0.5) + 0.1 * 11.5**2 * (2.0 - 0.4))
    assert np.isnan(pri_m2(host, track(time_s, 30.0, 0.0, 1.0, 0.0))), "their ways do not cross"
    assert np.isnan(pri_m2(host, track(time_s, -30.0, -2.0, 1.0, np.pi / 2))), "the crossing is behind the host"


def time_to_other_strip_s(
    x_m: np.ndarray,
    heading_rad: float,
    speed_mps: float,
    size: tuple[float, float],
    of: tuple[np.ndarray, float, float],
) -> float:
    """When the front of an outline first reaches the strip that the other sweeps, s, by moving it in steps."""
    (length, width), (origin, other_heading, other_width) = size, of
    ahead, left = (np.array([np.cos(heading_rad + turn), np.sin(heading_rad + turn)]) for turn in (0.0, np.pi / 2))
    front = x_m + 0.5 * length * ahead + np.linspace(-0.5, 0.5, 41)[:, None] * width * left
    across = np.array([-np.sin(other_heading), np.cos(other_heading)])
    time_s = np.arange(0.0, 8.0, 5e-4)
    place = (front - origin) @ across + speed_mps * (ahead @ across) * time_s[:, None]
    inside = np.flatnonzero((np.abs(place) <= 0.5 * other_width).any(axis=1))
    return float(time_s[inside[0]]) if len(inside) else np.inf


def test_pri_is_that_of_outlines_moved_in_steps() -> None:
    rng = np.random.default_rng(8)
    n_positive = 0
    for _ in range(12):
        speed, walk, turn = rng.uniform(5.0, 16.0), rng.uniform(0.8, 5.0), rng.uniform(0.3, 0.7) * np.pi
        size = rng.uniform(0.4, 2.0), rng.uniform(0.4, 1.0)
        heading, time_s = rng.uniform(-3.0, 3.0), np.arange(0.0, 3.0, STEP_S)
        meet_s, lead_s = rng.uniform(2.5, 4.0), rng.uniform(-0.5, 0.8)
        host_x, host_y = -speed * meet_s * np.array([np.cos(heading), np.sin(heading)])
        host = track(time_s, host_x, host_y, speed, heading)
        way = heading + turn
        other_x, other_y = -walk * (meet_s - lead_s) * np.array([np.cos(way), np.sin(way)])
        other = track(time_s, other_x, other_y, walk, way)
        total = 0.0
        stop_s = REACTION_S + speed / BRAKING_MPS2
        for k in range(len(time_s)):
            own, theirs = host.state[k, :2], other.state[k, :2]
            host_s = time_to_other_strip_s(own, heading, speed, CAR, (theirs, way, size[1]))
            other_s = time_to_other_strip_s(theirs, way, walk, size, (own, heading, CAR[1]))
            if other_s < host_s < stop_s:
                driven_s = np.arange(0.0, 4.0, 1e-3)  # brake from the reaction on, until the area or a stand
                mps = np.maximum(speed - BRAKING_MPS2 * np.maximum(driven_s - REACTION_S, 0.0), 0.0)
                way_m = np.concatenate([[0.0], np.cumsum(5e-4 * (mps[1:] + mps[:-1]))])
                reached = np.flatnonzero(way_m >= speed * host_s - 1e-9)
                impact = mps[reached[0]] if len(reached) else 0.0
                total += STEP_S * impact**2 * (stop_s - host_s)
        found = pri_m2(host, other, size)
        n_positive += found > 0.0
        assert found == pytest.approx(total, rel=0.01, abs=0.05)
    assert n_positive >= 4
