"""The file formats of tracks: a description of each, and the functions that encode tracks as the bytes of a file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from cwcli.lazy_dataclass import dataclass
from cwcli.text import finite_or_none

if TYPE_CHECKING:
    from cwcli.signals.columns import FloatArray, Int64Array

DEGREE_DECIMALS = 9
"""Decimals of an angle in degrees; chosen: 0.1 mm on the ground."""
FORBIDDEN_XML_CHARACTERS = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Pattern of the characters that no XML document may hold, not even escaped (XML 1.0, 2.2)."""
GPX_DOCUMENT_START = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="cwcli" xmlns="http://www.topografix.com/GPX/1/1">
"""
"""Beginning of a GPX document."""
KML_DOCUMENT_START = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document>
"""
"""Beginning of a KML document."""


@dataclass(frozen=True)
class Track:
    """States of one vehicle over time, n rows in the order of their stamps.

    Attributes:
        stamp_ns: Shape (n,), Unix time.
        x_m, y_m, heading_rad: Shape (n,): in the map frame; the heading counter-clockwise from east.
        speed_mps: Shape (n,).
        latitude_deg, longitude_deg: Shape (n,), WGS84; NaN where the map has no geographic origin.
        what: The exported content: `ego`, `remote`, ...
        accel_mps2, yaw_rate_radps: Shape (n,), or None.
        size_m: Length and width, None where unknown.
    """

    id: str
    stamp_ns: Int64Array
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    what: str = ""
    accel_mps2: FloatArray | None = None
    yaw_rate_radps: FloatArray | None = None
    size_m: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True)
class TrackFormat:
    """A file format of tracks.

    Attributes:
        suffixes: Suffixes of its files in lower case, the usual one first. No two formats share one.
        description: Name of the format and of the tools that read it, in one line.
        encode: Function from tracks to the content of a file.
        holds_one_track: A file holds one track only.
        is_geographic: It needs latitudes and longitudes.
        is_text: It can be printed on a terminal.
        holds_all_vehicles: By default a file holds the ego and all other vehicles.
    """

    suffixes: tuple[str, ...]
    description: str
    encode: Callable[[Sequence[Track]], bytes]
    holds_one_track: bool = False
    is_geographic: bool = False
    is_text: bool = True
    holds_all_vehicles: bool = False


def encode_tum_trajectory(tracks: Sequence[Track]) -> bytes:
    """Encode `timestamp tx ty tz qx qy qz qw` lines in the map frame, height 0; nine decimals keep stamps exact.

    Source: the RGB-D benchmark's file formats (cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats).
    """
    import numpy as np

    (track,) = tracks
    half = 0.5 * track.heading_rad
    rows = zip(track.stamp_ns.tolist(), track.x_m, track.y_m, np.sin(half), np.cos(half), strict=True)
    lines = [
        f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {x:.6f} {y:.6f} 0 0 0 {sine:.12f} {cosine:.12f}\n"
        for stamp_ns, x, y, sine, cosine in rows
    ]
    return "".join(lines).encode()


def encode_kitti_poses(tracks: Sequence[Track]) -> bytes:
    """Encode the upper three rows of each pose matrix, row by row, a line each, without a time.

    The poses are those of the body (x forward, y left, z up; not a camera) in the map frame, height 0. Source: the
    odometry benchmark's development kit (cvlibs.net/datasets/kitti/eval_odometry.php).
    """
    import numpy as np

    (track,) = tracks
    sine, cosine = np.sin(track.heading_rad), np.cos(track.heading_rad)
    lines = [
        f"{c:.12f} {-s:.12f} 0 {x:.6f} {s:.12f} {c:.12f} 0 {y:.6f} 0 0 1 0\n"
        for s, c, x, y in zip(sine, cosine, track.x_m, track.y_m, strict=True)
    ]
    return "".join(lines).encode()


