"""Vehicles that change their ids stay one: pseudonyms joined by motion.

A V2X station takes a new random id every few minutes (SAE J2945/1, ETSI TS 102 867). An id that ends and one that
begins soon after belong to one vehicle where the first one's motion leads to the second one's first message, where both
say the same size, and where nothing else that began or ended there comes near as likely. Two that could be either stay
apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import lap
import numpy as np

from cwcli.errors import UsageError
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import FloatArray, Int64Array, Strings
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.quality import BoolArray
from cwcli.signals.units import NS_PER_S

MAX_PAUSE_S = 3.0
"""Between the last message of an id and the first one of the next: messages come ten times a second, and a station that
changes its id may be silent for a while.
"""
MOST_DISTANCE = 18.5
"""Chi-square quantile of 0.999 with four degrees of freedom (east, north, speed, heading)."""
LEAST_ODDS = 13.8
"""By how much the squared distances of every other pairing must be greater: a likelihood ratio of 1000."""
POSITION_SIGMA_M = 1.5
"""Of messages that don't say it: what receivers with correction signals have."""
SPEED_SIGMA_MPS, HEADING_SIGMA_RAD = 0.5, np.deg2rad(3.0)
MANOEUVRE_MPS2 = 2.0
"""One sigma of an acceleration that the message does not have, along and across."""
ACCEL_SIGMA_MPS2, JERK_MPS3 = 0.5, 1.5
"""One sigma of one that it has, with its delay, and of how it changes during the pause."""
LEAST_TURNING_MPS = 1.0
"""Slower than this a heading says little: senders keep the last one at standstill."""
SAME_SIZE_M = 0.2
NEVER = 1e9
"""A finite cost, as the solver needs."""

MOST_IDS = 4000
"""Each is held against each other: 170 bytes a pair."""


@dataclass(frozen=True)
class Stitched:
    """Messages with joined ids.

    Attributes:
        signal: The messages; a vehicle has the id that it had first.
        joined: Pairs of an id that ended and the one that followed.
        n_undecided: Ids that ended where several could follow, or the other way round.
    """

    signal: RemoteSignal
    joined: tuple[tuple[str, str], ...]
    n_undecided: int


@dataclass(frozen=True)
class _Ends:
    """One message of each id, its first or its last; every array has a row for each id."""

    stamp_ns: Int64Array
    x_m: FloatArray
    y_m: FloatArray
    speed_mps: FloatArray
    heading_rad: FloatArray
    accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    variance_m2: FloatArray
    length_m: FloatArray
    width_m: FloatArray


def stitch(signal: RemoteSignal, local_map: LocalMap | None) -> Stitched:
    """Join the ids of vehicles that changed theirs.

    Args:
        signal: Messages of all vehicles.
        local_map: Where they drive; None where the signal is Cartesian.

    Raises:
        UsageError: There are more than `MOST_IDS`.
    """
    used, station_of = np.unique(signal.station.codes, return_inverse=True)
    names = [signal.station.values[code] for code in used]
    n = len(names)
    if n > MOST_IDS:
        raise UsageError(
            f"{n} ids are too many to be joined, more than {MOST_IDS}", hint="take less of the log: --start, --end"
        )
    order = np.lexsort((signal.stamp_ns, station_of))
    codes = station_of[order]
    first = order[np.searchsorted(codes, np.arange(n))]
    last = order[np.searchsorted(codes, np.arange(n), side="right") - 1]
    distance = _distances(_ends(signal, last, local_map), _ends(signal, first, local_map))
    follower, n_undecided = _decided(distance)
    root = np.arange(n, dtype=np.int32)
    ended = np.flatnonzero(follower >= 0)
    for k in ended[np.argsort(signal.stamp_ns[last[ended]], kind="stable")]:
        root[follower[k]] = root[k]
    kept, codes_of = np.unique(root, return_inverse=True)
    station = Strings(codes_of.astype(np.int32)[station_of], tuple(names[k] for k in kept))
    joined = tuple((names[k], names[follower[k]]) for k in ended)
    return Stitched(replace(signal, station=station), joined, n_undecided)


def _ends(signal: RemoteSignal, rows: Int64Array, local_map: LocalMap | None) -> _Ends:
    if local_map is not None:
        altitude_m = np.nan_to_num(signal.altitude_m[rows], nan=0.0)
        x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg[rows], signal.longitude_deg[rows], altitude_m)
    else:
        assert signal.x_m is not None
        assert signal.y_m is not None
        x_m, y_m = signal.x_m[rows], signal.y_m[rows]
    said_m2 = signal.position_covariance_m2[rows]
    variance_m2 = np.where(np.isfinite(said_m2).all(axis=1), 0.5 * (said_m2[:, 0] + said_m2[:, 2]), POSITION_SIGMA_M**2)
    return _Ends(
        signal.stamp_ns[rows],
        x_m,
        y_m,
        signal.speed_mps[rows],
        signal.heading_rad[rows],
        signal.accel_mps2[rows],
        signal.yaw_rate_radps[rows],
        variance_m2,
        signal.length_m[rows],
        signal.width_m[rows],
    )


