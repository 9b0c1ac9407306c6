"""Channels as Arrow tables for Python programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cwcli.errors import MissingSignalError
from cwcli.fleet.channel_tables import make_channel_table
from cwcli.metrics.table import to_arrow_table
from cwcli.signals.columns import Columns, Field, OutputChannel, Ragged

if TYPE_CHECKING:
    import pyarrow as pa

    from cwcli.channels.published import Channel
    from cwcli.evaluation.doubts.base import Doubt
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.call import Selection

DOUBT_COLUMNS = ("name", "sentence", "advice", "value", "threshold", "unit")
"""Columns of the table of doubts: the attributes of a `Doubt`."""
TIME_COLUMN_SUFFIX = "_ns"
"""Ending of the names of columns with times in ns; messages hold them as uint64, tables as int64."""


def arrow_table_of_topic(log: Log, topic: str, selection: Selection) -> pa.Table:
    """Read a channel as an Arrow table, one row a message logged in the selected span.

    Raises:
        MissingSignalError: There is no such channel.
        InputError: It can't be decoded, or the log is damaged.
    """
    return _arrow_table(log.columns(topic).slice_by_log_time(selection.start_ns, selection.end_ns))


def arrow_table_of_result(log: Log, channel: Channel, selection: Selection, *, may_be_empty: bool) -> pa.Table:
    """Read a channel that cwcli publishes as an Arrow table.

    Args:
        log: The log with the results of its stages.
        may_be_empty: Return a table without rows where the log has no such channel.

    Raises:
        MissingSignalError: There is no such channel, and it may not be empty.
    """
    if channel.topic in {each.topic for each in log.channels}:
        return arrow_table_of_topic(log, channel.topic, selection)
    if not may_be_empty:
        raise MissingSignalError(
            f"there is no channel {channel.topic} ({channel.what})",
            where=log.name,
            hint=f'run its stage: log.run("{channel.stage}")',
        )
    from cwcli.logs.read.added_channels import columns_of_added_channel

    nothing = OutputChannel(channel.topic, channel.schema, np.zeros(0, np.int64))
    return _arrow_table(columns_of_added_channel(nothing, None))


def arrow_table_of_doubts(doubts: Sequence[Doubt]) -> pa.Table:
    """Convert doubts to an Arrow table, one row a doubt, in their order."""
    import pyarrow as pa

    types = {name: pa.float64() if name in ("value", "threshold") else pa.string() for name in DOUBT_COLUMNS}
    return pa.table(
        {name: pa.array([getattr(doubt, name) for doubt in doubts], type=types[name]) for name in DOUBT_COLUMNS}
    )


def _arrow_table(columns: Columns) -> pa.Table:
    """Convert columns to Arrow: times as int64, and lists behind single values, whether read from a file or not."""
    names = sorted(columns.fields, key=lambda name: _has_several_values_per_row(columns.fields[name]))
    fields = {name: _as_int64_if_times(name, columns.fields[name]) for name in names}
    return to_arrow_table(make_channel_table(columns.topic, replace(columns, fields=fields)))


def _has_several_values_per_row(values: Field) -> bool:
    """Whether each row holds several values."""
    return isinstance(values, Ragged) or (isinstance(values, np.ndarray) and values.ndim > 1)


def _as_int64_if_times(name: str, values: Field) -> Field:
    """Return times as int64, which they fit until the year 2262; other columns as they are."""
    if name.endswith(TIME_COLUMN_SUFFIX) and isinstance(values, np.ndarray) and values.dtype == np.uint64:
        return values.astype(np.int64)
    return values
