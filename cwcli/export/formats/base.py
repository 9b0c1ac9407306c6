"""What a format of tracks is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cwcli.signals.columns import FloatArray, Int64Array


@dataclass(frozen=True)
class Track:
    """Where a vehicle was, n rows in the order of their stamps.

    Attributes:
        id: The vehicle.
        stamp_ns: Shape (n,), Unix time.
        x_m, y_m, heading_rad: Shape (n,): in the map frame; the heading counter-clockwise from east.
        speed_mps: Shape (n,).
        latitude_deg, longitude_deg: Shape (n,), WGS84; NaN where the map has no place on the earth.
        what: What was exported: `ego`, `remote`, ...
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
    """A format.

    Attributes:
        suffixes: How the names of its files may end, in lower case, the usual way first. No two formats share one.
        what: What it is, and who reads it, in one line.
        encode: Tracks -> the content of a file.
        is_of_one: A file holds one track.
        on_globe: It holds latitudes and longitudes.
        is_text: It can be printed.
        is_of_all: It holds the ego and all others together, unless something else is asked for.
    """

    suffixes: tuple[str, ...]
    what: str
    encode: Callable[[Sequence[Track]], bytes]
    is_of_one: bool = False
    on_globe: bool = False
    is_text: bool = True
    is_of_all: bool = False
