"""GeoJSON (RFC 7946): a feature a vehicle, a line string with the times and speeds of its points as properties."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.export.formats.base import Track, TrackFormat
from cwcli.export.text import DEGREE_DECIMALS, format_iso_time
from cwcli.text import finite_or_none


def encode_geojson_tracks(tracks: Sequence[Track]) -> bytes:
    """Encode tracks as a `FeatureCollection`; a vehicle with one state is a point, because a line needs two."""
    features = [_feature_of_track(track) for track in tracks]
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False).encode() + b"\n"


def _feature_of_track(track: Track) -> dict[str, Any]:
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


FORMAT = TrackFormat((".geojson",), "GeoJSON (RFC 7946), for GIS tools", encode_geojson_tracks, is_geographic=True)
"""The description of this format for the table of formats."""
