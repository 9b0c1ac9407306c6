"""Units: their spellings in headers, and their factors to SI."""

from __future__ import annotations

import math
import re

from cwcli.signals.mapping import SI_FACTORS_BY_UNIT_BY_KIND
from cwcli.signals.units import STANDARD_GRAVITY_MPS2

FACTOR_BY_KIND_AND_UNIT: dict[str, dict[str, float]] = {
    "speed": {**SI_FACTORS_BY_UNIT_BY_KIND["speed"], "ftps": 0.3048},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048},
    "place": {
        "deg": 1.0,
        "rad": 180.0 / math.pi,
        "arcmin": 1.0 / 60.0,
        "arcsec": 1.0 / 3600.0,
        "mas": 1.0 / 3_600_000.0,
        "1e-7deg": 1e-7,
        "1e-6deg": 1e-6,
        "semicircles": 180.0 / 2**31,
        "ddmm": 1.0,  # degrees and minutes, which are no factor: `places` converts them
    },
    "angle": {
        "deg": math.pi / 180.0,
        "rad": 1.0,
        "cdeg": 1e-2 * math.pi / 180.0,
        "e5deg": 1e-5 * math.pi / 180.0,  # of u-blox' receivers
    },
    "turn rate": {"radps": 1.0, "degps": math.pi / 180.0, "mdegps": 1e-3 * math.pi / 180.0},
    "acceleration": {"mps2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2},
    "number": {"1": 1.0},
    "time": {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "min": 6e10},
}
"""Kind of quantity -> unit -> factor to m/s, m, degrees (place), rad, rad/s, m/s^2, 1 and ns."""

_SPELLINGS_BY_KIND_AND_UNIT = {
    ("speed", "kmh"): "km/h kmh kph kmph kmhr km/hr km/u km/t",
    ("speed", "mps"): "m/s mps ms-1 ms^-1 meters/second metres/second m/sec ms",
    ("speed", "cmps"): "cm/s cmps",
    ("speed", "mmps"): "mm/s mmps",
    ("speed", "mph"): "mph mi/h miles/h",
    ("speed", "knots"): "kn kt kts knot knots",
    ("speed", "ftps"): "ft/s fps",
    ("length", "m"): "m meter meters metre metres",
    ("length", "mm"): "mm",
    ("length", "cm"): "cm",
    ("length", "km"): "km",
    ("length", "ft"): "ft feet",
    ("place", "deg"): "° deg degree grad grados gradi degrees",
    ("place", "semicircles"): "semicircle semicircles",
    ("place", "arcsec"): "arcsec arcsecond arcseconds",
    ("place", "mas"): "mas marcsec milliarcsec milliarcsecond milliarcseconds",
    ("place", "rad"): "rad radian radians",
    ("place", "1e-6deg"): "e6 1e-6deg",
    ("place", "1e-7deg"): "e7 1e7 dege7 1e-7 1e-7deg",
    ("angle", "deg"): "° deg degree grad grados gradi degrees",
    ("angle", "cdeg"): "cdeg centideg centidegrees",
    ("angle", "e5deg"): "e5 e5deg 1e-5deg",
    ("angle", "rad"): "rad radian radians",
    ("turn rate", "radps"): "rad/s radps rads rad/sec",
    ("turn rate", "degps"): "deg/s deg/sec degree/s degrees/s °/s °/sec degps dps degs",
    ("turn rate", "mdegps"): "mdps",
    ("acceleration", "mps2"): "m/s^2 m/s2 m/s² m/s/s m/sec2 ms-2 ms^-2 mps2 ms2 mss",
    ("acceleration", "g"): "g gs",
    ("acceleration", "mg"): "mg",
    ("time", "s"): "s sec secs second seconds",
    ("time", "ms"): "ms msec millis millisecond milliseconds",
    ("time", "us"): "us usec µs μs micros microseconds",
    ("time", "ns"): "ns nsec nsecs nanosec nanosecs nanos nanoseconds",
    ("time", "min"): "min",
}
"""Kind of quantity and unit -> the unit's spellings in lower case, without spaces inside."""
_UNIT_BY_KIND_OF_SPELLING: dict[str, dict[str, str]] = {}
"""Spelling -> the kinds of quantity that it can measure, and the unit of each."""
for (_kind, _unit), _spellings in _SPELLINGS_BY_KIND_AND_UNIT.items():
    for _spelling in _spellings.split():
        _UNIT_BY_KIND_OF_SPELLING.setdefault(_spelling, {})[_kind] = _unit


_UNIT_SIGN_BY_WRITTEN_OUT_UNIT_WORD_PATTERN = {
    "kilomet(er|re)s?": "km",
    "millimet(er|re)s?": "mm",
    "met(er|re)s?": "m",
    "hours?": "h",
    "seconds?|sec": "s",
    "degre+s?(ofarc)?": "deg",
    "radians?": "rad",
    "feet": "ft",
    "miles?": "mi",
    "squared?": "2",
    "per": "/",
}
"""Pattern of a word in a unit that is written out (`Unit_KiloMeterPerHour`, `degrees per second`) -> its sign."""
SCALED_UNIT_PATTERN = re.compile(r"(?P<factor>0\.0*1|10*|1e-?\d)(?P<unit>[^\d].*)")
"""A unit with a power of ten before it: `0.001 s`, `1e-2 deg`."""


def find_unit(text: str, kind: str) -> str:
    """Return the unit of a kind of quantity by its spelling, "" for a spelling that is not a unit of this kind."""
    spelling = re.sub(r"[\s\[\]()]", "", text.lower()).replace("·", "").replace("*", "").replace("sec^", "s^")
    found = _UNIT_BY_KIND_OF_SPELLING.get(spelling, {})
    if kind in found:
        return found[kind]
    factors = FACTOR_BY_KIND_AND_UNIT.get(kind, {})
    if spelling in factors:
        return spelling
    if "per" in spelling or spelling.startswith("unit_"):
        written_out = spelling.removeprefix("unit_").replace("_", "")
        for word, sign in _UNIT_SIGN_BY_WRITTEN_OUT_UNIT_WORD_PATTERN.items():
            written_out = re.sub(word, sign, written_out)
        return find_unit(written_out, kind) if written_out != spelling else ""
    scaled = SCALED_UNIT_PATTERN.fullmatch(spelling)
    base = _UNIT_BY_KIND_OF_SPELLING.get(scaled["unit"], {}).get(kind) if scaled else None
    if scaled is None or base is None:
        return ""
    factor = float(scaled["factor"]) * factors[base]
    return next((unit for unit, each in factors.items() if math.isclose(each, factor)), "")


def is_unit_text(text: str) -> bool:
    """Tell whether a text is the spelling of any unit."""
    spelling = re.sub(r"[\s\[\]()]", "", text.lower())
    scaled = SCALED_UNIT_PATTERN.fullmatch(spelling)
    return (
        spelling in _UNIT_BY_KIND_OF_SPELLING
        or (scaled is not None and scaled["unit"] in _UNIT_BY_KIND_OF_SPELLING)
        or ("per" in spelling and any(find_unit(spelling, kind) for kind in FACTOR_BY_KIND_AND_UNIT))
    )
