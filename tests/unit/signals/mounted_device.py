"""Odometry of a device that is turned against the car, by quaternion products: independent of what reads it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwcli.signals.columns import Columns, FloatArray
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields

DEG = np.pi / 180.0


def quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product of (w, x, y, z), shape (4, n) each."""
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


def turn(axis: int, angle_rad: FloatArray | float) -> FloatArray:
    """The quaternion (w, x, y, z) of a turn about one axis, shape (4, n)."""
    half = np.atleast_1d(np.asarray(angle_rad, np.float64) / 2.0)
    found = np.zeros((4, len(half)))
    found[0], found[1 + axis] = np.cos(half), np.sin(half)
    return found


def seen_by_device(vector: FloatArray, orientation: FloatArray) -> FloatArray:
    """World vectors (3, n) in the device's axes: q* v q."""
    pure = np.concatenate([np.zeros((1, vector.shape[1])), vector])
    conjugate = orientation * np.array([[1.0], [-1.0], [-1.0], [-1.0]])
    return quaternion_product(quaternion_product(conjugate, pure), orientation)[1:]


def odometry(
    time_s: FloatArray,
    heading_rad: FloatArray,
    speed_mps: FloatArray,
    *,
    left: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
    is_map: bool = False,
    noise_mps: float = 0.0,
    start_ns: int = T0_NS,
    **more: Any,
) -> Columns:
    """An odometry of a device that is mounted `left` (yaw), `pitch` and `roll` degrees off the car's axes."""
    mounting = quaternion_product(turn(2, left * DEG), quaternion_product(turn(1, pitch * DEG), turn(0, roll * DEG)))
    orientation = quaternion_product(turn(2, heading_rad), mounting)
    velocity = speed_mps * np.stack([np.cos(heading_rad), np.sin(heading_rad), np.zeros(len(time_s))])
    position = np.cumsum(velocity, axis=1) * np.gradient(time_s)
    linear = velocity if is_map else seen_by_device(velocity, orientation)
    linear = linear + noise_mps * np.random.default_rng(3).standard_normal(linear.shape)
    rate = np.stack([np.zeros(len(time_s)), np.zeros(len(time_s)), np.gradient(heading_rad, time_s)])
    angular = rate if is_map else seen_by_device(rate, orientation)
    fields = stamp_fields(start_ns + np.round(time_s * 1e9).astype(np.int64))
    fields |= {f"pose.pose.orientation.{name}": orientation[k] for k, name in enumerate("wxyz")}
    fields |= {f"pose.pose.position.{name}": position[k] for k, name in enumerate("xyz")}
    fields |= {f"twist.twist.linear.{name}": linear[k] for k, name in enumerate("xyz")}
    fields |= {f"twist.twist.angular.{name}": angular[k] for k, name in enumerate("xyz")}
    stamp_ns = start_ns + np.round(time_s * 1e9).astype(np.int64)
    return columns_of("nav_msgs/msg/Odometry", fields | more, topic="/truth/odom", log_time_ns=stamp_ns)
