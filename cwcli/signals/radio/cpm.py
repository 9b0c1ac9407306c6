"""ETSI Collective Perception Message in the unaligned packed encoding (TS 103 324 V2.1.1, BTP port 2009).

What its sender perceived of others: each object is a road user of its own (`signals.cpm`).
"""

from __future__ import annotations

from functools import cache

from cwcli.signals.columns import Field
from cwcli.signals.radio.messages import Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import NEVER, Choice, Enum, Int, ListOf, Open, bits, sequence
from cwcli.signals.radio.vam import REFERENCE_POSITION

MESSAGE_ID = 14
"""The message id of a CPM (TS 102 894-2)."""
PROTOCOL_VERSIONS = (2,)
"""The protocol versions that are decoded; version 1 (TR 103 562) was packed differently."""

_IDENTIFIER_1B, _IDENTIFIER_2B = Int(0, 255), Int(0, 65_535)
"""The ASN.1 types of identifiers of one and two octets."""
_COORDINATE = sequence(("value", Int(-131_072, 131_071)), ("confidence", Int(1, 4096)))
"""The ASN.1 type of a coordinate with its confidence."""
_VELOCITY_COMPONENT = sequence(("value", Int(-16_383, 16_383)), ("confidence", Int(1, 127)))
"""The ASN.1 type of a component of a velocity."""
_ACCELERATION_COMPONENT = sequence(("value", Int(-160, 161)), ("confidence", Int(0, 102)))
"""The ASN.1 type of a component of an acceleration."""
_ANGLE = sequence(("value", Int(0, 3601)), ("confidence", Int(1, 127)))
"""The ASN.1 type of an angle with its confidence."""
_DIMENSION = sequence(("value", Int(1, 256)), ("confidence", Int(1, 32)))
"""The ASN.1 type of an object's dimension."""
_VELOCITY = Choice(
    sequence(
        (
            "polarVelocity",
            sequence(
                (
                    "velocityMagnitude",
                    sequence(("speedValue", Int(0, 16_383)), ("speedConfidence", Int(1, 127))),
                ),
                ("velocityDirection", _ANGLE),
                ("zVelocity", _VELOCITY_COMPONENT, True),
            ),
        ),
        (
            "cartesianVelocity",
            sequence(
                ("xVelocity", _VELOCITY_COMPONENT),
                ("yVelocity", _VELOCITY_COMPONENT),
                ("zVelocity", _VELOCITY_COMPONENT, True),
            ),
        ),
    ).parts
)
"""The ASN.1 type of a velocity, polar or Cartesian."""
_ACCELERATION = Choice(
    sequence(
        (
            "polarAcceleration",
            sequence(
                (
                    "accelerationMagnitude",
                    sequence(("accelerationMagnitudeValue", Int(0, 161)), ("accelerationConfidence", Int(0, 102))),
                ),
                ("accelerationDirection", _ANGLE),
                ("zAcceleration", _ACCELERATION_COMPONENT, True),
            ),
        ),
        (
            "cartesianAcceleration",
            sequence(
                ("xAcceleration", _ACCELERATION_COMPONENT),
                ("yAcceleration", _ACCELERATION_COMPONENT),
                ("zAcceleration", _ACCELERATION_COMPONENT, True),
            ),
        ),
    ).parts
)
"""The ASN.1 type of an acceleration, polar or Cartesian."""
_CORRELATIONS = ListOf(
    sequence(
        ("componentsIncludedIntheMatrix", bits(13, extensible=True)),
        ("matrix", ListOf(ListOf(Int(-100, 101), 1, 13, extensible=True), 1, 13)),
    ),
    1,
    4,
)
"""The ASN.1 type of the correlation matrices."""
_VRU_SUB_CLASS = Choice(
    sequence(
        ("pedestrian", Enum(5)),
        ("bicyclistAndLightVruVehicle", Enum(10)),
        ("motorcyclist", Enum(6)),
        ("animal", Enum(5)),
    ).parts,
    extensible=True,
)
"""The ASN.1 type of the class of a vulnerable road user."""
_CLUSTER = sequence(
    ("clusterId", _IDENTIFIER_1B, True),
    ("clusterBoundingBoxShape", NEVER, True),
    ("clusterCardinalitySize", _IDENTIFIER_1B),
    ("clusterProfiles", bits(4), True),
    extensible=True,
)
"""The ASN.1 type of a cluster of road users."""
_CLASS = Choice(
    sequence(
        ("vehicleSubClass", Int(0, 14)),
        ("vruSubClass", _VRU_SUB_CLASS),
        ("groupSubClass", _CLUSTER),
        ("otherSubClass", Int(0, 255)),
    ).parts,
    extensible=True,
)
"""The ASN.1 type of an object's class."""
_ROAD_ID = sequence(("region", _IDENTIFIER_2B, True), ("id", _IDENTIFIER_2B))
"""The ASN.1 type of the id of a road segment or intersection."""
_MAP_POSITION = sequence(
    ("mapReference", Choice(sequence(("roadsegment", _ROAD_ID), ("intersection", _ROAD_ID)).parts), True),
    ("laneId", _IDENTIFIER_1B, True),
    ("connectionId", _IDENTIFIER_1B, True),
    (
        "longitudinalLanePosition",
        sequence(
            ("longitudinalLanePositionValue", Int(0, 32_767)), ("longitudinalLanePositionConfidence", Int(0, 1023))
        ),
        True,
    ),
    extensible=True,
)
"""The ASN.1 type of a position on a map."""
_OBJECT = sequence(
    ("objectId", _IDENTIFIER_2B, True),
    ("measurementDeltaTime", Int(-2048, 2047)),
    (
        "position",
        sequence(("xCoordinate", _COORDINATE), ("yCoordinate", _COORDINATE), ("zCoordinate", _COORDINATE, True)),
    ),
    ("velocity", _VELOCITY, True),
    ("acceleration", _ACCELERATION, True),
    ("angles", sequence(("zAngle", _ANGLE), ("yAngle", _ANGLE, True), ("xAngle", _ANGLE, True)), True),
    ("zAngularVelocity", sequence(("value", Int(-255, 256)), ("confidence", Enum(8))), True),
    ("lowerTriangularCorrelationMatrices", _CORRELATIONS, True),
    ("objectDimensionZ", _DIMENSION, True),
    ("objectDimensionY", _DIMENSION, True),
    ("objectDimensionX", _DIMENSION, True),
    ("objectAge", Int(0, 2047), True),
    ("objectPerceptionQuality", Int(0, 15), True),
    ("sensorIdList", ListOf(_IDENTIFIER_1B, 1, 128, extensible=True), True),
    ("classification", ListOf(sequence(("objectClass", _CLASS), ("confidence", Int(1, 101))), 1, 8), True),
    ("mapPosition", _MAP_POSITION, True),
    extensible=True,
)
"""The ASN.1 type of a perceived object."""
_PERCEIVED = sequence(
    ("numberOfPerceivedObjects", Int(0, 255)),
    ("perceivedObjects", ListOf(_OBJECT, 0, 255, extensible=True)),
    extensible=True,
)
"""The ASN.1 type of the container of perceived objects."""
_RATE = sequence(("mantissa", Int(1, 100)), ("exponent", Int(-5, 2)))
"""The ASN.1 type of a message rate."""
PERCEIVED_OBJECT_CONTAINER = 5
"""The id of the container of perceived objects."""
CPM = sequence(
    (
        "header",
        sequence(("protocolVersion", Int(0, 255)), ("messageId", Int(0, 255)), ("stationId", Int(0, 4_294_967_295))),
    ),
    (
        "payload",
        sequence(
            (
                "managementContainer",
                sequence(
                    ("referenceTime", Int(0, 4_398_046_511_103)),
                    ("referencePosition", REFERENCE_POSITION),
                    ("segmentationInfo", sequence(("totalMsgNo", Int(1, 8)), ("thisMsgNo", Int(1, 8))), True),
                    ("messageRateRange", sequence(("messageRateMin", _RATE), ("messageRateMax", _RATE)), True),
                    extensible=True,
                ),
            ),
            (
                "cpmContainers",
                ListOf(
                    sequence(
                        ("containerId", Int(1, 16)),
                        ("containerData", Open({PERCEIVED_OBJECT_CONTAINER: _PERCEIVED})),
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

_MANAGEMENT = "payload.managementContainer."
"""The path prefix of the management container."""
_POSITION = _MANAGEMENT + "referencePosition."
"""The path prefix of the reference position."""
_ELLIPSE = _POSITION + "positionConfidenceEllipse."
"""The path prefix of the position's confidence ellipse."""
OBJECTS = "payload.cpmContainers.containerData.perceivedObjects"
"""The path of the list of perceived objects."""

SENDER_PATHS: dict[str, str] = {
    "station": "header.stationId",
    "reference_time_ms": _MANAGEMENT + "referenceTime",
    "latitude_deg": _POSITION + "latitude",
    "longitude_deg": _POSITION + "longitude",
    "altitude_m": _POSITION + "altitude.altitudeValue",
    "semi_major_m": _ELLIPSE + "semiMajorAxisLength",
    "semi_minor_m": _ELLIPSE + "semiMinorAxisLength",
    "semi_major_compass_deg": _ELLIPSE + "semiMajorAxisOrientation",
}
"""The component of the packed message, by quantity of the sender in `signals.cpm`."""
OBJECT_PATHS: dict[str, str] = {
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
def program() -> Program:
    """Compile the program that decodes the components of sender and objects."""
    of_objects = (f"{OBJECTS}.{path}" for path in OBJECT_PATHS.values())
    return compile_type(CPM, (*SENDER_PATHS.values(), *of_objects), (OBJECTS,))


def objects(decoded: Decoded) -> dict[str, Field]:
    """Return the quantities that `signals.cpm` reads, one row an object, from decoded messages."""
    rows = decoded.rows[OBJECTS]
    made: dict[str, Field] = {name: decoded.numbers(path)[rows] for name, path in SENDER_PATHS.items()}
    made |= {name: decoded.numbers(f"{OBJECTS}.{path}") for name, path in OBJECT_PATHS.items()}
    return made
