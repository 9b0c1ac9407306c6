"""The interface of a V2X codec: it returns one row a message, in SI units and cwcli's signs, before clocks are
repaired."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.canonical import RemoteQuantities
from cwcli.signals.columns import BoolArray, Columns, FloatArray, Int64Array, Strings
from cwcli.signals.quality import RowLedger
from cwcli.signals.road_events import RoadEvents, empty_road_events

EGO_STATION_NOTE_BEGINNING = "the car is V2X station"
"""Begins the note on which station is the ego, and why."""
OTHER_STATION_REASON = "sent by another station"
"""The reason for setting aside a message that another station than the ego sent."""


@dataclass(frozen=True)
class Senders:
    """The senders of a channel's messages; every array has n rows.

    Attributes:
        station: Station id as text; code -1 where there is none.
        is_own: The message says that it was sent by the vehicle that recorded the log.
        is_roadside: The sender is a roadside unit.
    """

    station: Strings
    is_own: BoolArray
    is_roadside: BoolArray


@dataclass(frozen=True)
class RemoteRows(RemoteQuantities):
    """Decoded messages of one channel.

    Attributes:
        stamp_ns: Shape (n,): generation time, or log time where the message has none.
    """

    stamp_ns: Int64Array


def make_remote_rows(
    stamp_ns: Int64Array, values_by_name: Mapping[str, FloatArray], **quantities: FloatArray
) -> RemoteRows:
    """Return rows with the given quantities, NaN for others.

    Args:
        stamp_ns: Shape (n,): generation times.
        values_by_name: Decoded values, (n,) each: those that are named like a field of `RemoteQuantities` are taken.
        quantities: Fields of `RemoteQuantities`, which count before `values_by_name`.
    """
    n = len(stamp_ns)
    known = {**values_by_name, "position_covariance_m2": np.full((n, 3), np.nan), **quantities}
    names = [entry.name for entry in fields(RemoteQuantities)]
    return RemoteRows(
        **{name: known[name] if name in known else np.full(n, np.nan) for name in names}, stamp_ns=stamp_ns
    )


def empty_remote_rows(n: int) -> RemoteRows:
    """Return rows (n,) in which no quantity is known and all stamps are 0."""
    return make_remote_rows(np.zeros(n, np.int64), {})


@dataclass(frozen=True)
class V2xCodec:
    """The functions that read a V2X channel.

    Attributes:
        identify: Who sent each message; asked first, so that faults are counted for the messages in use only.
        decode: The quantities.
        objects: The objects that the senders report: columns with one row an object, and their codec.
        events: The events that they notify, and which messages (n,) have event data that can't be read.
    """

    identify: Callable[[Columns], Senders]
    decode: Callable[[Columns, RowLedger], RemoteRows]
    objects: Callable[[Columns], Objects] = lambda columns: ()
    events: Callable[[Columns], tuple[RoadEvents, BoolArray]] = lambda columns: (
        empty_road_events(),
        np.zeros(len(columns), np.bool_),
    )


Objects = tuple[tuple[Columns, V2xCodec], ...]
