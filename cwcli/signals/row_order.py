"""Ordering the rows of a channel by vehicle and by time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import Int64Array, Strings

Rows = npt.NDArray[np.intp]


def iter_rows_by_id(ids: Strings) -> Iterator[tuple[str, Rows]]:
    """Yield each id and the indices of its rows, in order of first appearance."""
    if not len(ids):
        return
    order = np.argsort(ids.codes, kind="stable")
    codes, starts = np.unique(ids.codes[order], return_index=True)
    for code, rows in zip(codes, np.split(order, starts[1:]), strict=True):
        yield ids.values[code], rows


def rows_by_stamp_without_repeats(stamp_ns: Int64Array, rows: Rows | None = None) -> Rows:
    """Return all rows, or those given, in the order of their stamps, only the first of each stamp."""
    chosen = np.arange(len(stamp_ns)) if rows is None else rows
    ordered = chosen[np.argsort(stamp_ns[chosen], kind="stable")]
    return ordered[np.concatenate(([True], np.diff(stamp_ns[ordered]) > 0))] if len(ordered) else ordered


def iter_track_rows(ids: Strings, stamp_ns: Int64Array) -> Iterator[tuple[str, Rows]]:
    """Yield each id and the indices of its rows, in the order of their stamps, only the first of each stamp."""
    for name, rows in iter_rows_by_id(ids):
        yield name, rows_by_stamp_without_repeats(stamp_ns, rows)


def first_and_last_rows_of_runs(holds: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last row of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    return [(int(first), int(stop) - 1) for first, stop in zip(edges[::2], edges[1::2], strict=True)]
