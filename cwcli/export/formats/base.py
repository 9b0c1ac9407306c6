"""Data classes of tracks and of their file formats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array


@dataclass(frozen=True)
class Track:
    """States of one vehicle over time, n rows in the order of their stamps.

    Attributes:
        id: Id of the vehicle.
        stamp_ns: Shape (n,), Unix time.
        x_m, y_m, heading_rad: Shape (n,): in the map frame; the heading counter-clockwise from east.
        speed_mps: Shape (n,).
        latitude_deg, longitude_deg: Shape (n,), WGS84; NaN where the map has no geographic origin.
        what: The exported content: `ego`, `remote`, ...
        accel_mps2, yaw_rate_radps: Shape (n,), or None.
        size_m: Length and width, NaN where unknown.
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
    size_m: tuple[float, float] = (math.nan, math.nan)


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
