"""Columns as one of the published channels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.channels.published import Channel
from cwcli.signals.columns import Field, Int64Array, OutputChannel, Strings


def output(channel: Channel, log_time_ns: Int64Array, fields: Mapping[str, Field]) -> OutputChannel:
    """The channel with its rows in log-time order (stable).

    Args:
        channel: Where they are published, and as what.
        log_time_ns: Shape (n,).
        fields: Field path -> n rows, none of them ragged.

    Raises:
        TypeError: A ragged column would have to be reordered.
    """
    order = np.argsort(log_time_ns, kind="stable")
    if not np.array_equal(order, np.arange(len(order))):
        log_time_ns, fields = log_time_ns[order], {name: _rows(each, order) for name, each in fields.items()}
    return OutputChannel(channel.topic, channel.schema, log_time_ns, fields)


def _rows(values: Field, order: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Field:
    if isinstance(values, Strings):
        return values.rows(order)
    if isinstance(values, np.ndarray):
        return values[order]
    raise TypeError("a ragged column can't be reordered here")
