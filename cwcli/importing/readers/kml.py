"""Tracks in KML: `gx:Track` with a `when` for each `gx:coord` (longitude, latitude, height); read as a stream.

Source: developers.google.com/kml/documentation/kmlreference#gxtrack. A `LineString` has no times and is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.importing.bounded_xml import iter_xml_events
from cwcli.importing.cells import DECIMAL_POINT_PATTERN
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, Preset, SourceTable

PRESET_BY_COLUMN = {
    "when": Preset("time"),
    "latitude": Preset("latitude", "deg"),
    "longitude": Preset("longitude", "deg"),
    "height": Preset("altitude", "m"),
}
"""Column -> the quantity and unit that the format fixes."""
NUMBER_PATTERN = re.compile(DECIMAL_POINT_PATTERN, re.ASCII)
"""A number of a place."""
MAX_TIME_CHARACTERS = 100
"""Number of characters of a time that are read; a longer text is none. Chosen by hand."""
MAX_TRACK_POINTS = 500_000
"""Greatest number of points: 13 hours at 10 Hz, which take 3 s and 150 MB. Chosen by hand."""


def _accepts_kml_file(head: FileHead) -> bool:
    return b"<kml" in head.data[:2000]


def _read_kml_table(path: str, answers: Answers) -> Sequence[SourceTable]:
    import pyarrow as pa

    whens: list[str] = []
    coordinates: list[tuple[float, float, float]] = []
    n_tracks = 0
    is_in_track = False  # a TimeStamp outside of it has a `when`, too
    for event, element in iter_xml_events(path, set()):
        tag = element.tag.rpartition("}")[2]
        is_in_track = event == "start" if tag == "Track" else is_in_track
        if event == "start":
            continue
        text = (element.text or "").strip()
        if tag == "when" and is_in_track:
            whens.append(text[:MAX_TIME_CHARACTERS])
        elif tag == "coord" and is_in_track:
            coordinates.append(_longitude_latitude_height(text))
        elif tag == "Track":
            n_tracks += 1
            if len(whens) != len(coordinates):
                raise DataError(
                    f"a track has {len(whens)} times and {len(coordinates)} places", where=path, hint="export it again"
                )
        if max(len(whens), len(coordinates)) > MAX_TRACK_POINTS:
            raise InputError(f"it has more than {MAX_TRACK_POINTS:,} points", where=path)
    if not n_tracks or not coordinates:
        raise InputError(
            "it is KML without a track that has times, which is not imported",
            where=path,
            hint="export it as GPX, or as KML with gx:Track",
        )
    places = np.array(coordinates)
    arrays = {"when": pa.array(whens), "latitude": places[:, 1], "longitude": places[:, 0], "height": places[:, 2]}
    columns_with_values = {
        name: each for name, each in arrays.items() if name != "height" or np.isfinite(places[:, 2]).any()
    }
    notes = [f"{n_tracks} tracks are read as one drive"] if n_tracks > 1 else []
    presets = {name: PRESET_BY_COLUMN[name] for name in columns_with_values}
    return [SourceTable.of_arrays(path, "", "kml", columns_with_values, presets=presets, notes=notes)]


def _longitude_latitude_height(text: str) -> tuple[float, float, float]:
    """Return a place of a `gx:coord`, NaN for what it lacks or what is no number."""
    parts = [*text.split(maxsplit=3)[:3], "", "", ""]
    values = [float(each) if NUMBER_PATTERN.match(each) else math.nan for each in parts[:3]]
    longitude, latitude, height = (each if math.isfinite(each) else math.nan for each in values)
    return longitude, latitude, height


KIND = ImportKind("KML tracks with times", (".kml",), _accepts_kml_file, _read_kml_table)
"""The description of this kind."""
