"""Joining the ids of remote vehicles that change them, by their motion.

A V2X station takes a new random id every few minutes (SAE J2945/1, ETSI TS 102 867). An id that ends and one that
begins soon after belong to one vehicle where the first one's motion leads to the second one's first message, where both
say the same size, and where nothing else that began or ended there comes near as likely. Two that could be either stay
apart.
"""

from __future__ import annotations

from collections.abc import Iterator

import lap
import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array, Strings, select_table_rows
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S

MAX_ID_CHANGE_PAUSE_S = 3.0
"""The longest pause between the last message of an id and the first of the next, in seconds: messages come ten times a
second, and a station may be silent while it changes its id. Chosen by hand."""
MAX_SQUARED_DISTANCE_OF_PAIR_SIGMAS2 = 18.5
"""The largest squared distance of a pair, in its own sigmas: the 0.999 quantile of chi-square with four degrees of
freedom (east, north, speed, heading)."""
MIN_SQUARED_DISTANCE_MARGIN_TO_RIVAL_PAIRING_SIGMAS2 = 13.8
"""The amount by which the squared distances of every other pairing must be greater: a likelihood ratio of 1000."""
DEFAULT_POSITION_SIGMA_M = 1.5
"""The error (one sigma) of a position whose message gives none, in metres: that of receivers with correction signals.
Chosen by hand."""
REPORTED_SPEED_SIGMA_MPS, REPORTED_HEADING_SIGMA_RAD = 0.5, np.deg2rad(3.0)
"""The errors (one sigma) of a reported speed in m/s and heading in rad. Chosen by hand; not fitted."""
UNKNOWN_ACCEL_SIGMA_MPS2 = 2.0
"""The sigma of an acceleration that the message does not give, along and across, in m/s^2. Chosen by hand; not
fitted."""
KNOWN_ACCEL_SIGMA_MPS2, JERK_SIGMA_MPS3 = 0.5, 1.5
"""The sigma of an acceleration that the message gives, with its delay, in m/s^2, and of its change, in m/s^3. Chosen by
hand; not fitted."""
MIN_SPEED_FOR_HEADING_MPS = 1.0
"""The speed in m/s below which a heading says little, because senders freeze it at standstill. Chosen by hand."""
MAX_SIZE_DIFFERENCE_OF_ONE_VEHICLE_M = 0.2
"""The largest difference of lengths or widths of one vehicle, in metres. Chosen by hand; not fitted."""
IMPOSSIBLE_PAIR_COST = 1e9
"""The finite cost of an impossible pair, which the solver needs."""
MAX_SQUARED_DISTANCE_OF_RIVAL_PAIR_SIGMAS2 = (
    MAX_SQUARED_DISTANCE_OF_PAIR_SIGMAS2 + MIN_SQUARED_DISTANCE_MARGIN_TO_RIVAL_PAIRING_SIGMAS2
)
"""The squared distance beyond which a pair can't be followed, nor make another pairing doubtful."""
PAIRS_PER_BLOCK = 1 << 17
"""The number of pairs that are compared at once; they take about 30 MB."""
MAX_COMPARED_ID_PAIRS = 1_000_000_000
"""The largest number of pairs that are compared; more would take minutes. Chosen by hand."""


@dataclass(frozen=True)
class StitchedSignal:
    """A signal in which the changed ids of one vehicle are joined.

    Attributes:
        signal: The messages; a vehicle has the id that it had first.
        joined: Pairs of an id that ended and the one that followed.
        n_undecided: Ids that ended where several could follow, or the other way round.
    """

    signal: RemoteSignal
    joined: tuple[tuple[str, str], ...]
    n_undecided: int


@dataclass(frozen=True)
class _EndMessages:
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

    def select_rows(self, rows: npt.NDArray[np.intp]) -> _EndMessages:
        """Return some of the rows, in this order."""
        return select_table_rows(self, rows)


@dataclass(frozen=True)
class _Candidates:
    """Pairs of an id that ended and one that began where it might be by then, one a row; sorted by the first.

    Attributes:
        ended, began: The ids.
        distance: Squared distance between where the first would be and where the second is.
    """

    ended: Int64Array
    began: Int64Array
    distance: FloatArray


