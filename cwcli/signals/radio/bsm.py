"""SAE J2735 Basic Safety Message in the unaligned packed encoding (DSRCmsgID 20), from the standard's field widths."""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.bsm_flags import CODED, N_FLAGS
from cwcli.signals.columns import Field, Strings
from cwcli.signals.j2735 import JSON_RAW
from cwcli.signals.radio.messages import MISSING, Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.types import Enum, Int, ListOf, Open, Sized, bits, sequence

MESSAGE_ID = 20
"""The DSRCmsgID of a BSM (SAE J2735)."""
VEHICLE_SAFETY_EXTENSIONS = 0
"""The PartII-Id of the vehicle safety extensions."""
LATITUDE = Int(-900_000_000, 900_000_001)
"""The ASN.1 type of a latitude."""
LONGITUDE = Int(-1_799_999_999, 1_800_000_001)
"""The ASN.1 type of a longitude."""
ELEVATION = Int(-4096, 61_439)
"""The ASN.1 type of an elevation."""
ACCURACY = sequence(("semiMajor", Int(0, 255)), ("semiMinor", Int(0, 255)), ("orientation", Int(0, 65_535)))
"""The ASN.1 type of the position accuracy."""
_TRANSMISSION = Enum(8)
"""The ASN.1 type of the transmission's state."""
VELOCITY = Int(0, 8191)
"""The ASN.1 type of a speed."""
HEADING = Int(0, 28_800)
"""The ASN.1 type of a heading."""
ACCELERATIONS = sequence(
    ("long", Int(-2000, 2001)),
    ("lat", Int(-2000, 2001)),
    ("vert", Int(-127, 127)),
    ("yaw", Int(-32_767, 32_767)),
)
"""The ASN.1 type of the accelerations and the yaw rate."""
_CORE = sequence(
    ("msgCnt", Int(0, 127)),
    ("id", Sized(8, 4, 4)),
    ("secMark", Int(0, 65_535)),
    ("lat", LATITUDE),
    ("long", LONGITUDE),
    ("elev", ELEVATION),
    ("accuracy", ACCURACY),
    ("transmission", _TRANSMISSION),
    ("speed", VELOCITY),
    ("heading", HEADING),
    ("angle", Int(-126, 127)),
    ("accelSet", ACCELERATIONS),
    (
        "brakes",
        sequence(
            ("wheelBrakes", bits(5)),
            ("traction", Enum(4)),
            ("abs", Enum(4)),
            ("scs", Enum(4)),
            ("brakeBoost", Enum(3)),
            ("auxBrakes", Enum(4)),
        ),
    ),
    ("size", sequence(("width", Int(0, 1023)), ("length", Int(0, 4095)))),
)
"""The ASN.1 type of the core data (part I)."""
DATE_TIME = sequence(
    ("year", Int(0, 4095), True),
    ("month", Int(0, 12), True),
    ("day", Int(0, 31), True),
    ("hour", Int(0, 31), True),
    ("minute", Int(0, 60), True),
    ("second", Int(0, 65_535), True),
    ("offset", Int(-840, 840), True),
)
"""The ASN.1 type of a date with time."""
_FULL_POSITION = sequence(
    ("utcTime", DATE_TIME, True),
    ("long", LONGITUDE),
    ("lat", LATITUDE),
    ("elevation", ELEVATION, True),
    ("heading", HEADING, True),
    ("speed", sequence(("transmisson", _TRANSMISSION), ("speed", VELOCITY)), True),
    ("posAccuracy", ACCURACY, True),
    ("timeConfidence", Enum(40), True),
    ("posConfidence", sequence(("pos", Enum(16)), ("elevation", Enum(16))), True),
    ("speedConfidence", sequence(("heading", Enum(8)), ("speed", Enum(8)), ("throttle", Enum(4))), True),
    extensible=True,
)
"""The ASN.1 type of a full position vector."""
_CRUMB = sequence(
    ("latOffset", Int(-131_072, 131_071)),
    ("lonOffset", Int(-131_072, 131_071)),
    ("elevationOffset", Int(-2048, 2047)),
    ("timeOffset", Int(1, 65_535)),
    ("speed", VELOCITY, True),
    ("posAccuracy", ACCURACY, True),
    ("heading", Int(0, 240), True),
    extensible=True,
)
"""The ASN.1 type of one point of the path history."""
_SAFETY = sequence(
    ("events", bits(N_FLAGS, extensible=True), True),
    (
        "pathHistory",
        sequence(
            ("initialPosition", _FULL_POSITION, True),
            ("currGNSSstatus", bits(8), True),
            ("crumbData", ListOf(_CRUMB, 1, 23)),
            extensible=True,
        ),
        True,
    ),
    (
        "pathPrediction",
        sequence(("radiusOfCurve", Int(-32_767, 32_767)), ("confidence", Int(0, 200)), extensible=True),
        True,
    ),
    ("lights", bits(9, extensible=True), True),
    extensible=True,
)
"""The ASN.1 type of the vehicle safety extensions."""
BSM = sequence(
    ("coreData", _CORE),
    (
        "partII",
        ListOf(sequence(("partII-Id", Int(0, 63)), ("partII-Value", Open({VEHICLE_SAFETY_EXTENSIONS: _SAFETY}))), 1, 8),
        True,
    ),
    ("regional", ListOf(sequence(("regionId", Int(0, 255)), ("regExtValue", Open())), 1, 4), True),
    extensible=True,
)
"""The ASN.1 type of a BasicSafetyMessage; of part II only the vehicle safety extensions are read."""

CORE_PATHS = tuple(
    f"coreData.{name}"
    for name in (
        *("msgCnt", "id", "secMark", "lat", "long", "elev", "transmission", "speed", "heading", "angle"),
        *("accuracy.semiMajor", "accuracy.semiMinor", "accuracy.orientation"),
        *("accelSet.long", "accelSet.lat", "accelSet.vert", "accelSet.yaw"),
        *("brakes.wheelBrakes", "brakes.traction", "brakes.abs", "brakes.scs", "brakes.brakeBoost", "brakes.auxBrakes"),
        *("size.width", "size.length"),
    )
)
"""The components of the core data that are decoded."""
STATION = JSON_RAW["station"]
"""The component of the sender's temporary id."""
EVENTS = CODED[0]
"""The component of the event flags."""
PREDICTION = "partII.partII-Value.pathPrediction"
"""The component of the path prediction."""
CRUMBS = "partII.partII-Value.pathHistory.crumbData"
"""The component of the path history's points."""


@cache
def core_program() -> Program:
    """Compile the program for part I and the event flags of part II."""
    return compile_type(BSM, (*CORE_PATHS, EVENTS, f"{PREDICTION}.radiusOfCurve", f"{PREDICTION}.confidence"))


@cache
def history_program() -> Program:
    """Compile the program for the points of the path history."""
    names = ("latOffset", "lonOffset", "elevationOffset", "timeOffset")
    return compile_type(BSM, tuple(f"{CRUMBS}.{name}" for name in names), (CRUMBS,))


def fields(decoded: Decoded) -> dict[str, Field]:
    """Return the leaf fields of a JSON BSM that `signals.j2735` reads, from decoded messages."""
    made: dict[str, Field] = {path: decoded.numbers(path) for path in JSON_RAW.values() if path != STATION}
    distinct, codes = np.unique(decoded.codes(STATION), return_inverse=True)
    names = tuple("" if code == MISSING else f"{code:08x}" for code in distinct)
    made[STATION] = Strings(codes.astype(np.int32), names)
    made[EVENTS] = np.nan_to_num(decoded.numbers(EVENTS)).astype(np.int64)
    return made
