"""NMEA 0183 as text: GGA or RMC for the position, RMC or VTG for the velocity, HDT for the heading; times are UTC.

A sentence whose checksum is wrong or missing is left out and counted, as for recorded `nmea_msgs/Sentence`.
"""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import field

import numpy as np

from cwcli.errors import DataError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, Preset, SourceTable
from cwcli.importing.text_file import iter_text_lines
from cwcli.importing.times import parse_start_ns
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.builders.nmea import MIN_FIELDS_AND_PARSER_BY_SENTENCE, split_sentence
from cwcli.signals.columns import Int64Array
from cwcli.signals.units import NS_PER_DAY, NS_PER_S
from cwcli.text import format_count

NMEA_SENTENCE_PATTERN = re.compile(r"[$!][A-Z]{2,5}[A-Z]*,.*(\*[0-9A-Fa-f]{2}|,)")
"""Pattern of an NMEA sentence, with or without its checksum."""
COLUMNS_BY_TABLE = {
    "position": ("latitude_deg", "longitude_deg", "altitude_m"),
    "velocity": ("speed_mps", "course_deg"),
    "heading": ("course_deg",),
}
"""Table -> the values of a sentence that it takes."""
PRESET_BY_COLUMN = {
    "time": Preset("time", "ns"),
    "latitude_deg": Preset("latitude", "deg"),
    "longitude_deg": Preset("longitude", "deg"),
    "altitude_m": Preset("altitude", "m"),
    "speed_mps": Preset("speed", "mps"),
    "course_deg": Preset("course", "deg-cw-north"),
}
"""Column -> the quantity and unit that the format fixes."""
SENTENCES_WITH_TIME = {"RMC", "GGA", "ZDA"}
"""The sentences that have a time of their own; the others have that of the last one before them."""
SENTENCES_BY_TABLE = {"position": ("GGA", "RMC"), "velocity": ("RMC", "VTG"), "heading": ("HDT",)}
"""Table -> the sentences that give it, the best first."""


@dataclass
class Sentences:
    """The values of a kind of sentence, by its row in the sequence of times."""

    row: array[int] = field(default_factory=lambda: array("q"))
    values: dict[str, array[float]] = field(default_factory=dict)


@dataclass
class CollectedSentences:
    """What the sentences of a file say.

    Attributes:
        ns_of_day: Time of day of each sentence that has one.
        day: Days since 1970 where the sentence has a date, else -1.
        by_type: Sentence type -> its values.
        counts: Reason -> sentences that can't be used.
    """

    ns_of_day: array[int] = field(default_factory=lambda: array("q"))
    day: array[int] = field(default_factory=lambda: array("q"))
    by_type: dict[str, Sentences] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)


def _accepts_nmea_file(head: FileHead) -> bool:
    found = sum(bool(NMEA_SENTENCE_PATTERN.search(line)) for line in head.lines)
    return found > 0 and found >= 0.3 * len(head.lines)


def _read_nmea_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    collected = _collect_sentences(path)
    if not len(collected.ns_of_day) and collected.counts:
        reasons = ", ".join(f"{reason}: {n}" for reason, n in collected.counts.items())
        raise DataError(
            f"no sentence can be used ({reasons})", where=path, hint="sentences need a checksum: $GPRMC,...*5A"
        )
    if not len(collected.ns_of_day):
        raise DataError("no sentence has a time", where=path, hint="GGA and RMC sentences have one")
    stamps, has_date = _stamps_ns_and_is_date_known(collected)
    notes = [f"{reason}: {format_count(n, 'sentence')}" for reason, n in collected.counts.items()]
    start_ns = 0
    if not has_date:
        if answers.start:
            start_ns = parse_start_ns(answers.start) // NS_PER_DAY * NS_PER_DAY
        else:
            notes.append("no sentence has a date: stamps count from midnight (--start names the day)")
    tables: list[SourceTable] = []
    for name, types in SENTENCES_BY_TABLE.items():
        kind = next((each for each in types if each in collected.by_type), None)
        if kind is None:
            continue
        tables.append(
            _build_sentence_table(path, name, collected.by_type[kind], stamps + start_ns, notes if not tables else [])
        )
        tables[-1].notes.append(f"from {kind} sentences")
    if not tables:
        raise DataError("it has no GGA, RMC, VTG or HDT sentence", where=path)
    return tables


