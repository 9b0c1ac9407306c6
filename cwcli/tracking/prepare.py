"""Check the detections of several sensors, transform them to the tracking frame and sort them by time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.kernels import track as kernel
from cwcli.kernels.track import RowKind
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.tracking.detections import (
    DEFAULT_SIGMAS_BY_KIND,
    YAW_RAD_BY_SENSOR_AXES,
    DetectionCounts,
    DetectionKind,
    Detections,
    EgoStates,
    SensorModel,
)

Mask = npt.NDArray[np.bool_]
Int8Array = npt.NDArray[np.int8]
MAX_RANGE_RATE_MPS = 200.0
"""Greatest possible range rate, m/s; rows beyond it are left out. Chosen by hand."""
MAX_DETECTION_LATENESS_S = 1.0
"""Greatest time in s by which a detection may arrive later than a newer one. Chosen by hand; not fitted."""
MIN_BELIEVED_STATED_DETECTION_VARIANCE, MAX_BELIEVED_STATED_DETECTION_VARIANCE = 1e-12, 1e8
"""Stated variances outside of these limits are absurd, and the sensor model's are used. Chosen by hand."""


@dataclass(frozen=True)
class DetectionRows:
    """Detections of all sensors in the tracking frame, in the order of time.

    Attributes:
        stamp_ns: Shape (n,), int64, non-decreasing.
        source: Shape (n,), index into `sources`.
        kind: Shape (n,), int8: a `RowKind`.
        z: Shape (n, 3): the values; positions and azimuths in the tracking frame's directions.
        r: Shape (n, 3, 3): their covariance.
        origin: Shape (n, 4): the sensor's x, y, vx, vy in the tracking frame.
        index: Shape (n,): row in the source's `Detections`.
        sources: Names of the sensors.
    """

    stamp_ns: Int64Array
    source: Int64Array
    kind: Int8Array
    z: FloatArray
    r: FloatArray
    origin: FloatArray
    index: Int64Array
    sources: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def to_kernel_rows(self) -> kernel.Rows:
        """Convert them to the kernel's rows."""
        return kernel.Rows(kind=self.kind, z=self.z, r=self.r, origin=self.origin)

    def select_rows(self, which: Int64Array | Mask | slice) -> DetectionRows:
        """Select the rows `which`, in that order."""
        return DetectionRows(
            self.stamp_ns[which],
            self.source[which],
            self.kind[which],
            np.ascontiguousarray(self.z[which]),
            np.ascontiguousarray(self.r[which]),
            np.ascontiguousarray(self.origin[which]),
            self.index[which],
            self.sources,
        )


@dataclass(frozen=True)
class Scans:
    """All scans in the order of time, empty ones included.

    Attributes:
        stamp_ns, source: Shape (s,).
        first: Shape (s + 1,): scan k has the rows `first[k]:first[k + 1]` of `Rows`.
        pose: Shape (s, 3): the sensor's x, y and the direction of its x axis in the tracking frame.
    """

    stamp_ns: Int64Array
    source: Int64Array
    first: Int64Array
    pose: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True)
class PreparedDetections:
    """Checked detections. `counts` is keyed by source."""

    rows: DetectionRows
    scans: Scans
    models: tuple[SensorModel, ...]
    counts: dict[str, DetectionCounts]
    has_ego: bool


def arrived_in_order_mask(stamp_ns: Int64Array, max_lateness_s: float) -> Mask:
    """Whether each row's stamp fits the order of arrival, up to `max_lateness_s`.

    As few rows as possible are rejected: the longest non-decreasing run of stamps stays (patience sorting), and with it
    every row that is late by no more than the limit. One stamp from the future costs one row, not the rest of the log.
    """
    n = len(stamp_ns)
    stamp_s = stamp_ns * 1e-9  # a fraction of a microsecond is enough here, and absurd stamps can't overflow
    if n < 2 or (np.maximum.accumulate(stamp_s) - stamp_s).max() <= max_lateness_s:
        return np.ones(n, bool)
    tails: list[int] = []
    ends: list[int] = []
    before = np.full(n, -1)
    for i, stamp in enumerate(stamp_ns.tolist()):
        k = bisect_right(tails, stamp)
        if k:
            before[i] = ends[k - 1]
        if k == len(tails):
            tails.append(stamp)
            ends.append(i)
        else:
            tails[k] = stamp
            ends[k] = i
    spine = np.zeros(n, bool)
    i = ends[-1]
    while i >= 0:
        spine[i] = True
        i = int(before[i])
    reached = np.maximum.accumulate(np.where(spine, stamp_s, -np.inf))
    ahead = np.minimum.accumulate(np.where(spine, stamp_s, np.inf)[::-1])[::-1]
    return spine | ((stamp_s >= reached - max_lateness_s) & (stamp_s <= ahead + max_lateness_s))


