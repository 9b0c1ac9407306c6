"""Probability of a collision over the manoeuvres that the host might make, by samples."""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s
from cwcli.measures.pair import Pair, RatiosAtStamps
from cwcli.signals.columns import FloatArray

CONTACT_HORIZON_S = 3.0
"""Time ahead within which a contact counts, s. Chosen by hand; not fitted."""
RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2 = 2.875
"""Sigma of the host's random accelerations along and across (CommonRoad-CriMe's random manoeuvre: 11.5 / 4)."""
N_RANDOM_MANOEUVRES = 2048
"""Number of manoeuvres; the share of them is the probability. Chosen by hand."""
MOMENTS_PER_BATCH = 8
"""Number of moments in a batch; it bounds the memory. Chosen by hand."""
MAX_ACCEL_NEEDED_FOR_CONTACT_SIGMAS = 4.0
"""Greatest acceleration, in sigmas, that a contact may need; pairs that need more are left out. Chosen by hand."""


def share_of_sampled_manoeuvres_touching(pair: Pair) -> RatiosAtStamps:
    """Share of the sampled manoeuvres that touch the other within the horizon, at each stamp, (n,)."""
    at = pair.other_in_host_axes
    found = np.zeros(len(at.x_m))
    radius = 0.5 * (np.hypot(*pair.host_size) + np.hypot(*pair.other_size))
    way = (
        np.hypot(at.vx_mps, at.vy_mps) * CONTACT_HORIZON_S
        + 0.5 * MAX_ACCEL_NEEDED_FOR_CONTACT_SIGMAS * RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2 * CONTACT_HORIZON_S**2
    )
    rows = np.flatnonzero(np.hypot(at.x_m, at.y_m) <= radius + way)
    whole, accel = EdgeProjections.from_pair(pair), sample_accelerations_mps2()
    for first in range(0, len(rows), MOMENTS_PER_BATCH):
        part = rows[first : first + MOMENTS_PER_BATCH]
        ax, ay = (np.tile(each, len(part)) for each in accel)
        hit = (
            accelerated_contact_time_s(whole.select_rows(np.repeat(part, N_RANDOM_MANOEUVRES)), -ax, -ay)
            <= CONTACT_HORIZON_S
        )
        found[part] = hit.reshape(len(part), N_RANDOM_MANOEUVRES).mean(axis=1)
    return pair.expand_near_rows_to_all_rows(found)


@cache
def sample_accelerations_mps2() -> FloatArray:
    """Sample the host's accelerations along and across, (2, N): normal, evenly spread, symmetric to left and right."""
    k = np.arange(1, N_RANDOM_MANOEUVRES // 2 + 1)
    golden = 1.32471795724474602596  # x^3 = x + 1: the additive sequence that is spread most evenly in two dimensions
    u, v = (k / golden % 1.0, k / golden**2 % 1.0)
    size, angle = RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2 * np.sqrt(-2.0 * np.log(u)), np.pi * v
    ax, ay = size * np.cos(angle), size * np.sin(angle)
    return np.stack([np.concatenate([ax, ax]), np.concatenate([ay, -ay])])


MEASURE = Measure(
    summary="probability of a collision over the manoeuvres that the host might make",
    symbol="P_MC",
    column="p_mc",
    critical="high",
    formula="share of 2048 accelerations of the host, normal with 2.875 m/s^2 along and across, that touch within 3 s",
    source="Broadhurst, Baker and Kanade 2005, with CommonRoad-CriMe's random manoeuvre",
    compute=share_of_sampled_manoeuvres_touching,
    is_symmetric=False,
    undefined="the centres are more than 200 m apart",
    misleads="for vehicles side by side in traffic: no driver manoeuvres at random",
    is_pointwise=True,
    is_stepped=True,
    is_sampled=True,
)