def join_changed_station_ids(signal: RemoteSignal, local_map: LocalMap | None) -> StitchedSignal:
    """Join the ids of vehicles that changed theirs.

    Args:
        local_map: The map for WGS84 positions; None where the signal is Cartesian.

    Raises:
        UsageError: There are more than `MAX_COMPARED_ID_PAIRS`.
    """
    used, station_of = np.unique(signal.station.codes, return_inverse=True)
    names = [signal.station.values[code] for code in used]
    n = len(names)
    order = np.lexsort((signal.stamp_ns, station_of))
    codes = station_of[order]
    first = order[np.searchsorted(codes, np.arange(n))]
    last = order[np.searchsorted(codes, np.arange(n), side="right") - 1]
    found = _find_candidate_pairs(
        _read_end_messages(signal, last, local_map), _read_end_messages(signal, first, local_map)
    )
    follower, n_undecided = _follower_of_each_id_and_unclear_count(found, n)
    root = np.arange(n, dtype=np.int32)
    ended = np.flatnonzero(follower >= 0)
    for k in ended[np.argsort(signal.stamp_ns[last[ended]], kind="stable")]:
        root[follower[k]] = root[k]
    distinct_roots, codes_of = np.unique(root, return_inverse=True)
    station = Strings(codes_of.astype(np.int32)[station_of], tuple(names[k] for k in distinct_roots))
    joined_names = tuple((names[k], names[follower[k]]) for k in ended)
    return StitchedSignal(replace(signal, station=station), joined_names, n_undecided)


def _read_end_messages(signal: RemoteSignal, rows: Int64Array, local_map: LocalMap | None) -> _EndMessages:
    if local_map is not None:
        altitude_m = np.nan_to_num(signal.altitude_m[rows], nan=0.0)
        x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg[rows], signal.longitude_deg[rows], altitude_m)
    else:
        assert signal.x_m is not None
        assert signal.y_m is not None
        x_m, y_m = signal.x_m[rows], signal.y_m[rows]
    said_m2 = signal.position_covariance_m2[rows]
    variance_m2 = np.where(
        np.isfinite(said_m2).all(axis=1), 0.5 * (said_m2[:, 0] + said_m2[:, 2]), DEFAULT_POSITION_SIGMA_M**2
    )
    return _EndMessages(
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


def _find_candidate_pairs(last: _EndMessages, first: _EndMessages) -> _Candidates:
    """Find all pairs whose pause and motion fit; only ids that begin soon enough after an end are compared.

    Raises:
        UsageError: There are more than `MAX_COMPARED_ID_PAIRS` of those.
    """
    by_time = np.argsort(first.stamp_ns, kind="stable")
    stamps = first.stamp_ns[by_time]
    begin = np.searchsorted(stamps, last.stamp_ns, side="right")
    n_after = np.searchsorted(stamps, last.stamp_ns + round(MAX_ID_CHANGE_PAUSE_S * NS_PER_S), side="right") - begin
    if (n_pairs := int(n_after.sum())) > MAX_COMPARED_ID_PAIRS:
        raise UsageError(
            f"{len(stamps)} ids are too many to be joined: {n_pairs} pairs are less than {MAX_ID_CHANGE_PAUSE_S:g} s "
            "apart",
            hint="take less of the log: --start, --end",
        )
    parts = []
    for some in _iter_id_slices_of_limited_pairs(n_after):
        counts = n_after[some]
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        ended = np.repeat(np.arange(some.start, some.stop), counts)
        began = by_time[np.repeat(begin[some], counts) + within]
        distance = _squared_distance_of_each_row_or_inf(last.select_rows(ended), first.select_rows(began))
        is_near = distance <= MAX_SQUARED_DISTANCE_OF_RIVAL_PAIR_SIGMAS2
        parts.append((ended[is_near], began[is_near], distance[is_near]))
    return _Candidates(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _iter_id_slices_of_limited_pairs(counts: Int64Array) -> Iterator[slice]:
    """Yield slices of consecutive ids with about `PAIRS_PER_BLOCK` pairs together, at least one id each."""
    ends, start = np.cumsum(counts), 0
    while start < len(counts):
        before = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, before + PAIRS_PER_BLOCK, side="right")), start + 1)
        yield slice(start, stop)
        start = stop


