"""`nmea_msgs/Sentence`: NMEA 0183 sentences as text (GGA, RMC, VTG, HDT of any talker).

A channel holds sentences of many kinds. The position is that of the GGA sentences, which have the height, or else of
the RMC; the velocity that of the RMC, which say whether it is valid, or else of the VTG; the heading that of the HDT.
The others are set aside. A sentence whose checksum is wrong or missing is rejected: a cut one looks sound but for that.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.builders.gnss import (
    GnssFix,
    heading_from_compass_or_nan,
    velocity_from_speed_and_course,
)
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.leaf_fields import read_stamps, read_texts
from cwcli.signals.quality import RowLedger
from cwcli.signals.role import Role
from cwcli.signals.units import MPS_PER_KMH

STANDARD_SENTENCE_ADDRESS_PATTERN = re.compile(r"[A-OQ-Z0-9][A-Z0-9]{4}")
"""A talker of two characters and a sentence type of three (NMEA 0183); `P` begins a maker's own sentences."""
MPS_PER_KNOT = 1852.0 / 3600.0
"""One knot in m/s (1852 m per hour)."""
NAN = float("nan")
"""The value of a quantity that a sentence does not give."""
NO_SENTENCE_REASON = "no NMEA sentence"
"""The reason for rejecting a text that is no NMEA sentence."""
NO_CHECKSUM_REASON = "NMEA checksum missing"
"""The reason for rejecting a sentence without a checksum."""
BAD_CHECKSUM_REASON = "NMEA checksum wrong"
"""The reason for rejecting a sentence whose checksum does not match."""
SENTENCE_TOO_SHORT_REASON = "NMEA sentence too short"
"""The reason for rejecting a sentence with too few fields."""
OTHER_SENTENCE_REASON = "other NMEA sentence"
"""The reason for setting aside a sentence of a type that is not needed."""
SENTENCE_TYPES_BY_ROLE: dict[str, tuple[str, ...]] = {
    Role.EGO_POSITION: ("GGA", "RMC"),
    Role.EGO_VELOCITY: ("RMC", "VTG"),
    Role.EGO_HEADING: ("HDT",),
}
"""The sentence types that give position, velocity and heading, best first."""
UNMEASURED_GGA_QUALITIES = ("0", "7")
"""The GGA quality codes of fixes that are not measured: 0 is no fix, 7 is typed in by hand (NMEA 0183)."""


@dataclass(frozen=True)
class SentenceValues:
    """The values of one sentence, in degrees, metres and m/s; NaN where it gives none."""

    is_fix: bool = True
    latitude_deg: float = NAN
    longitude_deg: float = NAN
    altitude_m: float = NAN
    speed_mps: float = NAN
    course_deg: float = NAN


def split_sentence(text: str) -> tuple[str, list[str]]:
    """Return a sentence's type (`GGA`) and fields; for an unusable text the reason and no fields."""
    body = text.strip()
    start = max(body.find("$"), body.find("!"))
    if start < 0 or not body.isascii():
        return NO_SENTENCE_REASON, []
    content, star, checksum = body[start + 1 :].partition("*")
    if not star or len(checksum) < 2:
        return NO_CHECKSUM_REASON, []
    try:
        stated_checksum = int(checksum[:2], 16)
    except ValueError:
        return BAD_CHECKSUM_REASON, []
    if stated_checksum != reduce(xor, content.encode(), 0):
        return BAD_CHECKSUM_REASON, []
    address, *fields = content.split(",")
    is_standard = STANDARD_SENTENCE_ADDRESS_PATTERN.fullmatch(address) is not None
    kind = address[2:] if is_standard else OTHER_SENTENCE_REASON
    return (
        (SENTENCE_TOO_SHORT_REASON, [])
        if kind in MIN_FIELDS_AND_PARSER_BY_SENTENCE and len(fields) < MIN_FIELDS_AND_PARSER_BY_SENTENCE[kind][0]
        else (kind, fields)
    )


def parse_gga(fields: Sequence[str]) -> SentenceValues:
    """Parse GGA, the fix. The geoid separation turns its height into one above the ellipsoid."""
    _, latitude, north, longitude, east, quality, _, _, altitude, _, separation = fields[:11]
    is_fix = quality.isdecimal() and quality not in UNMEASURED_GGA_QUALITIES
    place = parse_degrees_minutes(latitude, north, "NS"), parse_degrees_minutes(longitude, east, "EW")
    return SentenceValues(is_fix, *place, altitude_m=parse_number_or_nan(altitude) + parse_number_or_nan(separation))


