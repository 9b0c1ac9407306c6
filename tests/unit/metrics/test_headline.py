"""The registry of headline metrics, their sums, and pooling over logs: by hand."""

import math

import numpy as np
import pytest

from cwcli.metrics.headline import (
    METRICS,
    HeadlineCollector,
    Metric,
    find_metric,
    metric_sort_index,
    metric_value_from_sums,
)
from cwcli.metrics.pooling import (
    LogMetrics,
    MetricRow,
    metric_names,
    metric_rows_by_name,
    metrics_table_of_run,
    pool_all_metrics,
    pool_metric,
)
from cwcli.metrics.table import UNIT_BY_NAME_SUFFIX

FILLED = {"<quantity>": "yaw_rate", "<model>": "cj-cya", "<horizon>": "1.5", "<rule>": "path-ttc", "<measure>": "ttc_s"}


def filled(name: str) -> str:
    for placeholder, text in FILLED.items():
        name = name.replace(placeholder, text)
    return name


def log(name: str, **sums: tuple[float, float]) -> LogMetrics:
    """A log with metrics given as total and weight; __ stands for a dot."""
    headline = HeadlineCollector()
    for metric, (total, weight) in sums.items():
        headline.add_from_sums(metric.replace("__", "."), total, weight)
    return LogMetrics(name, metric_rows_by_name(headline.to_table()))


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_every_name_finds_its_metric_and_ends_in_its_unit(metric: Metric) -> None:
    found = find_metric(filled(metric.name))
    assert found is metric
    ending = metric.name.rpartition("_")[2]
    if metric.unit == "1/h":
        assert metric.name.endswith("_per_hour")
    elif metric.unit == "1/100 km":
        assert metric.name.endswith("_per_100km")
    elif metric.unit:
        assert UNIT_BY_NAME_SUFFIX[ending] == metric.unit
    else:
        assert ending not in UNIT_BY_NAME_SUFFIX


def test_a_metric_with_a_target_says_it_and_no_other_does() -> None:
    assert all(math.isfinite(metric.target) == (metric.better == "near") for metric in METRICS)


def test_only_metrics_with_a_better_side_are_compared() -> None:
    assert all(metric.better for metric in METRICS if metric.is_compared)


def test_root_mean_square_and_its_sums() -> None:
    headline = HeadlineCollector()
    headline.add_errors("ego.position_rmse_m", np.array([3.0, np.nan, 4.0]))
    (row,) = headline.to_table().rows_as_dicts()
    assert row["value"] == pytest.approx(math.sqrt(12.5))
    assert (row["n"], row["total"], row["weight"], row["stage"], row["unit"]) == (2, 25.0, 2.0, "estimate", "m")


def test_extremes_and_shares() -> None:
    headline = HeadlineCollector()
    headline.add_errors("ego.position_max_m", np.array([1.0, 7.0, 2.0]))
    headline.add_share("lanes.found_share", [True, True, False, True])
    headline.add_count("warnings.count", 4)
    values = {row["metric"]: (row["value"], row["n"]) for row in headline.to_table().rows_as_dicts()}
    assert values == {"ego.position_max_m": (7.0, 3), "lanes.found_share": (0.75, 4), "warnings.count": (4.0, 1)}


def test_nothing_to_judge_is_nan_or_no_row() -> None:
    headline = HeadlineCollector()
    headline.add_errors("ego.position_rmse_m", np.array([np.nan]))
    headline.add_from_sums("warnings.precision", 0.0, 0.0)
    (row,) = headline.to_table().rows_as_dicts()
    assert row["metric"] == "warnings.precision"
    assert math.isnan(row["value"]) and math.isnan(row["low"]) and row["n"] == 0


def test_an_unknown_metric_is_refused() -> None:
    with pytest.raises(ValueError, match="no metric"):
        HeadlineCollector().add_from_sums("ego.positon_rmse_m", 1.0, 1.0)


def test_rate_has_the_exact_poisson_interval() -> None:
    headline = HeadlineCollector()
    headline.add_from_sums("warnings.false_alarms_per_hour", 2.0, 0.5)
    (row,) = headline.to_table().rows_as_dicts()
    # Garwood's interval of a count of 2 is 0.24221 to 7.22469; half an hour doubles it
    assert (row["value"], row["low"], row["high"]) == pytest.approx((4.0, 0.48442, 14.44938), abs=1e-4)


