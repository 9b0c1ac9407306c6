"""SAE J2735 Basic Safety Message in the unaligned packed encoding (DSRCmsgID 20), from the standard's field widths."""

from __future__ import annotations

import numpy as np

from cwcli.signals.bsm_flags import CODED_FLAGS_PATHS, N_EVENT_FLAGS
from cwcli.signals.columns import Field
from cwcli.signals.j2735 import JSON_RAW_PATHS
from cwcli.signals.radio.messages import DecodedMessages, PackedMessage, format_station_ids
from cwcli.signals.radio.types import Enum, Int, ListOf, Open, Sized, bit_string_type, sequence_type

VEHICLE_SAFETY_EXTENSIONS_ID = 0
"""The PartII-Id of the vehicle safety extensions."""
LATITUDE_TYPE = Int(-900_000_000, 900_000_001)
"""The ASN.1 type of a latitude in 1e-7 degrees (SAE J2735)."""
LONGITUDE_TYPE = Int(-1_799_999_999, 1_800_000_001)
"""The ASN.1 type of a longitude in 1e-7 degrees (SAE J2735)."""
ELEVATION_TYPE = Int(-4096, 61_439)
"""The ASN.1 type of an elevation in 0.1 m (SAE J2735)."""
ACCURACY_TYPE = sequence_type(("semiMajor", Int(0, 255)), ("semiMinor", Int(0, 255)), ("orientation", Int(0, 65_535)))
"""The ASN.1 type of the position accuracy."""
_TRANSMISSION_TYPE = Enum(8)
"""The ASN.1 type of the transmission's state."""
VELOCITY_TYPE = Int(0, 8191)
"""The ASN.1 type of a speed."""
HEADING_TYPE = Int(0, 28_800)
"""The ASN.1 type of a heading."""
ACCELERATIONS_TYPE = sequence_type(
    ("long", Int(-2000, 2001)),
    ("lat", Int(-2000, 2001)),
    ("vert", Int(-127, 127)),
    ("yaw", Int(-32_767, 32_767)),
)
"""The ASN.1 type of the accelerations and the yaw rate."""
_CORE_DATA_TYPE = sequence_type(
    ("msgCnt", Int(0, 127)),
    ("id", Sized(8, 4, 4)),
    ("secMark", Int(0, 65_535)),
    ("lat", LATITUDE_TYPE),
    ("long", LONGITUDE_TYPE),
    ("elev", ELEVATION_TYPE),
    ("accuracy", ACCURACY_TYPE),
    ("transmission", _TRANSMISSION_TYPE),
    ("speed", VELOCITY_TYPE),
    ("heading", HEADING_TYPE),
    ("angle", Int(-126, 127)),
    ("accelSet", ACCELERATIONS_TYPE),
    (
        "brakes",
        sequence_type(
            ("wheelBrakes", bit_string_type(5)),
            ("traction", Enum(4)),
            ("abs", Enum(4)),
            ("scs", Enum(4)),
            ("brakeBoost", Enum(3)),
            ("auxBrakes", Enum(4)),
        ),
    ),
    ("size", sequence_type(("width", Int(0, 1023)), ("length", Int(0, 4095)))),
)
"""The ASN.1 type of the core data (part I)."""
DATE_TIME_TYPE = sequence_type(
    ("year", Int(0, 4095), True),
    ("month", Int(0, 12), True),
    ("day", Int(0, 31), True),
    ("hour", Int(0, 31), True),
    ("minute", Int(0, 60), True),
    ("second", Int(0, 65_535), True),
    ("offset", Int(-840, 840), True),
)
"""The ASN.1 type of a date with time."""
_FULL_POSITION_TYPE = sequence_type(
    ("utcTime", DATE_TIME_TYPE, True),
    ("long", LONGITUDE_TYPE),
    ("lat", LATITUDE_TYPE),
    ("elevation", ELEVATION_TYPE, True),
    ("heading", HEADING_TYPE, True),
    ("speed", sequence_type(("transmisson", _TRANSMISSION_TYPE), ("speed", VELOCITY_TYPE)), True),
    ("posAccuracy", ACCURACY_TYPE, True),
    ("timeConfidence", Enum(40), True),
    ("posConfidence", sequence_type(("pos", Enum(16)), ("elevation", Enum(16))), True),
    ("speedConfidence", sequence_type(("heading", Enum(8)), ("speed", Enum(8)), ("throttle", Enum(4))), True),
    extensible=True,
)
"""The ASN.1 type of a full position vector."""
_CRUMB_TYPE = sequence_type(
    ("latOffset", Int(-131_072, 131_071)),
    ("lonOffset", Int(-131_072, 131_071)),
    ("elevationOffset", Int(-2048, 2047)),
    ("timeOffset", Int(1, 65_535)),
    ("speed", VELOCITY_TYPE, True),
    ("posAccuracy", ACCURACY_TYPE, True),
    ("heading", Int(0, 240), True),
    extensible=True,
)
"""The ASN.1 type of one point of the path history."""
_SAFETY_EXTENSIONS_TYPE = sequence_type(
    ("events", bit_string_type(N_EVENT_FLAGS, extensible=True), True),
    (
        "pathHistory",
        sequence_type(
            ("initialPosition", _FULL_POSITION_TYPE, True),
            ("currGNSSstatus", bit_string_type(8), True),
            ("crumbData", ListOf(_CRUMB_TYPE, 1, 23)),
            extensible=True,
        ),
        True,
    ),
    (
        "pathPrediction",
        sequence_type(("radiusOfCurve", Int(-32_767, 32_767)), ("confidence", Int(0, 200)), extensible=True),
        True,
    ),
    ("lights", bit_string_type(9, extensible=True), True),
    extensible=True,
)
"""The ASN.1 type of the vehicle safety extensions."""
BSM_TYPE = sequence_type(
    ("coreData", _CORE_DATA_TYPE),
    (
        "partII",
        ListOf(
            sequence_type(
                ("partII-Id", Int(0, 63)),
                ("partII-Value", Open({VEHICLE_SAFETY_EXTENSIONS_ID: _SAFETY_EXTENSIONS_TYPE})),
            ),
            1,
            8,
        ),
        True,
    ),
    ("regional", ListOf(sequence_type(("regionId", Int(0, 255)), ("regExtValue", Open())), 1, 4), True),
    extensible=True,
)
"""The ASN.1 type of a BasicSafetyMessage; of part II only the vehicle safety extensions are read."""

STATION_PATH = JSON_RAW_PATHS["station"]
"""The component of the sender's temporary id."""
EVENTS_PATH = CODED_FLAGS_PATHS[0]
"""The component of the event flags."""
BSM = PackedMessage(lambda: BSM_TYPE, JSON_RAW_PATHS | {"events": EVENTS_PATH})
"""The packed BSM: its core data (part I) and the event flags of part II."""


def bsm_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of a JSON BSM that `signals.j2735` reads, from decoded messages."""
    fields: dict[str, Field] = {path: decoded.component_numbers(path) for path in JSON_RAW_PATHS.values()}
    fields[STATION_PATH] = format_station_ids(decoded.component_codes(STATION_PATH))
    fields[EVENTS_PATH] = np.nan_to_num(decoded.component_numbers(EVENTS_PATH)).astype(np.int64)
    return fields
