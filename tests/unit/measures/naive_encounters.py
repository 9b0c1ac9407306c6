"""Plain twins of `cwcli.kernels.encounters`: whole arrays, and complex numbers as places and directions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.measures.outlines import LengthAndWidthM, outline_separation_by_directions_m

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


def accelerated_contact_time(centre: FloatArray, speed: FloatArray, reach: FloatArray, bend: FloatArray) -> FloatArray:
    """Seconds until contact at constant acceleration from (4, m) each, (m,): infinity if never."""
    bend = np.where(np.abs(bend) < 1e-9, 0.0, bend)
    sign = np.where(bend < 0.0, -1.0, 1.0)
    bend, speed, centre = sign * bend, sign * speed, sign * centre
    speed = np.where(np.abs(speed) < 1e-9, 0.0, speed)
    low, high, _ = interval_below_zero(bend, speed, centre - reach)
    out, back, leaves = interval_below_zero(bend, speed, centre + reach)
    first_end = np.where(leaves, out, high)
    second = np.where(leaves, back, np.inf)
    time = np.zeros(centre.shape[1:])
    for _ in range(centre.shape[0] * 2 + 1):
        wait = np.where(
            time <= first_end, np.maximum(low, time), np.where(time <= high, np.maximum(second, time), np.inf)
        )
        later = wait.max(axis=0)
        if not (later > time).any():
            break
        time = later
    return time


def interval_below_zero(
    bend: FloatArray, slope: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """The interval of t in which start + slope t + bend t^2 / 2 <= 0: its ends, and whether it exists."""
    root = slope * slope - 2.0 * bend * start
    still = (bend == 0.0) & (slope == 0.0)
    exists = np.where(still, start <= 0.0, root >= 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        larger = -(slope + np.copysign(np.sqrt(np.maximum(root, 0.0)), slope))
        one, two = larger / bend, 2.0 * start / larger
    one = np.where(larger == 0.0, 0.0, one)
    two = np.where(larger == 0.0, 0.0, two)
    low, high = np.minimum(one, two), np.maximum(one, two)
    low, high = np.where(still, -np.inf, low), np.where(still, np.inf, high)
    return np.where(exists, low, np.inf), np.where(exists, high, -np.inf), exists


def overlap_time_along_arcs(
    place: ComplexArray,
    direction: ComplexArray,
    chords: ComplexArray,
    turns: ComplexArray,
    sizes: tuple[LengthAndWidthM, LengthAndWidthM],
    n_steps: int,
    step_s: float,
) -> FloatArray:
    """Seconds until two outlines overlap, from (m,), (m,), (2, m) and (2, m), linear between steps; NaN if never."""
    found, before = np.full(len(place), np.nan), np.full(len(place), np.inf)
    places, headings = [0.0 * place, place], [np.ones(len(place), complex), direction]
    for step in range(n_steps + 1):
        apart = places[1] - places[0]
        own, theirs = ((heading.real, heading.imag) for heading in headings)
        now = outline_separation_by_directions_m(apart.real, apart.imag, own, theirs, *sizes)
        hits = (now <= 0.0) & np.isnan(found)
        share = np.where(np.isfinite(before), now / (now - before), 0.0)
        found[hits] = (step_s * (step - share))[hits]
        before = now
        places = [place + heading * chord for place, heading, chord in zip(places, headings, chords, strict=True)]
        headings = [heading * turn for heading, turn in zip(headings, turns, strict=True)]
    return found


def rows_of_least_lag(
    poses: FloatArray, sizes: tuple[LengthAndWidthM, LengthAndWidthM], n_lags: int
) -> tuple[int, int]:
    """The first rows of poses (8, g) that overlap at the least lag, the other's later ones first; (-1, -1) if none."""
    n = poses.shape[1]
    for lag in range(n_lags):
        for mine, them in dict.fromkeys([(0, lag), (lag, 0)]):
            own, theirs = poses[:4, mine : mine + n - lag], poses[4:, them : them + n - lag]
            apart = outline_separation_by_directions_m(
                theirs[0] - own[0], theirs[1] - own[1], (own[2], own[3]), (theirs[2], theirs[3]), *sizes
            )
            rows = np.flatnonzero(apart <= 0.0)
            if len(rows):
                return mine + int(rows[0]), them + int(rows[0])
    return -1, -1