def _build_sentence_table(
    path: str, name: str, sentences: Sentences, stamps: Int64Array, notes: list[str]
) -> SourceTable:
    rows = np.frombuffer(sentences.row, np.int64)
    columns = {"time": stamps[rows], **{key: np.frombuffer(sentences.values[key]) for key in COLUMNS_BY_TABLE[name]}}
    columns_with_values = {key: values for key, values in columns.items() if key == "time" or np.isfinite(values).any()}
    presets = {key: PRESET_BY_COLUMN[key] for key in columns_with_values}
    if name == "heading":
        presets["course_deg"] = Preset("heading", "deg-cw-north")
    return SourceTable.of_arrays(path, name, "nmea", columns_with_values, presets=presets, notes=list(notes))


def _collect_sentences(path: str) -> CollectedSentences:
    collected = CollectedSentences()
    for line in iter_text_lines(path, "ascii"):
        if line.strip():
            _collect_sentence_of_line(collected, line)
    return collected


def _collect_sentence_of_line(collected: CollectedSentences, line: str) -> None:
    kind, fields = split_sentence(line)
    if not fields:
        collected.counts[kind] += 1
        return
    has_time = (
        _collect_time_if_sentence_has_one(collected, kind, fields)
        if kind in SENTENCES_WITH_TIME
        else bool(len(collected.ns_of_day))
    )
    if kind not in MIN_FIELDS_AND_PARSER_BY_SENTENCE:
        return
    values = MIN_FIELDS_AND_PARSER_BY_SENTENCE[kind][1](fields)
    if not values.is_fix or not has_time:
        collected.counts[f"{kind} without a {'time' if values.is_fix else 'fix'}"] += 1
        return
    if kind in ("GGA", "RMC") and math.isnan(values.latitude_deg + values.longitude_deg):
        collected.counts[f"{kind} without a readable place"] += 1
    sentences = collected.by_type.setdefault(kind, Sentences())
    sentences.row.append(len(collected.ns_of_day) - 1)
    for name in ("latitude_deg", "longitude_deg", "altitude_m", "speed_mps", "course_deg"):
        sentences.values.setdefault(name, array("d")).append(getattr(values, name))


def _collect_time_if_sentence_has_one(collected: CollectedSentences, kind: str, fields: Sequence[str]) -> bool:
    """Collect the time, and the date, of a sentence; tell whether it has a time."""
    match = re.fullmatch(r"(\d{2})(\d{2})(\d{2})(?:\.(\d*))?", fields[0])
    if not match:
        return False
    hour, minute, second = (int(match.group(k)) for k in (1, 2, 3))
    if hour > 23 or minute > 59 or second > 60:
        return False
    part = int((match.group(4) or "").ljust(9, "0")[:9] or "0")
    day = -1
    text = fields[8] if kind == "RMC" and len(fields) > 8 else ""
    if re.fullmatch(r"\d{6}", text):
        day = _days_since_1970_or_minus_1(
            2000 + int(text[4:]) if int(text[4:]) < 80 else 1900 + int(text[4:]), int(text[2:4]), int(text[:2])
        )
    if kind == "ZDA" and len(fields) > 3 and all(re.fullmatch(r"[0-9]{1,4}", text) for text in fields[1:4]):
        day = _days_since_1970_or_minus_1(int(fields[3]), int(fields[2]), int(fields[1]))
    collected.ns_of_day.append(((hour * 60 + minute) * 60 + second) * NS_PER_S + part)
    collected.day.append(day)
    return True


def _days_since_1970_or_minus_1(year: int, month: int, day: int) -> int:
    """Return the days since 1970, -1 for a date that does not exist or is not between 1980 and 2200."""
    if not 1980 <= year < 2200:
        return -1
    try:
        return int(np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D").astype(np.int64))
    except ValueError:
        return -1


def _stamps_ns_and_is_date_known(collected: CollectedSentences) -> tuple[Int64Array, bool]:
    """Return ns since 1970 of each time, and whether a date is known: each time is near the one before."""
    ns = np.frombuffer(collected.ns_of_day, np.int64)
    day = np.frombuffer(collected.day, np.int64)
    midnights = np.concatenate([[0], np.cumsum(np.diff(ns) < -NS_PER_DAY // 2)])
    dated = np.flatnonzero(day >= 0)
    if not len(dated):
        return ns + midnights * NS_PER_DAY, False
    nearest = dated[np.clip(np.searchsorted(dated, np.arange(len(ns)), side="right") - 1, 0, len(dated) - 1)]
    return ns + (day[nearest] + midnights - midnights[nearest]) * NS_PER_DAY, True


KIND = ImportKind("NMEA 0183 sentences as text", (".nmea", ".txt", ".log"), _accepts_nmea_file, _read_nmea_tables)
"""How files of NMEA sentences are recognised and read, for the table of import formats."""
