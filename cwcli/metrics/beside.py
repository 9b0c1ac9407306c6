"""Another system's metrics beside cwcli's own."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.metrics.pooling import MetricRow

SYSTEM = "system."
"""Another system's metrics have the names of cwcli's own behind it."""


def beside(rows: Mapping[str, MetricRow]) -> list[tuple[str, MetricRow, MetricRow | None]]:
    """Name, row and cwcli's own row of each metric of another system.

    Its state of the ego stands beside cwcli's online state: neither knows what comes.
    """
    found = []
    for name, row in rows.items():
        if name.startswith(SYSTEM):
            known = name.removeprefix(SYSTEM)
            own = rows.get(f"ego.online_{known.removeprefix('ego.')}") if known.startswith("ego.") else None
            found.append((known, row, own or rows.get(known)))
    return found
