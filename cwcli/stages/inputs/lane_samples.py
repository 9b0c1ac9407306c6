"""The channel of `cwcli lanes` as the observer wants it: checked, in the order of its stamps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwcli.channels.lanes import PREVIEW, read_lanes
from cwcli.channels.published import LANES
from cwcli.dynamics.samples import LaneSamples
from cwcli.errors import DataError, MissingSignalError
from cwcli.pipeline.result import InputCount
from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.signals.columns import Columns, FloatArray, Int64Array
from cwcli.signals.rows import rows_by_stamp

LIMITS = np.array([1e3, math.pi / 2.0, 1.0])
"""Of the values at the preview point; larger ones are no lane and are left out."""
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


def lane_samples(columns: Columns, *, where: str) -> ReadLanes:
    """The lane at the preview point at each frame.

    Raises:
        DataError: A field is missing, no stamp is usable, or the preview distance changes or makes no sense.
        MissingSignalError: There is no message.
    """
    place = f"{where}: {columns.topic}" if where else columns.topic
    if not len(columns):
        raise MissingSignalError("no frame is in the log, or none between --start and --end", where=place)
    lanes = read_lanes(columns, required=("stamp_ns", *PREVIEW, "preview_distance_m"))
    stamp_ns = lanes.stamp_ns
    usable = np.flatnonzero((stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS))
    if not len(usable):
        raise DataError("no frame has a usable stamp", where=place)
    rows = usable[rows_by_stamp(stamp_ns[usable])]
    values, sigma = lanes.preview[rows], lanes.preview_sigma[rows]
    with np.errstate(invalid="ignore"):
        is_beyond = np.abs(values) > LIMITS
        sigma = np.where((sigma > 0.0) & (sigma <= MAX_SIGMA), sigma, np.nan)  # the observer then takes its own
    values = np.where(is_beyond, np.nan, values)
    n_empty = int(np.count_nonzero(~np.isfinite(values).any(axis=1)))
    rejected = {NO_STAMP: len(columns) - len(usable), REPEATED: len(usable) - len(rows)}
    repaired = {
        OUT_OF_ORDER: int(np.count_nonzero(np.diff(stamp_ns[usable]) < 0)),
        OUT_OF_RANGE: int(np.count_nonzero(is_beyond.any(axis=1))),
    }
    samples = LaneSamples(
        stamp_ns[rows],
        *(values[:, 0], values[:, 1], values[:, 2]),
        *(sigma[:, 0], sigma[:, 1], sigma[:, 2]),
        yaw_sigma_rad=_yaw_sigma_rad(lanes.camera_yaw_sigma_rad),
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
    return ReadLanes(samples, columns.log_time_ns[rows], _preview(lanes.preview_m[rows], place), count)


def _preview(previews_m: FloatArray, where: str) -> float:
    distinct = np.unique(previews_m)
    low, high = PREVIEW_RANGE_M
    if len(distinct) > 1:
        told = f"{distinct[0]:g} and {distinct[1]:g} m"
        raise DataError(f"the preview distance changes within the channel: {told}", where=where)
    if not low <= distinct[0] <= high:
        raise DataError(f"a preview distance of {distinct[0]:g} m is not between {low:g} and {high:g} m", where=where)
    return float(distinct[0])


def _yaw_sigma_rad(told_rad: FloatArray) -> float:
    """What the camera's yaw contributes to the sigmas; 0 where the channel does not tell."""
    known = told_rad[np.isfinite(told_rad) & (told_rad >= 0.0)]
    return float(known.min(initial=math.pi)) if len(known) else 0.0
