"""Which quantity a column can be by its name, and the unit that the name states.

A name is split into words (`gpsSpeed_kmh`, `GPS Speed (km/h)` -> gps, speed; km/h). A quantity has nouns, of which one
must be there, and words that may stand beside; any other word makes the column something else.
"""

from __future__ import annotations

import re
from functools import lru_cache

from cwcli.importing.units import find_unit, is_unit_text
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Quantity:
    """What a column can be.

    Attributes:
        kind: Kind of its unit, a key of `cwcli.importing.units.FACTOR_BY_KIND_AND_UNIT`, or `text`.
        nouns: Words of which exactly one is in the name.
        qualifiers: Words that may stand in the name as well.
    """

    kind: str
    nouns: frozenset[str]
    qualifiers: frozenset[str] = frozenset()


def _quantity_from_words(kind: str, nouns: str, *qualifiers: str) -> Quantity:
    """Return a quantity by its words in texts."""
    return Quantity(kind, frozenset(nouns.split()), frozenset(" ".join(qualifiers).split()))


_RECEIVER_WORDS = (
    "gps gnss ins nav pvt fix receiver raw wgs84 location position pos geo point coord coordinate current my ubx osd"
)
_CAR_WORDS = (
    "vehicle veh car ego own obd can host actual measured value signal val current display displayed esp abs ecu "
    "motion dynamics chassis"
)
_WORDS_BESIDE_TIME = (
    "gps gnss utc gmt unix epoch system sys sensor local iso iso8601 since start from log recorder record recorded ros "
    "header device phone rel relative abs absolute posix measurement sample fix elapsed of the in wall realtime date "
    "fly flight osd marca de step frame today boot midnight uptime"
)
_WORDS_BESIDE_PLACE = "pos position translation local map utm enu global world vehicle veh ego car"
_AXIS_NOUNS_OF_ACCEL = "gforce gsensor acceleration accelerometer accel acc accelerations"
_AXIS_NOUNS_OF_GYRO = "gyro gyroscope gyr gyros omega angvel angrate angularrate angularvelocity"
_WORDS_BESIDE_IMU = (
    "imu linear raw uncal calibrated body sensor motion rotation rate angular velocity vel total with g specific "
    "force user"
)