def encode_gpx_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode each track as a GPX 1.1 `trk` of one segment, without headings and speeds (topografix.com/GPX/1/1)."""
    parts = [GPX_DOCUMENT_START]
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


def encode_kml_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode each track as a KML 2.2 `Placemark`: first all its times, then all its positions.

    Source: OGC 07-147r2, and developers.google.com/kml/documentation/kmlreference (`gx:Track`, Google's extension).
    """
    parts = [KML_DOCUMENT_START]
    for track in tracks:
        parts.append(f"<Placemark><name>{escape(replace_forbidden_xml_characters(track.id))}</name><gx:Track>\n")
        parts += [f"<when>{format_iso_time(stamp_ns)}</when>\n" for stamp_ns in track.stamp_ns.tolist()]
        places = zip(track.longitude_deg, track.latitude_deg, strict=True)
        parts += [f"<gx:coord>{format_degrees(lon)} {format_degrees(lat)} 0</gx:coord>\n" for lon, lat in places]
        parts.append("</gx:Track></Placemark>\n")
    return "".join([*parts, "</Document>\n</kml>\n"]).encode()


def encode_geojson_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode tracks as a GeoJSON `FeatureCollection` (RFC 7946), times and speeds of the points as properties.

    A vehicle with one state is a point, because a line needs two.
    """
    features = [_geojson_feature_of_track(track) for track in tracks]
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False).encode() + b"\n"


def _geojson_feature_of_track(track: Track) -> dict[str, Any]:
    import numpy as np

    places = np.round(np.column_stack([track.longitude_deg, track.latitude_deg]), DEGREE_DECIMALS).tolist()
    is_line = len(places) > 1
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": places}
        if is_line
        else {"type": "Point", "coordinates": places[0]},
        "properties": {
            "id": track.id,
            "times": [format_iso_time(stamp_ns) for stamp_ns in track.stamp_ns.tolist()],
            "speed_mps": [finite_or_none(round(value, 4)) for value in track.speed_mps.tolist()],
        },
    }


def format_degrees(value: float) -> str:
    """Format an angle in degrees with nine decimals."""
    return f"{value:.{DEGREE_DECIMALS}f}"


def format_iso_time(stamp_ns: int) -> str:
    """Format a Unix time in ns as ISO 8601 in UTC with nine decimals."""
    return f"{datetime.fromtimestamp(stamp_ns // 10**9, UTC):%Y-%m-%dT%H:%M:%S}.{stamp_ns % 10**9:09d}Z"


def replace_forbidden_xml_characters(text: str) -> str:
    """Replace each character that an XML document may not hold by the replacement character."""
    return FORBIDDEN_XML_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", text)


def _encode_osi_trace(tracks: Sequence[Track]) -> bytes:
    """Encode tracks as an OSI trace; its module writes logs, which the other formats need not import."""
    from cwcli.export.osi import encode_osi_mcap_trace

    return encode_osi_mcap_trace(tracks)


TRACK_FORMATS = {
    "tum": TrackFormat(
        (".tum",), "TUM trajectory, for evo and SLAM tools", encode_tum_trajectory, holds_one_track=True
    ),
    "kitti": TrackFormat(
        (".kitti", ".txt"), "KITTI poses, for evo; without times", encode_kitti_poses, holds_one_track=True
    ),
    "gpx": TrackFormat((".gpx",), "GPX 1.1, for maps and GNSS tools", encode_gpx_tracks, is_geographic=True),
    "kml": TrackFormat((".kml",), "KML 2.2, for Google Earth", encode_kml_tracks, is_geographic=True),
    "geojson": TrackFormat(
        (".geojson",), "GeoJSON (RFC 7946), for GIS tools", encode_geojson_tracks, is_geographic=True
    ),
    "osi": TrackFormat(
        (".osi.mcap",),
        "ASAM OSI trace, for simulators and their tools",
        _encode_osi_trace,
        is_text=False,
        holds_all_vehicles=True,
    ),
}
"""Name of a format, as `--format` spells it -> its description."""
