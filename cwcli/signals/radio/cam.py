"""ETSI Cooperative Awareness Message in the unaligned packed encoding (EN 302 637-2 V1.4.1, BTP port 2001).

Release 2 (TS 103 900) packs what is read here alike.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import Field
from cwcli.signals.etsi import EN_PATHS
from cwcli.signals.radio.messages import MISSING_CODE, DecodedMessages
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.tables import load_message_type

CAM_MESSAGE_ID = 2
"""The message id of a CAM (TS 102 894-2)."""
CAM_PROTOCOL_VERSIONS = (2,)
"""The protocol versions that are decoded; the one before (EN 302 637-2 up to V1.3.2) packs the curvature
differently."""

_PARAMETERS_PREFIX = "cam.camParameters."
"""The path prefix of the parameters."""
_POSITION_PREFIX = _PARAMETERS_PREFIX + "basicContainer.referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE_PREFIX = _POSITION_PREFIX + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
_CONTAINER_PATH = _PARAMETERS_PREFIX + "highFrequencyContainer"
"""The path of the high-frequency container."""
_VEHICLE_CONTAINER_PREFIX = _CONTAINER_PATH + ".basicVehicleContainerHighFrequency."
"""The path prefix of the vehicle's high-frequency container."""
_LATERAL_ACCELERATION_PATH = _VEHICLE_CONTAINER_PREFIX + "lateralAcceleration.lateralAccelerationValue"
"""The path of the lateral acceleration."""

CAM_COMPONENT_PATHS: dict[str, str] = {
    "station": "header.stationID",
    "generation_delta_time": "cam.generationDeltaTime",
    "station_type": _PARAMETERS_PREFIX + "basicContainer.stationType",
    "container": _CONTAINER_PATH,
    "latitude_deg": _POSITION_PREFIX + "latitude",
    "longitude_deg": _POSITION_PREFIX + "longitude",
    "altitude_m": _POSITION_PREFIX + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE_PREFIX + "semiMajorConfidence",
    "semi_minor_m": _ELLIPSE_PREFIX + "semiMinorConfidence",
    "semi_major_compass_deg": _ELLIPSE_PREFIX + "semiMajorOrientation",
    "heading_compass_deg": _VEHICLE_CONTAINER_PREFIX + "heading.headingValue",
    "heading_95_deg": _VEHICLE_CONTAINER_PREFIX + "heading.headingConfidence",
    "speed_mps": _VEHICLE_CONTAINER_PREFIX + "speed.speedValue",
    "speed_95_mps": _VEHICLE_CONTAINER_PREFIX + "speed.speedConfidence",
    "drive_direction": _VEHICLE_CONTAINER_PREFIX + "driveDirection",
    "yaw_rate_degps": _VEHICLE_CONTAINER_PREFIX + "yawRate.yawRateValue",
    "yaw_rate_confidence": _VEHICLE_CONTAINER_PREFIX + "yawRate.yawRateConfidence",
    "length_m": _VEHICLE_CONTAINER_PREFIX + "vehicleLength.vehicleLengthValue",
    "width_m": _VEHICLE_CONTAINER_PREFIX + "vehicleWidth",
    "accel_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinalAcceleration.longitudinalAccelerationValue",
    "accel_95_mps2": _VEHICLE_CONTAINER_PREFIX + "longitudinalAcceleration.longitudinalAccelerationConfidence",
    "lateral_accel_mps2": _LATERAL_ACCELERATION_PATH,
}
"""The component of the packed message, by quantity of `signals.etsi`."""


@cache
def compile_cam_program() -> Program:
    """Compile the program that decodes the components of a CAM."""
    return compile_type(load_message_type("cam"), tuple(CAM_COMPONENT_PATHS.values()))


def cam_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of `etsi_its_cam_msgs/CAM` that `signals.etsi` reads, from decoded messages."""
    made: dict[str, Field] = {
        EN_PATHS[name]: decoded.component_numbers(path) for name, path in CAM_COMPONENT_PATHS.items()
    }
    made[EN_PATHS["has_lateral_accel"]] = (decoded.component_codes(_LATERAL_ACCELERATION_PATH) != MISSING_CODE).astype(
        np.float64
    )
    return made
