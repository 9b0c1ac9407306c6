"""Headline metrics of several logs, and of all of them together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import (
    COLUMNS_MISSING_IN_EARLIER_VERSIONS,
    METRICS_TABLE_COLUMNS,
    HeadlineCollector,
    find_metric,
    metric_interval_from_sums,
    metric_sort_index,
    metric_value_from_sums,
)
from cwcli.metrics.intervals import UNKNOWN_INTERVAL
from cwcli.metrics.table import Table
from cwcli.signals.columns import FloatArray

UInt16Array = npt.NDArray[np.uint16]

MIN_LOGS_FOR_BOOTSTRAP = 5
"""Least number of logs over which a bootstrap interval is computed; chosen by hand."""
N_BOOTSTRAP_RESAMPLES = 2000
"""Number of bootstrap resamples over the logs; chosen by hand."""
MAX_DRAWN_LOG_COUNTS_IN_MEMORY = 4_000_000
"""Number of counts of drawn logs that are held as floating-point numbers at a time. Chosen by hand: 32 MB."""
LOG_ID_OF_ALL_LOGS_POOLED = "(pooled)"
"""The id that stands for all logs together in the column `log`."""
DATA_METRIC_PREFIX = "data."
"""Beginning of the names of metrics of the recorded data; all others measure results of stages."""


@dataclass(frozen=True)
class MetricRow:
    """One metric of one log, or of several; the columns of the table `metrics`."""

    stage: str
    metric: str
    value: float
    unit: str
    n: int
    low: float
    high: float
    pool: str
    total: float
    weight: float
    states: str = ""


@dataclass(frozen=True)
class LogMetrics:
    """The metrics of one log of a run.

    Attributes:
        id: Its name in the run, unique.
        rows: Metric -> its row.
        error: Why the log failed and has no metrics; "" if it did not fail.
        sha256: Hash of the input, "" where it is not known.
        notes: Notes for the user on its metrics.
        source: File of the recorded log, "" where it is not known.
        run_s: Seconds that the run took for it, 0 where they are not known.
    """

    id: str
    rows: Mapping[str, MetricRow] = field(default_factory=dict)
    error: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()
    source: str = ""
    run_s: float = 0.0

    def metric_value(self, name: str) -> float:
        """Return the value of a metric; NaN where there is none."""
        row = self.rows.get(name)
        return math.nan if row is None else row.value


def metric_rows_by_name(table: Table) -> dict[str, MetricRow]:
    """Return the rows of a table `metrics` by metric.

    Raises:
        ValueError: A column is missing.
    """
    missing = [
        name
        for name in METRICS_TABLE_COLUMNS
        if name not in table.columns and name not in COLUMNS_MISSING_IN_EARLIER_VERSIONS
    ]
    if missing:
        raise ValueError(f"the column {missing[0]} is missing")
    return {
        row["metric"]: MetricRow(
            str(row["stage"]),
            str(row["metric"]),
            float(row["value"]),
            str(row["unit"]),
            int(row["n"]),
            float(row["low"]),
            float(row["high"]),
            str(row["pool"]),
            float(row["total"]),
            float(row["weight"]),
            str(row.get("states", "")),
        )
        for row in table.rows_as_dicts()
    }


def notes_from_metadata(table: Table) -> tuple[str, ...]:
    """Return the notes in a table's metadata."""
    return tuple(table.metadata.get("notes", "").splitlines())


def metric_names(logs: Iterable[LogMetrics]) -> list[str]:
    """Return every metric that some log has, in the order of `cwcli.metrics.headline.METRICS`."""
    return sorted(dict.fromkeys(name for log in logs for name in log.rows), key=metric_sort_index)


def pool_metric(rows: Sequence[MetricRow], *, seed: int = 0) -> MetricRow:
    """Pool one metric over several logs.

    The sums add up (see `cwcli.metrics.headline`), so a log counts by its number of samples, a rate by its hours. The
    interval is Wilson's or Poisson's of the sums where the metric has one; else a percentile bootstrap over the logs,
    with at least 5 logs.

    Args:
        rows: Rows of the same metric, at least one.
        seed: Seed of the bootstrap.
    """
    first = rows[0]
    weighted_rows = _rows_with_weight(rows)
    total, weight = _weighted_sum_and_total_weight(weighted_rows, first.pool)
    value = metric_value_from_sums(first.pool, total, weight)
    metric = find_metric(first.metric)
    kind = metric.interval if metric is not None else ""
    low, high = (
        metric_interval_from_sums(kind, total, weight)
        if kind
        else _bootstrap_interval_over_logs(first.pool, weighted_rows, seed)
    )
    n = sum(row.n for row in rows)
    states = " or ".join(sorted({row.states for row in rows}))
    return MetricRow(first.stage, first.metric, value, first.unit, n, low, high, first.pool, total, weight, states)


