"""SAE J3224 Sensor Data Sharing Message in the unaligned packed encoding (DSRCmsgID 41), from the standard's widths.

What its sender detected of others: each object is a road user of its own (`signals.sdsm`).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import Field, Strings
from cwcli.signals.radio.bsm import (
    ACCELERATIONS,
    ACCURACY,
    DATE_TIME,
    ELEVATION,
    HEADING,
    LATITUDE,
    LONGITUDE,
    VELOCITY,
)
from cwcli.signals.radio.messages import MISSING, Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import Choice, Enum, Int, ListOf, Open, Sized, bits, sequence

MESSAGE_ID = 41
"""The DSRCmsgID of an SDSM (SAE J2735)."""

_CONFIDENCE = Enum(8)
"""The ASN.1 type of the confidences of speed, heading, acceleration, yaw rate and other rates."""
_CLASS_CONFIDENCE = Int(0, 101)
"""The ASN.1 type of the confidence of a class."""
_DISTANCE = Int(-32_767, 32_767)
"""The ASN.1 type of an offset from the reference position."""
_SIZE = Int(0, 1023)
"""The ASN.1 type of an obstacle's size."""
_SIZE_CONFIDENCE = Enum(14)
"""The ASN.1 type of the confidence of a size."""
_COMMON = sequence(
    ("objType", Enum(4, extensible=True)),
    ("objTypeCfd", _CLASS_CONFIDENCE),
    ("objectID", Int(0, 65_535)),
    ("measurementTime", Int(-1500, 1500)),
    ("timeConfidence", Enum(40)),
    ("pos", sequence(("offsetX", _DISTANCE), ("offsetY", _DISTANCE), ("offsetZ", _DISTANCE, True))),
    ("posConfidence", sequence(("pos", Enum(16)), ("elevation", Enum(16)))),
    ("speed", VELOCITY),
    ("speedConfidence", _CONFIDENCE),
    ("speedZ", VELOCITY, True),
    ("speedConfidenceZ", _CONFIDENCE, True),
    ("heading", HEADING),
    ("headingConf", _CONFIDENCE),
    ("accel4way", ACCELERATIONS, True),
    ("accCfdX", _CONFIDENCE, True),
    ("accCfdY", _CONFIDENCE, True),
    ("accCfdZ", _CONFIDENCE, True),
    ("accCfdYaw", _CONFIDENCE, True),
    extensible=True,
)
"""The ASN.1 type of the data that all objects have."""
_VEHICLE = sequence(
    ("lights", bits(9, extensible=True), True),
    (
        "vehAttitude",
        sequence(("pitch", Int(-7200, 7200)), ("roll", Int(-14_400, 14_400)), ("yaw", Int(-14_400, 14_400))),
        True,
    ),
    (
        "vehAttitudeConfidence",
        sequence(*((f"{axis}Confidence", _CONFIDENCE) for axis in ("pitch", "roll", "yaw"))),
        True,
    ),
    ("vehAngVel", sequence(("pitchRate", _DISTANCE), ("rollRate", _DISTANCE)), True),
    (
        "vehAngVelConfidence",
        sequence(("pitchRateConfidence", _CONFIDENCE, True), ("rollRateConfidence", _CONFIDENCE, True)),
        True,
    ),
    ("size", sequence(("width", Int(0, 1023)), ("length", Int(0, 4095))), True),
    ("height", Int(0, 127), True),
    (
        "vehicleSizeConfidence",
        sequence(
            ("vehicleWidthConfidence", _SIZE_CONFIDENCE),
            ("vehicleLengthConfidence", _SIZE_CONFIDENCE),
            ("vehicleHeightConfidence", _SIZE_CONFIDENCE, True),
        ),
        True,
    ),
    ("vehicleClass", Int(0, 255), True),
    ("classConf", _CLASS_CONFIDENCE, True),
    extensible=True,
)
"""The ASN.1 type of the data of a vehicle."""
_PEDESTRIAN = sequence(
    ("basicType", Enum(5, extensible=True), True),
    (
        "propulsion",
        Choice(
            sequence(
                ("human", Enum(6, extensible=True)),
                ("animal", Enum(4, extensible=True)),
                ("motor", Enum(6, extensible=True)),
            ).parts,
            extensible=True,
        ),
        True,
    ),
    ("attachment", Enum(7, extensible=True), True),
    ("radius", Int(0, 200), True),
)
"""The ASN.1 type of the data of a vulnerable road user."""
_OBSTACLE = sequence(
    ("obstSize", sequence(("width", _SIZE), ("length", _SIZE), ("height", _SIZE, True))),
    (
        "obstSizeConfidence",
        sequence(
            ("widthConfidence", _SIZE_CONFIDENCE),
            ("lengthConfidence", _SIZE_CONFIDENCE),
            ("heightConfidence", _SIZE_CONFIDENCE, True),
        ),
    ),
)
"""The ASN.1 type of the data of an obstacle."""
SDSM = sequence(
    ("msgCnt", Int(0, 127)),
    ("sourceID", Sized(8, 4, 4)),
    ("equipmentType", Enum(4, extensible=True)),
    ("sDSMTimeStamp", DATE_TIME),
    (
        "refPos",
        sequence(
            ("lat", LATITUDE),
            ("long", LONGITUDE),
            ("elevation", ELEVATION, True),
            ("regional", ListOf(sequence(("regionId", Int(0, 255)), ("regExtValue", Open())), 1, 4), True),
            extensible=True,
        ),
    ),
    ("refPosXYConf", ACCURACY),
    ("refPosElConf", Enum(16), True),
    (
        "objects",
        ListOf(
            sequence(
                ("detObjCommon", _COMMON),
                (
                    "detObjOptData",
                    Choice(sequence(("detVeh", _VEHICLE), ("detVRU", _PEDESTRIAN), ("detObst", _OBSTACLE)).parts),
                    True,
                ),
            ),
            1,
            256,
        ),
    ),
)
"""The ASN.1 type of a SensorDataSharingMessage."""

