"""ETSI Cooperative Awareness Message in the unaligned packed encoding (EN 302 637-2 V1.4.1, BTP port 2001).

Release 2 (TS 103 900) packs what is read here alike.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import Field
from cwcli.signals.etsi import EN_PATHS
from cwcli.signals.radio.messages import MISSING, Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.tables import load

MESSAGE_ID = 2
"""The message id of a CAM (TS 102 894-2)."""
PROTOCOL_VERSIONS = (2,)
"""The protocol versions that are decoded; the one before (EN 302 637-2 up to V1.3.2) packs the curvature
differently."""

_PARAMETERS = "cam.camParameters."
"""The path prefix of the parameters."""
_POSITION = _PARAMETERS + "basicContainer.referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE = _POSITION + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
_CONTAINER = _PARAMETERS + "highFrequencyContainer"
"""The path of the high-frequency container."""
_VEHICLE = _CONTAINER + ".basicVehicleContainerHighFrequency."
"""The path prefix of the vehicle's high-frequency container."""
_LATERAL = _VEHICLE + "lateralAcceleration.lateralAccelerationValue"
"""The path of the lateral acceleration."""

PATHS: dict[str, str] = {
    "station": "header.stationID",
    "generation_delta_time": "cam.generationDeltaTime",
    "station_type": _PARAMETERS + "basicContainer.stationType",
    "container": _CONTAINER,
    "latitude_deg": _POSITION + "latitude",
    "longitude_deg": _POSITION + "longitude",
    "altitude_m": _POSITION + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE + "semiMajorConfidence",
    "semi_minor_m": _ELLIPSE + "semiMinorConfidence",
    "semi_major_compass_deg": _ELLIPSE + "semiMajorOrientation",
    "heading_compass_deg": _VEHICLE + "heading.headingValue",
    "heading_95_deg": _VEHICLE + "heading.headingConfidence",
    "speed_mps": _VEHICLE + "speed.speedValue",
    "speed_95_mps": _VEHICLE + "speed.speedConfidence",
    "drive_direction": _VEHICLE + "driveDirection",
    "yaw_rate_degps": _VEHICLE + "yawRate.yawRateValue",
    "yaw_rate_confidence": _VEHICLE + "yawRate.yawRateConfidence",
    "length_m": _VEHICLE + "vehicleLength.vehicleLengthValue",
    "width_m": _VEHICLE + "vehicleWidth",
    "accel_mps2": _VEHICLE + "longitudinalAcceleration.longitudinalAccelerationValue",
    "accel_95_mps2": _VEHICLE + "longitudinalAcceleration.longitudinalAccelerationConfidence",
    "lateral_accel_mps2": _LATERAL,
}
"""The component of the packed message, by quantity of `signals.etsi`."""


@cache
def program() -> Program:
    """Compile the program that decodes the components of a CAM."""
    return compile_type(load("cam"), tuple(PATHS.values()))


def fields(decoded: Decoded) -> dict[str, Field]:
    """Return the leaf fields of `etsi_its_cam_msgs/CAM` that `signals.etsi` reads, from decoded messages."""
    made: dict[str, Field] = {EN_PATHS[name]: decoded.numbers(path) for name, path in PATHS.items()}
    made[EN_PATHS["has_lateral_accel"]] = (decoded.codes(_LATERAL) != MISSING).astype(np.float64)
    return made
