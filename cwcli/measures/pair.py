"""What really happened between two cars: their relative motion from the tracks, and its criticality measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.measures.outlines import Size, outline_distance, overlap_margin, time_to_contact
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

PET_LIMIT_S = 5.0
PET_STEP_S = 0.1
OUTLINE_RANGE_M = 100.0  # outlines are compared within this centre distance

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class ActualTrack:
    """What a vehicle really did, for the scores.

    Attributes:
        stamp_ns: Shape (n,), strictly increasing.
        state: Shape (n, >= 4): x_m, y_m, speed_mps, heading_rad first.
    """

    stamp_ns: Int64Array
    state: FloatArray


@dataclass(frozen=True)
class Motion:
    """Relative motion at the host's stamps, each (n,); NaN where a track has no data.

    Attributes:
        stamp_ns: Shape (n,).
        distance_m: Centre distance.
        gap_m: Distance of the outlines, negative where they overlap; NaN beyond 100 m of centre distance.
        ttc_s: Time to contact of the outlines if both kept velocity and heading; infinity if never.
        drac_mps2: Deceleration that would have avoided contact: closing speed^2 / (2 gap), 0 when not closing.
    """

    stamp_ns: Int64Array
    distance_m: FloatArray
    gap_m: FloatArray
    ttc_s: FloatArray
    drac_mps2: FloatArray


def interpolate(track: ActualTrack, at_ns: Int64Array, max_gap_s: float) -> FloatArray:
    """x, y, speed, heading at the given times, (n, 4); NaN outside the track and inside gaps above `max_gap_s`."""
    out = np.full((len(at_ns), 4), np.nan)
    stamp = track.stamp_ns
    if len(stamp) < 2:
        return out
    values = track.state[:, :4].copy()
    values[:, 3] = np.unwrap(values[:, 3])
    after = np.clip(np.searchsorted(stamp, at_ns), 1, len(stamp) - 1)
    gap_ns = stamp[after] - stamp[after - 1]
    known = (at_ns >= stamp[0]) & (at_ns <= stamp[-1]) & (gap_ns <= max_gap_s * NS_PER_S)
    known |= (at_ns == stamp[after]) | (at_ns == stamp[after - 1])  # on a point nothing is interpolated
    share = ((at_ns - stamp[after - 1]) / gap_ns)[:, None]
    found = values[after - 1] + share * (values[after] - values[after - 1])
    out[known] = found[known]
    return out


def relative_motion(
    host: ActualTrack, other: ActualTrack, *, max_gap_s: float, host_size: Size, other_size: Size
) -> Motion:
    """Distances and measures at the host's stamps."""
    own = host.state[:, :4]
    theirs = interpolate(other, host.stamp_ns, max_gap_s)
    dx, dy = theirs[:, 0] - own[:, 0], theirs[:, 1] - own[:, 1]
    distance = np.hypot(dx, dy)
    n = len(distance)
    gap, ttc, drac = np.full(n, np.nan), np.full(n, np.inf), np.zeros(n)
    ttc[np.isnan(distance)] = drac[np.isnan(distance)] = np.nan
    near = np.flatnonzero(distance <= OUTLINE_RANGE_M)
    dx, dy, own, theirs = dx[near], dy[near], own[near], theirs[near]
    dvx = theirs[:, 2] * np.cos(theirs[:, 3]) - own[:, 2] * np.cos(own[:, 3])
    dvy = theirs[:, 2] * np.sin(theirs[:, 3]) - own[:, 2] * np.sin(own[:, 3])
    gap[near] = outline_distance(dx, dy, own[:, 3], theirs[:, 3], host_size, other_size)
    ttc[near] = time_to_contact(dx, dy, dvx, dvy, own[:, 3], theirs[:, 3], host_size, other_size)
    with np.errstate(divide="ignore", invalid="ignore"):
        closing = -(dx * dvx + dy * dvy) / distance[near]
        needed = closing**2 / (2.0 * gap[near])
    # only a pair on the way to contact needs to brake at all
    brakes = (closing > 0.0) & np.isfinite(ttc[near])
    drac[near] = np.where(brakes, np.where(gap[near] > 0.0, needed, np.inf), 0.0)
    return Motion(host.stamp_ns, distance, gap, ttc, drac)


def post_encroachment_time(
    host: ActualTrack, other: ActualTrack, *, max_gap_s: float, host_size: Size, other_size: Size
) -> float:
    """Smallest time between one car leaving a spot and the other entering it, seconds, in steps of 0.1 s.

    It is the smallest lag at which the outline of one, taken that much later, overlaps the outline of the other: 0
    for a collision, NaN if none is found within 5 s. For a follower it is the time gap to the car ahead.
    """
    first = max(int(host.stamp_ns[0]), int(other.stamp_ns[0]))
    last = min(int(host.stamp_ns[-1]), int(other.stamp_ns[-1]))
    if last <= first:
        return float("nan")
    step_ns = round(PET_STEP_S * NS_PER_S)
    at_ns = np.arange(first, last + 1, step_ns)
    own, theirs = (interpolate(track, at_ns, max_gap_s) for track in (host, other))
    reach = 0.5 * (np.hypot(*host_size) + np.hypot(*other_size))
    for lag in range(min(round(PET_LIMIT_S / PET_STEP_S), len(at_ns) - 1) + 1):
        for early, late, early_size, late_size in (
            (own, theirs, host_size, other_size),
            (theirs, own, other_size, host_size),
        ):
            before, after = early[: len(early) - lag], late[lag:]
            dx, dy = after[:, 0] - before[:, 0], after[:, 1] - before[:, 1]
            near = np.flatnonzero(dx**2 + dy**2 <= reach**2)
            if not len(near):
                continue
            margin = overlap_margin(dx[near], dy[near], before[near, 3], after[near, 3], early_size, late_size)
            if (margin <= 0.0).any():
                return lag * PET_STEP_S
    return float("nan")
