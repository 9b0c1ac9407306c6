"""Events that stations notify besides their motion: the flags of BSMs, and DENMs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import (
    FloatArray,
    Int64Array,
    Strings,
    encode_strings,
    key_numbers_and_rows_of_first_appearance,
    select_table_rows,
)
from cwcli.signals.units import NS_PER_S

HARD_BRAKING_KIND = "hard braking"
"""The kind of an event whose sender reports that it brakes hard; warning rules use it."""
MAX_HARD_BRAKING_AGE_NS = 5 * NS_PER_S
"""The time after its stamp for which a report of hard braking is believed, in ns. Chosen: at 0.4 g a car loses 20 m/s
within 5 s, and one that brakes on reports it again; a DENM's usual validity (600 s) is meant for obstacles."""


@dataclass(frozen=True)
class RoadEvents:
    """Events that stations notified, one row per event, by stamp.

    Attributes:
        station: The station that notifies it.
        kind: The kind of event, as text.
        stamp_ns, log_time_ns: Shape (n,): when the message was made, and received.
        until_ns: Shape (n,): how long it holds; a BSM's flag for its own moment, a cancelled event till its stamp, one
            that a later message takes the place of till that was received.
        cause, sub_cause: Shape (n,): CauseCodeType and sub-cause of a DENM, NaN of a flag.
        latitude_deg, longitude_deg: Shape (n,): the place; NaN where not given.
        relevance_m: Shape (n,): the distance within which it matters; NaN where not given.
    """

    station: Strings
    kind: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    until_ns: Int64Array
    cause: FloatArray
    sub_cause: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    relevance_m: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def select_rows(self, rows: npt.NDArray[np.intp]) -> RoadEvents:
        """Return some of the events, in the given order."""
        return select_table_rows(self, rows)


def empty_road_events() -> RoadEvents:
    """Return a table without events."""
    times, nothing = np.zeros(0, np.int64), np.zeros(0)
    return RoadEvents(encode_strings([]), encode_strings([]), times, times, times, *(nothing,) * 5)


def join_road_events(parts: Sequence[RoadEvents]) -> RoadEvents:
    """Join several tables into one, by stamp."""
    if not parts:
        return empty_road_events()
    columns: dict[str, Any] = {}
    for name in (entry.name for entry in fields(RoadEvents)):
        values = [getattr(part, name) for part in parts]
        columns[name] = _join_strings(values) if isinstance(values[0], Strings) else np.concatenate(values)
    whole = RoadEvents(**columns)
    return whole.select_rows(np.argsort(whole.stamp_ns, kind="stable"))


def _join_strings(parts: Sequence[Strings]) -> Strings:
    """Join texts of several tables; the values are those in use, in order of first appearance."""
    index: dict[str, int] = {}
    codes = []
    for part in parts:
        code_of = [index.setdefault(value, len(index)) if value else -1 for value in part.values]
        codes.append(np.array([*code_of, -1], np.int32)[part.codes])
    joined_codes, names = np.concatenate(codes), tuple(index)
    used = np.flatnonzero(joined_codes >= 0)
    number, first = key_numbers_and_rows_of_first_appearance(joined_codes[used])
    values = tuple(names[code] for code in joined_codes[used[first]].tolist())
    joined_codes[used] = number
    return Strings(joined_codes, values)


def hard_braking_known_mask_or_none(
    events: RoadEvents, station: str, stamp_ns: Int64Array, log_time_ns: Int64Array
) -> npt.NDArray[np.bool_] | None:
    """Return at which states (m,) a station had reported that it brakes hard, as far as was known; None where it never
    does.

    Args:
        stamp_ns, log_time_ns: Shape (m,): of its states, and when each was known.
    """
    if station not in events.station.values or HARD_BRAKING_KIND not in events.kind.values:
        return None
    is_own = events.station.codes == events.station.values.index(station)
    rows = np.flatnonzero(is_own & (events.kind.codes == events.kind.values.index(HARD_BRAKING_KIND)))
    if not len(rows):
        return None
    says = np.zeros(len(stamp_ns), np.bool_)
    for row in rows:
        begin_ns = events.stamp_ns[row]
        until_ns = min(events.until_ns[row], begin_ns + MAX_HARD_BRAKING_AGE_NS)
        if np.isfinite(events.cause[row]) and until_ns <= begin_ns:
            continue  # a DENM that takes another back
        first, last = np.searchsorted(stamp_ns, [begin_ns, until_ns + 1])
        says[first:last] |= log_time_ns[first:last] >= events.log_time_ns[row]
    return says