def _squared_distance_of_each_row_or_inf(last_messages: _EndMessages, first_messages: _EndMessages) -> FloatArray:
    """Return the squared distance between where each id would be and the one that begins, (pairs,); inf for no pair.

    The motion during the pause is that of the last message, with its acceleration and yaw rate. Without a speed or a
    heading at both ends nothing says where it leads.
    """
    pause_s = (first_messages.stamp_ns - last_messages.stamp_ns) / NS_PER_S
    accel, yaw_rate = np.nan_to_num(last_messages.accel_mps2), np.nan_to_num(last_messages.yaw_rate_radps)
    speed = last_messages.speed_mps + accel * pause_s
    speed = np.where(speed * np.sign(last_messages.speed_mps) >= 0.0, speed, 0.0)  # it stops, and does not turn back
    mean_speed = 0.5 * (last_messages.speed_mps + speed)
    turned_angle_rad = yaw_rate * pause_s
    heading = last_messages.heading_rad + 0.5 * turned_angle_rad
    east, north = first_messages.x_m - last_messages.x_m, first_messages.y_m - last_messages.y_m
    along = east * np.cos(heading) + north * np.sin(heading) - mean_speed * pause_s
    across = north * np.cos(heading) - east * np.sin(heading)
    said_m2 = last_messages.variance_m2 + first_messages.variance_m2
    speed_change, along_m = _manoeuvre_speed_and_position_sigmas(last_messages.accel_mps2, pause_s)
    turning, across_m = _manoeuvre_speed_and_position_sigmas(last_messages.yaw_rate_radps, pause_s)
    speed_variance = 2.0 * REPORTED_SPEED_SIGMA_MPS**2 + speed_change**2
    heading_variance = (
        2.0 * REPORTED_HEADING_SIGMA_RAD**2 + (turning / np.maximum(np.abs(mean_speed), MIN_SPEED_FOR_HEADING_MPS)) ** 2
    )
    across_m = np.hypot(across_m, mean_speed * pause_s * REPORTED_HEADING_SIGMA_RAD)
    heading_error = wrap_angle(first_messages.heading_rad - last_messages.heading_rad - turned_angle_rad)
    is_slow = np.minimum(np.abs(mean_speed), np.abs(first_messages.speed_mps)) < MIN_SPEED_FOR_HEADING_MPS
    squared = (
        along**2 / (said_m2 + along_m**2)
        + across**2 / (said_m2 + across_m**2)
        + (first_messages.speed_mps - speed) ** 2 / speed_variance
        + np.where(is_slow, 0.0, heading_error**2 / heading_variance)
    )
    can_follow = (pause_s > 0.0) & (pause_s <= MAX_ID_CHANGE_PAUSE_S) & np.isfinite(squared)
    can_follow &= _sizes_agree_or_unknown_mask(
        last_messages.length_m, first_messages.length_m
    ) & _sizes_agree_or_unknown_mask(last_messages.width_m, first_messages.width_m)
    return np.where(can_follow, squared, np.inf)


