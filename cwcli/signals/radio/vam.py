"""ETSI VRU Awareness Message in the unaligned packed encoding (TS 103 300-3 V2.2.1 and V2.3.1, BTP port 2018).

It says of a pedestrian or a cyclist what a CAM says of a car, in the same codes; only size and driving direction are
not in it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import Field
from cwcli.signals.etsi import EN_PATHS
from cwcli.signals.radio.messages import MISSING_CODE, DecodedMessages
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import Enum, Int, Unread, sequence_type

VAM_MESSAGE_ID = 16
"""The message id of a VAM (TS 102 894-2)."""
VAM_PROTOCOL_VERSIONS = (3,)
"""The protocol versions that are decoded; the one before was packed differently."""

_ACCELERATION_TYPE = sequence_type(("value", Int(-160, 161)), ("confidence", Int(0, 102)))
"""The ASN.1 type of an acceleration with its confidence."""
_ANGLE_TYPE = sequence_type(("value", Int(0, 3601)), ("confidence", Int(1, 127)))
"""The ASN.1 type of an angle with its confidence."""
REFERENCE_POSITION_TYPE = sequence_type(
    ("latitude", Int(-900_000_000, 900_000_001)),
    ("longitude", Int(-1_800_000_000, 1_800_000_001)),
    (
        "positionConfidenceEllipse",
        sequence_type(
            ("semiMajorAxisLength", Int(0, 4095)),
            ("semiMinorAxisLength", Int(0, 4095)),
            ("semiMajorAxisOrientation", Int(0, 3601)),
        ),
    ),
    ("altitude", sequence_type(("altitudeValue", Int(-100_000, 800_001)), ("altitudeConfidence", Enum(16)))),
)
"""The ASN.1 type of a reference position."""
_HIGH_FREQUENCY_CONTAINER_TYPE = sequence_type(
    ("heading", _ANGLE_TYPE),
    ("speed", sequence_type(("speedValue", Int(0, 16_383)), ("speedConfidence", Int(1, 127)))),
    ("longitudinalAcceleration", _ACCELERATION_TYPE),
    ("curvature", sequence_type(("curvatureValue", Int(-1023, 1023)), ("curvatureConfidence", Enum(8))), True),
    ("curvatureCalculationMode", Enum(3, extensible=True), True),
    ("yawRate", sequence_type(("yawRateValue", Int(-32_766, 32_767)), ("yawRateConfidence", Enum(9))), True),
    ("lateralAcceleration", _ACCELERATION_TYPE, True),
    *((name, Unread(), True) for name in ("verticalAcceleration", "vruLanePosition", "environment")),
    *((name, Unread(), True) for name in ("movementControl", "orientation", "rollAngle", "deviceUsage")),
    extensible=True,
)
"""The ASN.1 type of the high-frequency container."""
_UNREAD_CONTAINER_NAMES = (
    "vruLowFrequencyContainer",
    "vruClusterInformationContainer",
    "vruClusterOperationContainer",
    "vruMotionPredictionContainer",
)
"""The containers behind the high-frequency one, which are not read."""
VAM_TYPE = sequence_type(
    (
        "header",
        sequence_type(
            ("protocolVersion", Int(0, 255)), ("messageId", Int(0, 255)), ("stationId", Int(0, 4_294_967_295))
        ),
    ),
    (
        "vam",
        sequence_type(
            ("generationDeltaTime", Int(0, 65_535)),
            (
                "vamParameters",
                sequence_type(
                    (
                        "basicContainer",
                        sequence_type(
                            ("stationType", Int(0, 255)),
                            ("referencePosition", REFERENCE_POSITION_TYPE),
                            extensible=True,
                        ),
                    ),
                    ("vruHighFrequencyContainer", _HIGH_FREQUENCY_CONTAINER_TYPE),
                    *((name, Unread(), True) for name in _UNREAD_CONTAINER_NAMES),
                    extensible=True,
                ),
            ),
        ),
    ),
)
"""The ASN.1 type of a VAM, as far as it is read."""

_PARAMETERS_PREFIX = "vam.vamParameters."
"""The path prefix of the parameters."""
_POSITION_PREFIX = _PARAMETERS_PREFIX + "basicContainer.referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE_PREFIX = _POSITION_PREFIX + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
_MOTION_CONTAINER_PREFIX = _PARAMETERS_PREFIX + "vruHighFrequencyContainer."
"""The path prefix of the high-frequency container."""
_LATERAL_ACCELERATION_PATH = _MOTION_CONTAINER_PREFIX + "lateralAcceleration.value"
"""The path of the lateral acceleration."""

VAM_COMPONENT_PATHS: dict[str, str] = {
    "station": "header.stationId",
    "generation_delta_time": "vam.generationDeltaTime",
    "station_type": _PARAMETERS_PREFIX + "basicContainer.stationType",
    "latitude_deg": _POSITION_PREFIX + "latitude",
    "longitude_deg": _POSITION_PREFIX + "longitude",
    "altitude_m": _POSITION_PREFIX + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE_PREFIX + "semiMajorAxisLength",
    "semi_minor_m": _ELLIPSE_PREFIX + "semiMinorAxisLength",
    "semi_major_compass_deg": _ELLIPSE_PREFIX + "semiMajorAxisOrientation",
    "heading_compass_deg": _MOTION_CONTAINER_PREFIX + "heading.value",
    "heading_95_deg": _MOTION_CONTAINER_PREFIX + "heading.confidence",
    "speed_mps": _MOTION_CONTAINER_PREFIX + "speed.speedValue",
    "speed_95_mps": _MOTION_CONTAINER_PREFIX + "speed.speedConfidence",
    "yaw_rate_degps": _MOTION_CONTAINER_PREFIX + "yawRate.yawRateValue",
    "yaw_rate_confidence": _MOTION_CONTAINER_PREFIX + "yawRate.yawRateConfidence",
    "accel_mps2": _MOTION_CONTAINER_PREFIX + "longitudinalAcceleration.value",
    "accel_95_mps2": _MOTION_CONTAINER_PREFIX + "longitudinalAcceleration.confidence",
    "lateral_accel_mps2": _LATERAL_ACCELERATION_PATH,
}
"""The component of the packed message, by quantity of `signals.etsi`."""


@cache
def compile_vam_program() -> Program:
    """Compile the program that decodes the components of a VAM."""
    return compile_type(VAM_TYPE, tuple(VAM_COMPONENT_PATHS.values()))


def vam_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of `etsi_its_cam_msgs/CAM` that `signals.etsi` reads, from decoded messages."""
    made: dict[str, Field] = {
        EN_PATHS[name]: decoded.component_numbers(path) for name, path in VAM_COMPONENT_PATHS.items()
    }
    made[EN_PATHS["has_lateral_accel"]] = (decoded.component_codes(_LATERAL_ACCELERATION_PATH) != MISSING_CODE).astype(
        np.float64
    )
    return made