OBJECTS = "objects"
"""The path of the list of detected objects."""
SENDER_PATHS: dict[str, str] = {
    "station": "sourceID",
    "dsecond_ms": "sDSMTimeStamp.second",
    "latitude_deg": "refPos.lat",
    "longitude_deg": "refPos.long",
    "altitude_m": "refPos.elevation",
    "semi_major_m": "refPosXYConf.semiMajor",
    "semi_minor_m": "refPosXYConf.semiMinor",
    "semi_major_compass_deg": "refPosXYConf.orientation",
}
"""The component of the packed message, by quantity of the sender in `signals.sdsm`."""
OBJECT_PATHS: dict[str, str] = {
    "object": "detObjCommon.objectID",
    "delta_time_ms": "detObjCommon.measurementTime",
    "north_m": "detObjCommon.pos.offsetX",
    "east_m": "detObjCommon.pos.offsetY",
    "position_confidence": "detObjCommon.posConfidence.pos",
    "speed_mps": "detObjCommon.speed",
    "speed_confidence": "detObjCommon.speedConfidence",
    "heading_compass_deg": "detObjCommon.heading",
    "heading_confidence": "detObjCommon.headingConf",
    "accel_mps2": "detObjCommon.accel4way.long",
    "accel_confidence": "detObjCommon.accCfdX",
    "lateral_accel_mps2": "detObjCommon.accel4way.lat",
    "yaw_rate_degps": "detObjCommon.accel4way.yaw",
    "yaw_rate_confidence": "detObjCommon.accCfdYaw",
    "width_m": "detObjOptData.detVeh.size.width",
    "length_m": "detObjOptData.detVeh.size.length",
}
"""The component of a packed object, by quantity of the object in `signals.sdsm`."""


@cache
def program() -> Program:
    """Compile the program that decodes the components of sender and objects."""
    of_objects = (f"{OBJECTS}.{path}" for path in OBJECT_PATHS.values())
    return compile_type(SDSM, (*SENDER_PATHS.values(), *of_objects), (OBJECTS,))


def objects(decoded: Decoded) -> dict[str, Field]:
    """Return the quantities that `signals.sdsm` reads, one row an object, from decoded messages."""
    rows = decoded.rows[OBJECTS]
    made: dict[str, Field] = {name: decoded.numbers(path)[rows] for name, path in SENDER_PATHS.items()}
    made |= {name: decoded.numbers(f"{OBJECTS}.{path}") for name, path in OBJECT_PATHS.items()}
    distinct, codes = np.unique(decoded.codes(SENDER_PATHS["station"])[rows], return_inverse=True)
    made["station"] = Strings(codes.astype(np.int32), tuple(f"{code:08x}" for code in distinct if code != MISSING))
    return made
