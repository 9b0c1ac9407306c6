"""`cwcli.v1.Measures`: how critical the ego and each other vehicle are to each other, moment by moment."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import PAIR_MEASURES
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.signals.columns import OutputChannel

PAIR_KEY_FIELDS = ("stamp_ns", "ego_id", "other_id")
"""Fields that say to which pair and moment a message belongs."""


@cache
def published_measure_names() -> tuple[str, ...]:
    """Names of the measures that the message has fields for; the others are in the metrics table only."""
    names = [field.name for field in find_message_schema(PAIR_MEASURES.schema).descriptor.fields]
    return tuple(name for name in names if name not in PAIR_KEY_FIELDS)


def make_measures_channel(ego: VehicleStates, columns: Mapping[str, Any]) -> OutputChannel:
    """Make the channel of one message per pair and moment; log times are those of the ego's states.

    Args:
        ego: States of the ego, in order of their stamps, each stamp once.
        columns: `ego_id`, `other_id`, `stamp_ns` and the measures, n rows each; what is not computed is NaN.
    """
    stamp_ns = columns["stamp_ns"]
    unknown = np.full(len(stamp_ns), np.nan)
    fields = {name: columns[name] for name in PAIR_KEY_FIELDS}
    fields.update({name: columns.get(name, unknown) for name in published_measure_names()})
    return make_output_channel(PAIR_MEASURES, ego.log_time_ns[np.searchsorted(ego.stamp_ns, stamp_ns)], fields)
