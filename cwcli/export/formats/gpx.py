"""GPX 1.1: a track with a time at each point.

Source: topografix.com/GPX/1/1. It holds no headings and speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from cwcli.export.formats.base import Track, TrackFormat
from cwcli.export.text import format_degrees, format_iso_time, replace_forbidden_xml_characters

GPX_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="cwcli" xmlns="http://www.topografix.com/GPX/1/1">
"""
"""Beginning of a GPX document."""


def encode_gpx_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode each track as a `trk` of one segment."""
    parts = [GPX_HEAD]
    for track in tracks:
        parts.append(f"<trk><name>{escape(replace_forbidden_xml_characters(track.id))}</name><trkseg>\n")
        rows = zip(track.stamp_ns.tolist(), track.latitude_deg, track.longitude_deg, strict=True)
        parts += [
            f'<trkpt lat="{format_degrees(lat)}" lon="{format_degrees(lon)}">'
            f"<time>{format_iso_time(stamp_ns)}</time></trkpt>\n"
            for stamp_ns, lat, lon in rows
        ]
        parts.append("</trkseg></trk>\n")
    return "".join([*parts, "</gpx>\n"]).encode()


FORMAT = TrackFormat((".gpx",), "GPX 1.1, for maps and GNSS tools", encode_gpx_tracks, is_geographic=True)
"""The description of this format for the table of formats."""
