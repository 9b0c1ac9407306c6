"""`cwcli.v1.Rejected`: the measurements that the estimator's gate rejected."""

from __future__ import annotations

import numpy as np

from cwcli.channels.output import output
from cwcli.channels.published import REJECTED
from cwcli.estimation.result import Gated
from cwcli.metrics.table import Table
from cwcli.signals.columns import Columns, Field, OutputChannel, constant_strings
from cwcli.signals.leaf_fields import numbers, texts, whole_numbers

GATED = "gated"
"""Published reason of a measurement that the gate rejected."""


def write_rejected(gated: Gated) -> OutputChannel:
    """Make the channel of one message a gated measurement; its log time is its stamp."""
    return output(REJECTED, gated.stamp_ns, _fields(gated))


def rejected_table(gated: Gated) -> Table:
    """Make a table of the gated measurements."""
    return Table("rejected", _fields(gated))


def _fields(gated: Gated) -> dict[str, Field]:
    return {
        "stamp_ns": gated.stamp_ns,
        "topic": gated.topic,
        "quantity": gated.quantity,
        "reason": constant_strings(GATED, len(gated)),
        "nis": gated.nis,
        "bound": gated.bound,
    }


def read_rejected(columns: Columns) -> Gated:
    """Read the gated measurements of a channel, in log-time order.

    Raises:
        DataError: A field is missing: another version wrote them.
    """
    reason = texts(columns, "reason", required=True)
    is_gated = np.array([*(value == GATED for value in reason.values), False])  # the code -1 is the last
    rows = np.flatnonzero(is_gated[reason.codes])
    return Gated(
        whole_numbers(columns, "stamp_ns", required=True)[0][rows],
        texts(columns, "topic", required=True).rows(rows),
        texts(columns, "quantity", required=True).rows(rows),
        numbers(columns, "nis", required=True)[rows],
        numbers(columns, "bound", required=True)[rows],
    )
