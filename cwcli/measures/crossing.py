"""Two straight paths that cross: when each outline is in the area that both sweep, at constant speeds."""

from __future__ import annotations

import numpy as np

from cwcli.measures.pair import Pair

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
