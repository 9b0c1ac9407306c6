"""Find senders among the objects that other stations perceived, so that a car that sends and is seen is used once.

Two cars cannot be in one place. An object is a sender where that is a thousand times likelier than the nearest place of
another car beside the sender, by the uncertainties that both messages state. So precise positions decide, and with
vague ones both stay. The errors of a receiver last, so that many moments tell no more than one; the mean of the last
moments is used. An object's number may pass to another car: at a moment that disagrees the object is kept and the run
of moments begins anew. An object is left out only while the sender's message is as recent as its own: not after the
sender has fallen silent, and only in part if the sender is heard less often than it is seen.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.remotes import perceived_rows_mask, select_remote_rows
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.units import NS_PER_S

Rows = npt.NDArray[np.intp]

MAX_MESSAGE_AGE_S = 1.0
"""Greatest age of a sender's message and of the object's moment before, s. Chosen by hand; not fitted."""
MAX_FRESH_MESSAGE_AGE_S = 0.3
"""A sender's message of at most this age is as recent as the object, s; so is one after the object's moment before.

Chosen as the period of slow senders; not fitted."""
SENDER_OFFSET_AVERAGING_TIME_S = 2.0
"""Duration of the moments that are averaged, s. Chosen by hand; not fitted."""
MIN_MOMENTS_FOR_OFFSET = 3
"""Least number of moments over which the offset of a sender is averaged. Chosen by hand; not fitted."""
MIN_SQUARED_DISTANCE_EXCESS_OF_OTHER_CAR = 13.8
"""Least excess of the squared distance to another car: a likelihood ratio of 1000, as for joined ids. Chosen by hand;
not fitted."""
MAX_SQUARED_SIGMAS_FROM_SENDER = 13.8
"""Greatest squared distance from the sender: the chi-square quantile of 0.999 with two degrees of freedom."""
MIN_CAR_CLEARANCE_M = 0.5
"""Least distance between two cars beside each other, m; people may touch. Chosen by hand; not fitted."""
MIN_CAR_WIDTH_M = 1.0
"""Least width in m of a road user that counts as a car and needs clearance. Chosen by hand; not fitted."""
DEFAULT_ROAD_USER_SIZE_M = 0.5
"""Length and width of a road user without a stated size, m. Chosen as a person's."""
MIN_POSITION_VARIANCE_M2 = 1e-4
"""Least variance of a position, (1 cm)^2: no position on the road is better known."""
DEFAULT_POSITION_SIGMA_M, DEFAULT_SPEED_SIGMA_MPS, DEFAULT_HEADING_SIGMA_RAD = 1.5, 1.0, np.deg2rad(5.0)
"""Sigmas of messages that state none: position per axis, speed and heading. Chosen by hand; not fitted."""
SENDER_ACCELERATION_SIGMA_MPS2 = 2.0
"""One sigma of the sender's acceleration since its message, m/s^2. Chosen as strong everyday driving."""
MAX_MOTION_DIFFERENCE_SIGMAS = 3.0
"""Greatest difference of the speeds and of the headings, in sigmas. Chosen by hand; not fitted."""
MIN_SPEED_FOR_HEADING_MPS = 1.0
"""Least speed in m/s at which headings are compared. Chosen by hand; not fitted."""
MAX_COMPARED_DISTANCE_M = 50.0
"""Greatest distance in m of an object from a position of a sender with which it is compared. Chosen for speed."""


@dataclass(frozen=True)
class _ObjectComparedWithSender:
    """One object compared with one sender: a row per moment of the object with a recent message of the sender.

    Attributes:
        rows: Rows of the object in the signal.
        along_m, across_m: Position of the object relative to the extrapolated sender, along and left of its heading.
        variance_along_m2, variance_across_m2: Variances of that, as both messages state them.
        motion_agrees: Whether speeds and headings agree, as far as they are known.
        is_fresh: Whether the sender's message is as recent as the object, which then adds nothing.
        length_m, width_m: Least distance of another road user before or behind the sender, and beside it.
    """

    rows: Rows
    along_m: FloatArray
    across_m: FloatArray
    variance_along_m2: FloatArray
    variance_across_m2: FloatArray
    motion_agrees: BoolArray
    is_fresh: BoolArray
    length_m: FloatArray
    width_m: FloatArray


