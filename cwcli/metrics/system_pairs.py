"""Another system's metrics beside cwcli's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cwcli.metrics.pooling import MetricRow

OTHER_SYSTEM_METRIC_PREFIX = "system."
"""Prefix of another system's metrics; the name of cwcli's own metric follows it."""


class MetricPair(NamedTuple):
    """A metric of another system and cwcli's own, None where cwcli has none; the name is without the prefix."""

    name: str
    other: MetricRow
    own: MetricRow | None


def pair_other_system_metrics_with_own(rows: Mapping[str, MetricRow]) -> list[MetricPair]:
    """Pair each metric of another system with cwcli's own.

    Its state of the ego is compared with cwcli's online state, because neither uses later data.
    """
    found = []
    for name, row in rows.items():
        if name.startswith(OTHER_SYSTEM_METRIC_PREFIX):
            known = name.removeprefix(OTHER_SYSTEM_METRIC_PREFIX)
            own = rows.get(f"ego.online_{known.removeprefix('ego.')}") if known.startswith("ego.") else None
            found.append(MetricPair(known, row, own or rows.get(known)))
    return found
