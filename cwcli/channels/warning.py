"""`/cwcli/warnings`, what one or several rules say of a log, and in words `/cwcli/log`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cwcli.channels.published import WARNING_LOG, WARNINGS
from cwcli.signals.columns import Field, Int64Array, OutputChannel, Strings, constant_strings
from cwcli.warning.output import HELD, RAISED

LEVEL_INFO, LEVEL_WARNING = 2, 3  # foxglove.Log

Warnings = tuple[Int64Array, Mapping[str, Field]]
"""Log times (w,), non-decreasing, and columns of `cwcli.v1.Warning`."""


def warning_channels(parts: Sequence[Warnings]) -> tuple[OutputChannel, OutputChannel]:
    """`/cwcli/warnings`, and in words `/cwcli/log`, of the warnings of one or several rules."""
    log_time_ns = np.concatenate([times for times, _ in parts])
    order = np.argsort(log_time_ns, kind="stable")
    fields = {name: _joined([columns[name] for _, columns in parts], order) for name in parts[0][1]}
    return OutputChannel(WARNINGS.topic, "cwcli.v1.Warning", log_time_ns[order], fields), _log_channel(
        log_time_ns[order], fields
    )


def _joined(parts: Sequence[Field], order: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Field:
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.asarray(np.concatenate([np.asarray(part) for part in parts]))[order]
    codes: dict[str, int] = {}
    found: list[Any] = []
    for part in parts:
        assert isinstance(part, Strings)
        renamed = np.array([codes.setdefault(value, len(codes)) for value in part.values], dtype=np.int32)
        found.append(renamed[part.codes] if len(part) else np.zeros(0, np.int32))
    return Strings(np.concatenate(found)[order].astype(np.int32), tuple(codes))


def _log_channel(log_time_ns: Int64Array, fields: Mapping[str, Field]) -> OutputChannel:
    """The warnings as `foxglove.Log`, for the viewer's log panel."""
    state = np.asarray(fields["state"])
    messages = fields["message"]
    assert isinstance(messages, Strings)
    rows = np.flatnonzero(state != HELD)  # a held warning says nothing new
    return OutputChannel(
        WARNING_LOG.topic,
        "foxglove.Log",
        log_time_ns[rows],
        {
            "timestamp": np.asarray(fields["stamp_ns"])[rows],
            "level": np.where(state[rows] == RAISED, LEVEL_WARNING, LEVEL_INFO),
            "message": Strings(messages.codes[rows], messages.values),
            "name": constant_strings("cwcli.warn", len(rows)),
        },
    )
