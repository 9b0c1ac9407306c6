"""ETSI Collective Perception Message in the unaligned packed encoding (TS 103 324 V2.1.1, BTP port 2009).

What its sender perceived of others: each object is a road user of its own (`signals.cpm`).
"""

from __future__ import annotations

from functools import cache

from cwcli.signals.columns import Field
from cwcli.signals.radio.messages import DecodedMessages
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import FORBIDDEN_TYPE, Choice, Enum, Int, ListOf, Open, bit_string_type, sequence_type
from cwcli.signals.radio.vam import REFERENCE_POSITION_TYPE

CPM_MESSAGE_ID = 14
"""The message id of a CPM (TS 102 894-2)."""
CPM_PROTOCOL_VERSIONS = (2,)
"""The protocol versions that are decoded; version 1 (TR 103 562) was packed differently."""

_IDENTIFIER_1B_TYPE, _IDENTIFIER_2B_TYPE = Int(0, 255), Int(0, 65_535)
"""The ASN.1 types of identifiers of one and two octets."""
_COORDINATE_TYPE = sequence_type(("value", Int(-131_072, 131_071)), ("confidence", Int(1, 4096)))
"""The ASN.1 type of a coordinate with its confidence."""
_VELOCITY_COMPONENT_TYPE = sequence_type(("value", Int(-16_383, 16_383)), ("confidence", Int(1, 127)))
"""The ASN.1 type of a component of a velocity."""
_ACCELERATION_COMPONENT_TYPE = sequence_type(("value", Int(-160, 161)), ("confidence", Int(0, 102)))
"""The ASN.1 type of a component of an acceleration."""
_ANGLE_TYPE = sequence_type(("value", Int(0, 3601)), ("confidence", Int(1, 127)))
"""The ASN.1 type of an angle with its confidence."""
_DIMENSION_TYPE = sequence_type(("value", Int(1, 256)), ("confidence", Int(1, 32)))
"""The ASN.1 type of an object's dimension."""
_VELOCITY_TYPE = Choice(
    sequence_type(
        (
            "polarVelocity",
            sequence_type(
                (
                    "velocityMagnitude",
                    sequence_type(("speedValue", Int(0, 16_383)), ("speedConfidence", Int(1, 127))),
                ),
                ("velocityDirection", _ANGLE_TYPE),
                ("zVelocity", _VELOCITY_COMPONENT_TYPE, True),
            ),
        ),
        (
            "cartesianVelocity",
            sequence_type(
                ("xVelocity", _VELOCITY_COMPONENT_TYPE),
                ("yVelocity", _VELOCITY_COMPONENT_TYPE),
                ("zVelocity", _VELOCITY_COMPONENT_TYPE, True),
            ),
        ),
    ).parts
)
"""The ASN.1 type of a velocity, polar or Cartesian."""
_ACCELERATION_TYPE = Choice(
    sequence_type(
        (
            "polarAcceleration",
            sequence_type(
                (
                    "accelerationMagnitude",
                    sequence_type(("accelerationMagnitudeValue", Int(0, 161)), ("accelerationConfidence", Int(0, 102))),
                ),
                ("accelerationDirection", _ANGLE_TYPE),
                ("zAcceleration", _ACCELERATION_COMPONENT_TYPE, True),
            ),
        ),
        (
            "cartesianAcceleration",
            sequence_type(
                ("xAcceleration", _ACCELERATION_COMPONENT_TYPE),
                ("yAcceleration", _ACCELERATION_COMPONENT_TYPE),
                ("zAcceleration", _ACCELERATION_COMPONENT_TYPE, True),
            ),
        ),
    ).parts
)
"""The ASN.1 type of an acceleration, polar or Cartesian."""
_CORRELATIONS_TYPE = ListOf(
    sequence_type(
        ("componentsIncludedIntheMatrix", bit_string_type(13, extensible=True)),
        ("matrix", ListOf(ListOf(Int(-100, 101), 1, 13, extensible=True), 1, 13)),
    ),
    1,
    4,
)
"""The ASN.1 type of the correlation matrices."""
_VRU_SUB_CLASS_TYPE = Choice(
    sequence_type(
        ("pedestrian", Enum(5)),
        ("bicyclistAndLightVruVehicle", Enum(10)),
        ("motorcyclist", Enum(6)),
        ("animal", Enum(5)),
    ).parts,
    extensible=True,
)
"""The ASN.1 type of the class of a vulnerable road user."""
_CLUSTER_TYPE = sequence_type(
    ("clusterId", _IDENTIFIER_1B_TYPE, True),
    ("clusterBoundingBoxShape", FORBIDDEN_TYPE, True),
    ("clusterCardinalitySize", _IDENTIFIER_1B_TYPE),
    ("clusterProfiles", bit_string_type(4), True),
    extensible=True,
)
"""The ASN.1 type of a cluster of road users."""
_OBJECT_CLASS_TYPE = Choice(
    sequence_type(
        ("vehicleSubClass", Int(0, 14)),
        ("vruSubClass", _VRU_SUB_CLASS_TYPE),
        ("groupSubClass", _CLUSTER_TYPE),
        ("otherSubClass", Int(0, 255)),
    ).parts,
    extensible=True,
)
"""The ASN.1 type of an object's class."""
_ROAD_ID_TYPE = sequence_type(("region", _IDENTIFIER_2B_TYPE, True), ("id", _IDENTIFIER_2B_TYPE))
"""The ASN.1 type of the id of a road segment or intersection."""
_MAP_POSITION_TYPE = sequence_type(
    (
        "mapReference",
        Choice(sequence_type(("roadsegment", _ROAD_ID_TYPE), ("intersection", _ROAD_ID_TYPE)).parts),
        True,
    ),
    ("laneId", _IDENTIFIER_1B_TYPE, True),
    ("connectionId", _IDENTIFIER_1B_TYPE, True),
    (
        "longitudinalLanePosition",
        sequence_type(
            ("longitudinalLanePositionValue", Int(0, 32_767)), ("longitudinalLanePositionConfidence", Int(0, 1023))
        ),
        True,
    ),
    extensible=True,
)
"""The ASN.1 type of a position on a map."""
_PERCEIVED_OBJECT_TYPE = sequence_type(
    ("objectId", _IDENTIFIER_2B_TYPE, True),
    ("measurementDeltaTime", Int(-2048, 2047)),
    (
        "position",
        sequence_type(
            ("xCoordinate", _COORDINATE_TYPE),
            ("yCoordinate", _COORDINATE_TYPE),
            ("zCoordinate", _COORDINATE_TYPE, True),
        ),
    ),
    ("velocity", _VELOCITY_TYPE, True),
    ("acceleration", _ACCELERATION_TYPE, True),
    (
        "angles",
        sequence_type(("zAngle", _ANGLE_TYPE), ("yAngle", _ANGLE_TYPE, True), ("xAngle", _ANGLE_TYPE, True)),
        True,
    ),
    ("zAngularVelocity", sequence_type(("value", Int(-255, 256)), ("confidence", Enum(8))), True),
    ("lowerTriangularCorrelationMatrices", _CORRELATIONS_TYPE, True),
    ("objectDimensionZ", _DIMENSION_TYPE, True),
    ("objectDimensionY", _DIMENSION_TYPE, True),
    ("objectDimensionX", _DIMENSION_TYPE, True),
    ("objectAge", Int(0, 2047), True),
    ("objectPerceptionQuality", Int(0, 15), True),
    ("sensorIdList", ListOf(_IDENTIFIER_1B_TYPE, 1, 128, extensible=True), True),
    (
        "classification",
        ListOf(sequence_type(("objectClass", _OBJECT_CLASS_TYPE), ("confidence", Int(1, 101))), 1, 8),
        True,
    ),
    ("mapPosition", _MAP_POSITION_TYPE, True),
    extensible=True,
)
"""The ASN.1 type of a perceived object."""
_PERCEIVED_CONTAINER_TYPE = sequence_type(
    ("numberOfPerceivedObjects", Int(0, 255)),
    ("perceivedObjects", ListOf(_PERCEIVED_OBJECT_TYPE, 0, 255, extensible=True)),
    extensible=True,
)
"""The ASN.1 type of the container of perceived objects."""
_MESSAGE_RATE_TYPE = sequence_type(("mantissa", Int(1, 100)), ("exponent", Int(-5, 2)))
"""The ASN.1 type of a message rate."""
PERCEIVED_OBJECT_CONTAINER_ID = 5
"""The id of the container of perceived objects."""
CPM_TYPE = sequence_type(
    (
        "header",
        sequence_type(
            ("protocolVersion", Int(0, 255)), ("messageId", Int(0, 255)), ("stationId", Int(0, 4_294_967_295))
        ),
    ),
    (
        "payload",
        sequence_type(
            (
                "managementContainer",
                sequence_type(
                    ("referenceTime", Int(0, 4_398_046_511_103)),
                    ("referencePosition", REFERENCE_POSITION_TYPE),
                    ("segmentationInfo", sequence_type(("totalMsgNo", Int(1, 8)), ("thisMsgNo", Int(1, 8))), True),
                    (
                        "messageRateRange",
                        sequence_type(("messageRateMin", _MESSAGE_RATE_TYPE), ("messageRateMax", _MESSAGE_RATE_TYPE)),
                        True,
                    ),
                    extensible=True,
                ),
            ),
            (
                "cpmContainers",
                ListOf(
                    sequence_type(
                        ("containerId", Int(1, 16)),
                        ("containerData", Open({PERCEIVED_OBJECT_CONTAINER_ID: _PERCEIVED_CONTAINER_TYPE})),
                    ),
                    1,
                    8,
                ),
            ),
            extensible=True,
        ),
    ),
)
"""The ASN.1 type of a CPM; of its containers only that of the perceived objects is read.

The list of containers is that of an extensible type with one more constraint (`ConstraintWrappedCpmContainers`), which
takes the extension away (X.680, 50.8): there is no bit for it.
"""