COLUMN_WORDS_BY_QUANTITY: dict[str, Quantity] = {
    "time": _quantity_from_words(
        "time",
        (
            "time times timestamp timestamps tst timestep stamp t datetime epoch clock zeit zeitstempel tijd "
            "tijdstip tijdstempel temps horodatage heure tiempo hora ora tempo tid tidpunkt czas время ts timeofday "
            "uhrzeit utc tow itow towms sow elapsed seconds nanos millis"
        ),
        _WORDS_BESIDE_TIME,
        "time stamp timestamp week of day seconds second millis nanos uhrzeit",
    ),
    "date": _quantity_from_words("text", "date datum day fecha data dato", "utc gps gmt local"),
    "week": _quantity_from_words("number", "week wn wnc gpsweek weekno", "gps gnss number no num"),
    "latitude": _quantity_from_words(
        "place",
        "latitude lat latitud latitudine breite breitengrad breedtegraad bredde breddegrad szerokość szerokosc широта",
        _RECEIVER_WORDS,
        "n s ns est estimated",
    ),
    "longitude": _quantity_from_words(
        "place",
        (
            "longitude longtitude lon lng long longitud longitudine länge laenge längengrad laengengrad lengtegraad "
            "længde længdegrad lengdegrad długość dlugosc долгота"
        ),
        _RECEIVER_WORDS,
        "e w ew est estimated",
    ),
    "latitude_half": _quantity_from_words("text", "ns latdir lathem", _RECEIVER_WORDS, "indicator hemisphere"),
    "longitude_half": _quantity_from_words("text", "ew londir lonhem longdir", _RECEIVER_WORDS, "indicator hemisphere"),
    "altitude": _quantity_from_words(
        "length",
        "altitude alt height elevation ele hmsl höhe hoehe hoogte altura altitud altitudine quota hauteur",
        _RECEIVER_WORDS,
        "est estimated msl above sea level ellipsoid ellipsoidal wgs hae mean asl amsl ü über nn nhn normalnull",
    ),
    "speed": _quantity_from_words(
        "speed",
        (
            "speed velocity vel spd v sog gspeed groundspeed geschwindigkeit vitesse velocidad velocidade velocità "
            "velocita snelheid hastighet hastighed prędkość predkosc rychlost скорость"
        ),
        _RECEIVER_WORDS,
        _CAR_WORDS,
        "over ground 2d horizontal horiz h forward longitudinal long linear",
    ),
    "velocity_east": _quantity_from_words("speed", "vele ve veast", _RECEIVER_WORDS),
    "velocity_north": _quantity_from_words("speed", "veln vn vnorth", _RECEIVER_WORDS),
    "course": _quantity_from_words(
        "angle",
        "course cog bearing headmot direction richtung kurs cmg crs cap rumbo rumo koers direzione rotta dirección",
        _RECEIVER_WORDS,
        "over ground track true motion of",
    ),
    "heading": _quantity_from_words(
        "angle",
        "heading hdg yaw azimuth psi theta headveh",
        _RECEIVER_WORDS,
        _CAR_WORDS,
        "true angle compass orientation north attitude of motion euler ins imu",
    ),
    "yaw_rate": _quantity_from_words("turn rate", "yawrate yawrt gierrate yawvel", _CAR_WORDS, _RECEIVER_WORDS, "imu"),
    "steering": _quantity_from_words(
        "angle", "steering steer lenkwinkel steeringangle", _CAR_WORDS, "angle wheel road tire tyre front"
    ),
    **{
        f"accel_{axis}": _quantity_from_words(
            "acceleration", f"{_AXIS_NOUNS_OF_ACCEL} acc{axis} accel{axis} a{axis} gf{axis}", _WORDS_BESIDE_IMU
        )
        for axis in "xyz"
    },
    **{
        f"gyro_{axis}": _quantity_from_words(
            "turn rate", f"{_AXIS_NOUNS_OF_GYRO} gyro{axis} gyr{axis} g{axis} w{axis}", _WORDS_BESIDE_IMU
        )
        for axis in "xyz"
    },
    **{f"quaternion_{axis}": _quantity_from_words("number", f"q{axis}") for axis in "xyzw"},
    "x": _quantity_from_words("length", "x easting east xeast utmx posx positionx px tx", _WORDS_BESIDE_PLACE),
    "y": _quantity_from_words("length", "y northing north ynorth utmy posy positiony py ty", _WORDS_BESIDE_PLACE),
    "z": _quantity_from_words("length", "z posz positionz pz tz", _WORDS_BESIDE_PLACE),
    **{
        part: _quantity_from_words("number", nouns, "utc gps gmt local")
        for part, nouns in {
            "year": "year yyyy jahr",
            "month": "month mon monat",
            "day": "day dd tag",
            "hour": "hour hours hr hh stunde",
            "minute": "minute minutes min mm",
            "second": "second seconds sec secs ss sekunde",
            "millisecond": "millisecond milliseconds millisekunde msec ms",
            "microsecond": "microsecond microseconds mikrosekunde micro micros usec usecs",
            "nanosecond": "nano nanosecond",
        }.items()
    },
    "day_half": _quantity_from_words("text", "ampm meridiem meridian", "time clock"),
    "vehicle_id": _quantity_from_words("text", "id", "vehicle veh car track object device trip station agent obj"),
    "fix": _quantity_from_words("number", "fix fixtype quality fixquality", "gps gnss type quality status"),
}
"""Name of a quantity -> what a column of it can be called, and the kind of its unit."""

