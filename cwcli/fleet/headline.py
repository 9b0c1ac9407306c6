"""The headline metrics of one log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cwcli.metrics.table import Table

if TYPE_CHECKING:
    from cwcli.logs.log import Log


def headline_metrics(log: Log, tables: Mapping[str, Table]) -> Table:
    """One row per metric: stage, metric, value, unit, n, low, high.

    Args:
        log: With the channels of the stages that ran.
        tables: Their tables, by name.
    """
    try:
        from cwcli.stages.evaluate import evaluate_log
    except ImportError:
        none = np.empty(0)
        return Table(
            "metrics",
            {
                "stage": [],
                "metric": [],
                "value": none,
                "unit": [],
                "n": np.empty(0, np.int64),
                "low": none,
                "high": none,
            },
        )
    table: Table = evaluate_log(log, tables=tables)
    return table