_MANAGEMENT_PREFIX = "payload.managementContainer."
"""The path prefix of the management container."""
_POSITION_PREFIX = _MANAGEMENT_PREFIX + "referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE_PREFIX = _POSITION_PREFIX + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
OBJECTS_PATH = "payload.cpmContainers.containerData.perceivedObjects"
"""The path of the list of perceived objects."""

SENDER_COMPONENT_PATHS: dict[str, str] = {
    "station": "header.stationId",
    "reference_time_ms": _MANAGEMENT_PREFIX + "referenceTime",
    "latitude_deg": _POSITION_PREFIX + "latitude",
    "longitude_deg": _POSITION_PREFIX + "longitude",
    "altitude_m": _POSITION_PREFIX + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE_PREFIX + "semiMajorAxisLength",
    "semi_minor_m": _ELLIPSE_PREFIX + "semiMinorAxisLength",
    "semi_major_compass_deg": _ELLIPSE_PREFIX + "semiMajorAxisOrientation",
}
"""The component of the packed message, by quantity of the sender in `signals.cpm`."""
OBJECT_COMPONENT_PATHS: dict[str, str] = {
    "object": "objectId",
    "delta_time_ms": "measurementDeltaTime",
    "east_m": "position.xCoordinate.value",
    "east_95_m": "position.xCoordinate.confidence",
    "north_m": "position.yCoordinate.value",
    "north_95_m": "position.yCoordinate.confidence",
    "speed_mps": "velocity.polarVelocity.velocityMagnitude.speedValue",
    "speed_95_mps": "velocity.polarVelocity.velocityMagnitude.speedConfidence",
    "direction_deg": "velocity.polarVelocity.velocityDirection.value",
    "direction_95_deg": "velocity.polarVelocity.velocityDirection.confidence",
    "east_mps": "velocity.cartesianVelocity.xVelocity.value",
    "east_95_mps": "velocity.cartesianVelocity.xVelocity.confidence",
    "north_mps": "velocity.cartesianVelocity.yVelocity.value",
    "north_95_mps": "velocity.cartesianVelocity.yVelocity.confidence",
    "accel_mps2": "acceleration.polarAcceleration.accelerationMagnitude.accelerationMagnitudeValue",
    "accel_95_mps2": "acceleration.polarAcceleration.accelerationMagnitude.accelerationConfidence",
    "accel_direction_deg": "acceleration.polarAcceleration.accelerationDirection.value",
    "east_mps2": "acceleration.cartesianAcceleration.xAcceleration.value",
    "east_95_mps2": "acceleration.cartesianAcceleration.xAcceleration.confidence",
    "north_mps2": "acceleration.cartesianAcceleration.yAcceleration.value",
    "north_95_mps2": "acceleration.cartesianAcceleration.yAcceleration.confidence",
    "heading_deg": "angles.zAngle.value",
    "heading_95_deg": "angles.zAngle.confidence",
    "yaw_rate_degps": "zAngularVelocity.value",
    "yaw_rate_confidence": "zAngularVelocity.confidence",
    "width_m": "objectDimensionY.value",
    "length_m": "objectDimensionX.value",
}
"""The component of a packed object, by quantity of the object in `signals.cpm`."""


@cache
def compile_cpm_program() -> Program:
    """Compile the program that decodes the components of sender and objects."""
    of_objects = (f"{OBJECTS_PATH}.{path}" for path in OBJECT_COMPONENT_PATHS.values())
    return compile_type(CPM_TYPE, (*SENDER_COMPONENT_PATHS.values(), *of_objects), (OBJECTS_PATH,))


def cpm_objects_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the quantities that `signals.cpm` reads, one row an object, from decoded messages."""
    rows = decoded.rows[OBJECTS_PATH]
    made: dict[str, Field] = {
        name: decoded.component_numbers(path)[rows] for name, path in SENDER_COMPONENT_PATHS.items()
    }
    made |= {name: decoded.component_numbers(f"{OBJECTS_PATH}.{path}") for name, path in OBJECT_COMPONENT_PATHS.items()}
    return made
