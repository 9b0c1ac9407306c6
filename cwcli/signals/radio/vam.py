"""ETSI VRU Awareness Message in the unaligned packed encoding (TS 103 300-3 V2.2.1 and V2.3.1, BTP port 2018).

It says of a pedestrian or a cyclist what a CAM says of a car, in the same codes; only size and driving direction are
not in it.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import Field
from cwcli.signals.etsi import EN_PATHS
from cwcli.signals.radio.messages import MISSING, Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import Enum, Int, Unread, sequence

MESSAGE_ID = 16
"""The message id of a VAM (TS 102 894-2)."""
PROTOCOL_VERSIONS = (3,)
"""The protocol versions that are decoded; the one before was packed differently."""

_ACCELERATION = sequence(("value", Int(-160, 161)), ("confidence", Int(0, 102)))
"""The ASN.1 type of an acceleration with its confidence."""
_ANGLE = sequence(("value", Int(0, 3601)), ("confidence", Int(1, 127)))
"""The ASN.1 type of an angle with its confidence."""
REFERENCE_POSITION = sequence(
    ("latitude", Int(-900_000_000, 900_000_001)),
    ("longitude", Int(-1_800_000_000, 1_800_000_001)),
    (
        "positionConfidenceEllipse",
        sequence(
            ("semiMajorAxisLength", Int(0, 4095)),
            ("semiMinorAxisLength", Int(0, 4095)),
            ("semiMajorAxisOrientation", Int(0, 3601)),
        ),
    ),
    ("altitude", sequence(("altitudeValue", Int(-100_000, 800_001)), ("altitudeConfidence", Enum(16)))),
)
"""The ASN.1 type of a reference position."""
_HIGH_FREQUENCY = sequence(
    ("heading", _ANGLE),
    ("speed", sequence(("speedValue", Int(0, 16_383)), ("speedConfidence", Int(1, 127)))),
    ("longitudinalAcceleration", _ACCELERATION),
    ("curvature", sequence(("curvatureValue", Int(-1023, 1023)), ("curvatureConfidence", Enum(8))), True),
    ("curvatureCalculationMode", Enum(3, extensible=True), True),
    ("yawRate", sequence(("yawRateValue", Int(-32_766, 32_767)), ("yawRateConfidence", Enum(9))), True),
    ("lateralAcceleration", _ACCELERATION, True),
    *((name, Unread(), True) for name in ("verticalAcceleration", "vruLanePosition", "environment")),
    *((name, Unread(), True) for name in ("movementControl", "orientation", "rollAngle", "deviceUsage")),
    extensible=True,
)
"""The ASN.1 type of the high-frequency container."""
_LATER_CONTAINERS = (
    "vruLowFrequencyContainer",
    "vruClusterInformationContainer",
    "vruClusterOperationContainer",
    "vruMotionPredictionContainer",
)
"""The containers behind the high-frequency one, which are not read."""
VAM = sequence(
    (
        "header",
        sequence(("protocolVersion", Int(0, 255)), ("messageId", Int(0, 255)), ("stationId", Int(0, 4_294_967_295))),
    ),
    (
        "vam",
        sequence(
            ("generationDeltaTime", Int(0, 65_535)),
            (
                "vamParameters",
                sequence(
                    (
                        "basicContainer",
                        sequence(
                            ("stationType", Int(0, 255)), ("referencePosition", REFERENCE_POSITION), extensible=True
                        ),
                    ),
                    ("vruHighFrequencyContainer", _HIGH_FREQUENCY),
                    *((name, Unread(), True) for name in _LATER_CONTAINERS),
                    extensible=True,
                ),
            ),
        ),
    ),
)
"""The ASN.1 type of a VAM, as far as it is read."""

_PARAMETERS = "vam.vamParameters."
"""The path prefix of the parameters."""
_POSITION = _PARAMETERS + "basicContainer.referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE = _POSITION + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
_MOTION = _PARAMETERS + "vruHighFrequencyContainer."
"""The path prefix of the high-frequency container."""
_LATERAL = _MOTION + "lateralAcceleration.value"
"""The path of the lateral acceleration."""

PATHS: dict[str, str] = {
    "station": "header.stationId",
    "generation_delta_time": "vam.generationDeltaTime",
    "station_type": _PARAMETERS + "basicContainer.stationType",
    "latitude_deg": _POSITION + "latitude",
    "longitude_deg": _POSITION + "longitude",
    "altitude_m": _POSITION + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE + "semiMajorAxisLength",
    "semi_minor_m": _ELLIPSE + "semiMinorAxisLength",
    "semi_major_compass_deg": _ELLIPSE + "semiMajorAxisOrientation",
    "heading_compass_deg": _MOTION + "heading.value",
    "heading_95_deg": _MOTION + "heading.confidence",
    "speed_mps": _MOTION + "speed.speedValue",
    "speed_95_mps": _MOTION + "speed.speedConfidence",
    "yaw_rate_degps": _MOTION + "yawRate.yawRateValue",
    "yaw_rate_confidence": _MOTION + "yawRate.yawRateConfidence",
    "accel_mps2": _MOTION + "longitudinalAcceleration.value",
    "accel_95_mps2": _MOTION + "longitudinalAcceleration.confidence",
    "lateral_accel_mps2": _LATERAL,
}
"""The component of the packed message, by quantity of `signals.etsi`."""


@cache
def program() -> Program:
    """Compile the program that decodes the components of a VAM."""
    return compile_type(VAM, tuple(PATHS.values()))


def fields(decoded: Decoded) -> dict[str, Field]:
    """Return the leaf fields of `etsi_its_cam_msgs/CAM` that `signals.etsi` reads, from decoded messages."""
    made: dict[str, Field] = {EN_PATHS[name]: decoded.numbers(path) for name, path in PATHS.items()}
    made[EN_PATHS["has_lateral_accel"]] = (decoded.codes(_LATERAL) != MISSING).astype(np.float64)
    return made