def drop_seen_objects_that_are_senders_and_note(
    signal: RemoteSignal, local_map: LocalMap | None
) -> tuple[RemoteSignal, tuple[str, ...]]:
    """Remove the perceived objects that are senders themselves; returns the signal and notes.

    The decision on a row uses no later row and no message that had not been received by then.

    Args:
        signal: Remote vehicles; only its perceived objects may be left out.
        local_map: Map for the positions; without one no object can be placed.
    """
    perceived = perceived_rows_mask(signal)
    if local_map is None or not perceived.any() or perceived.all():
        return signal, ()
    altitude_m = np.nan_to_num(signal.altitude_m)
    x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, altitude_m)
    nearest, next_nearest = np.full((2, len(perceived)), np.inf)
    is_sender, overlaps = np.zeros((2, len(perceived)), np.bool_)
    objects = [_sort_rows_by_log_time(signal, rows[perceived[rows]]) for _, rows in iter_rows_by_id(signal.station)]
    objects = [rows for rows in objects if len(rows)]
    senders = [rows[~perceived[rows]] for _, rows in iter_rows_by_id(signal.station)]
    ranges = _least_and_greatest_x_y_time_of_groups(x_m, y_m, signal.stamp_ns, objects)
    for said in (rows for rows in senders if len(rows)):
        for k in _object_indices_near_sender(
            ranges, _least_and_greatest_x_y_time_of_groups(x_m, y_m, signal.stamp_ns, [said])
        ):
            at = _compare_object_with_sender(signal, x_m, y_m, said, objects[k])
            is_same, own, is_inside = _sender_and_overlap_masks_with_distance(at, signal.stamp_ns, signal.log_time_ns)
            is_nearer = own < nearest[at.rows]
            next_nearest[at.rows] = np.where(is_nearer, nearest[at.rows], np.minimum(next_nearest[at.rows], own))
            nearest[at.rows] = np.where(is_nearer, own, nearest[at.rows])
            is_sender[at.rows] = np.where(is_nearer, is_same, is_sender[at.rows])
            overlaps[at.rows] |= is_inside
    with np.errstate(invalid="ignore"):
        is_sender &= next_nearest - nearest >= MIN_SQUARED_DISTANCE_EXCESS_OF_OTHER_CAR  # no other sender could be it
    n_known = sum(bool(is_sender[rows].any()) for rows in objects)
    n_unsure = sum(bool(overlaps[rows].any()) and not is_sender[rows].any() for rows in objects)
    notes = []
    if n_known:
        times = f"{int(is_sender.sum())} times, left out"
        notes.append(f"{n_known} perceived objects are vehicles that send messages themselves: {times}")
    if n_unsure:
        notes.append(
            f"{n_unsure} perceived objects may be vehicles that send messages themselves: the positions are too "
            "uncertain to tell, both are kept"
        )
    return select_remote_rows(signal, np.flatnonzero(~is_sender)) if n_known else signal, tuple(notes)


def _least_and_greatest_x_y_time_of_groups(
    x_m: FloatArray, y_m: FloatArray, stamp_ns: Int64Array, groups: list[Rows]
) -> FloatArray:
    """Return least and greatest x, y (m) and time (s) of each group of rows, (groups, 3, 2)."""
    time_s = (stamp_ns - stamp_ns[0]) / NS_PER_S
    return np.array([[(each[rows].min(), each[rows].max()) for each in (x_m, y_m, time_s)] for rows in groups])


def _object_indices_near_sender(object_bounds: FloatArray, sender_bounds: FloatArray) -> list[int]:
    """Return the indices of the objects that were near the sender at a common time."""
    margin = np.array([MAX_COMPARED_DISTANCE_M, MAX_COMPARED_DISTANCE_M, MAX_MESSAGE_AGE_S])
    meets = (object_bounds[:, :, 0] <= sender_bounds[:, :, 1] + margin) & (
        sender_bounds[:, :, 0] <= object_bounds[:, :, 1] + margin
    )
    return [int(k) for k in np.flatnonzero(meets.all(axis=1))]


