"""Units: their spellings in headers, and their factors to SI."""

from __future__ import annotations

import math
import re

from cwcli.signals.mapping import UNIT_FACTORS_BY_KIND
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

FACTORS: dict[str, dict[str, float]] = {
    "speed": {**UNIT_FACTORS_BY_KIND["speed"], "ftps": 0.3048},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048},
    "place": {"deg": 1.0, "rad": 180.0 / math.pi, "1e-7deg": 1e-7, "1e-6deg": 1e-6, "semicircles": 180.0 / 2**31},
    "angle": {"deg": math.pi / 180.0, "rad": 1.0, "cdeg": 1e-2 * math.pi / 180.0},
    "turn rate": {"radps": 1.0, "degps": math.pi / 180.0, "mdegps": 1e-3 * math.pi / 180.0},
    "acceleration": {"mps2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2},
    "number": {"1": 1.0},
    "time": {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "min": 6e10},
}
"""Kind of quantity -> unit -> factor to m/s, m, degrees (place), rad, rad/s, m/s^2, 1 and ns."""

_SPELLINGS: dict[str, tuple[tuple[str, str], ...]] = {
    "km/h": (("speed", "kmh"),),
    "kmh": (("speed", "kmh"),),
    "kph": (("speed", "kmh"),),
    "kmph": (("speed", "kmh"),),
    "kmhr": (("speed", "kmh"),),
    "m/s": (("speed", "mps"),),
    "mps": (("speed", "mps"),),
    "ms-1": (("speed", "mps"),),
    "ms^-1": (("speed", "mps"),),
    "cm/s": (("speed", "cmps"),),
    "cmps": (("speed", "cmps"),),
    "mm/s": (("speed", "mmps"),),
    "mmps": (("speed", "mmps"),),
    "mph": (("speed", "mph"),),
    "mi/h": (("speed", "mph"),),
    "miles/h": (("speed", "mph"),),
    "kn": (("speed", "knots"),),
    "kt": (("speed", "knots"),),
    "kts": (("speed", "knots"),),
    "knot": (("speed", "knots"),),
    "knots": (("speed", "knots"),),
    "meters/second": (("speed", "mps"),),
    "metres/second": (("speed", "mps"),),
    "m/sec": (("speed", "mps"),),
    "km/hr": (("speed", "kmh"),),
    "km/u": (("speed", "kmh"),),
    "km/t": (("speed", "kmh"),),
    "ft/s": (("speed", "ftps"),),
    "fps": (("speed", "ftps"),),
    "m": (("length", "m"),),
    "meter": (("length", "m"),),
    "meters": (("length", "m"),),
    "metre": (("length", "m"),),
    "metres": (("length", "m"),),
    "mm": (("length", "mm"),),
    "cm": (("length", "cm"),),
    "km": (("length", "km"),),
    "ft": (("length", "ft"),),
    "feet": (("length", "ft"),),
    "°": (("place", "deg"), ("angle", "deg")),
    "deg": (("place", "deg"), ("angle", "deg")),
    "degree": (("place", "deg"), ("angle", "deg")),
    "grad": (("place", "deg"), ("angle", "deg")),
    "grados": (("place", "deg"), ("angle", "deg")),
    "gradi": (("place", "deg"), ("angle", "deg")),
    "degrees": (("place", "deg"), ("angle", "deg")),
    "semicircle": (("place", "semicircles"),),
    "semicircles": (("place", "semicircles"),),
    "cdeg": (("angle", "cdeg"),),
    "centideg": (("angle", "cdeg"),),
    "centidegrees": (("angle", "cdeg"),),
    "rad": (("place", "rad"), ("angle", "rad")),
    "radian": (("place", "rad"), ("angle", "rad")),
    "radians": (("place", "rad"), ("angle", "rad")),
    "e6": (("place", "1e-6deg"),),
    "e7": (("place", "1e-7deg"),),
    "1e7": (("place", "1e-7deg"),),
    "dege7": (("place", "1e-7deg"),),
    "1e-7": (("place", "1e-7deg"),),
    "1e-7deg": (("place", "1e-7deg"),),
    "1e-6deg": (("place", "1e-6deg"),),
    "rad/s": (("turn rate", "radps"),),
    "radps": (("turn rate", "radps"),),
    "rads": (("turn rate", "radps"),),
    "rad/sec": (("turn rate", "radps"),),
    "deg/s": (("turn rate", "degps"),),
    "deg/sec": (("turn rate", "degps"),),
    "degree/s": (("turn rate", "degps"),),
    "degrees/s": (("turn rate", "degps"),),
    "°/s": (("turn rate", "degps"),),
    "°/sec": (("turn rate", "degps"),),
    "degps": (("turn rate", "degps"),),
    "dps": (("turn rate", "degps"),),
    "degs": (("turn rate", "degps"),),
    "mdps": (("turn rate", "mdegps"),),
    "m/s^2": (("acceleration", "mps2"),),
    "m/s2": (("acceleration", "mps2"),),
    "m/s²": (("acceleration", "mps2"),),
    "m/s/s": (("acceleration", "mps2"),),
    "m/sec2": (("acceleration", "mps2"),),
    "ms-2": (("acceleration", "mps2"),),
    "ms^-2": (("acceleration", "mps2"),),
    "mps2": (("acceleration", "mps2"),),
    "ms2": (("acceleration", "mps2"),),
    "mss": (("acceleration", "mps2"),),
    "g": (("acceleration", "g"),),
    "gs": (("acceleration", "g"),),
    "mg": (("acceleration", "mg"),),
    "s": (("time", "s"),),
    "sec": (("time", "s"),),
    "secs": (("time", "s"),),
    "second": (("time", "s"),),
    "seconds": (("time", "s"),),
    "ms": (("time", "ms"), ("speed", "mps")),
    "msec": (("time", "ms"),),
    "millis": (("time", "ms"),),
    "millisecond": (("time", "ms"),),
    "milliseconds": (("time", "ms"),),
    "us": (("time", "us"),),
    "usec": (("time", "us"),),
    "µs": (("time", "us"),),
    "μs": (("time", "us"),),
    "micros": (("time", "us"),),
    "microseconds": (("time", "us"),),
    "ns": (("time", "ns"),),
    "nsec": (("time", "ns"),),
    "nsecs": (("time", "ns"),),
    "nanosec": (("time", "ns"),),
    "nanosecs": (("time", "ns"),),
    "nanos": (("time", "ns"),),
    "nanoseconds": (("time", "ns"),),
    "min": (("time", "min"),),
}
"""Spelling in lower case, without spaces -> the kinds of quantity that it can measure, and the unit of each."""


def find_unit(text: str, kind: str) -> str:
    """Return the unit of a kind of quantity by its spelling, "" for a spelling that is not a unit of this kind."""
    spelling = re.sub(r"[\s\[\]()]", "", text.lower()).replace("·", "").replace("*", "").replace("sec^", "s^")
    found = dict(_SPELLINGS.get(spelling, ()))
    if kind in found:
        return found[kind]
    return spelling if spelling in FACTORS[kind] else ""


def is_unit_text(text: str) -> bool:
    """Tell whether a text is the spelling of any unit."""
    return re.sub(r"[\s\[\]()]", "", text.lower()) in _SPELLINGS
