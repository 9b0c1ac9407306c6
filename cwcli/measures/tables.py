"""Tables of the measures of a log's pairs: each moment, and the most critical values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.evaluate import MeasuredPair
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.signals.columns import Strings, encode_strings, repeat_string


def measure_series_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """The table with one row per moment of a pair, pair by pair."""
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
    ids = {"ego_id": repeat_string(ego_id, len(stamp_ns)), "other_id": other_id}
    return Table("measures", {**ids, "stamp_ns": stamp_ns, **columns}, docs=docs)


def measure_extremes_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """The table with one row per measure of a pair, for the whole time (encounter 0) and for each encounter."""
    rows = [(pair.other_id, extreme) for pair in pairs for extreme in pair.extremes]

    def integer_column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.int64)

    def float_column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.float64)

    return Table(
        "extremes",
        {
            "ego_id": repeat_string(ego_id, len(rows)),
            "other_id": encode_strings([other for other, _ in rows]),
            "encounter": integer_column("encounter"),
            "begin_stamp_ns": integer_column("begin_ns"),
            "end_stamp_ns": integer_column("end_ns"),
            "measure": encode_strings([extreme.measure for _, extreme in rows]),
            "value": float_column("value"),
            "unit": [measures[extreme.measure].unit for _, extreme in rows],
            "stamp_ns": integer_column("stamp_ns"),
            "sigma": float_column("sigma"),
        },
        docs={
            "encounter": ColumnDoc(doc="0: the whole time within 200 m; from 1: encounters within 50 m"),
            "stamp_ns": ColumnDoc(doc="time of the value; -1: it belongs to the whole encounter, or there is none"),
            "sigma": ColumnDoc(doc="standard error of the value, to first order by the states' covariances"),
        },
    )
