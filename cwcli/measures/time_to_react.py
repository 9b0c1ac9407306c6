"""Time to brake, to kick down, to steer, and to react: how long the host may wait until a manoeuvre no longer helps.

The pairs are on a collision course. Until the manoeuvre both keep velocity and heading; the other does so afterwards,
too. Each manoeuvre is a constant acceleration, so whether it avoids the contact has a closed form; the latest moment is
found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s, straight_contact_time_s
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2, CAR_LATERAL_LIMIT_MPS2
from cwcli.measures.pair import Pair, SecondsAtStamps
from cwcli.signals.columns import BoolArray, FloatArray

N_REACTION_TIME_BISECTIONS = 10
"""Number of bisections: the result is exact to a thousandth of the time to collision."""
AvoidanceCheck = Callable[[EdgeProjections, FloatArray], BoolArray]
"""A function: pair at the manoeuvre's begin and the host's speed, (m,) -> whether contact is avoided, (m,)."""


def latest_start_of_manoeuvre_s(manoeuvre: tuple[AvoidanceCheck, ...], pair: Pair) -> SecondsAtStamps:
    """Latest start (s) of the best manoeuvre at each stamp, (n,); NaN off a collision course or if none helps."""
    near = pair.near_rows
    ttc = pair.evaluate_measure(TTC)[near]
    rows = np.flatnonzero(ttc > 0.0)
    found = np.full(len(near), np.nan)
    if len(rows):
        start, own = EdgeProjections.from_pair(pair).select_rows(rows), pair.other_in_host_axes.host_speed_mps[rows]
        found[rows] = np.fmax.reduce([_bisect_latest_start_s(evades, start, own, ttc[rows]) for evades in manoeuvre])
    return pair.expand_near_rows_to_all_rows(found)


def _bisect_latest_start_s(
    evades: AvoidanceCheck, start: EdgeProjections, host_mps: FloatArray, ttc_s: FloatArray
) -> FloatArray:
    """Bisect the latest time in [0, ttc_s] from which the manoeuvre avoids contact, (m,); NaN if it never does."""
    low, high = np.zeros(len(ttc_s)), ttc_s.copy()
    helps = evades(start, host_mps)
    for _ in range(N_REACTION_TIME_BISECTIONS):
        middle = 0.5 * (low + high)
        avoided = evades(_advance_straight(start, middle), host_mps)
        low, high = np.where(avoided, middle, low), np.where(avoided, high, middle)
    return np.where(helps, low, np.nan)


def _advance_straight(start: EdgeProjections, time_s: FloatArray) -> EdgeProjections:
    """The pair after both have gone straight on for a time, (m,)."""
    x, y = start.centre_m[:2] + start.speed_mps[:2] * time_s
    return start.with_motion(x, y, *start.speed_mps[:2])


def _braking_avoids_contact(start: EdgeProjections, host_mps: FloatArray) -> BoolArray:
    """Whether full braking avoids contact, (m,): until the host stands; from then on only the other moves."""
    sign, stop_s = np.sign(host_mps), np.abs(host_mps) / CAR_BRAKING_LIMIT_MPS2
    hit = accelerated_contact_time_s(start, sign * CAR_BRAKING_LIMIT_MPS2, np.zeros(len(host_mps))) <= stop_s
    (x, y), (vx, vy) = start.centre_m[:2], start.speed_mps[:2]
    way = vx * stop_s + 0.5 * sign * CAR_BRAKING_LIMIT_MPS2 * stop_s**2
    after_stop = start.with_motion(x + way, y + vy * stop_s, vx + host_mps, vy)
    return ~hit & np.isinf(straight_contact_time_s(after_stop))


def _accelerating_avoids_contact(start: EdgeProjections, host_mps: FloatArray) -> BoolArray:
    """Whether full acceleration avoids contact, (m,)."""
    forward = -CAR_BRAKING_LIMIT_MPS2 * np.where(host_mps < 0.0, -1.0, 1.0)
    return np.isinf(accelerated_contact_time_s(start, forward, np.zeros(len(host_mps))))


def _steering_left_avoids_contact(start: EdgeProjections, host_mps: FloatArray) -> BoolArray:
    """Whether full lateral acceleration to the left avoids contact, (m,)."""
    zero = np.zeros(len(host_mps))
    return np.isinf(accelerated_contact_time_s(start, zero, zero - CAR_LATERAL_LIMIT_MPS2))


def _steering_right_avoids_contact(start: EdgeProjections, host_mps: FloatArray) -> BoolArray:
    """Whether full lateral acceleration to the right avoids contact, (m,)."""
    zero = np.zeros(len(host_mps))
    return np.isinf(accelerated_contact_time_s(start, zero, zero + CAR_LATERAL_LIMIT_MPS2))


def time_to_brake(pair: Pair) -> SecondsAtStamps:
    """Time (s) left to avoid contact by braking, at each stamp, (n,)."""
    return latest_start_of_manoeuvre_s((_braking_avoids_contact,), pair)


def time_to_kick_down(pair: Pair) -> SecondsAtStamps:
    """Time (s) left to avoid contact by accelerating, at each stamp, (n,)."""
    return latest_start_of_manoeuvre_s((_accelerating_avoids_contact,), pair)


def time_to_steer(pair: Pair) -> SecondsAtStamps:
    """Time (s) left to avoid contact by steering to one side, at each stamp, (n,)."""
    return latest_start_of_manoeuvre_s((_steering_left_avoids_contact, _steering_right_avoids_contact), pair)


def time_to_react(pair: Pair) -> SecondsAtStamps:
    """Time (s) left to avoid contact by any manoeuvre, at each stamp, (n,)."""
    return np.fmax(np.fmax(pair.evaluate_measure(TTB), pair.evaluate_measure(TTK)), pair.evaluate_measure(TTS))


TTB = Measure(
    summary="time left to avoid contact by braking",
    symbol="TTB",
    column="ttb_s",
    critical="low",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: a = 11.5 m/s^2 until it stands; the other keeps"
        " velocity and heading"
    ),
    source="Tamke, Dang and Breuel 2011",
    compute=time_to_brake,
    is_symmetric=False,
    undefined="the two are not on a collision course, or the manoeuvre no longer helps (then BTN, STN or TTR say so)",
    misleads="where there is no room, or the road is wet",
    is_pointwise=True,
    is_stepped=True,
)
TTK = replace(
    TTB,
    summary="time left to avoid contact by accelerating",
    symbol="TTK",
    column="ttk_s",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: a = 11.5 m/s^2; the other keeps velocity and "
        "heading"
    ),
    compute=time_to_kick_down,
    undefined="the two are not on a collision course, or the manoeuvre does not help",
)
TTS = replace(
    TTK,
    summary="time left to avoid contact by steering",
    symbol="TTS",
    column="tts_s",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: 8 m/s^2 to the left or the right, the heading "
        "kept; the other keeps velocity and heading"
    ),
    compute=time_to_steer,
)
TTR = replace(
    TTB,
    summary="time left to avoid contact somehow",
    symbol="TTR",
    column="ttr_s",
    formula="max(TTB, TTK, TTS)",
    source="Hillenbrand, Spieker and Kroschel 2006; Tamke, Dang and Breuel 2011",
    compute=time_to_react,
    threshold=0.5,
    threshold_source="cwcli: below it hardly anybody reacts",
    undefined="the two are not on a collision course, or nothing helps any more",
    misleads="as for its parts",
)
