"""An SDSM written bit by bit from SAE J3224's field widths, to hold the decoder against: it shares nothing with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.unit.signals.radio.packing import additions, any_bits, any_code, number, octets_of

Row = tuple[int, int, int]
# component: offset that is added, width in bits, highest value
DATE: dict[str, Row] = {
    "year": (0, 12, 4095),
    "month": (0, 4, 12),
    "day": (0, 5, 31),
    "hour": (0, 5, 31),
    "minute": (0, 6, 60),
    "sDSMTimeStamp.second": (0, 16, 65_535),
    "offset": (840, 11, 840),
}
POSITION: dict[str, Row] = {
    "refPos.lat": (900_000_000, 31, 900_000_001),
    "refPos.long": (1_799_999_999, 32, 1_800_000_001),
}
ACCURACY: dict[str, Row] = {
    "refPosXYConf.semiMajor": (0, 8, 255),
    "refPosXYConf.semiMinor": (0, 8, 255),
    "refPosXYConf.orientation": (0, 16, 65_535),
}
COMMON: dict[str, Row] = {
    "objTypeCfd": (0, 7, 101),
    "detObjCommon.objectID": (0, 16, 65_535),
    "detObjCommon.measurementTime": (1500, 12, 1500),
    "timeConfidence": (0, 6, 39),
}
PLACE: dict[str, Row] = {
    "detObjCommon.pos.offsetX": (32_767, 16, 32_767),
    "detObjCommon.pos.offsetY": (32_767, 16, 32_767),
    "offsetZ": (32_767, 16, 32_767),
}
MOTION: dict[str, Row] = {
    "detObjCommon.posConfidence.pos": (0, 4, 15),
    "elevationConfidence": (0, 4, 15),
    "detObjCommon.speed": (0, 13, 8191),
    "detObjCommon.speedConfidence": (0, 3, 7),
    "speedZ": (0, 13, 8191),
    "speedConfidenceZ": (0, 3, 7),
    "detObjCommon.heading": (0, 15, 28_800),
    "detObjCommon.headingConf": (0, 3, 7),
    "detObjCommon.accel4way.long": (2000, 12, 2001),
    "detObjCommon.accel4way.lat": (2000, 12, 2001),
    "vert": (127, 8, 127),
    "detObjCommon.accel4way.yaw": (32_767, 16, 32_767),
    "detObjCommon.accCfdX": (0, 3, 7),
    "accCfdY": (0, 3, 7),
    "accCfdZ": (0, 3, 7),
    "detObjCommon.accCfdYaw": (0, 3, 7),
}
SIZE: dict[str, Row] = {
    "detObjOptData.detVeh.size.width": (0, 10, 1023),
    "detObjOptData.detVeh.size.length": (0, 12, 4095),
}
OPTIONAL_MOTION = (
    ("speedZ",),
    ("speedConfidenceZ",),
    ("detObjCommon.accel4way.long", "detObjCommon.accel4way.lat", "vert", "detObjCommon.accel4way.yaw"),
    ("detObjCommon.accCfdX",),
    ("accCfdY",),
    ("accCfdZ",),
    ("detObjCommon.accCfdYaw",),
)
Values = dict[str, Any]


def put(rows: dict[str, Row], values: Values) -> str:
    """The components that are there."""
    return "".join(number(values[name] + offset, width) for name, (offset, width, _) in rows.items() if name in values)


def some(rng: np.random.Generator, rows: dict[str, Row], optional: tuple[str, ...] = ()) -> Values:
    return {name: any_code(rng, *row) for name, row in rows.items() if name not in optional or rng.random() < 0.5}


def flag(*present: object) -> str:
    return "".join("1" if each else "0" for each in present)


def any_object(rng: np.random.Generator) -> tuple[Values, str]:
    """Its components, and its bits."""
    values = some(rng, COMMON) | some(rng, PLACE, ("offsetZ",)) | some(rng, MOTION)
    for group in OPTIONAL_MOTION:
        if rng.random() < 0.5:
            values = {name: value for name, value in values.items() if name not in group}
    later = [any_bits(rng)] if rng.random() < 0.1 else []
    common = flag(later, *(group[0] in values for group in OPTIONAL_MOTION))
    common += "0" + number(int(rng.integers(0, 4)), 2) + put(COMMON, values)
    common += flag("offsetZ" in values) + put(PLACE, values) + put(MOTION, values)
    common += additions(later) if later else ""
    kind = int(rng.integers(0, 4))
    if kind == 3:
        return values, "0" + common
    told = (vehicle, pedestrian, obstacle)[kind](rng, values)
    return values, "1" + common + number(kind, 2) + told


def vehicle(rng: np.random.Generator, values: Values) -> str:
    """DetectedVehicleData, with what is optional or not."""
    if rng.random() < 0.6:
        values |= some(rng, SIZE)
    lights, attitude, sure, turning, turn_sure, height, size_sure, kind, kind_sure = rng.random(9) < 0.4
    later = [any_bits(rng), ""] if rng.random() < 0.2 else []
    has_size = "detObjOptData.detVeh.size.width" in values
    bits = flag(later, lights, attitude, sure, turning, turn_sure, has_size, height, size_sure, kind, kind_sure)
    bits += "0" + number(int(rng.integers(512)), 9) if lights else ""
    bits += (
        "".join(number(int(rng.integers(n)), w) for n, w in ((14_401, 14), (28_801, 15), (28_801, 15)))
        if attitude
        else ""
    )
    bits += number(int(rng.integers(512)), 9) if sure else ""
    bits += "".join(number(int(rng.integers(65_535)), 16) for _ in range(2)) if turning else ""
    if turn_sure:
        one, two = rng.random(2) < 0.5
        bits += flag(one, two) + ("101" if one else "") + ("010" if two else "")
    bits += put(SIZE, values)
    bits += number(int(rng.integers(128)), 7) if height else ""
    if size_sure:
        bits += (more := flag(rng.random() < 0.5)) + "1101" + "0001" + ("0111" if more == "1" else "")
    bits += number(int(rng.integers(256)), 8) if kind else ""
    bits += number(int(rng.integers(102)), 7) if kind_sure else ""
    return bits + (additions(later) if later else "")


def pedestrian(rng: np.random.Generator, values: Values) -> str:
    """DetectedVRUData."""
    del values
    basic, propulsion, attachment, radius = rng.random(4) < 0.5
    bits = flag(basic, propulsion, attachment, radius)
    bits += "0" + number(int(rng.integers(5)), 3) if basic else ""
    if propulsion:
        kind = int(rng.integers(3))
        bits += "0" + number(kind, 2) + "0" + number(int(rng.integers(4)), (3, 2, 3)[kind])
    bits += "0" + number(int(rng.integers(7)), 3) if attachment else ""
    return bits + (number(int(rng.integers(201)), 8) if radius else "")


def obstacle(rng: np.random.Generator, values: Values) -> str:
    """DetectedObstacleData."""
    del values
    high, sure = rng.random(2) < 0.5
    bits = flag(high) + "".join(number(int(rng.integers(1024)), 10) for _ in range(3 if high else 2))
    return bits + flag(sure) + "".join(number(int(rng.integers(14)), 4) for _ in range(3 if sure else 2))


def any_sdsm(rng: np.random.Generator) -> tuple[Values, list[Values], bytes]:
    """The sender's components, those of each object, and the message."""
    values = (
        {"sourceID": int(rng.integers(2**32))}
        | some(rng, DATE, tuple(DATE))
        | some(rng, POSITION)
        | some(rng, ACCURACY)
    )
    if rng.random() < 0.7:
        values["refPos.elevation"] = any_code(rng, 4096, 16, 61_439)
    sure = rng.random() < 0.4
    bits = flag(sure) + number(int(rng.integers(128)), 7) + number(values["sourceID"], 32)
    bits += "0" + number(int(rng.integers(4)), 2) + flag(*(name in values for name in DATE)) + put(DATE, values)
    later = [any_bits(rng)] if rng.random() < 0.1 else []
    bits += flag(later, "refPos.elevation" in values, False) + put(POSITION, values)
    if "refPos.elevation" in values:
        bits += number(values["refPos.elevation"] + 4096, 16)
    bits += (additions(later) if later else "") + put(ACCURACY, values)
    bits += number(int(rng.integers(16)), 4) if sure else ""
    objects = [any_object(rng) for _ in range(int(rng.choice([1, 2, 5, 30])))]
    bits += number(len(objects) - 1, 8) + "".join(told for _, told in objects)
    return values, [made for made, _ in objects], octets_of(bits)
