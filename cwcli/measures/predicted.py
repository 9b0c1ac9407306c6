"""First overlap of the outlines along paths of constant speed and yaw rate."""

from __future__ import annotations

import numpy as np

from cwcli.measures.outlines import outline_separation_by_directions_m
from cwcli.measures.pair import Pair, SecondsAtStamps

HORIZON_S = 5.0
"""Time ahead within which overlaps are searched, s. Chosen by hand; not fitted."""
STEP_S = 0.1
"""Step of the paths, s. Chosen by hand."""


def first_overlap_time_s(pair: Pair) -> SecondsAtStamps:
    """Time (s) of the first overlap in the rows `near`, (m,), linear between the steps; NaN if beyond `HORIZON_S`."""
    at, own_m, their_m = pair.other_in_host_axes, pair.host_size, pair.other_size
    found = np.full(len(at.x_m), np.nan)
    radius = 0.5 * (np.hypot(*own_m) + np.hypot(*their_m))
    fastest = np.abs(at.host_speed_mps) + np.abs(at.other_speed_mps)
    rows = np.flatnonzero(np.hypot(at.x_m, at.y_m) <= radius + HORIZON_S * fastest)
    # Complex numbers are places and directions in the host's axes at the start; a product turns.
    rates = [pair.host_accel_yaw_rate_jerk[pair.near_rows[rows], 1], pair.other_derivatives[pair.near_rows[rows], 1]]
    headings = [np.ones(len(rows), complex), (at.cos_turn + 1j * at.sin_turn)[rows]]
    speeds = [at.host_speed_mps[rows], at.other_speed_mps[rows]]
    places = [np.zeros(len(rows), complex), (at.x_m + 1j * at.y_m)[rows]]
    turns = [np.exp(1j * rate * STEP_S) for rate in rates]
    chords = [v * STEP_S * np.sinc(0.5 * rate * STEP_S / np.pi) for v, rate in zip(speeds, rates, strict=True)]
    chords = [chord * np.exp(0.5j * rate * STEP_S) for chord, rate in zip(chords, rates, strict=True)]
    before = np.full(len(rows), np.inf)
    for step in range(round(HORIZON_S / STEP_S) + 1):
        apart = places[1] - places[0]
        close = np.flatnonzero(apart.real**2 + apart.imag**2 <= (radius + STEP_S * fastest[rows]) ** 2)
        now = np.full(len(rows), np.inf)
        if len(close):
            own, theirs = ((heading.real[close], heading.imag[close]) for heading in headings)
            now[close] = outline_separation_by_directions_m(
                apart.real[close], apart.imag[close], own, theirs, own_m, their_m
            )
            hits = close[(now[close] <= 0.0) & np.isnan(found[rows[close]])]
            with np.errstate(invalid="ignore"):
                share = np.where(np.isfinite(before[hits]), now[hits] / (now[hits] - before[hits]), 0.0)
            found[rows[hits]] = STEP_S * (step - share)
        before = now
        places = [place + heading * chord for place, heading, chord in zip(places, headings, chords, strict=True)]
        headings = [heading * turn for heading, turn in zip(headings, turns, strict=True)]
    return found
