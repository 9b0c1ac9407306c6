"""GPX 1.1: a track with a time at each point.

Source: topografix.com/GPX/1/1. It holds no headings and speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from cwcli.export.formats.base import Track, TrackFormat
from cwcli.export.text import degrees, iso_time, xml_text

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="cwcli" xmlns="http://www.topografix.com/GPX/1/1">
"""
"""Beginning of a GPX document."""


def encode(tracks: Sequence[Track]) -> bytes:
    """Encode each track as a `trk` of one segment."""
    parts = [HEAD]
    for track in tracks:
        parts.append(f"<trk><name>{escape(xml_text(track.id))}</name><trkseg>\n")
        rows = zip(track.stamp_ns.tolist(), track.latitude_deg, track.longitude_deg, strict=True)
        parts += [
            f'<trkpt lat="{degrees(lat)}" lon="{degrees(lon)}"><time>{iso_time(stamp_ns)}</time></trkpt>\n'
            for stamp_ns, lat, lon in rows
        ]
        parts.append("</trkseg></trk>\n")
    return "".join([*parts, "</gpx>\n"]).encode()


FORMAT = TrackFormat((".gpx",), "GPX 1.1, for maps and GNSS tools", encode, on_globe=True)
"""The description of this format for the table of formats."""
