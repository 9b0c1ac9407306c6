"""`cwcli.v1.Rejected`: the measurements that the estimator's gate rejected."""

from __future__ import annotations

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import REJECTED
from cwcli.estimation.result import GatedMeasurements
from cwcli.metrics.table import Table
from cwcli.signals.columns import Columns, Field, OutputChannel, repeat_string
from cwcli.signals.leaf_fields import read_integers, read_numbers, read_texts

GATED_REASON = "gated"
"""Published reason of a measurement that the gate rejected."""


def make_rejected_measurement_channel(gated: GatedMeasurements) -> OutputChannel:
    """Make the channel of one message a gated measurement; its log time is its stamp."""
    return make_output_channel(REJECTED, gated.stamp_ns, _rejected_fields(gated))


def table_of_rejected_measurements(gated: GatedMeasurements) -> Table:
    """Make a table of the gated measurements."""
    return Table("rejected", _rejected_fields(gated))


def _rejected_fields(gated: GatedMeasurements) -> dict[str, Field]:
    return {
        "stamp_ns": gated.stamp_ns,
        "topic": gated.topic,
        "quantity": gated.quantity,
        "reason": repeat_string(GATED_REASON, len(gated)),
        "nis": gated.nis,
        "bound": gated.bound,
    }


def read_gated_measurements(columns: Columns) -> GatedMeasurements:
    """Read the gated measurements of a channel, in log-time order.

    Raises:
        DataError: A field is missing: another version wrote them.
    """
    reason = read_texts(columns, "reason", required=True)
    is_gated = np.array([*(value == GATED_REASON for value in reason.values), False])  # the code -1 is the last
    rows = np.flatnonzero(is_gated[reason.codes])
    return GatedMeasurements(
        read_integers(columns, "stamp_ns", required=True)[0][rows],
        read_texts(columns, "topic", required=True).select_rows(rows),
        read_texts(columns, "quantity", required=True).select_rows(rows),
        read_numbers(columns, "nis", required=True)[rows],
        read_numbers(columns, "bound", required=True)[rows],
    )