_AXIS_WORDS = {"x": "x", "y": "y", "z": "z", "longitudinal": "x", "lateral": "y", "vertical": "z"}
_WORD_PAIRS_BY_SINGLE_WORD = {
    "yawrate": "yaw rate, yaw velocity, yaw rt",
    "steeringwheel": "steering wheel",
    "gyro": "rotation rate, angular velocity, angular rate, ang vel, ang rate",
    "nedvel": "ned vel, vel ned",
    "enuvel": "enu vel, vel enu",
    "veln": "vel n, velocity north, north velocity, vel north, v north, v n, nedvel x, nedvel n, enuvel y, enuvel n",
    "vele": "vel e, velocity east, east velocity, vel east, v east, v e, nedvel y, nedvel e, enuvel x, enuvel e",
    "crs": "g crs",
    **{f"q{axis}": f"quat {axis}, quaternion {axis}, orientation {axis}" for axis in "xyzw"},
    "latdir": "lat dir",
    "londir": "lon dir",
    "ns": "n s",
    "ew": "e w",
    "headmot": "head mot",
    "ampm": "am pm",
    "headveh": "head veh",
    "itow": "i tow",
    "wnc": "w nc",
    "hmsl": "h msl, h ell",
    "gspeed": "g speed, g vel, g spd",
    "groundspeed": "ground speed",
    "hhmm": "hh mm",
    "time": "sensor time, hhmm ss",
    "ms": "m sec",
    "gforce": "g force",
    "gfx": "g fx",
    "gfy": "g fy",
    "gfz": "g fz",
}
"""One word -> the pairs of words that mean it."""
_SINGLE_WORD_BY_WORD_PAIR = {
    tuple(pair.split()): word for word, pairs in _WORD_PAIRS_BY_SINGLE_WORD.items() for pair in pairs.split(", ")
}
"""Two words that mean one."""
_TOPIC_FOLDER_WORDS_TO_IGNORE = frozenset(
    {
        "report",
        "status",
        "state",
        "msg",
        "message",
        "data",
        "topic",
        "sensor",
        "sensors",
        "twist",
        "velocity",
        "pose",
        "odom",
    }
)
"""Words of the folders of a topic (`/vehicle/velocity_report/speed`) that say nothing against its last name."""
_WORDS_BEHIND_UNIT_OF_TIME = frozenset({"today", "since", "boot", "start", "elapsed", "midnight", "uptime"})
"""Words behind a unit of time that make a name one of a time: `ms_today`, `us since boot`."""
_UNITS_THAT_ALONE_NAME_A_SPEED_COLUMN = frozenset({"mph", "kmh", "kph", "kmph", "knots", "kts"})
"""Units that are the whole name of a column of speeds."""
MAX_READ_COLUMN_NAME_CHARACTERS = 500
"""Number of characters of a column's name that are looked at. Chosen by hand: paths of topics have 100."""
_MAX_UNIT_WORDS_AT_NAME_END = 3
"""Largest number of words at the end of a name that are tried as a unit (`m s 2`)."""


@dataclass(frozen=True)
class NamedColumn:
    """What a column's name says.

    Attributes:
        words: Its words in lower case, without the unit.
        unit_text: The unit as written, or "".
    """

    words: tuple[str, ...]
    unit_text: str


@lru_cache(maxsize=4096)
def split_name(name: str) -> NamedColumn:
    """Split a column's name into its words and its unit: in brackets, or as its last words."""
    text = (
        name[:MAX_READ_COLUMN_NAME_CHARACTERS]
        .strip()
        .strip('"')
        .strip("#")
        .strip()
        .removeprefix(".")
        .removeprefix("field.")
    )
    if "|" in text:  # RaceCapture: "Speed"|"kph"|0.0|250.0|10
        text = "{} [{}]".format(*(part.strip('" ') for part in text.split("|")[:2]))
    unit = ""
    bracket = re.search(r"[\[(<{]([^\])>}]*)[\])>}]", text)
    if bracket:
        unit = bracket.group(1).strip()
        text = text[: bracket.start()] + " " + text[bracket.end() :]
    elif re.search(r"\s(in|/)\s*\S+$", text):
        head, _, tail = re.sub(r"\s(in|/)\s*(\S+)$", r"\0\2", text).partition("\0")
        if is_unit_text(tail):
            text, unit = head, tail
    text = re.sub(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])", " ", text)
    text = re.sub(r"(?<=[A-Z])(?=[A-Z][a-z])", " ", text)
    words = [word for word in re.split(r"(?:[^\w°]|_)+", text.lower()) if word]
    if not unit:
        words, unit = _split_words_and_unit(words)
    elif len(words) > 1 and not is_unit_text(unit):
        words, more = _split_words_and_unit(words)  # `speed_kmh (GPS)`
        words, unit = (
            ([*words, *re.split(r"(?:\W|_)+", unit.lower())], more) if more or len(unit) > 1 else (words, unit)
        )
    if not unit and len(words) > 1 and find_unit(words[0], "time") and set(words[1:]) <= _WORDS_BEHIND_UNIT_OF_TIME:
        words, unit = ["time", *words[1:]], words[0]
    joined: list[str] = []
    for word in [part for each in words for part in _word_without_number_at_end(each)]:
        pair = (joined[-1], word) if joined else ("", "")
        if pair in _SINGLE_WORD_BY_WORD_PAIR:
            joined[-1] = _SINGLE_WORD_BY_WORD_PAIR[pair]
        else:
            joined.append(word)
    return NamedColumn(tuple(word for word in joined if word), unit)