def _distances(last: _Ends, first: _Ends) -> FloatArray:
    """Squared distance between where each id would be and each id that begins, shape (n, n); infinite for no pair.

    The motion during the pause is that of the last message, with its acceleration and yaw rate. Without a speed or a
    heading at both ends nothing says where it leads.
    """
    pause_s = (first.stamp_ns[None, :] - last.stamp_ns[:, None]) / NS_PER_S
    accel, yaw_rate = np.nan_to_num(last.accel_mps2)[:, None], np.nan_to_num(last.yaw_rate_radps)[:, None]
    speed = last.speed_mps[:, None] + accel * pause_s
    speed = np.where(speed * np.sign(last.speed_mps)[:, None] >= 0.0, speed, 0.0)  # it stops, and does not turn back
    mean_speed = 0.5 * (last.speed_mps[:, None] + speed)
    turned = yaw_rate * pause_s
    heading = last.heading_rad[:, None] + 0.5 * turned
    east, north = (np.subtract.outer(from_m, to_m).T for from_m, to_m in ((first.x_m, last.x_m), (first.y_m, last.y_m)))
    along = east * np.cos(heading) + north * np.sin(heading) - mean_speed * pause_s
    across = north * np.cos(heading) - east * np.sin(heading)
    said_m2 = last.variance_m2[:, None] + first.variance_m2[None, :]
    speed_change, along_m = _manoeuvre(last.accel_mps2, pause_s)
    turning, across_m = _manoeuvre(last.yaw_rate_radps, pause_s)
    speed_variance = 2.0 * SPEED_SIGMA_MPS**2 + speed_change**2
    heading_variance = 2.0 * HEADING_SIGMA_RAD**2 + (turning / np.maximum(np.abs(mean_speed), LEAST_TURNING_MPS)) ** 2
    across_m = np.hypot(across_m, mean_speed * pause_s * HEADING_SIGMA_RAD)
    heading_error = wrap_angle(first.heading_rad[None, :] - last.heading_rad[:, None] - turned)
    is_slow = np.minimum(np.abs(mean_speed), np.abs(first.speed_mps[None, :])) < LEAST_TURNING_MPS
    squared = (
        along**2 / (said_m2 + along_m**2)
        + across**2 / (said_m2 + across_m**2)
        + (first.speed_mps[None, :] - speed) ** 2 / speed_variance
        + np.where(is_slow, 0.0, heading_error**2 / heading_variance)
    )
    can_follow = (pause_s > 0.0) & (pause_s <= MAX_PAUSE_S) & np.isfinite(squared)
    can_follow &= _is_same(last.length_m, first.length_m) & _is_same(last.width_m, first.width_m)
    return np.where(can_follow, squared, np.inf)


def _manoeuvre(known: FloatArray, pause_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One sigma of the speed and of the way that a manoeuvre during the pause makes, along or across, both (n, n).

    Args:
        known: Shape (n,), the acceleration or yaw rate of each last message, NaN where it has none.
        pause_s: Shape (n, n).
    """
    is_known = np.isfinite(known)[:, None]
    accel = np.where(is_known, ACCEL_SIGMA_MPS2, MANOEUVRE_MPS2)
    jerk = np.where(is_known, JERK_MPS3, 0.0)
    pause = np.maximum(pause_s, 0.0)
    return np.hypot(accel * pause, 0.5 * jerk * pause**2), np.hypot(0.5 * accel * pause**2, jerk * pause**3 / 6.0)


def _is_same(one_m: FloatArray, other_m: FloatArray) -> BoolArray:
    """Whether both sizes agree, or one is not given."""
    differs: BoolArray = np.abs(one_m[:, None] - other_m[None, :]) > SAME_SIZE_M
    return ~differs


def _decided(distance: FloatArray) -> tuple[Int64Array, int]:
    """The follower of each id, -1 without one, and how many have a candidate but no clear one.

    The likeliest pairing of all that ended with all that began, where to be alone costs what can't rival a candidate. A
    pair counts where the likeliest pairing without it is less likely by `LEAST_ODDS`.
    """
    n = len(distance)
    follower = np.full(n, -1, np.int64)
    ended = np.flatnonzero((distance <= MOST_DISTANCE).any(axis=1))
    began = np.flatnonzero((distance <= MOST_DISTANCE).any(axis=0))
    for rows, columns in _groups(distance[np.ix_(ended, began)] <= MOST_DISTANCE + LEAST_ODDS):
        cost = distance[np.ix_(ended[rows], began[columns])]
        best, total = _pairing(cost)
        for row in np.flatnonzero(best >= 0):
            if cost[row, best[row]] > MOST_DISTANCE:
                continue
            without = cost.copy()
            without[row, best[row]] = np.inf
            if _pairing(without)[1] - total >= LEAST_ODDS:
                follower[ended[rows[row]]] = began[columns[best[row]]]
    return follower, len(ended) - int(np.count_nonzero(follower >= 0))


def _groups(is_near: BoolArray) -> list[tuple[Int64Array, Int64Array]]:
    """Rows and columns that have to do with each other, group by group."""
    left = set(range(len(is_near)))
    groups = []
    while left:
        rows, columns = {left.pop()}, set[int]()
        while True:
            columns = set(np.flatnonzero(is_near[sorted(rows)].any(axis=0)).tolist())
            more = set(np.flatnonzero(is_near[:, sorted(columns)].any(axis=1)).tolist()) | rows
            if more == rows:
                break
            rows = more
        left -= rows
        groups.append((np.array(sorted(rows), np.int64), np.array(sorted(columns), np.int64)))
    return groups


def _pairing(cost: FloatArray) -> tuple[Int64Array, float]:
    """The cheapest pairing: for each row its column or -1, and what it costs."""
    n_rows, n_columns = cost.shape
    whole = np.full((n_rows, n_columns + n_rows), MOST_DISTANCE + LEAST_ODDS)
    whole[:, :n_columns] = np.minimum(cost, NEVER)
    total, column, _ = lap.lapjv(whole, extend_cost=True)
    best = np.where(column < n_columns, column, -1)
    return best.astype(np.int64), float(total)
