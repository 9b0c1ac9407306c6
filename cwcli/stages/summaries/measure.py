"""What `cwcli measure` says: the measures as tables, and the most critical encounters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.evaluate import WHOLE, Extreme, MeasuredPair
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.pipeline.result import Cell, Section
from cwcli.signals.columns import Strings, constant_strings, strings_from
from cwcli.signals.units import NS_PER_S

SHOWN = {
    "gap": "gap [m]",
    "ttc": "TTC [s]",
    "pet": "PET [s]",
    "drac": "DRAC [m/s^2]",
    "thw": "THW [s]",
    "ttr": "TTR [s]",
    "delta-v": "Delta v [m/s]",
}
MAX_SHOWN = 20


def series_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """One row a moment of a pair, pair by pair."""
    lengths = np.array([len(pair.stamp_ns) for pair in pairs], int)
    other_id = Strings(
        np.repeat(np.arange(len(pairs), dtype=np.int32), lengths), tuple(pair.other_id for pair in pairs)
    )
    series = {name: entry for name, entry in measures.items() if entry.is_series}
    columns = {
        entry.column: np.concatenate([np.zeros(0), *(pair.values[name] for pair in pairs)])
        for name, entry in series.items()
    }
    stamp_ns = np.concatenate([np.zeros(0, np.int64), *(pair.stamp_ns for pair in pairs)])
    docs = {entry.column: ColumnDoc(unit=entry.unit, doc=entry.summary) for entry in series.values()}
    ids = {"ego_id": constant_strings(ego_id, len(stamp_ns)), "other_id": other_id}
    return Table("measures", {**ids, "stamp_ns": stamp_ns, **columns}, docs=docs)


def extremes_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """One row a measure of a pair: over the whole time (encounter 0), and of each encounter."""
    rows = [(pair.other_id, extreme) for pair in pairs for extreme in pair.extremes]

    def whole(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.int64)

    def numbers(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.float64)

    return Table(
        "extremes",
        {
            "ego_id": constant_strings(ego_id, len(rows)),
            "other_id": strings_from([other for other, _ in rows]),
            "encounter": whole("encounter"),
            "begin_stamp_ns": whole("begin_ns"),
            "end_stamp_ns": whole("end_ns"),
            "measure": strings_from([extreme.measure for _, extreme in rows]),
            "value": numbers("value"),
            "unit": [measures[extreme.measure].unit for _, extreme in rows],
            "stamp_ns": whole("stamp_ns"),
            "sigma": numbers("sigma"),
        },
        docs={
            "encounter": ColumnDoc(doc="0: the whole time within 200 m; from 1: stretches within 50 m"),
            "stamp_ns": ColumnDoc(doc="when; -1: of the stretch, or none"),
            "sigma": ColumnDoc(doc="of the value, to first order by the states' covariances"),
        },
    )


def encounters_section(pairs: Sequence[MeasuredPair], start_ns: int) -> Section:
    """The most critical encounters, those with the least time to collision first, then the nearest."""
    found = [row for pair in pairs for row in _encounters(pair, start_ns)]
    order = [row for _, row in sorted(found, key=lambda each: each[0])]
    columns = ("vehicle", "from [s]", "to [s]", *SHOWN.values())
    title = "Most critical encounters (within 50 m; times from the log's start)"
    if len(order) > MAX_SHOWN:
        title = f"{MAX_SHOWN} most critical of {len(order)} encounters (within 50 m; times from the log's start)"
    return Section("encounters", title, columns, tuple(order[:MAX_SHOWN]))


def _encounters(pair: MeasuredPair, start_ns: int) -> list[tuple[tuple[float, ...], tuple[Cell, ...]]]:
    """What they are ordered by, and the row."""
    by_number: dict[int, dict[str, Extreme]] = {}
    for extreme in pair.extremes:
        if extreme.encounter != WHOLE:
            by_number.setdefault(extreme.encounter, {})[extreme.measure] = extreme
    rows: list[tuple[tuple[float, ...], tuple[Cell, ...]]] = []
    for extremes in by_number.values():
        first = next(iter(extremes.values()))
        span = ((each - start_ns) / NS_PER_S for each in (first.begin_ns, first.end_ns))
        values = {name: extremes[name].value if name in extremes else math.nan for name in SHOWN}
        order = tuple(math.inf if math.isnan(values[name]) else values[name] for name in ("ttc", "gap"))
        rows.append(((*order, float(first.begin_ns)), (pair.other_id, *span, *values.values())))
    return rows
