"""Times to collision: when the outlines would touch, by how the two are taken to move on."""

from __future__ import annotations

import numpy as np

from cwcli.kernels.encounters import overlap_time_along_arcs
from cwcli.measures.base import Measure
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s, straight_contact_time_s
from cwcli.measures.pair import Pair, SecondsAtStamps
from cwcli.signals.columns import FloatArray


def time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) at each stamp, (n,); NaN off a collision course, and beyond 200 m of centre distance."""
    found = straight_contact_time_s(EdgeProjections.from_pair(pair))
    return pair.expand_near_rows_to_all_rows(np.where(found < np.inf, found, np.nan))


TTC = Measure(
    summary="time to collision of the outlines at constant velocities",
    symbol="TTC",
    column="ttc_s",
    critical="low",
    formula="least t >= 0 at which the rectangles overlap, moved by v_e t and v_o t",
    source="Hayward 1972; ISO 15623",
    compute=time_to_collision,
    note="of the outlines at constant velocities",
    threshold=1.0,
    threshold_source="cwcli; 1.5 s is usual for urban conflicts (van der Horst 1990)",
    undefined="the two are not on a collision course",
    misleads="in curves, where two on their own lanes are on a collision course for a moment; when either brakes",
    is_pointwise=True,
    with_warnings=True,
    clause=lambda threshold: f"the two were {threshold:g} s from contact",
)


def modified_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) at constant accelerations, at each stamp, (n,); NaN if there is none."""
    at = pair.other_in_host_axes
    ax, ay = at.other_accel_mps2
    found = accelerated_contact_time_s(EdgeProjections.from_pair(pair), ax - at.host_accel_mps2, ay)
    return pair.expand_near_rows_to_all_rows(np.where(found < np.inf, found, np.nan))


MTTC = Measure(
    summary="time to collision of the outlines at constant accelerations",
    symbol="MTTC",
    column="mttc_s",
    critical="low",
    formula="least t >= 0 at which the rectangles overlap, moved by v_e t + a_e t^2 / 2 and v_o t + a_o t^2 / 2",
    source="Ozbay et al. 2008; Jansson 2005, eq. 5.24",
    compute=modified_time_to_collision,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="the two are not on a collision course at these accelerations",
    misleads="for a braking car far ahead: the formula lets it drive backwards after it has stopped",
    is_pointwise=True,
)