def test_pooling_adds_the_sums() -> None:
    logs = [
        log("a", ego__position_rmse_m=(100.0, 4.0), warnings__precision=(1.0, 1.0), ego__position_max_m=(9.0, 1.0)),
        log("b", ego__position_rmse_m=(44.0, 32.0), warnings__precision=(2.0, 4.0), ego__position_max_m=(2.0, 1.0)),
    ]
    found = pool_all_metrics(logs)
    assert found["ego.position_rmse_m"].value == pytest.approx(2.0)  # sqrt(144 / 36), not the mean of 5 and 1.17
    assert found["warnings.precision"].value == pytest.approx(0.6)
    assert found["ego.position_max_m"].value == 9.0
    assert found["ego.position_rmse_m"].n == 36
    # Wilson's interval of 3 of 5
    assert (found["warnings.precision"].low, found["warnings.precision"].high) == pytest.approx(
        (0.2307, 0.8824), abs=1e-4
    )


def test_logs_without_a_value_do_not_count() -> None:
    logs = [log("a", warnings__precision=(0.0, 0.0)), log("b", warnings__precision=(1.0, 2.0))]
    assert pool_all_metrics(logs)["warnings.precision"].value == 0.5


def test_few_logs_have_no_bootstrap_interval_and_more_have_a_seeded_one() -> None:
    rng = np.random.default_rng(1)
    logs = [log(str(k), ego__position_rmse_m=(float(x), 10.0)) for k, x in enumerate(rng.uniform(5, 15, 200))]
    rows = [each.rows["ego.position_rmse_m"] for each in logs]
    assert math.isnan(pool_metric(rows[:4]).low)
    once, again = pool_metric(rows, seed=3), pool_metric(rows, seed=3)
    assert (once.low, once.high) == (again.low, again.high)
    # totals have mean 10 and standard deviation 10 / sqrt(12): the root's error is that / sqrt(200) / 10 / 2
    half = 1.96 * 10.0 / math.sqrt(12.0) / math.sqrt(200.0) / 10.0 / 2.0
    assert once.high - once.low == pytest.approx(2.0 * half, rel=0.15)
    assert once.low < once.value < once.high


def test_value_of_each_pool() -> None:
    assert metric_value_from_sums("rms", 18.0, 2.0) == 3.0
    assert metric_value_from_sums("mean", 18.0, 2.0) == 9.0
    assert (
        metric_value_from_sums("sum", 18.0, 1.0)
        == metric_value_from_sums("max", 18.0, 1.0)
        == metric_value_from_sums("min", 18.0, 1.0)
        == 18.0
    )


def test_names_come_in_the_order_of_the_registry() -> None:
    logs = [log("a", data__faults_count=(0.0, 1.0)), log("b", ego__position_rmse_m=(1.0, 1.0))]
    assert metric_names(logs) == ["ego.position_rmse_m", "data.faults_count"]
    assert metric_sort_index("something.else") == len(METRICS)


def test_run_table_holds_every_log_and_the_pooled_rows() -> None:
    logs = [log("a", warnings__count=(3.0, 1.0)), LogMetrics("b", error="broken"), log("c", warnings__count=(4.0, 1.0))]
    records = metrics_table_of_run(logs).rows_as_dicts()
    assert [(row["log"], row["metric"], row["value"]) for row in records] == [
        ("a", "warnings.count", 3.0),
        ("c", "warnings.count", 4.0),
        ("(pooled)", "warnings.count", 7.0),
    ]


def test_rows_of_a_table_come_back_as_they_were() -> None:
    headline = HeadlineCollector()
    headline.add_from_sums("warnings.recall", 1.0, 4.0)
    (row,) = metric_rows_by_name(headline.to_table()).values()
    assert isinstance(row, MetricRow)
    assert (row.metric, row.value, row.n, row.pool, row.total, row.weight) == (
        "warnings.recall",
        0.25,
        4,
        "mean",
        1.0,
        4.0,
    )