def _manoeuvre_speed_and_position_sigmas(
    accel_or_yaw_rate: FloatArray, pause_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sigmas of speed and position that a manoeuvre during the pause causes, along or across, (pairs,) each.

    Args:
        accel_or_yaw_rate: The acceleration or yaw rate of each last message, (pairs,), NaN where it has none.
        pause_s: Shape (pairs,).
    """
    is_known = np.isfinite(accel_or_yaw_rate)
    accel = np.where(is_known, KNOWN_ACCEL_SIGMA_MPS2, UNKNOWN_ACCEL_SIGMA_MPS2)
    jerk = np.where(is_known, JERK_SIGMA_MPS3, 0.0)
    pause = np.maximum(pause_s, 0.0)
    return np.hypot(accel * pause, 0.5 * jerk * pause**2), np.hypot(0.5 * accel * pause**2, jerk * pause**3 / 6.0)


def _sizes_agree_or_unknown_mask(one_m: FloatArray, other_m: FloatArray) -> BoolArray:
    """Return where both sizes agree, or one is not given."""
    differs: BoolArray = np.abs(one_m - other_m) > MAX_SIZE_DIFFERENCE_OF_ONE_VEHICLE_M
    return ~differs


def _follower_of_each_id_and_unclear_count(candidates: _Candidates, n_ids: int) -> tuple[Int64Array, int]:
    """Return the follower of each of n ids, -1 without one, and how many have a candidate but no clear one.

    The likeliest pairing of all that ended with all that began, where to be alone costs what can't rival a candidate. A
    pair counts where the likeliest pairing without it is less likely by the stated margin.
    """
    follower = np.full(n_ids, -1, np.int64)
    is_good = candidates.distance <= MAX_SQUARED_DISTANCE_OF_PAIR_SIGMAS2
    has_ended, has_begun = np.zeros((2, n_ids), np.bool_)
    has_ended[candidates.ended[is_good]] = has_begun[candidates.began[is_good]] = True
    counts = has_ended[candidates.ended] & has_begun[candidates.began]
    ended, began, distance = candidates.ended[counts], candidates.began[counts], candidates.distance[counts]
    is_alone = (np.bincount(ended, minlength=n_ids)[ended] == 1) & (np.bincount(began, minlength=n_ids)[began] == 1)
    is_clear = is_alone & (
        distance <= MAX_SQUARED_DISTANCE_OF_PAIR_SIGMAS2
    )  # to be alone costs as much more as it takes
    follower[ended[is_clear]] = began[is_clear]
    ended, began, distance = ended[~is_alone], began[~is_alone], distance[~is_alone]
    for pairs in _pair_indices_of_connected_groups(ended, began, n_ids):
        rows, row = np.unique(ended[pairs], return_inverse=True)
        columns, column = np.unique(began[pairs], return_inverse=True)
        cost = np.full((len(rows), len(columns)), np.inf)
        cost[row, column] = distance[pairs]
        best, total = _column_of_each_row_and_least_cost(cost)
        for k in np.flatnonzero(best >= 0):
            if cost[k, best[k]] > MAX_SQUARED_DISTANCE_OF_PAIR_SIGMAS2:
                continue
            without = cost.copy()
            without[k, best[k]] = np.inf
            if (
                _column_of_each_row_and_least_cost(without)[1] - total
                >= MIN_SQUARED_DISTANCE_MARGIN_TO_RIVAL_PAIRING_SIGMAS2
            ):
                follower[rows[k]] = columns[best[k]]
    return follower, int(np.count_nonzero(has_ended)) - int(np.count_nonzero(follower >= 0))


def _pair_indices_of_connected_groups(ended: Int64Array, began: Int64Array, n: int) -> list[npt.NDArray[np.intp]]:
    """Return the connected groups of pairs: those that share an end or a beginning."""
    label = np.arange(2 * n)  # of each end, and behind them of each beginning
    one, other = ended, began + n
    while True:
        least = np.minimum(label[one], label[other])
        before = label.copy()
        np.minimum.at(label, one, least)
        np.minimum.at(label, other, least)
        label = label[label]  # each on to what its own label has become
        if np.array_equal(label, before):
            break
    group = label[ended]
    order = np.argsort(group, kind="stable")
    return [each for each in np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(each)]


def _column_of_each_row_and_least_cost(cost: FloatArray) -> tuple[Int64Array, float]:
    """Return the cheapest pairing, as the column of each row or -1, and its cost."""
    n_rows, n_columns = cost.shape
    whole = np.full((n_rows, n_columns + n_rows), MAX_SQUARED_DISTANCE_OF_RIVAL_PAIR_SIGMAS2)
    whole[:, :n_columns] = np.minimum(cost, IMPOSSIBLE_PAIR_COST)
    total, column, _ = lap.lapjv(whole, extend_cost=True)
    best = np.where(column < n_columns, column, -1)
    return best.astype(np.int64), float(total)
