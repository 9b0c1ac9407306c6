"""Objects that a station perceived (CPM, SDSM), as road users of their own.

An object is named after its sender and its number there, `1201:7`. Its place is the sender's reference position plus an
offset in the plane there; both are uncertain, and so is where the sender thinks it is: their covariances add up. Its
time is the message's reference time plus the object's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cwcli.signals.columns import (
    Columns,
    FloatArray,
    Int64Array,
    Strings,
    absent_strings,
    key_numbers_and_rows_of_first_appearance,
)
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.quality import RowLedger
from cwcli.signals.units import NS_PER_MS
from cwcli.signals.v2x_codec import Objects, RemoteRows, Senders, V2xCodec, empty_remote_rows, make_remote_rows
from cwcli.signals.v2x_elements import decode_identifier_codes, read_station_ids
from cwcli.signals.v2x_tables import Element

WGS84_EQUATOR_RADIUS_M = 6_378_137.0
"""The radius of the WGS84 ellipsoid at the equator, in metres."""
WGS84_FLATTENING = 1.0 / 298.257223563
"""The flattening (1) of the WGS84 ellipsoid."""
OBJECT_ID_ELEMENT = Element("ObjectId", 1.0, 1, 0, 65_535)
"""The data element of an object's id, in CPM and SDSM alike."""


def identify_objects_as_senders(columns: Columns) -> Senders:
    """Return the senders of objects: each is named after its sender and its number, columns `station` and `object`."""
    n = len(columns)
    sender = read_station_ids(columns, "station")
    number = decode_identifier_codes(OBJECT_ID_ELEMENT, read_numbers(columns, "object"))
    names = (*sender.values, "unknown")
    numbered = np.flatnonzero(np.isfinite(number))
    key = sender.codes[numbered] * (OBJECT_ID_ELEMENT.high + 1) + number[numbered].astype(np.int64)
    object_codes, first = key_numbers_and_rows_of_first_appearance(key)
    codes = np.full(n, -1, np.int32)
    codes[numbered] = object_codes
    codes_and_numbers = zip(sender.codes[numbered[first]].tolist(), number[numbered[first]].tolist(), strict=True)
    stations = Strings(codes, tuple(f"{names[code]}:{int(k)}" for code, k in codes_and_numbers)).merge_equal_values()
    return Senders(stations, np.zeros(n, np.bool_), np.zeros(n, np.bool_))


def make_object_codec(decode: Callable[[Columns, RowLedger], RemoteRows]) -> V2xCodec:
    """Return the codec of objects, one a row; objects without an id are set aside, because they can't be tracked."""

    def decode_numbered(columns: Columns, ledger: RowLedger) -> RemoteRows:
        read_station_ids(columns, "station", ledger=ledger)
        ledger.set_aside(
            ~np.isfinite(decode_identifier_codes(OBJECT_ID_ELEMENT, read_numbers(columns, "object"), ledger)),
            "object without an id",
        )
        return decode(columns, ledger)

    return V2xCodec(identify_objects_as_senders, decode_numbered)


def shift_wgs84_positions(
    latitude_deg: FloatArray, longitude_deg: FloatArray, east_m: FloatArray, north_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return latitude and longitude (deg) of points (n,) that lie some way off others, in the tangent plane there.

    By the ellipsoid's radii of curvature, and the first term by which the plane leaves the ellipsoid: right to 1 cm at
    3 km, below 75 degrees of latitude.
    """
    latitude = np.deg2rad(latitude_deg)
    e2 = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
    w = 1.0 - e2 * np.sin(latitude) ** 2
    across_m = WGS84_EQUATOR_RADIUS_M / np.sqrt(w)  # N, of the prime vertical
    along_m = WGS84_EQUATOR_RADIUS_M * (1.0 - e2) / w**1.5  # M, of the meridian
    with np.errstate(divide="ignore", invalid="ignore"):
        d_north = north_m / along_m - east_m**2 * np.tan(latitude) / (2.0 * along_m * across_m)
        d_east = east_m / (across_m * np.cos(latitude)) * (1.0 + north_m * np.tan(latitude) / along_m)
    longitude = longitude_deg + np.rad2deg(d_east)
    is_beyond = (longitude < -180.0) | (longitude >= 180.0)
    return latitude_deg + np.rad2deg(d_north), np.where(is_beyond, (longitude + 180.0) % 360.0 - 180.0, longitude)


def add_position_covariances(sender_m2: FloatArray, offset_m2: FloatArray) -> FloatArray:
    """Add the covariances (n, 3) of reference position and offset; NaN where the offset's is not given.

    A sender whose own position has no covariance counts with that of the offset alone.
    """
    return offset_m2 + np.where(np.isnan(sender_m2), 0.0, sender_m2)


def make_object_rows(
    ledger: RowLedger, stamp_ns: Int64Array, values_by_name: Mapping[str, FloatArray], **quantities: FloatArray
) -> RemoteRows:
    """Build the rows of objects (m,), as `make_remote_rows`.

    Args:
        ledger: The objects' ledger; an object without its own time gets its message's, which is counted.
        stamp_ns: Shape (m,): the messages' reference times.
        values_by_name: Decoded values; `delta_time_ms` is the time from there to the objects' own.
    """
    delta_time_ms = values_by_name["delta_time_ms"]
    ledger.count_repaired(np.isnan(delta_time_ms), "no measurement time, message time used")
    own_ns = stamp_ns + np.rint(np.nan_to_num(delta_time_ms) * NS_PER_MS).astype(np.int64)
    return make_remote_rows(own_ns, values_by_name, **quantities)


def unknown_senders(columns: Columns) -> Senders:
    """Return unknown senders, for messages that do not describe their senders."""
    n = len(columns)
    return Senders(absent_strings(n), np.zeros(n, np.bool_), np.zeros(n, np.bool_))


def make_objects_only_codec(name: str, find: Callable[[Columns], Objects]) -> V2xCodec:
    """Return the codec of a channel whose messages describe only other objects."""

    def set_messages_aside(columns: Columns, ledger: RowLedger) -> RemoteRows:
        ledger.set_aside(np.ones(len(columns), np.bool_), f"{name} (objects counted separately)")
        return empty_remote_rows(len(columns))

    return V2xCodec(unknown_senders, set_messages_aside, find)
