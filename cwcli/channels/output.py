"""Makes published channels from columns, and thins rows to a rate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.channels.published import Channel
from cwcli.signals.columns import Field, Int64Array, NumericArray, OutputChannel, Strings
from cwcli.signals.units import NS_PER_S


def make_output_channel(channel: Channel, log_time_ns: Int64Array, fields: Mapping[str, Field]) -> OutputChannel:
    """Make a channel from columns, sorted by log time (stable).

    Args:
        channel: Topic and schema of the messages.
        log_time_ns: Shape (n,).
        fields: Field path -> n rows, none of them ragged.

    Raises:
        TypeError: A ragged column would have to be reordered.
    """
    order = np.argsort(log_time_ns, kind="stable")
    if not np.array_equal(order, np.arange(len(order))):
        log_time_ns, fields = log_time_ns[order], {name: _reorder_rows(each, order) for name, each in fields.items()}
    return OutputChannel(channel.topic, channel.schema, log_time_ns, fields)


def _reorder_rows(values: Field, order: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Field:
    if isinstance(values, Strings):
        return values.select_rows(order)
    if isinstance(values, np.ndarray):
        return values[order]
    raise TypeError("a ragged column can't be reordered here")


def first_rows_of_each_vehicle_and_period(codes: NumericArray, stamp_ns: Int64Array, rate_hz: float) -> Int64Array:
    """Select the first row of each vehicle in each period of a clock; the row numbers increase.

    Args:
        codes, stamp_ns: Shape (n,): vehicle and time of each row.
        rate_hz: Rate of the clock, whose first tick is at time 0.
    """
    period = stamp_ns // max(round(NS_PER_S / rate_hz), 1)
    order = np.lexsort((period, codes))
    is_first = (np.diff(period[order]) != 0) | (np.diff(codes[order]) != 0)
    return np.sort(order[np.concatenate([[True], is_first])[: len(order)]])
