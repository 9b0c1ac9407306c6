"""A BSM written bit by bit from SAE J2735's field widths, to hold the decoder against: it shares nothing with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

# component: offset that is added, width in bits, highest value
CORE: dict[str, tuple[int, int, int]] = {
    "coreData.msgCnt": (0, 7, 127),
    "coreData.id": (0, 32, 2**32 - 1),
    "coreData.secMark": (0, 16, 65_535),
    "coreData.lat": (900_000_000, 31, 900_000_001),
    "coreData.long": (1_799_999_999, 32, 1_800_000_001),
    "coreData.elev": (4096, 16, 61_439),
    "coreData.accuracy.semiMajor": (0, 8, 255),
    "coreData.accuracy.semiMinor": (0, 8, 255),
    "coreData.accuracy.orientation": (0, 16, 65_535),
    "coreData.transmission": (0, 3, 7),
    "coreData.speed": (0, 13, 8191),
    "coreData.heading": (0, 15, 28_800),
    "coreData.angle": (126, 8, 127),
    "coreData.accelSet.long": (2000, 12, 2001),
    "coreData.accelSet.lat": (2000, 12, 2001),
    "coreData.accelSet.vert": (127, 8, 127),
    "coreData.accelSet.yaw": (32_767, 16, 32_767),
    "coreData.brakes.wheelBrakes": (0, 5, 31),
    "coreData.brakes.traction": (0, 2, 3),
    "coreData.brakes.abs": (0, 2, 3),
    "coreData.brakes.scs": (0, 2, 3),
    "coreData.brakes.brakeBoost": (0, 2, 2),
    "coreData.brakes.auxBrakes": (0, 2, 3),
    "coreData.size.width": (0, 10, 1023),
    "coreData.size.length": (0, 12, 4095),
}
N_CORE_BITS = sum(width for _, width, _ in CORE.values())
CRUMB: dict[str, tuple[int, int, int]] = {
    "latOffset": (131_072, 18, 131_071),
    "lonOffset": (131_072, 18, 131_071),
    "elevationOffset": (2048, 12, 2047),
    "timeOffset": (-1, 16, 65_535),
}

Values = dict[str, Any]


def number(value: int, width: int) -> str:
    """`width` bits."""
    assert 0 <= value < 1 << width
    return f"{value:0{width}b}"


def octets_of(bits: str) -> bytes:
    """Bits, filled up with zeros to whole octets; one octet at least."""
    padded = (bits or "0") + "0" * (-len(bits or "0") % 8)
    return int(padded, 2).to_bytes(len(padded) // 8, "big")


def length(n: int) -> bytes:
    """A length without bounds."""
    return bytes([n]) if n < 128 else (0x8000 | n).to_bytes(2, "big")


def open_type(bits: str) -> str:
    """Bits inside an open type."""
    contents = octets_of(bits)
    return "".join(number(each, 8) for each in length(len(contents)) + contents)


def core_bits(values: Mapping[str, int]) -> str:
    """Part I."""
    return "".join(number(values[name] + offset, width) for name, (offset, width, _) in CORE.items())


def additions(later: list[str]) -> str:
    """What a later version has added to a sequence: components of which each may be absent ("")."""
    present = "".join("1" if each else "0" for each in later)
    return number(len(later) - 1, 7) + present + "".join(open_type(each) for each in later if each)


def crumb_bits(values: Mapping[str, Any]) -> str:
    """A point of the path history, with what it may have beside its place."""
    optional = [("speed", 13), ("accuracy", 32), ("heading", 8)]
    later = values.get("later", [])
    bits = ("1" if later else "0") + "".join("1" if name in values else "0" for name, _ in optional)
    bits += "".join(number(values[name] + offset, width) for name, (offset, width, _) in CRUMB.items())
    bits += "".join(number(values[name], width) for name, width in optional if name in values)
    return bits + (additions(later) if later else "")


def safety_bits(values: Values) -> str:
    """The vehicle safety extensions of part II."""
    names = ("events", "crumbs", "prediction", "lights")
    later = values.get("later", [])
    bits = ("1" if later else "0") + "".join("1" if name in values else "0" for name in names)
    if "events" in values:
        more = values.get("more_events", "")
        bits += f"1{number(13 + len(more), 8)}" if more else "0"
        bits += number(values["events"], 13) + more
    if "crumbs" in values:
        gnss = values.get("gnss")
        bits += "00" + ("0" if gnss is None else "1" + number(gnss, 8))
        bits += number(len(values["crumbs"]) - 1, 5) + "".join(crumb_bits(each) for each in values["crumbs"])
    if "prediction" in values:
        radius, confidence = values["prediction"]
        bits += "0" + number(radius + 32_767, 16) + number(confidence, 8)
    if "lights" in values:
        bits += "0" + number(values["lights"], 9)
    return bits + (additions(later) if later else "")


def bsm(values: Values) -> bytes:
    """A BasicSafetyMessage.

    Args:
        values: Components of part I by their paths; `part_two`: pairs of an id and bits; `regional`: likewise; `later`.
    """
    part_two, regional, later = (values.get(name, []) for name in ("part_two", "regional", "later"))
    bits = "".join("1" if each else "0" for each in (later, part_two, regional)) + core_bits(values)
    if part_two:
        bits += number(len(part_two) - 1, 3)
        bits += "".join(number(kind, 6) + open_type(contents) for kind, contents in part_two)
    if regional:
        bits += number(len(regional) - 1, 2)
        bits += "".join(number(kind, 8) + open_type(contents) for kind, contents in regional)
    return octets_of(bits + (additions(later) if later else ""))


def framed(message: bytes, message_id: int = 20) -> bytes:
    """Inside a MessageFrame."""
    return message_id.to_bytes(2, "big") + length(len(message)) + message


def random_bsm(rng: np.random.Generator) -> Values:
    """Any BSM: values from all of their range and its ends, with and without what is optional."""
    values: Values = {name: any_code(rng, *row) for name, row in CORE.items()}
    part_two = []
    for _ in range(int(rng.integers(0, 3))):
        if rng.random() < 0.3:
            part_two.append((int(rng.integers(1, 64)), any_bits(rng)))
            continue
        safety: Values = {}
        if rng.random() < 0.7:
            safety["events"] = int(rng.integers(0, 1 << 13))
            safety["more_events"] = any_bits(rng)[:9] if rng.random() < 0.3 else ""
        if rng.random() < 0.5:
            safety["crumbs"] = [random_crumb(rng) for _ in range(int(rng.integers(1, 24)))]
            safety |= {"gnss": int(rng.integers(0, 256))} if rng.random() < 0.5 else {}
        if rng.random() < 0.5:
            safety["prediction"] = (int(rng.integers(-32_767, 32_768)), int(rng.integers(0, 201)))
        if rng.random() < 0.3:
            safety["lights"] = int(rng.integers(0, 512))
        safety["later"] = [any_bits(rng), "", any_bits(rng)] if rng.random() < 0.2 else []
        values["safety"] = {**values.get("safety", {}), **safety}
        values["all_crumbs"] = values.get("all_crumbs", []) + safety.get("crumbs", [])
        part_two.append((0, safety_bits(safety)))
    values["part_two"] = part_two
    values["regional"] = [(int(rng.integers(0, 256)), any_bits(rng))] if rng.random() < 0.2 else []
    values["later"] = ["", any_bits(rng)] if rng.random() < 0.1 else []
    return values


def random_crumb(rng: np.random.Generator) -> Values:
    """A point of a path history."""
    crumb: Values = {name: any_code(rng, *row) for name, row in CRUMB.items()}
    for name, width in (("speed", 13), ("accuracy", 32), ("heading", 8)):
        if rng.random() < 0.2:
            crumb[name] = int(rng.integers(0, 241 if name == "heading" else 1 << width))
    crumb["later"] = [any_bits(rng)] if rng.random() < 0.1 else []
    return crumb


def any_code(rng: np.random.Generator, offset: int, width: int, high: int) -> int:
    """A code of a component, now and then the lowest or the highest one."""
    del width
    chance = rng.random()
    return -offset if chance < 0.05 else high if chance < 0.1 else int(rng.integers(-offset, high, endpoint=True))


def any_bits(rng: np.random.Generator) -> str:
    """Bits of something unknown."""
    return "".join(str(bit) for bit in rng.integers(0, 2, int(rng.integers(1, 60))))
