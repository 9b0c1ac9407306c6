"""Messages that tell of others, and what they mean: the car of `v2x_messages`, seen by a station near it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import cos, pi, radians, sin
from typing import Any

import numpy as np

from cwcli.signals import cpm, sdsm
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role

SENDER_DEG = (40.8646987, -77.8304602)
EAST_M, NORTH_M = 120.5, -80.2
MS = 1_000_000
Sample = tuple[dict[str, Any], dict[Role, dict[str, Any]]]


def nested(values: dict[str, Any]) -> dict[str, Any]:
    """Dotted paths as dictionaries."""
    made: dict[str, Any] = {}
    for path, value in values.items():
        *outer, leaf = path.split(".")
        inner = made
        for name in outer:
            inner = inner.setdefault(name, {})
        inner[leaf] = value
    return made


def means(k: int, stamp_ns: int, **more: Any) -> dict[Role, dict[str, Any]]:
    """A car 120.5 m east and 80.2 m south of the sender, 10 m/s north-east, 20 ms before the message's time."""
    latitude, longitude = place()
    return {
        Role.REMOTE: {
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "speed_mps": 10.0,
            "heading_rad": pi / 4,
            "yaw_rate_radps": radians(5.0),
            "length_m": 4.5,
            "width_m": 1.8,
            "stamp_ns": stamp_ns - 20 * MS,
            **more,
        }
    }


@cache
def place() -> tuple[float, float]:
    """Where the car is, by PROJ's topocentric transformation."""
    zero = np.zeros(1)
    latitude, longitude, _ = LocalMap(*SENDER_DEG).wgs84_from_map(zero + EAST_M, zero + NORTH_M, zero)
    return float(latitude[0]), float(longitude[0])


def cpm_object(**changes: int) -> dict[str, int]:
    """In codes, polar and Cartesian alike; flags say which counts."""
    codes = {
        "object": 7,
        "delta_time_ms": -20,
        "east_m": 12_050,
        "east_95_m": 98,
        "north_m": -8020,
        "north_95_m": 196,
        "speed_mps": 1000,
        "speed_95_mps": 98,
        "direction_deg": 450,
        "direction_95_deg": 20,
        "east_mps": round(1000 * cos(pi / 4)),
        "east_95_mps": 98,
        "north_mps": round(1000 * sin(pi / 4)),
        "north_95_mps": 98,
        "accel_mps2": 30,
        "accel_95_mps2": 10,
        "accel_direction_deg": 2250,  # backward: braking
        "east_mps2": -21,
        "east_95_mps2": 10,
        "north_mps2": -21,
        "north_95_mps2": 10,
        "heading_deg": 450,
        "heading_95_deg": 20,
        "yaw_rate_degps": 5,
        "yaw_rate_confidence": 1,
        "width_m": 18,
        "length_m": 45,
    }
    return codes | changes


def ros_cpm(k: int, stamp_ns: int, **changes: int) -> Sample:
    """Polar velocity and acceleration."""
    sender = {
        "station": 1201,
        "reference_time_ms": stamp_ns // MS - 1_072_915_200_000 + 5000,
        "latitude_deg": 408_646_987,
        "longitude_deg": -778_304_602,
        "altitude_m": 800_001,
        "semi_major_m": 245,
        "semi_minor_m": 245,
        "semi_major_compass_deg": 0,
    }
    leaves = {cpm.ROS_OBJECT_PATHS[name]: code for name, code in cpm_object(**changes).items()}
    leaves |= dict.fromkeys(cpm.ROS_PRESENCE_FLAG_PATHS_BY_OBJECT_QUANTITY.values(), True)
    car = {path.removeprefix(f"{cpm.ROS_OBJECTS_PATH}."): value for path, value in leaves.items()}
    car |= dict.fromkeys(("velocity_is_present", "acceleration_is_present"), True)
    car |= {"velocity.choice": 0, "acceleration.choice": 0}
    message = nested({cpm.ROS_SENDER_PATHS[name][0]: code for name, code in sender.items()})
    perceived = {"perceived_objects": {"array": [nested(car)]}}
    message["payload"]["cpm_containers"] = {
        "value": {"array": [{"container_data_perceived_object_container": perceived}]}
    }
    more = {"accel_mps2": -3.0, "lateral_accel_mps2": 0.0, "speed_sigma_mps": 0.98 / 1.959964}
    return message, means(k, stamp_ns, position_covariance_m2=COVARIANCE, **more)