def _word_without_number_at_end(word: str) -> list[str]:
    """Return a word without a number at its end (`speed2`), which tells columns of one quantity apart."""
    numbered = re.fullmatch(r"([^\W\d_]{3,})\d{1,2}", word)
    return [numbered.group(1)] if numbered and word not in {"wgs84", "iso8601"} else [] if word.isdecimal() else [word]


def _split_words_and_unit(words: list[str]) -> tuple[list[str], str]:
    """Return the words without a unit at their end, and the unit."""
    if words == ["m", "sec"]:  # mSec
        return words, ""
    for n in range(min(_MAX_UNIT_WORDS_AT_NAME_END, len(words) - 1), 0, -1):
        tail = words[-n:]
        if n == 1 and tail[0] in {"second", "seconds"} and words[0] in {"utc", "gps", "gmt", "local"}:
            break  # a part of the date in six columns
        if n == 1 and tail[0] in {"m", "s", "g"} and len(words) == 2 and words[0] in {"n", "e"}:
            break
        for joint in ("", "/"):
            if is_unit_text(joint.join(tail)):
                return words[:-n], joint.join(tail)
    return words, ""


def quantities_of_name(name: str) -> list[str]:
    """Return the quantities that a column can be by its name."""
    if name.strip().lower() in _UNITS_THAT_ALONE_NAME_A_SPEED_COLUMN:
        return ["speed"]
    message, _, signal = name.rpartition("::")
    if message:  # CAN signals, whose names repeat those of their messages and senders: `ESP_21::ESP_v_Signal`
        noise = set(split_name(message).words)
        words = split_name(signal).words
        return _quantities_of_words(tuple(word for word in words if word not in noise) or words)
    named = split_name(name)
    found = _quantities_of_words(named.words)
    if not found and "track" in named.words and find_unit(named.unit_text, "angle"):  # without a unit it is a number
        found = _quantities_of_words(tuple("course" if word == "track" else word for word in named.words))
    if not found and name.startswith("/"):
        folders, _, last = name.rpartition("/")
        folder_words = [word for word in split_name(folders).words if word not in _TOPIC_FOLDER_WORDS_TO_IGNORE]
        found = _quantities_of_words((*folder_words, *split_name(last).words))
    return found


def _quantities_of_words(words: tuple[str, ...]) -> list[str]:
    return [quantity for quantity in COLUMN_WORDS_BY_QUANTITY if _do_words_name_quantity(words, quantity)]


def unit_of_name(name: str, kind: str) -> str:
    """Return the unit of a kind that a column's name states, or ""."""
    return find_unit(split_name(name).unit_text, kind) or (
        find_unit(name, kind) if name.lower() in _UNITS_THAT_ALONE_NAME_A_SPEED_COLUMN else ""
    )


def _do_words_name_quantity(words: tuple[str, ...], quantity: str) -> bool:
    quantity_words = COLUMN_WORDS_BY_QUANTITY[quantity]
    axis = quantity[-1] if quantity.startswith(("accel_", "gyro_")) else ""
    if axis:
        axes = [_AXIS_WORDS[word] for word in words if word in _AXIS_WORDS]
        joined = [
            word
            for word in words
            if word in quantity_words.nouns and len(word) <= 6 and word.endswith(axis) and word not in {"gyro"}
        ]
        if axes and axes != [axis]:
            return False
        if not axes and not joined:
            return False
        words = tuple(word for word in words if word not in _AXIS_WORDS)
    nouns = [word for word in words if word in quantity_words.nouns]
    others = [
        word
        for word in words
        if word not in quantity_words.nouns and not (nouns and find_unit(word, quantity_words.kind))
    ]
    if quantity == "time":
        return bool(nouns) and all(word in quantity_words.qualifiers for word in others)
    is_noun_there = bool(nouns) if axis else len(nouns) == 1  # `accelerometerAccelerationX`
    return is_noun_there and all(word in quantity_words.qualifiers for word in others)
