"""Logs by what changed on them: values by hand."""

from __future__ import annotations

import math

import pytest

from cwcli.metrics.headline import find_metric
from cwcli.metrics.log_changes import Direction, rank_log_changes
from cwcli.metrics.pooling import LogMetrics, MetricRow

RMSE, RECALL = "ego.position_rmse_m", "warnings.recall"


def log(name: str, error: str = "", **values: float) -> LogMetrics:
    """A log with metrics; `__` stands for a dot."""
    rows = {}
    for key, value in values.items():
        metric = find_metric(key.replace("__", "."))
        assert metric is not None
        assert metric.is_compared
        sums = (metric.pool, value, 1.0)
        rows[metric.name] = MetricRow(metric.stage, metric.name, value, metric.unit, 100, math.nan, math.nan, *sums)
    return LogMetrics(name, rows, error)


def test_the_worst_log_comes_first_and_those_without_change_are_not_listed() -> None:
    before = [log(name, ego__position_rmse_m=1.0, warnings__recall=1.0) for name in "abcdef"]
    after = [
        log("a", ego__position_rmse_m=1.005, warnings__recall=1.0),  # within 1 %
        log("b", ego__position_rmse_m=0.5, warnings__recall=1.0),  # better
        log("c", ego__position_rmse_m=1.5, warnings__recall=1.0),  # worse by half
        log("d", ego__position_rmse_m=0.9, warnings__recall=0.2),  # better by 10 %, worse by 80 %
        log("e", ego__position_rmse_m=1.0),  # recall is gone
        log("f", error="it is no MCAP file"),
    ]
    ranked = rank_log_changes(before, after, tolerance=0.01)
    assert [each.id for each in ranked] == ["f", "e", "d", "c", "b"]
    assert ranked[0].error == "it is no MCAP file"
    assert [(c.metric, c.direction) for c in ranked[2].changes] == [(RECALL, Direction.WORSE), (RMSE, Direction.BETTER)]
    assert [c.worsening for c in ranked[2].changes] == pytest.approx([0.8, -0.1])
    assert [(c.direction, c.before) for c in ranked[1].changes] == [(Direction.GONE, 1.0)]
    assert math.isnan(ranked[1].changes[0].after)


def test_a_metric_that_was_zero_does_not_hide_the_others() -> None:
    before = [log("a", ego__position_rmse_m=0.0), log("b", ego__position_rmse_m=1.0)]
    after = [log("a", ego__position_rmse_m=1e-3), log("b", ego__position_rmse_m=1.5)]
    ranked = rank_log_changes(before, after, tolerance=0.01)
    assert [each.id for each in ranked] == ["a", "b"]
    assert all(math.isfinite(each.sort_key_by_worsening[2]) for each in ranked)


def test_a_log_of_one_run_alone_is_not_compared() -> None:
    assert not rank_log_changes([log("a", ego__position_rmse_m=1.0)], [log("b", ego__position_rmse_m=9.0)], tolerance=0)
    failed_before = [log("a", error="it is damaged")]
    assert not rank_log_changes(failed_before, [log("a", ego__position_rmse_m=9.0)], tolerance=0)
