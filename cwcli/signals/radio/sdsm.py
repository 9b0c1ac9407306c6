"""SAE J3224 Sensor Data Sharing Message in the unaligned packed encoding (DSRCmsgID 41), from the standard's widths.

What its sender detected of others: each object is a road user of its own (`signals.sdsm`).
"""

from __future__ import annotations

from cwcli.signals.columns import Field
from cwcli.signals.radio.bsm import (
    ACCELERATIONS_TYPE,
    ACCURACY_TYPE,
    DATE_TIME_TYPE,
    ELEVATION_TYPE,
    HEADING_TYPE,
    LATITUDE_TYPE,
    LONGITUDE_TYPE,
    VELOCITY_TYPE,
)
from cwcli.signals.radio.messages import DecodedMessages, PackedMessage, format_station_ids
from cwcli.signals.radio.types import Choice, Enum, Int, ListOf, Open, Sized, bit_string_type, sequence_type
from cwcli.signals.sdsm import OBJECTS_PATH, SDSM_PATHS

_CONFIDENCE_TYPE = Enum(8)
"""The ASN.1 type of the confidences of speed, heading, acceleration, yaw rate and other rates."""
_CLASS_CONFIDENCE_TYPE = Int(0, 101)
"""The ASN.1 type of the confidence of a class."""
_DISTANCE_TYPE = Int(-32_767, 32_767)
"""The ASN.1 type of an offset from the reference position."""
_SIZE_TYPE = Int(0, 1023)
"""The ASN.1 type of an obstacle's size."""
_SIZE_CONFIDENCE_TYPE = Enum(14)
"""The ASN.1 type of the confidence of a size."""
_COMMON_DATA_TYPE = sequence_type(
    ("objType", Enum(4, extensible=True)),
    ("objTypeCfd", _CLASS_CONFIDENCE_TYPE),
    ("objectID", Int(0, 65_535)),
    ("measurementTime", Int(-1500, 1500)),
    ("timeConfidence", Enum(40)),
    ("pos", sequence_type(("offsetX", _DISTANCE_TYPE), ("offsetY", _DISTANCE_TYPE), ("offsetZ", _DISTANCE_TYPE, True))),
    ("posConfidence", sequence_type(("pos", Enum(16)), ("elevation", Enum(16)))),
    ("speed", VELOCITY_TYPE),
    ("speedConfidence", _CONFIDENCE_TYPE),
    ("speedZ", VELOCITY_TYPE, True),
    ("speedConfidenceZ", _CONFIDENCE_TYPE, True),
    ("heading", HEADING_TYPE),
    ("headingConf", _CONFIDENCE_TYPE),
    ("accel4way", ACCELERATIONS_TYPE, True),
    ("accCfdX", _CONFIDENCE_TYPE, True),
    ("accCfdY", _CONFIDENCE_TYPE, True),
    ("accCfdZ", _CONFIDENCE_TYPE, True),
    ("accCfdYaw", _CONFIDENCE_TYPE, True),
    extensible=True,
)
"""The ASN.1 type of the data that all objects have."""
_VEHICLE_DATA_TYPE = sequence_type(
    ("lights", bit_string_type(9, extensible=True), True),
    (
        "vehAttitude",
        sequence_type(("pitch", Int(-7200, 7200)), ("roll", Int(-14_400, 14_400)), ("yaw", Int(-14_400, 14_400))),
        True,
    ),
    (
        "vehAttitudeConfidence",
        sequence_type(*((f"{axis}Confidence", _CONFIDENCE_TYPE) for axis in ("pitch", "roll", "yaw"))),
        True,
    ),
    ("vehAngVel", sequence_type(("pitchRate", _DISTANCE_TYPE), ("rollRate", _DISTANCE_TYPE)), True),
    (
        "vehAngVelConfidence",
        sequence_type(("pitchRateConfidence", _CONFIDENCE_TYPE, True), ("rollRateConfidence", _CONFIDENCE_TYPE, True)),
        True,
    ),
    ("size", sequence_type(("width", Int(0, 1023)), ("length", Int(0, 4095))), True),
    ("height", Int(0, 127), True),
    (
        "vehicleSizeConfidence",
        sequence_type(
            ("vehicleWidthConfidence", _SIZE_CONFIDENCE_TYPE),
            ("vehicleLengthConfidence", _SIZE_CONFIDENCE_TYPE),
            ("vehicleHeightConfidence", _SIZE_CONFIDENCE_TYPE, True),
        ),
        True,
    ),
    ("vehicleClass", Int(0, 255), True),
    ("classConf", _CLASS_CONFIDENCE_TYPE, True),
    extensible=True,
)
"""The ASN.1 type of the data of a vehicle."""
_PEDESTRIAN_DATA_TYPE = sequence_type(
    ("basicType", Enum(5, extensible=True), True),
    (
        "propulsion",
        Choice(
            sequence_type(
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
_OBSTACLE_DATA_TYPE = sequence_type(
    ("obstSize", sequence_type(("width", _SIZE_TYPE), ("length", _SIZE_TYPE), ("height", _SIZE_TYPE, True))),
    (
        "obstSizeConfidence",
        sequence_type(
            ("widthConfidence", _SIZE_CONFIDENCE_TYPE),
            ("lengthConfidence", _SIZE_CONFIDENCE_TYPE),
            ("heightConfidence", _SIZE_CONFIDENCE_TYPE, True),
        ),
    ),
)
"""The ASN.1 type of the data of an obstacle."""
SDSM_TYPE = sequence_type(
    ("msgCnt", Int(0, 127)),
    ("sourceID", Sized(8, 4, 4)),
    ("equipmentType", Enum(4, extensible=True)),
    ("sDSMTimeStamp", DATE_TIME_TYPE),
    (
        "refPos",
        sequence_type(
            ("lat", LATITUDE_TYPE),
            ("long", LONGITUDE_TYPE),
            ("elevation", ELEVATION_TYPE, True),
            ("regional", ListOf(sequence_type(("regionId", Int(0, 255)), ("regExtValue", Open())), 1, 4), True),
            extensible=True,
        ),
    ),
    ("refPosXYConf", ACCURACY_TYPE),
    ("refPosElConf", Enum(16), True),
    (
        "objects",
        ListOf(
            sequence_type(
                ("detObjCommon", _COMMON_DATA_TYPE),
                (
                    "detObjOptData",
                    Choice(
                        sequence_type(
                            ("detVeh", _VEHICLE_DATA_TYPE),
                            ("detVRU", _PEDESTRIAN_DATA_TYPE),
                            ("detObst", _OBSTACLE_DATA_TYPE),
                        ).parts
                    ),
                    True,
                ),
            ),
            1,
            256,
        ),
    ),
)
"""The ASN.1 type of a SensorDataSharingMessage."""

SDSM = PackedMessage(lambda: SDSM_TYPE, SDSM_PATHS, OBJECTS_PATH)
"""The packed SDSM: its sender and its objects."""


def sdsm_objects_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the quantities that `signals.sdsm` reads, one row an object, from decoded messages."""
    station = format_station_ids(decoded.component_codes(SDSM_PATHS["station"])[decoded.rows[OBJECTS_PATH]])
    return SDSM.read_quantities(decoded) | {"station": station}