def potential_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) with a vehicle straight ahead at its deceleration, at each stamp, (n,); NaN if it has none.

    The gap d and its rate d' close at d + d' t - b t^2 / 2 = 0 with the deceleration b of the vehicle ahead, so
    t = (d' + sqrt(d'^2 + 2 b d)) / b; the collection prints the first sign for a positive closing speed. Written as
    2 d / (sqrt(d'^2 + 2 b d) - d') it holds for b = 0, too, and for a vehicle that accelerates away too slowly.
    """
    at = pair.other_in_host_axes
    braking = -at.other_accel_mps2[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.sqrt(at.vx_mps**2 + 2.0 * braking * at.headway_if_straight_ahead_m) - at.vx_mps
        time_s = 2.0 * at.headway_if_straight_ahead_m / rate
    return pair.expand_near_rows_to_all_rows(np.where(at.is_straight_ahead & (rate > 0.0), time_s, np.nan))


PTTC = Measure(
    summary="time to collision with a vehicle ahead at its deceleration and the host's constant speed",
    symbol="PTTC",
    column="pttc_s",
    critical="low",
    formula="(d' + sqrt(d'^2 + 2 b HW)) / b, with d' = v_o - v_e and the deceleration b = -a_o",
    source="Wakabayashi et al. 2003, as given by Westhofen et al. 2023 (criticality-metrics.readthedocs.io, PTTC)",
    compute=potential_time_to_collision,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="nothing is ahead of the host within the width of the two outlines, or the host never reaches it",
    misleads="for a braking car far ahead: the formula lets it drive backwards after it has stopped",
    is_pointwise=True,
)


def inverse_time_to_collision(pair: Pair) -> FloatArray:
    """Closing speed over gap (Hz) of a vehicle straight ahead at each stamp, (n,); infinity in contact."""
    at = pair.other_in_host_axes
    closing_mps = -at.vx_mps
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(closing_mps > 0.0, closing_mps / at.headway_if_straight_ahead_m, 0.0)
    return pair.expand_near_rows_to_all_rows(np.where(at.is_straight_ahead, rate, np.nan))


ITTC = Measure(
    summary="inverse time to collision with a vehicle ahead",
    symbol="1/TTC",
    column="ittc_hz",
    critical="high",
    formula="(v_e - v_o) / HW where the host closes, else 0; infinity in contact",
    source="Hayward 1972, as given by the repository regenesis90/SSM_feasibility (ITTC)",
    compute=inverse_time_to_collision,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="when the one ahead brakes or accelerates",
    is_pointwise=True,
)


def time_to_predicted_collision(pair: Pair) -> SecondsAtStamps:
    """Time to collision (s) along paths of constant speed and yaw rate, at each stamp, (n,); NaN if there is none."""
    return pair.expand_near_rows_to_all_rows(first_overlap_time_s(pair))


TTC_STAR = Measure(
    summary="time to collision along paths of constant speed and yaw rate",
    symbol="TTC*",
    column="ttc_star_s",
    critical="low",
    formula="least t in [0, 5 s] at which the rectangles overlap along their arcs, in steps of 0.1 s, linear between",
    source="CommonRoad-CriMe (Lin and Althoff 2023), on paths of constant speed and yaw rate",
    compute=time_to_predicted_collision,
    threshold=1.0,
    threshold_source="as for TTC",
    undefined="the paths do not meet within 5 s",
    misleads="at the end of a curve, where the yaw rate changes",
    is_pointwise=True,
)


WORST_CASE_ACCEL_MPS2 = 11.5
"""Largest acceleration of each vehicle in any direction (CommonRoad vehicle 2, see `limits.CAR_BRAKING_LIMIT_MPS2`)."""
N_WTTC_ITERATIONS = 24
"""Number of steps of the iteration that solves for the time. Chosen by hand."""


def worst_time_to_collision(pair: Pair) -> SecondsAtStamps:
    """Worst time to collision (s) at each stamp, (n,).

    It solves |r + v t| = R + A t^2 / 2. Each step goes as far as would be safe if the centres closed with all of their
    relative speed from there on, so that no earlier contact is passed over.
    """
    at = pair.relative_motion
    radius = sum(np.hypot(length / 6.0, width / 2.0) for length, width in (pair.host_size, pair.other_size))
    together = 2.0 * WORST_CASE_ACCEL_MPS2
    speed = np.hypot(at.dvx_mps, at.dvy_mps)
    time = np.zeros(len(speed))
    for _ in range(N_WTTC_ITERATIONS):
        distance_m = np.hypot(at.dx_m + at.dvx_mps * time, at.dy_m + at.dvy_mps * time)
        left = np.maximum(distance_m - radius + speed * time, 0.0)
        time = np.maximum((np.sqrt(speed**2 + 2.0 * together * left) - speed) / together, time)
    return pair.expand_near_rows_to_all_rows(time)


WTTC = Measure(
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


ARC_PATH_HORIZON_S = 5.0
"""Time ahead within which overlaps are searched, s. Chosen by hand; not fitted."""
ARC_PATH_STEP_S = 0.1
"""Step of the paths, s. Chosen by hand."""


def first_overlap_time_s(pair: Pair) -> SecondsAtStamps:
    """Time (s) of the first overlap in the rows `near`, (m,), linear between steps; NaN beyond `ARC_PATH_HORIZON_S`."""
    at, own_m, their_m = pair.other_in_host_axes, pair.host_size, pair.other_size
    found = np.full(len(at.x_m), np.nan)
    radius = 0.5 * (np.hypot(*own_m) + np.hypot(*their_m))
    fastest = np.abs(at.host_speed_mps) + np.abs(at.other_speed_mps)
    rows = np.flatnonzero(np.hypot(at.x_m, at.y_m) <= radius + ARC_PATH_HORIZON_S * fastest)
    # complex numbers are places and directions in the host's axes at the start; a product turns
    rates = [pair.host_accel_yaw_rate_jerk[pair.near_rows[rows], 1], pair.other_derivatives[pair.near_rows[rows], 1]]
    speeds = [at.host_speed_mps[rows], at.other_speed_mps[rows]]
    turns = [np.exp(1j * rate * ARC_PATH_STEP_S) for rate in rates]
    chords = [
        v * ARC_PATH_STEP_S * np.sinc(0.5 * rate * ARC_PATH_STEP_S / np.pi) * np.exp(0.5j * rate * ARC_PATH_STEP_S)
        for v, rate in zip(speeds, rates, strict=True)
    ]
    found[rows] = overlap_time_along_arcs(
        np.column_stack([at.x_m[rows], at.y_m[rows]]),
        np.column_stack([at.cos_turn[rows], at.sin_turn[rows]]),
        np.stack(chords).view(np.float64).reshape(2, -1, 2),
        np.stack(turns).view(np.float64).reshape(2, -1, 2),
        radius + ARC_PATH_STEP_S * fastest[rows],
        own_m,
        their_m,
        n_steps=round(ARC_PATH_HORIZON_S / ARC_PATH_STEP_S),
        step_s=ARC_PATH_STEP_S,
    )
    return found