def _compare_object_with_sender(
    signal: RemoteSignal, x_m: FloatArray, y_m: FloatArray, sender_rows: Rows, object_rows: Rows
) -> _ObjectComparedWithSender:
    """Compare an object at each moment with the sender's newest message, extrapolated at its speed."""
    place = np.searchsorted(signal.stamp_ns[sender_rows], signal.stamp_ns[object_rows], side="right") - 1
    is_late = place >= 0
    oldest_ns = signal.stamp_ns[object_rows] - round(MAX_MESSAGE_AGE_S * NS_PER_S)
    while is_late.any():  # messages that had not been received by then
        is_late &= signal.log_time_ns[sender_rows[place]] > signal.log_time_ns[object_rows]
        is_late &= signal.stamp_ns[sender_rows[place]] >= oldest_ns
        place[is_late] -= 1
        is_late &= place >= 0
    newest = sender_rows[np.maximum(place, 0)]
    age_s = (signal.stamp_ns[object_rows] - signal.stamp_ns[newest]) / NS_PER_S
    heading, speed = signal.heading_rad[newest], signal.speed_mps[newest]
    is_heard = (place >= 0) & (age_s <= MAX_MESSAGE_AGE_S)
    is_heard &= np.isfinite(heading) & np.isfinite(speed)
    before_ns = np.append(np.iinfo(np.int64).max, signal.stamp_ns[object_rows[:-1]])
    is_fresh = ((age_s <= MAX_FRESH_MESSAGE_AGE_S) | (signal.stamp_ns[newest] >= before_ns))[is_heard]
    rows, newest = object_rows[is_heard], newest[is_heard]
    age_s, heading, speed = age_s[is_heard], heading[is_heard], speed[is_heard]
    cos, sin = np.cos(heading), np.sin(heading)
    dx, dy = x_m[rows] - x_m[newest] - age_s * speed * cos, y_m[rows] - y_m[newest] - age_s * speed * sin
    covariance = _covariances_or_default(signal.position_covariance_m2[newest]) + _covariances_or_default(
        signal.position_covariance_m2[rows]
    )
    xx, xy, yy = covariance.T
    moved_m2 = (0.5 * SENDER_ACCELERATION_SIGMA_MPS2 * age_s**2) ** 2
    sigma_mps = [_positive_or_default(signal.speed_sigma_mps[each], DEFAULT_SPEED_SIGMA_MPS) for each in (newest, rows)]
    sigma_rad = [
        _positive_or_default(signal.heading_sigma_rad[each], DEFAULT_HEADING_SIGMA_RAD) for each in (newest, rows)
    ]
    since_mps = np.hypot(sigma_mps[0], SENDER_ACCELERATION_SIGMA_MPS2 * age_s)
    speed_error = np.abs(signal.speed_mps[rows] - speed) / np.hypot(since_mps, sigma_mps[1])
    heading_error = np.abs(wrap_angle(signal.heading_rad[rows] - heading)) / np.hypot(sigma_rad[0], sigma_rad[1])
    is_slow = np.minimum(np.abs(speed), np.abs(signal.speed_mps[rows])) < MIN_SPEED_FOR_HEADING_MPS
    fits = ~(speed_error > MAX_MOTION_DIFFERENCE_SIGMAS) & (is_slow | ~(heading_error > MAX_MOTION_DIFFERENCE_SIGMAS))
    lengths = (
        _positive_or_default(signal.length_m[newest], DEFAULT_ROAD_USER_SIZE_M),
        _positive_or_default(signal.length_m[rows], DEFAULT_ROAD_USER_SIZE_M),
    )
    widths = (
        _positive_or_default(signal.width_m[newest], DEFAULT_ROAD_USER_SIZE_M),
        _positive_or_default(signal.width_m[rows], DEFAULT_ROAD_USER_SIZE_M),
    )
    clearance = np.where(np.minimum(*widths) < MIN_CAR_WIDTH_M, 0.0, MIN_CAR_CLEARANCE_M)
    return _ObjectComparedWithSender(
        rows,
        dx * cos + dy * sin,
        dy * cos - dx * sin,
        xx * cos**2 + 2.0 * xy * cos * sin + yy * sin**2 + moved_m2 + (age_s * sigma_mps[0]) ** 2,
        xx * sin**2 - 2.0 * xy * cos * sin + yy * cos**2 + moved_m2 + (age_s * speed * sigma_rad[0]) ** 2,
        fits,
        is_fresh,
        0.5 * (lengths[0] + lengths[1]) + clearance,
        0.5 * (widths[0] + widths[1]) + clearance,
    )


