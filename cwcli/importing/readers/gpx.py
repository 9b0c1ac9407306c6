"""GPX tracks: `trkpt` with a time each, read as a stream.

Times are UTC (GPX 1.1, topografix.com/GPX/1/1). Speeds in m/s and courses in degrees are read where a program wrote
them (GPX 1.0, or extensions of the same names).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from cwcli.errors import DataError, MissingSignalError
from cwcli.importing.bounded_xml import iter_xml_events
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, ColumnsOfRows, Preset, Question, SourceTable

TRACK_POINTS_PER_BATCH = 50_000
"""Number of track points in a batch of rows. Chosen by hand: a batch takes a few megabytes."""
PRESET_BY_COLUMN = {
    "time": Preset("time"),
    "lat": Preset("latitude", "deg"),
    "lon": Preset("longitude", "deg"),
    "ele": Preset("altitude", "m"),
    "speed": Preset("speed", "mps"),
    "course": Preset("course"),
}
"""Column -> the quantity and unit that the format fixes."""


def _accepts_gpx_file(head: FileHead) -> bool:
    return "<gpx" in "\n".join(head.lines[:20])


def _read_gpx_tables(path: str, answers: Answers) -> Sequence[SourceTable]:
    tracks = [(name, n) for name, n in _names_and_point_counts_of_tracks(path) if n]
    if not tracks:
        raise DataError("it has no track with points", where=path, hint="routes and way points have no times")
    wanted_track = 0
    if len(tracks) > 1:
        names = [name for name, _ in tracks]
        if answers.vehicle not in names:
            shown = ", ".join(f"{name} ({n} points)" for name, n in tracks[:10])
            raise Question(path, f"it has {len(tracks)} tracks: {shown}", f"--id '{names[0]}'").as_error()
        wanted_track = names.index(answers.vehicle)
    found = set(_names_of_points(path, tracks[wanted_track][0]))
    if "time" not in found:
        raise MissingSignalError(
            "its points have no times: it is a route, not a recorded drive",
            where=path,
            hint="export the recorded activity with its times",
        )
    columns = tuple(name for name in PRESET_BY_COLUMN if name in {"time", "lat", "lon"} or name in found)
    notes: list[str] = []

    def read_column_batches(names: Sequence[str]) -> Iterator[ColumnsOfRows]:
        import pyarrow as pa

        rows: list[dict[str, str]] = []
        for track, point in _iter_track_points(path):
            if track != tracks[wanted_track][0]:
                continue
            rows.append(point)
            if len(rows) == TRACK_POINTS_PER_BATCH:
                yield {name: pa.array([row.get(name, "") for row in rows]) for name in names}
                rows = []
        if rows:
            yield {name: pa.array([row.get(name, "") for row in rows]) for name in names}

    presets = {name: PRESET_BY_COLUMN[name] for name in columns}
    if "course" in presets:
        presets["course"] = Preset("course", "deg-cw-north")
    return [SourceTable(path, "", "gpx", columns, read_column_batches, presets=presets, notes=notes)]


def _names_and_point_counts_of_tracks(path: str) -> list[tuple[str, int]]:
    """Return name and number of points of each track; unnamed and equal names get a number."""
    counts: dict[str, int] = {}
    for name, _ in _iter_track_points(path):
        counts[name] = counts.get(name, 0) + 1
    return list(counts.items())


def _names_of_points(path: str, track: str) -> Iterator[str]:
    for k, (name, point) in enumerate(_iter_track_points(path)):
        if name == track:
            yield from point
        if k > TRACK_POINTS_PER_BATCH:
            return


def _iter_track_points(path: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield track and fields of each point.

    Raises:
        InputError: It is no XML, or exceeds its bounds.
    """
    name, n_tracks = "", 0
    seen: set[str] = set()
    is_in_point = False
    for event, element in iter_xml_events(path, {"trkpt"}):
        tag = element.tag.rpartition("}")[2]
        if event == "start":
            if tag == "trk":
                n_tracks += 1
                name = f"track {n_tracks}"
            is_in_point |= tag == "trkpt"
        elif tag == "name" and not is_in_point and n_tracks:
            text = (element.text or "").strip()
            name = text if text and text not in seen else name
            seen.add(text)
        elif tag == "trkpt":
            is_in_point = False
            yield name, _texts_by_field_of_point(element)


def _texts_by_field_of_point(point: Any) -> dict[str, str]:
    fields = {"lat": point.get("lat", ""), "lon": point.get("lon", "")}
    for child in point.iter():
        tag = child.tag.rpartition("}")[2]
        if tag in PRESET_BY_COLUMN and child.text and tag not in fields:
            fields[tag] = child.text.strip()
    return fields


KIND = ImportKind("GPX tracks", (".gpx",), _accepts_gpx_file, _read_gpx_tables)
"""The description of this kind."""