def pool_metric_value(rows: Sequence[MetricRow]) -> float:
    """Return the pooled value of a metric without its interval; NaN without rows."""
    return (
        metric_value_from_sums(rows[0].pool, *_weighted_sum_and_total_weight(_rows_with_weight(rows), rows[0].pool))
        if rows
        else math.nan
    )


def pool_all_metrics(logs: Sequence[LogMetrics], *, seed: int = 0) -> dict[str, MetricRow]:
    """Pool every metric over the logs that have it."""
    return {
        name: pool_metric([log.rows[name] for log in logs if name in log.rows], seed=seed)
        for name in metric_names(logs)
    }


def _rows_with_weight(rows: Sequence[MetricRow]) -> list[MetricRow]:
    """Return the rows with a positive weight and a finite total: the others judge nothing."""
    return [row for row in rows if row.weight > 0.0 and math.isfinite(row.total)]


def _weighted_sum_and_total_weight(rows: Sequence[MetricRow], pool: str) -> tuple[float, float]:
    """Return total and weight of several rows; of an extreme the weight is 1."""
    if not rows:
        return math.nan, 0.0
    totals = [row.total for row in rows]
    if pool in {"max", "min"}:
        return (max if pool == "max" else min)(totals), 1.0
    return math.fsum(totals), math.fsum(row.weight for row in rows)


def _bootstrap_interval_over_logs(pool: str, rows: Sequence[MetricRow], seed: int) -> tuple[float, float]:
    """Return the 95 % percentile interval of a pooled root mean square or mean, by resampling the logs."""
    if pool not in {"rms", "mean"} or len(rows) < MIN_LOGS_FOR_BOOTSTRAP:
        return UNKNOWN_INTERVAL
    drawn = bootstrap_draw_counts(len(rows), seed)
    totals = resampled_sums(drawn, np.array([row.total for row in rows]))
    weights = resampled_sums(drawn, np.array([row.weight for row in rows]))
    values = totals / weights
    if pool == "rms":
        values = np.sqrt(np.maximum(values, 0.0))
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


@lru_cache(maxsize=2)
def bootstrap_draw_counts(n: int, seed: int) -> UInt16Array:
    """Return how often each of n logs is drawn in each bootstrap resample, shape (N_RESAMPLES, n)."""
    rng = np.random.default_rng(seed)
    counts = np.empty((N_BOOTSTRAP_RESAMPLES, n), np.uint16)
    for rows in _iter_resample_slices(n):
        counts[rows] = rng.multinomial(n, np.full(n, 1.0 / n), size=rows.stop - rows.start)
    return counts


def resampled_sums(draw_counts: UInt16Array, values: FloatArray) -> FloatArray:
    """Return the sum of the drawn values in each resample, shape (N_RESAMPLES,).

    Args:
        draw_counts: What `bootstrap_draw_counts` returned, shape (N_RESAMPLES, n).
        values: One of each log, shape (n,).
    """
    sums = [draw_counts[rows].astype(np.float64) @ values for rows in _iter_resample_slices(len(values))]
    return np.concatenate(sums)


def _iter_resample_slices(n: int) -> Iterator[slice]:
    """Yield slices of the resamples of n logs that have at most `MAX_DRAWN_LOG_COUNTS_IN_MEMORY` counts each."""
    step = min(max(MAX_DRAWN_LOG_COUNTS_IN_MEMORY // n, 1), N_BOOTSTRAP_RESAMPLES)
    for first in range(0, N_BOOTSTRAP_RESAMPLES, step):
        yield slice(first, min(first + step, N_BOOTSTRAP_RESAMPLES))


def metrics_table_of_run(logs: Sequence[LogMetrics], *, seed: int = 0) -> Table:
    """Return the rows of all logs, then the pooled ones under the id `(pooled)`, with a column `log` in front."""
    ids: list[str] = []
    headline = HeadlineCollector()
    for name, rows in (
        *((log.id, log.rows) for log in logs),
        (LOG_ID_OF_ALL_LOGS_POOLED, pool_all_metrics(logs, seed=seed)),
    ):
        for row in rows.values():
            ids.append(name)
            headline.rows.append(tuple(getattr(row, column) for column in METRICS_TABLE_COLUMNS))
    table = headline.to_table()
    return Table(table.name, {"log": ids, **table.columns}, table.docs)
