"""The V2X messages of a simulated log: SAE J2735 as JSON, in raw integers or in the ODE's decoded units.

The integers round every value to the standard's step, so that the last bits of a processor's sine can't change the
bytes of a log.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from cwcli.signals.angles import compass_deg_from_heading
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_MS
from cwcli.simulation.v2x_link import ReceivedMessages

BSM_SCHEMA: dict[str, Any] = {
    "title": "BasicSafetyMessage",
    "type": "object",
    "properties": {
        "coreData": {
            "type": "object",
            "properties": {
                "msgCnt": {"type": "integer"},
                "id": {"type": "string"},
                "secMark": {"type": "integer"},
                "lat": {"type": "integer"},
                "long": {"type": "integer"},
                "elev": {"type": "integer"},
                "accuracy": {
                    "type": "object",
                    "properties": {name: {"type": "integer"} for name in ("semiMajor", "semiMinor", "orientation")},
                },
                "transmission": {"type": "string"},
                "speed": {"type": "integer"},
                "heading": {"type": "integer"},
                "angle": {"type": "integer"},
                "accelSet": {
                    "type": "object",
                    "properties": {name: {"type": "integer"} for name in ("long", "lat", "vert", "yaw")},
                },
                "brakes": {
                    "type": "object",
                    "properties": {
                        name: {"type": "string"}
                        for name in ("wheelBrakes", "traction", "abs", "scs", "brakeBoost", "auxBrakes")
                    },
                },
                "size": {
                    "type": "object",
                    "properties": {name: {"type": "integer"} for name in ("width", "length")},
                },
            },
        }
    },
}
"""JSON schema of a BasicSafetyMessage of SAE J2735 with raw integers."""

ODE_SCHEMA: dict[str, Any] = {
    "title": "OdeBsmData",
    "type": "object",
    "properties": {"metadata": {"type": "object"}, "payload": {"type": "object"}},
}
"""JSON schema of a record of the USDOT Operational Data Environment."""

_UNAVAILABLE_BRAKES = {
    "wheelBrakes": "10000",
    "traction": "unavailable",
    "abs": "unavailable",
    "scs": "unavailable",
    "brakeBoost": "unavailable",
    "auxBrakes": "unavailable",
}
"""Brake status of SAE J2735 whose parts are all unavailable."""
_UNAVAILABLE_STEERING_WHEEL_ANGLE_CODE = 127
"""Value of a steering wheel angle, in steps of 1.5 deg, that stands for unavailable (SAE J2735)."""
_UNAVAILABLE_VERTICAL_ACCEL = -127
"""Value of a vertical acceleration, in steps of 0.02 g, that stands for unavailable (SAE J2735)."""


def encode_bsm_json(data: ReceivedMessages, local_map: LocalMap) -> list[bytes]:
    """Encode messages as SAE J2735 BasicSafetyMessage with raw integers.

    Steps are 1e-7 deg, 0.1 m, 0.02 m/s, 0.0125 deg, 0.01 m/s^2 and 0.01 deg/s.

    Yaw rate and lateral acceleration are positive to the right. A negative speed (noise at rest) is sent as 0.
    """
    return [_format_compact_json({"coreData": core}) for core in _bsm_core_data_in_raw_steps(data, local_map)]


def encode_ode_json(data: ReceivedMessages, local_map: LocalMap) -> list[bytes]:
    """Encode messages as records of the USDOT Operational Data Environment, in deg, m, m/s, m/s^2 and deg/s.

    The values are rounded to the same steps as the raw integers.
    """
    rows = zip(
        _bsm_core_data_in_raw_steps(data, local_map), data.stamp_ns.tolist(), data.log_time_ns.tolist(), strict=True
    )
    return [_format_compact_json(_ode_record_from_core_data(core, stamp, log_time)) for core, stamp, log_time in rows]


def _bsm_core_data_in_raw_steps(data: ReceivedMessages, local_map: LocalMap) -> list[dict[str, Any]]:
    """The part `coreData` of each message, with raw integers."""
    x_m, y_m, speed, heading, accel, yaw_rate = data.state.T
    lat_deg, lon_deg, alt_m = local_map.wgs84_from_map(x_m, y_m, np.zeros(len(x_m)))
    accuracy = int(np.clip(np.round(data.sigma[0] / 0.05), 0, 254))
    columns = {
        "msgCnt": data.count % 128,
        "secMark": data.stamp_ns // NS_PER_MS % 60_000,
        "lat": _whole_steps_clipped_to_range(lat_deg, 1e-7, -900_000_000, 900_000_000),
        "long": _whole_steps_clipped_to_range(lon_deg, 1e-7, -1_799_999_999, 1_800_000_000),
        "elev": _whole_steps_clipped_to_range(alt_m, 0.1, -4095, 61439),
        "speed": _whole_steps_clipped_to_range(speed, 0.02, 0, 8190),
        "heading": _whole_steps_clipped_to_range(compass_deg_from_heading(heading), 0.0125, 0, 28800) % 28800,
        "accel": _whole_steps_clipped_to_range(accel, 0.01, -2000, 2000),
        "lateral": _whole_steps_clipped_to_range(-data.lateral_accel_mps2, 0.01, -2000, 2000),
        "yaw": _whole_steps_clipped_to_range(-np.degrees(yaw_rate), 0.01, -32767, 32767),
    }
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [
        {
            "msgCnt": count,
            "id": data.station_id,
            "secMark": mark,
            "lat": lat,
            "long": lon,
            "elev": elev,
            "accuracy": {"semiMajor": accuracy, "semiMinor": accuracy, "orientation": 0},
            "transmission": "forwardGears",
            "speed": speed_steps,
            "heading": course,
            "angle": _UNAVAILABLE_STEERING_WHEEL_ANGLE_CODE,
            "accelSet": {"long": longitudinal, "lat": lateral, "vert": _UNAVAILABLE_VERTICAL_ACCEL, "yaw": yaw},
            "brakes": _UNAVAILABLE_BRAKES,
            "size": {"width": round(data.width_m * 100), "length": round(data.length_m * 100)},
        }
        for count, mark, lat, lon, elev, speed_steps, course, longitudinal, lateral, yaw in rows
    ]


def _ode_record_from_core_data(core: dict[str, Any], stamp_ns: int, log_time_ns: int) -> dict[str, Any]:
    """The ODE record of one message, decoded from its raw integers."""
    accel, accuracy = core["accelSet"], core["accuracy"]
    return {
        "metadata": {
            "bsmSource": "RV",
            "recordType": "bsmTx",
            "payloadType": "us.dot.its.jpo.ode.model.OdeBsmPayload",
            "schemaVersion": 6,
            "recordGeneratedAt": _format_iso_time(stamp_ns),
            "recordGeneratedBy": "OBU",
            "odeReceivedAt": _format_iso_time(log_time_ns),
            "sanitized": False,
        },
        "payload": {
            "dataType": "us.dot.its.jpo.ode.plugin.j2735.J2735Bsm",
            "data": {
                "coreData": {
                    "msgCnt": core["msgCnt"],
                    "id": core["id"],
                    "secMark": core["secMark"],
                    "position": {
                        "latitude": round(core["lat"] * 1e-7, 7),
                        "longitude": round(core["long"] * 1e-7, 7),
                        "elevation": round(core["elev"] * 0.1, 1),
                    },
                    "accelSet": {
                        "accelLat": round(accel["lat"] * 0.01, 2),
                        "accelLong": round(accel["long"] * 0.01, 2),
                        "accelYaw": round(accel["yaw"] * 0.01, 2),
                    },
                    "accuracy": {
                        "semiMajor": round(accuracy["semiMajor"] * 0.05, 2),
                        "semiMinor": round(accuracy["semiMinor"] * 0.05, 2),
                    },
                    "transmission": "FORWARDGEARS",
                    "speed": round(core["speed"] * 0.02, 2),
                    "heading": round(core["heading"] * 0.0125, 4),
                    "size": core["size"],
                }
            },
        },
    }


def _whole_steps_clipped_to_range(values: FloatArray, step: float, low: int, high: int) -> Int64Array:
    """Round values (n,) to whole numbers of steps, clipped to the field's range."""
    return np.clip(np.round(values / step), low, high).astype(np.int64)


def _format_iso_time(time_ns: int) -> str:
    """Format a time in ns since 1970 as ISO 8601 with milliseconds."""
    instant = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=time_ns // NS_PER_MS)
    return instant.strftime("%Y-%m-%dT%H:%M:%S.") + f"{instant.microsecond // 1000:03d}Z"


def _format_compact_json(value: dict[str, Any]) -> bytes:
    """Format a value as JSON without spaces, in bytes."""
    return json.dumps(value, separators=(",", ":")).encode()
