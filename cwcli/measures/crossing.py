"""Two straight paths that cross: when each outline is in the area that both sweep, at constant speeds."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2
from cwcli.measures.pair import Pair, PairNumber, SecondsAtStamps

MIN_CROSSING_SINE = 0.5
"""Smallest sine of the angle between the paths: below 30 degrees vehicles merge or follow, rather than cross."""
MIN_CROSSING_SPEED_MPS = 0.1
"""Speed in m/s below which a vehicle counts as standing and reaches no crossing. Chosen by hand; not fitted."""


class StraightCrossing:
    """Times at the crossing in the rows `near` of a pair, each (m,); NaN where the paths do not cross.

    Attributes:
        host_arrival_s, other_arrival_s: Arrival of the centres at the crossing of the paths.
        host_entry_s, host_exit_s, other_entry_s, other_exit_s: Entry of the outlines into the area, and exit.
        is_crossing_ahead: The paths cross, both move forwards, and neither has left the area.
    """

    def __init__(self, pair: Pair) -> None:
        at = pair.other_in_host_axes
        (length, width), (their_length, their_width) = pair.host_size, pair.other_size
        own, theirs = at.host_speed_mps, at.other_speed_mps
        cross = (
            (np.abs(at.sin_turn) > MIN_CROSSING_SINE)
            & (own > MIN_CROSSING_SPEED_MPS)
            & (theirs > MIN_CROSSING_SPEED_MPS)
        )
        own, theirs, turn = (np.where(cross, values, np.nan) for values in (own, theirs, at.sin_turn))
        cosine, sine = np.abs(at.cos_turn), np.abs(turn)
        other_way = -at.y_m / turn
        host_way = at.x_m + other_way * at.cos_turn
        # A strip of width w, cut by another of width u under the angle, is (u + w |cos|) / |sin| long.
        host_half = 0.5 * (length + (their_width + width * cosine) / sine)
        other_half = 0.5 * (their_length + (width + their_width * cosine) / sine)
        self.host_arrival_s, self.other_arrival_s = host_way / own, other_way / theirs
        self.host_entry_s, self.host_exit_s = (host_way - host_half) / own, (host_way + host_half) / own
        self.other_entry_s, self.other_exit_s = (other_way - other_half) / theirs, (other_way + other_half) / theirs
        self.is_crossing_ahead = cross & (self.host_exit_s > 0.0) & (self.other_exit_s > 0.0)


def predicted_post_encroachment_time(pair: Pair) -> SecondsAtStamps:
    """Predicted post-encroachment time (s) at each stamp, (n,); 0 where both would be in the area at once."""
    at = StraightCrossing(pair)
    gap = np.maximum(at.host_entry_s - at.other_exit_s, at.other_entry_s - at.host_exit_s)
    return pair.expand_near_rows_to_all_rows(np.where(at.is_crossing_ahead, np.maximum(gap, 0.0), np.nan))


PPET = Measure(
    summary="post-encroachment time at constant speeds",
    symbol="PPET",
    column="ppet_s",
    critical="low",
    formula=(
        "max(t_entry,e - t_exit,o, t_entry,o - t_exit,e, 0) of the area that both outlines sweep, straight on at "
        "constant speeds"
    ),
    source="Allen, Shin and Cooper 1978; SUMO device.ssm",
    compute=predicted_post_encroachment_time,
    threshold=1.0,
    threshold_source="cwcli; SUMO reports from 2 s",
    undefined="the ways cross under less than 30 degrees, or one has left the area, or stands",
    misleads="for a vehicle that brakes before the crossing",
    is_pointwise=True,
)


def gap_time(pair: Pair) -> SecondsAtStamps:
    """Time (s) between both arrivals at the crossing, at each stamp, (n,); NaN where no crossing is ahead."""
    at = StraightCrossing(pair)
    return pair.expand_near_rows_to_all_rows(
        np.where(at.is_crossing_ahead, np.abs(at.host_arrival_s - at.other_arrival_s), np.nan)
    )


GAP_TIME = Measure(
    summary="time between both arrivals at the crossing of their ways",
    symbol="GT",
    column="gap_time_s",
    critical="low",
    formula="|s_e / v_e - s_o / v_o|, s the way of a centre to the crossing of the two straight ways",
    source="Allen, Shin and Cooper 1978, for the centres",
    compute=gap_time,
    undefined="the ways cross under less than 30 degrees, or one is past the crossing, or stands",
    misleads="for a vehicle that turns off before the crossing",
    is_pointwise=True,
)


PRI_REACTION_TIME_S = 1.0
"""Reaction time of the host's driver, s, which the definition of PRI leaves open. Chosen: that of MDRAC."""


def pedestrian_risk_index_of_pair_m2(pair: Pair) -> PairNumber:
    """Pedestrian risk index (m^2) of the pair, (): 0 if the host could always stop, or always was first."""
    at = StraightCrossing(pair)
    if not at.is_crossing_ahead.any():
        return np.array(np.nan)
    rows = np.flatnonzero(at.is_crossing_ahead)
    speed_mps, host_s = pair.other_in_host_axes.host_speed_mps[rows], at.host_entry_s[rows]
    stop_s = PRI_REACTION_TIME_S + speed_mps / CAR_BRAKING_LIMIT_MPS2
    braking_m = speed_mps * np.maximum(host_s - PRI_REACTION_TIME_S, 0.0)
    impact_m2ps2 = np.maximum(speed_mps**2 - 2.0 * CAR_BRAKING_LIMIT_MPS2 * braking_m, 0.0)
    is_conflict = (np.maximum(at.other_entry_s[rows], 0.0) < host_s) & (host_s < stop_s)
    weights_s = pair.stamp_weights_s[pair.near_rows][rows]
    return np.array((weights_s * np.where(is_conflict, impact_m2ps2 * (stop_s - host_s), 0.0)).sum())


PRI = Measure(
    summary="energy of hitting another that crosses, by how much too late the host could stop",
    symbol="PRI",
    column="pri_m2",
    critical="high",
    formula=(
        "sum of v_i^2 (t_s - t_entry,e) dt where max(t_entry,o, 0) < t_entry,e < t_s, with the area of PPET, t_s = t_r "
        "+ v_e / a, v_i^2 = max(v_e^2 - 2 a v_e max(t_entry,e - t_r, 0), 0), with a = 11.5 m/s^2, t_r = 1 s"
    ),
    source="Cafiso et al. 2011, as given by Westhofen et al. 2023 (criticality-metrics.readthedocs.io, PRI)",
    compute=pedestrian_risk_index_of_pair_m2,
    is_series=False,
    is_symmetric=False,
    undefined="their ways never crossed ahead of both under at least 30 degrees",
    misleads="for two that cross twice, which it adds up; its area is what the outlines sweep, not a marked crossing",
)