def interpolate_ego_states_and_known_mask(ego: EgoStates, stamp_ns: Int64Array) -> tuple[FloatArray, Mask]:
    """Interpolate the ego's x, y, heading, vx, vy, yaw rate at the stamps, (n, 6), and where they are known.

    Between states the position and the unwrapped heading are linear; nothing is interpolated across a long gap.
    """
    t0 = int(ego.stamp_ns[0]) if len(ego.stamp_ns) else 0
    out = np.full((len(stamp_ns), 6), np.nan)
    if not len(ego.stamp_ns) or not len(stamp_ns):
        return out, np.zeros(len(stamp_ns), bool)
    grid = (ego.stamp_ns - t0) * 1e-9
    at = (stamp_ns - t0) * 1e-9
    right = np.clip(np.searchsorted(grid, at), 1, max(len(grid) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(grid) - 1)
    near = np.minimum(np.abs(at - grid[left]), np.abs(grid[right] - at))
    inside = (at >= grid[0]) & (at <= grid[-1])
    known = np.where(inside, grid[right] - grid[left] <= ego.max_gap_s, near <= 0.5 * ego.max_gap_s)
    known |= near == 0.0
    for k, column in enumerate((ego.x_m, ego.y_m, np.unwrap(ego.heading_rad))):
        out[:, k] = np.interp(at, grid, column)
    speed = np.interp(at, grid, ego.speed_mps)
    out[:, 3] = speed * np.cos(out[:, 2])
    out[:, 4] = speed * np.sin(out[:, 2])
    out[:, 5] = np.interp(at, grid, ego.yaw_rate_radps)
    past = np.where(inside, 0.0, at - np.clip(at, grid[0], grid[-1]))  # just outside: move on at constant velocity
    out[:, 0] += past * out[:, 3]
    out[:, 1] += past * out[:, 4]
    out[:, 2] += past * out[:, 5]
    return out, known & np.isfinite(out).all(axis=1)


def sensor_pose_and_velocity(
    model: SensorModel, ego: EgoStates | None, stamp_ns: Int64Array
) -> tuple[FloatArray, FloatArray, Mask]:
    """Pose (n, 3) and velocity (n, 2) of the sensor in the tracking frame, and where they are known."""
    n = len(stamp_ns)
    yaw = model.yaw_rad + YAW_RAD_BY_SENSOR_AXES[model.axes]
    if ego is None or model.carrier == "map":
        return np.tile([model.x_m, model.y_m, yaw], (n, 1)), np.zeros((n, 2)), np.ones(n, bool)
    car, known = interpolate_ego_states_and_known_mask(ego, stamp_ns)
    c, s = np.cos(car[:, 2]), np.sin(car[:, 2])
    arm_x = c * model.x_m - s * model.y_m
    arm_y = s * model.x_m + c * model.y_m
    pose = np.stack([car[:, 0] + arm_x, car[:, 1] + arm_y, car[:, 2] + yaw], axis=1)
    velocity = np.stack([car[:, 3] - car[:, 5] * arm_y, car[:, 4] + car[:, 5] * arm_x], axis=1)
    return pose, velocity, known


def _measurement_covariances(data: Detections, model: SensorModel, counts: DetectionCounts) -> FloatArray:
    """Covariance of every row, (n, k, k): the message's if it is valid, else the sensor model's."""
    n, width = data.values.shape
    sigma = model.sigma or DEFAULT_SIGMAS_BY_KIND[data.kind]
    if len(sigma) < width:
        raise ValueError(f"{data.source}: {len(sigma)} sigmas for {width} values")
    out = np.tile(np.diag(np.square(sigma[:width])), (n, 1, 1))
    if data.covariance is None or not n:
        return out
    has_covariance = np.isfinite(data.covariance).all(axis=(1, 2)) & (data.covariance != 0.0).any(axis=(1, 2))
    diagonal = np.diagonal(data.covariance, axis1=1, axis2=2)
    sane = (
        has_covariance
        & (np.abs(data.covariance) < MAX_BELIEVED_STATED_DETECTION_VARIANCE).all(axis=(1, 2))
        & (diagonal > MIN_BELIEVED_STATED_DETECTION_VARIANCE).all(axis=1)
    )
    mirrored = out.copy()
    mirrored[sane] = 0.5 * (data.covariance[sane] + data.covariance[sane].transpose(0, 2, 1))
    scale = np.sqrt(np.diagonal(mirrored, axis1=1, axis2=2))
    good = np.linalg.eigvalsh(mirrored / (scale[:, :, None] * scale[:, None, :]))[:, 0] > 1e-9
    counts.count_repaired(
        "covariance not positive or absurd, the sensor's noise used", int((has_covariance & ~(sane & good)).sum())
    )
    out[good] = mirrored[good]
    return out


def _valid_rows_mask(
    data: Detections, model: SensorModel, counts: DetectionCounts, max_scan: int, lateness_s: float
) -> Mask:
    """Which rows are valid by themselves; the others are counted as rejected under the first reason that fits."""
    values = data.values
    radar = data.kind == DetectionKind.RADAR
    with np.errstate(invalid="ignore", over="ignore"):
        distance = values[:, 0] if radar else np.hypot(values[:, 0], values[:, 1])
        unknown = np.asarray(~np.isfinite(values[:, :2]).all(axis=1))
        checks: list[tuple[str, Mask]] = [("not finite", unknown)]
        if data.frame is not None and model.frame_ids:
            ok_codes = [k for k, name in enumerate(data.frame.values) if name in model.frame_ids]
            checks.insert(0, ("wrong frame id", ~np.isin(data.frame.codes, ok_codes)))
        if radar:
            checks.append(("negative range", values[:, 0] < 0.0))
        checks.append(("beyond the sensor's range", distance > model.max_range_m))
    left = np.ones(len(data), bool)
    for reason, bad in checks:
        counts.count_rejected(reason, int((bad & left).sum()))
        left &= ~bad
    valid_rows = np.flatnonzero(left)
    fits = arrived_in_order_mask(data.stamp_ns[valid_rows], lateness_s)
    counts.count_rejected("time went backwards or jumped", int((~fits).sum()))
    left[valid_rows[~fits]] = False
    valid_rows = valid_rows[fits]
    counts.count_repaired("arrived out of order, put in order", int((np.diff(data.stamp_ns[valid_rows]) < 0).sum()))
    order = np.argsort(data.stamp_ns[valid_rows], kind="stable")
    _, first = np.unique(data.stamp_ns[valid_rows][order], return_index=True)
    starts = np.repeat(first, np.diff(np.append(first, len(valid_rows))))
    crowded = np.arange(len(valid_rows)) - starts >= max_scan
    counts.count_rejected(f"more than {max_scan} in one scan", int(crowded.sum()))
    left[valid_rows[order[crowded]]] = False
    return left


def _transform_to_tracking_frame(data: Detections, model: SensorModel, ego: EgoStates | None, valid_rows: Mask,
    counts: DetectionCounts, source: int, sources: tuple[str, ...]) -> DetectionRows:  # fmt: skip
    r = _measurement_covariances(data, model, counts)
    index = np.flatnonzero(valid_rows)
    stamps = data.stamp_ns[index]
    pose, velocity, known = sensor_pose_and_velocity(model, ego, stamps)
    counts.count_rejected("no ego state at that time", int((~known).sum()))
    index, stamps, pose, velocity = index[known], stamps[known], pose[known], velocity[known]
    n = len(index)
    z = np.zeros((n, 3))
    noise = np.tile(np.eye(3), (n, 1, 1))
    values = data.values[index]
    if data.kind == DetectionKind.POSITION:
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        turn = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
        z[:, :2] = pose[:, :2] + np.einsum("nij,nj->ni", turn, values)
        noise[:, :2, :2] = turn @ r[index] @ turn.transpose(0, 2, 1)
        kind = np.full(n, RowKind.POSITION, np.int8)
    else:
        rate = values[:, 2]
        with np.errstate(invalid="ignore"):
            wild = np.isinf(rate) | (np.abs(rate) > MAX_RANGE_RATE_MPS)
        counts.count_repaired("impossible range rate, left out", int(wild.sum()))
        has_rate = np.isfinite(rate) & ~wild & model.use_range_rate
        azimuth = values[:, 1] + pose[:, 2]
        z[:, 0] = values[:, 0]
        z[:, 1] = azimuth - 2.0 * np.pi * np.floor((azimuth + np.pi) / (2.0 * np.pi))
        z[:, 2] = np.where(has_rate, rate, 0.0)
        noise[:] = r[index]
        kind = np.where(has_rate, RowKind.RADAR, RowKind.RADAR_WITHOUT_RATE).astype(np.int8)
    counts.used = n
    origin = np.concatenate([pose[:, :2], velocity], axis=1)
    return DetectionRows(stamps, np.full(n, source), kind, z, noise, origin, index, sources)


def _collect_scans(rows: DetectionRows, extra: Sequence[tuple[int, Int64Array]], models: Sequence[SensorModel],
           ego: EgoStates | None) -> Scans:  # fmt: skip
    """Collect the scans of the rows, and the empty ones."""
    n = len(rows)
    new = np.ones(n, bool)
    new[1:] = (np.diff(rows.stamp_ns) != 0) | (np.diff(rows.source) != 0)
    first = np.flatnonzero(new)
    stamp, source = [rows.stamp_ns[first]], [rows.source[first]]
    for k, stamps in extra:
        empty = np.setdiff1d(stamps, rows.stamp_ns[rows.source == k])
        stamp.append(empty)
        source.append(np.full(len(empty), k))
    stamps_all, source_all = np.concatenate(stamp), np.concatenate(source)
    order = np.lexsort((source_all, stamps_all))
    stamps_all, source_all = stamps_all[order], source_all[order]
    sizes = np.zeros(len(order), np.int64)
    sizes[: len(first)] = np.diff(np.append(first, n))
    pose = np.zeros((len(order), 3))
    known = np.ones(len(order), bool)
    for k, model in enumerate(models):
        mine = source_all == k
        pose[mine], _, known[mine] = sensor_pose_and_velocity(model, ego, stamps_all[mine])
    ends = np.concatenate([[0], np.cumsum(sizes[order])])
    keep = known | (np.diff(ends) > 0)
    first_rows = np.append(ends[:-1][keep], n)
    return Scans(stamps_all[keep], source_all[keep], first_rows, pose[keep])


def prepare_detections(
    detections: Sequence[Detections],
    sensors: Mapping[str, SensorModel] | None = None,
    ego: EgoStates | None = None,
    *,
    max_scan: int = 20_000,
    max_lateness_s: float = MAX_DETECTION_LATENESS_S,
) -> PreparedDetections:
    """Check the detections, bring them into the tracking frame and put them in the order of time.

    Args:
        detections: One entry per sensor. They are not changed.
        sensors: Source -> model; a source without one gets the default model.
        ego: The car's states; with them the tracking frame is the map, without them the body frame.
        max_scan: Detections of one scan beyond this number are rejected.
        max_lateness_s: A detection may arrive this much later than a newer one; it is sorted in.

    Returns:
        The rows, the scans and the counts: every rejection has a reason.
    """
    sources = tuple(d.source for d in detections)
    if len(set(sources)) != len(sources):
        raise ValueError(f"two entries for one source: {', '.join(sources)}")
    models = tuple((sensors or {}).get(s, SensorModel()) for s in sources)
    counts = {s: DetectionCounts() for s in sources}
    parts = []
    for k, (data, model) in enumerate(zip(detections, models, strict=True)):
        count = counts[data.source]
        count.read = len(data)
        valid_rows = _valid_rows_mask(data, model, count, max_scan, max_lateness_s)
        parts.append(_transform_to_tracking_frame(data, model, ego, valid_rows, count, k, sources))
    if not parts:
        empty = np.zeros(0, np.int64)
        rows = DetectionRows(empty, empty, np.zeros(0, np.int8), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0,
        4)),
                    empty, ())  # fmt: skip
        return PreparedDetections(
            rows, Scans(empty, empty, np.zeros(1, np.int64), np.zeros((0, 3))), (), {}, ego is not None
        )
    joined_rows = DetectionRows(
        np.concatenate([p.stamp_ns for p in parts]),
        np.concatenate([p.source for p in parts]),
        np.concatenate([p.kind for p in parts]),
        np.concatenate([p.z for p in parts]),
        np.concatenate([p.r for p in parts]),
        np.concatenate([p.origin for p in parts]),
        np.concatenate([p.index for p in parts]),
        sources,
    )
    rows = joined_rows.select_rows(np.lexsort((joined_rows.source, joined_rows.stamp_ns)))
    extra = [(k, d.scan_stamp_ns) for k, d in enumerate(detections) if d.scan_stamp_ns is not None]
    return PreparedDetections(rows, _collect_scans(rows, extra, models, ego), models, counts, ego is not None)
