"""What changed on each log between two runs, the worst log first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import Metric, find_metric
from cwcli.metrics.pooling import LogMetrics

MAX_COUNTED_WORSENING_SHARE = 1e3
"""Greatest worsening that one metric counts with, as a share of its value before: one that was 0 would outweigh all
others. Chosen by hand."""


class Direction(Enum):
    """Which way a metric changed on a log."""

    WORSE = "worse"
    BETTER = "better"
    GONE = "gone"
    NEW = "new"


@dataclass(frozen=True)
class LogMetricChange:
    """One metric on one log in two runs.

    Attributes:
        before, after: Its values; NaN where a run has none.
        worsening: Change for the worse as a share of the value before, negative for the better, 0 where a value lacks.
    """

    metric: str
    unit: str
    before: float
    after: float
    direction: Direction
    worsening: float


@dataclass(frozen=True)
class LogChange:
    """One log in two runs.

    Attributes:
        error: Why it failed in the later run, "" if it did not.
        changes: The metrics that differ, the worst first.
    """

    id: str
    error: str
    changes: tuple[LogMetricChange, ...]

    @property
    def sort_key_by_worsening(self) -> tuple[bool, int, float]:
        """Sort key, higher is worse: failed, number of metrics that are gone, sum of the worsenings of the others."""
        n_gone = sum(change.direction is Direction.GONE for change in self.changes)
        return bool(self.error), n_gone, sum(max(change.worsening, 0.0) for change in self.changes)


def rank_log_changes(
    baseline: Sequence[LogMetrics], candidate: Sequence[LogMetrics], *, tolerance: float
) -> list[LogChange]:
    """Return the logs of both runs on which a compared metric differs or that fail, the worst first.

    Args:
        baseline, candidate: The logs of the runs; ids are unique in each.
        tolerance: Changes of up to this share of the value before, or of a share without a unit by as much, count as
            the same.
    """
    before = {log.id: log for log in baseline if not log.error}
    ranked = []
    for after in candidate:
        if after.id not in before:
            continue
        early = before[after.id]
        names = () if after.error else dict.fromkeys((*early.rows, *after.rows))
        found = [_change_of_metric(name, early, after, tolerance) for name in names]
        changes = sorted(filter(None, found), key=_change_sort_key)
        if changes or after.error:
            ranked.append(LogChange(after.id, after.error, tuple(changes)))
    return sorted(ranked, key=lambda log: log.sort_key_by_worsening, reverse=True)


def _change_sort_key(change: LogMetricChange) -> tuple[bool, float]:
    """Sort key: metrics that are gone come first, then those that got worst."""
    return change.direction is not Direction.GONE, -change.worsening


def _change_of_metric(name: str, early: LogMetrics, late: LogMetrics, tolerance: float) -> LogMetricChange | None:
    """Return the change of one metric on one log; None if it is not compared or the same."""
    metric = find_metric(name)
    if metric is None or not metric.is_compared:
        return None
    before, after = early.metric_value(name), late.metric_value(name)
    if math.isfinite(before) != math.isfinite(after):
        direction = Direction.GONE if math.isfinite(before) else Direction.NEW
        return LogMetricChange(name, metric.unit, before, after, direction, 0.0)
    if not math.isfinite(before):
        return None
    scale = 1.0 if metric.is_share else abs(metric.target if metric.better == "near" else before)
    worsening = _worsening_in_metric_unit(metric, before, after)
    if abs(worsening) <= tolerance * scale:
        return None
    relative = worsening / abs(before) if before else math.copysign(MAX_COUNTED_WORSENING_SHARE, worsening)
    relative = max(-MAX_COUNTED_WORSENING_SHARE, min(MAX_COUNTED_WORSENING_SHARE, relative))
    direction = Direction.WORSE if worsening > 0.0 else Direction.BETTER
    return LogMetricChange(name, metric.unit, before, after, direction, relative)


def _worsening_in_metric_unit(metric: Metric, before: float, after: float) -> float:
    """Return by how much a metric got worse, in its unit; negative: better."""
    if metric.better == "near":
        return abs(after - metric.target) - abs(before - metric.target)
    return before - after if metric.better == "higher" else after - before
