"""The channel of `cwcli lanes` as the observer wants it: checked, in the order of its stamps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.channels.published import LANES
from cwcli.dynamics.samples import LaneSamples
from cwcli.errors import DataError, MissingSignalError
from cwcli.pipeline.result import InputCount
from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.leaves import numbers, whole_numbers
from cwcli.signals.rows import rows_by_stamp

LIMITS = {"lateral_deviation_m": 1e3, "heading_deviation_rad": math.pi / 2.0, "curvature_1pm": 1.0}
"""Larger values are no lane; they are left out."""
SIGMAS = ("lateral_deviation_sigma_m", "heading_deviation_sigma_rad", "curvature_sigma_1pm")
LANE_FIELDS = ("stamp_ns", *LIMITS, *SIGMAS, "preview_distance_m", "camera_yaw_sigma_rad")
MAX_SIGMA = 1e3
PREVIEW_RANGE_M = (0.1, 1e3)

REPEATED = "stamp repeated"
OUT_OF_ORDER = "stamp out of order, sorted"
OUT_OF_RANGE = "value out of range, left out"
NO_STAMP = "no usable stamp"
NO_VALUE = "no boundary found"


@dataclass(frozen=True)
class ReadLanes:
    """The frames.

    Attributes:
        samples: n frames.
        log_time_ns: Shape (n,).
        preview_m: Of the preview point ahead of the camera.
        count: What became of the messages.
    """

    samples: LaneSamples
    log_time_ns: Int64Array
    preview_m: float
    count: InputCount


def read_lanes(columns: Columns, *, where: str) -> ReadLanes:
    """The lane at the preview point at each frame.

    Raises:
        DataError: A field is missing, no stamp is usable, or the preview distance changes or makes no sense.
        MissingSignalError: There is no message.
    """
    place = f"{where}: {columns.topic}" if where else columns.topic
    if not len(columns):
        raise MissingSignalError("no frame is in the log, or none between --start and --end", where=place)
    missing = [name for name in ("stamp_ns", *LIMITS, "preview_distance_m") if name not in columns.fields]
    if missing:
        hint = "write it again with this version of cwcli (`--replace`)"
        raise DataError(f"the channel has no field `{missing[0]}`", where=place, hint=hint)
    stamp_ns, _ = whole_numbers(columns, "stamp_ns")
    usable = np.flatnonzero((stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS))
    if not len(usable):
        raise DataError("no frame has a usable stamp", where=place)
    rows = usable[rows_by_stamp(stamp_ns[usable])]
    values, is_beyond = _within(columns, rows)
    n_empty = int(np.count_nonzero(~np.isfinite(values).any(axis=1)))
    rejected = {NO_STAMP: len(columns) - len(usable), REPEATED: len(usable) - len(rows)}
    repaired = {
        OUT_OF_ORDER: int(np.count_nonzero(np.diff(stamp_ns[usable]) < 0)),
        OUT_OF_RANGE: int(np.count_nonzero(is_beyond)),
    }
    samples = LaneSamples(
        stamp_ns[rows],
        *(values[:, 0], values[:, 1], values[:, 2]),
        *_sigmas(columns, rows),
        yaw_sigma_rad=_yaw_sigma_rad(columns),
    )
    count = InputCount(
        columns.topic,
        LANES.role,
        len(columns),
        len(rows) - n_empty,
        rejected={reason: n for reason, n in rejected.items() if n},
        repaired={reason: n for reason, n in repaired.items() if n},
        set_aside={NO_VALUE: n_empty} if n_empty else {},
    )
    preview_m = _preview(numbers(columns, "preview_distance_m")[rows], place)
    return ReadLanes(samples, columns.log_time_ns[rows], preview_m, count)


def _within(columns: Columns, rows: npt.NDArray[np.intp]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """The three values (n, 3), NaN where they are no lane; and the rows where something was left out."""
    values = np.column_stack([numbers(columns, name)[rows] for name in LIMITS])
    with np.errstate(invalid="ignore"):
        beyond = np.abs(values) > np.array(list(LIMITS.values()))
    return np.where(beyond, np.nan, values), np.asarray(beyond.any(axis=1), dtype=np.bool_)


def _sigmas(columns: Columns, rows: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """NaN where a sigma is none: the observer then takes its own."""
    known = [numbers(columns, name)[rows] for name in SIGMAS]
    first, second, third = (np.where((each > 0.0) & (each <= MAX_SIGMA), each, np.nan) for each in known)
    return first, second, third


def _preview(previews_m: FloatArray, where: str) -> float:
    distinct = np.unique(previews_m)
    low, high = PREVIEW_RANGE_M
    if len(distinct) > 1:
        told = f"{distinct[0]:g} and {distinct[1]:g} m"
        raise DataError(f"the preview distance changes within the channel: {told}", where=where)
    if not low <= distinct[0] <= high:
        raise DataError(f"a preview distance of {distinct[0]:g} m is not between {low:g} and {high:g} m", where=where)
    return float(distinct[0])


def _yaw_sigma_rad(columns: Columns) -> float:
    """What the camera's yaw contributes to the sigmas; 0 where the channel does not tell."""
    if "camera_yaw_sigma_rad" not in columns.fields:
        return 0.0
    known = numbers(columns, "camera_yaw_sigma_rad")
    known = known[np.isfinite(known) & (known >= 0.0)]
    return float(known.min(initial=math.pi)) if len(known) else 0.0
