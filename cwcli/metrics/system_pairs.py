"""Another system's metrics beside cwcli's own."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.metrics.pooling import MetricRow

SYSTEM_PREFIX = "system."
"""Another system's metrics have the names of cwcli's own behind it."""


def pair_with_own(rows: Mapping[str, MetricRow]) -> list[tuple[str, MetricRow, MetricRow | None]]:
    """Name, row and cwcli's own row of each metric of another system.

    Its state of the ego stands beside cwcli's online state: neither knows what comes.
    """
    found = []
    for name, row in rows.items():
        if name.startswith(SYSTEM_PREFIX):
            known = name.removeprefix(SYSTEM_PREFIX)
            own = rows.get(f"ego.online_{known.removeprefix('ego.')}") if known.startswith("ego.") else None
            found.append((known, row, own or rows.get(known)))
    return found
