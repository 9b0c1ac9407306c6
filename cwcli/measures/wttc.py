"""Worst time to collision: the earliest contact if both accelerate as hard as they can in any direction."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, SecondsAtStamps

WORST_ACCEL_MPS2 = 11.5
"""Largest acceleration of each vehicle in any direction (CommonRoad vehicle 2, see `limits.CAR_BRAKING_LIMIT_MPS2`)."""
N_TIME_STEPS = 24
"""Number of steps of the iteration that solves for the time. Chosen by hand."""


def worst_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Worst time to collision (s) at each stamp, (n,).

    It solves |r + v t| = R + A t^2 / 2. Each step goes as far as would be safe if the centres closed with all of their
    relative speed from there on, so that no earlier contact is passed over.
    """
    at = pair.relative_motion
    radius = sum(np.hypot(length / 6.0, width / 2.0) for length, width in (pair.host_size, pair.other_size))
    together = 2.0 * WORST_ACCEL_MPS2
    speed = np.hypot(at.dvx_mps, at.dvy_mps)
    time = np.zeros(len(speed))
    for _ in range(N_TIME_STEPS):
        apart = np.hypot(at.dx_m + at.dvx_mps * time, at.dy_m + at.dvy_mps * time)
        left = np.maximum(apart - radius + speed * time, 0.0)
        time = np.maximum((np.sqrt(speed**2 + 2.0 * together * left) - speed) / together, time)
    return pair.expand_to_all_rows(time)


MEASURE = Measure(
    summary="time until contact if both accelerate towards it as hard as possible",
    symbol="WTTC",
    column="wttc_s",
    critical="low",
    formula=(
        "least t >= 0 with |r + v t| = r_e + r_o + (a + a) t^2 / 2, a = 11.5 m/s^2, r^2 = (length / 6)^2 + (width / "
        "2)^2"
    ),
    source="Wachenfeld et al. 2016, with the middle of CommonRoad-CriMe's three discs of each vehicle",
    compute=worst_time_to_collision,
    undefined="the centres are more than 200 m apart",
    misleads="for two vehicles that pass each other on any road: it finds candidates, not conflicts",
    is_pointwise=True,
)
