"""The host's lidar and radar: what each scan detects of the other vehicles, in the host's body axes.

A scan sees the centre of every other vehicle within its range and field of view with its detection probability; no
vehicle hides another. The lidar measures a position, the radar range, azimuth and range rate (xiang2019, eq. 1-4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.simulation.streams import RunSpan, draw_message_schedule, random_stream
from cwcli.simulation.truth import Motion


@dataclass(frozen=True)
class DetectionScans:
    """The scans of one sensor, in the order of their log times; an empty one is a scan, too.

    Attributes:
        sensor: `lidar` or `radar`.
        stamp_ns, log_time_ns: Shape (n,).
        first: Shape (n + 1,): row of each scan's first detection.
        values: Shape (m, 2): x, y in m; or (m, 3): range in m, azimuth in rad, range rate in m/s.
        sigma: Shape (2,) or (3,): standard deviations of the values' noise.
        n_lost: Number of scans that were lost.
    """

    sensor: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    first: Int64Array
    values: FloatArray
    sigma: FloatArray
    n_lost: int


def positions_and_velocities_in_host_body_frame(host: FloatArray, other: FloatArray) -> FloatArray:
    """Return position and velocity (n, 4) of another vehicle in the host's turning body frame; states are (n, 8)."""
    cos, sin = np.cos(host[:, 3]), np.sin(host[:, 3])
    dx, dy = other[:, 0] - host[:, 0], other[:, 1] - host[:, 1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    vx = other[:, 2] * np.cos(other[:, 3]) - host[:, 2] * cos
    vy = other[:, 2] * np.sin(other[:, 3]) - host[:, 2] * sin
    return np.column_stack([x, y, cos * vx + sin * vy + host[:, 5] * y, cos * vy - sin * vx - host[:, 5] * x])


def simulate_detections(
    sensor: str, host: Motion, others: Sequence[Motion], settings: Mapping[str, Any], run: RunSpan
) -> DetectionScans:
    """Simulate the scans of one sensor over the drive.

    Args:
        sensor: `lidar` or `radar`.
        settings: As checked by `spec.DETECTOR_KEYS`.
    """
    plan = draw_message_schedule(settings, end_s=run.end_s, seed=run.seed, names=("host", sensor))
    true_s = plan.time_s - settings["latency_s"]
    own = host.states_at(true_s)
    relative = np.array(
        [positions_and_velocities_in_host_body_frame(own, other.states_at(true_s)) for other in others]
    ).reshape(len(others), len(true_s), 4)
    reach = np.hypot(relative[..., 0], relative[..., 1])
    azimuth = np.arctan2(relative[..., 1], relative[..., 0])
    if sensor == "lidar":
        exact, sigma = relative[..., :2], np.full(2, settings["sigma_m"])
    else:
        rate = (relative[..., :2] * relative[..., 2:]).sum(axis=-1) / np.maximum(reach, 1e-9)
        exact = np.stack([reach, azimuth, rate], axis=-1)
        sigma = np.array(
            [settings["range_sigma_m"], np.radians(settings["azimuth_sigma_deg"]), settings["rate_sigma_mps"]]
        )
    noise = random_stream(run.seed, "host", sensor, "noise").standard_normal(exact.shape)
    chance = random_stream(run.seed, "host", sensor, "detection").random(reach.shape)
    values = exact + sigma * noise
    if sensor == "radar":
        values[..., 0] = np.abs(values[..., 0])
        values[..., 1] = wrap_angle(values[..., 1])
    is_seen = (reach <= settings["max_range_m"]) & (chance < settings["detection_probability"])
    is_seen &= np.abs(azimuth) <= np.radians(settings["fov_deg"]) / 2.0
    is_seen &= np.array([other.is_present_at(true_s) for other in others], np.bool_).reshape(is_seen.shape)
    order = np.argsort(plan.arrival_ns, kind="stable")
    order = order[plan.is_heard[order]]
    is_seen_by_row = is_seen.T[order]
    return DetectionScans(
        sensor=sensor,
        stamp_ns=run.start_ns + plan.stamp_ns[order],
        log_time_ns=run.start_ns + plan.arrival_ns[order],
        first=np.concatenate([[0], np.cumsum(is_seen_by_row.sum(axis=1))]).astype(np.int64),
        values=np.swapaxes(values, 0, 1)[order][is_seen_by_row],
        sigma=sigma,
        n_lost=int(np.count_nonzero(~plan.is_heard)),
    )
