"""Joining and selecting signals of remote vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import Strings, select_table_rows
from cwcli.signals.road_events import join_road_events

_FIELDS_NOT_PER_ROW = {"source", "station", "frame_id", "is_exact", "is_perceived", "events"}
"""The fields of a `RemoteSignal` that are not one value per row."""


def join_remote_signals(signals: Sequence[RemoteSignal]) -> RemoteSignal:
    """Join signals into one in stamp order; a station received on two channels is one vehicle."""
    if len(signals) == 1:
        return signals[0]
    stamp_ns = np.concatenate([s.stamp_ns for s in signals])
    order = np.argsort(stamp_ns, kind="stable")
    names = {name: k for k, name in enumerate(dict.fromkeys(name for s in signals for name in s.station.values))}
    codes = np.concatenate(
        [np.array([names[name] for name in s.station.values], np.int32)[s.station.codes] for s in signals]
    )
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(s, name) for s in signals])[order]
        for name in RemoteSignal.__dataclass_fields__
        if name not in _FIELDS_NOT_PER_ROW and getattr(signals[0], name) is not None
    }
    if any(s.is_perceived is not None for s in signals):
        columns["is_perceived"] = np.concatenate([perceived_rows_mask(s) for s in signals])[order]
    events = [s.events for s in signals if s.events is not None]
    return RemoteSignal(
        events=join_road_events(events) if events else None,
        source=", ".join(dict.fromkeys(s.source for s in signals)),
        station=Strings(codes[order], tuple(names)),
        frame_id=signals[0].frame_id,
        is_exact=all(s.is_exact for s in signals),
        **columns,
    )


def perceived_rows_mask(signal: RemoteSignal) -> npt.NDArray[np.bool_]:
    """Return which rows describe objects that others perceived, shape (n,)."""
    return np.zeros(len(signal.stamp_ns), np.bool_) if signal.is_perceived is None else signal.is_perceived


def select_remote_rows(signal: RemoteSignal, rows: npt.NDArray[np.intp]) -> RemoteSignal:
    """Return some rows of a signal, in the given order."""
    return select_table_rows(signal, rows, shared=("events",))
