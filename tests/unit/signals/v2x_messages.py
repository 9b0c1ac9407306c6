"""The same car in every message that tells of one: BSM as JSON, ODE record, ROS and CARMA message, and CAM."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cwcli.signals.columns import Columns, Ragged
from cwcli.signals.etsi import CAM_PATHS, CAM_TS_PATHS
from cwcli.signals.j2735 import CARMA_PRESENCE_MASKS, JSON_ODE_PATHS, ROS_PATHS, STANDARD_JSON_PATHS_BY_QUANTITY
from cwcli.signals.v2x_tables import ros_leaf_path, ros_presence_paths
from tests.unit.signals.radio import packing
from tests.unit.signals.signal_columns import T0_NS, columns_of

MS = 1_000_000
LOG_NS = np.array([T0_NS + 100 * MS])

# One car, 40.8646987 N 77.8304602 W, 335.6 m, due west at 10 m/s, braking at 3.5 m/s^2, turning left at 10 degrees/s,
# 1 m/s^2 to the left, 4.5 m x 1.8 m, 20 ms before the log time (08:07:10.100 UTC): in J2735's codes.
RAW_BSM: dict[str, Any] = {
    "station": "2a3c603c",
    "dsecond_ms": 10_080,
    "transmission": "forwardGears",
    "latitude_deg": 408_646_987,
    "longitude_deg": -778_304_602,
    "altitude_m": 3356,
    "semi_major_m": 40,
    "semi_minor_m": 20,
    "semi_major_compass_deg": 16_384,  # 90.0013733 degrees: the ellipse lies east-west
    "speed_mps": 500,
    "heading_compass_deg": 21_600,
    "accel_mps2": -350,
    "lateral_accel_mps2": -100,
    "yaw_rate_degps": -1000,
    "width_m": 180,
    "length_m": 450,
}
ODE_BSM = RAW_BSM | {
    "transmission": "FORWARDGEARS",
    "latitude_deg": 40.8646987,
    "longitude_deg": -77.8304602,
    "altitude_m": 335.6,
    "semi_major_m": 2.0,
    "semi_minor_m": 1.0,
    "semi_major_compass_deg": 90.0013733,
    "speed_mps": 10.0,
    "heading_compass_deg": 270.0,
    "accel_mps2": -3.5,
    "lateral_accel_mps2": -1.0,
    "yaw_rate_degps": -10.0,
}
STATION_OCTETS = Ragged(values=np.array([0x2A, 0x3C, 0x60, 0x3C], dtype=np.uint8), offsets=np.array([0, 4]))
ROS_BSM = RAW_BSM | {"station": STATION_OCTETS, "transmission": 2}
CARMA_BSM = ODE_BSM | {"station": STATION_OCTETS, "transmission": 2, "width_m": 1.8, "length_m": 4.5}

# The same car in ETSI's codes, with confidences; TAI since 2004: (1570522030 - 1072915200 + 5) s + 80 ms, modulo 65536.
CAM: dict[str, Any] = {
    "station": 1001,
    "generation_delta_time": ((1_570_522_030 - 1_072_915_200 + 5) * 1000 + 80) % 65_536,
    "station_type": 5,
    "container": 0,
    "latitude_deg": 408_646_987,
    "longitude_deg": -778_304_602,
    "altitude_m": 33_560,
    "semi_major_m": 490,
    "semi_minor_m": 245,
    "semi_major_compass_deg": 900,
    "heading_compass_deg": 2700,
    "heading_95_deg": 10,
    "speed_mps": 1000,
    "speed_95_mps": 98,
    "drive_direction": 0,
    "accel_mps2": -35,
    "accel_95_mps2": 2,
    "lateral_accel_mps2": 10,
    "has_lateral_accel_mps2": 1,
    "yaw_rate_degps": 1000,
    "yaw_rate_confidence": 3,
    "length_m": 45,
    "width_m": 18,
}


def ros_paths(paths: Mapping[str, str]) -> dict[str, str]:
    """Leaf fields of a ROS message of ETSI by quantity, and the flags of optional ones as `has_...`."""
    flags = {f"has_{name}": flag for name, flag in ros_presence_paths(paths).items()}
    return {name: ros_leaf_path(path) for name, path in paths.items()} | flags


def message(schema: str, paths: dict[str, str], values: dict[str, Any], encoding: str, **more: Any) -> Columns:
    fields = {paths[name]: [value] if not isinstance(value, Ragged) else value for name, value in values.items()}
    return columns_of(schema, fields | more, topic="/v2x", message_encoding=encoding, log_time_ns=LOG_NS)


def json_bsm(changes: dict[str, Any] | None = None, prefix: str = "", schema: str = "BasicSafetyMessage") -> Columns:
    paths = {name: prefix + leaf for name, leaf in STANDARD_JSON_PATHS_BY_QUANTITY.items()}
    return message(schema, paths, RAW_BSM | (changes or {}), "json")


def ode_bsm(changes: dict[str, Any] | None = None, source: str = "RV") -> Columns:
    paths = {name: f"payload.data.{leaf}" for name, leaf in JSON_ODE_PATHS.items()}
    return message("OdeBsmData", paths, ODE_BSM | (changes or {}), "json", **{"metadata.bsmSource": [source]})


def ros_bsm(changes: dict[str, Any] | None = None) -> Columns:
    return message("j2735_v2x_msgs/msg/BSM", ROS_PATHS, ROS_BSM | (changes or {}), "cdr")


def carma_bsm(changes: dict[str, Any] | None = None, absent: tuple[str, ...] = ()) -> Columns:
    flags: dict[str, int] = {}
    for name, path, bit in CARMA_PRESENCE_MASKS:
        flags[path] = flags.get(path, 0) | (0 if name in absent else bit)
    more = {path: [flag] for path, flag in flags.items()}
    return message("carma_v2x_msgs/msg/BSM", ROS_PATHS, CARMA_BSM | (changes or {}), "cdr", **more)


def cam(changes: dict[str, Any] | None = None, *, is_ts: bool = False) -> Columns:
    schema = "etsi_its_cam_ts_msgs/msg/CAM" if is_ts else "etsi_its_cam_msgs/msg/CAM"
    return message(schema, ros_paths(CAM_TS_PATHS if is_ts else CAM_PATHS), CAM | (changes or {}), "cdr")


def packed_bsm(k: int = 0) -> bytes:
    """The BSM in a MessageFrame, `k` tenths of a second later."""
    codes = {STANDARD_JSON_PATHS_BY_QUANTITY[name]: value for name, value in RAW_BSM.items()}
    codes |= {"coreData.id": 0x2A3C603C, "coreData.transmission": 2}
    codes["coreData.secMark"] += 100 * k
    return packing.framed(packing.bsm(dict.fromkeys(packing.CORE, 0) | codes))


PACKED_CAM = bytes.fromhex("0202000003e9bb880059c00bc9679cbab4c3d41ea70841371e08a8c121f46102c089f417feea0f98d55980")
"""The CAM as pycrate encodes it from ETSI's modules (tests/peers/test_etsi_cam.py does so again)."""


def packed_cam(k: int = 0) -> bytes:
    """The CAM, `k` tenths of a second later: the octets 6 and 7 are its generation time in ms, modulo 65,536."""
    generation = (CAM["generation_delta_time"] + 100 * k) % 65_536
    return PACKED_CAM[:6] + generation.to_bytes(2, "big") + PACKED_CAM[8:]


def radio(schema: str, field: str, *messages: bytes) -> Columns:
    """A channel of octets, all logged at `LOG_NS`."""
    ends = np.cumsum([0, *map(len, messages)])
    octets = Ragged(np.frombuffer(b"".join(messages), np.uint8), ends.astype(np.int64))
    return columns_of(schema, {field: octets}, log_time_ns=np.repeat(LOG_NS, len(messages)), message_encoding="cdr")
