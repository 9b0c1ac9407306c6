"""The closest encounter of two rectangles that move straight on.

The distance of two convex outlines is a convex function of time while they only move, so it is least at once, where a
corner of one passes a side or a corner of the other, or during contact.
"""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_time import TTC
from cwcli.measures.distances import GAP
from cwcli.measures.pair import MetresAtStamps, Pair, SecondsAtStamps
from cwcli.signals.columns import FloatArray


def time_and_distance_of_closest_encounter(pair: Pair) -> FloatArray:
    """Time (s) and distance (m) of the closest encounter from now on at constant velocities, rows `near`, (2, m).

    The relative motion is seen along the relative velocity: a corner of the difference of the two outlines (a corner of
    one against a corner of the other) is nearest when it passes the origin.
    """
    at, near = pair.other_in_host_axes, pair.near_rows
    ttc = pair.evaluate_measure(TTC)[near]
    speed = np.hypot(at.vx_mps, at.vy_mps)
    best_m = np.maximum(pair.evaluate_measure(GAP)[near], 0.0)
    best_s = np.zeros(len(speed))
    with np.errstate(divide="ignore", invalid="ignore"):
        ux, uy = at.vx_mps / speed, at.vy_mps / speed
    length, width = (0.5 * size for size in pair.host_size)
    their_length, their_width = (0.5 * size for size in pair.other_size)
    along, across = their_length * at.cos_turn, their_length * at.sin_turn
    half_across, ahead = their_width * at.sin_turn, their_width * at.cos_turn
    for far in (-1.0, 1.0):
        for left in (-1.0, 1.0):
            x, y = at.x_m + far * along - left * half_across, at.y_m + far * across + left * ahead
            for own_x in (-length, length):
                for own_y in (-width, width):
                    to_go = -((x - own_x) * ux + (y - own_y) * uy)
                    miss = np.abs((y - own_y) * ux - (x - own_x) * uy)
                    nearer = (to_go > 0.0) & (miss < best_m)
                    best_m = np.where(nearer, miss, best_m)
                    best_s = np.where(nearer, to_go / np.maximum(speed, 1e-9), best_s)
    hits = np.isfinite(ttc)
    best_m, best_s = np.where(hits, 0.0, best_m), np.where(hits, ttc, best_s)
    return np.stack([np.where(speed > 1e-9, best_s, np.nan), best_m])


def time_to_closest_encounter(pair: Pair) -> SecondsAtStamps:
    """Time to the closest encounter (s) at each stamp, (n,)."""
    time_s, _ = pair.compute_once(time_and_distance_of_closest_encounter)
    return pair.expand_near_rows_to_all_rows(time_s)


TTCE = Measure(
    summary="time to the closest encounter at constant velocities",
    symbol="TTCE",
    column="ttce_s",
    critical="low",
    formula="first t >= 0 at which the distance of the rectangles, moved by v_e t and v_o t, is least",
    source="Eggert 2014",
    compute=time_to_closest_encounter,
    undefined="the centres are more than 200 m apart, or nothing moves relative to the other",
    misleads="alone: a short time does not mean a short distance; read it with DCE",
    is_pointwise=True,
)


def distance_of_closest_encounter(pair: Pair) -> MetresAtStamps:
    """Distance (m) of the outlines at their closest encounter, computed at each stamp, (n,)."""
    _, distance_m = pair.compute_once(time_and_distance_of_closest_encounter)
    return pair.expand_near_rows_to_all_rows(distance_m)


DCE = Measure(
    summary="distance of the outlines at the closest encounter",
    symbol="DCE",
    column="dce_m",
    critical="low",
    formula="least distance of the rectangles for t >= 0, moved by v_e t and v_o t; 0 on a collision course",
    source="Eggert 2014",
    compute=distance_of_closest_encounter,
    undefined="the centres are more than 200 m apart",
    misleads="far ahead in time: a small DCE in 20 s means little; read it with TTCE",
    is_pointwise=True,
)
