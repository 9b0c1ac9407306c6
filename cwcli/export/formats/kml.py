"""KML 2.2 with Google's extension for tracks with times.

Source: OGC 07-147r2, and developers.google.com/kml/documentation/kmlreference (`gx:Track`).
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from cwcli.export.formats.base import Track, TrackFormat
from cwcli.export.text import format_degrees, format_iso_time, replace_forbidden_xml_characters

KML_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document>
"""
"""Beginning of a KML document."""


def encode_kml_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode each track as a `Placemark`: first all its times, then all its positions."""
    parts = [KML_HEAD]
    for track in tracks:
        parts.append(f"<Placemark><name>{escape(replace_forbidden_xml_characters(track.id))}</name><gx:Track>\n")
        parts += [f"<when>{format_iso_time(stamp_ns)}</when>\n" for stamp_ns in track.stamp_ns.tolist()]
        places = zip(track.longitude_deg, track.latitude_deg, strict=True)
        parts += [f"<gx:coord>{format_degrees(lon)} {format_degrees(lat)} 0</gx:coord>\n" for lon, lat in places]
        parts.append("</gx:Track></Placemark>\n")
    return "".join([*parts, "</Document>\n</kml>\n"]).encode()


FORMAT = TrackFormat((".kml",), "KML 2.2, for Google Earth", encode_kml_tracks, is_geographic=True)
"""The description of this format for the table of formats."""
