"""First contact in closed form: by hand, and against a fine grid of time."""

import math

import numpy as np
import pytest

from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s, straight_contact_time_s
from cwcli.measures.outlines import outline_separation_m
from cwcli.measures.pair import ActualTrack, Pair

CAR, TRUCK = (4.5, 1.8), (12.0, 2.5)
STEP_S = 2e-3


def pair_of(host: list[list[float]], other: list[list[float]], other_size: tuple[float, float] = CAR) -> Pair:
    """Of rows x, y, speed, heading, a moment each."""
    stamps = np.arange(len(host)) * 10**8
    return Pair(ActualTrack(stamps, np.array(host)), ActualTrack(stamps, np.array(other)), CAR, other_size, 0.5)


@pytest.mark.parametrize(
    ("dx", "dy", "dvx", "dvy", "heading", "time"),
    [
        (24.5, 0.0, -10.0, 0.0, 0.0, 2.0),  # rear end: 20 m of gap at 10 m/s
        (24.5, 0.0, 0.0, 0.0, 0.0, math.inf),  # the same speed
        (24.5, 0.0, 10.0, 0.0, 0.0, math.inf),  # opening
        (24.5, 3.5, -10.0, 0.0, 0.0, math.inf),  # the next lane
        (0.0, 3.8, 0.0, -0.5, 0.0, 4.0),  # drifting together: 2 m at 0.5 m/s
        (3.0, 0.0, -1.0, 0.0, 0.0, 0.0),  # touching already
        (13.15, -10.0, -10.0, 5.0, math.pi / 2, 1.37),  # crossing: 10 = 0.9 + 2.25 + 6.85 m at 5 m/s
    ],
)
def test_straight_contact_by_hand(dx: float, dy: float, dvx: float, dvy: float, heading: float, time: float) -> None:
    standing = [[0.0, 0.0, 0.0, 0.0]] * 2
    at = EdgeProjections.from_pair(pair_of(standing, [[dx, dy, 0.0, heading]] * 2))
    moving = at.with_motion(*(np.full(2, each) for each in (dx, dy, dvx, dvy)))
    np.testing.assert_allclose(straight_contact_time_s(moving), time, atol=1e-9)
    np.testing.assert_allclose(accelerated_contact_time_s(moving, np.zeros(2), np.zeros(2)), time, atol=1e-9)


@pytest.mark.parametrize(
    ("gap", "speed", "accel", "time"),
    [
        (20.0, 0.0, -10.0, 2.0),  # 10 t^2 / 2 = 20
        (20.0, -15.0, 5.0, 2.0),  # 15 t - 5 t^2 / 2 = 20
        (20.0, -10.0, 5.0, math.inf),  # stands after 10 m
        (20.0, 5.0, -10.0, (5.0 + math.sqrt(425.0)) / 10.0),  # goes away first
    ],
)
def test_accelerated_contact_by_hand(gap: float, speed: float, accel: float, time: float) -> None:
    at = EdgeProjections.from_pair(pair_of([[0.0, 0.0, 0.0, 0.0]] * 2, [[gap + 4.5, 0.0, speed, 0.0]] * 2))
    np.testing.assert_allclose(accelerated_contact_time_s(at, np.full(2, accel), np.zeros(2)), time, atol=1e-9)


def test_accelerated_contact_against_a_grid_of_time() -> None:
    rng = np.random.default_rng(3)
    n, time = 300, np.arange(0.0, 12.0, STEP_S)
    rows = [
        np.column_stack([rng.uniform(-15, 15, (n, 2)), rng.uniform(-2, 15, n), rng.uniform(-4, 4, n)]).tolist()
        for _ in range(2)
    ]
    pair = pair_of(rows[0], rows[1], TRUCK)
    at, accel = pair.other_in_host_axes, rng.normal(0.0, 3.0, (2, n))
    found = accelerated_contact_time_s(EdgeProjections.from_pair(pair), *accel)
    n_hits = 0
    for k in range(n):
        x, y = (
            place[k] + speed[k] * time + 0.5 * a[k] * time**2
            for place, speed, a in ((at.x_m, at.vx_mps, accel[0]), (at.y_m, at.vy_mps, accel[1]))
        )
        turn = np.full(len(time), math.atan2(at.sin_turn[k], at.cos_turn[k]))
        margin = outline_separation_m(x, y, np.zeros(len(time)), turn, CAR, TRUCK)
        if (margin <= 0.0).any():
            n_hits += 1
            assert time[(margin <= 0.0).argmax()] - STEP_S <= found[k] <= time[(margin <= 0.0).argmax()]
        else:
            assert found[k] > time[-1] or margin.min() < 1e-3
    assert 50 < n_hits < 250
