"""The formats of tracks; each module describes one and encodes tracks as the bytes of a file."""

from __future__ import annotations

from importlib import import_module

from cwcli.export.formats.base import TrackFormat

TRACK_FORMATS = {
    "tum": "cwcli.export.formats.tum",
    "kitti": "cwcli.export.formats.kitti",
    "gpx": "cwcli.export.formats.gpx",
    "kml": "cwcli.export.formats.kml",
    "geojson": "cwcli.export.formats.geojson",
    "osi": "cwcli.export.formats.osi",
}
"""Name of a format -> the module with its `FORMAT`."""


def load_track_format(name: str) -> TrackFormat:
    """Import the format of a name in `TRACK_FORMATS`."""
    found: TrackFormat = import_module(TRACK_FORMATS[name]).FORMAT
    return found