def parse_rmc(fields: Sequence[str]) -> SentenceValues:
    """Parse RMC, the recommended minimum, with the speed in knots."""
    _, status, latitude, north, longitude, east, speed, course = fields[:8]
    is_fix = status == "A" and not (len(fields) > 11 and fields[11] == "N")
    place = parse_degrees_minutes(latitude, north, "NS"), parse_degrees_minutes(longitude, east, "EW")
    return SentenceValues(
        is_fix, *place, speed_mps=MPS_PER_KNOT * parse_number_or_nan(speed), course_deg=parse_number_or_nan(course)
    )


def parse_vtg(fields: Sequence[str]) -> SentenceValues:
    """Parse VTG, course and speed over ground, in km/h or else in knots."""
    course, _, _, _, knots, _, kmh, _ = fields[:8]
    speed = MPS_PER_KMH * parse_number_or_nan(kmh) if kmh else MPS_PER_KNOT * parse_number_or_nan(knots)
    return SentenceValues(
        not (len(fields) > 8 and fields[8] == "N"), speed_mps=speed, course_deg=parse_number_or_nan(course)
    )


def parse_hdt(fields: Sequence[str]) -> SentenceValues:
    """Parse HDT, the vehicle's true heading."""
    heading, of_north = fields[:2]
    return SentenceValues(course_deg=parse_number_or_nan(heading) if of_north == "T" else NAN)


MIN_FIELDS_AND_PARSER_BY_SENTENCE: dict[str, tuple[int, Callable[[Sequence[str]], SentenceValues]]] = {
    "GGA": (11, parse_gga),
    "RMC": (8, parse_rmc),
    "VTG": (8, parse_vtg),
    "HDT": (2, parse_hdt),
}
"""The least number of fields and the parser, by sentence type."""


def parse_degrees_minutes(text: str, hemisphere: str, both_hemispheres: str) -> float:
    """Parse degrees and minutes: `4807.038`, `N` gives 48.1173; the second hemisphere is negative, an invalid text
    and a place beyond 90 or 180 degrees NaN."""
    value = parse_number_or_nan(text)
    whole, minutes = divmod(value, 100.0)
    if len(hemisphere) != 1 or hemisphere not in both_hemispheres or not (value >= 0.0 and minutes < 60.0):
        return NAN
    if whole + minutes / 60.0 > (90.0 if hemisphere in "NS" else 180.0):
        return NAN
    return (whole + minutes / 60.0) * (1.0 if hemisphere == both_hemispheres[0] else -1.0)


def parse_number_or_nan(text: str) -> float:
    """Parse digits with one point and a sign at most; NaN for any other text."""
    unsigned = text[1:] if text.startswith(("+", "-")) else text
    return float(text) if unsigned.replace(".", "", 1).isdecimal() else NAN


def read_sentences(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read the sentences of the first type that the channel has of those that give what the role needs."""
    kinds = SENTENCE_TYPES_BY_ROLE[ledger.quality.role]
    field = read_texts(columns, "sentence")
    values = () if field is None else field.values
    split = [*map(split_sentence, values), (NO_SENTENCE_REASON, [])]
    codes = np.full(len(columns), -1, np.int64) if field is None else field.codes.astype(np.int64)
    names = np.array([kind for kind, _ in split])
    sentence_kind = next((kind for kind in kinds if kind in names), kinds[0])
    for reason in (NO_SENTENCE_REASON, NO_CHECKSUM_REASON, BAD_CHECKSUM_REASON, SENTENCE_TOO_SHORT_REASON):
        ledger.reject((names == reason)[codes], reason)
    ledger.set_aside((names != sentence_kind)[codes], OTHER_SENTENCE_REASON)
    said = [
        MIN_FIELDS_AND_PARSER_BY_SENTENCE[kind][1](fields) if kind == sentence_kind else SentenceValues(False)
        for kind, fields in split
    ]

    def float_column(name: str) -> FloatArray:
        return np.array([getattr(each, name) for each in said], np.float64)[codes]

    course_deg = float_column("course_deg")
    return GnssFix(
        *read_stamps(columns),
        is_fix=np.array([each.is_fix for each in said])[codes],
        latitude_deg=float_column("latitude_deg"),
        longitude_deg=float_column("longitude_deg"),
        altitude_m=float_column("altitude_m"),
        velocity_mps=velocity_from_speed_and_course(float_column("speed_mps"), course_deg),
        heading_rad=heading_from_compass_or_nan(course_deg),
    )