def _sender_and_overlap_masks_with_distance(
    compared: _ObjectComparedWithSender, stamp_ns: Int64Array, log_time_ns: Int64Array
) -> tuple[BoolArray, FloatArray, BoolArray]:
    """Decide from the last moments whether an object is a sender; all results (n,).

    Args:
        compared: Moments in the order in which they were received.

    Returns:
        Whether the object is the sender and no car beside it; the squared distance in sigmas (infinite where the motion
        differs); and whether the two would overlap.
    """
    n = len(compared.rows)
    along, across = compared.along_m, compared.across_m
    variance_along, variance_across = compared.variance_along_m2, compared.variance_across_m2
    own, other = _squared_distances_to_sender_and_to_other(compared, along, across, variance_along, variance_across)
    agrees = compared.motion_agrees & (own <= MAX_SQUARED_SIGMAS_FROM_SENDER) & (own <= other)
    # A run begins behind a gap, and a moment that disagrees is one of its own.
    begins = np.ones(n, np.bool_)
    is_gap = np.abs(np.diff(stamp_ns[compared.rows])) > round(MAX_MESSAGE_AGE_S * NS_PER_S)
    begins[1:] = is_gap | ~agrees[1:] | ~agrees[:-1]
    received_ns = log_time_ns[compared.rows]
    first = np.maximum.accumulate(np.where(begins, np.arange(n), 0))
    first = np.maximum(
        first, np.searchsorted(received_ns, received_ns - round(SENDER_OFFSET_AVERAGING_TIME_S * NS_PER_S))
    )
    counts = np.arange(1, n + 1) - first

    def moving_mean(values: FloatArray) -> FloatArray:
        total = np.append(0.0, np.cumsum(values))
        return np.asarray((total[1:] - total[first]) / counts)

    own, other = _squared_distances_to_sender_and_to_other(
        compared, moving_mean(along), moving_mean(across), moving_mean(variance_along), moving_mean(variance_across)
    )
    is_inside = agrees & (own <= MAX_SQUARED_SIGMAS_FROM_SENDER) & (other > 0.0) & (counts >= MIN_MOMENTS_FOR_OFFSET)
    is_same = is_inside & compared.is_fresh & (other - own >= MIN_SQUARED_DISTANCE_EXCESS_OF_OTHER_CAR)
    return is_same, np.where(compared.motion_agrees, own, np.inf), is_inside


def _squared_distances_to_sender_and_to_other(
    compared: _ObjectComparedWithSender,
    along_m: FloatArray,
    across_m: FloatArray,
    along_m2: FloatArray,
    across_m2: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return squared distances in sigmas: from the sender, and from the nearest place of another road user."""
    along_m2, across_m2 = (
        np.maximum(along_m2, MIN_POSITION_VARIANCE_M2),
        np.maximum(across_m2, MIN_POSITION_VARIANCE_M2),
    )
    own = along_m**2 / along_m2 + across_m**2 / across_m2
    # Another car is beside this one or before or behind it; how far it is off in the other direction is its choice.
    aside = np.maximum(compared.width_m - np.abs(across_m), 0.0) ** 2 / across_m2
    ahead = np.maximum(compared.length_m - np.abs(along_m), 0.0) ** 2 / along_m2
    return own, np.minimum(aside, ahead)


def _sort_rows_by_log_time(signal: RemoteSignal, rows: Rows) -> Rows:
    """Sort rows by the time at which they were received."""
    return rows[np.argsort(signal.log_time_ns[rows], kind="stable")]


def _covariances_or_default(covariance_m2: FloatArray) -> FloatArray:
    """Replace covariances (n, 3) that are not stated by the default."""
    is_stated = np.isfinite(covariance_m2).all(axis=1, keepdims=True)
    return np.where(is_stated, covariance_m2, np.array([DEFAULT_POSITION_SIGMA_M**2, 0.0, DEFAULT_POSITION_SIGMA_M**2]))


def _positive_or_default(values: FloatArray, default: float) -> FloatArray:
    """Replace values that are not finite and positive by a default."""
    return np.where(np.isfinite(values) & (values > 0.0), values, default)
