"""One message of every OSI schema that fills a role, as a dictionary, and what it means; see `input_messages`."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin

from cwcli.signals.role import Role
from tests.laws.input_messages import Message, Sample, stamp_of

HOST, OTHER = 7, 2**63 + 5
YAW_RAD = 0.5


def _time(k: int) -> Message:
    seconds, nanos = divmod(stamp_of(k), 10**9)
    return {"seconds": seconds, "nanos": nanos}


def _base(x_m: float, y_m: float, yaw_rad: float, speed_mps: float) -> Message:
    """A box that drives along its yaw, and brakes with 2 m/s^2 while it is pushed to its left with 1."""
    ahead, left = (cos(yaw_rad), sin(yaw_rad)), (-sin(yaw_rad), cos(yaw_rad))
    return {
        "position": {"x": x_m, "y": y_m, "z": 0.7},
        "orientation": {"yaw": yaw_rad},
        "orientation_rate": {"yaw": 0.1},
        "velocity": {"x": speed_mps * ahead[0], "y": speed_mps * ahead[1]},
        "acceleration": {"x": -2.0 * ahead[0] + left[0], "y": -2.0 * ahead[1] + left[1]},
        "dimension": {"length": 5.0, "width": 2.1},
    }


def _world(k: int) -> tuple[Message, dict[Role, dict[str, object]]]:
    x_m, speed_mps = 1e6 + 3.0 * k, 12.0 + k
    host = _base(x_m, -4.0, YAW_RAD, speed_mps)
    other = _base(x_m + 20.0, -5.0, -3.0, -3.0)
    message = {
        "timestamp": _time(k),
        "host_vehicle_id": {"value": HOST},
        "moving_object": [
            {"id": {"value": OTHER}, "base": other, "type": "TYPE_VEHICLE"},
            {
                "id": {"value": HOST},
                "base": host,
                "type": "TYPE_VEHICLE",
                "vehicle_attributes": {"bbcenter_to_rear": {"x": -1.3}},
            },
        ],
    }
    pose = {"x_m": x_m, "y_m": -4.0, "yaw_rad": YAW_RAD, "speed_mps": speed_mps, "yaw_rate_radps": 0.1}
    means: dict[Role, dict[str, object]] = {
        Role.EGO_POSITION: {**pose, "accel_mps2": -2.0},
        Role.TRUTH: {**pose, "accel_mps2": -2.0},
        Role.EGO_SPEED: {"speed_mps": speed_mps, "yaw_rate_radps": 0.1},
        Role.REMOTE: {
            "x_m": x_m + 20.0,
            "y_m": -5.0,
            "heading_rad": -3.0,
            "speed_mps": -3.0,
            "accel_mps2": -2.0,
            "lateral_accel_mps2": 1.0,
            "length_m": 5.0,
            "width_m": 2.1,
        },
        Role.TARGET_TRUTH: {"x_m": x_m + 20.0, "y_m": -5.0, "vx_mps": -3.0 * cos(-3.0), "vy_mps": -3.0 * sin(-3.0)},
    }
    return message, means


def _ground_truth(k: int) -> Sample:
    return _world(k)


def _sensor_view(k: int) -> Sample:
    message, means = _world(k)
    return {"timestamp": _time(k), "host_vehicle_id": {"value": HOST}, "global_ground_truth": message}, means


def _sensor_data(k: int) -> Sample:
    """A sensor that looks to the left, 2 m ahead of the rear axle: what is 30 m before it is left of the car."""
    view, means = _sensor_view(k)
    del means[Role.REMOTE]
    turned = 1.5707963267948966
    message = {
        "timestamp": _time(k + 5),
        "last_measurement_time": _time(k),
        "mounting_position": {"position": {"x": 2.0, "y": 0.5}, "orientation": {"yaw": turned}},
        "moving_object": [
            {
                "base": {**_base(30.0, -1.0, 0.0, 0.0)},
                "base_rmse": {"position": {"x": 0.2, "y": 0.3}},
                "reference_point": "REFERENCE_POINT_REAR_MIDDLE",
            }
        ],
        "sensor_view": [view],
    }
    # ahead of the sensor 30 + half the length of 5, to its right 1; the rear axle is 1.3 behind the box's centre
    seen = [2.0 + 1.0 - 1.3, 0.5 + 32.5]
    return message, {**means, Role.DETECTIONS: {"values": [seen], "covariance": [[[0.09, 0.0], [0.0, 0.04]]]}}


def _host_vehicle_data(k: int) -> Sample:
    message = {
        "timestamp": _time(k),
        "host_vehicle_id": {"value": HOST},
        "vehicle_localization": {"position": {"x": 100.0 + k, "y": 50.0}, "orientation": {"yaw": 1.0}},
        "vehicle_motion": {
            "position": {"x": 98.6 + k, "y": 50.0},
            "velocity": {"x": 9.0 + k, "y": 0.2},
            "orientation_rate": {"yaw": -0.2},
        },
    }
    return message, {
        Role.EGO_POSITION: {"x_m": 100.0 + k, "y_m": 50.0, "yaw_rad": 1.0},
        Role.EGO_SPEED: {"speed_mps": 9.0 + k, "yaw_rate_radps": -0.2},
    }


OSI_SAMPLES: dict[str, Callable[[int], Sample]] = {
    "osi3.GroundTruth": _ground_truth,
    "osi3.SensorView": _sensor_view,
    "osi3.SensorData": _sensor_data,
    "osi3.HostVehicleData": _host_vehicle_data,
}