COVARIANCE = [(2.45 / 2.447747) ** 2 + (0.98 / 1.959964) ** 2, 0.0, (2.45 / 2.447747) ** 2 + (1.96 / 1.959964) ** 2]
"""Of the sender's circle of 2.45 m and bounds of 0.98 m and 1.96 m: about 1 + 0.25 and 1 + 1 m^2."""


def ros_sdsm(*, is_carma: bool) -> Callable[[int, int], Sample]:
    """The same car; J3224's axes are north, east, down, and its yaw rate is positive to the right."""

    def sample(k: int, stamp_ns: int) -> Sample:
        sender: dict[str, Any] = {
            "station": [0x01, 0x0C, 0x0C, 0x0A],
            "dsecond_ms": stamp_ns // MS % 60_000,
            "latitude_deg": SENDER_DEG[0] if is_carma else 408_646_987,
            "longitude_deg": SENDER_DEG[1] if is_carma else -778_304_602,
            "altitude_m": 0.0 if is_carma else 0,
            "semi_major_m": 2.0 if is_carma else 40,
            "semi_minor_m": 2.0 if is_carma else 40,
            "semi_major_compass_deg": 0.0 if is_carma else 0,
        }
        car: dict[str, Any] = {
            "object": 7,
            "delta_time_ms": -0.02 if is_carma else -20,
            "north_m": NORTH_M if is_carma else -802,
            "east_m": EAST_M if is_carma else 1205,
            "position_confidence": 9,  # 1 m
            "speed_mps": 10.0 if is_carma else 500,
            "speed_confidence": 4,  # 1 m/s
            "heading_compass_deg": 45.0 if is_carma else 3600,
            "heading_confidence": 2,  # 5 degrees
            "accel_mps2": -3.0 if is_carma else -300,
            "lateral_accel_mps2": -1.0 if is_carma else -100,
            "yaw_rate_degps": -5.0 if is_carma else -500,
            "accel_confidence": 4,
            "yaw_rate_confidence": 4,
            "width_m": 1.8 if is_carma else 180,
            "length_m": 4.5 if is_carma else 450,
        }
        leaves = {sdsm.ROS_PATHS[name]: value for name, value in (sender | car).items()}
        for _, path, bit in sdsm.presence_quantities_paths_and_bits(is_carma=True):
            leaves[path] = leaves.get(path, 0) | bit
        of_objects = f"{sdsm.ROS_OBJECTS_PATH}."
        values = {path.removeprefix(of_objects): leaves.pop(path) for path in [*leaves] if path.startswith(of_objects)}
        common = "detected_object_common_data"
        values |= {f"{common}.speed.unavailable": False, f"{common}.heading.unavailable": False}
        values["detected_object_optional_data.choice"] = 0
        message = nested(leaves) | {"objects": {"detected_object_data": [nested(values)]}}
        more = {"accel_mps2": -3.0, "lateral_accel_mps2": 1.0, "speed_sigma_mps": 1.0 / 1.959964}
        spread = 4.0 + (1.0 / 1.959964) ** 2
        return message, means(k, stamp_ns, position_covariance_m2=[spread, 0.0, spread], **more)

    return sample


PERCEIVED_SAMPLES: dict[str, Callable[[int, int], Sample]] = {
    "etsi_its_cpm_ts_msgs/CollectivePerceptionMessage": ros_cpm,
    "j3224_v2x_msgs/SensorDataSharingMessage": ros_sdsm(is_carma=False),
    "carma_v2x_msgs/SensorDataSharingMessage": ros_sdsm(is_carma=True),
}
